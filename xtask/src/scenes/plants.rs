//! Potted plants: a turned pot, soil, and arching leaves cut out by alpha.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};
use libm::{cosf, sinf};

use super::lathe::Profile;
use super::mesh::{Mesh, Vertex};
use super::noise::hash;

/// Height of the pot, metres.
const POT: f32 = 0.46;
/// Height of the soil in it, metres.
const SOIL: f32 = 0.40;

/// The pot, its foot at the origin.
pub(crate) fn pot() -> Mesh {
    Profile::default()
        .smooth([(0.17, 0.0), (0.185, 0.02), (0.20, 0.04)])
        .smooth([(0.20, 0.04), (0.235, 0.12), (0.255, 0.22), (0.258, 0.30), (0.250, 0.37)])
        .half_round(0.252, 0.37, 0.40, 0.6)
        .straight(&[(0.252, 0.40), (0.285, 0.42), (0.285, POT), (0.245, POT), (0.235, SOIL - 0.02)])
        .lathe(40)
}

/// The soil that fills it.
pub(crate) fn soil() -> Mesh {
    Profile::default().smooth([(0.238, SOIL), (0.12, SOIL + 0.012), (0.0, SOIL + 0.018)]).lathe(24)
}

/// Leaves in rings from the upright heart outwards.
pub(crate) fn leaves(seed: u32) -> Mesh {
    const LEAVES: i32 = 46;
    let mut mesh = Mesh::default();
    for leaf in 0..LEAVES {
        let random = |column: i32| hash(leaf, column, seed);
        let outwards = leaf as f32 / LEAVES as f32;
        // The golden angle keeps leaves from standing behind each other.
        let azimuth = TAU * (leaf as f32 * 0.618_034 + 0.05 * random(0));
        let rise = 1.45 - 0.80 * outwards + 0.15 * (random(1) - 0.5);
        let bend = 0.7 + 1.1 * outwards + 0.3 * random(2);
        let length = 0.74 - 0.20 * outwards + 0.12 * random(3);
        add_leaf(&mut mesh, azimuth, rise, bend, length);
    }
    mesh
}

/// A leaf `length` metres long that leaves the soil at `rise` radians and bends down by `bend` radians.
fn add_leaf(mesh: &mut Mesh, azimuth: f32, rise: f32, bend: f32, length: f32) {
    const SEGMENTS: usize = 7;
    let out = Vec3::new(cosf(azimuth), 0.0, sinf(azimuth));
    let across = Vec3::new(-out.z, 0.0, out.x);
    let step = length / SEGMENTS as f32;
    let mut spine = vec![(out * 0.035 + Vec3::Y * (SOIL - 0.02), rise)];
    for segment in 0..SEGMENTS {
        let (point, _) = spine[segment];
        let angle = rise - bend * (segment as f32 + 0.5) / SEGMENTS as f32;
        spine.push((point + (out * cosf(angle) + Vec3::Y * sinf(angle)) * step, angle));
    }
    const HALF_WIDTH: f32 = 0.065;
    mesh.sheet(2, SEGMENTS, |column, row| {
        let (point, angle) = spine[row];
        let up = Vec3::Y * cosf(angle) - out * sinf(angle);
        let side = column as f32 - 1.0;
        let normal = (up - across * 0.35 * side).normalize();
        Vertex {
            position: point + across * side * HALF_WIDTH + up * 0.35 * HALF_WIDTH * side.abs(),
            normal,
            uv: Vec2::new(0.5 * column as f32, 1.0 - row as f32 / SEGMENTS as f32),
        }
    });
}
