//! Scenes with known answers, shared by the tests.

pub mod cloud_truth;
pub mod prepared;
pub mod scenes;
pub mod truth;
