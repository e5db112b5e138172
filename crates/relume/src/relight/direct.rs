//! Direct light on the view samples, with ray-traced shadows.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::RelightSettings;
use crate::sample::{Chains, ViewGrid, ViewSample, ViewSamples};
use crate::scene::Light;
use crate::shade::{self, Dome, PointGroup, PreparedLight};
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Accel, Ray};

/// Shadow rays a pixel towards a light with extent, spread over its samples. More make soft shadows smoother.
const SOFT_RAYS: usize = 16;
/// The same in a preview, where towards a light without extent there is one.
const PREVIEW_SOFT_RAYS: usize = 4;
/// Samples that are asked for together whether a light could reach them: those of some pixels side by side.
const GROUP: usize = 64;
/// Samples that one task shades, whole groups.
const CHUNK: usize = 2048;

/// What is lit.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) samples: &'a ViewSamples,
    /// By material, what the samples' `k_d` is multiplied by; none where that is 1 for all.
    pub(super) scales: Option<&'a [Vec3]>,
    /// The samples of the grid that is lit, [`GROUP`] by [`GROUP`].
    pub(super) groups: &'a [PointGroup],
}

/// The samples of a grid that can be lit, [`GROUP`] by [`GROUP`].
pub(super) fn view_groups(samples: &[ViewSample]) -> Vec<PointGroup> {
    let group = |samples: &[ViewSample]| {
        let lit = samples.iter().filter(|sample| sample.reflects());
        PointGroup::new(lit.map(|sample| (sample.position, sample.geometric_normal.get())))
    };
    samples.par_chunks(GROUP).with_min_len(64).map(group).collect()
}

/// One view sample as it is seen.
struct Seen<'a> {
    sample: &'a ViewSample,
    /// Unit, to where its light goes.
    view: Vec3,
    /// The part of that light which reaches the camera.
    throughput: Vec3,
}

/// One light's direct light on every pixel, and the number of shadow rays.
pub(super) fn direct(
    view: View<'_>,
    accel: &Accel,
    light: &Light,
    settings: &RelightSettings,
) -> (Vec<Vec3>, u64) {
    let soft_rays = if settings.preview { PREVIEW_SOFT_RAYS } else { SOFT_RAYS };
    let prepared = PreparedLight::new(light);
    let ViewGrid { samples, chains, a_pixel, .. } = view.samples.grid(settings.aa);
    let camera = view.samples.camera.position();
    let rays = if prepared.needs_samples() { soft_rays / a_pixel } else { 1 };
    let shading = Shading { light: &prepared, view, rays, accel };
    let share = 1.0 / (a_pixel * rays) as f32;
    let mut pixels = vec![Vec3::ZERO; view.samples.pixels()];
    let straight: u64 = pixels
        .par_chunks_mut(CHUNK / a_pixel)
        .zip(samples.par_chunks(CHUNK / a_pixel * a_pixel))
        .enumerate()
        .map(|(chunk, (pixels, samples))| {
            let first = chunk * (CHUNK / a_pixel) * a_pixel;
            let reached = samples
                .chunks(GROUP)
                .enumerate()
                .filter(|(group, _)| prepared.may_reach(&view.groups[first / GROUP + group]));
            let seen = reached.flat_map(|(group, samples)| {
                (group * GROUP..).zip(samples).map(|(index, sample)| {
                    let view = (camera - sample.position) / sample.depth;
                    (index, Seen { sample, view, throughput: Vec3::ONE })
                })
            });
            let add = |index: usize, radiance| pixels[index / a_pixel] += radiance * share;
            if settings.preview && !prepared.needs_samples() {
                shading.run_shared(seen, (first, a_pixel), add)
            } else {
                shading.run(seen, first, add)
            }
        })
        .sum();
    let behind = chains.branches.par_chunks(CHUNK).enumerate().map(|(chunk, branches)| {
        let seen = branches.iter().enumerate().map(|(index, branch)| {
            let throughput = branch.throughput.get();
            (index, Seen { sample: &branch.sample, view: branch.view(), throughput })
        });
        let mut lit = Vec::new();
        let first = samples.len() + chunk * CHUNK;
        let rays = shading.run(seen, first, |index, radiance| {
            lit.push((branches[index].owner as usize / a_pixel, radiance * share));
        });
        (lit, rays)
    });
    let behind: Vec<_> = behind.collect();
    for &(pixel, radiance) in behind.iter().flat_map(|(lit, _)| lit) {
        pixels[pixel] += radiance;
    }
    for (owner, radiance) in mirrored(chains, &prepared) {
        pixels[owner as usize / a_pixel] += radiance / a_pixel as f32;
    }
    (pixels, straight + behind.iter().map(|(_, rays)| rays).sum::<u64>())
}

/// What views that were turned show of the light itself.
fn mirrored(chains: &Chains, light: &PreparedLight) -> Vec<(u32, Vec3)> {
    let branches = chains.branches.par_iter().with_min_len(CHUNK).filter_map(|branch| {
        let radiance = light.seen_along(&branch.last_ray(), &branch.cone()?);
        (radiance != Vec3::ZERO).then(|| (branch.owner, radiance * branch.throughput.get()))
    });
    let sky = chains.sky.par_iter().with_min_len(CHUNK).filter_map(|view| {
        let radiance = light.seen_along(&view.ray(), &view.cone());
        (radiance != Vec3::ZERO).then(|| (view.owner, radiance * view.throughput))
    });
    branches.chain(sky).collect()
}

struct Shading<'a> {
    light: &'a PreparedLight,
    view: View<'a>,
    /// Shadow rays a sample.
    rays: usize,
    accel: &'a Accel,
}

impl Shading<'_> {
    /// Tells `add` the numbers of the samples that light reaches, and what of it reaches the camera, ray by ray. `first` is the number of the
    /// first sample for the random numbers. Returns the rays.
    fn run<'s>(
        &self,
        seen: impl Iterator<Item = (usize, Seen<'s>)>,
        first: usize,
        add: impl FnMut(usize, Vec3),
    ) -> u64 {
        let (mut rays, mut waiting) = (Vec::new(), Vec::new());
        for (index, seen) in seen.filter(|(_, seen)| seen.sample.reflects()) {
            for which in 0..self.rays {
                if let Some((ray, radiance)) = self.unshadowed(&seen, first + index, which) {
                    rays.push(ray);
                    waiting.push((index, radiance));
                }
            }
        }
        self.trace(&rays, &waiting, add)
    }

    /// Tells `add` what waits for those of `rays` that are free. Returns how many rays there are.
    fn trace(&self, rays: &[Ray], waiting: &[(usize, Vec3)], mut add: impl FnMut(usize, Vec3)) -> u64 {
        let mut blocked = vec![false; rays.len()];
        self.accel.occluded_batch(rays, &mut blocked);
        for (&(index, radiance), _) in waiting.iter().zip(&blocked).filter(|&(_, &blocked)| !blocked) {
            add(index, radiance);
        }
        rays.len() as u64
    }

    /// The same with one ray for each pixel, of `a_pixel` samples, whose answer stands for all of these. It starts from another sample than in
    /// neighbouring pixels, so that together they look at all places within a pixel.
    fn run_shared<'s>(
        &self,
        seen: impl Iterator<Item = (usize, Seen<'s>)>,
        (first, a_pixel): (usize, usize),
        add: impl FnMut(usize, Vec3),
    ) -> u64 {
        let width = self.view.samples.width;
        let (mut rays, mut waiting): (Vec<Ray>, Vec<(usize, Vec3)>) = (Vec::new(), Vec::new());
        for (index, seen) in seen.filter(|(_, seen)| seen.sample.reflects()) {
            let Some((ray, radiance)) = self.unshadowed(&seen, first + index, 0) else { continue };
            let pixel = (first + index) / a_pixel;
            let is_favoured = index % a_pixel == (pixel % width + 2 * (pixel / width)) % a_pixel;
            match (waiting.last_mut(), rays.last_mut()) {
                (Some((before, sum)), Some(chosen)) if *before / a_pixel == index / a_pixel => {
                    *sum += radiance;
                    if is_favoured {
                        *chosen = ray;
                    }
                }
                _ => {
                    rays.push(ray);
                    waiting.push((index, radiance));
                }
            }
        }
        self.trace(&rays, &waiting, add)
    }

    /// A shadow ray and the radiance that reaches the camera if it is free.
    fn unshadowed(&self, seen: &Seen<'_>, number: usize, which: usize) -> Option<(Ray, Vec3)> {
        let random = if self.light.needs_samples() {
            sobol_2d(which as u32, 0, hash(number as u32, 0x51_a9))
        } else {
            Vec2::ZERO
        };
        let sample = seen.sample;
        let arriving = self.light.sample(sample.position, random)?;
        let geometric = sample.geometric_normal.get();
        let cos = sample.shading_normal.get().dot(arriving.direction);
        if cos <= 0.0 || geometric.dot(arriving.direction) <= 0.0 {
            return None;
        }
        let surface = sample.surface();
        let k_d = match self.view.scales {
            Some(scales) => surface.diffuse_albedo * scales[sample.material as usize],
            None => surface.diffuse_albedo,
        };
        let brdf = k_d * std::f32::consts::FRAC_1_PI + surface.specular(seen.view, arriving.direction);
        let radiance = seen.throughput * brdf * arriving.irradiance * cos;
        let ray = shade::shadow_ray(sample.position, geometric, &arriving);
        (radiance != Vec3::ZERO).then_some((ray, radiance))
    }
}

/// Adds what surfaces that the camera sees emit, those of the materials that `shines` says.
pub(super) fn add_emission(grid: ViewGrid<'_>, shines: impl Fn(u32) -> bool, pixels: &mut [Vec3]) {
    for (sample, _, radiance) in grid.emitted().filter(|&(_, material, _)| shines(material)) {
        pixels[sample / grid.a_pixel] += radiance / grid.a_pixel as f32;
    }
}

/// Adds what `dome` shows where views leave the scene by way of mirrors and glass. The suns of its map are lights of their own.
pub(super) fn add_sky(grid: ViewGrid<'_>, dome: &Dome, pixels: &mut [Vec3]) {
    for view in &grid.chains.sky {
        let radiance = view.throughput * dome.radiance_without_suns(view.direction);
        pixels[view.owner as usize / grid.a_pixel] += radiance / grid.a_pixel as f32;
    }
}
