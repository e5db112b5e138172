//! Drapes: pleated cloth that hangs from a rod.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};
use libm::{cosf, sinf};

use super::mesh::{Mesh, Vertex};
use super::noise::smoothstep;

/// A drape in the XY plane, its rod along X through the origin. It is thin and seen from both sides.
pub(crate) struct Drape {
    /// Along the rod, metres.
    pub(crate) width: f32,
    /// Metres from the rod to the hem.
    pub(crate) drop: f32,
    /// Pleats across it.
    pub(crate) pleats: f32,
    /// Moves the pleats; radians.
    pub(crate) phase: f32,
    /// How far it is drawn to one side by a cord: -1 to the left, 0 not at all, 1 to the right.
    pub(crate) drawn: f32,
}

const COLUMNS: usize = 64;
const ROWS: usize = 30;
/// Rows at the hem that are of the trim's material.
const TRIM_ROWS: usize = 3;
/// Share of the drop at which the cord holds the cloth.
const CORD: f32 = 0.62;

impl Drape {
    fn position(&self, s: f32, t: f32) -> Vec3 {
        // Drawn cloth is narrow at the cord, and falls almost straight below it.
        let to_cord = smoothstep(0.0, CORD, t) * (1.0 - 0.35 * smoothstep(CORD, 1.0, t));
        let narrow = 1.0 - 0.62 * self.drawn.abs() * to_cord;
        let side = 0.5 * self.width * (1.0 - narrow) * self.drawn.signum();
        let sway = 0.02 * sinf(2.3 * t + 3.0 * s + self.phase);
        let x = (s - 0.5) * self.width * narrow + side + sway * t;
        let depth = (0.022 + 0.030 * t) * (1.0 + 0.5 * self.drawn.abs() * to_cord);
        let bend = 0.8 * sinf(1.7 * t + self.phase) + 0.5 * sinf(TAU * s * 1.3 + self.phase);
        let z = depth * sinf(TAU * self.pleats * s + bend) + 0.02 * t * sinf(TAU * s + 2.0 * self.phase);
        let sag = 0.02 * (1.0 - t) * sinf(TAU * self.pleats * s + 1.0).abs();
        Vec3::new(x, -self.drop * t - sag, z)
    }

    fn vertex(&self, column: usize, row: usize) -> Vertex {
        const STEP: f32 = 1e-3;
        let (s, t) = (column as f32 / COLUMNS as f32, row as f32 / ROWS as f32);
        let across = self.position(s + STEP, t) - self.position(s - STEP, t);
        let down = self.position(s, t + STEP) - self.position(s, t - STEP);
        // One figure of the cloth is 0.35 m wide; a pleated cloth is half as wide again as its rod.
        let metres = Vec2::new(1.5 * self.width * s, self.drop * t);
        Vertex {
            position: self.position(s, t),
            normal: down.cross(across).normalize_or(Vec3::Z),
            uv: metres / 0.35,
        }
    }

    /// The cloth and the trim along its hem.
    pub(crate) fn meshes(&self) -> [Mesh; 2] {
        let (mut cloth, mut trim) = (Mesh::default(), Mesh::default());
        cloth.sheet(COLUMNS, ROWS - TRIM_ROWS, |column, row| self.vertex(column, row));
        trim.sheet(COLUMNS, TRIM_ROWS, |column, row| self.vertex(column, row + ROWS - TRIM_ROWS));
        [cloth, trim]
    }
}

/// A round rod along X, its middle at the origin. Its ends are let into the columns and have no caps.
pub(crate) fn rod(length: f32, radius: f32) -> Mesh {
    const SEGMENTS: usize = 12;
    let mut mesh = Mesh::default();
    mesh.sheet(SEGMENTS, 1, |column, row| {
        let angle = TAU * column as f32 / SEGMENTS as f32;
        let normal = Vec3::new(0.0, cosf(angle), sinf(angle));
        let position = normal * radius + Vec3::X * length * (row as f32 - 0.5);
        Vertex { position, normal, uv: Vec2::new(position.x, angle * radius) }
    });
    mesh
}
