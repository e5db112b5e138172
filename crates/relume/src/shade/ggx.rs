//! The GGX microfacet distribution with height-correlated Smith masking (Heitz 2014, "Understanding the
//! Masking-Shadowing Function in Microfacet-Based BRDFs"), isotropic.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

/// Density of microfacet normals per projected area, `D`, 1/sr. `sin2` is the squared sine between the half
/// vector and the normal: apart from the cosine because one minus a squared cosine loses all digits at the
/// peak of a smooth surface.
pub(super) fn distribution(cos_half: f32, sin2_half: f32, alpha: f32) -> f32 {
    let alpha2 = alpha * alpha;
    let slope = sin2_half / alpha2 + cos_half * cos_half;
    1.0 / (PI * alpha2 * slope * slope)
}

/// `sqrt(alpha^2 + (1 - alpha^2) cos^2)`: the root in every Smith term.
pub(super) fn smith_root(cos: f32, alpha: f32) -> f32 {
    let alpha2 = alpha * alpha;
    (alpha2 + (1.0 - alpha2) * cos * cos).sqrt()
}

/// Masking and shadowing with the microfacet denominator: `G2 / (4 cos_view cos_light)`.
pub(super) fn visibility(cos_view: f32, cos_light: f32, alpha: f32) -> f32 {
    0.5 / (cos_light * smith_root(cos_view, alpha) + cos_view * smith_root(cos_light, alpha))
}

/// Density per solid angle of the light's direction when the half vector is drawn by
/// [`sample_visible_normal`]: `G1(view) D / (4 cos_view)`.
pub(super) fn reflection_density(cos_view: f32, distribution: f32, alpha: f32) -> f32 {
    0.5 * distribution / (cos_view + smith_root(cos_view, alpha))
}

/// BRDF without Fresnel, times the light's cosine, over [`reflection_density`]: `G2 / G1`, at most 1.
pub(super) fn reflection_weight(cos_view: f32, cos_light: f32, alpha: f32) -> f32 {
    2.0 * cos_light * visibility(cos_view, cos_light, alpha) * (cos_view + smith_root(cos_view, alpha))
}

/// Schlick's weight of the grazing reflectance.
pub(super) fn schlick(cos: f32) -> f32 {
    let x = (1.0 - cos).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}

/// A microfacet normal among those that `view` sees (Heitz 2018, "Sampling the GGX Distribution of Visible
/// Normals"). Both in the frame whose z is the surface's normal; `view` is of unit length with `z > 0`.
pub(super) fn sample_visible_normal(view: Vec3, alpha: f32, sample: Vec2) -> Vec3 {
    let stretched = Vec3::new(alpha * view.x, alpha * view.y, view.z).normalize();
    let length2 = stretched.x * stretched.x + stretched.y * stretched.y;
    let tangent =
        if length2 > 1e-12 { Vec3::new(-stretched.y, stretched.x, 0.0) / length2.sqrt() } else { Vec3::X };
    let bitangent = stretched.cross(tangent);
    let radius = sample.x.sqrt();
    let angle = TAU * sample.y;
    let x = radius * angle.cos();
    let fold = 0.5 * (1.0 + stretched.z);
    let y = (1.0 - fold) * (1.0 - x * x).max(0.0).sqrt() + fold * radius * angle.sin();
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let normal = tangent * x + bitangent * y + stretched * z;
    Vec3::new(alpha * normal.x, alpha * normal.y, normal.z.max(1e-6)).normalize()
}
