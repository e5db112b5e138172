//! The real scenes, where they are at hand.

use std::path::PathBuf;
use std::time::Instant;

use relume::glam::Vec3;
use relume::scene::{AlphaMode, Geometry};
use relume_io::{Imported, load_scene};

/// The scene, where it is at hand; else says that what needs it is skipped.
fn load(name: &str) -> Option<Imported> {
    let folder = std::env::var_os("RELUME_SCENES")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes")));
    let path = folder.join(name);
    if path.is_file() {
        return Some(load_scene(&path).unwrap());
    }
    println!("skipped: {} is not there", path.display());
    None
}

/// Triangles with all instances counted, how many of them have no area, materials, textures, the camera's place and vertical field of view in
/// degrees, and the size of the bounding box.
type Expected = (&'static str, usize, usize, usize, usize, [f32; 3], f32, [f32; 3]);

const SCENES: [Expected; 7] = [
    ("sponza.glb", 262_267, 1, 25, 64, [-9.5, 1.2, -0.3], 55.0, [29.77, 12.45, 18.31]),
    ("cornell.glb", 36, 0, 4, 0, [0.278, 0.273, -0.8], 39.3, [0.56, 0.55, 0.56]),
    ("still_life.glb", 123_155, 0, 11, 4, [0.62, 1.24, 1.22], 38.0, [2.6, 2.4, 2.25]),
    ("hairball.glb", 328_736, 0, 7, 0, [0.35, 1.45, 3.1], 42.0, [3.0, 2.6, 3.0]),
    ("temple.glb", 2_163_244, 8, 9, 6, [1.3, 1.9, 12.2], 58.0, [80.0, 10.62, 90.0]),
    ("bunny_ground.glb", 127_251, 0, 2, 0, [2.3, 2.1, 3.0], 38.0, [4.0, 1.6, 4.0]),
    ("horse_ground.glb", 154_766, 0, 2, 0, [2.3, 2.1, 3.0], 38.0, [4.0, 1.8, 4.0]),
];

#[test]
fn shared_scenes_match_their_table() {
    for (name, triangles, degenerate, materials, textures, camera, fov, size) in SCENES {
        let start = Instant::now();
        let Some(imported) = load(name) else { continue };
        let seconds = start.elapsed().as_secs_f64();
        let scene = &imported.scene;
        println!("{name}: {seconds:.3} s, warnings {:?}", imported.warnings);
        let geometry = Geometry::new(scene);
        assert_eq!(geometry.triangles.len(), triangles - degenerate, "{name}");
        assert_eq!(scene.materials.len(), materials, "{name}");
        assert_eq!(scene.textures.len(), textures, "{name}");
        assert!((scene.cameras[0].position() - Vec3::from_array(camera)).length() < 1e-2, "{name}");
        assert!((scene.cameras[0].vertical_fov.to_degrees() - fov).abs() < 0.1, "{name}");
        let (low, high) = geometry.bounds().unwrap();
        assert!((high - low - Vec3::from_array(size)).length() < 0.02, "{name}: {}", high - low);
        let no_area = |warning: &String| warning.contains("triangles have no area");
        assert!(imported.warnings.iter().all(no_area), "{name}: {:?}", imported.warnings);
        assert_eq!(imported.warnings.is_empty(), degenerate == 0, "{name}: {:?}", imported.warnings);
        check_normals(name, &geometry);
    }
}

/// Shading normals are of unit length and, but for bent hairs, lie on the front of their triangles.
fn check_normals(name: &str, geometry: &Geometry) {
    assert!(geometry.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{name}");
    let away = (0..geometry.triangles.len())
        .filter(|&triangle| {
            let front = geometry.area_vector(triangle);
            let shading: Vec3 =
                geometry.triangles[triangle].iter().map(|&v| geometry.normals[v as usize]).sum();
            front.dot(shading) < 0.0
        })
        .count();
    let share = away as f64 / geometry.triangles.len() as f64;
    assert!(share < 1e-3, "{name}: {away} triangles face away from their normals");
}

#[test]
fn sponza_has_masks_and_tangents() {
    let Some(Imported { scene, .. }) = load("sponza.glb") else { return };
    let mut masked: Vec<_> = scene
        .materials
        .iter()
        .filter(|material| material.alpha_mode == AlphaMode::Mask { cutoff: 0.5 } && material.double_sided)
        .map(|material| material.name.as_str())
        .collect();
    masked.sort_unstable();
    assert_eq!(masked, ["Material__57", "chain", "leaf"]);
    for mesh in &scene.meshes {
        let mapped = scene.materials[mesh.material].normal_texture.is_some();
        assert_eq!(mesh.tangents.len(), if mapped { mesh.positions.len() } else { 0 }, "{}", mesh.name);
    }
}
