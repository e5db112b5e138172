//! A writer of small glTF files, so that tests hold the bytes they expect the importer to read.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

pub(crate) const F32: u32 = 5126;
pub(crate) const U16: u32 = 5123;
pub(crate) const I8: u32 = 5120;

/// A glTF document and its one buffer.
pub(crate) struct Builder {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
    /// Where images go: into the buffer, or beside the file.
    files: Option<PathBuf>,
}

impl Builder {
    /// Images become buffer views.
    pub(crate) fn embedded() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}}), bin: Vec::new(), files: None }
    }

    /// Images become files in `folder`.
    pub(crate) fn beside(folder: &Path) -> Self {
        Self { files: Some(folder.to_owned()), ..Self::embedded() }
    }

    /// Appends `value` to the array `key` and returns its index.
    pub(crate) fn push(&mut self, key: &str, value: Value) -> usize {
        let array = &mut self.json[key];
        if array.is_null() {
            *array = json!([]);
        }
        let array = array.as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    /// A buffer view over `bytes`.
    pub(crate) fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    /// An accessor of floats with `N` components.
    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        let mut accessor =
            json!({"bufferView": view, "componentType": F32, "count": values.len(), "type": kind});
        if N == 3 {
            accessor["min"] = json!([-1e3, -1e3, -1e3]);
            accessor["max"] = json!([1e3, 1e3, 1e3]);
        }
        self.push("accessors", accessor)
    }

    /// An accessor of 16-bit indices.
    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": U16, "count": values.len(), "type": "SCALAR"}),
        )
    }

    /// An image of one texel row.
    pub(crate) fn image(&mut self, name: &str, texels: &[[u8; 4]]) -> usize {
        let bytes = png(texels);
        match self.files.clone() {
            Some(folder) => {
                std::fs::create_dir_all(folder.join("tex tures")).unwrap();
                std::fs::write(folder.join("tex tures").join(format!("{name}.png")), bytes).unwrap();
                self.push("images", json!({"name": name, "uri": format!("tex%20tures/{name}.png")}))
            }
            None => {
                let view = self.view(&bytes, None);
                self.push("images", json!({"name": name, "bufferView": view, "mimeType": "image/png"}))
            }
        }
    }

    /// The bytes of a `.glb`.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        let mut text = serde_json::to_vec(&json).unwrap();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend((12 + 8 + text.len() as u32 + 8 + bin.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin)] {
            glb.extend((chunk.len() as u32).to_le_bytes());
            glb.extend(kind);
            glb.extend_from_slice(chunk);
        }
        glb
    }

    /// Writes `scene.glb` into `folder`.
    pub(crate) fn write_glb(&self, folder: &Path) -> PathBuf {
        let path = folder.join("scene.glb");
        std::fs::write(&path, self.glb()).unwrap();
        path
    }

    /// Writes `scene.gltf` and its buffer at `uri` into `folder`.
    pub(crate) fn write_gltf(&self, folder: &Path, uri: &str) -> PathBuf {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bin.len(), "uri": uri}]);
        if !uri.starts_with("data:") {
            std::fs::write(folder.join(uri), &self.bin).unwrap();
        }
        let path = folder.join("scene.gltf");
        std::fs::write(&path, serde_json::to_vec_pretty(&json).unwrap()).unwrap();
        path
    }
}

/// A PNG file of one row.
pub(crate) fn png(texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    image::RgbaImage::from_fn(texels.len() as u32, 1, |x, _| image::Rgba(texels[x as usize]))
        .write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png)
        .unwrap();
    bytes
}

/// One triangle in the plane z = 0 that faces +Z, in a scene of one node.
pub(crate) fn triangle() -> Builder {
    let mut builder = Builder::embedded();
    let positions = builder.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    builder.push("meshes", json!({"name": "tri", "primitives": [{"attributes": {"POSITION": positions}}]}));
    builder.push("nodes", json!({"name": "n", "mesh": 0}));
    builder.push("scenes", json!({"nodes": [0]}));
    builder
}

/// A scene with every feature the importer reads.
pub(crate) fn everything(mut b: Builder) -> Builder {
    let red = b.image("red", &[[255, 0, 0, 255], [0, 255, 0, 100]]);
    let flat = b.image("flat", &[[128, 128, 255, 255]]);
    b.push("samplers", json!({"wrapS": 33648, "wrapT": 33071, "magFilter": 9728}));
    b.push("textures", json!({"source": red, "sampler": 0}));
    b.push("textures", json!({"source": flat}));
    b.push("textures", json!({"source": red}));
    b.push(
        "materials",
        json!({
            "name": "full",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1.0, 0.75],
                "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {
                    "offset": [0.25, 0.5], "scale": [2.0, 3.0], "texCoord": 1}}},
                "metallicFactor": 0.2, "roughnessFactor": 0.3,
                "metallicRoughnessTexture": {"index": 1, "texCoord": 1},
            },
            "normalTexture": {"index": 1, "texCoord": 0, "scale": 0.7, "extensions": {
                "KHR_texture_transform": {"rotation": std::f32::consts::FRAC_PI_2, "texCoord": 1}}},
            "emissiveTexture": {"index": 0, "texCoord": 1},
            "emissiveFactor": [1.0, 0.5, 0.25],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}},
            "doubleSided": true,
        }),
    );
    b.push(
        "materials",
        json!({"name": "mask", "alphaMode": "MASK", "alphaCutoff": 0.3, "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 2}, "metallicRoughnessTexture": {"index": 2, "texCoord": 1}}}),
    );
    b.push("materials", json!({"name": "glass", "alphaMode": "BLEND"}));
    slanted_mesh(&mut b);
    strange_mesh(&mut b);
    nodes(&mut b);
    b.json["extensionsUsed"] = json!([
        "KHR_texture_transform",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_clearcoat"
    ]);
    b.json["extensionsRequired"] = json!(["KHR_lights_punctual", "KHR_texture_transform"]);
    b
}

/// A quad in the plane x + y = 1 that faces (1, 1, 0), indexed, with normals as normalised bytes and two sets of coordinates.
fn slanted_mesh(b: &mut Builder) {
    let positions = b.floats(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]);
    let normals = b.view(&[90, 90, 0, 0].repeat(4), Some(4));
    let normals = b.push(
        "accessors",
        json!({"bufferView": normals, "componentType": I8, "normalized": true, "count": 4, "type": "VEC3"}),
    );
    let half: Vec<u8> =
        [0_u16, 0, 65_535, 0, 65_535, 65_535, 0, 65_535].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uv0 = b.view(&half, None);
    let uv0 = b.push(
        "accessors",
        json!({"bufferView": uv0, "componentType": U16, "normalized": true, "count": 4, "type": "VEC2"}),
    );
    let uv1 = b.floats(&[[0.0, 2.0], [2.0, 2.0], [2.0, 0.0], [0.0, 0.0]]);
    let indices = b.indices(&[0, 1, 2, 0, 2, 3, 0, 0, 1]);
    let strip = b.indices(&[0, 1, 3, 2]);
    let attributes = json!({"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uv0, "TEXCOORD_1": uv1});
    b.push(
        "meshes",
        json!({"name": "slanted", "primitives": [
            {"attributes": attributes, "indices": indices, "material": 0},
            {"attributes": attributes, "indices": strip, "material": 1, "mode": 5},
        ]}),
    );
}

/// A fan whose apex a sparse accessor lifts, without normals or indices; points; a triangle without material.
fn strange_mesh(b: &mut Builder) {
    let positions = b.floats(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let index = b.view(&[0], None);
    let value = b.view(&[0.0_f32, 0.0, 5.0].map(f32::to_le_bytes).concat(), None);
    b.json["accessors"][positions]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": index, "componentType": 5121}, "values": {"bufferView": value}});
    b.push(
        "meshes",
        json!({"name": "strange", "primitives": [
            {"attributes": {"POSITION": positions}, "mode": 6, "material": 2},
            {"attributes": {"POSITION": positions}, "mode": 0},
            {"attributes": {"POSITION": positions}},
        ]}),
    );
}

fn nodes(b: &mut Builder) {
    b.push(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}),
    );
    b.push(
        "cameras",
        json!({"type": "orthographic", "orthographic": {"xmag": 1.0, "ymag": 1.0, "znear": 0.1, "zfar": 9.0}}),
    );
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1.0, 0.5, 0.0], "intensity": 40.0, "range": 10.0},
        {"type": "spot", "intensity": 3.0,
         "spot": {"innerConeAngle": 0.0, "outerConeAngle": std::f32::consts::FRAC_PI_2}},
        {"type": "directional", "color": [0.1, 0.2, 0.3], "intensity": 10.0},
    ]}});
    let turn = std::f32::consts::FRAC_1_SQRT_2;
    // A quarter turn about Y, which takes -Z to -X; then 10 along X.
    b.push(
        "nodes",
        json!({"name": "world", "matrix": [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 10, 0, 0, 1],
        "children": [1, 2, 3, 4, 5, 6, 7, 8, 9]}),
    );
    b.push(
        "nodes",
        json!({"name": "stretched", "mesh": 0, "scale": [2.0, 1.0, 0.5],
        "rotation": [0.0, 0.0, turn, turn], "translation": [1.0, 2.0, 3.0]}),
    );
    b.push("nodes", json!({"name": "mirrored", "mesh": 0, "scale": [-3.0, 1.0, 1.0]}));
    b.push("nodes", json!({"name": "third", "mesh": 1}));
    b.push(
        "nodes",
        json!({"name": "eye", "camera": 0, "translation": [0.0, 1.0, 0.0], "scale": [2.0, 2.0, 2.0]}),
    );
    b.push("nodes", json!({"name": "flat eye", "camera": 1}));
    let light = |name: &str, light: usize| json!({"name": name, "translation": [0.0, 0.0, 1.0], "extensions": {"KHR_lights_punctual": {"light": light}}});
    b.push("nodes", light("lamp", 0));
    b.push("nodes", light("lamp", 1));
    b.push("nodes", light("sun", 2));
    b.push("nodes", json!({"name": "nothing", "mesh": 0, "scale": [0.0, 1.0, 1.0]}));
    b.push("nodes", json!({"name": "unused", "mesh": 0}));
    b.push("scenes", json!({"nodes": [10]}));
    b.push("scenes", json!({"nodes": [0]}));
    b.json["scene"] = json!(1);
    b.push("animations", json!({"channels": [], "samplers": []}));
}
