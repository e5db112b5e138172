//! glTF 2.0 to a scene. The parsed JSON is read as plain data; every index and range is checked here.

mod accessor;
mod camera_light;
mod document;
mod material;
mod nodes;
mod primitive;
mod texture;
mod transmission;
mod uri;

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use ::gltf::json::Index;
use ::gltf::json::mesh::Primitive;
use rayon::prelude::*;
use relume::scene::{Instance, Mesh};
use relume::{LightRig, Result, Scene};

use crate::import::Imported;
use document::Document;
use material::Materials;
use nodes::{MeshNode, Nodes};

/// The most instances of primitives one file may ask for.
const MOST_INSTANCES: usize = 1 << 24;

/// Which mesh of the scene holds each converted primitive; `None` where nothing of it is left.
type MeshOfPrimitive = HashMap<(usize, usize), Option<usize>>;

/// Reads a `.glb` or `.gltf` file, told apart by its first bytes.
pub(crate) fn load(path: &Path) -> Result<Imported> {
    let mut warnings = Vec::new();
    let document = Document::open(path, &mut warnings)?;
    let nodes = nodes::walk(&document, &mut warnings)?;

    let used: BTreeSet<usize> = nodes.meshes.iter().map(|node| node.mesh).collect();
    let primitives: Vec<(usize, usize)> = used
        .iter()
        .flat_map(|&mesh| (0..document.root.meshes[mesh].primitives.len()).map(move |p| (mesh, p)))
        .collect();
    check_size(&document, &primitives, &nodes.meshes)?;

    let mut materials = Materials::new(&document);
    let material_of: Vec<usize> = primitives
        .iter()
        .map(|&at| materials.request(primitive_at(&document, at).material.map(|m| m.value()), &mut warnings))
        .collect::<Result<_>>()?;
    let (meshes, mesh_of) = convert(&document, &primitives, &material_of, &materials, &mut warnings)?;
    let (materials, textures) = materials.finish(&mut warnings)?;

    let Nodes { meshes: mesh_nodes, cameras, lights } = nodes;
    let instances = place(&document, &mesh_nodes, &mesh_of);
    let lights = LightRig { lights, ..LightRig::default() };
    Ok(Imported { scene: Scene { meshes, instances, materials, textures, cameras, lights }, warnings })
}

fn primitive_at<'a>(document: &'a Document<'_>, (mesh, primitive): (usize, usize)) -> &'a Primitive {
    &document.root.meshes[mesh].primitives[primitive]
}

/// Refuses files whose few bytes ask for immense scenes by naming the same things again and again.
fn check_size(document: &Document<'_>, primitives: &[(usize, usize)], nodes: &[MeshNode]) -> Result<()> {
    let elements: u64 = primitives
        .iter()
        .map(|&at| primitive::element_count(document, primitive_at(document, at)))
        .fold(0, u64::saturating_add);
    if elements > primitive::MOST_ELEMENTS {
        return Err(document.fail(format!(
            "meshes ask for {elements} vertices and indices, more than {}; split the scene",
            primitive::MOST_ELEMENTS
        )));
    }
    let instances: usize = nodes.iter().map(|node| document.root.meshes[node.mesh].primitives.len()).sum();
    if instances > MOST_INSTANCES {
        return Err(document.fail(format!("nodes ask for {instances} instances, more than {MOST_INSTANCES}")));
    }
    Ok(())
}

/// Converts primitives side by side; meshes, warnings and the first error come in the file's order.
fn convert(
    document: &Document<'_>,
    primitives: &[(usize, usize)],
    material_of: &[usize],
    materials: &Materials<'_>,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Mesh>, MeshOfPrimitive)> {
    let converted: Vec<_> = primitives
        .par_iter()
        .zip(material_of)
        .map(|(&at, &material)| primitive::convert(document, at, material, materials.coordinates(material)))
        .collect();
    let mut meshes = Vec::new();
    let mut mesh_of = HashMap::new();
    for (&at, built) in primitives.iter().zip(converted) {
        let built = built.map_err(|message| document.fail(message))?;
        warnings.extend(built.warnings);
        let slot = built.mesh.map(|mesh| {
            meshes.push(mesh);
            meshes.len() - 1
        });
        mesh_of.insert(at, slot);
    }
    Ok((meshes, mesh_of))
}

/// One instance per node and primitive; a node is one object.
fn place(document: &Document<'_>, nodes: &[MeshNode], mesh_of: &MeshOfPrimitive) -> Vec<Instance> {
    let mut instances = Vec::new();
    for (object, node) in nodes.iter().enumerate() {
        for primitive in 0..document.root.meshes[node.mesh].primitives.len() {
            if let Some(&Some(mesh)) = mesh_of.get(&(node.mesh, primitive)) {
                instances.push(Instance {
                    name: node.name.clone(),
                    mesh,
                    world_from_object: node.world_from_object,
                    object: object as u32,
                });
            }
        }
    }
    instances
}

/// "`name`" or "3", for messages.
fn label<T>(index: Index<T>, name: Option<&String>) -> String {
    match name {
        Some(name) if !name.is_empty() => format!("`{name}`"),
        _ => index.value().to_string(),
    }
}
