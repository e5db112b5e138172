//! The path tracer: the truth that everything is measured against. It shares scene, trace and shade with the
//! relighter, and nothing else.
//!
//! Paths start at the camera. Each vertex is lit by every light and by the emissive triangles (next-event
//! estimation); emissive triangles and domes are found by scattered rays too, and the two are weighed against each other by
//! multiple importance sampling (Veach 1997, ch. 9). Other lights are invisible to all rays but shadow rays, and no light shows itself to the
//! camera; in mirrors, and through glass that bends its view, it sees both.
//! Nothing is clamped, so the mean is unbiased and the noise honest; but in mirrors and glass, where views end that show next to nothing, and
//! lights and suns have edges as wide as a view.
//!
//! The camera's view goes on from mirrors and through glass ([`crate::shade::Surface::specular_events`]), and what it meets there is seen as
//! what it meets at once: these are no bounces. To all other rays clear surfaces are not there: they cast no shadows and no caustics.
//!
//! *Bounce 0*, the direct layer, is what surfaces emit towards the camera and light that goes from a light, a dome or an
//! emissive triangle to the camera's first surface. Bounce `k` has met `k` more surfaces on its way.

mod emitters;
mod film;
mod progressive;
mod response;
mod tile;

use glam::Vec3;
use rayon::prelude::{IntoParallelRefIterator, ParallelIterator};

use crate::error::{Error, Result};
use crate::image::{Image, Layers};
use crate::progress::Progress;
use crate::scene::{Geometry, LightRig, Scene};
use crate::shade::{PreparedLight, Surface, surface_at};
use crate::trace::{Accel, Hit};

pub use progressive::Progressive;

use emitters::Emitters;
use film::Film;
use tile::{Tile, TileArea};

/// Pixels along a tile's side.
const TILE: usize = 8;
/// Largest image side.
const MAX_SIDE: usize = 1 << 15;
/// Most images that [`Settings::per_bounce`] gives; further bounces are in the indirect layer only.
pub const MAX_BOUNCE_IMAGES: u32 = 16;

/// Which light paths count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Paths {
    /// All: every vertex has its full BSDF. What a renderer would show.
    #[default]
    All,
    /// Those that the transfer models. The first surface has its full BSDF. Every later surface is a diffuse reflector with the
    /// hemispherical reflectance as albedo and its geometric normal in all cosines.
    Transfer,
    /// As [`Self::Transfer`], but the first surface answers to light from other surfaces and from domes by its diffuse lobe alone, with the
    /// shading normal's cosine: what a transfer without reflections models, but for the highlights of suns in maps, which it has.
    DiffuseTransfer,
}

/// What to render, and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Index into [`Scene::cameras`].
    pub camera: usize,
    /// Paths a pixel; rounded up to a multiple of `2 * aa^2`. Noise falls with its square root or faster.
    pub spp: u32,
    /// Indirect bounces; `None` is unlimited, ended by Russian roulette.
    pub bounces: Option<u32>,
    /// Rays per pixel and axis: 1 is the pixel's centre, 2 the regular `2x2` grid, box-filtered. The points are the
    /// relighter's, so that edges agree; more paths never blur them.
    pub aa: u32,
    /// Which light paths count.
    pub paths: Paths,
    /// Another seed gives independent noise.
    pub seed: u32,
    /// Whether to give each bounce's image.
    pub per_bounce: bool,
    /// Whether to give each enabled light's layers. Emissive triangles belong to none of them.
    pub per_light: bool,
}

impl Default for Settings {
    /// 640x480, 64 paths a pixel, all bounces, 2x2.
    fn default() -> Self {
        Self {
            width: 640,
            height: 480,
            camera: 0,
            spp: 64,
            bounces: None,
            aa: 2,
            paths: Paths::All,
            seed: 0,
            per_bounce: false,
            per_light: false,
        }
    }
}

/// Relative L2 noise: the norm of the mean's standard error over the norm of the mean. 0 for a black image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Of the full image.
    pub full: f64,
    /// Of the direct layer.
    pub direct: f64,
    /// Of the indirect layer.
    pub indirect: f64,
}

/// A path-traced frame with the means to judge it.
#[derive(Clone, Debug, Default)]
pub struct Reference {
    /// The frame. `noise` is each pixel's standard error as the two halves show it; `edges` is empty.
    pub layers: Layers,
    /// Entry `k` is light of exactly `k + 1` indirect bounces; empty unless asked for.
    pub indirect_by_bounce: Vec<Image>,
    /// Direct and indirect layer of two independent halves, whose mean is the frame: for an unbiased squared error
    /// multiply the differences to one half by those to the other.
    pub halves: [Layers; 2],
    /// Estimated from the halves.
    pub noise: Noise,
}

/// All that a tile reads.
struct World<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    /// What the camera's rays meet, also after mirrors and glass.
    all: &'a Accel,
    /// What all other rays meet: the same without clear surfaces.
    accel: &'a Accel,
    lights: Vec<PreparedLight>,
    /// By light: the suns of a dome's map, as mirrors and glass show them.
    suns: Vec<Vec<PreparedLight>>,
    /// By material: what its emission is multiplied by.
    emission_scales: Vec<Vec3>,
    /// By material: the base colour that takes the place of the scene's.
    base_colors: Vec<Option<Vec3>>,
    emitters: Emitters,
    settings: &'a Settings,
}

impl World<'_> {
    /// The surface that a ray along `ray_direction` hit, with the rig's base colour.
    fn surface_at(&self, hit: &Hit, ray_direction: Vec3) -> Surface {
        let surface = surface_at(self.scene, self.geometry, hit, ray_direction);
        match self.base_colors[surface.material as usize] {
            Some(base_color) => surface.with_base_color(base_color),
            None => surface,
        }
    }

    /// Whether scattered rays may find light: paths go on for it.
    fn shines_by_itself(&self) -> bool {
        !self.emitters.is_empty() || self.lights.iter().any(|light| light.dome().is_some())
    }

    /// Radiance that a surface emits under the rig, W/(sr m^2).
    fn emission(&self, surface: &Surface) -> Vec3 {
        surface.emission * self.emission_scales[surface.material as usize]
    }
}

/// Renders `scene` under `rig`, not under the lights stored in the scene. `geometry` and `accel` are the scene's.
/// Runs in rayon's current pool; the bytes do not depend on its size.
///
/// # Errors
/// [`Error::Setting`] where a setting is out of range or the rig's emitters or edited materials are not the scene's or unusable,
/// [`Error::Cancelled`] where `progress` asks to stop.
pub fn render(
    scene: &Scene,
    geometry: &Geometry,
    accel: &Accel,
    rig: &LightRig,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Reference> {
    settings.check(scene)?;
    let enabled: Vec<_> = rig.lights.iter().filter(|light| light.enabled).collect();
    let emitters = rig.emitters_of(scene.named_materials())?;
    let scale = |emitter: &Option<usize>| emitter.map_or(Vec3::ONE, |emitter| rig.emitters[emitter].scale);
    let emission_scales: Vec<Vec3> = emitters.iter().map(scale).collect();
    let edits = rig.edits_of(scene.named_materials().map(|(name, _)| name))?;
    let base_color = |edit: Option<usize>| edit.map(|edit| rig.materials[edit].base_color);
    let opaque = geometry.without_clear().map(|geometry| (Accel::new(scene, &geometry), geometry));
    let (opaque_accel, opaque) =
        opaque.as_ref().map_or((accel, geometry), |(accel, geometry)| (accel, geometry));
    let lights: Vec<_> = enabled.iter().map(|light| PreparedLight::new(light)).collect();
    let suns = |light: &PreparedLight| {
        light.dome().map_or(Vec::new(), |dome| dome.suns().map(|sun| PreparedLight::new(&sun)).collect())
    };
    let world = World {
        scene,
        geometry,
        all: accel,
        accel: opaque_accel,
        suns: lights.iter().map(suns).collect(),
        lights,
        emitters: Emitters::new(scene, opaque, &emission_scales),
        emission_scales,
        base_colors: edits.into_iter().map(base_color).collect(),
        settings,
    };
    let film = Film::new(settings, enabled.len());
    let areas = TileArea::cover(settings.width, settings.height, TILE);
    progress.stage("path tracing", areas.len() as u64);
    let tiles = areas
        .par_iter()
        .map(|area| {
            let tile = Tile::new(&world, film, *area).render(progress)?;
            progress.advance(1);
            Ok(tile)
        })
        .collect::<Result<Vec<_>>>()?;
    let names = enabled.iter().map(|light| light.name.clone()).collect();
    Ok(film.assemble(settings, &areas, &tiles, names))
}

impl Settings {
    fn check(&self, scene: &Scene) -> Result<()> {
        let refuse = |message: String| Err(Error::Setting(message));
        if !(1..=MAX_SIDE).contains(&self.width) || !(1..=MAX_SIDE).contains(&self.height) {
            return refuse(format!(
                "the image size {}x{} is not within 1 to {MAX_SIDE} pixels a side; choose another",
                self.width, self.height
            ));
        }
        if self.aa != 1 && self.aa != 2 {
            return refuse(format!("aa is {}; it must be 1 or 2", self.aa));
        }
        if self.spp == 0 {
            return refuse("spp is 0; at least 1 path a pixel is needed".to_owned());
        }
        if self.camera >= scene.cameras.len() {
            return refuse(format!(
                "there is no camera {}; the scene has {}, counted from 0",
                self.camera,
                scene.cameras.len()
            ));
        }
        Ok(())
    }

    /// Paths per sub-pixel and half.
    fn samples(&self) -> u32 {
        self.spp.div_ceil(2 * self.aa * self.aa)
    }

    /// Whether light of `bounce` counts.
    fn counts(&self, bounce: u32) -> bool {
        self.bounces.is_none_or(|bounces| bounce <= bounces)
    }
}
