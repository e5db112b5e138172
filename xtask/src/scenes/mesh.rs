//! Indexed triangle meshes and the few solids that need no profile.

use glam::{Vec2, Vec3};

/// Metres of surface that one repeat of a stone texture covers.
pub(crate) const TILE: f32 = 2.0;

/// One corner of a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Vertex {
    /// Metres.
    pub(crate) position: Vec3,
    /// Unit, out of the solid.
    pub(crate) normal: Vec3,
    /// glTF convention: (0, 0) is the top left of the image.
    pub(crate) uv: Vec2,
}

/// Triangles that share one material.
#[derive(Clone, Default)]
pub(crate) struct Mesh {
    /// Corners.
    pub(crate) vertices: Vec<Vertex>,
    /// Counter-clockwise seen from where the normals point.
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Adds a corner and returns its index.
    pub(crate) fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) -> u32 {
        self.vertices.push(Vertex { position, normal, uv });
        (self.vertices.len() - 1) as u32
    }

    /// Adds a triangle, wound so that its front agrees with its corners' normals. Slivers are left out.
    pub(crate) fn triangle(&mut self, a: u32, b: u32, c: u32) {
        let [va, vb, vc] = [a, b, c].map(|index| self.vertices[index as usize]);
        let area = (vb.position - va.position).cross(vc.position - va.position);
        if area.length_squared() < 1e-14 {
            return;
        }
        let front = area.dot(va.normal + vb.normal + vc.normal) >= 0.0;
        self.triangles.push(if front { [a, b, c] } else { [a, c, b] });
    }

    /// Adds `a b c d` round a quadrilateral.
    pub(crate) fn quad_of(&mut self, a: u32, b: u32, c: u32, d: u32) {
        self.triangle(a, b, c);
        self.triangle(a, c, d);
    }

    /// Adds a sheet of `columns * rows` quadrilaterals through `corner(column, row)`.
    pub(crate) fn sheet(&mut self, columns: usize, rows: usize, corner: impl Fn(usize, usize) -> Vertex) {
        let base = self.vertices.len() as u32;
        let stride = columns as u32 + 1;
        for row in 0..=rows {
            self.vertices.extend((0..=columns).map(|column| corner(column, row)));
        }
        for row in 0..rows as u32 {
            for column in 0..columns as u32 {
                let a = base + row * stride + column;
                self.quad_of(a, a + 1, a + 1 + stride, a + stride);
            }
        }
    }

    /// Adds a flat quadrilateral `a b c d`, textured in metres, that faces `normal`.
    pub(crate) fn quad(&mut self, corners: [Vec3; 4], normal: Vec3) {
        let [a, b, c, d] = corners.map(|p| self.vertex(p, normal, box_uv(p, normal)));
        self.quad_of(a, b, c, d);
    }

    /// Adds a box from `lo` to `hi` whose edges are cut by `chamfer` metres. What stands on the ground has
    /// no bottom.
    pub(crate) fn chamfered_box(&mut self, lo: Vec3, hi: Vec3, chamfer: f32, bottom: bool) {
        let (center, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
        let signs = [-1.0, 1.0];
        // The corner of the face across `axis`, in the octant of `octant`.
        let at = |axis: usize, octant: Vec3| {
            let mut offset = half - Vec3::splat(chamfer);
            offset[axis] = half[axis];
            center + octant * offset
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for sign in signs {
                if axis == 1 && sign < 0.0 && !bottom {
                    continue;
                }
                let octant = |a: f32, b: f32| unit(axis) * sign + unit(u) * a + unit(v) * b;
                let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
                self.quad(corners.map(|(a, b)| at(axis, octant(a, b))), unit(axis) * sign);
            }
            for a in signs {
                for b in signs {
                    let octant = |along: f32| unit(axis) * along + unit(u) * a + unit(v) * b;
                    let corners =
                        [at(u, octant(-1.0)), at(u, octant(1.0)), at(v, octant(1.0)), at(v, octant(-1.0))];
                    self.quad(corners, (unit(u) * a + unit(v) * b).normalize());
                }
            }
        }
        for x in signs {
            for y in signs {
                for z in signs {
                    let octant = Vec3::new(x, y, z);
                    let normal = octant.normalize();
                    let [a, b, c] = [0, 1, 2].map(|axis| {
                        let p = at(axis, octant);
                        self.vertex(p, normal, box_uv(p, normal))
                    });
                    self.triangle(a, b, c);
                }
            }
        }
    }

    /// Adds everything of `other`.
    pub(crate) fn append(&mut self, other: &Self) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|index| index + base)));
    }
}

fn unit(axis: usize) -> Vec3 {
    Vec3::AXES[axis]
}

/// Texture coordinates of a stone texture projected along the main axis of `normal`, upright and unmirrored.
pub(crate) fn box_uv(p: Vec3, normal: Vec3) -> Vec2 {
    let n = normal.abs();
    let metres = if n.y >= n.x && n.y >= n.z {
        Vec2::new(p.x, p.z * normal.y.signum())
    } else if n.x >= n.z {
        Vec2::new(-p.z * normal.x.signum(), -p.y)
    } else {
        Vec2::new(p.x * normal.z.signum(), -p.y)
    };
    metres / TILE
}
