//! Rows by the paper's estimator, for comparison: Hasan 2006, section 4.3.
//!
//! The cluster tree is cut where a cluster's squared diagonal over its squared distance falls below a threshold; a
//! random sample of the cluster speaks for all of it; entries are at most 0.1.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::tiles::GatherPoint;
use crate::sample::GatherCloud;
use crate::trace::sampling::{hash, unit};
use crate::trace::{Accel, Ray, offset_origin};

/// Entries are clamped to this, "which leads to some darkening in the corners".
const CLAMP: f32 = 0.1;

/// Bounds of every cluster of the tree, level by level from the leaves.
pub(super) struct ClusterBounds {
    /// `levels[j][i]`: smallest and largest corner of the samples `i * 4^j .. (i + 1) * 4^j`.
    levels: Vec<Vec<(Vec3, Vec3)>>,
}

impl ClusterBounds {
    pub(super) fn new(cloud: &GatherCloud) -> Self {
        let mut levels = vec![cloud.samples.iter().map(|s| (s.position, s.position)).collect::<Vec<_>>()];
        while let Some(finer) = levels.last().filter(|level| level.len() > 1) {
            let coarser = finer
                .chunks(4)
                .map(|four| four.iter().fold(four[0], |all, one| (all.0.min(one.0), all.1.max(one.1))))
                .collect();
            levels.push(coarser);
        }
        Self { levels }
    }
}

/// What the paper's rows are made of.
#[derive(Clone, Copy)]
pub(super) struct PaperRows<'a> {
    pub(super) accel: &'a Accel,
    pub(super) cloud: &'a GatherCloud,
    pub(super) bounds: &'a ClusterBounds,
    /// Clusters are opened while `s^2 / d^2` is above this. Smaller is slower and closer.
    pub(super) threshold: f32,
}

impl PaperRows<'_> {
    /// Fills one row of the diffuse final gather, all zero on entry. Returns the number of rays.
    pub(super) fn row(&self, point: &GatherPoint, row: &mut [f32]) -> u64 {
        let response = |direction: Vec3| point.shading_normal.dot(direction).max(0.0) * FRAC_1_PI;
        self.row_of(point, response, |_, _| 1.0, CLAMP, row)
    }

    /// The same of the glossy final gather: "the subdivision threshold will depend on the value of the lobe".
    pub(super) fn glossy_row(&self, point: &GatherPoint, row: &mut [f32]) -> u64 {
        let Some(lobe) = point.lobe else { return 0 };
        let mirrored = lobe.mirrored();
        let peak = |middle: Vec3, radius: f32| {
            let (distance, direction) = (middle.length(), middle.normalize_or(mirrored));
            let (apart, cone) = (direction.angle_between(mirrored), (radius / distance.max(radius)).asin());
            // the direction within the cluster's cone that is nearest to the lobe's peak
            let way = if apart > cone { cone / apart } else { 1.0 };
            PI * lobe.response(direction.lerp(mirrored, way).normalize_or(mirrored))
        };
        // one cell may rightly hold all of a lobe
        self.row_of(point, |direction| lobe.response(direction), peak, 1.0, row)
    }

    /// `response` is the BRDF times the cosine towards a unit direction. `peak` says how many times the diffuse response it is at most
    /// towards a sphere, given by its middle from the point and its radius. Entries are at most `clamp`.
    fn row_of(
        &self,
        point: &GatherPoint,
        response: impl Fn(Vec3) -> f32,
        peak: impl Fn(Vec3, f32) -> f32,
        clamp: f32,
        row: &mut [f32],
    ) -> u64 {
        let mut rays = 0;
        let mut waiting = vec![(self.bounds.levels.len() - 1, 0_usize)];
        while let Some((level, cluster)) = waiting.pop() {
            let (low, high) = self.bounds.levels[level][cluster];
            if is_below(low, high, point) {
                continue;
            }
            let middle = 0.5 * (low + high) - point.position;
            let diagonal = low.distance_squared(high);
            let sharpness = peak(middle, 0.5 * diagonal.sqrt()).max(1.0);
            if level > 0 && diagonal * sharpness > self.threshold * middle.length_squared() {
                waiting.extend((0..4).map(|child| (level - 1, 4 * cluster + child)));
                continue;
            }
            let size = 1 << (2 * level);
            let samples = cluster * size..(cluster + 1) * size;
            let random = unit(hash(cluster as u32 ^ (level as u32) << 24, point.seed));
            let chosen = samples.start + ((random * size as f32) as usize).min(size - 1);
            let sample = &self.cloud.samples[chosen];
            let between = sample.position - point.position;
            let square = between.length_squared().max(1e-12);
            let direction = between / square.sqrt();
            let facing = (-sample.normal.dot(direction)).max(0.0);
            let factor = response(direction) * facing * sample.area / square;
            if factor > 0.0 {
                rays += 1;
                let origin = offset_origin(point.position, point.geometric_normal);
                let target = offset_origin(sample.position, sample.normal);
                if !self.accel.occluded(&Ray::between(origin, target)) {
                    row[samples].fill(factor.min(clamp));
                }
            }
        }
        rays
    }
}

/// Whether a box lies wholly below the point's horizon.
fn is_below(low: Vec3, high: Vec3, point: &GatherPoint) -> bool {
    let normal = point.shading_normal;
    let farthest = Vec3::select(normal.cmpge(Vec3::ZERO), high, low);
    (farthest - point.position).dot(normal) <= 0.0
}
