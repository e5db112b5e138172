//! Light models against closed forms.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::{PointGroup, PreparedLight, needs_samples, sample, shadow_ray};
use crate::scene::{Light, LightKind};
use crate::trace::sampling::{hash, sobol_2d, unit};

const SAMPLES: u32 = 1 << 12;

fn light(kind: LightKind) -> Light {
    Light { name: String::new(), enabled: true, kind }
}

fn omni(radius: f32) -> Light {
    light(LightKind::Omni { position: Vec3::new(0.0, 2.0, 0.0), intensity: Vec3::new(1.0, 2.0, 3.0), radius })
}

fn spot(inner_angle: f32, outer_angle: f32) -> Light {
    light(LightKind::Spot {
        position: Vec3::ZERO,
        target: Vec3::new(0.0, -3.0, 0.0),
        intensity: Vec3::ONE,
        inner_angle,
        outer_angle,
        radius: 0.0,
    })
}

/// Irradiance on a surface at `position` with `normal`, without visibility.
fn irradiance(light: &Light, position: Vec3, normal: Vec3) -> DVec3 {
    let light = PreparedLight::new(light);
    (0..SAMPLES)
        .filter_map(|i| light.sample(position, sobol_2d(i, 0, 17)))
        .map(|sample| (sample.irradiance * normal.dot(sample.direction).max(0.0)).as_dvec3())
        .sum::<DVec3>()
        / f64::from(SAMPLES)
}

fn close(a: DVec3, b: Vec3, tolerance: f64) -> bool {
    (a - b.as_dvec3()).abs().max_element() <= tolerance * f64::from(b.max_element())
}

/// A spot at the origin that shines down, seen from `angle` degrees off its axis at distance 2.
fn spot_factor(light: &Light, angle: f32) -> f32 {
    let (sin, cos) = angle.to_radians().sin_cos();
    let position = 2.0 * Vec3::new(sin, -cos, 0.0);
    sample(light, position, glam::Vec2::ZERO).map_or(0.0, |sample| sample.irradiance.x * 4.0)
}

#[test]
fn point_light_falls_off_with_the_square() {
    let sample = sample(&omni(0.0), Vec3::new(0.0, 0.0, 1.5), glam::Vec2::splat(0.3)).unwrap();
    assert!((sample.distance - 2.5).abs() < 1e-6);
    assert!(sample.direction.abs_diff_eq(Vec3::new(0.0, 0.8, -0.6), 1e-6));
    assert!(sample.irradiance.abs_diff_eq(Vec3::new(1.0, 2.0, 3.0) / 6.25, 1e-6));
    assert!(!needs_samples(&omni(0.0)) && needs_samples(&omni(0.1)));
}

/// A sphere wholly above the horizon gives `pi L (r / d)^2 cos`: what the point in its centre gives.
#[test]
fn sphere_light_has_the_irradiance_of_its_centre() {
    for radius in [1e-4, 0.1, 1.0, 1.9_f32] {
        let radiance = Vec3::new(1.0, 2.0, 3.0) / (PI * radius * radius);
        let expected = PI * radiance * (radius / 2.0) * (radius / 2.0);
        let measured = irradiance(&omni(radius), Vec3::ZERO, Vec3::Y);
        assert!(close(measured, expected, 1e-3), "{measured} is not {expected}");
        assert!(!close(irradiance(&omni(radius), Vec3::new(0.0, -0.1, 0.0), Vec3::Y), expected, 1e-3));
    }
    let tilted = Vec3::new(0.6, 0.8, 0.0);
    assert!(close(irradiance(&omni(0.5), Vec3::ZERO, tilted), 0.8 * Vec3::new(1.0, 2.0, 3.0) / 4.0, 1e-3));
}

#[test]
fn sphere_samples_end_on_the_sphere() {
    for i in 0..200 {
        let position = Vec3::new(0.3, 0.0, -0.4);
        let sample = sample(&omni(0.7), position, sobol_2d(i, 0, 2)).unwrap();
        let end = position + sample.direction * sample.distance;
        assert!((end.distance(Vec3::new(0.0, 2.0, 0.0)) - 0.7).abs() < 1e-3);
        assert!(sample.distance < 2.05, "the near side");
    }
}

#[test]
fn points_in_or_at_a_light_stay_finite() {
    let center = Vec3::new(0.0, 2.0, 0.0);
    let nearby = [Vec3::ZERO, Vec3::X * 1e-20, Vec3::X * 1e-6, Vec3::Y * 0.3, Vec3::X * 0.5];
    for (radius, offset) in [0.0, 1e-6, 0.5].into_iter().flat_map(|r| nearby.map(|offset| (r, offset))) {
        let hard_spot = light(LightKind::Spot {
            position: center,
            target: Vec3::ZERO,
            intensity: Vec3::ONE,
            inner_angle: 0.0,
            outer_angle: 90.0,
            radius,
        });
        for light in [omni(radius), hard_spot] {
            for i in 0..20 {
                if let Some(sample) = sample(&light, center + offset, sobol_2d(i, 0, 4)) {
                    assert!(sample.irradiance.is_finite() && sample.direction.is_normalized(), "{sample:?}");
                    assert!(sample.distance.is_finite());
                    let ray = shadow_ray(center + offset, Vec3::Y, &sample);
                    assert!(ray.direction.is_finite() && ray.origin.is_finite());
                }
            }
        }
    }
    // no cliff at the sphere's surface
    let at = |r: f32| irradiance(&omni(0.5), center - Vec3::Y * r, Vec3::Y);
    assert!(at(0.501).abs_diff_eq(at(0.499), 0.1 * at(0.499).max_element()));
}

#[test]
fn spot_follows_the_formula() {
    let light = spot(20.0, 40.0);
    let expected = |angle: f32| {
        let cos = |degrees: f32| degrees.to_radians().cos();
        ((cos(angle) - cos(40.0)) / (cos(20.0) - cos(40.0))).clamp(0.0, 1.0).powi(2)
    };
    for angle in [0.0, 10.0, 19.9, 25.0, 30.0, 39.0, 41.0, 120.0] {
        let factor = spot_factor(&light, angle);
        assert!((factor - expected(angle)).abs() < 1e-4, "{factor} at {angle}");
    }
    assert!((spot_factor(&light, 30.0) - expected(31.0)).abs() > 1e-2, "a degree must be noticed");
}

#[test]
fn spot_without_rim_is_a_hard_edge() {
    for angle in [0.5, 30.0, 90.0] {
        let light = spot(angle, angle);
        assert!((spot_factor(&light, angle * 0.99) - 1.0).abs() < 1e-5);
        assert_eq!(spot_factor(&light, angle * 1.01), 0.0);
        assert!(spot_factor(&light, angle).is_finite());
    }
    assert!(spot_factor(&spot(0.0, 0.0), 0.0).is_finite());
}

#[test]
fn distant_disc_keeps_the_irradiance() {
    let direction = Vec3::new(0.0, -3.0, 4.0);
    let normal = -direction.normalize();
    for angle in [0.0, 0.5, 20.0, 180.0] {
        let color = Vec3::new(3.0, 2.0, 1.0);
        let light = light(LightKind::Distant { direction, irradiance: color, angle });
        let measured = irradiance(&light, Vec3::splat(7.0), normal);
        assert!(close(measured, color, 1e-3), "{measured} with {angle} degrees");
        assert!(!close(irradiance(&light, Vec3::ZERO, Vec3::Y), color, 1e-3), "the cosine must be noticed");
        let half = (0.5 * angle).to_radians();
        for i in 0..100 {
            let sample = sample(&light, Vec3::ZERO, sobol_2d(i, 0, 5)).unwrap();
            assert!(sample.distance.is_infinite());
            assert!(sample.direction.angle_between(normal) <= half + 1e-3);
        }
        assert_eq!(needs_samples(&light), angle > 0.0);
    }
}

/// What has all of a light above its horizon receives exactly what the light's centre stands for.
#[test]
fn the_centre_stands_for_the_whole_light() {
    let normal = Vec3::new(0.3, 0.9, -0.2).normalize();
    let sun = |angle| {
        light(LightKind::Distant { direction: Vec3::new(0.3, -1.0, 0.2), irradiance: Vec3::ONE, angle })
    };
    for light in [omni(0.0), omni(0.5), omni(1.5), sun(0.0), sun(30.0), spot(20.0, 40.0)] {
        let position = Vec3::new(0.1, -0.4, 0.2);
        let normal = if matches!(light.kind, LightKind::Spot { .. }) { Vec3::Y } else { normal };
        let center = PreparedLight::new(&light).center(position).unwrap();
        let expected = center.irradiance * normal.dot(center.direction);
        let measured = irradiance(&light, position, normal);
        assert!(close(measured, expected, 1e-3), "{light:?}: {measured} is not {expected}");
    }
    // half below the horizon it does not
    let center = PreparedLight::new(&omni(1.5)).center(Vec3::ZERO).unwrap();
    let flat = irradiance(&omni(1.5), Vec3::ZERO, Vec3::X);
    assert!(flat.x > 0.04 && (center.irradiance * Vec3::X.dot(center.direction)).x < 1e-6);
    assert!(PreparedLight::new(&spot(10.0, 20.0)).center(Vec3::X).is_none());
}

/// Lights of all kinds around the origin, some with extent, also of the widest angles.
fn any_light(seed: u32) -> Light {
    let random = |dimension: u32| unit(hash(dimension, seed));
    let place =
        |dimension| Vec3::from_array(std::array::from_fn(|axis| 4.0 * random(dimension + axis as u32) - 2.0));
    let radius = if random(0) < 0.5 { 0.0 } else { 1.5 * random(1) };
    let wide = if random(9) < 0.1 { 1.0 } else { random(2).powi(2) };
    let intensity = Vec3::ONE;
    let outer_angle = 90.0 * wide;
    let inner_angle = outer_angle * random(3);
    light(match seed % 3 {
        0 => LightKind::Omni { position: place(4), intensity, radius },
        1 => LightKind::Spot {
            position: place(4),
            target: place(7),
            intensity,
            inner_angle,
            outer_angle,
            radius,
        },
        _ => LightKind::Distant { direction: place(4), irradiance: intensity, angle: 180.0 * wide },
    })
}

/// Whether some of a light is above the horizon of a point, and within its cone.
fn is_above(light: &LightKind, position: Vec3, normal: Vec3) -> bool {
    let (position, normal) = (position.as_dvec3(), normal.as_dvec3());
    let above = |center: Vec3, radius: f32| {
        let to_center = center.as_dvec3() - position;
        normal.dot(to_center) > -f64::from(radius) || to_center.length() < f64::from(radius)
    };
    match *light {
        LightKind::Omni { position: center, radius, .. } => above(center, radius),
        LightKind::Spot { position: center, target, outer_angle, radius, .. } => {
            let (away, axis) = (position - center.as_dvec3(), (target - center).as_dvec3());
            above(center, radius) && away.angle_between(axis) < f64::from(outer_angle).to_radians()
        }
        LightKind::Distant { direction, angle, .. } => {
            normal.dot(-direction.as_dvec3().normalize()) > -(0.5 * f64::from(angle)).to_radians().sin()
        }
        LightKind::Dome { .. } => true,
    }
}

#[test]
fn what_a_light_is_said_not_to_reach_it_does_not() {
    let (mut missed, mut left) = (0, 0);
    for seed in 0..20_000 {
        let random = |dimension: u32| unit(hash(dimension, seed ^ 0x9e37));
        let vector = |dimension: u32| {
            Vec3::from_array(std::array::from_fn(|axis| 2.0 * random(dimension + axis as u32) - 1.0))
        };
        // points alone, walls, walls that are nearly even, corners, and what faces everywhere
        let bend = [0.0, 0.0, 3e-4, 0.5 * random(7), 4.0][seed as usize % 5];
        let (count, size) = if seed % 7 == 0 { (1, 0.0) } else { (20, random(0).powi(3)) };
        let (middle, normal) = (2.0 * vector(1), vector(4).normalize());
        let points: Vec<(Vec3, Vec3)> = (0..count)
            .map(|i| (middle + size * vector(10 + 6 * i), (normal + bend * vector(13 + 6 * i)).normalize()))
            .collect();
        let light = any_light(seed);
        let lit = points.iter().any(|&(position, normal)| is_above(&light.kind, position, normal));
        if PreparedLight::new(&light).may_reach(&PointGroup::new(points.iter().copied())) {
            left += u32::from(!lit);
        } else {
            missed += 1;
            assert!(!lit, "light {seed}: {light:?} {points:?}");
        }
    }
    // most of what no light reaches is left out, or there is no use in asking
    assert!(missed > 2 * left, "{missed} left out, {left} not");
    assert!(!PreparedLight::new(&any_light(0)).may_reach(&PointGroup::new([].into_iter())));
}

/// Light that grazes a wall whose normals differ by less than a cosine can tell.
#[test]
fn a_wall_that_is_nearly_even_is_not_taken_for_even() {
    for tilt in [1e-5, 1e-4, 2.4e-4, 1e-3] {
        let normals = [Vec3::new(tilt, 0.0, 1.0).normalize(), Vec3::new(-tilt, 0.0, 1.0).normalize()];
        let group = PointGroup::new(normals.into_iter().map(|normal| (Vec3::ZERO, normal)));
        for share in [0.5, 0.9, 0.999] {
            // towards the light: below the horizon of one, above that of the other
            let towards = Vec3::new(1.0, 0.0, -share * tilt).normalize();
            assert!(normals[0].dot(towards) > 0.0 && normals[1].dot(towards) < 0.0);
            let kind = LightKind::Distant { direction: -towards, irradiance: Vec3::ONE, angle: 0.0 };
            assert!(PreparedLight::new(&light(kind)).may_reach(&group), "{tilt} {share}");
        }
    }
}
