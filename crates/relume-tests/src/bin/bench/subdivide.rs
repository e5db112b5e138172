//! More triangles of the same surfaces: each is parted into four at the middles of its edges.

use std::collections::HashMap;

use relume::glam::Vec3;
use serde_json::{Value, json};

use crate::glb::{Glb, Numbers};

/// The triangles of one primitive, with what each vertex has.
#[derive(Clone, Debug, PartialEq)]
struct Surface {
    /// `POSITION`, `NORMAL`, ...
    attributes: Vec<(String, Numbers)>,
    triangles: Vec<[u32; 3]>,
}

/// The scene of `glb` with each triangle in `4^times` ones. What vertices have is interpolated; normals and tangents stay unit vectors. The old
/// vertices stay in the buffer, where nothing refers to them.
///
/// # Errors
/// Which primitive is no plain list of triangles.
pub(crate) fn subdivided(mut glb: Glb, times: u32) -> Result<Glb, String> {
    let count = |value: &Value| value.as_array().map_or(0, Vec::len);
    for mesh in 0..count(&glb.json["meshes"]) {
        for primitive in 0..count(&glb.json["meshes"][mesh]["primitives"]) {
            let mut surface =
                read(&glb, &glb.json["meshes"][mesh]["primitives"][primitive]).ok_or_else(|| {
                    format!("primitive {primitive} of mesh {mesh} is no plain list of triangles")
                })?;
            for _ in 0..times {
                surface = surface.halved();
            }
            let (attributes, indices) = append(&mut glb, &surface);
            let primitive = &mut glb.json["meshes"][mesh]["primitives"][primitive];
            primitive["attributes"] = attributes;
            primitive["indices"] = indices.into();
            if let Some(primitive) = primitive.as_object_mut() {
                primitive.remove("targets");
            }
        }
    }
    Ok(glb)
}

/// `None` where it cannot be subdivided.
fn read(glb: &Glb, primitive: &Value) -> Option<Surface> {
    let number = |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok());
    if primitive["mode"].as_u64().unwrap_or(4) != 4
        || !primitive["extensions"]["KHR_draco_mesh_compression"].is_null()
    {
        return None;
    }
    let kept = ["POSITION", "NORMAL", "TANGENT", "TEXCOORD_", "COLOR_"];
    let attributes = primitive["attributes"].as_object()?.iter();
    let attributes = attributes.filter(|(name, _)| kept.iter().any(|kept| name.starts_with(kept)));
    let attributes: Option<Vec<_>> =
        attributes.map(|(name, accessor)| Some((name.clone(), glb.numbers(number(accessor)?)?))).collect();
    let attributes = attributes?;
    let vertices = |(_, numbers): &(String, Numbers)| numbers.values.len() / numbers.components;
    let count = attributes.iter().find(|(name, _)| name == "POSITION").map(vertices)?;
    let indices = match &primitive["indices"] {
        Value::Null => (0..u32::try_from(count).ok()?).collect(),
        accessor => glb.indices(number(accessor)?)?,
    };
    let (triangles, rest) = indices.as_chunks::<3>();
    let sound = rest.is_empty()
        && indices.iter().all(|&index| (index as usize) < count)
        && attributes.iter().all(|attribute| vertices(attribute) == count);
    sound.then(|| Surface { attributes, triangles: triangles.to_vec() })
}

/// Puts a surface into the buffer; its attributes and indices as a primitive names them.
fn append(glb: &mut Glb, surface: &Surface) -> (Value, usize) {
    let mut attributes = json!({});
    for (name, numbers) in &surface.attributes {
        let bytes: Vec<u8> = numbers.values.iter().flat_map(|number| number.to_le_bytes()).collect();
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][numbers.components - 1];
        let count = numbers.values.len() / numbers.components;
        let mut accessor = json!({"componentType": 5126, "type": kind, "count": count});
        if name == "POSITION" {
            let positions = || numbers.values.as_chunks::<3>().0.iter().copied().map(Vec3::from);
            let low = positions().fold(Vec3::INFINITY, Vec3::min);
            let high = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
            accessor["min"] = json!(low.to_array());
            accessor["max"] = json!(high.to_array());
        }
        attributes[name.as_str()] = glb.append(&bytes, accessor).into();
    }
    let indices = surface.triangles.as_flattened();
    let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
    let accessor = json!({"componentType": 5125, "type": "SCALAR", "count": indices.len()});
    (attributes, glb.append(&bytes, accessor))
}

impl Surface {
    /// Every triangle in four.
    fn halved(mut self) -> Self {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut triangles = Vec::with_capacity(4 * self.triangles.len());
        for [a, b, c] in std::mem::take(&mut self.triangles) {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| self.middle(from, to, &mut middles));
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        Self { triangles, ..self }
    }

    /// The vertex in the middle of an edge, which triangles on both its sides share.
    fn middle(&mut self, from: u32, to: u32, middles: &mut HashMap<(u32, u32), u32>) -> u32 {
        let vertices = self.attributes.first().map_or(0, |(_, first)| first.values.len() / first.components);
        *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
            for (name, numbers) in &mut self.attributes {
                numbers.add_middle(name, from as usize, to as usize);
            }
            vertices as u32
        })
    }
}

impl Numbers {
    fn add_middle(&mut self, name: &str, from: usize, to: usize) {
        let count = self.components;
        let begin = self.values.len();
        for component in 0..count {
            let (a, b) = (self.values[from * count + component], self.values[to * count + component]);
            self.values.push(0.5 * (a + b));
        }
        if matches!(name, "NORMAL" | "TANGENT") && count >= 3 {
            let middle = Vec3::from_slice(&self.values[begin..]);
            // normals that point away from each other have no middle
            let unit = middle.try_normalize().unwrap_or(Vec3::from_slice(&self.values[from * count..]));
            self.values[begin..begin + 3].copy_from_slice(&unit.to_array());
        }
        if name == "TANGENT" && count == 4 {
            self.values[begin + 3] = self.values[from * count + 3];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::scene::Geometry;
    use std::path::Path;

    /// Triangles, their whole area, and the same by axes of the normals with their signs.
    fn measured(path: &Path) -> (usize, f64, [f64; 3]) {
        let scene = relume_io::load_scene(path).unwrap().scene;
        let geometry = Geometry::new(&scene);
        let vectors = (0..geometry.triangles.len()).map(|triangle| geometry.area_vector(triangle).as_dvec3());
        let area = vectors.clone().map(|vector| 0.5 * vector.length()).sum();
        let upward = |axis: usize| vectors.clone().map(|vector| 0.5 * vector[axis].max(0.0)).sum();
        (geometry.triangles.len(), area, [0, 1, 2].map(upward))
    }

    fn demo() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/arcade.glb")
    }

    #[test]
    fn each_triangle_becomes_four_on_the_same_surface() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fine.glb");
        let coarse = Glb::read(&demo()).unwrap();
        let before = measured(&demo());
        for times in [0, 1] {
            subdivided(coarse.clone(), times).unwrap().write(&path).unwrap();
            let after = measured(&path);
            assert_eq!(after.0, before.0 * 4_usize.pow(times));
            let same = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-5;
            assert!(same(after.1, before.1), "{} {}", after.1, before.1);
            assert!((0..3).all(|axis| same(after.2[axis], before.2[axis])), "{:?} {:?}", after.2, before.2);
        }
        // one triangle fewer is another surface
        let mut torn = coarse;
        let mut surface = read(&torn, &torn.json["meshes"][0]["primitives"][0]).unwrap();
        surface.triangles.pop();
        let (_, indices) = append(&mut torn, &surface);
        torn.json["meshes"][0]["primitives"][0]["indices"] = indices.into();
        torn.write(&path).unwrap();
        assert!(measured(&path).1 < before.1 * (1.0 - 1e-12));
    }

    #[test]
    fn edges_are_shared_and_normals_stay_unit_vectors() {
        let numbers = |components: usize, values: &[f32]| Numbers { components, values: values.to_vec() };
        let surface = Surface {
            attributes: vec![
                ("POSITION".into(), numbers(3, &[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.])),
                ("NORMAL".into(), numbers(3, &[1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., -1.])),
                ("TEXCOORD_0".into(), numbers(2, &[0., 0., 4., 0., 0., 4., 4., 4.])),
            ],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
        };
        let fine = surface.halved();
        assert_eq!(fine.triangles.len(), 8);
        let [(_, positions), (_, normals), (_, uvs)] = fine.attributes.as_slice() else { panic!("three") };
        assert_eq!(positions.values.len(), 3 * (4 + 5), "the edge between the two is halved once");
        assert!(normals.values.as_chunks::<3>().0.iter().all(|normal| Vec3::from(*normal).is_normalized()));
        assert_eq!(uvs.values[8..10], [2.0, 0.0]);
    }

    #[test]
    fn strips_are_refused() {
        let mut glb = Glb::read(&demo()).unwrap();
        glb.json["meshes"][0]["primitives"][0]["mode"] = 5.into();
        assert!(subdivided(glb, 1).unwrap_err().contains("primitive 0 of mesh 0"));
    }
}
