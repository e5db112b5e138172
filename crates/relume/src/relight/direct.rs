//! Direct light on the view samples, with ray-traced shadows.

use glam::Vec3;
use rayon::prelude::*;

use super::RelightSettings;
use super::lanes::{LANES, Lanes, LitSample, Places};
use crate::sample::{Chains, ViewGrid, ViewSample, ViewSamples};
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
    let mut pixels = bytemuck::zeroed_vec(view.samples.pixels());
    let width = view.samples.width;
    let straight: u64 = pixels
        .par_chunks_mut(TILE * width)
        .zip(samples.par_chunks(TILE * width * a_pixel))
        .zip(view.tiles.par_chunks(width.div_ceil(TILE)))
        .enumerate()
        .map(|(row, ((pixels, samples), tiles))| {
            let (first, height) = (row * TILE * width * a_pixel, pixels.len() / width);
            let mut task =
                Task::new(&shading, first, |index, radiance| pixels[index / a_pixel] += radiance * share);
            for (column, tile) in (0..width).step_by(TILE).zip(tiles) {
                if !prepared.may_reach(tile) {
                    continue;
                }
                for pixel in of_tile(column, (width, height)) {
                    for (index, sample) in (pixel * a_pixel..).zip(&samples[pixel * a_pixel..][..a_pixel]) {
                        let view = (camera - sample.position) / sample.depth;
                        task.take(index, &Seen { sample, view, throughput: Vec3::ONE });
                    }
                }
            }
            task.finish()
        })
        .sum();
    let alone = Shading { shared_by: 1, ..shading };
    let behind = chains.branches.par_chunks(CHUNK).enumerate().map(|(chunk, branches)| {
        let mut lit = Vec::new();
        let first = samples.len() + chunk * CHUNK;
        let mut task = Task::new(&alone, first, |index: usize, radiance| {
            lit.push((branches[index].owner as usize / a_pixel, radiance * share));
        });
        for (index, branch) in branches.iter().enumerate() {
            let throughput = branch.throughput.get();
            task.take(index, &Seen { sample: &branch.sample, view: branch.view(), throughput });
        }
        let rays = task.finish();
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

/// Some samples on their way: rays wait until there are enough to be traced.
struct Task<'a, F> {
    shading: &'a Shading<'a>,
    /// The number of the first sample for the random numbers.
    first: usize,
    rays: Vec<Ray>,
    waiting: Vec<Waiting<'a>>,
    /// Samples that were not yet asked for what arrives there, up to [`LANES`], and where they are.
    asked: Vec<(usize, Seen<'a>)>,
    places: Places,
    /// Rays that were traced.
    traced: u64,
    /// Is told the numbers of the samples that light reaches, and what of it reaches the camera, ray by ray.
    add: F,
}

impl<'a, F: FnMut(usize, Vec3)> Task<'a, F> {
    fn new(shading: &'a Shading<'a>, first: usize, add: F) -> Self {
        Self {
            shading,
            first,
            rays: Vec::new(),
            waiting: Vec::new(),
            asked: Vec::with_capacity(LANES),
            places: Places::ZERO,
            traced: 0,
            add,
        }
    }

    /// Sends rays from a sample to the light, where that is above its horizon, soon. Samples that share a ray come one after the other.
    #[inline]
    fn take(&mut self, index: usize, seen: &Seen<'a>) {
        if !seen.sample.reflects() {
            return;
        }
        if self.shading.light.needs_samples() {
            self.take_soft(index, seen);
            return;
        }
        let (lane, sample) = (self.asked.len(), seen.sample);
        for (axis, value) in sample.position.to_array().into_iter().enumerate() {
            self.places.position[axis][lane] = value;
        }
        let (geometric, shading) = (sample.geometric_normal.sides(), sample.shading_normal.sides());
        for side in 0..2 {
            (self.places.geometric[side][lane], self.places.shading[side][lane]) =
                (geometric[side], shading[side]);
        }
        self.asked.push((index, *seen));
        if self.asked.len() == LANES {
            self.ask();
        }
    }

    /// Sends rays to a light without extent from those samples that were taken.
    fn ask(&mut self) {
        if self.asked.is_empty() {
            return;
        }
        let arrivals = self.places.arrivals(self.shading.light);
        let at = |lanes: &[[f32; LANES]; 3], lane: usize| Vec3::from(lanes.each_ref().map(|axis| axis[lane]));
        let mut asked = std::mem::take(&mut self.asked);
        for (lane, (index, seen)) in asked.drain(..).enumerate().filter(|&(lane, _)| arrivals.cos[lane] > 0.0)
        {
            let arriving = LightSample {
                direction: at(&arrivals.light.direction, lane),
                distance: arrivals.light.distance[lane],
                irradiance: arrivals.light.irradiance * arrivals.light.factor[lane],
            };
            let normals = [at(&arrivals.geometric, lane), at(&arrivals.shading, lane)];
            self.wait(index, seen, normals, arriving, arrivals.cos[lane]);
        }
        self.asked = asked;
    }

    /// Sends rays to points of a light with extent.
    fn take_soft(&mut self, index: usize, seen: &Seen<'a>) {
        let sample = seen.sample;
        let normals = [sample.geometric_normal.get(), sample.shading_normal.get()];
        for which in 0..self.shading.rays {
            let random = sobol_2d(which as u32, 0, hash((self.first + index) as u32, 0x51_a9));
            let Some(arriving) = self.shading.light.sample(sample.position, random) else { continue };
            let [lies, shades] = normals.map(|normal| normal.dot(arriving.direction));
            if lies > 0.0 && shades > 0.0 {
                self.wait(index, *seen, normals, arriving, shades);
            }
        }
    }

    /// Puts a sample, that light arrives at, to those that wait for a ray. `normals` are the geometric one and that it is shaded by; `cos` is between
    /// this and the light.
    fn wait(
        &mut self,
        index: usize,
        seen: Seen<'a>,
        [normal, shading_normal]: [Vec3; 2],
        arriving: LightSample,
        cos: f32,
    ) {
        let shared_by = self.shading.shared_by;
        let shares = shared_by > 1
            && self.waiting.last().is_some_and(|last| last.index / shared_by == index / shared_by);
        if self.rays.len() >= BATCH && !shares {
            self.trace();
        }
        let ray = || shade::shadow_ray(seen.sample.position, normal, &arriving);
        if !shares {
            self.rays.push(ray());
        } else if self.shading.is_favoured(self.first + index)
            && let Some(chosen) = self.rays.last_mut()
        {
            *chosen = ray();
        }
        let ray = self.rays.len() - 1;
        self.waiting.push(Waiting { index, seen, shading_normal, arriving, cos, ray });
    }

    /// Traces what waits, and returns how many rays there were in all.
    fn finish(mut self) -> u64 {
        self.ask();
        self.trace();
        self.traced
    }

    /// Traces the rays, and shades what waits for those that are free.
    fn trace(&mut self) {
        if self.rays.is_empty() {
            return;
        }
        let mut blocked = vec![false; self.rays.len()];
        self.shading.accel.occluded_batch(&self.rays, &mut blocked);
        self.traced += self.rays.len() as u64;
        self.rays.clear();
        let (mut lanes, mut owners) = (Lanes::default(), [0; LANES]);
        let mut filled = 0;
        let mut shade = |lanes: &Lanes, owners: &[usize]| {
            let radiance = lanes.shade();
            for (lane, &index) in owners.iter().enumerate() {
                (self.add)(index, Vec3::from(radiance.map(|channel| channel[lane])));
            }
        };
        for waiting in self.waiting.drain(..).filter(|waiting| !blocked[waiting.ray]) {
            owners[filled] = waiting.index;
            lanes.set(filled, &self.shading.lit(&waiting));
            filled += 1;
            if filled == LANES {
                shade(&lanes, &owners);
                filled = 0;
            }
        }
        if filled > 0 {
            shade(&lanes, &owners[..filled]);
        }
    }
}

impl Shading<'_> {
    /// Whether a sample, by its number, is the one that its pixel's ray starts from.
    fn is_favoured(&self, number: usize) -> bool {
        let (pixel, width) = (number / self.shared_by, self.view.samples.width);
        number % self.shared_by == (pixel % width + 2 * (pixel / width)) % self.shared_by
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
