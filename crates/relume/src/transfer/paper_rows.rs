//! Rows by the paper's estimator, for comparison: Hasan 2006, section 4.3.
//!
//! The cluster tree is cut where a cluster's squared diagonal over its squared distance falls below a threshold; a
//! random sample of the cluster speaks for all of it; entries are at most 0.1.

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
    /// Fills one row, all zero on entry. Returns the number of rays.
    pub(super) fn row(&self, point: &GatherPoint, row: &mut [f32]) -> u64 {
        let mut rays = 0;
        let mut waiting = vec![(self.bounds.levels.len() - 1, 0_usize)];
        while let Some((level, cluster)) = waiting.pop() {
            let (low, high) = self.bounds.levels[level][cluster];
            if is_below(low, high, point) {
                continue;
            }
            let distance = point.position.distance_squared(0.5 * (low + high));
            if level > 0 && low.distance_squared(high) > self.threshold * distance {
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
            let cosines = point.shading_normal.dot(between).max(0.0) * (-sample.normal.dot(between)).max(0.0);
            let factor = cosines * sample.area / (std::f32::consts::PI * square * square);
            if factor > 0.0 {
                rays += 1;
                let origin = offset_origin(point.position, point.geometric_normal);
                let target = offset_origin(sample.position, sample.normal);
                if !self.accel.occluded(&Ray::between(origin, target)) {
                    row[samples].fill(factor.min(CLAMP));
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
