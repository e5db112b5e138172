//! Test scenes on their way through preparation and relighting.

use std::sync::Arc;

use relume::glam::{DVec3, Vec3};
use relume::image::{Image, Layers};
use relume::relight::RelightSettings;
use relume::sample::Receivers;
use relume::transfer::{Encoding, Quality, Settings};
use relume::{LightRig, Preparation, Relighter, Transfer};

use crate::scenes::TestScene;

/// A draft of 32x24 pixels and 1024 gather samples: what is enough where only sameness is asked for.
pub fn tiny() -> Settings {
    Settings { size: (32, 24), gather: 1024, quality: Quality::Draft, ..Settings::default() }
}

/// Rows as they are, in 8 bits, over 4096 gather samples: what is off is the estimate.
pub fn uncompressed(size: (usize, usize)) -> Settings {
    Settings {
        size,
        gather: 4096,
        quality: Quality::Standard,
        encoding: Encoding::HaarRows,
        coefficients: 4096,
        ..Settings::default()
    }
}

/// Prepares a scene.
///
/// # Panics
/// If it cannot be prepared.
pub fn prepare(built: &TestScene, settings: Settings) -> Transfer {
    Preparation::new(&built.scene).settings(settings).run(&()).expect("a scene that can be prepared")
}

/// Relights with an engine that has kept nothing.
///
/// # Panics
/// If the settings are out of range.
pub fn relight_afresh(transfer: &Arc<Transfer>, rig: &LightRig, settings: &RelightSettings) -> Layers {
    Relighter::new(Arc::clone(transfer)).relight(rig, settings).expect("valid settings")
}

/// What each row of the final gather adds up to over surfaces: the operator applied to ones, and zeros where samples are of the sky.
pub fn row_sums(transfer: &Transfer) -> Vec<f32> {
    let mut ones = vec![Vec3::ONE; transfer.cloud.surfaces().len()];
    ones.resize(transfer.cloud.len(), Vec3::ZERO);
    transfer.gather.apply(&ones).iter().map(|sum| sum.x).collect()
}

/// The pixels whose centre reflects light, with the row of the final gather from which it takes its light.
pub fn lit_centers(transfer: &Transfer) -> impl Iterator<Item = (usize, usize)> {
    let rows = transfer.receivers_of_centers.iter().enumerate();
    rows.filter(|&(_, &row)| row != Receivers::NONE).map(|(pixel, &row)| (pixel, row as usize))
}

/// What the row of each lit pixel's centre adds up to.
pub fn center_sums(transfer: &Transfer) -> Vec<f32> {
    let sums = row_sums(transfer);
    lit_centers(transfer).map(|(_, row)| sums[row]).collect()
}

/// Smallest, mean and largest of some numbers.
pub fn spread(values: &[f32]) -> [f64; 3] {
    let values = || values.iter().map(|&value| f64::from(value));
    let mean = values().sum::<f64>() / values().count().max(1) as f64;
    [values().fold(f64::INFINITY, f64::min), mean, values().fold(f64::NEG_INFINITY, f64::max)]
}

/// The mean pixel.
pub fn mean(image: &Image) -> DVec3 {
    image.pixels.iter().map(|pixel| pixel.as_dvec3()).sum::<DVec3>() / image.pixels.len() as f64
}

/// An image of one colour, as large as `like`.
pub fn flat(like: &Image, color: Vec3) -> Image {
    Image { pixels: vec![color; like.pixels.len()], ..*like }
}
