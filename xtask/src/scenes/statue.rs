//! The statue: a winged figure in a long robe, as a smooth union of simple solids.

use glam::{UVec3, Vec3};
use libm::{atan2f, sinf};

use super::mesh::Mesh;
use super::noise::smoothstep;
use super::surface_nets::Grid;

/// Distance to a ball of radius `r0` at `a` swept to `b` and radius `r1`. Exact enough for slow tapers.
fn limb(p: Vec3, a: Vec3, b: Vec3, r0: f32, r1: f32) -> f32 {
    let axis = b - a;
    let t = ((p - a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    p.distance(a + axis * t) - (r0 + (r1 - r0) * t)
}

fn ellipsoid(p: Vec3, center: Vec3, radii: Vec3) -> f32 {
    let q = (p - center) / radii;
    let (k0, k1) = (q.length(), (q / radii).length());
    if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -radii.min_element() }
}

/// The smaller of two distances, rounded over `k` metres where they meet (Quilez' quadratic polynomial).
fn smooth_union(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}

/// The long robe: wide at the ground, drawn in below the breast, blown back, with folds that run down it.
fn robe(p: Vec3) -> f32 {
    let skirt = limb(p, Vec3::new(-0.03, 0.10, 0.0), Vec3::new(0.0, 0.98, 0.0), 0.30, 0.150);
    let train = limb(p, Vec3::new(-0.30, 0.06, 0.05), Vec3::new(-0.06, 0.80, 0.0), 0.16, 0.11);
    let knee = limb(p, Vec3::new(0.20, 0.10, 0.10), Vec3::new(0.05, 0.85, 0.08), 0.13, 0.12);
    let cloth = smooth_union(smooth_union(skirt, train, 0.18), knee, 0.14);
    let around = atan2f(p.z, p.x + 0.02);
    let down = 1.0 - smoothstep(0.35, 1.02, p.y);
    let folds =
        sinf(13.0 * around + 2.2 * p.y + 0.9 * sinf(3.0 * p.y)) + 0.5 * sinf(7.0 * around - 3.1 * p.y + 1.0);
    let girdle = sinf(around * 26.0 + 9.0 * p.y) * smoothstep(0.85, 1.0, p.y) * smoothstep(1.3, 1.1, p.y);
    // The steep folds make the distance too large; the factor keeps it below the true one.
    0.8 * (cloth - 0.021 * folds * down - 0.004 * girdle)
}

fn torso(p: Vec3) -> f32 {
    let waist = limb(p, Vec3::new(0.0, 0.95, 0.0), Vec3::new(0.02, 1.26, 0.0), 0.150, 0.165);
    let shoulders = limb(p, Vec3::new(0.01, 1.37, -0.17), Vec3::new(0.01, 1.37, 0.17), 0.078, 0.078);
    let breast = limb(p, Vec3::new(0.10, 1.26, -0.075), Vec3::new(0.10, 1.26, 0.075), 0.078, 0.078);
    let belt = limb(p, Vec3::new(0.01, 1.09, -0.02), Vec3::new(0.01, 1.09, 0.02), 0.162, 0.162);
    let body = smooth_union(smooth_union(waist, shoulders, 0.14), breast, 0.06);
    smooth_union(body, belt, 0.02)
}

fn head(p: Vec3) -> f32 {
    let neck = limb(p, Vec3::new(0.01, 1.38, 0.0), Vec3::new(0.05, 1.56, 0.0), 0.066, 0.054);
    let skull = ellipsoid(p, Vec3::new(0.05, 1.68, 0.0), Vec3::new(0.105, 0.125, 0.090));
    let face = ellipsoid(p, Vec3::new(0.095, 1.635, 0.0), Vec3::new(0.066, 0.100, 0.064));
    let nose = limb(p, Vec3::new(0.150, 1.680, 0.0), Vec3::new(0.176, 1.632, 0.0), 0.010, 0.015);
    let knot = ellipsoid(p, Vec3::new(-0.085, 1.72, 0.0), Vec3::new(0.055, 0.055, 0.06));
    let head = smooth_union(smooth_union(skull, face, 0.04), nose, 0.02);
    smooth_union(smooth_union(neck, head, 0.05), knot, 0.04)
}

fn arms(p: Vec3) -> f32 {
    let arm = |shoulder: Vec3, elbow: Vec3, hand: Vec3| {
        let upper = limb(p, shoulder, elbow, 0.066, 0.050);
        let lower = limb(p, elbow, hand, 0.050, 0.034);
        smooth_union(upper, lower, 0.03)
    };
    let raised = arm(Vec3::new(0.01, 1.37, 0.20), Vec3::new(0.17, 1.52, 0.38), Vec3::new(0.27, 1.84, 0.36));
    let orb = p.distance(Vec3::new(0.30, 1.94, 0.36)) - 0.075;
    let resting =
        arm(Vec3::new(0.01, 1.36, -0.20), Vec3::new(-0.02, 1.10, -0.36), Vec3::new(0.14, 0.99, -0.18));
    smooth_union(raised, orb, 0.03).min(resting)
}

/// One wing: feathers that fan out from the shoulder blade, the longest at the top.
fn wing(p: Vec3, side: f32) -> f32 {
    const FEATHERS: usize = 9;
    let root = Vec3::new(-0.13, 1.30, 0.09 * side);
    let wrist = Vec3::new(-0.34, 1.66, 0.36 * side);
    let mut wing = limb(p, root, wrist, 0.070, 0.055);
    for feather in 0..FEATHERS {
        let t = feather as f32 / (FEATHERS - 1) as f32;
        let tip =
            Vec3::new(-0.52 + 0.10 * t, 2.22 - 1.00 * t, (0.66 + 0.50 * t * (1.0 - t) - 0.26 * t * t) * side);
        let start = wrist.lerp(root, 0.85 * t);
        let blade = limb(p, start, tip, 0.050, 0.034);
        wing = smooth_union(wing, blade, 0.032);
    }
    wing
}

fn figure(p: Vec3) -> f32 {
    let body = smooth_union(robe(p), torso(p), 0.05);
    let body = smooth_union(body, head(p), 0.04);
    let body = smooth_union(body, arms(p), 0.04);
    let wings = wing(p, 1.0).min(wing(p, -1.0));
    let rock = ellipsoid(p, Vec3::new(-0.04, 0.03, 0.02), Vec3::new(0.52, 0.075, 0.44));
    let all = smooth_union(smooth_union(body, wings, 0.07), rock, 0.05);
    all.max(-p.y)
}

/// The statue with its foot at the origin, looking along +X, 2.25 m to the tips of the wings.
pub(crate) fn statue() -> Mesh {
    let grid = Grid { origin: Vec3::new(-0.75, -0.03, -0.94), cells: UVec3::new(55, 97, 79), cell: 0.0238 };
    grid.surface(figure)
}
