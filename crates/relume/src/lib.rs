//! Relume relights a fixed shot with full global illumination while the lights move.
//!
//! A scene and a camera are prepared once into a [`Transfer`]. A [`Relighter`] then turns any [`LightRig`] into an
//! image: direct light with ray-traced shadows, and indirect light of any number of bounces. Light transport is linear
//! and neither camera nor surfaces move, so all that a changed light needs is new direct light on a cloud of points and
//! a product with a prepared matrix.
//!
//! ```
//! use relume::{Light, LightKind, LightRig, Preparation, Relighter, glam::Vec3};
//! use relume::{relight::RelightSettings, transfer::Quality};
//! use relume_io::{ExrMeta, load_scene, write_exr};
//! # fn main() -> relume::Result<()> {
//! # let assets = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets"));
//! # let folder = std::env::temp_dir().join(format!("relume-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder).expect("a folder for temporary files");
//!
//! let scene = load_scene(&assets.join("arcade.glb"))?.scene;
//! // tiny, so that it takes a second; leave these out for a real picture
//! let transfer = Preparation::new(&scene).size(32, 24).gather(256).quality(Quality::Draft).run(&())?;
//! transfer.save(folder.join("arcade.relume"))?; // `Transfer::load` reads it back, here or elsewhere
//!
//! let lamp = LightKind::Omni { position: Vec3::new(-2.6, 2.1, -0.9), intensity: Vec3::splat(12.0), radius: 0.05 };
//! let rig = LightRig { lights: vec![Light { name: "lamp".into(), enabled: true, kind: lamp }], ..LightRig::default() };
//! let layers = Relighter::new(transfer).relight(&rig, &RelightSettings::default())?;
//! write_exr(folder.join("arcade.exr"), &layers, &ExrMeta::default())?;
//!
//! assert!(layers.indirect.pixels.iter().any(|pixel| pixel.min_element() > 0.0));
//! # std::fs::remove_dir_all(&folder).expect("nothing else uses the folder");
//! # Ok(())
//! # }
//! ```
//!
//! The crate reads no scene file and writes no image: `relume-io` does both, and a renderer may as well fill a [`Scene`]
//! itself. Files, threads and errors are the caller's: work runs in the current rayon pool, reports to a [`Progress`],
//! and fails with one sentence ([`Error`]).
//!
//! # Where things are
//!
//! | module | what |
//! |---|---|
//! | [`scene`] | geometry, materials, textures, cameras, lights, rigs: plain data |
//! | [`trace`] | acceleration structure, rays, sampling sequences |
//! | [`shade`] | how a point answers to a light |
//! | [`sample`] | view samples, gather cloud, cluster tree, direct light on the cloud |
//! | [`transfer`] | preparation, the operators, their encodings, the cache file |
//! | [`relight`] | the engine: rig in, layers out |
//! | [`mod@reference`] | the path tracer that everything is measured against |
//! | [`image`] | layers, display transform, metrics |
//!
//! Metres, Y up, right-handed; scene-linear Rec. 709; radiant units. The same input, seed and version give the same bytes
//! on the same kind of processor, whatever the number of threads. `docs/ARCHITECTURE.md` leads through the stages,
//! `docs/METHODS.md` from each equation to its code, `docs/CACHE.md` through the file.

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
pub use scene::{Camera, Emitter, Light, LightKind, LightRig, MaterialEdit, Scene};
pub use transfer::{Preparation, Preparing, Transfer};
