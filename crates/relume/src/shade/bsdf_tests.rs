//! The lobes against quadrature, and what no surface may do.

use std::f32::consts::PI;

use glam::{DVec3, Vec2, Vec3};

use super::{Bsdf, Surface};
use crate::shade::{energy, surface::MIN_ROUGHNESS};
use crate::trace::sampling::{cosine_hemisphere, sobol_2d, uniform_sphere};

fn surface(roughness: f32, metallic: f32, color: Vec3) -> Surface {
    Surface {
        diffuse_albedo: color * (1.0 - metallic),
        white_albedo: Vec3::splat(1.0 - metallic),
        specular_f0: Vec3::splat(0.04).lerp(color, metallic),
        specular_f90: 1.0,
        dielectric_specular: 1.0,
        dielectric_f0: 0.04,
        roughness,
        lit: true,
        ..Surface::BLACK
    }
}

fn view(cos: f32) -> Vec3 {
    Vec3::new((1.0 - cos * cos).sqrt(), cos, 0.0)
}

/// Integral of `f` over the upper hemisphere, by the midpoint rule with nodes crowded where a lobe of `alpha`
/// around the mirror direction of `view` has its peak.
fn integrate(view: Vec3, alpha: f64, f: impl Fn(Vec3) -> DVec3) -> DVec3 {
    const RINGS: usize = 600;
    const SECTORS: usize = 240;
    let mirror = Vec3::new(-view.x, view.y, -view.z);
    let (tangent, bitangent) = mirror.any_orthonormal_pair();
    let mut sum = DVec3::ZERO;
    // t in 0..1 -> angle = pi * (e^{k t} - 1) / (e^k - 1)
    let k = (40.0 / alpha).ln().max(1.0);
    for ring in 0..RINGS {
        let t = (ring as f64 + 0.5) / RINGS as f64;
        let angle = std::f64::consts::PI * (k * t).exp_m1() / k.exp_m1();
        let step = std::f64::consts::PI * k * (k * t).exp() / k.exp_m1() / RINGS as f64;
        for sector in 0..SECTORS {
            let turn = std::f64::consts::TAU * (sector as f64 + 0.5) / SECTORS as f64;
            let (sin, cos) = angle.sin_cos();
            let direction = mirror * cos as f32
                + tangent * (sin * turn.cos()) as f32
                + bitangent * (sin * turn.sin()) as f32;
            if direction.y > 0.0 {
                sum += f(direction) * (sin * step * std::f64::consts::TAU / SECTORS as f64);
            }
        }
    }
    sum
}

#[test]
fn white_furnace_and_table_equal_quadrature() {
    for roughness in [0.08, 0.2, 0.5, 1.0_f32] {
        for cos in [0.03, 0.3, 0.8, 1.0] {
            // a mirror that absorbs nothing, and a dielectric
            for (metallic, color) in [(1.0, Vec3::ONE), (0.0, Vec3::ONE)] {
                let surface = surface(roughness, metallic, color);
                let view = view(cos);
                let alpha = f64::from(roughness * roughness);
                let specular =
                    integrate(view, alpha, |light| (surface.specular(view, light) * light.y).as_dvec3());
                let expected = surface.specular_albedo(cos).as_dvec3();
                let error = (specular - expected).abs().max_element();
                assert!(error < 0.006, "roughness {roughness}, cos {cos}: {specular} is not {expected}");
                let all =
                    integrate(view, alpha, |light| Bsdf::new(&surface, view).evaluate(light).as_dvec3());
                assert!(all.max_element() < 1.006, "more than arrives: {all} at {roughness}, {cos}");
            }
        }
    }
    // the comparison notices a lobe of another roughness
    let (sharp, blunt) = (surface(0.2, 1.0, Vec3::ONE), surface(1.0, 1.0, Vec3::ONE));
    let integral =
        integrate(view(0.3), 0.04, |light| (sharp.specular(view(0.3), light) * light.y).as_dvec3());
    assert!((integral - blunt.specular_albedo(0.3).as_dvec3()).abs().max_element() > 0.02);
}

#[test]
fn table_lies_near_the_integral_between_its_nodes() {
    let points: Vec<Vec2> = (0..4096).map(|i| sobol_2d(i, 0, 99)).collect();
    let mut worst: f32 = 0.0;
    for i in 0..200 {
        let at = sobol_2d(i, 1, 7);
        let (cos, roughness) = (at.x.max(0.005), MIN_ROUGHNESS + at.y * (1.0 - MIN_ROUGHNESS));
        let integral = energy::integrate(cos, roughness, &points);
        worst = worst.max((energy::table().pair(cos, roughness) - integral).abs().max_element());
    }
    assert!(worst < 0.005, "{worst}");
}

#[test]
fn specular_is_reciprocal() {
    let surface = surface(0.3, 0.5, Vec3::new(0.9, 0.5, 0.1));
    for i in 0..200 {
        let a = cosine_hemisphere(Vec3::Y, sobol_2d(i, 0, 1));
        let b = cosine_hemisphere(Vec3::Y, sobol_2d(i, 1, 1));
        let (there, back) = (surface.specular(a, b), surface.specular(b, a));
        assert!(there.abs_diff_eq(back, 1e-4 * there.max_element()), "{there} {back}");
        let mut other = surface;
        other.roughness = 0.35;
        assert!(!there.abs_diff_eq(other.specular(b, a), 1e-4 * there.max_element()));
    }
}

#[test]
fn density_integrates_to_one_less_what_falls_below_the_horizon() {
    for (roughness, metallic) in [(0.15, 0.0), (0.4, 0.5), (0.9, 1.0_f32)] {
        let surface = surface(roughness, metallic, Vec3::splat(0.7));
        for cos in [0.2, 0.9] {
            let bsdf = Bsdf::new(&surface, view(cos));
            let alpha = f64::from(roughness * roughness);
            let above = integrate(view(cos), alpha, |light| DVec3::splat(f64::from(bsdf.density(light)))).x;
            const DRAWS: u32 = 1 << 14;
            let drawn = (0..DRAWS)
                .filter(|&i| bsdf.sample(sobol_2d(i, 1, 3).x, sobol_2d(i, 0, 3)).is_some())
                .count() as f64
                / f64::from(DRAWS);
            assert!((above - drawn).abs() < 0.01, "density {above}, draws {drawn}");
            assert!(above < 1.003);
        }
    }
}

/// The sampled mean of `weight * f(direction)` must be the integral of `evaluate * f`, for an `f` that tells
/// directions apart.
#[test]
fn sampled_estimates_equal_quadrature() {
    let radiance = |direction: Vec3| 1.0 + direction.x + 0.5 * direction.z * direction.z;
    for (roughness, metallic) in [(0.1, 0.3), (0.3, 0.0), (0.8, 1.0)] {
        let surface = surface(roughness, metallic, Vec3::new(0.8, 0.5, 0.2));
        let view = view(0.6);
        let bsdf = Bsdf::new(&surface, view);
        let alpha = f64::from(roughness * roughness);
        let expected = integrate(view, alpha, |light| (bsdf.evaluate(light) * radiance(light)).as_dvec3());
        const DRAWS: u32 = 1 << 15;
        let mut sum = DVec3::ZERO;
        for i in 0..DRAWS {
            if let Some(drawn) = bsdf.sample(sobol_2d(i, 1, 5).x, sobol_2d(i, 0, 5)) {
                sum += (drawn.weight * radiance(drawn.direction)).as_dvec3();
                assert!((drawn.direction.length() - 1.0).abs() < 1e-4);
            }
        }
        let mean = sum / f64::from(DRAWS);
        assert!(mean.abs_diff_eq(expected, 0.006), "{mean} is not {expected} at roughness {roughness}");
        assert!(!mean.abs_diff_eq(expected * 1.05, 0.006), "the comparison must notice five percent");
    }
}

#[test]
fn hemispherical_reflectance_is_the_mean_over_views() {
    for (roughness, metallic) in [(0.2, 0.0), (0.6, 0.5), (1.0, 1.0)] {
        let surface = surface(roughness, metallic, Vec3::new(0.9, 0.5, 0.1));
        const VIEWS: u32 = 1 << 10;
        let mean = (0..VIEWS)
            .map(|i| {
                let cos = cosine_hemisphere(Vec3::Y, sobol_2d(i, 0, 11)).y;
                (surface.diffuse(cos) + surface.specular_albedo(cos)).as_dvec3()
            })
            .sum::<DVec3>()
            / f64::from(VIEWS);
        let reflectance = surface.hemispherical_reflectance().as_dvec3();
        assert!(reflectance.abs_diff_eq(mean, 1e-3), "{reflectance} {mean}");
        assert!(!surface.diffuse_albedo.as_dvec3().abs_diff_eq(mean, 1e-3), "lobes must matter here");
        assert!(reflectance.max_element() <= 1.0);
    }
}

#[test]
fn without_specular_the_surface_is_lambertian() {
    let mut surface = surface(0.5, 0.0, Vec3::new(0.2, 0.4, 0.6));
    (surface.specular_f0, surface.specular_f90, surface.dielectric_specular) = (Vec3::ZERO, 0.0, 0.0);
    let bsdf = Bsdf::new(&surface, view(0.1));
    let light = view(0.7);
    assert!(bsdf.evaluate(light).abs_diff_eq(surface.diffuse_albedo / PI * 0.7, 1e-6));
    assert_eq!(surface.hemispherical_reflectance(), surface.diffuse_albedo);
}

#[test]
fn extreme_views_stay_finite() {
    for i in 0..4000 {
        let at = sobol_2d(i, 0, 21);
        let mut surface = surface(if i % 2 == 0 { MIN_ROUGHNESS } else { 1.0 }, at.x, Vec3::ONE);
        surface.geometric_normal = cosine_hemisphere(Vec3::Y, at);
        let view = if i % 3 == 0 { Vec3::X } else { uniform_sphere(sobol_2d(i, 2, 21)) };
        let bsdf = Bsdf::new(&surface, view);
        let light = if i % 5 == 0 { -view } else { uniform_sphere(sobol_2d(i, 3, 21)) };
        assert!(bsdf.evaluate(light).is_finite() && bsdf.density(light).is_finite());
        if let Some(drawn) = bsdf.sample(at.y, sobol_2d(i, 4, 21)) {
            assert!(drawn.weight.is_finite() && drawn.weight.min_element() >= 0.0, "{drawn:?}");
        }
    }
}
