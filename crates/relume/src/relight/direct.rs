//! Direct light on the view samples, with ray-traced shadows.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::RelightSettings;
use super::lanes::{LANES, Lanes, LitSample};
use crate::sample::{Chains, PackedNormal, ViewGrid, ViewSample, ViewSamples};
use crate::scene::Light;
use crate::shade::{self, Dome, LightSample, PointGroup, PreparedLight};
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Accel, Ray};

/// Shadow rays a pixel towards a light with extent, spread over its samples. More make soft shadows smoother.
const SOFT_RAYS: usize = 16;
/// The same in a preview, where towards a light without extent there is one.
const PREVIEW_SOFT_RAYS: usize = 4;
/// Pixels along a side of the tiles whose rays travel together, and that are asked for together whether a light could reach them.
const TILE: usize = 4;
/// Rays that are traced at a time.
const BATCH: usize = 1024;
/// Branches that one task shades.
const CHUNK: usize = 2048;

/// What is lit.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) samples: &'a ViewSamples,
    /// By material, what the samples' `k_d` is multiplied by; none where that is 1 for all.
    pub(super) scales: Option<&'a [Vec3]>,
    /// The samples of the tiles of the grid that is lit, row by row.
    pub(super) tiles: &'a [PointGroup],
}

/// The pixels of a tile that begins at a column, by number in its row of tiles: four by four, so that those of a packet are a square.
fn of_tile(column: usize, (width, height): (usize, usize)) -> impl Iterator<Item = usize> + Clone {
    let place = |i: usize| (i & 1 | i >> 1 & 2, i >> 1 & 1 | i >> 2 & 2);
    let inside = move |&(x, y): &(usize, usize)| column + x < width && y < height;
    (0..TILE * TILE).map(place).filter(inside).map(move |(x, y)| y * width + column + x)
}

/// What of a grid can be lit, tile by tile, row by row.
pub(super) fn tiles(samples: &ViewSamples, aa: u32) -> Vec<PointGroup> {
    let width = samples.width;
    let ViewGrid { samples, a_pixel, .. } = samples.grid(aa);
    let row = |row: &[ViewSample]| -> Vec<PointGroup> {
        let height = row.len() / (width * a_pixel);
        let tile = |column| {
            let of_pixel = |pixel| row[pixel * a_pixel..(pixel + 1) * a_pixel].iter();
            let lit = of_tile(column, (width, height)).flat_map(of_pixel).filter(|sample| sample.reflects());
            PointGroup::new(lit.map(|sample| (sample.position, sample.geometric_normal.get())))
        };
        (0..width).step_by(TILE).map(tile).collect()
    };
    samples.par_chunks(TILE * width * a_pixel).flat_map_iter(row).collect()
}

/// One view sample as it is seen.
#[derive(Clone, Copy)]
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
    let shares = settings.preview && !prepared.needs_samples();
    let shading =
        Shading { light: &prepared, view, rays, accel, shared_by: if shares { a_pixel } else { 1 } };
    let share = 1.0 / (a_pixel * rays) as f32;
    let mut pixels = vec![Vec3::ZERO; view.samples.pixels()];
    let width = view.samples.width;
    let straight: u64 = pixels
        .par_chunks_mut(TILE * width)
        .zip(samples.par_chunks(TILE * width * a_pixel))
        .zip(view.tiles.par_chunks(width.div_ceil(TILE)))
        .enumerate()
        .map(|(row, ((pixels, samples), tiles))| {
            let (first, height) = (row * TILE * width * a_pixel, pixels.len() / width);
            let reached = (0..width).step_by(TILE).zip(tiles).filter(|(_, tile)| prepared.may_reach(tile));
            let seen = reached
                .flat_map(|(column, _)| of_tile(column, (width, height)))
                .flat_map(|pixel| pixel * a_pixel..(pixel + 1) * a_pixel)
                .map(|index| {
                    let sample = &samples[index];
                    let view = (camera - sample.position) / sample.depth;
                    (index, Seen { sample, view, throughput: Vec3::ONE })
                });
            shading.run(seen, first, |index, radiance| pixels[index / a_pixel] += radiance * share)
        })
        .sum();
    let behind = chains.branches.par_chunks(CHUNK).enumerate().map(|(chunk, branches)| {
        let seen = branches.iter().enumerate().map(|(index, branch)| {
            let throughput = branch.throughput.get();
            (index, Seen { sample: &branch.sample, view: branch.view(), throughput })
        });
        let mut lit = Vec::new();
        let first = samples.len() + chunk * CHUNK;
        let alone = Shading { shared_by: 1, ..shading };
        let rays = alone.run(seen, first, |index, radiance| {
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

#[derive(Clone, Copy)]
struct Shading<'a> {
    light: &'a PreparedLight,
    view: View<'a>,
    /// Shadow rays a sample.
    rays: usize,
    /// Samples of a pixel that take their answer from one ray. It starts from another sample than in neighbouring pixels, so that together they look at all
    /// places within a pixel.
    shared_by: usize,
    accel: &'a Accel,
}

/// A view sample that light reaches unless its ray is blocked.
struct Waiting<'a> {
    index: usize,
    seen: Seen<'a>,
    shading_normal: Vec3,
    arriving: LightSample,
    /// Between the light and the shading normal.
    cos: f32,
    /// Its ray's number.
    ray: usize,
}

impl Shading<'_> {
    /// Tells `add` the numbers of the samples that light reaches, and what of it reaches the camera, ray by ray. `first` is the number of the
    /// first sample for the random numbers. Returns the rays.
    fn run<'s>(
        &self,
        seen: impl Iterator<Item = (usize, Seen<'s>)>,
        first: usize,
        mut add: impl FnMut(usize, Vec3),
    ) -> u64 {
        let (mut rays, mut waiting): (Vec<Ray>, Vec<Waiting<'_>>) = (Vec::new(), Vec::new());
        let (mut count, mut geometric) = (0, Normals::default());
        let mut shading = Normals::default();
        let width = self.view.samples.width;
        for (index, seen) in seen.filter(|(_, seen)| seen.sample.reflects()) {
            let group = index / self.shared_by;
            let goes_on =
                self.shared_by > 1 && waiting.last().is_some_and(|last| last.index / self.shared_by == group);
            if rays.len() >= BATCH && !goes_on {
                count += self.finish(&mut rays, &mut waiting, &mut add);
            }
            for which in 0..self.rays {
                let number = first + index;
                let Some(arriving) = self.arriving(seen.sample, number, which) else { continue };
                let normal = geometric.get(seen.sample.geometric_normal);
                if normal.dot(arriving.direction) <= 0.0 {
                    continue;
                }
                let shading_normal = shading.get(seen.sample.shading_normal);
                let cos = shading_normal.dot(arriving.direction);
                if cos <= 0.0 {
                    continue;
                }
                let ray = || shade::shadow_ray(seen.sample.position, normal, &arriving);
                if goes_on || (which > 0 && self.shared_by > 1) {
                    let pixel = number / self.shared_by;
                    let favoured = (pixel % width + 2 * (pixel / width)) % self.shared_by;
                    if index % self.shared_by == favoured
                        && let Some(chosen) = rays.last_mut()
                    {
                        *chosen = ray();
                    }
                } else {
                    rays.push(ray());
                }
                let ray = rays.len() - 1;
                waiting.push(Waiting { index, seen, shading_normal, arriving, cos, ray });
            }
        }
        count + self.finish(&mut rays, &mut waiting, &mut add)
    }

    /// Traces the `rays`, tells `add` of what waits for those that are free, and empties both. Returns how many rays there were.
    fn finish(
        &self,
        rays: &mut Vec<Ray>,
        waiting: &mut Vec<Waiting<'_>>,
        add: &mut impl FnMut(usize, Vec3),
    ) -> u64 {
        let count = rays.len() as u64;
        let mut blocked = vec![false; rays.len()];
        self.accel.occluded_batch(rays, &mut blocked);
        rays.clear();
        let mut lanes = Lanes::default();
        let mut owners = [0; LANES];
        let mut filled = 0;
        let mut empty = |lanes: &Lanes, owners: &[usize]| {
            let radiance = lanes.shade();
            for (lane, &index) in owners.iter().enumerate() {
                add(index, Vec3::from(radiance.map(|channel| channel[lane])));
            }
        };
        for waiting in waiting.drain(..).filter(|waiting| !blocked[waiting.ray]) {
            owners[filled] = waiting.index;
            lanes.set(filled, &self.lit(&waiting));
            filled += 1;
            if filled == LANES {
                empty(&lanes, &owners);
                filled = 0;
            }
        }
        empty(&lanes, &owners[..filled]);
        count
    }

    fn arriving(&self, sample: &ViewSample, number: usize, which: usize) -> Option<LightSample> {
        let random = if self.light.needs_samples() {
            sobol_2d(which as u32, 0, hash(number as u32, 0x51_a9))
        } else {
            Vec2::ZERO
        };
        self.light.sample(sample.position, random)
    }

    fn lit(&self, waiting: &Waiting<'_>) -> LitSample {
        let Waiting { seen: Seen { sample, view, throughput }, shading_normal, ref arriving, cos, .. } =
            *waiting;
        let k_d = match self.view.scales {
            Some(scales) => sample.diffuse.get() * scales[sample.material as usize],
            None => sample.diffuse.get(),
        };
        LitSample {
            normal: shading_normal,
            view,
            light: arriving.direction,
            k_d,
            f0: sample.specular.get(),
            f90: sample.grazing(),
            roughness: sample.roughness(),
            arriving: throughput * arriving.irradiance * cos,
        }
    }
}

/// Unpacks normals, which are mostly those of the sample before.
#[derive(Default)]
struct Normals(Option<(PackedNormal, Vec3)>);

impl Normals {
    fn get(&mut self, packed: PackedNormal) -> Vec3 {
        match self.0 {
            Some((before, normal)) if before == packed => normal,
            _ => self.0.insert((packed, packed.get())).1,
        }
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
