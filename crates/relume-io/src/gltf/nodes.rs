//! The node hierarchy: where meshes, cameras and lights stand in the world.

use std::collections::HashSet;

use ::gltf::json::Index;
use ::gltf::json::scene::Node;
use relume::Result;
use relume::glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, Mat3, Vec3};
use relume::{Camera, Light};

use super::camera_light;
use super::document::Document;
use crate::import::unique_name;

/// A node with a mesh: one object of the scene.
#[derive(Debug)]
pub(super) struct MeshNode {
    pub(super) name: String,
    /// Index into the file's meshes.
    pub(super) mesh: usize,
    pub(super) world_from_object: Affine3A,
}

/// All that the scene's nodes place in the world.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    pub(super) meshes: Vec<MeshNode>,
    pub(super) cameras: Vec<Camera>,
    pub(super) lights: Vec<Light>,
}

/// Names in use, and what is said once for all lights.
#[derive(Default)]
struct Seen {
    cameras: HashSet<String>,
    lights: HashSet<String>,
    ranges: usize,
}

/// Walks the default scene, or the first one, depth first in the file's order. The depth has no limit.
pub(super) fn walk(document: &Document<'_>, warnings: &mut Vec<String>) -> Result<Nodes> {
    let root = &document.root;
    let scene = root.scene.map_or(0, |scene| scene.value());
    let scene = root
        .scenes
        .get(scene)
        .ok_or_else(|| document.fail("has no scene; export the scene with its nodes"))?;
    let mut nodes = Nodes::default();
    let mut seen = Seen::default();
    let mut reached = vec![false; root.nodes.len()];
    let mut stack: Vec<(Index<Node>, DAffine3)> =
        scene.nodes.iter().rev().map(|&node| (node, DAffine3::IDENTITY)).collect();
    while let Some((index, world_from_parent)) = stack.pop() {
        let (Some(node), Some(reached)) = (root.nodes.get(index.value()), reached.get_mut(index.value()))
        else {
            return Err(document.fail(format!("names node {index}, which does not exist")));
        };
        let label = super::label(index, node.name.as_ref());
        if std::mem::replace(reached, true) {
            return Err(document.fail(format!(
                "node {label} is its own ancestor or has two parents; give every node one parent"
            )));
        }
        let parent_from_node =
            local_transform(node).map_err(|message| document.fail(format!("node {label}: {message}")))?;
        let world_from_node = world_from_parent * parent_from_node;
        add_node(document, node, index, world_from_node, (&mut nodes, &mut seen), warnings)
            .map_err(|message| document.fail(format!("node {label}: {message}")))?;
        let children = node.children.as_deref().unwrap_or_default();
        stack.extend(children.iter().rev().map(|&child| (child, world_from_node)));
    }
    if seen.ranges > 0 {
        warnings.push(format!(
            "{} lights have a `range`, which is left out: light falls off with 1/r^2 alone",
            seen.ranges
        ));
    }
    Ok(nodes)
}

/// The node's `matrix`, or its translation, rotation and scale.
fn local_transform(node: &Node) -> Result<DAffine3, String> {
    let transform = if let Some(m) = node.matrix.map(|m| m.map(f64::from)) {
        if [m[3], m[7], m[11]] != [0.0; 3] || m[15] != 1.0 {
            return Err("its matrix is not affine: the last row must be 0 0 0 1".to_owned());
        }
        DAffine3 {
            matrix3: DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]),
            translation: DVec3::new(m[12], m[13], m[14]),
        }
    } else {
        let vector = |v: Option<[f32; 3]>, default: f64| {
            v.map_or(DVec3::splat(default), |v| DVec3::from_array(v.map(f64::from)))
        };
        let rotation = DQuat::from_array(node.rotation.unwrap_or_default().0.map(f64::from));
        let length = rotation.length();
        if !(length > 0.0 && length.is_finite()) {
            return Err("its rotation is not a quaternion of unit length".to_owned());
        }
        let (scale, translation) = (vector(node.scale, 1.0), vector(node.translation, 0.0));
        DAffine3::from_scale_rotation_translation(scale, rotation / length, translation)
    };
    if transform.is_finite() {
        Ok(transform)
    } else {
        Err("its transform has a number that is not finite".to_owned())
    }
}

fn add_node(
    document: &Document<'_>,
    node: &Node,
    index: Index<Node>,
    world_from_node: DAffine3,
    (nodes, seen): (&mut Nodes, &mut Seen),
    warnings: &mut Vec<String>,
) -> Result<(), String> {
    let given = node.name.clone().filter(|name| !name.is_empty());
    if let Some(mesh) = node.mesh {
        let name = given.clone().unwrap_or_else(|| format!("node {index}"));
        let world_from_object = world_from_node.as_affine3a();
        if is_invertible(&world_from_object) {
            nodes.meshes.push(MeshNode { name, mesh: mesh.value(), world_from_object });
        } else {
            warnings.push(format!("the mesh of node `{name}` is scaled to nothing and was left out"));
        }
    }
    if let Some(camera) = node.camera.and_then(|camera| document.root.get(camera)) {
        let name = given.clone().or_else(|| camera.name.clone()).unwrap_or_else(|| "camera".to_owned());
        if let Some(mut camera) = camera_light::camera(camera, rigid(&world_from_node)?, &name, warnings)? {
            camera.name = unique_name(&name, &mut seen.cameras);
            nodes.cameras.push(camera);
        }
    }
    let light = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
    if let Some(light) = light.and_then(|light| document.root.get(light.light)) {
        let name = given.or_else(|| light.name.clone()).unwrap_or_else(|| "light".to_owned());
        let kind = camera_light::light_kind(light, rigid(&world_from_node)?)?;
        seen.ranges += usize::from(light.range.is_some());
        nodes.lights.push(Light { name: unique_name(&name, &mut seen.lights), enabled: true, kind });
    }
    Ok(())
}

/// Whether normals can be carried by the inverse transpose.
fn is_invertible(transform: &Affine3A) -> bool {
    let determinant = transform.matrix3.determinant();
    determinant != 0.0 && determinant.is_finite() && transform.matrix3.inverse().is_finite()
}

/// Rotation and translation alone: -Z is kept, Y as far as it is perpendicular to it, and mirroring is not.
fn rigid(world_from_node: &DAffine3) -> Result<Affine3A, String> {
    let scaled_away = || "its camera or light is scaled to nothing; give it a scale of 1".to_owned();
    let back = world_from_node.matrix3.z_axis.try_normalize().ok_or_else(scaled_away)?;
    let right = world_from_node.matrix3.y_axis.cross(back).try_normalize().ok_or_else(scaled_away)?;
    let up = back.cross(right);
    let columns = [right, up, back].map(|axis| axis.as_vec3());
    let translation: Vec3 = world_from_node.translation.as_vec3();
    if !translation.is_finite() {
        return Err("its place is not finite".to_owned());
    }
    Ok(Affine3A::from_mat3_translation(Mat3::from_cols(columns[0], columns[1], columns[2]), translation))
}
