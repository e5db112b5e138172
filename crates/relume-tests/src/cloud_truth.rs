//! Bounced light that arrives at gather samples, by paths: what the bounce operator says, without the final gather.

use rayon::prelude::*;
use relume::Light;
use relume::glam::{Vec2, Vec3};
use relume::sample::GatherSample;
use relume::shade::{PreparedLight, shadow_ray, surface_at};
use relume::trace::sampling::{cosine_hemisphere, hash, sobol_2d, unit};
use relume::trace::{Accel, Ray, offset_origin};

use crate::scenes::TestScene;

/// Irradiance over pi at each of `samples` from light that has met at least one surface on its way, W/(sr m^2). Every surface is a diffuse
/// reflector with the hemispherical reflectance as albedo and its geometric normal, as the transfer models it; light from `light` alone.
/// Another seed gives independent noise.
pub fn bounced_irradiance(
    built: &TestScene,
    light: &Light,
    samples: &[GatherSample],
    paths: u32,
    seed: u32,
) -> Vec<Vec3> {
    let light = PreparedLight::new(light);
    let walk = |(number, sample): (usize, &GatherSample)| {
        let seed = hash(number as u32, seed);
        let path = |index| one_path(built, &light, sample, index, seed);
        (0..paths).map(path).sum::<Vec3>() / paths as f32
    };
    samples.par_iter().enumerate().map(walk).collect()
}

/// The light that one path finds.
fn one_path(built: &TestScene, light: &PreparedLight, sample: &GatherSample, index: u32, seed: u32) -> Vec3 {
    let TestScene { scene, geometry, accel } = built;
    let (mut position, mut normal) = (sample.position, sample.normal);
    let (mut found, mut throughput) = (Vec3::ZERO, Vec3::ONE);
    for depth in 0.. {
        let direction = cosine_hemisphere(normal, sobol_2d(index, 3 * depth, seed));
        let hit = accel.closest(&Ray::new(offset_origin(position, normal), direction));
        if !hit.is_hit() {
            break;
        }
        let surface = surface_at(scene, geometry, &hit, direction);
        if !surface.lit {
            break;
        }
        (position, normal) = (surface.position, surface.geometric_normal);
        throughput *= surface.hemispherical_reflectance();
        let draw = sobol_2d(index, 3 * depth + 1, seed);
        found += throughput * direct(accel, light, position, normal, draw);
        let survival = throughput.max_element().min(0.95);
        if unit(hash(index ^ depth << 20, seed)) >= survival {
            break;
        }
        throughput /= survival;
    }
    found
}

/// Irradiance over pi straight from the light.
fn direct(accel: &Accel, light: &PreparedLight, position: Vec3, normal: Vec3, draw: Vec2) -> Vec3 {
    let Some(sample) = light.sample(position, draw) else { return Vec3::ZERO };
    let cosine = normal.dot(sample.direction);
    if cosine <= 0.0 || accel.occluded(&shadow_ray(position, normal, &sample)) {
        return Vec3::ZERO;
    }
    sample.irradiance * (cosine / std::f32::consts::PI)
}

/// `norm(light - truth) / norm(truth)` over samples, with the truth's noise, known from two halves, taken out; 0 where chance makes the square
/// negative.
pub fn unbiased_error(light: &[Vec3], halves: &[Vec<Vec3>; 2]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (light, (a, b)) in light.iter().zip(halves[0].iter().zip(&halves[1])) {
        let (light, a, b) = (light.as_dvec3(), a.as_dvec3(), b.as_dvec3());
        error += (light - a).dot(light - b);
        norm += a.dot(b);
    }
    (error / norm.max(f64::MIN_POSITIVE)).max(0.0).sqrt()
}
