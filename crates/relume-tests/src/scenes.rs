//! Small scenes made in code.

use std::f32::consts::{PI, TAU};
use std::path::Path;

use relume::glam::{Affine3A, Mat3, Vec2, Vec3};
use relume::scene::{Geometry, Instance, Material, Mesh, Texture};
use relume::trace::Accel;
use relume::{Camera, Light, LightKind, LightRig, Scene};

/// A scene under construction. Each shape is a mesh and an object of its own; its front is named at each method.
#[derive(Clone, Debug, Default)]
pub struct SceneBuilder {
    scene: Scene,
}

/// A scene that is ready to be traced.
#[derive(Debug)]
pub struct TestScene {
    /// As an importer would give it.
    pub scene: Scene,
    /// Flattened.
    pub geometry: Geometry,
    /// Over `geometry`.
    pub accel: Accel,
}

/// A purely diffuse material, one-sided.
pub fn lambertian(albedo: Vec3) -> Material {
    Material { base_color: albedo.extend(1.0), specular: 0.0, ..Material::default() }
}

/// A purely diffuse material that also shines; one-sided.
pub fn emissive(albedo: Vec3, emission: Vec3) -> Material {
    Material { emission, ..lambertian(albedo) }
}

/// A rig of these lights, named by their place, all enabled.
pub fn rig(lights: impl IntoIterator<Item = LightKind>) -> LightRig {
    let lights = lights.into_iter().enumerate();
    LightRig {
        exposure: 0.0,
        lights: lights.map(|(i, kind)| Light { name: format!("light {i}"), enabled: true, kind }).collect(),
        emitters: Vec::new(),
        materials: Vec::new(),
    }
}

/// An omni light.
pub fn omni(position: Vec3, intensity: Vec3, radius: f32) -> LightKind {
    LightKind::Omni { position, intensity, radius }
}

/// A point light that shines within a cone, `angles` are the inner and the outer one in degrees from the axis.
pub fn spot(position: Vec3, target: Vec3, intensity: Vec3, angles: (f32, f32)) -> LightKind {
    let (inner_angle, outer_angle) = angles;
    LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius: 0.0 }
}

/// A closed room of 4 x 3 x 5 metres with a box on its floor, all diffuse, seen from its back.
pub fn box_room() -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::new(0.7, 0.6, 0.5)));
    let block = builder.material(lambertian(Vec3::new(0.2, 0.4, 0.7)));
    builder
        .room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall)
        .block(Vec3::new(1.1, 0.0, 1.2), Vec3::new(2.1, 1.3, 2.2), block)
        .camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 1.2, 0.0), 55.0);
    builder.build()
}

/// A room with a floor of this material and a white and a red block on it.
pub fn hall(floor: Material) -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::new(0.7, 0.7, 0.65)));
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    let red = builder.material(lambertian(Vec3::new(0.7, 0.1, 0.05)));
    let floor = builder.material(floor);
    let up = 0.002 * Vec3::Y;
    builder
        .room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall)
        .quad(up, 5.0 * Vec3::Z, 4.0 * Vec3::X, floor)
        .block(Vec3::new(0.6, 0.0, 1.2), Vec3::new(1.3, 1.6, 1.9), white)
        .block(Vec3::new(2.2, 0.0, 0.8), Vec3::new(3.2, 0.9, 1.6), red)
        .camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 0.7, 0.0), 55.0);
    builder.build()
}

/// A metal of a warm colour.
pub fn metal(roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, specular: 1.0, ..lambertian(Vec3::new(0.9, 0.7, 0.5)) }
}

/// A closed room with nothing in it, of one diffuse material, seen from one of its corners.
pub fn empty_room(material: Material) -> TestScene {
    let mut builder = SceneBuilder::new();
    let material = builder.material(material);
    builder.room(Vec3::ZERO, Vec3::new(2.0, 2.0, 3.0), material).camera(
        Vec3::new(1.7, 1.6, 2.8),
        Vec3::new(0.8, 0.7, 0.0),
        60.0,
    );
    builder.build()
}

/// A floor at y = 0 seen from above.
pub fn floor(material: Material) -> TestScene {
    let mut builder = SceneBuilder::new();
    let material = builder.material(material);
    builder.quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material).camera(
        Vec3::new(0.0, 3.0, 4.0),
        Vec3::ZERO,
        40.0,
    );
    builder.build()
}

/// A court: a room without a ceiling, with a block and a metal ball, open to the sky.
pub fn court() -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::new(0.7, 0.6, 0.5)));
    let red = builder.material(lambertian(Vec3::new(0.7, 0.2, 0.1)));
    let ball = builder.material(metal(0.3));
    let (x, y, z) = (4.0 * Vec3::X, 2.0 * Vec3::Y, 5.0 * Vec3::Z);
    builder
        .quad(Vec3::ZERO, z, x, wall)
        .quad(Vec3::ZERO, x, y, wall)
        .quad(Vec3::ZERO, y, z, red)
        .quad(x + y, -y, z, wall)
        .block(Vec3::new(1.2, 0.0, 1.0), Vec3::new(2.0, 1.1, 1.8), red)
        .sphere(Vec3::new(2.9, 0.5, 2.2), 0.5, 24, false, ball)
        .camera(Vec3::new(2.0, 1.4, 4.9), Vec3::new(2.0, 0.6, 1.0), 60.0);
    builder.build()
}

/// The demo's scene.
///
/// # Panics
/// If it is not where it belongs in the repository.
pub fn arcade() -> TestScene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/arcade.glb");
    let scene = relume_io::load_scene(&path).expect("the demo's scene").scene;
    let geometry = Geometry::new(&scene);
    let accel = Accel::new(&scene, &geometry);
    TestScene { scene, geometry, accel }
}

/// A hollow ball of radius 1 around the origin, of one diffuse material, seen from inside.
pub fn integrating_sphere(material: Material) -> TestScene {
    let mut builder = SceneBuilder::new();
    let material = builder.material(material);
    builder.sphere(Vec3::ZERO, 1.0, 32, true, material).camera(Vec3::new(0.0, 0.1, 0.5), Vec3::ZERO, 70.0);
    builder.build()
}

impl SceneBuilder {
    /// An empty scene.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a material; returns its index.
    pub fn material(&mut self, material: Material) -> usize {
        self.scene.materials.push(material);
        self.scene.materials.len() - 1
    }

    /// Adds a pinhole camera at `position` that looks at `target`; the field of view is vertical, in degrees.
    pub fn camera(&mut self, position: Vec3, target: Vec3, fov: f32) -> &mut Self {
        let forward = (target - position).normalize();
        let up = if forward.y.abs() > 0.99 { Vec3::Z } else { Vec3::Y };
        let right = forward.cross(up).normalize();
        let axes = Mat3::from_cols(right, right.cross(forward), -forward);
        self.scene.cameras.push(Camera {
            name: format!("camera {}", self.scene.cameras.len()),
            world_from_camera: Affine3A::from_mat3_translation(axes, position),
            vertical_fov: fov.to_radians(),
        });
        self
    }

    /// Adds a mesh with normals where it stands.
    pub fn mesh(&mut self, mesh: Mesh) -> &mut Self {
        let index = self.scene.meshes.len();
        self.scene.instances.push(Instance {
            name: format!("object {index}"),
            mesh: index,
            world_from_object: Affine3A::IDENTITY,
            object: index as u32,
        });
        self.scene.meshes.push(mesh);
        self
    }

    /// A parallelogram; its front is towards `edge_u x edge_v`.
    pub fn quad(&mut self, corner: Vec3, edge_u: Vec3, edge_v: Vec3, material: usize) -> &mut Self {
        self.mesh(Mesh {
            positions: vec![corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v],
            normals: vec![edge_u.cross(edge_v).normalize(); 4],
            uvs: vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material,
            ..Mesh::default()
        })
    }

    /// A regular polygon of `segments` corners on a circle; its front is towards `normal`.
    pub fn disc(
        &mut self,
        center: Vec3,
        normal: Vec3,
        radius: f32,
        segments: u32,
        material: usize,
    ) -> &mut Self {
        let normal = normal.normalize();
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let rim = (0..segments).map(|i| {
            let (y, x) = (TAU * i as f32 / segments as f32).sin_cos();
            center + radius * (tangent * x + bitangent * y)
        });
        let positions: Vec<_> = std::iter::once(center).chain(rim).collect();
        let handedness = tangent.cross(bitangent).dot(normal);
        let triangles = (0..segments)
            .map(|i| (1 + i, 1 + (i + 1) % segments))
            .map(|(a, b)| if handedness > 0.0 { [0, a, b] } else { [0, b, a] })
            .collect();
        self.mesh(Mesh {
            normals: vec![normal; positions.len()],
            positions,
            triangles,
            material,
            ..Mesh::default()
        })
    }

    /// A sphere of `2 * segments` by `segments` faces with smooth normals; its front is outside, or inside where
    /// `inward`.
    pub fn sphere(
        &mut self,
        center: Vec3,
        radius: f32,
        segments: u32,
        inward: bool,
        material: usize,
    ) -> &mut Self {
        let columns = 2 * segments;
        let mut mesh = Mesh { material, ..Mesh::default() };
        for row in 0..=segments {
            for column in 0..=columns {
                let (sin, cos) = (PI * row as f32 / segments as f32).sin_cos();
                let (y, x) = (TAU * column as f32 / columns as f32).sin_cos();
                let outward = Vec3::new(sin * x, cos, sin * y);
                mesh.positions.push(center + radius * outward);
                mesh.normals.push(if inward { -outward } else { outward });
                mesh.uvs.push(Vec2::new(column as f32 / columns as f32, row as f32 / segments as f32));
            }
        }
        for row in 0..segments {
            for column in 0..columns {
                let a = row * (columns + 1) + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns + 2);
                for [a, b, c] in [[a, b, c], [b, d, c]] {
                    mesh.triangles.push(if inward { [a, c, b] } else { [a, b, c] });
                }
            }
        }
        self.mesh(mesh)
    }

    /// A closed axis-aligned box from `min` to `max`, its front inside.
    pub fn room(&mut self, min: Vec3, max: Vec3, material: usize) -> &mut Self {
        let size = max - min;
        let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
        self.quad(min, z, x, material)
            .quad(min, x, y, material)
            .quad(min, y, z, material)
            .quad(max, -x, -z, material)
            .quad(max, -y, -x, material)
            .quad(max, -z, -y, material)
    }

    /// A block that stands on a floor: an axis-aligned box without a bottom, its front outside.
    pub fn block(&mut self, min: Vec3, max: Vec3, material: usize) -> &mut Self {
        let size = max - min;
        let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
        self.quad(min, y, x, material)
            .quad(min, z, y, material)
            .quad(max, -z, -x, material)
            .quad(max, -x, -y, material)
            .quad(max, -y, -z, material)
    }

    /// Adds a texture; returns its index.
    pub fn texture(&mut self, texture: Texture) -> usize {
        self.scene.textures.push(texture);
        self.scene.textures.len() - 1
    }

    /// The scene, flattened and ready to be traced.
    pub fn build(self) -> TestScene {
        let scene = self.scene;
        let geometry = Geometry::new(&scene);
        let accel = Accel::new(&scene, &geometry);
        TestScene { scene, geometry, accel }
    }
}

#[cfg(test)]
mod tests {
    use super::{SceneBuilder, lambertian};
    use relume::glam::Vec3;
    use relume::trace::Ray;

    /// All shapes show their fronts where their docs say.
    #[test]
    fn fronts_face_as_said() {
        let mut builder = SceneBuilder::new();
        let material = builder.material(lambertian(Vec3::ONE));
        builder
            .sphere(Vec3::ZERO, 1.0, 16, false, material)
            .sphere(Vec3::ZERO, 1.5, 16, true, material)
            .room(Vec3::splat(-2.0), Vec3::splat(2.0), material)
            .block(Vec3::new(3.0, -1.0, -1.0), Vec3::new(5.0, 1.0, 1.0), material);
        let built = builder.build();
        for (i, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
            for direction in [axis, -axis] {
                let side = Vec3::new(0.011, 0.007, 0.013);
                for (from, front) in [(0.0, false), (1.2, true), (1.7, true)] {
                    let ray = Ray::new(side + direction * from, direction);
                    let hit = built.accel.closest(&ray);
                    let towards = built.geometry.area_vector(hit.triangle as usize).dot(direction) < 0.0;
                    assert_eq!(towards, front, "axis {i}, from {from}");
                }
            }
        }
        let block = Vec3::new(4.01, 0.02, 0.03);
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Z] {
            // from inside the block its backs are seen
            let hit = built.accel.closest(&Ray::new(block, axis));
            assert!(
                hit.is_hit() && built.geometry.area_vector(hit.triangle as usize).dot(axis) > 0.0,
                "{axis}"
            );
        }
        for normal in [Vec3::X, Vec3::NEG_Y, Vec3::new(1.0, 2.0, -3.0)] {
            let mut builder = SceneBuilder::new();
            let material = builder.material(lambertian(Vec3::ONE));
            builder.disc(Vec3::ZERO, normal, 1.0, 9, material);
            let built = builder.build();
            assert!(built.geometry.area_vector(4).normalize().abs_diff_eq(normal.normalize(), 1e-5));
        }
    }
}
