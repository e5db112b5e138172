//! Seeded low-discrepancy sequences and what is drawn from them.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

/// A point of an Owen-scrambled Sobol sequence in `[0, 1)^2`: index `index`, dimensions `2 * pair` and
/// `2 * pair + 1`, scrambled by `seed`. Beyond 128 pairs the seed is changed instead of the dimension, and beyond
/// 65,536 points likewise: the sequence is then a new, independently scrambled one.
pub fn sobol_2d(index: u32, pair: u32, seed: u32) -> Vec2 {
    const PAIRS: u32 = sobol_burley::NUM_DIMENSIONS / 2;
    const POINTS: u32 = 1 << 16;
    let seed = hash(seed, (pair / PAIRS) ^ (index / POINTS).wrapping_mul(0x9e37_79b9));
    let dimension = 2 * (pair % PAIRS);
    let index = index % POINTS;
    Vec2::new(sobol_burley::sample(index, dimension, seed), sobol_burley::sample(index, dimension + 1, seed))
}

/// Mixes two numbers into one that looks random (a PCG-style finaliser).
pub fn hash(a: u32, b: u32) -> u32 {
    let mut x = a.wrapping_mul(0x85eb_ca6b) ^ b.wrapping_add(0x9e37_79b9).wrapping_mul(0xc2b2_ae35);
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// A number in `[0, 1)` from a hash.
pub fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Two unit vectors that make an orthonormal, right-handed frame with the unit `normal`
/// (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
pub fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    normal.any_orthonormal_pair()
}

/// A unit direction around `normal` with density `cos / pi`.
pub fn cosine_hemisphere(normal: Vec3, sample: Vec2) -> Vec3 {
    let (tangent, bitangent) = tangents(normal);
    let (radius, angle) = (sample.x.sqrt(), TAU * sample.y);
    let height = (1.0 - sample.x).max(0.0).sqrt();
    (tangent * (radius * angle.cos()) + bitangent * (radius * angle.sin()) + normal * height).normalize()
}

/// A unit direction with the uniform density `1 / (4 pi)`.
pub fn uniform_sphere(sample: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * sample.x;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let angle = TAU * sample.y;
    Vec3::new(radius * angle.cos(), radius * angle.sin(), z)
}

/// A unit direction in the cone around `axis` whose half angle has the cosine `cos_max`, uniform in solid angle:
/// density `1 / (2 pi (1 - cos_max))`.
pub fn uniform_cone(axis: Vec3, cos_max: f32, sample: Vec2) -> Vec3 {
    let (tangent, bitangent) = tangents(axis);
    let cos = 1.0 - sample.x * (1.0 - cos_max);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let angle = TAU * sample.y;
    (tangent * (sin * angle.cos()) + bitangent * (sin * angle.sin()) + axis * cos).normalize()
}

/// Barycentric weights of the second and third corner, uniform over a triangle's area.
pub fn uniform_triangle(sample: Vec2) -> (f32, f32) {
    let root = sample.x.sqrt();
    (root * (1.0 - sample.y), root * sample.y)
}

/// Density of [`cosine_hemisphere`] at a direction whose cosine with the normal is `cos`.
pub fn cosine_hemisphere_density(cos: f32) -> f32 {
    cos.max(0.0) / PI
}
