//! Files for Relume: glTF and OBJ in, EXR and PNG out, light rigs.

mod bitmap;
mod gltf;
mod import;
mod mesh_parts;
mod obj;
mod tangents;

pub use import::{Imported, load_scene};
