//! Relume relights a fixed shot with full global illumination while the lights move.

pub mod error;
pub mod image;
pub mod progress;
pub mod reference;
pub mod scene;
pub mod shade;
pub mod trace;

pub use error::{Error, Result};
pub use glam;
pub use progress::Progress;
pub use scene::{Camera, Light, LightKind, LightRig, Scene};
