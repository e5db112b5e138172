//! Direct light on the view samples, with ray-traced shadows.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::sample::{ViewSample, ViewSamples};
use crate::scene::Light;
use crate::shade::{self, PreparedLight};
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Accel, Ray};

/// Shadow rays a pixel towards a light with extent, spread over its samples. More make soft shadows smoother.
const SOFT_RAYS: usize = 16;
/// Samples that one task shades.
const CHUNK: usize = 2048;

/// What is lit.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) samples: &'a ViewSamples,
    /// By material, what the samples' `k_d` is multiplied by; none where that is 1 for all.
    pub(super) scales: Option<&'a [Vec3]>,
}

/// One light's direct light on every pixel, and the number of shadow rays.
pub(super) fn direct(view: View<'_>, accel: &Accel, light: &Light, aa: u32) -> (Vec<Vec3>, u64) {
    let View { samples: view, scales } = view;
    let prepared = PreparedLight::new(light);
    let (samples, a_pixel) = if aa == 1 { (&view.centers, 1) } else { (&view.quads, 4) };
    let rays = if prepared.needs_samples() { SOFT_RAYS / a_pixel } else { 1 };
    let mut pixels = vec![Vec3::ZERO; view.pixels()];
    let spent = pixels
        .par_chunks_mut(CHUNK / a_pixel)
        .enumerate()
        .map(|(chunk, pixels)| {
            let first = chunk * (CHUNK / a_pixel) * a_pixel;
            let samples = &samples[first..first + pixels.len() * a_pixel];
            let shading = Shading { light: &prepared, camera: view.camera, scales, rays, first };
            shading.run(samples, accel, a_pixel, pixels)
        })
        .sum();
    (pixels, spent)
}

struct Shading<'a> {
    light: &'a PreparedLight,
    camera: Vec3,
    /// See [`View::scales`].
    scales: Option<&'a [Vec3]>,
    /// Shadow rays a sample.
    rays: usize,
    /// Number of the first sample, for its random numbers.
    first: usize,
}

impl Shading<'_> {
    fn run(&self, samples: &[ViewSample], accel: &Accel, a_pixel: usize, pixels: &mut [Vec3]) -> u64 {
        let (mut rays, mut waiting) = (Vec::with_capacity(samples.len() * self.rays), Vec::new());
        for (index, sample) in samples.iter().enumerate().filter(|(_, sample)| sample.is_lit()) {
            for which in 0..self.rays {
                if let Some((ray, radiance)) = self.unshadowed(sample, index, which) {
                    rays.push(ray);
                    waiting.push((index / a_pixel, radiance));
                }
            }
        }
        let mut blocked = vec![false; rays.len()];
        accel.occluded_batch(&rays, &mut blocked);
        let share = 1.0 / (a_pixel * self.rays) as f32;
        for (&(pixel, radiance), _) in waiting.iter().zip(&blocked).filter(|&(_, &blocked)| !blocked) {
            pixels[pixel] += radiance * share;
        }
        rays.len() as u64
    }

    /// A shadow ray and the radiance that reaches the camera if it is free.
    fn unshadowed(&self, sample: &ViewSample, index: usize, which: usize) -> Option<(Ray, Vec3)> {
        let random = if self.light.needs_samples() {
            sobol_2d(which as u32, 0, hash((self.first + index) as u32, 0x51_a9))
        } else {
            Vec2::ZERO
        };
        let arriving = self.light.sample(sample.position, random)?;
        let geometric = sample.geometric_normal.get();
        let cos = sample.shading_normal.get().dot(arriving.direction);
        if cos <= 0.0 || geometric.dot(arriving.direction) <= 0.0 {
            return None;
        }
        let surface = sample.surface();
        let view = (self.camera - sample.position) / sample.depth;
        let k_d = match self.scales {
            Some(scales) => surface.diffuse_albedo * scales[sample.material as usize],
            None => surface.diffuse_albedo,
        };
        let brdf = k_d * std::f32::consts::FRAC_1_PI + surface.specular(view, arriving.direction);
        let radiance = brdf * arriving.irradiance * cos;
        let ray = shade::shadow_ray(sample.position, geometric, &arriving);
        (radiance != Vec3::ZERO).then_some((ray, radiance))
    }
}

/// Adds what surfaces that the camera sees emit, those of the materials that `shines` says.
pub(super) fn add_emission(view: &ViewSamples, aa: u32, shines: impl Fn(u32) -> bool, pixels: &mut [Vec3]) {
    let (samples, emission, a_pixel) = if aa == 1 {
        (&view.centers, &view.center_emission, 1)
    } else {
        (&view.quads, &view.quad_emission, 4)
    };
    for &(sample, radiance) in emission {
        if shines(samples[sample as usize].material) {
            pixels[sample as usize / a_pixel] += radiance / a_pixel as f32;
        }
    }
}
