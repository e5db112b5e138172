//! Walls with arched openings or niches, the mouldings round them, and groin vaults.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Vec2, Vec3};
use libm::{cosf, sinf};

use super::mesh::{Mesh, TILE, Vertex, box_uv};

/// Straight pieces of half a round arch.
const HALF_ARCH: usize = 10;

/// Where a wall stands: a point of its face at height 0, the way along it, and the way out of its face.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    /// Metres.
    pub(crate) origin: Vec3,
    /// Unit, horizontal.
    pub(crate) along: Vec3,
    /// Unit, horizontal.
    pub(crate) out: Vec3,
}

impl Frame {
    /// The point `s` metres along, `y` metres up and `depth` metres behind the face.
    pub(crate) fn at(&self, s: f32, y: f32, depth: f32) -> Vec3 {
        self.origin + self.along * s + Vec3::Y * y - self.out * depth
    }

    fn direction(&self, along: f32, up: f32) -> Vec3 {
        self.along * along + Vec3::Y * up
    }
}

/// A round arch over straight jambs.
#[derive(Clone, Copy)]
pub(crate) struct Opening {
    /// Metres along the wall.
    pub(crate) center: f32,
    /// Metres.
    pub(crate) radius: f32,
    /// Height at which the arch begins.
    pub(crate) spring: f32,
    /// Height at which the opening begins; the wall goes on below it.
    pub(crate) sill: f32,
}

impl Opening {
    /// Points of the arch, from the smaller to the larger `s`.
    fn arch(&self) -> impl Iterator<Item = (f32, f32)> {
        (0..=2 * HALF_ARCH).map(|step| {
            let angle = PI - step as f32 / (2 * HALF_ARCH) as f32 * PI;
            (self.center + self.radius * cosf(angle), self.spring + self.radius * sinf(angle))
        })
    }
}

/// What stands behind the face.
pub(crate) enum Back<'a> {
    /// The openings go through; the wall has another face up to the height given.
    Through(&'a dyn Fn(f32) -> f32),
    /// The openings are niches with a back of their own.
    Niche,
}

/// A wall between `start` and `end` metres along its frame.
pub(crate) struct ArchedWall<'a> {
    /// Where it stands.
    pub(crate) frame: Frame,
    /// Metres along the frame.
    pub(crate) start: f32,
    /// Metres along the frame.
    pub(crate) end: f32,
    /// Where the wall begins between the openings: on the ground, or on the columns' capitals.
    pub(crate) bottom: f32,
    /// Height of the face.
    pub(crate) top: f32,
    /// Of the wall, or of the niches, metres.
    pub(crate) thickness: f32,
    /// From smaller to larger `s`, apart from each other.
    pub(crate) openings: &'a [Opening],
    /// What stands behind the face.
    pub(crate) back: Back<'a>,
}

impl ArchedWall<'_> {
    /// Both faces and the reveals of the openings.
    pub(crate) fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        self.add_face(&mut mesh, 0.0, &|_| self.top);
        if let Back::Through(top) = self.back {
            self.add_face(&mut mesh, self.thickness, top);
        }
        for opening in self.openings {
            self.add_reveal(&mut mesh, opening);
        }
        mesh
    }

    fn add_face(&self, mesh: &mut Mesh, depth: f32, top: &dyn Fn(f32) -> f32) {
        const PIER_STRIPS: usize = 4;
        let mut from = self.start;
        for opening in self.openings {
            let to = opening.center - opening.radius;
            let pier = (0..=PIER_STRIPS)
                .map(|step| (from + (to - from) * step as f32 / PIER_STRIPS as f32, self.bottom));
            self.add_strip(mesh, depth, &pier.collect::<Vec<_>>(), top);
            self.add_strip(mesh, depth, &opening.arch().collect::<Vec<_>>(), top);
            let sill = opening.sill.min(self.top);
            let ends = [(to, self.bottom), (opening.center + opening.radius, self.bottom)];
            self.add_strip(mesh, depth, &ends, &|_| sill);
            from = opening.center + opening.radius;
        }
        let pier = (0..=PIER_STRIPS)
            .map(|step| (from + (self.end - from) * step as f32 / PIER_STRIPS as f32, self.bottom));
        self.add_strip(mesh, depth, &pier.collect::<Vec<_>>(), top);
    }

    /// A strip of wall from the points of `below` up to `top`.
    fn add_strip(&self, mesh: &mut Mesh, depth: f32, below: &[(f32, f32)], top: &dyn Fn(f32) -> f32) {
        let normal = if depth > 0.0 { -self.frame.out } else { self.frame.out };
        if below.iter().all(|&(s, y)| top(s) <= y) {
            return;
        }
        mesh.sheet(below.len() - 1, 1, |column, row| {
            let (s, y) = below[column];
            let position = self.frame.at(s, if row == 0 { y } else { top(s) }, depth);
            Vertex { position, normal, uv: box_uv(position, normal) }
        });
    }

    fn add_reveal(&self, mesh: &mut Mesh, opening: &Opening) {
        let Frame { along, out, .. } = self.frame;
        let points: Vec<(f32, f32)> = opening.arch().collect();
        mesh.sheet(points.len() - 1, 1, |column, row| {
            let (s, y) = points[column];
            let inwards = self.frame.direction(opening.center - s, opening.spring - y) / opening.radius;
            let length = column as f32 / (points.len() - 1) as f32 * PI * opening.radius;
            let depth = row as f32 * self.thickness;
            Vertex {
                position: self.frame.at(s, y, depth),
                normal: inwards,
                uv: Vec2::new(depth, length) / TILE,
            }
        });
        let foot = opening.sill.max(self.bottom);
        let corners = |s: f32| {
            [(foot, 0.0), (foot, self.thickness), (opening.spring, self.thickness), (opening.spring, 0.0)]
                .map(|(y, depth)| self.frame.at(s, y, depth))
        };
        mesh.quad(corners(opening.center - opening.radius), along);
        mesh.quad(corners(opening.center + opening.radius), -along);
        let ends = [opening.center - opening.radius, opening.center + opening.radius];
        if opening.sill > self.bottom {
            let [a, b] = ends;
            let sill = [(a, 0.0), (b, 0.0), (b, self.thickness), (a, self.thickness)];
            mesh.quad(sill.map(|(s, depth)| self.frame.at(s, foot, depth)), Vec3::Y);
        }
        if matches!(self.back, Back::Niche) {
            mesh.sheet(points.len() - 1, 1, |column, row| {
                let (s, y) = points[column];
                let position = self.frame.at(s, if row == 0 { foot } else { y }, self.thickness);
                Vertex { position, normal: out, uv: box_uv(position, out) }
            });
        }
    }
}

/// A raised band round an arch: its inner edge goes on from the arch, `width` wide and `relief` high.
pub(crate) fn archivolt(frame: &Frame, opening: &Opening, width: f32, relief: f32) -> Mesh {
    // (distance from the arch, height over the wall, normal along the radius, normal out of the wall)
    let step = 0.62 * width;
    let low = 0.6 * relief;
    let bands = [
        [(0.0, 0.0, -1.0, 0.0), (0.0, low, -1.0, 0.0)],
        [(0.0, low, 0.0, 1.0), (step, low, 0.0, 1.0)],
        [(step, low, -1.0, 0.0), (step, relief, -1.0, 0.0)],
        [(step, relief, 0.0, 1.0), (width, relief, 0.0, 1.0)],
        [(width, relief, 1.0, 0.0), (width, 0.0, 1.0, 0.0)],
    ];
    let mut mesh = Mesh::default();
    for band in bands {
        mesh.sheet(2 * HALF_ARCH, 1, |column, row| {
            let angle = PI - column as f32 / (2 * HALF_ARCH) as f32 * PI;
            let radial = frame.direction(cosf(angle), sinf(angle));
            let (distance, height, across, outwards) = band[row];
            let radius = opening.radius + distance;
            Vertex {
                position: frame.at(opening.center, opening.spring, -height) + radial * radius,
                normal: radial * across + frame.out * outwards,
                uv: Vec2::new(angle * radius, distance + height) / TILE,
            }
        });
    }
    mesh
}

/// The underside of a groin vault over the rectangle `center +- half` (x and z): two elliptic barrels that
/// cross, `rise` metres high over `spring`.
pub(crate) fn groin_vault(center: Vec2, half: Vec2, spring: f32, rise: f32) -> Mesh {
    const RINGS: usize = 5;
    let mut mesh = Mesh::default();
    for (barrel, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)] {
        // The quarter of the vault beyond the diagonals: `s` runs across its barrel, `t` along it.
        mesh.sheet(2 * HALF_ARCH, RINGS, |column, row| {
            let t = sinf(FRAC_PI_2 * row as f32 / RINGS as f32);
            let s = t * sinf((column as f32 / HALF_ARCH as f32 - 1.0) * FRAC_PI_2);
            let (unit_x, unit_z) = if barrel == 0 { (s, side * t) } else { (side * t, s) };
            let height = (1.0 - s * s).max(0.0).sqrt();
            let width = if barrel == 0 { half.x } else { half.y };
            // Downwards out of the ellipse (s / width, height / rise).
            let slope = Vec2::new(-s / width, -height / rise).normalize();
            let normal =
                if barrel == 0 { Vec3::new(slope.x, slope.y, 0.0) } else { Vec3::new(0.0, slope.y, slope.x) };
            let position =
                Vec3::new(center.x + unit_x * half.x, spring + rise * height, center.y + unit_z * half.y);
            Vertex { position, normal, uv: Vec2::new(position.x, position.z) / TILE }
        });
    }
    mesh
}

/// Height of the edge of such a vault `offset` metres from the middle of a side that is `2 * half` long.
pub(crate) fn vault_edge(offset: f32, half: f32, spring: f32, rise: f32) -> f32 {
    let u = (offset / half).clamp(-1.0, 1.0);
    spring + rise * (1.0 - u * u).max(0.0).sqrt()
}
