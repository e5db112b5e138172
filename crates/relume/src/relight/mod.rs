//! The engine: a rig in, layers out.
//!
//! Every light is relit alone, under white light, and kept: what a light does is linear in its colour, channel by
//! channel. A frame is the sum of what its lights did, so that a moved light costs one light's work and a changed
//! colour costs the sum.

mod direct;
mod upsample;

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;

use crate::image::{Image, Layers, LightLayers};
use crate::sample::{edge_pixels, illuminate};
use crate::scene::{Light, LightRig};
use crate::trace::Accel;
use crate::transfer::{BounceSeries, Transfer};
use crate::{Error, Progress, Result};

/// Which light to show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Only {
    /// Direct and indirect.
    #[default]
    Both,
    /// Direct alone; the indirect layer stays black and costs nothing.
    Direct,
    /// Indirect alone; the direct layer stays black and costs nothing.
    Indirect,
}

/// How to relight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RelightSettings {
    /// Indirect bounces; `None` follows light until it is spent.
    pub bounces: Option<u32>,
    /// Direct samples along each side of a pixel: 1 (the pixel's centre) or 2 (a 2x2 grid).
    pub aa: u32,
    /// Which light to show.
    pub only: Only,
    /// Whether to give each light its own layers as well.
    pub per_light: bool,
}

impl Default for RelightSettings {
    fn default() -> Self {
        Self { bounces: None, aa: 2, only: Only::Both, per_light: false }
    }
}

/// What a frame took, milliseconds unless said otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameStats {
    /// The whole frame.
    pub frame_ms: f64,
    /// Direct light on the view samples.
    pub direct_ms: f64,
    /// Direct light on the cloud.
    pub cloud_ms: f64,
    /// Bounces within the cloud.
    pub bounces_ms: f64,
    /// The final gather.
    pub gather_ms: f64,
    /// Indirect light spread to the pixels' samples.
    pub upsample_ms: f64,
    /// The sum over lights.
    pub sum_ms: f64,
    /// Lights that had to be relit; the others were kept from before.
    pub relit: usize,
    /// Shadow rays, from view samples and from the cloud.
    pub shadow_rays: u64,
    /// How often the bounce operator was applied.
    pub bounce_steps: u32,
}

/// What one light does under white light.
struct Lit {
    direct: Image,
    indirect: Image,
}

struct Kept {
    light: Light,
    settings: RelightSettings,
    lit: Lit,
}

/// Name under which the light of emissive surfaces appears among the layers a light.
pub const EMISSION: &str = "emission";

/// Relights one shot, again and again.
pub struct Relighter {
    transfer: Arc<Transfer>,
    accel: Accel,
    bounces: BounceSeries,
    edges: Vec<bool>,
    /// Where the transfer has reflections.
    tints: Option<upsample::Tints>,
    /// What the lights of the last frame did.
    kept: Vec<Kept>,
    /// The same of lights that were off or black in it.
    dark: Vec<Kept>,
    emission: Option<(RelightSettings, Lit)>,
    stats: FrameStats,
}

impl Relighter {
    /// Makes a shot ready: builds the acceleration structure for its shadows and finds how fast its light fades.
    pub fn new(transfer: impl Into<Arc<Transfer>>) -> Self {
        crate::shade::warm_up();
        let transfer = transfer.into();
        let albedo: Vec<Vec3> = transfer.cloud.samples.iter().map(|sample| sample.albedo).collect();
        Self {
            accel: transfer.occluders.accel(),
            bounces: BounceSeries::new(&transfer.bounce, &albedo),
            edges: edge_pixels(&transfer.view),
            tints: transfer.glossy.is_some().then(|| upsample::Tints::new(&transfer.view)),
            kept: Vec::new(),
            dark: Vec::new(),
            emission: None,
            stats: FrameStats::default(),
            transfer,
        }
    }

    /// The shot.
    pub fn transfer(&self) -> &Transfer {
        &self.transfer
    }

    /// What the last frame took.
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// Pixels on a geometric edge.
    pub fn edges(&self) -> &[bool] {
        &self.edges
    }

    /// Forgets what earlier frames computed.
    pub fn forget(&mut self) {
        self.kept.clear();
        self.dark.clear();
        self.emission = None;
    }

    /// The shot under `rig`. Lights that have not changed since an earlier frame, or only in colour, cost nothing but
    /// their share of the sum.
    ///
    /// # Errors
    /// [`Error::Setting`] unless `aa` is 1 or 2.
    pub fn relight(&mut self, rig: &LightRig, settings: &RelightSettings) -> Result<Layers> {
        self.relight_watched(rig, settings, &())
    }

    /// The same, with `progress` told of every light and asked between two whether to stop.
    ///
    /// # Errors
    /// As [`Self::relight`], and [`Error::Cancelled`].
    pub fn relight_watched(
        &mut self,
        rig: &LightRig,
        settings: &RelightSettings,
        progress: &dyn Progress,
    ) -> Result<Layers> {
        if !(1..=2).contains(&settings.aa) {
            return Err(Error::Setting(format!("{} samples a pixel side: must be 1 or 2", settings.aa)));
        }
        let began = Instant::now();
        self.stats = FrameStats::default();
        let shining: Vec<&Light> =
            rig.lights.iter().filter(|light| light.enabled && light.color() != Vec3::ZERO).collect();
        progress.stage("relighting", shining.len() as u64);
        let mut before = std::mem::take(&mut self.kept);
        before.append(&mut self.dark);
        for light in &shining {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let found = before
                .iter()
                .position(|kept| kept.settings.same_light(settings) && kept.light.same_but_for_color(light));
            let lit = match found {
                Some(place) => before.swap_remove(place).lit,
                None => self.light(light, settings),
            };
            self.kept.push(Kept { light: (*light).clone(), settings: *settings, lit });
            progress.advance(1);
        }
        // a light that is off or black keeps what it did, and comes back for nothing
        self.dark = before
            .into_iter()
            .filter(|kept| kept.settings.same_light(settings))
            .filter(|kept| rig.lights.iter().any(|light| kept.light.same_but_for_color(light)))
            .collect();
        self.light_emission(settings);
        let sum_began = Instant::now();
        let mut layers = self.sum(settings);
        layers.edges.clone_from(&self.edges);
        self.stats.sum_ms = milliseconds(sum_began);
        self.stats.frame_ms = milliseconds(began);
        Ok(layers)
    }

    fn black(&self) -> Image {
        Image::new(self.transfer.view.width, self.transfer.view.height)
    }

    /// One light alone, white.
    fn light(&mut self, light: &Light, settings: &RelightSettings) -> Lit {
        let white = light.with_color(Vec3::ONE);
        self.stats.relit += 1;
        let mut lit = Lit { direct: self.black(), indirect: self.black() };
        if settings.only != Only::Indirect {
            let began = Instant::now();
            let (direct, rays) = direct::direct(&self.transfer.view, &self.accel, &white, settings.aa);
            lit.direct.pixels = direct;
            self.stats.shadow_rays += rays;
            self.stats.direct_ms += milliseconds(began);
        }
        if settings.only != Only::Direct && settings.bounces != Some(0) {
            let began = Instant::now();
            let cloud = illuminate(&self.transfer.cloud, &self.accel, &white);
            self.stats.shadow_rays += cloud.shadow_rays;
            self.stats.cloud_ms += milliseconds(began);
            let times = settings.bounces.map(|bounces| bounces - 1);
            lit.indirect.pixels = self.gather(&cloud.radiance, times, settings.aa);
        }
        lit
    }

    /// Light on the cloud, bounced and gathered to the pixels.
    fn gather(&mut self, radiance: &[Vec3], times: Option<u32>, aa: u32) -> Vec<Vec3> {
        let began = Instant::now();
        let (bounced, steps) = self.bounces.sum(&self.transfer.bounce, radiance, times);
        self.stats.bounce_steps += steps;
        self.stats.bounces_ms += milliseconds(began);
        let began = Instant::now();
        let (gathered, glossy) = self.transfer.gather_from(&bounced);
        self.stats.gather_ms += milliseconds(began);
        let began = Instant::now();
        let glossy = glossy.as_deref().zip(self.tints.as_ref());
        let pixels = upsample::upsample(&self.transfer, &gathered, glossy, aa);
        self.stats.upsample_ms += milliseconds(began);
        pixels
    }

    /// Emissive surfaces: what the camera sees of them, their light on the view samples (direct), and its bounces.
    fn light_emission(&mut self, settings: &RelightSettings) {
        let view = &self.transfer.view;
        let emits = self.transfer.cloud.samples.iter().any(|sample| sample.emission != Vec3::ZERO);
        let seen = !view.center_emission.is_empty() || !view.quad_emission.is_empty();
        if !(emits || seen) || self.emission.as_ref().is_some_and(|(kept, _)| kept.same_light(settings)) {
            return;
        }
        let mut lit = Lit { direct: self.black(), indirect: self.black() };
        let emitted: Vec<Vec3> = self.transfer.cloud.samples.iter().map(|sample| sample.emission).collect();
        if settings.only != Only::Indirect {
            lit.direct.pixels = self.gather(&emitted, Some(0), settings.aa);
            direct::add_emission(&self.transfer.view, settings.aa, &mut lit.direct.pixels);
        }
        if settings.only != Only::Direct && settings.bounces != Some(0) {
            let bounced = self.bounces.reflect(&self.transfer.bounce, &emitted);
            lit.indirect.pixels =
                self.gather(&bounced, settings.bounces.map(|bounces| bounces - 1), settings.aa);
        }
        self.emission = Some((*settings, lit));
    }

    fn sum(&self, settings: &RelightSettings) -> Layers {
        let mut parts: Vec<(&str, Vec3, &Lit)> =
            self.kept.iter().map(|kept| (kept.light.name.as_str(), kept.light.color(), &kept.lit)).collect();
        if let Some((_, lit)) = &self.emission {
            parts.push((EMISSION, Vec3::ONE, lit));
        }
        let mut layers = Layers { direct: self.black(), indirect: self.black(), ..Layers::default() };
        for (_, color, lit) in &parts {
            add_scaled(&mut layers.direct, &lit.direct, *color);
            add_scaled(&mut layers.indirect, &lit.indirect, *color);
        }
        if settings.per_light {
            layers.per_light = parts
                .iter()
                .map(|(name, color, lit)| LightLayers {
                    name: (*name).to_owned(),
                    direct: scaled(&lit.direct, *color),
                    indirect: scaled(&lit.indirect, *color),
                })
                .collect();
        }
        layers
    }
}

impl RelightSettings {
    /// Whether a light relit with the one looks the same with the other.
    fn same_light(&self, other: &Self) -> bool {
        (self.bounces, self.aa, self.only) == (other.bounces, other.aa, other.only)
    }
}

fn add_scaled(sum: &mut Image, image: &Image, color: Vec3) {
    sum.pixels
        .par_iter_mut()
        .zip(&image.pixels)
        .with_min_len(16_384)
        .for_each(|(sum, pixel)| *sum += *pixel * color);
}

fn scaled(image: &Image, color: Vec3) -> Image {
    Image { pixels: image.pixels.iter().map(|pixel| *pixel * color).collect(), ..image.clone() }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
