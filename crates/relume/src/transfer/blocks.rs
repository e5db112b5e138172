//! Which rows are encoded together.

use glam::Vec3;

use crate::sample::{GatherCloud, GatherSample, ViewSamples, cluster_order};
use crate::trace::sampling::hash;
use crate::transfer::rows::{GatherPoint, TILE};

/// Rows in block order: points, the length of each block, and what each row stands for.
pub(super) struct Blocks {
    pub(super) points: Vec<GatherPoint>,
    pub(super) lengths: Vec<usize>,
    /// The pixel, or the gather sample.
    pub(super) owners: Vec<u32>,
}

/// Runs of `length` pixels that lie close together and face alike; the last may be shorter. Pixels that reflect nothing are
/// left out.
pub(super) fn of_pixels(view: &ViewSamples, length: usize, seed: u32) -> Blocks {
    let lit: Vec<u32> =
        (0..view.pixels() as u32).filter(|&pixel| view.centers[pixel as usize].is_lit()).collect();
    let points: Vec<GatherPoint> = lit
        .iter()
        .map(|&pixel| {
            let sample = &view.centers[pixel as usize];
            GatherPoint {
                position: sample.position,
                shading_normal: sample.shading_normal.get(),
                geometric_normal: sample.geometric_normal.get(),
                seed: hash(pixel, seed),
            }
        })
        .collect();
    let low = points.iter().fold(Vec3::INFINITY, |low, point| low.min(point.position));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, point| high.max(point.position));
    let places: Vec<(Vec3, Vec3)> =
        points.iter().map(|point| (point.position, point.shading_normal)).collect();
    let order = cluster_order(&places, low.distance(high), [length, TILE]);
    let lengths = (0..points.len()).step_by(length).map(|first| length.min(points.len() - first)).collect();
    Blocks {
        owners: order.iter().map(|&index| lit[index as usize]).collect(),
        points: order.iter().map(|&index| points[index as usize]).collect(),
        lengths,
    }
}

/// Runs of `length` gather samples, a power of four, or of all if there are fewer: clusters of the tree.
pub(super) fn of_cloud(cloud: &GatherCloud, length: usize, seed: u32) -> Blocks {
    let length = length.min(cloud.len());
    let point = |(index, sample): (usize, &GatherSample)| GatherPoint {
        position: sample.position,
        shading_normal: sample.normal,
        geometric_normal: sample.normal,
        seed: hash(index as u32, seed ^ 0x5bd1_e995),
    };
    Blocks {
        points: cloud.samples.iter().enumerate().map(point).collect(),
        lengths: vec![length; cloud.len() / length],
        owners: (0..cloud.len() as u32).collect(),
    }
}
