//! What `quality.json` holds.

use relume::transfer::{Quality, Settings};
use serde::Serialize;

use crate::figures::Column;

/// A run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// Of Relume.
    pub(crate) version: &'static str,
    /// Pixels: width and height.
    pub(crate) size: (usize, usize),
    pub(crate) gather_samples: usize,
    pub(crate) quality: Quality,
    /// Paths a pixel of the references.
    pub(crate) spp: u32,
    /// Scenes that were measured.
    pub(crate) scenes: Vec<SceneReport>,
    /// Scenes that were not there.
    pub(crate) skipped: Vec<String>,
}

/// A scene.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneReport {
    /// Without folder and ending.
    pub(crate) name: String,
    /// Of all that was read of it.
    pub(crate) scene_hash: String,
    pub(crate) triangles: usize,
    /// The cases it was measured under.
    pub(crate) lights: Vec<LightReport>,
    /// In the order asked for.
    pub(crate) encodings: Vec<EncodingReport>,
}

/// A case.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LightReport {
    pub(crate) name: String,
    /// As a rig file, for `relume relight --rig`.
    pub(crate) rig: String,
}

/// A scene prepared in one way.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct EncodingReport {
    /// Its name, how light bounces where that is not the usual way, and its size where that was given.
    pub(crate) encoding: String,
    /// All that it was prepared with.
    pub(crate) settings: Settings,
    /// All operators, over all pixels of the image.
    pub(crate) bytes_per_pixel: f64,
    /// Of the bounce operator alone.
    pub(crate) bounce_bytes: usize,
    /// Wall-clock seconds of the preparation, on this many threads.
    pub(crate) prepare_seconds: f64,
    pub(crate) threads: usize,
    /// Of the final gather, a lit pixel.
    pub(crate) rays_per_pixel: f64,
    /// Of the bounces, a gather sample.
    pub(crate) rays_per_gather_sample: f64,
    /// While preparing; `null` where the system does not tell.
    pub(crate) peak_rss_bytes: Option<u64>,
    /// By truth and number of bounces.
    pub(crate) columns: Vec<Column>,
    /// Rows of the picture, from the top: which light each shows.
    pub(crate) pictured: Vec<String>,
}
