//! Meshes the zero surface of a signed distance by naive surface nets (Gibson 1998, "Constrained elastic
//! surface nets"): one vertex a cell that the surface crosses, one quadrilateral an edge.
//!
//! Where the paper relaxes the vertices, here each is moved along the gradient onto the surface.

use glam::{UVec3, Vec2, Vec3};

use super::mesh::Mesh;

/// A box of cubic cells.
pub(crate) struct Grid {
    /// Its smallest corner, metres.
    pub(crate) origin: Vec3,
    /// Cells along each axis.
    pub(crate) cells: UVec3,
    /// Edge of a cell, metres.
    pub(crate) cell: f32,
}

impl Grid {
    fn corners(&self) -> UVec3 {
        self.cells + UVec3::ONE
    }

    fn index(&self, p: UVec3) -> usize {
        let n = self.corners();
        ((p.z * n.y + p.y) * n.x + p.x) as usize
    }

    fn position(&self, p: UVec3) -> Vec3 {
        self.origin + p.as_vec3() * self.cell
    }

    fn points(size: UVec3) -> impl Iterator<Item = UVec3> {
        (0..size.z)
            .flat_map(move |z| (0..size.y).flat_map(move |y| (0..size.x).map(move |x| UVec3::new(x, y, z))))
    }

    /// The surface where `distance` (negative inside) is zero. It must not touch the sides of the grid.
    pub(crate) fn surface(&self, distance: impl Fn(Vec3) -> f32) -> Mesh {
        let values: Vec<f32> = Self::points(self.corners()).map(|p| distance(self.position(p))).collect();
        let mut mesh = Mesh::default();
        let mut vertex_of_cell = vec![u32::MAX; values.len()];
        for cell in Self::points(self.cells) {
            let Some(start) = self.mean_crossing(cell, &values) else { continue };
            let (position, normal) = project(start, 0.25 * self.cell, &distance);
            vertex_of_cell[self.index(cell)] = mesh.vertex(position, normal, Vec2::ZERO);
        }
        for corner in Self::points(self.cells) {
            for axis in 0..3 {
                self.add_edge_quad(&mut mesh, corner, axis, &values, &vertex_of_cell);
            }
        }
        mesh
    }

    /// The mean of the points where the cell's twelve edges cross the surface.
    fn mean_crossing(&self, cell: UVec3, values: &[f32]) -> Option<Vec3> {
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for axis in 0..3 {
            let (step, u, v) = (unit(axis), unit((axis + 1) % 3), unit((axis + 2) % 3));
            for side in [UVec3::ZERO, u, v, u + v] {
                let (a, b) = (cell + side, cell + side + step);
                let (value_a, value_b) = (values[self.index(a)], values[self.index(b)]);
                if (value_a < 0.0) != (value_b < 0.0) {
                    sum += self.position(a).lerp(self.position(b), value_a / (value_a - value_b));
                    count += 1.0;
                }
            }
        }
        (count > 0.0).then(|| sum / count)
    }

    /// The quadrilateral round the edge from `corner` along `axis`, where the surface crosses that edge.
    fn add_edge_quad(&self, mesh: &mut Mesh, corner: UVec3, axis: usize, values: &[f32], vertices: &[u32]) {
        let (u, v) = (unit((axis + 1) % 3), unit((axis + 2) % 3));
        let inside = values[self.index(corner)] < 0.0;
        let ends_inside = values[self.index(corner + unit(axis))] < 0.0;
        if inside == ends_inside || corner.dot(u) == 0 || corner.dot(v) == 0 {
            return;
        }
        let mut cells = [corner - u - v, corner - v, corner, corner - u];
        if ends_inside {
            cells.reverse();
        }
        // Wound by the side the edge leaves to, not by the normals, which break at creases.
        let [a, b, c, d] = cells.map(|cell| vertices[self.index(cell)]);
        let splits = [[[a, b, c], [a, c, d]], [[b, c, d], [b, d, a]]];
        let agreement = splits.map(|[first, second]| agreement(mesh, first).min(agreement(mesh, second)));
        mesh.triangles.extend(splits[usize::from(agreement[1] > agreement[0])]);
    }
}

fn unit(axis: usize) -> UVec3 {
    UVec3::AXES[axis]
}

/// Moves `p` at most `reach` along the gradient onto the surface, and gives the unit normal there.
fn project(p: Vec3, reach: f32, distance: &impl Fn(Vec3) -> f32) -> (Vec3, Vec3) {
    const STEP: f32 = 2e-3;
    let gradient = |p: Vec3| {
        Vec3::AXES.iter().fold(Vec3::ZERO, |sum, &axis| {
            sum + axis * (distance(p + axis * STEP) - distance(p - axis * STEP)) / (2.0 * STEP)
        })
    };
    let slope = gradient(p);
    let moved = p - slope.normalize_or_zero() * (distance(p) / slope.length().max(0.5)).clamp(-reach, reach);
    (moved, gradient(moved).normalize_or(Vec3::Y))
}

/// Twice the area times the unit normal of a triangle's front.
fn area(mesh: &Mesh, triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|vertex| mesh.vertices[vertex as usize].position);
    (b - a).cross(c - a)
}

/// Cosine between a triangle's front and its vertices' normals.
fn agreement(mesh: &Mesh, triangle: [u32; 3]) -> f32 {
    let normals: Vec3 = triangle.iter().map(|&vertex| mesh.vertices[vertex as usize].normal).sum();
    area(mesh, triangle).normalize_or_zero().dot(normals.normalize_or_zero())
}
