//! Surfaces of a small quad.

use glam::{Affine3A, Vec2, Vec3, Vec4};

use super::{MIN_ROUGHNESS, surface_at, surface_on_triangle};
use crate::scene::{ColorSpace, Geometry, Instance, Material, Mesh, Scene, Texture, TextureRef, Wrap};
use crate::trace::{Accel, Ray};

/// A unit square in the plane z = 0, its front towards +z, its image upright when seen from there.
fn square(material: Material, texel: [u8; 4], tangents: Vec<Vec4>) -> (Scene, Geometry) {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let mesh = Mesh {
        positions: corners.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect(),
        normals: vec![Vec3::Z; 4],
        uvs: corners.iter().map(|&(x, y)| Vec2::new(x, 1.0 - y)).collect(),
        tangents,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let scene = Scene {
        meshes: vec![mesh],
        instances: vec![Instance {
            name: String::new(),
            mesh: 0,
            world_from_object: Affine3A::IDENTITY,
            object: 5,
        }],
        materials: vec![material],
        textures: vec![Texture {
            name: String::new(),
            width: 1,
            height: 1,
            texels: vec![texel],
            color_space: ColorSpace::Linear,
            wrap: [Wrap::Repeat; 2],
        }],
        ..Scene::default()
    };
    let geometry = Geometry::new(&scene);
    (scene, geometry)
}

#[test]
fn material_becomes_surface() {
    let material = Material {
        base_color: Vec4::new(0.8, 0.6, 0.4, 1.0),
        metallic: 0.5,
        roughness: 0.5,
        metallic_roughness_texture: Some(TextureRef::new(0)),
        emission: Vec3::new(1.0, 2.0, 3.0),
        ..Material::default()
    };
    let (scene, geometry) = square(material, [255, 51, 255, 255], Vec::new());
    let surface = surface_on_triangle(&scene, &geometry, 0, 0.5, 0.25, true);
    assert!(surface.position.abs_diff_eq(Vec3::new(0.75, 0.25, 0.0), 1e-6));
    assert!(surface.diffuse_albedo.abs_diff_eq(Vec3::new(0.4, 0.3, 0.2), 1e-6));
    assert!(surface.specular_f0.abs_diff_eq(Vec3::new(0.42, 0.32, 0.22), 1e-6));
    assert!((surface.roughness - 0.1).abs() < 1e-6, "G of the texture scales roughness");
    assert_eq!(surface.emission, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((surface.object, surface.specular_f90, surface.lit), (5, 1.0, true));
}

#[test]
fn backs_of_one_sided_surfaces_are_dead() {
    for double_sided in [false, true] {
        let material = Material { emission: Vec3::ONE, double_sided, roughness: 0.0, ..Material::default() };
        let (scene, geometry) = square(material, [0; 4], Vec::new());
        let accel = Accel::new(&scene, &geometry);
        let ray = Ray::new(Vec3::new(0.2, 0.7, -1.0), Vec3::Z);
        let surface = surface_at(&scene, &geometry, &accel.closest(&ray), ray.direction);
        assert_eq!((surface.geometric_normal, surface.shading_normal), (Vec3::NEG_Z, Vec3::NEG_Z));
        assert_eq!(surface.lit, double_sided);
        assert_eq!(surface.emission != Vec3::ZERO, double_sided);
        assert_eq!(surface.hemispherical_reflectance() != Vec3::ZERO, double_sided);
        if double_sided {
            assert_eq!(surface.roughness, MIN_ROUGHNESS);
        }
    }
}

/// The map leans right and up; with tangents and without them the answer is the same.
#[test]
fn normal_map_leans_the_shading_normal() {
    let tangent = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
    for tangents in [tangent, Vec::new(), vec![Vec4::ZERO; 4]] {
        let material = Material { normal_texture: Some(TextureRef::new(0)), ..Material::default() };
        let (scene, geometry) = square(material, [191, 159, 223, 255], tangents);
        let surface = surface_on_triangle(&scene, &geometry, 1, 0.2, 0.2, true);
        let expected = Vec3::new(127.0, 63.0, 191.0).normalize();
        assert!(surface.shading_normal.abs_diff_eq(expected, 1e-5), "{}", surface.shading_normal);
        assert_eq!(surface.geometric_normal, Vec3::Z);
        let back = surface_on_triangle(&scene, &geometry, 1, 0.2, 0.2, false);
        assert!(back.shading_normal.abs_diff_eq(-expected, 1e-5));
    }
}

#[test]
fn normals_turned_away_are_brought_into_view() {
    let material = Material { normal_texture: Some(TextureRef::new(0)), ..Material::default() };
    let (scene, geometry) = square(material, [255, 128, 140, 255], Vec::new());
    let accel = Accel::new(&scene, &geometry);
    let direction = Vec3::new(1.0, 0.0, -0.2);
    let ray = Ray::new(Vec3::new(0.5, 0.5, 0.0) - direction, direction);
    let surface = surface_at(&scene, &geometry, &accel.closest(&ray), direction);
    let cos = surface.shading_normal.dot(-direction.normalize());
    assert!(cos > 0.0 && cos < 0.05, "just in view: {cos}");
    assert!(surface.shading_normal.is_normalized());
    // seen from the other side nothing needs turning
    let ray = Ray::new(Vec3::new(1.5, 0.5, 0.2), Vec3::new(-1.0, 0.0, -0.2));
    let surface = surface_at(&scene, &geometry, &accel.closest(&ray), ray.direction);
    assert!(surface.shading_normal.x > 0.9);
}
