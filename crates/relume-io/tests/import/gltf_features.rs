//! The importer against one scene with every feature it reads, in each container.

use crate::support::{Builder, everything, triangle};
use relume::glam::{Affine2, Vec2, Vec3, Vec4};
use relume::scene::{AlphaMode, ColorSpace, Geometry, Interior, Wrap};
use relume::{LightKind, Scene};
use relume_io::{Imported, load_scene};

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}

/// The same scene as `.glb`, as `.gltf` with files beside it, and as `.gltf` with a data URI.
fn all_containers() -> Vec<Imported> {
    let folder = tempfile::tempdir().unwrap();
    let glb = everything(Builder::embedded());
    let files = everything(Builder::beside(folder.path()));
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(&glb.bin);
    let data_folder = tempfile::tempdir().unwrap();
    [
        glb.write_glb(folder.path()),
        files.write_gltf(folder.path(), "geo.bin"),
        glb.write_gltf(data_folder.path(), &format!("data:application/octet-stream;base64,{data}")),
    ]
    .map(|path| load_scene(&path).unwrap())
    .into()
}

fn scene() -> Scene {
    let folder = tempfile::tempdir().unwrap();
    load_scene(&everything(Builder::embedded()).write_glb(folder.path())).unwrap().scene
}

#[test]
fn containers_agree() {
    let all = all_containers();
    for other in &all[1..] {
        assert_eq!(all[0].scene, other.scene);
        assert_eq!(all[0].warnings, other.warnings);
    }
}

#[test]
fn instances_share_meshes_and_objects_are_nodes() {
    let scene = scene();
    let placed: Vec<_> = scene.instances.iter().map(|i| (i.name.as_str(), i.mesh, i.object)).collect();
    assert_eq!(
        placed,
        [
            ("stretched", 0, 0),
            ("stretched", 1, 0),
            ("mirrored", 0, 1),
            ("mirrored", 1, 1),
            ("third", 2, 2),
            ("third", 3, 2),
        ]
    );
    let triangles: Vec<_> = scene.meshes.iter().map(|mesh| mesh.triangles.len()).collect();
    assert_eq!(triangles, [2, 2, 2, 1], "list without its empty triangle, strip, fan, list");
}

#[test]
fn normals_follow_surfaces_under_any_transform() {
    let scene = scene();
    let geometry = Geometry::new(&scene);
    for triangle in 0..geometry.triangles.len() {
        let surface = geometry.area_vector(triangle).normalize();
        for vertex in geometry.triangles[triangle] {
            assert!(near(geometry.normals[vertex as usize], surface), "triangle {triangle}");
        }
    }
    // Normals carried like positions would be wrong here.
    let stretched = &scene.instances[0];
    let wrong = stretched.world_from_object.transform_vector3(scene.meshes[0].normals[0]).normalize();
    assert!(!near(wrong, geometry.normals[0]));
}

#[test]
fn transforms_are_composed_from_matrix_and_trs() {
    let scene = scene();
    // (1, 0, 0) scaled to (2, 0, 0), turned about Z to (0, 2, 0), moved to (1, 4, 3); turned about Y: (x, y, z) to
    // (z, y, -x), moved by 10.
    let world = scene.instances[0].world_from_object.transform_point3(Vec3::X);
    assert!(near(world, Vec3::new(13.0, 4.0, -1.0)), "{world}");
    assert!(scene.instances[2].world_from_object.matrix3.determinant() < 0.0);
    let geometry = Geometry::new(&scene);
    let mirrored = (0..geometry.triangles.len()).find(|&t| geometry.objects[t] == 1).unwrap();
    // Facing (1, 1, 0), mirrored to (-1, 3, 0) by the inverse transpose of the scale; turned to (0, 3, 1).
    let expected = Vec3::new(0.0, 3.0, 1.0).normalize();
    assert!(near(geometry.area_vector(mirrored).normalize(), expected), "winding must stay outward");
}

#[test]
fn attributes_are_read() {
    let scene = scene();
    let [list, _, fan, plain] = &scene.meshes[..] else { panic!("four meshes") };
    assert!(list.normals.iter().all(|&n| near(n, Vec3::new(1.0, 1.0, 0.0).normalize())));
    assert_eq!(
        list.uvs,
        [[0.0, 2.0], [2.0, 2.0], [2.0, 0.0], [0.0, 0.0]].map(Vec2::from_array),
        "TEXCOORD_1"
    );
    assert_eq!(scene.meshes[1].uvs[2], Vec2::ONE, "TEXCOORD_0 as normalised 16-bit integers");
    // u runs along (-1, 1, 0) and v along -Z. The normal map, turned by a quarter, has its u along v and its v along -u.
    assert_eq!(list.tangents.len(), list.positions.len());
    for t in &list.tangents {
        assert!(near(t.truncate(), Vec3::NEG_Z) && t.w == 1.0, "{t}");
    }
    assert!(fan.positions.contains(&Vec3::new(0.0, 0.0, 5.0)), "sparse value");
    assert_eq!(fan.normals.len(), 6, "flat normals have corners of their own");
    assert!(plain.tangents.is_empty() && plain.uvs.is_empty());
    assert_eq!(scene.materials[plain.material].name, "default");
}

#[test]
fn materials_are_read() {
    let scene = scene();
    let full = &scene.materials[0];
    assert_eq!(full.name, "full");
    assert_eq!(full.base_color, Vec4::new(0.5, 0.25, 1.0, 0.75));
    assert_eq!((full.metallic, full.roughness, full.normal_scale), (0.2, 0.3, 0.7));
    assert_eq!(full.emission, Vec3::new(8.0, 4.0, 2.0));
    assert!(full.double_sided);
    assert_eq!(full.alpha_mode, AlphaMode::Opaque);
    let base = full.base_color_texture.unwrap();
    assert_eq!(base.uv(Vec2::new(1.0, 1.0)), Vec2::new(2.25, 3.5));
    let normal = full.normal_texture.unwrap();
    let turned = normal.uv(Vec2::new(1.0, 0.0));
    assert!((turned - Vec2::new(0.0, -1.0)).length() < 1e-6, "counter-clockwise in the image: {turned}");
    assert_eq!(full.metallic_roughness_texture.unwrap().texture_from_mesh, Affine2::IDENTITY);

    let texture = |r: Option<relume::scene::TextureRef>| &scene.textures[r.unwrap().texture];
    assert_eq!(texture(full.base_color_texture).wrap, [Wrap::Mirror, Wrap::Clamp]);
    assert_eq!(texture(full.base_color_texture).color_space, ColorSpace::Srgb);
    assert_eq!(texture(full.normal_texture).color_space, ColorSpace::Linear);
    assert_eq!(texture(full.normal_texture).wrap, [Wrap::Repeat; 2]);
    assert_eq!(full.emission_texture.unwrap().texture, base.texture, "same image, sampler and colour space");

    let mask = &scene.materials[1];
    assert_eq!(mask.alpha_mode, AlphaMode::Mask { cutoff: 0.3 });
    assert!(!mask.double_sided);
    assert_eq!((mask.metallic, mask.roughness), (1.0, 1.0));
    assert_eq!(texture(mask.base_color_texture).texels, [[255, 0, 0, 255], [0, 255, 0, 100]]);
    let linear = texture(mask.metallic_roughness_texture);
    assert_eq!(linear.color_space, ColorSpace::Linear, "one image read both ways is two textures");
    assert_eq!(linear.texels, texture(mask.base_color_texture).texels);
    assert_eq!(scene.textures.len(), 4);
    assert_eq!(scene.materials[2].alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
}

#[test]
fn cameras_and_lights_are_read() {
    let scene = scene();
    let [camera] = &scene.cameras[..] else { panic!("the orthographic camera is left out") };
    assert_eq!((camera.name.as_str(), camera.vertical_fov), ("eye", 0.8));
    assert!(near(camera.position(), Vec3::new(10.0, 1.0, 0.0)));
    assert!(near(camera.direction(32.0, 24.0, 64, 48), Vec3::NEG_X));
    assert!(camera.world_from_camera.matrix3.determinant() - 1.0 < 1e-5, "scale must not stay");

    let lights = &scene.lights.lights;
    let names: Vec<_> = lights.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["lamp", "lamp_2", "sun"]);
    let LightKind::Omni { position, intensity, radius } = lights[0].kind else { panic!("{:?}", lights[0]) };
    assert!(near(position, Vec3::new(11.0, 0.0, 0.0)));
    assert_eq!((intensity, radius), (Vec3::new(40.0, 20.0, 0.0), 0.0));
    let LightKind::Spot { position, target, inner_angle, outer_angle, .. } = lights[1].kind else { panic!() };
    assert!(near(target - position, Vec3::NEG_X));
    assert_eq!(inner_angle, 0.0);
    assert!(outer_angle <= 90.0 && outer_angle > 89.9999);
    let LightKind::Distant { direction, irradiance, angle } = lights[2].kind else { panic!() };
    assert!(near(direction, Vec3::NEG_X));
    assert!(near(irradiance, Vec3::new(1.0, 2.0, 3.0)));
    assert_eq!(angle, 0.0);
}

#[test]
fn everything_left_out_is_said() {
    let warnings = all_containers().swap_remove(0).warnings;
    for expected in [
        "KHR_materials_clearcoat",
        "animations were left out",
        "`flat eye` is orthographic",
        "`nothing` is scaled to nothing",
        "1 lights have a `range`",
        "`mask` reads TEXCOORD_0 and TEXCOORD_1",
        "`glass` is blended",
        "`slanted`, primitive 0: 1 of 3 triangles",
        "`strange`, primitive 1 has points or lines",
        "1 indices make no triangle",
        "ask for nearest filtering",
    ] {
        assert!(warnings.iter().any(|w| w.contains(expected)), "{expected} in {warnings:#?}");
    }
    assert_eq!(warnings.len(), 11, "{warnings:#?}");
}

fn with_material(material: serde_json::Value) -> Builder {
    let mut builder = triangle();
    builder.push("materials", material);
    builder.json["meshes"][0]["primitives"][0]["material"] = serde_json::json!(0);
    builder
}

#[test]
fn glass_is_read() {
    let mut builder = with_material(serde_json::json!({
        "name": "green",
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.0},
        "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 0}},
            "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_volume": {
                "thicknessFactor": 0.1, "attenuationColor": [1.0, 0.5, 0.25], "attenuationDistance": 0.5
            },
        },
    }));
    let texels = builder.image("panes", &[[255, 0, 0, 255], [0, 0, 0, 255]]);
    builder.push("textures", serde_json::json!({"source": texels}));
    let folder = tempfile::tempdir().unwrap();
    let imported = load_scene(&builder.write_glb(folder.path())).unwrap();
    assert!(imported.warnings.iter().all(|warning| !warning.contains("glass")), "{:?}", imported.warnings);
    let glass = &imported.scene.materials[0];
    assert_eq!((glass.transmission, glass.ior), (0.75, 1.33));
    let texture = &imported.scene.textures[glass.transmission_texture.unwrap().texture];
    assert_eq!((texture.color_space, texture.mean_red()), (ColorSpace::Linear, 0.5));
    let Interior::Solid { extinction } = glass.interior else { panic!("a solid") };
    assert!(near((extinction * -0.5).exp(), Vec3::new(1.0, 0.5, 0.25)), "{extinction}");
    assert_eq!(
        imported.scene.clear_materials(),
        [false],
        "over its texture, less than half of the light passes"
    );
}

#[test]
fn thin_and_frosted_glass_are_told_apart() {
    let builder = with_material(serde_json::json!({
        "name": "frosted",
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.3},
        "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 1.0},
            "KHR_materials_ior": {"ior": 0.0},
            "KHR_materials_volume": {"thicknessFactor": 0.0},
        },
    }));
    let folder = tempfile::tempdir().unwrap();
    let imported = load_scene(&builder.write_glb(folder.path())).unwrap();
    let glass = &imported.scene.materials[0];
    assert_eq!((glass.interior, glass.ior), (Interior::Thin, 1.5));
    assert_eq!(imported.scene.clear_materials(), [true]);
    for expected in ["`frosted` is frosted glass; what lies behind", "`frosted` has the refractive index 0"] {
        assert!(imported.warnings.iter().any(|w| w.contains(expected)), "{:?}", imported.warnings);
    }
    for (extensions, expected) in [
        (
            serde_json::json!({"KHR_materials_ior": {"ior": 0.7}}),
            "the refractive index 0.7; give one of at least 1",
        ),
        (
            serde_json::json!({"KHR_materials_volume": {"thicknessFactor": 1.0, "attenuationDistance": -1.0}}),
            "an attenuation colour or distance out of range",
        ),
    ] {
        let bad = with_material(serde_json::json!({"name": "bad", "extensions": extensions}));
        let error = load_scene(&bad.write_glb(folder.path())).unwrap_err().to_string();
        assert!(error.contains("material `bad`") && error.contains(expected), "{error}");
    }
}
