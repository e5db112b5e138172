//! Files for Relume: glTF and OBJ in, EXR and PNG out, light rigs.

mod environment_file;
pub mod exr_file;
mod frame_file;
mod image_file;
pub mod png_file;
pub mod rig;

pub use environment_file::read_environment;
pub use exr_file::{Attribute, ExrImage, ExrMeta, Precision, read_exr, write_exr, write_exr_image};
pub use frame_file::{
    FrameNames, ImageKind, bounces, frame_attributes, own_number, own_text, stored_number, write_behind,
    write_frame,
};
pub use image_file::read_image;
pub use png_file::{read_png, write_png};
pub use rig::{
    AnimatedRig, Curve, Field, Interpolation, Subject, check_materials, load_rig, parse_rig, rig_to_toml,
    save_rig,
};
mod bitmap;
mod gltf;
mod import;
mod mesh_parts;
mod obj;
mod tangents;

pub use import::{Imported, load_scene};
