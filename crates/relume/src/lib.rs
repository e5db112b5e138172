//! Relume relights a fixed shot with full global illumination while the lights move.

pub mod atomic;
pub mod error;
pub mod image;
pub mod progress;
pub mod reference;
pub mod relight;
pub mod sample;
pub mod scene;
pub mod shade;
pub mod trace;
pub mod transfer;

pub use atomic::atomic_write;
pub use error::{Error, Result};
pub use glam;
pub use progress::Progress;
pub use relight::Relighter;
pub use scene::{Camera, Light, LightKind, LightRig, Scene};
pub use transfer::{Preparation, Transfer};
