//! Tangents for normal maps by MikkTSpace, the space that glTF's normal maps are baked in.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use relume::glam::{Affine2, Vec3, Vec4};
use relume::scene::Mesh;

/// A mesh as MikkTSpace asks for it, and the tangents it gives, one a corner of each triangle.
struct Corners<'a> {
    mesh: &'a Mesh,
    texture_from_mesh: Affine2,
    tangents: Vec<[Vec4; 3]>,
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.mesh.triangles[face][corner] as usize].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.mesh.triangles[face][corner] as usize].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let uv = self.mesh.uvs[self.mesh.triangles[face][corner] as usize];
        let uv = self.texture_from_mesh.transform_point2(uv);
        // MikkTSpace has v upwards, as the green channel of a glTF normal map has; glTF's v points down.
        [uv.x, -uv.y]
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        let normal = self.mesh.normals[self.mesh.triangles[face][corner] as usize];
        let encoded = tangent.map_or(Vec4::ZERO, |t| Vec4::from_array(t.tangent_encoded()));
        self.tangents[face][corner] = sane_tangent(encoded, normal);
    }
}

/// `tangent` with a unit direction and a sign of exactly 1 or -1; any direction along the surface where it has none.
fn sane_tangent(tangent: Vec4, normal: Vec3) -> Vec4 {
    let sign = if tangent.w < 0.0 { -1.0 } else { 1.0 };
    tangent.truncate().try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector()).extend(sign)
}

/// Gives `mesh` tangents for a normal map read at `texture_from_mesh * uv`. Vertices whose triangles disagree about
/// the tangent (mirrored coordinates) are split.
///
/// The mesh has normals and coordinates, one a vertex.
pub(crate) fn add_tangents(mesh: &mut Mesh, texture_from_mesh: Affine2) {
    let mut corners =
        Corners { mesh, texture_from_mesh, tangents: vec![[Vec4::ZERO; 3]; mesh.triangles.len()] };
    match generate_tangents(&mut corners) {
        Ok(()) => {}
        // The type has no value today; were it to gain one, the corners keep what `set_tangent` gave them.
        Err(_) => return,
    }
    let tangents = corners.tangents;
    split_vertices(mesh, &tangents);
}

/// Writes one tangent a corner into one a vertex, repeating vertices that need several.
fn split_vertices(mesh: &mut Mesh, corner_tangents: &[[Vec4; 3]]) {
    let mut vertex_tangents: Vec<Option<Vec4>> = vec![None; mesh.positions.len()];
    let mut repeated: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    for (triangle, tangents) in mesh.triangles.iter_mut().zip(corner_tangents) {
        for (corner, &tangent) in triangle.iter_mut().zip(tangents) {
            let vertex = *corner as usize;
            match vertex_tangents[vertex] {
                None => vertex_tangents[vertex] = Some(tangent),
                Some(first) if first == tangent => {}
                Some(_) => {
                    let key = (*corner, tangent.to_array().map(f32::to_bits));
                    *corner = *repeated.entry(key).or_insert_with(|| {
                        vertex_tangents.push(Some(tangent));
                        mesh.positions.push(mesh.positions[vertex]);
                        mesh.normals.push(mesh.normals[vertex]);
                        mesh.uvs.push(mesh.uvs[vertex]);
                        vertex_tangents.len() as u32 - 1
                    });
                }
            }
        }
    }
    mesh.tangents = vertex_tangents
        .into_iter()
        .zip(&mesh.normals)
        .map(|(tangent, &normal)| tangent.unwrap_or_else(|| sane_tangent(Vec4::ZERO, normal)))
        .collect();
}

/// The file's own tangents, normalised; `None` where one has no direction, so that all are computed again.
pub(crate) fn checked_tangents(tangents: &[Vec4]) -> Option<Vec<Vec4>> {
    tangents
        .iter()
        .map(|t| {
            let direction = t.truncate().try_normalize()?;
            t.w.is_finite().then(|| direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 }))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::{Mat2, Vec2};

    /// Two triangles in the plane z = 0 that face +Z.
    fn quad(uvs: [[f32; 2]; 4]) -> Mesh {
        Mesh {
            positions: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                .map(|[x, y]| Vec3::new(x, y, 0.0))
                .to_vec(),
            normals: vec![Vec3::Z; 4],
            uvs: uvs.map(Vec2::from_array).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    /// Coordinates that show the image upright: u to the right, v down.
    const UPRIGHT: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

    #[test]
    fn upright_image_has_tangent_right_and_bitangent_up() {
        let mut mesh = quad(UPRIGHT);
        add_tangents(&mut mesh, Affine2::IDENTITY);
        assert_eq!(mesh.tangents.len(), 4);
        for t in &mesh.tangents {
            assert!((*t - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6, "{t}");
            let bitangent = Vec3::Z.cross(t.truncate()) * t.w;
            assert!((bitangent - Vec3::Y).length() < 1e-6, "green must point up in the image");
        }
        let mut mirrored = quad(UPRIGHT.map(|[u, v]| [1.0 - u, v]));
        add_tangents(&mut mirrored, Affine2::IDENTITY);
        assert!(mirrored.tangents.iter().all(|t| (*t - Vec4::new(-1.0, 0.0, 0.0, -1.0)).length() < 1e-6));
    }

    #[test]
    fn rotated_texture_turns_the_tangent() {
        // The image turned by a quarter: its u runs along the mesh's -v, which is +Y here.
        let turn = Affine2::from_mat2(Mat2::from_cols(Vec2::new(0.0, 1.0), Vec2::new(-1.0, 0.0)));
        let mut mesh = quad(UPRIGHT);
        add_tangents(&mut mesh, turn);
        assert!(
            mesh.tangents.iter().all(|t| (t.truncate() - Vec3::Y).length() < 1e-6),
            "{:?}",
            mesh.tangents
        );
    }

    #[test]
    fn vertices_on_a_mirror_seam_are_split() {
        // Two quads that share the edge x = 1, whose u runs to it from both sides.
        let mut mesh = quad(UPRIGHT);
        mesh.positions.extend([Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 0.0)]);
        mesh.normals.extend([Vec3::Z; 2]);
        mesh.uvs.extend([Vec2::new(0.0, 1.0), Vec2::new(0.0, 0.0)]);
        mesh.triangles.extend([[1, 4, 5], [1, 5, 2]]);
        add_tangents(&mut mesh, Affine2::IDENTITY);
        assert_eq!(mesh.positions.len(), 8);
        for (i, t) in mesh.triangles.iter().enumerate() {
            let expected = if i < 2 { Vec3::X } else { Vec3::NEG_X };
            for &v in t {
                assert!((mesh.tangents[v as usize].truncate() - expected).length() < 1e-6);
            }
        }
    }

    #[test]
    fn constant_coordinates_give_some_tangent_along_the_surface() {
        let mut mesh = quad([[0.5, 0.5]; 4]);
        add_tangents(&mut mesh, Affine2::IDENTITY);
        assert!(mesh.tangents.iter().all(|t| (t.truncate().length() - 1.0).abs() < 1e-5));
    }

    #[test]
    fn tangents_without_direction_are_refused() {
        assert_eq!(
            checked_tangents(&[Vec4::new(2.0, 0.0, 0.0, -0.5)]),
            Some(vec![Vec4::new(1.0, 0.0, 0.0, -1.0)])
        );
        assert_eq!(checked_tangents(&[Vec4::X, Vec4::ZERO]), None);
        assert_eq!(checked_tangents(&[Vec4::NAN]), None);
    }
}
