//! The container, the JSON and the buffers of a glTF file.

use std::path::{Path, PathBuf};

use ::gltf::json::{Root, validation::Validate};
use relume::{Error, Result};

use super::uri::{Target, resolve};
use crate::import::read_file;

/// The extensions that are read here.
const SUPPORTED_EXTENSIONS: [&str; 7] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Extensions that pack geometry or images and must be undone before.
const COMPRESSION_EXTENSIONS: [&str; 5] = [
    "EXT_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "EXT_texture_webp",
];

/// A validated glTF file with its buffers in memory.
#[derive(Debug)]
pub(super) struct Document<'a> {
    pub(super) path: &'a Path,
    pub(super) root: Root,
    buffers: Vec<Vec<u8>>,
}

impl<'a> Document<'a> {
    /// Reads the file and all its buffers, and warns of what it has that is left out.
    pub(super) fn open(path: &'a Path, warnings: &mut Vec<String>) -> Result<Self> {
        let bytes = read_file(path)?;
        let (json, blob) = split_container(&bytes).map_err(|message| Error::file(path, message))?;
        let mut root: Root = Root::from_slice(json).map_err(|e| {
            Error::file(path, format!("is not glTF: {e} of the JSON part; export the scene again"))
        })?;
        if !root.asset.version.starts_with("2.") {
            let version = &root.asset.version;
            return Err(Error::file(path, format!("is glTF version {version}; convert it to version 2.0")));
        }
        check_extensions(path, &mut root, warnings)?;
        leave_out_animation(&mut root, warnings);
        validate(path, &root)?;
        let mut document = Self { path, root, buffers: Vec::new() };
        document.buffers = document.read_buffers(blob)?;
        Ok(document)
    }

    /// An error about this file.
    pub(super) fn fail(&self, message: impl Into<String>) -> Error {
        Error::file(self.path, message)
    }

    /// The folder that relative URIs start from.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The bytes a `uri` stands for, and the file they came from.
    pub(super) fn read_uri(&self, uri: &str) -> Result<(Vec<u8>, Option<PathBuf>), String> {
        match resolve(self.folder(), uri)? {
            Target::Bytes(bytes) => Ok((bytes, None)),
            Target::File(file) => {
                let bytes = read_file(&file).map_err(|error| {
                    format!("{error}; put the file there, or export the scene as one .glb")
                })?;
                Ok((bytes, Some(file)))
            }
        }
    }

    fn read_buffers(&self, blob: Option<&[u8]>) -> Result<Vec<Vec<u8>>> {
        let mut buffers = Vec::with_capacity(self.root.buffers.len());
        for (index, buffer) in self.root.buffers.iter().enumerate() {
            let bytes = match (&buffer.uri, blob) {
                (Some(uri), _) => {
                    self.read_uri(uri).map_err(|message| self.fail(format!("buffer {index}: {message}")))?.0
                }
                (None, Some(blob)) if index == 0 => blob.to_vec(),
                (None, _) => {
                    return Err(self
                        .fail(format!("buffer {index} has neither a `uri` nor the binary part of a .glb")));
                }
            };
            if (bytes.len() as u64) < buffer.byte_length.0 {
                let (has, wants) = (bytes.len(), buffer.byte_length.0);
                return Err(self.fail(format!(
                    "buffer {index} has {has} of its {wants} bytes; the file was cut off, copy it again"
                )));
            }
            buffers.push(bytes);
        }
        Ok(buffers)
    }

    /// The bytes of a buffer view and its stride, if it has one.
    pub(super) fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), String> {
        let view =
            self.root.buffer_views.get(index).ok_or_else(|| format!("there is no buffer view {index}"))?;
        let start = view.byte_offset.unwrap_or_default().0;
        let range = start
            .checked_add(view.byte_length.0)
            .and_then(|end| Some(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let bytes = self
            .buffers
            .get(view.buffer.value())
            .and_then(|buffer| buffer.get(range?))
            .ok_or_else(|| format!("buffer view {index} reaches past the end of its buffer"))?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0)))
    }
}

/// The JSON and the binary part of a `.glb`, or the whole of a `.gltf`.
fn split_container(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes), None));
    }
    let word = |at: usize| {
        bytes
            .get(at..at + 4)
            .and_then(|b| b.try_into().ok())
            .map(u32::from_le_bytes)
            .ok_or("the .glb header is cut off")
    };
    let version = word(4)?;
    if version != 2 {
        return Err(format!("is a .glb of version {version}; convert it to version 2"));
    }
    let total = word(8)? as usize;
    let chunks = bytes.get(12..total).ok_or_else(|| {
        format!("says it has {total} bytes but has {}; the file was cut off, copy it again", bytes.len())
    })?;
    let json = chunk(chunks)?;
    if json.kind != b"JSON" {
        return Err("does not begin with a JSON chunk; export the scene again".to_owned());
    }
    if json.rest.is_empty() {
        return Ok((json.contents, None));
    }
    // Chunks of other kinds are to be ignored, says the specification.
    let binary = chunk(json.rest)?;
    Ok((json.contents, (binary.kind == b"BIN\0").then_some(binary.contents)))
}

/// One part of a `.glb` and the bytes that follow it.
struct Chunk<'a> {
    kind: &'a [u8],
    contents: &'a [u8],
    rest: &'a [u8],
}

/// The first chunk of `bytes`.
fn chunk(bytes: &[u8]) -> Result<Chunk<'_>, String> {
    let cut_off = || "a chunk of the .glb is cut off; copy the file again".to_owned();
    let (length, rest) = bytes.split_first_chunk::<4>().ok_or_else(cut_off)?;
    let (kind, rest) = rest.split_at_checked(4).ok_or_else(cut_off)?;
    let (contents, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or_else(cut_off)?;
    Ok(Chunk { kind, contents, rest })
}

fn check_extensions(path: &Path, root: &mut Root, warnings: &mut Vec<String>) -> Result<()> {
    let supported = |name: &str| SUPPORTED_EXTENSIONS.contains(&name);
    if let Some(name) = root.extensions_required.iter().find(|name| !supported(name)) {
        let mend = if COMPRESSION_EXTENSIONS.contains(&name.as_str()) {
            "export the scene without compression"
        } else {
            "export the scene without it"
        };
        return Err(Error::file(
            path,
            format!("requires the extension {name}, which is not supported; {mend}"),
        ));
    }
    for name in root.extensions_used.iter().filter(|name| !supported(name)) {
        warnings.push(format!("the extension {name} is not supported and was left out"));
    }
    // The check above replaces the one of the validation, which knows other extensions.
    root.extensions_required.clear();
    Ok(())
}

/// Takes out what is left in its rest pose, so that its flaws are no reason to refuse the file.
fn leave_out_animation(root: &mut Root, warnings: &mut Vec<String>) {
    let mut warn = |count: usize, what: &str| {
        if count > 0 {
            warnings.push(format!("{count} {what} left out: the scene stands in its rest pose"));
        }
    };
    warn(root.animations.len(), "animations were");
    warn(root.skins.len(), "skins were");
    let morphed = |primitive: &&mut ::gltf::json::mesh::Primitive| {
        primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty())
    };
    let primitives = root.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives);
    let targets: usize = primitives.filter(morphed).map(|p| p.targets.take().map_or(0, |t| t.len())).sum();
    warn(targets, "morph targets were");
    root.animations.clear();
    root.skins.clear();
    for node in &mut root.nodes {
        node.skin = None;
    }
}

/// Checks that every index leads somewhere and every constant is known.
fn validate(path: &Path, root: &Root) -> Result<()> {
    // The validation itself takes the accessors of primitives for granted.
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(index) =
                primitive.attributes.values().find(|index| index.value() >= root.accessors.len())
            {
                let message =
                    format!("meshes[{m}].primitives[{p}] names accessor {index}, which does not exist");
                return Err(Error::file(path, message));
            }
        }
    }
    let mut first = None;
    root.validate(root, ::gltf::json::Path::new, &mut |place, error| {
        if first.is_none() {
            first = Some((place(), error));
        }
    });
    match first {
        Some((place, error)) => {
            let error = error.to_string().to_lowercase();
            Err(Error::file(
                path,
                format!("is not valid glTF at {}: {error}; export the scene again", place.as_str()),
            ))
        }
        None => Ok(()),
    }
}
