//! The importer from outside: whole files in, scenes or one sentence out.

#![expect(clippy::unwrap_used, reason = "a test that cannot be set up has to fail")]

mod gltf_errors;
mod gltf_features;
mod obj;
mod shared_scenes;
mod support;
