//! One tile's paths, advanced together: all rays of a step are traced as one batch, which is faster than one path
//! after the other. A camera ray meets the same point whatever the sample, so it is traced and shaded once.

use std::ops::Range;

use glam::{Vec2, Vec3};

use super::World;
use super::emitters::{power_heuristic, solid_angle_density};
use super::film::{Film, Share, TileSums};
use super::response::Response;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::shade::{
    Bsdf, Dome, LEAST_THROUGHPUT, LightSample, MAX_SPECULAR_EVENTS, Medium, Surface, ViewCone, shadow_ray,
};
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Hit, Ray, offset_origin};

/// Paths in flight: enough to fill a batch, few enough to stay in the cache.
const WAVE: usize = 4096;
/// Shadow rays that wait for each other.
const SHADOWS: usize = 16384;
/// Bounces after which paths are ended at random.
const ROULETTE_AFTER: u32 = 3;
/// Most likely survival of the roulette; the rest ends paths that lose no energy.
const MAX_SURVIVAL: f32 = 0.95;

/// Pairs of the sampling sequence that a vertex uses.
const PAIRS: u32 = 5;
const DIRECTION: u32 = 0;
const LOBE_AND_ROULETTE: u32 = 1;
const EMITTER_AND_LIGHT: u32 = 2;
const EMITTER_PLACE: u32 = 3;
const LIGHT_PLACE: u32 = 4;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileArea {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// A surface that a sub-pixel sees: at first sight, or in mirrors and through glass.
struct Primary {
    /// Within the tile.
    pixel: u32,
    /// Seed of its sampling sequence.
    seed: u32,
    /// The part of its light that reaches the camera.
    throughput: Vec3,
    surface: Surface,
    direct: Bsdf,
    indirect: Response,
}

/// A ray of the camera's, before or after mirrors and glass.
#[derive(Clone, Copy)]
struct ViewRay {
    ray: Ray,
    pixel: u32,
    /// Within the tile.
    sub_pixel: u32,
    seed: u32,
    throughput: Vec3,
    cone: ViewCone,
    events: u32,
    medium: Medium,
}

/// Mirrors and panes that a view is followed through: so many that what lies behind more does not matter, and twice what the relighter follows.
const MAX_EVENTS: u32 = 2 * MAX_SPECULAR_EVENTS;
/// A view of which less than this reaches the camera is not followed; an eighth of the relighter's.
const LEAST_VIEW: f32 = LEAST_THROUGHPUT / 8.0;
/// Views that are followed from one sub-pixel, at most.
const MAX_VIEWS: u32 = 256;

/// Which numbers a path draws.
#[derive(Clone, Copy)]
struct Sequence {
    seed: u32,
    sample: u32,
}

#[derive(Clone, Copy)]
struct Path {
    pixel: u32,
    half: u32,
    sequence: Sequence,
    /// What a unit of radiance along the ray adds to the pixel.
    throughput: Vec3,
    /// With which the ray's direction was drawn, 1/sr.
    density: f32,
}

/// Light that a shadow ray asks for.
struct Shadow {
    pixel: u32,
    share: Share,
    light: Vec3,
    /// How many paths it stands for.
    paths: u32,
}

/// A light or emitter at a vertex, before visibility.
struct Candidate {
    light: Vec3,
    source: Option<u32>,
    ray: Ray,
}

pub(super) struct Tile<'a> {
    world: &'a World<'a>,
    area: TileArea,
    primaries: Vec<Primary>,
    sums: TileSums,
    shadows: Vec<Shadow>,
    shadow_rays: Vec<Ray>,
    blocked: Vec<bool>,
    candidates: Vec<Candidate>,
}

impl TileArea {
    /// Squares of `side` pixels that cover an image, cut at its right and lower border.
    pub(super) fn cover(width: usize, height: usize, side: usize) -> Vec<Self> {
        let mut areas = Vec::new();
        for y in (0..height).step_by(side) {
            for x in (0..width).step_by(side) {
                areas.push(Self { x, y, width: side.min(width - x), height: side.min(height - y) });
            }
        }
        areas
    }

    pub(super) fn pixels(&self) -> usize {
        self.width * self.height
    }
}

impl Sequence {
    /// Two numbers in `[0, 1)` for one purpose at one vertex.
    fn pair(self, vertex: u32, purpose: u32) -> Vec2 {
        sobol_2d(self.sample, vertex.wrapping_mul(PAIRS) + purpose, self.seed)
    }

    /// Where on a light's extent; each light has a sequence of its own.
    fn light_place(self, vertex: u32, light: u32) -> Vec2 {
        let seed = hash(self.seed, light.wrapping_add(1));
        sobol_2d(self.sample, vertex.wrapping_mul(PAIRS) + LIGHT_PLACE, seed)
    }
}

impl<'a> Tile<'a> {
    pub(super) fn new(world: &'a World<'a>, film: Film, area: TileArea) -> Self {
        Self {
            world,
            area,
            primaries: Vec::new(),
            sums: film.sums(area.pixels()),
            shadows: Vec::new(),
            shadow_rays: Vec::new(),
            blocked: Vec::new(),
            candidates: Vec::new(),
        }
    }

    /// The means of all of the film's layers.
    pub(super) fn render(mut self, progress: &dyn Progress) -> Result<Vec<Vec3>> {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        self.trace_primaries();
        self.light_by_points();
        let samples = self.world.settings.samples();
        let chunk = (WAVE / self.primaries.len().max(1)).max(1);
        for half in 0..2 {
            for first in (0..samples).step_by(chunk) {
                if progress.cancelled() {
                    return Err(Error::Cancelled);
                }
                self.trace_wave(half, first..samples.min(first + chunk as u32));
            }
        }
        Ok(self.sums.means())
    }

    /// Finds what the sub-pixels see: all views of a step are traced as one batch.
    fn trace_primaries(&mut self) {
        let mut views = self.camera_views();
        let (mut rays, mut hits) = (Vec::new(), Vec::new());
        let mut followed = vec![0_u32; views.len()];
        while !views.is_empty() {
            rays.clear();
            rays.extend(views.iter().map(|view| view.ray));
            hits.resize(rays.len(), Hit::MISS);
            self.world.all.closest_batch(&rays, &mut hits);
            let mut behind = Vec::new();
            for (view, hit) in views.iter().zip(&hits) {
                self.add_lights(view, hit.t);
                if hit.is_hit() {
                    self.add_primary(*view, hit, &mut behind);
                }
            }
            behind.retain(|view: &ViewRay| {
                followed[view.sub_pixel as usize] += 1;
                followed[view.sub_pixel as usize] <= MAX_VIEWS
            });
            views = behind;
        }
    }

    fn camera_views(&self) -> Vec<ViewRay> {
        let settings = self.world.settings;
        let camera = &self.world.scene.cameras[settings.camera];
        let aa = settings.aa as usize;
        let pixel = camera.pixel_angle(settings.width, settings.height);
        let spread = 0.5 * pixel / settings.aa as f32;
        let mut views = Vec::new();
        for row in 0..aa * self.area.height {
            for column in 0..aa * self.area.width {
                let (x, y) = (aa * self.area.x + column, aa * self.area.y + row);
                let place = |i: usize| (i as f32 + 0.5) / aa as f32;
                let direction = camera.direction(place(x), place(y), settings.width, settings.height);
                views.push(ViewRay {
                    ray: Ray::new(camera.position(), direction),
                    pixel: (row / aa * self.area.width + column / aa) as u32,
                    sub_pixel: views.len() as u32,
                    seed: hash(hash(settings.seed, x as u32), y as u32),
                    throughput: Vec3::ONE,
                    cone: ViewCone::new(spread, direction),
                    events: 0,
                    medium: Medium::default(),
                });
            }
        }
        views
    }

    /// Shades what a view meets, and lets it go on.
    fn add_primary(&mut self, mut view: ViewRay, hit: &Hit, behind: &mut Vec<ViewRay>) {
        let settings = self.world.settings;
        let surface = self.world.surface_at(hit, view.ray.direction);
        if !surface.lit {
            return;
        }
        view.throughput *= view.medium.transmittance(hit.t);
        let share = Share { half: None, bounce: 0, light: None };
        let emission = view.throughput * self.world.emission(&surface);
        self.sums.add(view.pixel, share, emission, settings.samples());
        let to_viewer = -view.ray.direction;
        let beside = surface.beside_events(to_viewer);
        if beside.diffuse_albedo != Vec3::ZERO || beside.specular_f90 > 0.0 {
            self.primaries.push(Primary {
                pixel: view.pixel,
                seed: view.seed,
                throughput: view.throughput,
                surface,
                direct: Bsdf::new(&beside, to_viewer),
                indirect: Response::new(settings.paths, true, &beside, to_viewer),
            });
        }
        if view.events == MAX_EVENTS {
            return;
        }
        for (event, number) in surface.specular_events(to_viewer).zip(1..) {
            let throughput = view.throughput * event.weight;
            if throughput.max_element() < LEAST_VIEW {
                continue;
            }
            let side = surface.geometric_normal * surface.geometric_normal.dot(event.direction).signum();
            behind.push(ViewRay {
                ray: Ray::new(offset_origin(surface.position, side), event.direction),
                seed: hash(view.seed, number),
                throughput,
                cone: view.cone.after(hit.t, &surface, to_viewer, &event),
                events: view.events + 1,
                medium: event.medium.unwrap_or(view.medium),
                ..view
            });
        }
    }

    /// What a view that was turned shows of lights and domes themselves, up to where it meets a surface.
    fn add_lights(&mut self, view: &ViewRay, t: f32) {
        if !view.cone.turned || view.medium != Medium::default() {
            return;
        }
        let (samples, ray) = (self.world.settings.samples(), Ray { t_max: t, ..view.ray });
        for (light, prepared) in self.world.lights.iter().enumerate() {
            let radiance = match prepared.dome() {
                Some(dome) if t == f32::INFINITY => {
                    let suns = &self.world.suns[light];
                    let shown: Vec3 = suns.iter().map(|sun| sun.seen_along(&ray, &view.cone)).sum();
                    dome.radiance_without_suns(ray.direction) + shown
                }
                Some(_) => continue,
                None => prepared.seen_along(&ray, &view.cone),
            };
            let share = Share { half: None, bounce: 0, light: Some(light as u32) };
            self.sums.add(view.pixel, share, view.throughput * radiance, samples);
        }
    }

    /// Direct light of lights without extent: one shadow ray a sub-pixel holds for all its paths.
    fn light_by_points(&mut self) {
        let world = self.world;
        let paths = world.settings.samples();
        for (light, prepared) in world.lights.iter().enumerate().filter(|(_, light)| !light.needs_samples()) {
            for i in 0..self.primaries.len() {
                let primary = &self.primaries[i];
                let Some(sample) = prepared.sample(primary.surface.position, Vec2::ZERO) else { continue };
                let value =
                    primary.throughput * primary.direct.evaluate(sample.direction) * sample.irradiance;
                let ray = shadow_ray(primary.surface.position, primary.surface.geometric_normal, &sample);
                let share = Share { half: None, bounce: 0, light: Some(light as u32) };
                let pixel = primary.pixel;
                self.ask(ray, Shadow { pixel, share, light: value, paths });
            }
            self.answer_shadows();
        }
    }

    /// Traces the paths `samples` of one half, of all sub-pixels, to their ends.
    fn trace_wave(&mut self, half: u32, samples: Range<u32>) {
        let mut paths = Vec::with_capacity(WAVE);
        let mut rays = Vec::with_capacity(WAVE);
        let needs_path = self.world.settings.counts(1) || self.world.shines_by_itself();
        for i in 0..self.primaries.len() {
            let seed = hash(self.primaries[i].seed, half);
            for sample in samples.clone() {
                let sequence = Sequence { seed, sample };
                self.light_primary(i, half, sequence);
                if !needs_path {
                    continue;
                }
                let Primary { pixel, throughput, ref surface, ref indirect, .. } = self.primaries[i];
                let path = Path { pixel, half, sequence, throughput, density: 0.0 };
                if let Some((path, ray)) = path.scattered(surface, indirect, 0) {
                    paths.push(path);
                    rays.push(ray);
                }
            }
        }
        self.answer_shadows();
        let mut hits = Vec::new();
        let mut vertex = 1;
        while !paths.is_empty() {
            hits.resize(rays.len(), Hit::MISS);
            self.world.accel.closest_batch(&rays, &mut hits);
            self.advance(vertex, &mut paths, &mut rays, &hits);
            self.answer_shadows();
            vertex += 1;
        }
    }

    /// Direct light of what has extent, for one path.
    fn light_primary(&mut self, index: usize, half: u32, sequence: Sequence) {
        let world = self.world;
        let Primary { pixel, throughput, surface, .. } = self.primaries[index];
        let share = Share { half: Some(half), bounce: 0, light: None };
        for (light, prepared) in world.lights.iter().enumerate().filter(|(_, light)| light.needs_samples()) {
            let place = sequence.light_place(0, light as u32);
            let primary = &self.primaries[index];
            let lit = match prepared.dome() {
                // as light of other surfaces, which scattered rays find
                Some(dome) => dome_sample(dome, &primary.indirect, place)
                    .map(|(sample, weight)| (sample, primary.indirect.evaluate(sample.direction) * weight)),
                None => prepared
                    .sample(surface.position, place)
                    .map(|sample| (sample, primary.direct.evaluate(sample.direction))),
            };
            if let Some((sample, value)) = lit {
                let share = Share { light: Some(light as u32), ..share };
                let ray = shadow_ray(surface.position, surface.geometric_normal, &sample);
                let light = throughput * value * sample.irradiance;
                self.ask(ray, Shadow { pixel, share, light, paths: 1 });
            }
        }
        let emitter = emitter_candidate(world, &surface, &self.primaries[index].indirect, sequence, 0);
        if let Some(Candidate { light, ray, .. }) = emitter {
            self.ask(ray, Shadow { pixel, share, light: throughput * light, paths: 1 });
        }
    }

    /// Moves all paths to the vertices that their rays hit: adds what shines there, asks for the light that arrives, and
    /// scatters the paths that go on. Keeps `paths` and `rays` side by side.
    fn advance(&mut self, vertex: u32, paths: &mut Vec<Path>, rays: &mut Vec<Ray>, hits: &[Hit]) {
        let world = self.world;
        let settings = world.settings;
        let goes_on = settings.counts(vertex + 1) || world.shines_by_itself();
        let mut kept = 0;
        for i in 0..paths.len() {
            let (path, ray, hit) = (paths[i], rays[i], &hits[i]);
            if !hit.is_hit() {
                self.add_domes(&path, ray.direction, vertex - 1);
                continue;
            }
            let surface = world.surface_at(hit, ray.direction);
            if !surface.lit {
                continue;
            }
            if surface.emission != Vec3::ZERO {
                self.add_emission(&path, &surface, hit, ray.direction, vertex - 1);
            }
            if !settings.counts(vertex) {
                continue;
            }
            let response = Response::new(settings.paths, false, &surface, -ray.direction);
            self.light_vertex(&path, &surface, &response, vertex);
            if let Some((path, ray)) = path.scattered(&surface, &response, vertex).filter(|_| goes_on) {
                (paths[kept], rays[kept]) = (path, ray);
                kept += 1;
            }
        }
        paths.truncate(kept);
        rays.truncate(kept);
    }

    /// Emission that a scattered ray found, weighed against its being drawn from the emitters.
    fn add_emission(&mut self, path: &Path, surface: &Surface, hit: &Hit, direction: Vec3, bounce: u32) {
        let density = self.world.emitters.density(hit.triangle);
        let other = solid_angle_density(density, hit.t * hit.t, surface, direction).unwrap_or(0.0);
        let light = path.throughput * self.world.emission(surface) * power_heuristic(path.density, other);
        self.sums.add(path.pixel, Share { half: Some(path.half), bounce, light: None }, light, 1);
    }

    /// What domes show to a scattered ray that met nothing, weighed against its being drawn from them.
    fn add_domes(&mut self, path: &Path, direction: Vec3, bounce: u32) {
        for (light, prepared) in self.world.lights.iter().enumerate() {
            let Some(dome) = prepared.dome() else { continue };
            let weight = power_heuristic(path.density, dome.density(direction));
            let share = Share { half: Some(path.half), bounce, light: Some(light as u32) };
            self.sums.add(path.pixel, share, path.throughput * dome.radiance(direction) * weight, 1);
        }
    }

    /// Light that arrives at a vertex. One light or emitter is drawn in proportion to what it would add without
    /// shadow, so that many lights cost one shadow ray.
    fn light_vertex(&mut self, path: &Path, surface: &Surface, response: &Response, vertex: u32) {
        let world = self.world;
        self.candidates.clear();
        for (light, prepared) in world.lights.iter().enumerate() {
            let place = if prepared.needs_samples() {
                path.sequence.light_place(vertex, light as u32)
            } else {
                Vec2::ZERO
            };
            if let Some(dome) = prepared.dome() {
                if let Some((sample, weight)) = dome_sample(dome, response, place) {
                    let sample = LightSample { irradiance: sample.irradiance * weight, ..sample };
                    self.add_candidate(light as u32, surface, response, &sample);
                }
            } else if let Some(sample) = prepared.sample(surface.position, place) {
                self.add_candidate(light as u32, surface, response, &sample);
            }
        }
        self.candidates.extend(emitter_candidate(world, surface, response, path.sequence, vertex));
        let importance = |candidate: &Candidate| (path.throughput * candidate.light).element_sum();
        let total: f32 = self.candidates.iter().map(importance).sum();
        if total <= 0.0 {
            return;
        }
        let mut left = path.sequence.pair(vertex, EMITTER_AND_LIGHT).y * total;
        // rounding may leave a little; the last candidate with light takes it
        let mut drawn = None;
        for candidate in &self.candidates {
            let weight = importance(candidate);
            if weight > 0.0 {
                drawn = Some((candidate, weight));
                left -= weight;
                if left < 0.0 {
                    break;
                }
            }
        }
        let Some((&Candidate { light, source, ray }, weight)) = drawn else { return };
        let share = Share { half: Some(path.half), bounce: vertex, light: source };
        let light = path.throughput * light * (total / weight);
        self.ask(ray, Shadow { pixel: path.pixel, share, light, paths: 1 });
    }

    fn add_candidate(&mut self, source: u32, surface: &Surface, response: &Response, sample: &LightSample) {
        let light = response.evaluate(sample.direction) * sample.irradiance;
        if light != Vec3::ZERO {
            let ray = shadow_ray(surface.position, surface.geometric_normal, sample);
            self.candidates.push(Candidate { light, source: Some(source), ray });
        }
    }

    /// Puts a shadow ray in the queue.
    fn ask(&mut self, ray: Ray, shadow: Shadow) {
        if shadow.light == Vec3::ZERO {
            return;
        }
        self.shadow_rays.push(ray);
        self.shadows.push(shadow);
        if self.shadows.len() >= SHADOWS {
            self.answer_shadows();
        }
    }

    /// Traces the queue and adds what arrives.
    fn answer_shadows(&mut self) {
        self.blocked.resize(self.shadow_rays.len(), false);
        self.world.accel.occluded_batch(&self.shadow_rays, &mut self.blocked);
        for (shadow, &blocked) in self.shadows.iter().zip(&self.blocked) {
            if !blocked {
                self.sums.add(shadow.pixel, shadow.share, shadow.light, shadow.paths);
            }
        }
        self.shadows.clear();
        self.shadow_rays.clear();
    }
}

impl Path {
    /// The path after it scattered at its `vertex`, and its new ray; `None` where it ends.
    fn scattered(mut self, surface: &Surface, response: &Response, vertex: u32) -> Option<(Self, Ray)> {
        let Vec2 { x: choice, y: roulette } = self.sequence.pair(vertex, LOBE_AND_ROULETTE);
        let drawn = response.sample(choice, self.sequence.pair(vertex, DIRECTION))?;
        self.throughput *= drawn.weight;
        self.density = drawn.density;
        if vertex >= ROULETTE_AFTER {
            let survival = self.throughput.max_element().min(MAX_SURVIVAL);
            if roulette >= survival {
                return None;
            }
            self.throughput /= survival;
        }
        let origin = offset_origin(surface.position, surface.geometric_normal);
        Some((self, Ray::new(origin, drawn.direction)))
    }
}

/// Light from a direction drawn from a dome, and its weight against a scattered ray's finding it.
fn dome_sample(dome: &Dome, response: &Response, place: Vec2) -> Option<(LightSample, f32)> {
    let (sample, density) = dome.sample(place)?;
    Some((sample, power_heuristic(density, response.density(sample.direction))))
}

/// Light from a point drawn from the emitters, weighed against a scattered ray's finding it.
fn emitter_candidate(
    world: &World<'_>,
    surface: &Surface,
    response: &Response,
    sequence: Sequence,
    vertex: u32,
) -> Option<Candidate> {
    if world.emitters.is_empty() {
        return None;
    }
    let choice = sequence.pair(vertex, EMITTER_AND_LIGHT).x;
    let place = sequence.pair(vertex, EMITTER_PLACE);
    let sample = world.emitters.sample(world, surface.position, choice, place)?;
    let value = response.evaluate(sample.direction);
    if value == Vec3::ZERO {
        return None;
    }
    let weight = power_heuristic(sample.density, response.density(sample.direction));
    let origin = offset_origin(surface.position, surface.geometric_normal);
    Some(Candidate {
        light: value * sample.radiance * (weight / sample.density),
        source: None,
        ray: Ray::between(origin, sample.position),
    })
}
