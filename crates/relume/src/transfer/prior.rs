//! The light prior: how much each wavelet coefficient of light on the cloud is expected to vary.
//!
//! Learned from random lights in the scene's free space: narrow and wide spots, omnis and suns, each scaled so that it
//! carries the same energy on the cloud. The spread falls with the area of the basis function by far less than area-weighted selection assumes.

use std::f32::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use super::{Coefficients, Operator, bounces, haar};
use crate::progress::Progress;
use crate::sample::{GatherCloud, illuminate};
use crate::scene::{Light, LightKind};
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, uniform_sphere, unit};
use crate::trace::{Accel, Ray, offset_origin};
use crate::{Error, Result};

/// Share of a coefficient's own measured variance in its prior; the rest is the mean of its level, so that a
/// coefficient that no training light happened to touch is not thought impossible.
const OWN_SHARE: f64 = 0.6;

/// Random lights of unit flux in the free space around the cloud.
pub(super) fn training_lights(cloud: &GatherCloud, accel: &Accel, count: usize, seed: u32) -> Vec<Light> {
    let positions = || cloud.samples.iter().map(|sample| sample.position);
    let low = positions().fold(Vec3::INFINITY, Vec3::min);
    let high = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    let diagonal = low.distance(high).max(1e-3);
    (0..count as u32).map(|index| training_light(cloud, accel, diagonal, hash(index, seed))).collect()
}

fn training_light(cloud: &GatherCloud, accel: &Accel, diagonal: f32, seed: u32) -> Light {
    let random = |dimension: u32| unit(hash(dimension, seed));
    let sample = &cloud.samples[((random(0) * cloud.len() as f32) as usize).min(cloud.len() - 1)];
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

/// Light on the cloud from each of `lights`.
pub(super) fn train(
    cloud: &GatherCloud,
    accel: &Accel,
    lights: &[Light],
    progress: &dyn Progress,
) -> Result<Vec<Vec<Vec3>>> {
    progress.stage("light prior", lights.len() as u64);
    lights
        .par_iter()
        .map(|light| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let radiance = illuminate(cloud, accel, light).radiance;
            progress.advance(1);
            Ok(radiance)
        })
        .collect()
}

/// `D`: the expected magnitude of each Haar coefficient, learned from `lights` on the cloud, with their bounces where a
/// bounce operator is given. Scaled so that the mean square is one.
pub(super) fn magnitudes(cloud: &GatherCloud, lights: &[Vec<Vec3>], bounce: Option<&Operator>) -> Vec<f32> {
    let count = cloud.len();
    let albedo: Vec<Vec3> = cloud.samples.iter().map(|sample| sample.albedo).collect();
    let mut variance = vec![0.0_f64; count];
    for light in lights {
        let bounced = bounce.map(|bounce| bounces::gather_bounces(bounce, &albedo, light, Some(4)).0);
        let light = bounced.as_deref().unwrap_or(light);
        let coefficients = Coefficients::new(light, &[]);
        // Errors are relative to each image: a light that shines on little, and brightly, counts no more than others.
        let energy: f64 = light.iter().map(|rgb| f64::from(rgb.length_squared())).sum();
        let weight = if energy > 0.0 { 1.0 / energy } else { 0.0 };
        for (variance, rgb) in variance.iter_mut().zip(coefficients.as_slice()) {
            *variance += weight * rgb.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>();
        }
    }
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
    // a scene that no training light reaches still gets a usable prior
    (0..count).map(|index| ((blend(index) * scale).sqrt() as f32).max(1e-6)).collect()
}
