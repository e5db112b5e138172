//! The light prior: how much each wavelet coefficient of light on the cloud is expected to vary.
//!
//! Learned from random lights in the scene's free space (narrow and wide spots, omnis and suns), from skies where there is one, and from
//! light from everywhere, each scaled so that it carries the same energy on the cloud: how large each coefficient is, and which go together. The spread
//! falls with the area of the basis function by far less than area-weighted selection assumes.

use std::f32::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use super::{Coefficients, Operator, Selection, bounces, haar};
use crate::progress::Progress;
use crate::sample::{GatherCloud, GatherSample, illuminate};
use crate::scene::{Light, LightKind};
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, uniform_sphere, unit};
use crate::trace::{Accel, Ray, offset_origin};
use crate::{Error, Result};

/// Share of a coefficient's own measured variance in its prior; the rest is the mean of its level, so that a
/// coefficient that no training light happened to touch is not thought impossible.
const OWN_SHARE: f64 = 0.6;

/// Of a scene that is open, this share of the lights are skies.
const SKIES: f32 = 0.125;

/// A light to learn from.
pub(super) enum TrainingLight {
    Lamp(Light),
    Sky(Sky),
}

/// A sky to learn from: some glow all around, and two places that are brighter.
pub(super) struct Sky {
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

    fn radiance(&self, direction: Vec3) -> f32 {
        let lobe = |Lobe { direction: middle, sharpness, weight }: &Lobe| {
            let norm = sharpness / (2.0 * PI * (1.0 - (-2.0 * sharpness).exp()));
            weight * norm * (sharpness * (middle.dot(direction) - 1.0)).exp()
        };
        self.glow + self.lobes.iter().map(lobe).sum::<f32>()
    }
}

/// Random lights of unit flux in the free space around the cloud.
pub(super) fn training_lights(
    cloud: &GatherCloud,
    accel: &Accel,
    count: usize,
    seed: u32,
) -> Vec<TrainingLight> {
    let positions = || cloud.surfaces().iter().map(|sample| sample.position);
    let low = positions().fold(Vec3::INFINITY, Vec3::min);
    let high = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    let diagonal = low.distance(high).max(1e-3);
    let light = |seed| {
        if !cloud.sky.is_empty() && unit(hash(50, seed)) < SKIES {
            TrainingLight::Sky(Sky::random(seed))
        } else {
            TrainingLight::Lamp(training_light(cloud.surfaces(), accel, diagonal, seed))
        }
    };
    (0..count as u32).map(|index| light(hash(index, seed))).collect()
}

fn training_light(surfaces: &[GatherSample], accel: &Accel, diagonal: f32, seed: u32) -> Light {
    let random = |dimension: u32| unit(hash(dimension, seed));
    let sample = &surfaces[((random(0) * surfaces.len() as f32) as usize).min(surfaces.len() - 1)];
    let away = cosine_hemisphere(sample.normal, sobol_2d(0, 0, seed));
    let origin = offset_origin(sample.position, sample.normal);
    let free = accel.closest(&Ray::new(origin, away)).t.min(0.5 * diagonal);
    let position = origin + away * (free * (0.03 + 0.94 * random(1)));
    let kind = match random(2) {
        pick if pick < 0.5 => {
            let outer_angle = 6.0 * 8.0_f32.powf(random(3)); // 6 to 48 degrees
            let inner_angle = outer_angle * (0.3 + 0.6 * random(4));
            let middle = (0.5 * (outer_angle + inner_angle)).to_radians();
            let flux = 2.0 * PI * (1.0 - middle.cos());
            let target = position + uniform_sphere(sobol_2d(1, 0, seed));
            LightKind::Spot {
                position,
                target,
                intensity: Vec3::splat(1.0 / flux),
                inner_angle,
                outer_angle,
                radius: 0.0,
            }
        }
        pick if pick < 0.85 => LightKind::Omni { position, intensity: Vec3::splat(0.25 / PI), radius: 0.0 },
        _ => {
            let up = cosine_hemisphere(Vec3::Y, sobol_2d(2, 0, seed));
            let irradiance = Vec3::splat(16.0 / (diagonal * diagonal));
            LightKind::Distant { direction: -up, irradiance, angle: 0.0 }
        }
    };
    Light { name: String::new(), enabled: true, kind }
}

/// Radiance on the cloud under each of `lights`, the mean of the channels. Under a white light the colour is the albedo's, but
/// for cells of several colours that are lit in part.
pub(super) fn train(
    cloud: &GatherCloud,
    accel: &Accel,
    lights: &[TrainingLight],
    progress: &dyn Progress,
) -> Result<Vec<Vec<f32>>> {
    progress.stage("training lights", lights.len() as u64);
    lights
        .par_iter()
        .map(|light| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let radiance = match light {
                TrainingLight::Lamp(light) => {
                    let radiance = illuminate(cloud, accel, light).radiance;
                    radiance.iter().map(|rgb| rgb.element_sum() / 3.0).collect()
                }
                TrainingLight::Sky(sky) => on_the_sky(cloud, sky),
            };
            progress.advance(1);
            Ok(radiance)
        })
        .collect()
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

/// What is known of light on the cloud before a lamp is set. Errors are relative to each image: a light that shines on little, and
/// brightly, counts no more than others. All are scaled to the same energy, a mean square of one on the cloud.
pub(super) struct LightPrior {
    /// `D`: the expected magnitude of each Haar coefficient, all channels; its mean square is one. Learned, or what another
    /// [`Selection`] puts in its place.
    pub(super) magnitudes: Vec<f32>,
    /// `C`: the grey coefficients of the training lights over `D`. Row after row, a row a coefficient, a column a light.
    pub(super) training: Vec<f32>,
    /// Columns of `training`.
    pub(super) lights: usize,
    /// The same of lights from which nothing is learned: they tell how well what was learned holds.
    pub(super) held: Vec<f32>,
    /// Columns of `held`.
    pub(super) held_lights: usize,
}

/// One light in so many is held out: the last ones.
const HELD_OUT: usize = 4;
/// Most lights that are held out. Each costs a product with all rows.
const MOST_HELD_OUT: usize = 48;

/// How far a prior has learned.
struct Lessons {
    /// Grey coefficients of each light.
    grey: Vec<Vec<f32>>,
    /// Sum over lights of the squares of each coefficient, all channels.
    variance: Vec<f64>,
}

impl LightPrior {
    /// Learns from `lights` on the cloud, with their bounces where a bounce operator is given and how often to apply it. `selection` says
    /// whether magnitudes are learned as well.
    pub(super) fn new(
        cloud: &GatherCloud,
        lights: &[Vec<f32>],
        selection: Selection,
        bounce: Option<(&Operator, u32)>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let count = cloud.len();
        let albedo: Vec<Vec3> = cloud.samples.iter().map(|sample| sample.albedo).collect();
        let mut lessons = Lessons { grey: Vec::new(), variance: vec![0.0; count] };
        // light from everywhere: a closed room under an even sky, and what is left where no lamp shines on anything
        lessons.learn(&vec![Vec3::ONE; count]);
        let mut held = Vec::new();
        let first_held = lights.len() - lights.len().div_ceil(HELD_OUT).min(MOST_HELD_OUT);
        let mut tints: Vec<Vec3> =
            albedo.iter().map(|rgb| *rgb * (3.0 / rgb.element_sum().max(1e-30))).collect();
        // the sky has no colour of its own
        tints[cloud.surfaces().len()..].fill(Vec3::ONE);
        for (index, light) in lights.iter().enumerate() {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let mut light: Vec<Vec3> = light.iter().zip(&tints).map(|(grey, tint)| *grey * *tint).collect();
            if let Some((bounce, times)) = bounce {
                light = bounces::gather_bounces(bounce, &albedo, &light, Some(times)).0;
            }
            if index < first_held {
                lessons.learn(&light);
            } else {
                held.extend(scaled(&light).map(|(_, grey)| grey));
            }
            progress.advance(1);
        }
        let Lessons { grey, variance } = lessons;
        let magnitudes = selection.unlearned(count).unwrap_or_else(|| magnitudes(&variance));
        Ok(Self {
            training: columns(&grey, &magnitudes),
            lights: grey.len(),
            held: columns(&held, &magnitudes),
            held_lights: held.len(),
            magnitudes,
        })
    }
}

impl Lessons {
    fn learn(&mut self, light: &[Vec3]) {
        let Some((shares, grey)) = scaled(light) else { return };
        for (variance, share) in self.variance.iter_mut().zip(shares) {
            *variance += share;
        }
        self.grey.push(grey);
    }
}

/// The share of a light's energy in each coefficient, all channels, and its grey coefficients, scaled to the energy that all lights
/// have. `None` for one that meets nothing: it teaches nothing.
fn scaled(light: &[Vec3]) -> Option<(Vec<f64>, Vec<f32>)> {
    let coefficients = Coefficients::new(light, &[]);
    let squares = |rgb: &[f32; 3]| rgb.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>();
    let mut shares: Vec<f64> = coefficients.as_slice().iter().map(squares).collect();
    let energy: f64 = shares.iter().sum();
    if energy <= 0.0 {
        return None;
    }
    shares.iter_mut().for_each(|share| *share /= energy);
    let scale = (light.len() as f64 / (3.0 * energy)).sqrt() as f32;
    let grey = coefficients.as_slice().iter().map(|rgb| scale * rgb.iter().sum::<f32>());
    Some((shares, grey.collect()))
}

/// `D` from the sum over lights of the squares of each coefficient.
fn magnitudes(variance: &[f64]) -> Vec<f32> {
    let count = variance.len();
    let levels = haar::level(count.max(1) - 1) + 1;
    let (mut sums, mut members) = (vec![0.0; levels], vec![0.0; levels]);
    for (index, variance) in variance.iter().enumerate() {
        sums[haar::level(index)] += variance;
        members[haar::level(index)] += 1.0;
    }
    let blend = |index: usize| {
        let level = haar::level(index);
        OWN_SHARE * variance[index] + (1.0 - OWN_SHARE) * sums[level] / members[level]
    };
    let total: f64 = (0..count).map(blend).sum::<f64>().max(1e-300);
    let scale = count as f64 / total;
    // no coefficient is thought impossible
    (0..count).map(|index| ((blend(index) * scale).sqrt() as f32).max(1e-6)).collect()
}

/// Coefficients in units of their expected magnitudes, a column a light.
fn columns(lights: &[Vec<f32>], magnitudes: &[f32]) -> Vec<f32> {
    let mut columns = Vec::with_capacity(lights.len() * magnitudes.len());
    for (index, magnitude) in magnitudes.iter().enumerate() {
        columns.extend(lights.iter().map(|light| light[index] / magnitude));
    }
    columns
}
