//! OBJ and MTL files.

use std::path::Path;

use relume::glam::{Vec2, Vec3, Vec4};
use relume::scene::{AlphaMode, ColorSpace, Geometry};
use relume_io::{Imported, load_scene};

const OBJ: &str = "\
mtllib lib.mtl
o first
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 2
usemtl tiles
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl glow
f -4/-4/-1 -3/-3/-1 -2/-2/-1
o second
v 0 0 5
usemtl nowhere
f 1 2 5
";

const MTL: &str = "\
newmtl tiles
Kd 0.25
Ns 30
map_Kd -s 2 2 1 tiles.png
map_d mask.png
norm tiles.png
bump tiles.png
newmtl glow
Kd 0.1 0.2 0.3
Ke 5 6 7
d 0.75
";

fn write(folder: &Path, obj: &str, mtl: Option<&str>) -> Result<Imported, String> {
    std::fs::write(folder.join("a.obj"), obj).unwrap();
    let library = folder.join("lib.mtl");
    match mtl {
        Some(mtl) => std::fs::write(library, mtl).unwrap(),
        None => drop(std::fs::remove_file(library)),
    }
    std::fs::write(folder.join("tiles.png"), crate::support::png(&[[10, 20, 30, 40], [50, 60, 70, 80]]))
        .unwrap();
    std::fs::write(folder.join("mask.png"), crate::support::png(&[[255; 4], [0, 0, 0, 255]])).unwrap();
    load_scene(&folder.join("a.obj")).map_err(|error| {
        assert!(error.is_bad_input());
        error.to_string()
    })
}

fn load(obj: &str, mtl: Option<&str>) -> Result<Imported, String> {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), obj, mtl)
}

#[test]
fn meshes_and_objects_are_read() {
    let imported = load(OBJ, Some(MTL)).unwrap();
    let scene = &imported.scene;
    let placed: Vec<_> = scene.instances.iter().map(|i| (i.name.as_str(), i.object)).collect();
    assert_eq!(placed, [("first", 0), ("first", 0), ("second", 1)]);
    let quad = &scene.meshes[0];
    assert_eq!(quad.triangles.len(), 2, "a quad is two triangles");
    assert_eq!(quad.normals[0], Vec3::Z);
    assert_eq!(quad.uvs[0], Vec2::new(0.0, 1.0), "v points down");
    assert!((quad.tangents[0] - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6, "{}", quad.tangents[0]);
    let geometry = Geometry::new(scene);
    assert!(
        geometry.area_vector(3).normalize().dot(geometry.normals[geometry.triangles[3][0] as usize]) > 0.999
    );
}

#[test]
fn materials_are_read() {
    let scene = load(OBJ, Some(MTL)).unwrap().scene;
    let [tiles, glow, grey] = &scene.materials[..] else { panic!("{:?}", scene.materials) };
    assert_eq!(tiles.base_color, Vec4::new(0.25, 0.25, 0.25, 1.0));
    assert_eq!(tiles.roughness, 0.5, "(2 / 32)^(1/4)");
    assert_eq!(tiles.alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
    assert!(tiles.double_sided && tiles.metallic == 0.0);
    let base = tiles.base_color_texture.unwrap();
    assert_eq!(scene.textures[base.texture].texels, [[10, 20, 30, 255], [50, 60, 70, 0]], "alpha from map_d");
    assert_eq!(base.uv(Vec2::new(0.5, 1.0)), Vec2::new(1.0, 1.0), "scaled about the bottom left");
    assert_eq!(scene.textures[tiles.normal_texture.unwrap().texture].color_space, ColorSpace::Linear);
    assert_eq!(glow.emission, Vec3::new(5.0, 6.0, 7.0));
    assert_eq!((glow.base_color.w, glow.alpha_mode), (0.75, AlphaMode::Mask { cutoff: 0.5 }));
    assert_eq!(grey.base_color, Vec4::new(0.5, 0.5, 0.5, 1.0));
    assert_eq!(scene.meshes[2].material, 2);
}

#[test]
fn what_is_left_out_is_said() {
    let warnings = load(OBJ, Some(MTL)).unwrap().warnings;
    for expected in ["`nowhere`", "height map", "`glow` is transparent", "no camera"] {
        assert!(warnings.iter().any(|w| w.contains(expected)), "{expected} in {warnings:#?}");
    }
}

#[test]
fn a_missing_library_makes_everything_grey() {
    let imported = load(OBJ, None).unwrap();
    assert_eq!(imported.scene.materials.len(), 1);
    assert!(imported.warnings.iter().any(|w| w.contains("lib.mtl is missing")), "{:?}", imported.warnings);
}

#[test]
fn bad_files_are_errors_that_name_the_place() {
    let bad = |obj: &str, mtl: &str, expected: &str| {
        let error = load(obj, Some(mtl)).unwrap_err();
        assert!(error.contains(expected), "{expected}: {error}");
    };
    bad(&OBJ.replace("f 1 2 5", "f 1 2 6"), MTL, "a.obj: line 19: a face names vertex 6");
    bad(&OBJ.replace("v 1 1 0", "v 1 nan 0"), MTL, "not finite");
    bad("v 0 0 0\n", MTL, "no triangle");
    bad(OBJ, &MTL.replace("tiles.png", "absent.png"), "absent.png: cannot read");
    bad(OBJ, &MTL.replace("Ke 5", "Ke -5"), "lib.mtl: MTL material `glow`");
    bad(OBJ, &MTL.replace("Ns 30", "Ns thirty"), "lib.mtl: cannot be read as MTL");
}

#[test]
fn altered_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut state = 7_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let characters = b"0123456789-/ .\n\\\tvfondKe";
    for _ in 0..1500 {
        let mut files = [OBJ, MTL].map(|text| text.as_bytes().to_vec());
        for file in &mut files {
            for _ in 0..random(4) {
                let at = random(file.len());
                file[at] = characters[random(characters.len())];
            }
            let length = file.len() - if random(4) == 0 { random(file.len()) } else { 0 };
            file.truncate(length);
        }
        let [obj, mtl] = files.map(|file| String::from_utf8(file).unwrap());
        drop(write(folder.path(), &obj, Some(&mtl)));
    }
}
