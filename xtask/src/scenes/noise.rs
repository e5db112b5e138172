//! Seeded, tileable noise that gives the same bits everywhere.

use glam::Vec2;

/// A number in `0..1` for a lattice point.
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343) ^ (y as u32).wrapping_mul(0xd816_3841) ^ seed;
    for _ in 0..2 {
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    }
    (h >> 8) as f32 / (1 << 24) as f32
}

/// `0` below `lo`, `1` above `hi`, smooth between.
pub(crate) fn smoothstep(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in `0..1` over the lattice of `p`, repeating every `period` cells.
fn value(p: Vec2, period: i32, seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let f = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let (x, y) = (cell.x as i32, cell.y as i32);
    let at = |dx: i32, dy: i32| hash((x + dx).rem_euclid(period), (y + dy).rem_euclid(period), seed);
    let top = at(0, 0) + (at(1, 0) - at(0, 0)) * f.x;
    let bottom = at(0, 1) + (at(1, 1) - at(0, 1)) * f.x;
    top + (bottom - top) * f.y
}

/// Octaves of value noise in `-1..1` that tile over the unit square.
pub(crate) fn fractal(uv: Vec2, period: i32, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for octave in 0..octaves {
        let period = period << octave;
        sum += weight * (2.0 * value(uv * period as f32, period, seed + octave) - 1.0);
        total += weight;
        weight *= 0.5;
    }
    sum / total
}
