//! From a scene file to a [`Scene`], with what every format needs afterwards.

use std::path::Path;

use relume::glam::{Affine3A, Mat3, Vec3};
use relume::{Camera, Error, Result, Scene};

/// A scene and what its file asked for that it does not have.
#[derive(Clone, Debug)]
pub struct Imported {
    /// At least one triangle and one camera.
    pub scene: Scene,
    /// One sentence each, in no order of importance.
    pub warnings: Vec<String>,
}

/// The vertical field of view of a camera made for a file without one, radians.
const MADE_CAMERA_FOV: f32 = std::f32::consts::FRAC_PI_4;

/// From the scene's centre to a made camera: from the front, to the right of it and a little above.
const MADE_CAMERA_SIDE: Vec3 = Vec3::new(0.8, 0.5, 1.0);

/// The largest coordinate, metres, whose square and cube are still numbers in `f32`.
const LARGEST_COORDINATE: f32 = 1e12;

/// The most bytes one file may have.
const LARGEST_FILE: u64 = 16 << 30;

/// Reads the scene at `path`: glTF 2.0 (`.glb`, `.gltf` with files beside it or data URIs) or Wavefront
/// OBJ with MTL (`.obj`).
///
/// Units: glTF is metres; its photometric numbers (candela, lux) are taken as scene-linear radiant ones,
/// W/sr and W/m^2, without the factor 683. OBJ has no unit and is taken as metres. Lights in the file fall
/// off with `1/r^2` alone: `range` is left out.
///
/// What is read: node hierarchies, instances, triangles, strips and fans, metallic-roughness materials with
/// base colour, normal, metallic-roughness and emissive textures, alpha masks, `KHR_texture_transform`,
/// `KHR_materials_emissive_strength`, `KHR_lights_punctual`, `KHR_mesh_quantization`, perspective cameras. Occlusion
/// textures are left out, because occlusion is computed. Skins, morph targets and animations are left in their rest pose. A primitive
/// without a material is a white rough dielectric ([`relume::scene::Material::default`]), where glTF would have a metal.
///
/// A file without a camera gets one that frames the scene, and a warning that says so.
///
/// # Errors
///
/// [`Error::Io`] where the file cannot be read, [`Error::File`] with the place and the mend where it is
/// malformed, needs an unsupported extension, refers to a missing file or holds no triangle.
pub fn load_scene(path: &Path) -> Result<Imported> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let imported = match extension.as_str() {
        "glb" | "gltf" => crate::gltf::load(path)?,
        "obj" => crate::obj::load(path)?,
        "" => {
            return Err(Error::file(path, "a scene's name must end in .glb, .gltf or .obj"));
        }
        other => {
            return Err(Error::file(
                path,
                format!("`.{other}` files cannot be imported; convert the scene to .glb, .gltf or .obj"),
            ));
        }
    };
    finish(path, imported)
}

/// The contents of a regular file of sane size.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, "read", e))?;
    if !metadata.is_file() {
        return Err(Error::file(path, "is not a regular file"));
    }
    if metadata.len() > LARGEST_FILE {
        return Err(Error::file(path, format!("is larger than {} GiB; split it", LARGEST_FILE >> 30)));
    }
    std::fs::read(path).map_err(|e| Error::io(path, "read", e))
}

/// Checks what holds for a scene of any format, and adds a camera where there is none.
fn finish(path: &Path, mut imported: Imported) -> Result<Imported> {
    let scene = &imported.scene;
    let of_instances = |count: fn(&relume::scene::Mesh) -> usize| -> u64 {
        scene.instances.iter().map(|instance| count(&scene.meshes[instance.mesh]) as u64).sum()
    };
    let triangles = of_instances(|mesh| mesh.triangles.len());
    if triangles == 0 {
        return Err(Error::file(
            path,
            "holds no triangle that can be used; export the meshes with the scene",
        ));
    }
    let vertices = of_instances(|mesh| mesh.positions.len());
    if vertices.max(triangles) >= u64::from(u32::MAX) {
        return Err(Error::file(
            path,
            format!("has {triangles} triangles with all instances counted; at most {} can be held", u32::MAX),
        ));
    }
    let (low, high) = bounds(path, scene)?;
    if scene.cameras.is_empty() {
        let camera = framing_camera(low, high);
        let at = camera.position();
        imported.warnings.push(format!(
            "no camera in the file: one was made at ({:.3}, {:.3}, {:.3}) that frames the whole scene",
            at.x, at.y, at.z
        ));
        imported.scene.cameras.push(camera);
    }
    Ok(imported)
}

/// The world-space box round all instances.
fn bounds(path: &Path, scene: &Scene) -> Result<(Vec3, Vec3)> {
    let mut total = (Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY));
    for instance in &scene.instances {
        let (mut low, mut high) = total;
        let mut sum = Vec3::ZERO;
        for &position in &scene.meshes[instance.mesh].positions {
            let world = instance.world_from_object.transform_point3(position);
            sum += world; // keeps a NaN, which min and max lose
            low = low.min(world);
            high = high.max(world);
        }
        let largest = low.abs().max(high.abs()).max_element();
        if sum.is_nan() || largest > LARGEST_COORDINATE {
            return Err(Error::file(
                path,
                format!(
                    "`{}` reaches further than {LARGEST_COORDINATE:e} m; mend its transform or scale",
                    instance.name
                ),
            ));
        }
        total = (low, high);
    }
    Ok(total)
}

/// A camera outside the box that sees all of its bounding sphere.
fn framing_camera(low: Vec3, high: Vec3) -> Camera {
    let center = 0.5 * (low + high);
    let radius = 0.5 * (high - low).length();
    let back = MADE_CAMERA_SIDE.normalize();
    let distance = radius / (0.5 * MADE_CAMERA_FOV).sin();
    let right = Vec3::Y.cross(back).normalize();
    let rotation = Mat3::from_cols(right, back.cross(right), back);
    Camera {
        name: "default".to_owned(),
        world_from_camera: Affine3A::from_mat3_translation(rotation, center + distance * back),
        vertical_fov: MADE_CAMERA_FOV,
    }
}

/// `wanted`, or the first of `wanted_2`, `wanted_3`, ... that `taken` does not hold yet; added to `taken`.
pub(crate) fn unique_name(wanted: &str, taken: &mut std::collections::HashSet<String>) -> String {
    let mut name = wanted.to_owned();
    let mut number = 2_usize;
    while !taken.insert(name.clone()) {
        name = format!("{wanted}_{number}");
        number += 1;
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn made_camera_sees_every_corner() {
        let (low, high) = (Vec3::new(-3.0, 1.0, 4.0), Vec3::new(9.0, 2.0, 5.0));
        let camera = framing_camera(low, high);
        let camera_from_world = camera.world_from_camera.inverse();
        let tangent = (0.5 * camera.vertical_fov).tan();
        let inside = |p: Vec3, tangent: f32| {
            let p = camera_from_world.transform_point3(p);
            p.z < 0.0 && p.x.abs() <= -p.z * tangent && p.y.abs() <= -p.z * tangent
        };
        let mut corners = (0..8).map(|i| {
            let pick = |bit: i32, axis: usize| if i & bit == 0 { low[axis] } else { high[axis] };
            Vec3::new(pick(1, 0), pick(2, 1), pick(4, 2))
        });
        assert!(corners.clone().all(|p| inside(p, tangent)));
        assert!(!corners.all(|p| inside(p, 0.2 * tangent)), "a narrow view must not hold the scene");
        assert!(camera.world_from_camera.matrix3.determinant() > 0.999);
    }

    #[test]
    fn names_become_unique() {
        let mut taken = std::collections::HashSet::new();
        let names = ["a", "a", "a_2", "a"].map(|wanted| unique_name(wanted, &mut taken));
        assert_eq!(names, ["a", "a_2", "a_2_2", "a_3"]);
    }
}
