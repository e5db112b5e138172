//! The engine: a rig in, layers out.
//!
//! Every light is relit alone, under white light, and kept: what a light does is linear in its colour, channel by
//! channel. A frame is the sum of what its lights did, so that a moved light costs one light's work and a changed
//! colour costs the sum. Other base colours of materials ([`crate::MaterialEdit`]) relight all of them once.

mod direct;
mod edits;
mod emission;
mod lanes;
mod through;
mod upsample;

use std::borrow::Cow;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;

use crate::image::{Image, Layers, LightLayers};
use crate::sample::{Detail, cloud_groups, edge_pixels, illuminate_with};
use crate::scene::{Light, LightKind, LightRig};
use crate::shade::{Dome, PointGroup};
use crate::trace::Accel;
use crate::transfer::{CloudBounces, Operator, Transfer, Work};
use crate::{Error, Progress, Result};

pub use through::look_through;

use edits::Edits;
use emission::Glow;
use upsample::Reflection;

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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelightSettings {
    /// Indirect bounces; `None` follows light until it is spent.
    pub bounces: Option<u32>,
    /// Direct samples along each side of a pixel: 1 (the pixel's centre) or 2 (a 2x2 grid).
    pub aa: u32,
    /// Which light to show.
    pub only: Only,
    /// Whether to give each light its own layers as well.
    pub per_light: bool,
    /// `epsilon` of culling on the fly (Hasan 2006, section 3.5), 0 to 1: parts of the transfer that add next to nothing under a
    /// light are left out. More is faster and coarser. It bounds the relative error that is added in each application of an operator
    /// if its parts are independent; what comes of it is mostly far less. 0 leaves out nothing; `None` is what suits the encoding
    /// ([`Encoding::cull`](crate::transfer::Encoding::cull)). Relative to each light's own result: lights still add up exactly.
    pub cull: Option<f32>,
    /// For dragging: what is not known yet from an earlier frame is lit coarsely; the rest is shown as it was. Left out are, of shadow rays from what the
    /// camera sees straight, three in four at 2x2 samples (shadows are as sharp as a pixel) and towards lights with extent (grain); in
    /// indirect light shadows' edges finer than a gather sample; and all bounces after the third, which are guessed. A frame without it then lights these
    /// lights anew.
    pub preview: bool,
}

impl Default for RelightSettings {
    fn default() -> Self {
        Self { bounces: None, aa: 2, only: Only::Both, per_light: false, cull: None, preview: false }
    }
}

impl RelightSettings {
    /// `epsilon` of culling for an operator.
    fn epsilon(&self, operator: &Operator) -> f32 {
        self.cull.unwrap_or_else(|| operator.encoding().cull())
    }
}

/// What a frame took, milliseconds unless said otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameStats {
    /// The whole frame.
    pub frame_ms: f64,
    /// What pixels reflect, the cloud's albedo and how fast light fades, where the rig edits base colours otherwise than in the frame before; else 0.
    /// The last is most of it: some twenty to forty steps of bounces, as much as those of two to four lights.
    pub edits_ms: f64,
    /// Direct light on the view samples; in the first frame also what of them a light could reach is found.
    pub direct_ms: f64,
    /// Direct light on the cloud; in the first frame also what of it a light could reach is found.
    pub cloud_ms: f64,
    /// Bounces within the cloud.
    pub bounces_ms: f64,
    /// The final gather.
    pub gather_ms: f64,
    /// Indirect light spread to the pixels; in the first frame also what these reflect is found.
    pub upsample_ms: f64,
    /// The sum over lights.
    pub sum_ms: f64,
    /// Lights that had to be relit; the others were kept from before.
    pub relit: usize,
    /// Shadow rays, from view samples and from the cloud.
    pub shadow_rays: u64,
    /// Those of them from the cloud.
    pub cloud_rays: u64,
    /// How often light was gathered: once a lamp, twice where what emits or a dome shines.
    pub gathers: u32,
    /// Bytes that spreading indirect light to the pixels reads and writes.
    pub upsample_bytes: u64,
    /// Bytes that the sum over lights reads and writes.
    pub sum_bytes: u64,
    /// How often the bounce operator was applied.
    pub bounce_steps: u32,
    /// Multiply-adds of each colour, in bounces and final gather.
    pub multiply_adds: u64,
    /// Those of them that were culled.
    pub culled: u64,
}

impl FrameStats {
    fn add(&mut self, work: Work) {
        self.multiply_adds += work.all;
        self.culled += work.culled;
    }
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
    accel: Arc<Accel>,
    /// Within the cloud as it was prepared.
    bounces: CloudBounces,
    edits: Edits,
    edges: Vec<bool>,
    /// By samples along a pixel's side, 1 and 2; made when asked for.
    reflections: [Option<Reflection>; 2],
    /// What of the view a light could reach, in the same way.
    tiles: [Option<Vec<PointGroup>>; 2],
    /// The same of the cloud.
    cloud_groups: Option<Vec<PointGroup>>,
    /// What the lights of the last frame did.
    kept: Vec<Kept>,
    /// The same of lights that were off or black in it.
    dark: Vec<Kept>,
    /// Materials that shine, ascending.
    emissive: Vec<u32>,
    emission: Vec<Glow>,
    stats: FrameStats,
}

impl Relighter {
    /// Makes a shot ready: builds the acceleration structure for its shadows and finds how fast its light fades.
    pub fn new(transfer: impl Into<Arc<Transfer>>) -> Self {
        crate::shade::warm_up();
        let transfer = transfer.into();
        let base_colors = transfer.report.base_colors.iter().map(|&rgb| Vec3::from(rgb)).collect();
        Self {
            accel: transfer.occluders.accel(),
            bounces: CloudBounces::new(&transfer, &transfer.cloud),
            edits: Edits::new(&transfer, base_colors),
            edges: edge_pixels(&transfer.view),
            reflections: [None, None],
            tiles: [None, None],
            cloud_groups: None,
            kept: Vec::new(),
            dark: Vec::new(),
            emissive: transfer.emissive_materials(),
            emission: Vec::new(),
            stats: FrameStats::default(),
            transfer,
        }
    }

    /// The shot.
    pub fn transfer(&self) -> &Transfer {
        &self.transfer
    }

    /// What shadow rays are traced in.
    pub fn accel(&self) -> &Accel {
        &self.accel
    }

    /// What the last frame took.
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// Pixels on a geometric edge.
    pub fn edges(&self) -> &[bool] {
        &self.edges
    }

    /// The diffuse albedo of what the camera sees, `k_d`, under the base colours of the last frame: dimensionless, the mean over a pixel's samples.
    pub fn albedo(&self) -> Image {
        self.transfer.view.albedo(self.edits.scales())
    }

    /// Forgets what earlier frames computed.
    pub fn forget(&mut self) {
        self.kept.clear();
        self.dark.clear();
        self.emission.clear();
    }

    /// The shot under `rig`. Lights that have not changed since an earlier frame, or only in colour, cost nothing but
    /// their share of the sum. Where base colours change, all lights are relit.
    ///
    /// # Errors
    /// [`Error::Setting`] unless `aa` is 1 or 2, `cull` 0 to 1, every emitter of the rig names a material of the scene that shines and has a
    /// usable scale, every edited material is one of the scene and has a base colour within `0..=1`, none is named twice, the shot has the sky where a dome
    /// is to shine, and it can tell so many bounces apart and have other colours ([`Multibounce`](crate::transfer::Multibounce)).
    pub fn relight(&mut self, rig: &LightRig, settings: &RelightSettings) -> Result<Layers> {
        self.relight_watched(rig, settings, &())
    }

    /// Whether the shot can be relit so, without lighting anything: no other frame of this rig and these settings is refused.
    ///
    /// # Errors
    /// [`Error::Setting`] as [`Self::relight`].
    pub fn check(&self, rig: &LightRig, settings: &RelightSettings) -> Result<()> {
        self.asked(rig, settings).map(drop)
    }

    /// What emits, in groups, with what each is multiplied by, and the base colours by material.
    fn asked(&self, rig: &LightRig, settings: &RelightSettings) -> Result<Asked> {
        if !(1..=2).contains(&settings.aa) {
            return Err(Error::Setting(format!("{} samples a pixel side: must be 1 or 2", settings.aa)));
        }
        if settings.cull.is_some_and(|cull| !(0.0..=1.0).contains(&cull)) {
            let cull = settings.cull.unwrap_or_default();
            return Err(Error::Setting(format!("an epsilon of {cull} to cull by: must be 0 to 1")));
        }
        if settings.only == Only::Indirect && self.transfer.is_direct_only() {
            return Err(Error::Setting(
                "the shot has no indirect light yet: only direct light is there".to_owned(),
            ));
        }
        let glows = self.glows(rig)?;
        let base_colors = edits::base_colors(&self.transfer.report, rig)?;
        let dome = shining(rig).into_iter().find(|light| matches!(light.kind, LightKind::Dome { .. }));
        if let Some(dome) = dome.filter(|_| !self.transfer.report.settings.sky) {
            return Err(Error::Setting(format!(
                "dome light `{}`: the shot was prepared without the sky; prepare it again without --no-sky",
                dome.name
            )));
        }
        if settings.only != Only::Direct {
            let emits = dome.is_some() || glows.iter().any(|(_, scale)| *scale != Vec3::ZERO);
            self.transfer.multibounce().check_bounces(settings.bounces, emits)?;
        }
        Ok((glows, base_colors))
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
        let began = Instant::now();
        let (glows, base_colors) = self.asked(rig, settings)?;
        let shining = shining(rig);
        self.stats = FrameStats::default();
        if self.edits.differ_from(&base_colors) {
            let began = Instant::now();
            self.forget();
            self.edits = Edits::new(&self.transfer, base_colors);
            let reflection = Reflection::new(&self.transfer, self.edits.scales(), settings.aa);
            self.reflections = [None, None];
            self.reflections[settings.aa as usize - 1] = Some(reflection);
            self.stats.edits_ms = milliseconds(began);
        }
        progress.stage("relighting", (shining.len() + glows.len()) as u64);
        let mut before = std::mem::take(&mut self.kept);
        before.append(&mut self.dark);
        for light in &shining {
            if progress.cancelled() {
                self.dark = before;
                return Err(Error::Cancelled);
            }
            let found = before
                .iter()
                .position(|kept| kept.settings.serve(settings) && kept.light.same_but_for_color(light));
            let known = found.map(|place| before.swap_remove(place));
            let (lit, settings) = match known {
                Some(kept) => (kept.lit, kept.settings),
                None => (self.light(light, settings), *settings),
            };
            self.kept.push(Kept { light: (*light).clone(), settings, lit });
            progress.advance(1);
        }
        // a light that is off or black keeps what it did, and comes back for nothing
        self.dark = before
            .into_iter()
            .filter(|kept| kept.settings.serve(settings))
            .filter(|kept| rig.lights.iter().any(|light| kept.light.same_but_for_color(light)))
            .collect();
        self.light_emission(glows, settings, progress)?;
        let sum_began = Instant::now();
        let mut layers = self.sum(settings);
        layers.edges.clone_from(&self.edges);
        self.stats.sum_ms = milliseconds(sum_began);
        // of two layers, each light's is read, and the sum read and written
        let shining = self.emission.iter().filter(|glow| glow.scale.is_some()).count();
        let images = 2 * 3 * (self.kept.len() + shining + usize::from(shining > 0));
        self.stats.sum_bytes = (images * layers.direct.pixels.len() * size_of::<Vec3>()) as u64;
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
        match &white.kind {
            LightKind::Dome { map, intensity, rotation } => {
                self.dome(&Dome::new(map.clone(), *intensity, *rotation), settings)
            }
            _ => self.lamp(&white, settings),
        }
    }

    /// A light that shines from a place or a direction.
    fn lamp(&mut self, light: &Light, settings: &RelightSettings) -> Lit {
        let mut lit = Lit { direct: self.black(), indirect: self.black() };
        if settings.only != Only::Indirect {
            let began = Instant::now();
            let samples = &self.transfer.view;
            let tiles = self.tiles[settings.aa as usize - 1]
                .get_or_insert_with(|| direct::tiles(samples, settings.aa));
            let view = direct::View { samples, scales: self.edits.scales(), tiles };
            let (direct, rays) = direct::direct(view, &self.accel, light, settings);
            lit.direct.pixels = direct;
            self.stats.shadow_rays += rays;
            self.stats.direct_ms += milliseconds(began);
        }
        let gathers = !self.transfer.is_direct_only() && settings.bounces != Some(0);
        if settings.only != Only::Direct && gathers {
            let began = Instant::now();
            let detail = if settings.preview { Detail::Coarse } else { Detail::Full };
            let groups = self.cloud_groups.get_or_insert_with(|| cloud_groups(&self.transfer.cloud));
            let cloud = self.edits.cloud(&self.transfer);
            let cloud = illuminate_with(cloud, Some(groups), &self.accel, light, detail);
            self.stats.shadow_rays += cloud.shadow_rays;
            self.stats.cloud_rays += cloud.shadow_rays;
            self.stats.cloud_ms += milliseconds(began);
            let times = settings.bounces.map(|bounces| bounces - 1);
            lit.indirect.pixels = self.gather(&cloud.radiance, times, settings);
        }
        lit
    }

    /// How light goes round within the cloud, under the base colours of the frame.
    fn bounces_for(&self, settings: &RelightSettings) -> Cow<'_, CloudBounces> {
        let bounces = self.edits.bounces(&self.bounces);
        if settings.preview { Cow::Owned(bounces.coarse()) } else { Cow::Borrowed(bounces) }
    }

    /// Light on the cloud, bounced and gathered to the pixels.
    fn gather(&mut self, radiance: &[Vec3], times: Option<u32>, settings: &RelightSettings) -> Vec<Vec3> {
        let began = Instant::now();
        let (bounce, bounces) = (&self.transfer.bounce, self.bounces_for(settings));
        let bounced = bounces.sum(bounce, radiance, times, settings.epsilon(bounce));
        self.gather_bounced(bounced, began, settings)
    }

    /// The final gather of light on the cloud that has bounced since `began`.
    fn gather_bounced(
        &mut self,
        (bounced, steps, work): (Vec<Vec3>, u32, Work),
        began: Instant,
        settings: &RelightSettings,
    ) -> Vec<Vec3> {
        self.stats.add(work);
        self.stats.bounce_steps += steps;
        self.stats.bounces_ms += milliseconds(began);
        let began = Instant::now();
        let (gathered, glossy, work) =
            self.transfer.gather_from(&bounced, settings.epsilon(&self.transfer.gather));
        self.stats.add(work);
        self.stats.gathers += 1;
        self.stats.gather_ms += milliseconds(began);
        let began = Instant::now();
        let reflection = self.reflections[settings.aa as usize - 1]
            .get_or_insert_with(|| Reflection::new(&self.transfer, self.edits.scales(), settings.aa));
        let pixels = reflection.upsample(&gathered, glossy.as_deref());
        let light = gathered.len() + glossy.as_ref().map_or(0, Vec::len) + pixels.len();
        self.stats.upsample_bytes += (reflection.bytes() + light * size_of::<Vec3>()) as u64;
        self.stats.upsample_ms += milliseconds(began);
        pixels
    }

    fn sum(&self, settings: &RelightSettings) -> Layers {
        let mut layers = Layers { direct: self.black(), indirect: self.black(), ..Layers::default() };
        for Kept { light, lit, .. } in &self.kept {
            add_scaled(&mut layers.direct, &lit.direct, light.color());
            add_scaled(&mut layers.indirect, &lit.indirect, light.color());
        }
        let emission = self.emission_layers();
        if let Some(emission) = &emission {
            add_scaled(&mut layers.direct, &emission.direct, Vec3::ONE);
            add_scaled(&mut layers.indirect, &emission.indirect, Vec3::ONE);
        }
        if settings.per_light {
            let of_light = |Kept { light, lit, .. }: &Kept| LightLayers {
                name: light.name.clone(),
                direct: scaled(&lit.direct, light.color()),
                indirect: scaled(&lit.indirect, light.color()),
            };
            layers.per_light = self.kept.iter().map(of_light).chain(emission).collect();
        }
        layers
    }
}

impl RelightSettings {
    /// Whether a light relit with these settings is what the `wanted` ones ask for, or better.
    fn serve(&self, wanted: &Self) -> bool {
        let of_look = |settings: &Self| (settings.bounces, settings.aa, settings.only, settings.cull);
        of_look(self) == of_look(wanted) && (wanted.preview || !self.preview)
    }
}

/// Groups of emissive materials with what each is multiplied by, and the base colour of each material.
type Asked = (Vec<(Vec<u32>, Vec3)>, Vec<Vec3>);

/// Lights that shine.
fn shining(rig: &LightRig) -> Vec<&Light> {
    rig.lights.iter().filter(|light| light.enabled && light.color() != Vec3::ZERO).collect()
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
