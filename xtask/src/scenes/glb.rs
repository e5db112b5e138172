//! Writes a binary glTF 2.0 file.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use glam::Vec3;
use serde_json::{Value, json};

use super::mesh::Mesh;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// A file in the making. Everything added is named by its index in the file.
#[derive(Default)]
pub(crate) struct Glb {
    binary: Vec<u8>,
    buffer_views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    textures: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    cameras: Vec<Value>,
}

fn push(list: &mut Vec<Value>, value: Value) -> usize {
    list.push(value);
    list.len() - 1
}

impl Glb {
    fn buffer_view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.binary.extend_from_slice(bytes);
        push(&mut self.buffer_views, view)
    }

    fn floats(&mut self, values: impl Iterator<Item = f32>, kind: &str, count: usize) -> usize {
        let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
        let view = self.buffer_view(&bytes, Some(ARRAY_BUFFER));
        push(
            &mut self.accessors,
            json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": kind}),
        )
    }

    fn indices(&mut self, mesh: &Mesh) -> usize {
        let indices = mesh.triangles.as_flattened();
        let short = mesh.vertices.len() < usize::from(u16::MAX);
        let bytes: Vec<u8> = if short {
            indices.iter().flat_map(|&index| (index as u16).to_le_bytes()).collect()
        } else {
            indices.iter().flat_map(|&index| index.to_le_bytes()).collect()
        };
        let view = self.buffer_view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        let kind = if short { UNSIGNED_SHORT } else { UNSIGNED_INT };
        let accessor =
            json!({"bufferView": view, "componentType": kind, "count": indices.len(), "type": "SCALAR"});
        push(&mut self.accessors, accessor)
    }

    /// Adds a PNG, repeated in both directions.
    pub(crate) fn texture(&mut self, name: &str, png: &[u8]) -> usize {
        let view = self.buffer_view(png, None);
        let image =
            push(&mut self.images, json!({"name": name, "bufferView": view, "mimeType": "image/png"}));
        push(&mut self.textures, json!({"name": name, "sampler": 0, "source": image}))
    }

    /// Adds a material written as in the file.
    pub(crate) fn material(&mut self, material: Value) -> usize {
        push(&mut self.materials, material)
    }

    /// Adds a mesh of one primitive a (mesh, material) pair.
    pub(crate) fn mesh(&mut self, name: &str, parts: &[(&Mesh, usize)]) -> usize {
        let primitives: Vec<Value> = parts
            .iter()
            .map(|&(mesh, material)| {
                let count = mesh.vertices.len();
                let vertices = || mesh.vertices.iter();
                let positions = self.floats(vertices().flat_map(|v| v.position.to_array()), "VEC3", count);
                let first = mesh.vertices.first().map_or(Vec3::ZERO, |v| v.position);
                let lo = vertices().fold(first, |lo, v| lo.min(v.position));
                let hi = vertices().fold(first, |hi, v| hi.max(v.position));
                self.accessors[positions]["min"] = json!(lo.to_array());
                self.accessors[positions]["max"] = json!(hi.to_array());
                let normals = self.floats(vertices().flat_map(|v| v.normal.to_array()), "VEC3", count);
                let uvs = self.floats(vertices().flat_map(|v| v.uv.to_array()), "VEC2", count);
                let attributes = json!({"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs});
                json!({"attributes": attributes, "indices": self.indices(mesh), "material": material})
            })
            .collect();
        push(&mut self.meshes, json!({"name": name, "primitives": primitives}))
    }

    /// Adds a node that shows `mesh` at `translation`, metres.
    pub(crate) fn node(&mut self, name: &str, mesh: usize, translation: Vec3) -> usize {
        push(&mut self.nodes, json!({"name": name, "mesh": mesh, "translation": translation.to_array()}))
    }

    /// Turns a node about the Y axis, radians.
    pub(crate) fn turn(&mut self, node: usize, angle: f32) {
        self.nodes[node]["rotation"] = json!([0.0, libm::sinf(0.5 * angle), 0.0, libm::cosf(0.5 * angle)]);
    }

    /// Adds a camera node at `eye` that looks at `target` with a vertical field of view in radians.
    pub(crate) fn camera(&mut self, name: &str, eye: Vec3, target: Vec3, vertical_fov: f32) {
        let back = (eye - target).normalize();
        let right = Vec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let camera = push(
            &mut self.cameras,
            json!({
                "name": name,
                "type": "perspective",
                "perspective": {"yfov": vertical_fov, "znear": 0.05, "zfar": 100.0, "aspectRatio": 16.0 / 9.0},
            }),
        );
        let columns = [right.extend(0.0), up.extend(0.0), back.extend(0.0), eye.extend(1.0)];
        let matrix: Vec<f32> = columns.iter().flat_map(|column| column.to_array()).collect();
        push(&mut self.nodes, json!({"name": name, "camera": camera, "matrix": matrix}));
    }

    /// The extensions that materials use, in order of their names.
    fn extensions(&self) -> BTreeSet<&str> {
        let extensions = |material| Some(Value::as_object(material)?.get("extensions")?.as_object()?.keys());
        self.materials.iter().filter_map(extensions).flatten().map(String::as_str).collect()
    }

    /// The whole file, of one scene with this name.
    pub(crate) fn finish(mut self, scene: &str) -> Result<Vec<u8>> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let sampler = json!({"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497});
        let samplers = if self.textures.is_empty() { Vec::new() } else { vec![sampler] };
        let nodes: Vec<usize> = (0..self.nodes.len()).collect();
        let mut document = json!({
            "asset": {"version": "2.0", "generator": "cargo xtask scenes", "copyright": "MIT OR Apache-2.0"},
            "scene": 0,
            "scenes": [{"name": scene, "nodes": nodes}],
            "nodes": self.nodes,
            "cameras": self.cameras,
            "meshes": self.meshes,
            "materials": self.materials,
            "textures": self.textures,
            "images": self.images,
            "samplers": samplers,
            "accessors": self.accessors,
            "bufferViews": self.buffer_views,
            "extensionsUsed": self.extensions(),
            "buffers": [{"byteLength": self.binary.len()}],
        });
        if let Value::Object(document) = &mut document {
            // glTF has no empty lists
            document.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
        }
        let mut text = serde_json::to_vec(&document).context("cannot write the scene's JSON")?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.binary.len();
        let mut file = Vec::with_capacity(total);
        file.extend_from_slice(b"glTF");
        for word in [2, u32::try_from(total).context("the scene is larger than a glb can be")?] {
            file.extend_from_slice(&word.to_le_bytes());
        }
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.binary)] {
            file.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(chunk);
        }
        Ok(file)
    }
}
