//! Which rows are encoded together.

use crate::sample::{GatherCloud, ViewSamples};
use crate::trace::sampling::hash;
use crate::transfer::rows::GatherPoint;

/// Rows in block order: points, the length of each block, and what each row stands for.
pub(super) struct Blocks {
    pub(super) points: Vec<GatherPoint>,
    pub(super) lengths: Vec<usize>,
    /// The pixel, or the gather sample.
    pub(super) owners: Vec<u32>,
}

/// The bits of `index` at even places, packed: half of a Morton code.
fn every_other_bit(index: usize) -> usize {
    (0..16).map(|bit| (index >> (2 * bit) & 1) << bit).sum()
}

/// Squares of `edge x edge` pixels, `edge` a power of two. Within a block, pixels come in Morton order, so that each run
/// of 16 is a 4x4 tile. Pixels that reflect nothing are left out.
pub(super) fn of_pixels(view: &ViewSamples, edge: usize, seed: u32) -> Blocks {
    let mut blocks = Blocks { points: Vec::new(), lengths: Vec::new(), owners: Vec::new() };
    for top in (0..view.height).step_by(edge) {
        for left in (0..view.width).step_by(edge) {
            let before = blocks.points.len();
            for index in 0..edge * edge {
                let (x, y) = (left + every_other_bit(index), top + every_other_bit(index >> 1));
                if x >= view.width || y >= view.height {
                    continue;
                }
                let pixel = y * view.width + x;
                let sample = &view.centers[pixel];
                if sample.is_lit() {
                    blocks.owners.push(pixel as u32);
                    blocks.points.push(GatherPoint {
                        position: sample.position,
                        shading_normal: sample.shading_normal.get(),
                        geometric_normal: sample.geometric_normal.get(),
                        seed: hash(pixel as u32, seed),
                    });
                }
            }
            if blocks.points.len() > before {
                blocks.lengths.push(blocks.points.len() - before);
            }
        }
    }
    blocks
}

/// Runs of `length` gather samples, a power of four, or of all if there are fewer: clusters of the tree.
pub(super) fn of_cloud(cloud: &GatherCloud, length: usize, seed: u32) -> Blocks {
    let length = length.min(cloud.len());
    let point = |(index, sample): (usize, &crate::sample::GatherSample)| GatherPoint {
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
