//! Light on the sub-samples of a patch, side by side.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use multiversion::multiversion;

use super::packed::unpacked;
use super::{SUB_SAMPLES, SubSample};
use crate::shade::{LANES, Lane, PreparedLight};

const _: () = assert!(SUB_SAMPLES == LANES);

/// What each sub-sample adds to the outgoing radiance of its patch, W/(sr m^2), were nothing in between it and the centre of the light.
pub(super) fn unshadowed(light: &PreparedLight, patch: &[SubSample; SUB_SAMPLES]) -> [Vec3; SUB_SAMPLES] {
    let (mut position, mut side) = ([[0.0; LANES]; 3], [[0.0; LANES]; 2]);
    for (lane, sub) in patch.iter().enumerate() {
        [position[0][lane], position[1][lane], position[2][lane]] = sub.position.to_array();
        [side[0][lane], side[1][lane]] = sub.normal.sides();
    }
    let mut factor = [0.0; LANES];
    let irradiance = cosines(light, &position, &side, &mut factor);
    std::array::from_fn(|lane| {
        let sub = &patch[lane];
        if factor[lane] == 0.0 {
            return Vec3::ZERO;
        }
        sub.albedo.get() * irradiance * (factor[lane] * sub.weight() * FRAC_1_PI)
    })
}

/// For each point, what the returned irradiance is multiplied by, the cosine included, from its position and the sides of its packed normal.
#[multiversion(targets("x86_64+avx2+fma"))]
fn cosines(light: &PreparedLight, position: &[Lane; 3], side: &[Lane; 2], factor: &mut Lane) -> Vec3 {
    let centers = light.centers(position);
    for i in 0..LANES {
        let [x, y, z] = unpacked([side[0][i], side[1][i]]);
        let [dx, dy, dz] = [0, 1, 2].map(|axis| centers.direction[axis][i]);
        let cos = x * dx + y * dy + z * dz;
        factor[i] = if cos > 0.0 { centers.factor[i] * cos } else { 0.0 };
    }
    centers.irradiance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{PackedNormal, PackedUnit};
    use crate::scene::{Light, LightKind};
    use crate::trace::sampling::{hash, sobol_2d, uniform_sphere, unit};

    /// One sub-sample alone, from what a light says of a point.
    fn alone(light: &PreparedLight, sub: &SubSample) -> Vec3 {
        let Some(sample) = light.center(sub.position) else { return Vec3::ZERO };
        let cos = sub.normal.get().dot(sample.direction).max(0.0);
        sub.albedo.get() * sample.irradiance * (cos * sub.weight() * FRAC_1_PI)
    }

    #[test]
    fn sub_samples_are_lit_side_by_side_as_they_are_alone() {
        let mut lit = 0;
        for seed in 0..600_u32 {
            let random = |dimension: u32| unit(hash(dimension, seed));
            let vector = |dimension: u32| {
                Vec3::from_array(std::array::from_fn(|axis| 2.0 * random(dimension + axis as u32) - 1.0))
            };
            let (position, intensity) = (vector(0), Vec3::new(1.0, 2.0, 3.0));
            let radius = if seed % 2 == 0 { 0.0 } else { random(3) };
            let kind = match seed % 5 {
                0 | 1 => LightKind::Omni { position, intensity, radius },
                2 | 3 => LightKind::Spot {
                    position,
                    target: vector(4),
                    intensity,
                    inner_angle: 30.0 * random(7),
                    outer_angle: 40.0 + 40.0 * random(8),
                    radius,
                },
                _ => {
                    LightKind::Distant { direction: position, irradiance: intensity, angle: 5.0 * random(3) }
                }
            };
            let light = PreparedLight::new(&Light { name: String::new(), enabled: true, kind });
            let patch = std::array::from_fn(|i| SubSample {
                // one of them where the light is
                position: if i == 3 { position } else { vector(20 + 10 * i as u32) },
                normal: PackedNormal::new(uniform_sphere(sobol_2d(i as u32, 0, seed))),
                albedo: PackedUnit::new(Vec3::new(random(9), random(10), 1.0)),
                weight: if i == 5 { 0 } else { 4000 },
            });
            for (found, sub) in unshadowed(&light, &patch).iter().zip(&patch) {
                let expected = alone(&light, sub);
                assert!(expected.is_finite() && found.is_finite());
                lit += u32::from(expected != Vec3::ZERO);
                // where a cosine is nearly none, or a spot's rim ends, only what the light could bring tells rounding from error
                let most = 3.0
                    / if seed % 5 == 4 {
                        1.0
                    } else {
                        position.distance_squared(sub.position).max(radius * radius)
                    };
                let off = (*found - expected).abs().max_element();
                assert!(
                    off <= 1e-5 * expected.max_element() + 1e-6 * most * sub.weight(),
                    "{found} {expected}"
                );
            }
        }
        assert!(lit > 2000, "{lit}");
    }
}
