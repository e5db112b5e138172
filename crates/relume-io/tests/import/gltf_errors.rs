//! Files that must be refused with one sentence, and files that must not end the process.

use std::path::Path;

use crate::support::{Builder, everything, triangle};
use relume_io::load_scene;
use serde_json::{Value, json};

fn load(builder: &Builder) -> Result<relume_io::Imported, String> {
    let folder = tempfile::tempdir().unwrap();
    load_scene(&builder.write_glb(folder.path())).map_err(|error| {
        assert!(error.is_bad_input());
        error.to_string()
    })
}

fn refused(change: impl FnOnce(&mut Builder), expected: &str) {
    let mut builder = triangle();
    change(&mut builder);
    let error = load(&builder).unwrap_err();
    assert!(error.contains("scene.glb: ") && error.contains(expected), "{expected}: {error}");
}

#[test]
fn a_plain_triangle_gets_a_camera() {
    let imported = load(&triangle()).unwrap();
    assert_eq!(imported.scene.cameras.len(), 1);
    assert!(imported.warnings.iter().any(|w| w.contains("no camera in the file")), "{:?}", imported.warnings);
    assert!((imported.scene.cameras[0].vertical_fov.to_degrees() - 45.0).abs() < 1e-4);
}

#[test]
fn malformed_structures_are_named() {
    refused(|b| b.json["nodes"][0]["children"] = json!([0]), "node `n` is its own ancestor");
    refused(|b| b.json["nodes"][0]["children"] = json!([7]), "not valid glTF");
    refused(|b| b.json["nodes"][0]["rotation"] = json!([0, 0, 0, 0]), "unit length");
    // past f32: the JSON reader's own words, before a transform can be made of it
    refused(
        |b| b.json["nodes"][0]["scale"] = json!([1e39, 1, 1]),
        "is not glTF: number out of range at line",
    );
    refused(
        |b| b.json["nodes"][0]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
        "not affine",
    );
    refused(|b| b.json["nodes"][0]["translation"] = json!([1e30, 0, 0]), "reaches further");
    refused(|b| b.json["scenes"] = json!([]), "has no scene");
    refused(|b| b.json["scenes"] = json!([{"nodes": []}]), "no triangle");
    refused(|b| b.json["asset"]["version"] = json!("1.0"), "version 1.0");
    refused(|b| b.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(99), "accessor 99");
    refused(|b| b.json["meshes"][0]["primitives"][0]["material"] = json!(3), "not valid glTF at meshes[0]");
    refused(|b| b.json["accessors"][0]["count"] = json!(4), "mesh `tri`, primitive 0");
    refused(|b| b.json["accessors"][0]["count"] = json!(u64::MAX), "ask for");
    refused(|b| b.json["accessors"][0]["byteOffset"] = json!(u64::MAX), "past the end");
    refused(|b| b.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX), "past the end");
    refused(|b| b.json["bufferViews"][0]["byteStride"] = json!(4), "stride of 4");
    refused(|b| b.json["accessors"][0]["type"] = json!("VEC2"), "2 components");
    refused(|b| b.json["accessors"][0]["componentType"] = json!(5125), "32-bit");
}

#[test]
fn bad_indices_and_positions_name_mesh_and_primitive() {
    refused(
        |b| {
            let indices = b.indices(&[0, 1, 3]);
            b.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        },
        "mesh `tri`, primitive 0: triangle 0 has the corners [0, 1, 3]",
    );
    refused(
        |b| b.bin[4..8].copy_from_slice(&f32::NAN.to_le_bytes()),
        "mesh `tri`, primitive 0: the position of vertex 0 is not finite",
    );
}

#[test]
fn sparse_accessors_without_data_are_bounded() {
    refused(
        |b| {
            let view = b.view(&[0; 16], None);
            b.json["accessors"][0] = json!({"componentType": 5126, "count": 1_u64 << 28, "type": "VEC3",
                "min": [0, 0, 0], "max": [1, 1, 1], "sparse": {"count": 1,
                "indices": {"bufferView": view, "componentType": 5121}, "values": {"bufferView": view}}});
        },
        "without a buffer view",
    );
}

#[test]
fn required_extensions_are_errors_and_used_ones_warnings() {
    refused(
        |b| b.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
        "requires the extension KHR_draco_mesh_compression, which is not supported; export the scene without compression",
    );
    let mut used = triangle();
    used.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression", "KHR_texture_transform"]);
    let warnings = load(&used).unwrap().warnings;
    assert_eq!(warnings.iter().filter(|w| w.contains("extension")).count(), 1, "{warnings:?}");
}

#[test]
fn deep_hierarchies_do_not_overflow_the_stack() {
    let mut builder = triangle();
    let depth = 200_000;
    let mut nodes: Vec<Value> = (0..depth).map(|i| json!({"children": [i + 1]})).collect();
    nodes.push(json!({"name": "leaf", "mesh": 0, "translation": [1, 2, 3]}));
    builder.json["nodes"] = json!(nodes);
    let imported = load(&builder).unwrap();
    assert_eq!(imported.scene.instances[0].name, "leaf");
}

#[test]
fn missing_and_remote_images_name_file_and_material() {
    let folder = tempfile::tempdir().unwrap();
    let builder = everything(Builder::beside(folder.path()));
    let path = builder.write_gltf(folder.path(), "geo.bin");
    std::fs::remove_file(folder.path().join("tex tures/red.png")).unwrap();
    let error = load_scene(&path).unwrap_err().to_string();
    assert!(error.contains("red.png") && error.contains("material `full`"), "{error}");

    for (uri, expected) in
        [("https://x.org/red.png", "not beside the scene"), (".", "regular file"), ("a%FF", "UTF-8")]
    {
        let mut remote = everything(Builder::beside(folder.path()));
        remote.json["images"][0]["uri"] = json!(uri);
        let path = remote.write_gltf(folder.path(), "geo.bin");
        let error = load_scene(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let path = builder.write_gltf(folder.path(), "geo.bin");
    std::fs::write(folder.path().join("tex tures/flat.png"), b"no image").unwrap();
    std::fs::write(folder.path().join("tex tures/red.png"), crate::support::png(&[[1; 4]])).unwrap();
    let error = load_scene(&path).unwrap_err().to_string();
    assert!(error.contains("`flat`") && error.contains("neither PNG nor JPEG"), "{error}");
}

#[test]
fn buffers_that_are_missing_or_short_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let builder = triangle();
    let path = builder.write_gltf(folder.path(), "geo.bin");
    std::fs::write(folder.path().join("geo.bin"), &builder.bin[..8]).unwrap();
    assert!(load_scene(&path).unwrap_err().to_string().contains("8 of its 36 bytes"));
    std::fs::remove_file(folder.path().join("geo.bin")).unwrap();
    let error = load_scene(&path).unwrap_err().to_string();
    assert!(error.contains("buffer 0") && error.contains("geo.bin"), "{error}");
}

#[test]
fn other_files_are_refused() {
    for (name, expected) in [("a.fbx", "`.fbx` files"), ("a", "must end in"), ("none.glb", "cannot read")] {
        let error = load_scene(&Path::new("/nonexistent").join(name)).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
        assert!(error.is_bad_input());
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(load_scene(folder.path()).is_err());
}

#[test]
fn truncated_files_never_panic() {
    let bytes = everything(Builder::embedded()).glb();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    for length in (0..bytes.len()).step_by(7).chain(0..40) {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(load_scene(&path).is_err(), "{length} of {} bytes", bytes.len());
    }
}

#[test]
fn altered_files_never_panic() {
    let bytes = everything(Builder::embedded()).glb();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let mut state = 1_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut refused = 0;
    for round in 0..4000 {
        let mut altered = bytes.clone();
        for _ in 0..=round % 4 {
            let at = random(altered.len());
            // Digits for digits keep the JSON well-formed and its numbers wrong.
            altered[at] = match altered[at] {
                b'0'..=b'9' => b'0' + random(10) as u8,
                _ if round % 3 == 0 => random(256) as u8,
                other => other ^ (1 << random(8)),
            };
        }
        std::fs::write(&path, &altered).unwrap();
        refused += usize::from(load_scene(&path).is_err());
    }
    assert!(refused > 500, "only {refused} of 4000 were refused");
}
