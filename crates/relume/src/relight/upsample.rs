//! From the receivers' irradiance to the pixels (Hasan 2006, section 3.6).
//!
//! Nearly all samples of a pixel, and of what it shows in mirrors and through glass, take their light from one receiver or two. What they reflect of it
//! is added up once for a shot: a frame then reads one receiver or two a pixel in place of every sample.

use glam::Vec3;
use rayon::prelude::*;

use crate::sample::{Receivers, ViewGrid, ViewSample};
use crate::transfer::Transfer;

/// Pixels that one task puts together.
const CHUNK: usize = 4096;

/// What a pixel reflects of the light at one receiver, towards the camera.
#[derive(Clone, Copy)]
struct Part {
    receiver: u32,
    /// Of the light over the hemisphere: `k_d`, averaged over the pixel.
    diffuse: Vec3,
    /// Of that along the specular lobe: `k_g`.
    glossy: Vec3,
}

/// What the pixels reflect of the light at the receivers.
pub(super) struct Reflection {
    parts: Vec<Part>,
    /// Where each pixel's parts end.
    ends: Vec<u32>,
}

/// Of a chunk of pixels.
#[derive(Default)]
struct Parts {
    parts: Vec<Part>,
    /// How many are those of each pixel.
    counts: Vec<u32>,
}

/// What a sample reflects.
struct Tints<'a> {
    /// By material, what the samples' `k_d` is multiplied by.
    scales: Option<&'a [Vec3]>,
    /// Whether there is light along lobes.
    glossy: bool,
}

impl Tints<'_> {
    fn of(&self, sample: &ViewSample, eye: Vec3, receiver: u32, weight: Vec3) -> Part {
        let k_d = match self.scales {
            Some(scales) => sample.diffuse.get() * scales[sample.material as usize],
            None => sample.diffuse.get(),
        };
        let k_g = if self.glossy {
            let to_camera = (eye - sample.position) / sample.depth;
            let surface = sample.surface();
            surface.specular_albedo(to_camera.dot(surface.shading_normal))
        } else {
            Vec3::ZERO
        };
        Part { receiver, diffuse: weight * k_d, glossy: weight * k_g }
    }
}

impl Parts {
    /// Adds to the pixel at hand, whose parts begin at `first`.
    fn add(&mut self, first: usize, part: Part) {
        match self.parts[first..].iter_mut().find(|before| before.receiver == part.receiver) {
            Some(before) => {
                before.diffuse += part.diffuse;
                before.glossy += part.glossy;
            }
            None => self.parts.push(part),
        }
    }
}

impl Reflection {
    /// Of one grid of samples. `scales` is, by material, what the samples' `k_d` is multiplied by; none where that is 1 for all.
    pub(super) fn new(transfer: &Transfer, scales: Option<&[Vec3]>, aa: u32) -> Self {
        let view = &transfer.view;
        let ViewGrid { samples, chains, a_pixel, .. } = view.grid(aa);
        let [receivers, branch_receivers] = transfer.receivers_of(aa);
        let share = Vec3::splat(1.0 / a_pixel as f32);
        let tints = Tints { scales, glossy: transfer.glossy.is_some() };
        let pixel_of = |branch: u32| chains.branches[branch as usize].owner as usize / a_pixel;
        let lit = |branch: &u32| branch_receivers[*branch as usize] != Receivers::NONE;
        let mut behind: Vec<u32> = (0..chains.branches.len() as u32).filter(lit).collect();
        behind.sort_by_key(|&branch| pixel_of(branch));
        let chunk = |start: usize| {
            let mut parts = Parts::default();
            let mut behind = &behind[behind.partition_point(|&branch| pixel_of(branch) < start)..];
            for pixel in start..(start + CHUNK).min(view.pixels()) {
                let first = parts.parts.len();
                for index in
                    (pixel * a_pixel..(pixel + 1) * a_pixel).filter(|&i| receivers[i] != Receivers::NONE)
                {
                    parts.add(
                        first,
                        tints.of(&samples[index], view.camera.position(), receivers[index], share),
                    );
                }
                while let Some((&index, rest)) = behind.split_first().filter(|(b, _)| pixel_of(**b) == pixel)
                {
                    let (branch, receiver) =
                        (&chains.branches[index as usize], branch_receivers[index as usize]);
                    let weight = share * branch.throughput.get();
                    parts.add(first, tints.of(&branch.sample, branch.eye, receiver, weight));
                    behind = rest;
                }
                parts.counts.push((parts.parts.len() - first) as u32);
            }
            parts
        };
        let chunks: Vec<Parts> = (0..view.pixels()).into_par_iter().step_by(CHUNK).map(chunk).collect();
        let mut end = 0;
        let counts = chunks.iter().flat_map(|chunk| &chunk.counts);
        let ends = counts.map(|count| {
            end += count;
            end
        });
        Self { ends: ends.collect(), parts: chunks.iter().flat_map(|chunk| &chunk.parts).copied().collect() }
    }

    /// Bytes of both arrays.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.parts) + size_of_val(&*self.ends)
    }

    /// What the pixels reflect of light that was gathered, one value a receiver: over the hemisphere, and along the lobes, where there is any.
    pub(super) fn upsample(&self, diffuse: &[Vec3], glossy: Option<&[Vec3]>) -> Vec<Vec3> {
        let reflected = |part: &Part| {
            let receiver = part.receiver as usize;
            let glossy = glossy.map_or(Vec3::ZERO, |glossy| part.glossy * glossy[receiver]);
            part.diffuse * diffuse[receiver] + glossy
        };
        let of_pixel = |pixel: usize| {
            let first = pixel.checked_sub(1).map_or(0, |before| self.ends[before]);
            self.parts[first as usize..self.ends[pixel] as usize].iter().map(reflected).sum()
        };
        (0..self.ends.len()).into_par_iter().with_min_len(CHUNK).map(of_pixel).collect()
    }
}
