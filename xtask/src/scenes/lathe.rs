//! Surfaces of revolution and straight mouldings, both drawn from a profile.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};
use libm::{cosf, sinf};

use super::mesh::{Mesh, TILE, Vertex, box_uv};

/// A profile of smooth pieces with creases between them. Points are (radius or depth, height) in metres, and
/// the solid lies to the left of the way they are walked: up the outside, down an inside.
#[derive(Default)]
pub(crate) struct Profile {
    pieces: Vec<Vec<Vec2>>,
}

impl Profile {
    /// Adds a straight piece through the points given.
    pub(crate) fn straight(mut self, points: &[(f32, f32)]) -> Self {
        self.pieces.extend(points.windows(2).map(|pair| vec![Vec2::from(pair[0]), Vec2::from(pair[1])]));
        self
    }

    /// Adds one smooth piece through the points given.
    pub(crate) fn smooth(mut self, points: impl IntoIterator<Item = (f32, f32)>) -> Self {
        self.pieces.push(points.into_iter().map(Vec2::from).collect());
        self
    }

    /// Adds a half round (torus) that stands out by half its height, or with `out` -1 a hollow (scotia).
    pub(crate) fn half_round(self, radius: f32, y0: f32, y1: f32, out: f32) -> Self {
        const STEPS: usize = 6;
        let r = 0.5 * (y1 - y0);
        self.smooth((0..=STEPS).map(move |step| {
            let angle = step as f32 / STEPS as f32 * PI - FRAC_PI_2;
            (radius + out * r * cosf(angle), y0 + r + r * sinf(angle))
        }))
    }

    /// Adds a quarter round (echinus) that opens upwards from `radius` by `width`.
    pub(crate) fn quarter_round(self, radius: f32, y0: f32, y1: f32, width: f32) -> Self {
        const STEPS: usize = 5;
        self.smooth((0..=STEPS).map(move |step| {
            let angle = step as f32 / STEPS as f32 * FRAC_PI_2;
            (radius + width * sinf(angle), y1 - (y1 - y0) * cosf(angle))
        }))
    }

    /// For each piece its points with the unit normal to the right of the way.
    fn with_normals(&self) -> impl Iterator<Item = Vec<(Vec2, Vec2)>> {
        self.pieces.iter().map(|points| {
            let last = points.len() - 1;
            (0..points.len())
                .map(|i| {
                    let way = points[(i + 1).min(last)] - points[i.saturating_sub(1)];
                    (points[i], Vec2::new(way.y, -way.x).normalize_or_zero())
                })
                .collect()
        })
    }

    /// Turns the profile about the Y axis.
    pub(crate) fn lathe(&self, segments: usize) -> Mesh {
        let mut mesh = Mesh::default();
        let mut length = 0.0;
        for piece in self.with_normals() {
            let mut lengths = vec![length];
            for pair in piece.windows(2) {
                length += pair[0].0.distance(pair[1].0);
                lengths.push(length);
            }
            let widest = piece.iter().map(|(point, _)| point.x).fold(0.0, f32::max);
            mesh.sheet(segments, piece.len() - 1, |column, row| {
                let turn = column as f32 / segments as f32;
                let (sin, cos) = (sinf(turn * TAU), cosf(turn * TAU));
                let (point, normal) = piece[row];
                Vertex {
                    position: Vec3::new(point.x * cos, point.y, -point.x * sin),
                    normal: Vec3::new(normal.x * cos, normal.y, -normal.x * sin),
                    uv: Vec2::new(turn * TAU * widest, -lengths[row]) / TILE,
                }
            });
        }
        mesh
    }

    /// Draws the profile from `start` to `end`, both on the wall's face; depth stands out along `out`.
    pub(crate) fn moulding(&self, start: Vec3, end: Vec3, out: Vec3) -> Mesh {
        let mut mesh = Mesh::default();
        for piece in self.with_normals() {
            mesh.sheet(1, piece.len() - 1, |column, row| {
                let (point, normal) = piece[row];
                let position = [start, end][column] + out * point.x + Vec3::Y * point.y;
                let normal = out * normal.x + Vec3::Y * normal.y;
                Vertex { position, normal, uv: box_uv(position, normal) }
            });
        }
        mesh
    }
}
