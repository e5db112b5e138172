//! What this machine can do at best, to tell a stage's rate as a share of it.

use std::hint::black_box;
use std::time::Instant;

use rayon::prelude::*;
use relume::sample::ViewSamples;
use relume::trace::{Accel, Ray, offset_origin};
use serde::Serialize;

/// Bytes that are read to measure bandwidth: more than caches hold.
const STREAMED: usize = 256 << 20;
/// Bytes that one task reads.
const PART: usize = 1 << 20;
/// Rays that one task traces.
const CHUNK: usize = 4096;
/// The best of so many runs counts.
const RUNS: usize = 5;

/// Ceilings of this machine, on the threads at hand.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Ceiling {
    /// Memory read from start to end.
    pub(super) read_gb_per_s: f64,
    /// Rays of this shot that run side by side as well as rays can and meet nothing: from all view samples to the camera, millions.
    pub(super) mrays_per_s: f64,
}

impl Ceiling {
    pub(super) fn measured(view: &ViewSamples, accel: &Accel) -> Self {
        Self { read_gb_per_s: read_rate() / 1e9, mrays_per_s: ray_rate(view, accel) / 1e6 }
    }
}

/// The most work a second of some runs.
fn best(work: usize, run: impl Fn()) -> f64 {
    let rate = |_| {
        let began = Instant::now();
        run();
        work as f64 / began.elapsed().as_secs_f64().max(1e-9)
    };
    (0..RUNS).map(rate).fold(0.0, f64::max)
}

fn read_rate() -> f64 {
    let memory: Vec<u64> = vec![1; STREAMED / size_of::<u64>()];
    let sum = |part: &[u64]| part.iter().fold(0_u64, |sum, value| sum.wrapping_add(*value));
    best(STREAMED, || {
        let sum: u64 = memory.par_chunks(PART / size_of::<u64>()).map(sum).sum();
        black_box(sum);
    })
}

fn ray_rate(view: &ViewSamples, accel: &Accel) -> f64 {
    let seen = view.quads.iter().filter(|sample| !sample.is_sky());
    let to_camera = |sample: &relume::sample::ViewSample| {
        Ray::between(offset_origin(sample.position, sample.geometric_normal.get()), view.camera.position())
    };
    let rays: Vec<Ray> = seen.map(to_camera).collect();
    best(rays.len(), || {
        rays.par_chunks(CHUNK).for_each(|rays| {
            let mut blocked = vec![false; rays.len()];
            accel.occluded_batch(rays, &mut blocked);
            black_box(&blocked);
        });
    })
}
