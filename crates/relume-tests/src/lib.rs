//! Scenes with known answers, shared by the tests, and what the measuring programs share.

pub mod cloud_truth;
pub mod command_line;
pub mod prepared;
pub mod progress;
pub mod reports;
pub mod scenes;
pub mod truth;
