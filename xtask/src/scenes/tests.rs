//! The demo scene as a stranger reads it: parsed by the `gltf` crate, probed by rays.

use std::f32::consts::TAU;

use glam::{Mat4, Vec3};

use super::arcade::arcade;
use super::noise::hash;
use super::parlour::parlour;

/// The triangles of the file, world space, with what the tests ask of them.
struct Triangles {
    corners: Vec<[Vec3; 3]>,
    normals: Vec<[Vec3; 3]>,
    double_sided: Vec<bool>,
}

fn read(file: &[u8]) -> (gltf::Document, Triangles) {
    let (document, buffers, _) = gltf::import_slice(file).unwrap();
    let mut triangles = Triangles { corners: vec![], normals: vec![], double_sided: vec![] };
    for node in document.nodes() {
        let Some(mesh) = node.mesh() else { continue };
        let world_from_object = Mat4::from_cols_array_2d(&node.transform().matrix());
        for primitive in mesh.primitives() {
            let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
            let point = |p| world_from_object.transform_point3(Vec3::from_array(p));
            let vector = |n| world_from_object.transform_vector3(Vec3::from_array(n));
            let positions: Vec<Vec3> = reader.read_positions().unwrap().map(point).collect();
            let normals: Vec<Vec3> = reader.read_normals().unwrap().map(vector).collect();
            let uvs: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
            assert!(uvs.iter().flatten().all(|uv| uv.is_finite()), "{:?}", mesh.name());
            let indices: Vec<usize> =
                reader.read_indices().unwrap().into_u32().map(|index| index as usize).collect();
            for corner in indices.chunks_exact(3) {
                triangles.corners.push([0, 1, 2].map(|i| positions[corner[i]]));
                triangles.normals.push([0, 1, 2].map(|i| normals[corner[i]]));
                triangles.double_sided.push(primitive.material().double_sided());
            }
        }
    }
    (document, triangles)
}

/// What a ray meets first: whether it may meet it there, and how far away.
#[derive(Debug, PartialEq)]
enum Meets {
    Front,
    Back,
    Nothing,
}

fn trace(triangles: &Triangles, origin: Vec3, direction: Vec3) -> Meets {
    let mut nearest = (f32::INFINITY, Meets::Nothing);
    for (corners, &double_sided) in triangles.corners.iter().zip(&triangles.double_sided) {
        // Moeller and Trumbore 1997.
        let [a, b, c] = *corners;
        let (ab, ac) = (b - a, c - a);
        let p = direction.cross(ac);
        let determinant = ab.dot(p);
        let to_origin = origin - a;
        let u = to_origin.dot(p) / determinant;
        let q = to_origin.cross(ab);
        let v = direction.dot(q) / determinant;
        let distance = ac.dot(q) / determinant;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 1e-4 && distance < nearest.0 {
            let front = double_sided || determinant > 0.0;
            nearest = (distance, if front { Meets::Front } else { Meets::Back });
        }
    }
    nearest.1
}

/// Rays from the places given, even over the sphere, that do not meet a front or leave through the open roof.
fn leaks(triangles: &Triangles) -> Vec<String> {
    const PLACES: [Vec3; 6] = [
        Vec3::new(-4.0, 1.7, 0.4),
        Vec3::new(3.1, 0.4, -0.8),
        Vec3::new(0.1, 1.1, 3.21),
        Vec3::new(-5.13, 1.2, -3.17),
        Vec3::new(2.3, 4.4, 3.1),
        Vec3::new(5.41, 4.1, -2.9),
    ];
    const RAYS: i32 = 250;
    let mut leaks = Vec::new();
    for (place, origin) in PLACES.into_iter().enumerate() {
        for ray in 0..RAYS {
            let y = 2.0 * (ray as f32 + hash(ray, place as i32, 1)) / RAYS as f32 - 1.0;
            let turn = TAU * (ray as f32 * 0.618_034 + hash(ray, place as i32, 2));
            let r = (1.0 - y * y).sqrt();
            let direction = Vec3::new(r * turn.cos(), y, r * turn.sin());
            let meets = trace(triangles, origin, direction);
            let at_roof = origin + direction * ((5.5 - origin.y) / direction.y);
            let open = direction.y > 0.0 && at_roof.x.abs() < 5.7 && at_roof.z.abs() < 2.0;
            if meets == Meets::Back || (meets == Meets::Nothing && !open) {
                leaks.push(format!("from {origin} along {direction}: {meets:?}"));
            }
        }
    }
    leaks
}

#[test]
fn the_scene_is_what_it_says() {
    let file = arcade().unwrap();
    assert!(file.len() < 4_000_000, "{} bytes", file.len());
    assert_eq!(file, arcade().unwrap(), "the same bytes every time");
    let (document, triangles) = read(&file);
    let count = triangles.corners.len();
    assert!((60_000..=120_000).contains(&count), "{count} triangles");
    let cameras: Vec<_> = document.cameras().map(|camera| camera.name().map(str::to_owned)).collect();
    assert_eq!(cameras, [Some("shot".to_owned())]);
    for name in ["drape_red", "drape_green", "drape_blue", "statue_marble", "floor_paving", "leaf"] {
        assert!(document.materials().any(|material| material.name() == Some(name)), "no {name}");
    }
}

#[test]
fn normals_are_unit_and_agree_with_the_winding() {
    let folded_at = |file: &[u8]| folded(&read(file).1);
    // Crevices of the statue that are narrower than a cell of its grid may fold over.
    let folded = folded_at(&arcade().unwrap());
    assert!(folded.len() < 30, "winding against the normals at {} places: {folded:?}", folded.len());
    assert_eq!(folded_at(&parlour().unwrap()), []);
}

/// Where triangles are wound against their normals.
fn folded(triangles: &Triangles) -> Vec<Vec3> {
    let mut folded = Vec::new();
    for ([a, b, c], normals) in triangles.corners.iter().zip(&triangles.normals) {
        let front = (b - a).cross(c - a);
        assert!(front.length() > 0.0, "a triangle without area at {a}");
        assert!(normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-3), "at {a}");
        if front.dot(normals.iter().sum()) < 0.0 {
            folded.push(*a);
        }
    }
    folded
}

#[test]
fn the_parlour_has_mirrors_and_glass() {
    let file = parlour().unwrap();
    assert_eq!(file, parlour().unwrap(), "the same bytes every time");
    let (document, triangles) = read(&file);
    assert!((8_000..=20_000).contains(&triangles.corners.len()), "{} triangles", triangles.corners.len());
    let extensions: Vec<_> = document.extensions_used().collect();
    assert_eq!(extensions, ["KHR_materials_ior", "KHR_materials_transmission", "KHR_materials_volume"]);
    for name in ["mirror", "glass_clear", "glass_green", "pane", "chrome", "floor_polished", "lamp"] {
        assert!(document.materials().any(|material| material.name() == Some(name)), "no {name}");
    }
}

#[test]
fn nothing_shines_through_the_walls() {
    let (_, mut triangles) = read(&arcade().unwrap());
    let found = leaks(&triangles);
    assert!(found.is_empty(), "{} leaks:\n{}", found.len(), found.join("\n"));
    // The same rays must find a scene that is inside out.
    for corners in &mut triangles.corners {
        corners.swap(1, 2);
    }
    assert!(leaks(&triangles).len() > 100);
    // ... and one that lacks its walls.
    triangles.corners.retain(|[a, ..]| a.x.abs() < 5.0);
    triangles.double_sided = vec![true; triangles.corners.len()];
    assert!(leaks(&triangles).len() > 20);
}

#[test]
fn the_statue_is_closed() {
    let mesh = super::statue::statue();
    let edges = |triangles: &[[u32; 3]]| {
        let mut balance = std::collections::BTreeMap::new();
        for &[a, b, c] in triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *balance.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        balance.values().filter(|&&balance| balance != 0).count()
    };
    assert_eq!(edges(&mesh.triangles), 0);
    assert!(edges(&mesh.triangles[1..]) == 3, "one triangle less opens its three edges");
}
