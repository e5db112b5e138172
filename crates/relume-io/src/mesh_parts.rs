//! What a file says of one mesh, checked and completed to a [`Mesh`].

use relume::glam::{Affine2, Vec2, Vec3, Vec4};
use relume::scene::Mesh;

use crate::tangents::{add_tangents, checked_tangents};

/// Vertices and triangles as they stand in a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct MeshParts {
    /// The name in the file.
    pub(crate) name: String,
    /// For messages: which mesh this is.
    pub(crate) place: String,
    pub(crate) positions: Vec<Vec3>,
    /// One a vertex or empty; computed flat where empty.
    pub(crate) normals: Vec<Vec3>,
    /// One a vertex or empty.
    pub(crate) uvs: Vec<Vec2>,
    /// One a vertex or empty; kept only where a normal map needs them.
    pub(crate) tangents: Vec<Vec4>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Index into the scene's materials.
    pub(crate) material: usize,
    /// The normal map's `texture_from_mesh`, where the material has a normal map.
    pub(crate) normal_map: Option<Affine2>,
}

/// A checked mesh, and what was left out on the way.
#[derive(Debug)]
pub(crate) struct Built {
    /// `None` where no triangle is left.
    pub(crate) mesh: Option<Mesh>,
    pub(crate) warnings: Vec<String>,
}

impl MeshParts {
    /// Checks all numbers, drops triangles without area and vertices without triangles, and computes the
    /// normals and tangents that are missing.
    ///
    /// Errors name the place: a position that is not finite, an index past the last vertex, an attribute with another count than the
    /// positions.
    pub(crate) fn build(mut self) -> Result<Built, String> {
        let mut warnings = Vec::new();
        self.check()?;
        self.drop_degenerate(&mut warnings);
        if self.triangles.is_empty() {
            return Ok(Built { mesh: None, warnings });
        }
        self.drop_unused_vertices();
        self.complete_uvs(&mut warnings);
        self.complete_normals(&mut warnings);
        let mesh = self.into_mesh(&mut warnings);
        Ok(Built { mesh: Some(mesh), warnings })
    }

    fn check(&self) -> Result<(), String> {
        let place = &self.place;
        let count = self.positions.len();
        if count > u32::MAX as usize {
            return Err(format!("{place} has {count} vertices; split it"));
        }
        if let Some(vertex) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(format!(
                "{place}: the position of vertex {vertex} is not finite; export the mesh again"
            ));
        }
        for (attribute, length) in
            [("normals", self.normals.len()), ("uvs", self.uvs.len()), ("tangents", self.tangents.len())]
        {
            if length != 0 && length != count {
                return Err(format!(
                    "{place} has {length} {attribute} for {count} positions; export it again"
                ));
            }
        }
        let outside = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= count);
        if let Some(index) = self.triangles.iter().position(outside) {
            return Err(format!(
                "{place}: triangle {index} has the corners {:?}, but there are only {count} vertices; export the mesh again",
                self.triangles[index]
            ));
        }
        Ok(())
    }

    fn area_vector(&self, triangle: [u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
        (b - a).cross(c - a)
    }

    fn drop_degenerate(&mut self, warnings: &mut Vec<String>) {
        let before = self.triangles.len();
        let mut triangles = std::mem::take(&mut self.triangles);
        triangles.retain(|&triangle| self.area_vector(triangle).try_normalize().is_some());
        self.triangles = triangles;
        let dropped = before - self.triangles.len();
        if dropped > 0 {
            warnings.push(format!(
                "{}: {dropped} of {before} triangles have no area and were left out",
                self.place
            ));
        }
    }

    /// Several meshes may share one list of vertices; each keeps only its own, in their order.
    fn drop_unused_vertices(&mut self) {
        let mut used = vec![false; self.positions.len()];
        for &vertex in self.triangles.as_flattened() {
            used[vertex as usize] = true;
        }
        if used.iter().all(|&u| u) {
            return;
        }
        let mut next = 0_u32;
        let new_index: Vec<u32> = used
            .iter()
            .map(|&used| {
                let index = next;
                next += u32::from(used);
                index
            })
            .collect();
        for vertex in self.triangles.as_flattened_mut() {
            *vertex = new_index[*vertex as usize];
        }
        keep(&mut self.positions, &used);
        keep(&mut self.normals, &used);
        keep(&mut self.uvs, &used);
        keep(&mut self.tangents, &used);
    }

    fn complete_uvs(&mut self, warnings: &mut Vec<String>) {
        let mut mended = 0_usize;
        for uv in self.uvs.iter_mut().filter(|uv| !uv.is_finite()) {
            *uv = Vec2::ZERO;
            mended += 1;
        }
        if mended > 0 {
            warnings.push(format!(
                "{}: {mended} texture coordinates are not finite and were set to 0",
                self.place
            ));
        }
    }

    fn complete_normals(&mut self, warnings: &mut Vec<String>) {
        if self.normals.is_empty() {
            self.make_flat();
            return;
        }
        let mut missing = 0_usize;
        for normal in &mut self.normals {
            *normal = normal.try_normalize().unwrap_or_else(|| {
                missing += 1;
                Vec3::ZERO
            });
        }
        if missing > 0 {
            self.mend_zero_normals();
            warnings.push(format!(
                "{}: {missing} normals have no direction and were computed from the triangles",
                self.place
            ));
        }
    }

    /// Gives every triangle corners of its own with the triangle's normal, as glTF asks of meshes without normals;
    /// tangents are left out with them.
    fn make_flat(&mut self) {
        let corners: Vec<usize> =
            self.triangles.as_flattened().iter().map(|&vertex| vertex as usize).collect();
        self.normals = self
            .triangles
            .iter()
            .flat_map(|&triangle| [self.area_vector(triangle).normalize_or(Vec3::Y); 3])
            .collect();
        self.positions = corners.iter().map(|&vertex| self.positions[vertex]).collect();
        if !self.uvs.is_empty() {
            self.uvs = corners.iter().map(|&vertex| self.uvs[vertex]).collect();
        }
        self.tangents.clear();
        let mut next = 0_u32;
        self.triangles = std::iter::repeat_with(|| {
            next += 3;
            [next - 3, next - 2, next - 1]
        })
        .take(corners.len() / 3)
        .collect();
    }

    /// Area-weighted mean of the triangles round each vertex whose normal is zero.
    fn mend_zero_normals(&mut self) {
        let zero: Vec<bool> = self.normals.iter().map(|n| *n == Vec3::ZERO).collect();
        for &triangle in &self.triangles {
            let area = self.area_vector(triangle);
            for vertex in triangle.map(|vertex| vertex as usize) {
                if zero[vertex] {
                    self.normals[vertex] += area;
                }
            }
        }
        for (normal, _) in self.normals.iter_mut().zip(&zero).filter(|(_, zero)| **zero) {
            *normal = normal.normalize_or(Vec3::Y);
        }
    }

    fn into_mesh(self, warnings: &mut Vec<String>) -> Mesh {
        let mut mesh = Mesh {
            name: self.name,
            positions: self.positions,
            normals: self.normals,
            uvs: self.uvs,
            tangents: Vec::new(),
            triangles: self.triangles,
            material: self.material,
        };
        let Some(texture_from_mesh) = self.normal_map else { return mesh };
        if mesh.uvs.is_empty() {
            warnings.push(format!(
                "{} has no texture coordinates for its normal map, which is left out there",
                self.place
            ));
            return mesh;
        }
        match checked_tangents(&self.tangents) {
            Some(tangents) if !tangents.is_empty() => mesh.tangents = tangents,
            checked => {
                if checked.is_none() {
                    warnings.push(format!(
                        "{} has tangents without direction; all were computed again",
                        self.place
                    ));
                }
                add_tangents(&mut mesh, texture_from_mesh);
            }
        }
        mesh
    }
}

/// Keeps the entries of `attribute` whose flag is set; an empty attribute stays empty.
fn keep<T>(attribute: &mut Vec<T>, used: &[bool]) {
    let mut flags = used.iter();
    attribute.retain(|_| flags.next().copied().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> MeshParts {
        MeshParts {
            place: "mesh 0".to_owned(),
            positions: vec![Vec3::ZERO, Vec3::splat(9.0), Vec3::X, Vec3::Y, Vec3::Z],
            normals: vec![Vec3::Z * 4.0; 5],
            uvs: (0..5).map(|i| Vec2::splat(i as f32)).collect(),
            triangles: vec![[0, 2, 3], [0, 2, 2], [0, 3, 4]],
            ..MeshParts::default()
        }
    }

    #[test]
    fn unused_vertices_and_empty_triangles_go() {
        let built = parts().build().unwrap();
        let mesh = built.mesh.unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z]);
        assert_eq!(mesh.uvs[1], Vec2::splat(2.0));
        assert_eq!(mesh.normals, [Vec3::Z; 4]);
        assert_eq!(built.warnings.len(), 1);
        assert!(built.warnings[0].contains("1 of 3 triangles"), "{:?}", built.warnings);
    }

    #[test]
    fn missing_normals_are_flat_and_split() {
        let built = MeshParts { normals: Vec::new(), ..parts() }.build().unwrap();
        let mesh = built.mesh.unwrap();
        assert_eq!(mesh.positions.len(), 6);
        assert_eq!(mesh.uvs.len(), 6);
        for (triangle, expected) in mesh.triangles.iter().zip([Vec3::Z, Vec3::X]) {
            for &vertex in triangle {
                assert_eq!(mesh.normals[vertex as usize], expected);
            }
        }
    }

    #[test]
    fn zero_normals_are_mended_from_their_triangles() {
        let mut parts = parts();
        parts.normals[2] = Vec3::ZERO;
        parts.normals[4] = Vec3::NAN;
        let built = parts.build().unwrap();
        let mesh = built.mesh.unwrap();
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::X]);
        assert!(built.warnings.iter().any(|w| w.contains("2 normals")), "{:?}", built.warnings);
    }

    #[test]
    fn bad_numbers_are_errors_that_name_the_place() {
        let mut bad = parts();
        bad.positions[3].y = f32::INFINITY;
        assert!(bad.build().unwrap_err().starts_with("mesh 0: the position of vertex 3"));
        let mut bad = parts();
        bad.triangles[0][1] = 5;
        assert!(bad.build().unwrap_err().contains("only 5 vertices"));
        let mut bad = parts();
        bad.normals.pop();
        assert!(bad.build().unwrap_err().contains("4 normals for 5 positions"));
    }

    #[test]
    fn only_normal_maps_ask_for_tangents() {
        let given = MeshParts { tangents: vec![Vec4::new(0.0, 3.0, 0.0, -1.0); 5], ..parts() };
        assert!(given.clone().build().unwrap().mesh.unwrap().tangents.is_empty());
        let mapped = MeshParts { normal_map: Some(Affine2::IDENTITY), ..given };
        let mesh = mapped.clone().build().unwrap().mesh.unwrap();
        assert_eq!(mesh.tangents, [Vec4::new(0.0, 1.0, 0.0, -1.0); 4]);
        let bad = MeshParts { tangents: vec![Vec4::ZERO; 5], ..mapped.clone() }.build().unwrap();
        assert!(!bad.mesh.unwrap().tangents.is_empty());
        assert!(bad.warnings.iter().any(|w| w.contains("computed again")));
        let bare = MeshParts { uvs: Vec::new(), ..mapped }.build().unwrap();
        assert!(bare.mesh.unwrap().tangents.is_empty());
        assert!(bare.warnings.iter().any(|w| w.contains("no texture coordinates")));
    }
}
