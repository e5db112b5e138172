//! Lights to learn from, and others to be judged by.
//!
//! What is learned from: random lights in the scene's free space (narrow and wide spots, omnis and suns) and, where there is a sky, skies, half of them on
//! surfaces as they are and half on white paint, since a rig may paint them; and what shines in the scene, which is no guess. Nothing is learned from some of the random lights, which tell how much an encoding loses; and from
//! *others*, of kinds that are never learned from: needles of light, lamps at a wall, strings of lamps, low suns, even skies. Those tell how far
//! what was learned holds.

use std::f32::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use super::outlook::{brightest, diagonal, share};
use super::prior::is_white;
use crate::progress::Progress;
use crate::sample::{Detail, GatherCloud, GatherSample, cloud_groups, illuminate_with};
use crate::scene::{Light, LightKind};
use crate::shade::PointGroup;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, uniform_sphere, unit};
use crate::trace::{Accel, Ray, offset_origin};
use crate::{Error, Result};

/// Of a scene that is open, this share of the lights are skies.
const SKIES: f32 = 0.125;

/// Kinds of lights that are never learned from.
const OTHERS: u32 = 5;

/// Most materials that shine which are learned from each by itself, those of the most power.
const MOST_SHINING: usize = 8;

/// A light on the cloud.
enum Source {
    Lamps(Vec<Light>),
    Sky(Sky),
}

/// Radiance on the cloud under lights, the mean of the channels.
#[derive(Default)]
pub(super) struct Training {
    /// Of the kinds that are learned from, in no order; on white paint where [`is_white`] says so.
    pub(super) alike: Vec<Vec<f32>>,
    /// Of other kinds.
    pub(super) others: Vec<Vec<f32>>,
    /// What surfaces emit, one a material, of its brightest place.
    pub(super) shining: Vec<Vec<f32>>,
    /// What samples reflect on white paint, RGB: where base colour factors, which a rig may change, are white.
    pub(super) white: Vec<Vec3>,
}

/// A sky to learn from: some glow all around, and two places that are brighter.
struct Sky {
    glow: f32,
    lobes: [Lobe; 2],
}

/// `weight exp(sharpness (cos - 1))`, scaled so that `weight` is what comes from all directions together.
struct Lobe {
    direction: Vec3,
    sharpness: f32,
    weight: f32,
}

impl Sky {
    fn random(seed: u32) -> Self {
        let random = |dimension: u32| unit(hash(dimension, seed));
        let lobe = |number: u32| Lobe {
            direction: cosine_hemisphere(Vec3::Y, sobol_2d(3 + number, 0, seed)),
            // from a glow over a quarter of the sky to a sun of two degrees
            sharpness: 3000.0_f32.powf(random(20 + number)),
            weight: random(30 + number),
        };
        Self { glow: 0.1 * random(40), lobes: [0, 1].map(lobe) }
    }

    /// The glow alone.
    fn even() -> Self {
        let none = || Lobe { direction: Vec3::Y, sharpness: 1.0, weight: 0.0 };
        Self { glow: 1.0, lobes: [none(), none()] }
    }

    fn radiance(&self, direction: Vec3) -> f32 {
        let lobe = |Lobe { direction: middle, sharpness, weight }: &Lobe| {
            let norm = sharpness / (2.0 * PI * (1.0 - (-2.0 * sharpness).exp()));
            weight * norm * (sharpness * (middle.dot(direction) - 1.0)).exp()
        };
        self.glow + self.lobes.iter().map(lobe).sum::<f32>()
    }
}

impl Training {
    /// `alike` random lights of unit flux in the free space around the cloud, and `others` of other kinds. Under a white light the colour is
    /// the albedo's, but for cells of several colours that are lit in part.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn new(
        (cloud, white): (&GatherCloud, &GatherCloud),
        accel: &Accel,
        (alike, others): (usize, usize),
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<Self> {
        progress.stage("training lights", (alike + others) as u64);
        let space = Space::new(cloud, accel);
        let groups = cloud_groups(cloud);
        let lit = |source: Source, cloud: &GatherCloud| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let radiance = radiance_of(&source, (cloud, &groups), accel);
            progress.advance(1);
            Ok(radiance)
        };
        let usual = |number: u32| {
            let cloud = if is_white(number as usize, alike) { white } else { cloud };
            lit(space.usual(hash(number, seed)), cloud)
        };
        let others_seed = hash(seed, 0x07_4e85);
        let unusual = |number: u32| lit(space.unusual(number % OTHERS, hash(number, others_seed)), cloud);
        Ok(Self {
            alike: (0..alike as u32).into_par_iter().map(usual).collect::<Result<_>>()?,
            others: (0..others as u32).into_par_iter().map(unusual).collect::<Result<_>>()?,
            shining: shining(cloud),
            white: white.samples.iter().map(|sample| sample.albedo).collect(),
        })
    }
}

/// Where lights may be.
struct Space<'a> {
    cloud: &'a GatherCloud,
    accel: &'a Accel,
    /// Of the box around all surfaces, metres.
    diagonal: f32,
}

impl<'a> Space<'a> {
    fn new(cloud: &'a GatherCloud, accel: &'a Accel) -> Self {
        Self { cloud, accel, diagonal: diagonal(cloud) }
    }

    /// A random surface sample.
    fn surface(&self, seed: u32) -> &GatherSample {
        let surfaces = self.cloud.surfaces();
        &surfaces[((unit(hash(0, seed)) * surfaces.len() as f32) as usize).min(surfaces.len() - 1)]
    }

    /// A place in the open: a share of the way from a random surface to what lies in front of it.
    fn place(&self, seed: u32, share: impl Fn(f32) -> f32) -> Vec3 {
        let sample = self.surface(seed);
        let away = cosine_hemisphere(sample.normal, sobol_2d(0, 0, seed));
        let origin = offset_origin(sample.position, sample.normal);
        let free = self.accel.closest(&Ray::new(origin, away)).t.min(0.5 * self.diagonal);
        origin + away * share(free)
    }

    /// A light to learn from.
    fn usual(&self, seed: u32) -> Source {
        let random = |dimension: u32| unit(hash(dimension, seed));
        if !self.cloud.sky.is_empty() && random(50) < SKIES {
            return Source::Sky(Sky::random(seed));
        }
        let position = self.place(seed, |free| free * (0.03 + 0.94 * random(1)));
        Source::Lamps(vec![match random(2) {
            pick if pick < 0.5 => {
                let outer_angle = 6.0 * 8.0_f32.powf(random(3)); // 6 to 48 degrees
                spot(position, (outer_angle * (0.3 + 0.6 * random(4)), outer_angle), seed)
            }
            pick if pick < 0.85 => omni(position),
            _ => self.sun(cosine_hemisphere(Vec3::Y, sobol_2d(2, 0, seed))),
        }])
    }

    /// A light of one of the kinds that are not learned from. Where there is no sky, its light is none.
    fn unusual(&self, kind: u32, seed: u32) -> Source {
        let random = |dimension: u32| unit(hash(dimension, seed));
        let anywhere = |seed: u32| self.place(seed, |free| free * (0.1 + 0.8 * random(1)));
        match kind {
            // a needle of light
            0 => {
                let outer_angle = 2.0 + 2.0 * random(3);
                Source::Lamps(vec![spot(anywhere(seed), (0.8 * outer_angle, outer_angle), seed)])
            }
            // a lamp at a wall
            1 => Source::Lamps(vec![omni(self.place(seed, |free| free.min(AT_A_WALL * self.diagonal)))]),
            // a string of lamps
            2 => {
                let [from, to] = [0, 1].map(|end| anywhere(hash(end, seed)));
                Source::Lamps(
                    (0..STRING).map(|lamp| omni(from.lerp(to, lamp as f32 / (STRING - 1) as f32))).collect(),
                )
            }
            // a low sun
            3 => {
                let (height, turn) = ((3.0 + 9.0 * random(3)).to_radians(), 2.0 * PI * random(4));
                let (sin, cos) = height.sin_cos();
                Source::Lamps(vec![self.sun(Vec3::new(cos * turn.cos(), sin, cos * turn.sin()))])
            }
            // an even sky
            _ => Source::Sky(Sky::even()),
        }
    }

    fn sun(&self, towards: Vec3) -> Light {
        let irradiance = Vec3::splat(16.0 / (self.diagonal * self.diagonal));
        light(LightKind::Distant { direction: -towards, irradiance, angle: 0.0 })
    }
}

/// Distance of a lamp at a wall, in diagonals of the scene: some centimetres in a room.
const AT_A_WALL: f32 = 0.005;
/// Lamps of a string.
const STRING: usize = 5;
fn light(kind: LightKind) -> Light {
    Light { name: String::new(), enabled: true, kind }
}

fn omni(position: Vec3) -> Light {
    light(LightKind::Omni { position, intensity: Vec3::splat(0.25 / PI), radius: 0.0 })
}

/// In any direction; the angles are the inner and the outer one, degrees.
fn spot(position: Vec3, (inner_angle, outer_angle): (f32, f32), seed: u32) -> Light {
    let middle = (0.5 * (outer_angle + inner_angle)).to_radians();
    let flux = 2.0 * PI * (1.0 - middle.cos());
    light(LightKind::Spot {
        position,
        target: position + uniform_sphere(sobol_2d(1, 0, seed)),
        intensity: Vec3::splat(1.0 / flux),
        inner_angle,
        outer_angle,
        radius: 0.0,
    })
}

/// What each material emits, of those that bring the most light to the cloud.
fn shining(cloud: &GatherCloud) -> Vec<Vec<f32>> {
    let brightest = brightest(cloud);
    let mut materials: Vec<u32> = brightest.keys().copied().collect();
    materials.sort_unstable();
    let of = |material: u32| cloud.emitted.iter().filter(move |part| part.material == material);
    let power = |&material: &u32| -> f32 {
        of(material).map(|part| part.radiance.element_sum() * cloud.samples[part.sample as usize].area).sum()
    };
    if materials.len() > MOST_SHINING {
        materials.sort_by(|a, b| power(b).total_cmp(&power(a)));
        materials.truncate(MOST_SHINING);
    }
    let radiance = |material: u32| {
        let mut radiance = vec![0.0; cloud.len()];
        of(material).for_each(|part| radiance[part.sample as usize] += share(part, &brightest));
        radiance
    };
    materials.into_iter().map(radiance).collect()
}

/// Radiance of each sample, the mean of the channels. `groups` are those of the cloud.
fn radiance_of(source: &Source, (cloud, groups): (&GatherCloud, &[PointGroup]), accel: &Accel) -> Vec<f32> {
    let mean = |rgb: Vec3| rgb.element_sum() / 3.0;
    match source {
        Source::Lamps(lamps) => {
            let mut sum = vec![0.0; cloud.len()];
            for lamp in lamps {
                let radiance = illuminate_with(cloud, Some(groups), accel, lamp, Detail::Full).radiance;
                sum.iter_mut().zip(radiance).for_each(|(sum, rgb)| *sum += mean(rgb));
            }
            sum
        }
        Source::Sky(sky) => on_the_sky(cloud, sky),
    }
}

/// Radiance of each sample under a sky, before any of it has met a surface.
fn on_the_sky(cloud: &GatherCloud, sky: &Sky) -> Vec<f32> {
    let mut radiance = vec![0.0; cloud.surfaces().len()];
    let mean = |cell: usize| {
        let directions = cloud.sky.targets(cell, 0);
        directions.iter().map(|direction| sky.radiance(*direction)).sum::<f32>() / directions.len() as f32
    };
    radiance.extend((0..cloud.sky.len()).map(mean));
    radiance
}
