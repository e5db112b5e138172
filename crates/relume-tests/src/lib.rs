//! Scenes with known answers, shared by the tests.

pub mod scenes;
