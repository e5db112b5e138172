//! Files for Relume: glTF and OBJ in, EXR and PNG out, light rigs.

#![expect(dead_code, reason = "the importers that use these modules follow")]

mod bitmap;
mod mesh_parts;
mod tangents;
