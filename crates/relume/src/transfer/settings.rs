//! What a transfer is prepared with.

use std::cmp::Ordering;

use super::photons::PhotonSettings;
use super::{Encoding, Multibounce, Quality, Selection};
use crate::sample::{CloudMethod, Spacing};
use crate::scene::{Camera, Scene};
use crate::{Error, Result};

/// How rows of the final gather are estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowMethod {
    /// Hemisphere rays and form factors, balanced, with shared visibility; the default.
    #[default]
    Balanced,
    /// The paper's cluster cut with clamped entries, for comparison.
    Paper,
}

/// What a transfer is prepared with.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Settings {
    /// Pixels: width and height, 1 to 16,384 each.
    pub size: (usize, usize),
    /// Index into the scene's cameras.
    pub camera: usize,
    /// Gather samples: a power of four. More resolve light finer, for proportionally more time.
    pub gather: usize,
    /// Where gather samples are dense.
    pub cloud: CloudMethod,
    /// Whether a sixteenth of the gather samples are of the sky, where the scene is open to it: for dome lights.
    pub sky: bool,
    /// Time and space to spend.
    pub quality: Quality,
    /// How far apart those receivers lie, at most, that have a row of their own and from which the others take their light: a share of the harmonic
    /// mean distance of what they see, 0 to 1. More is faster, smaller and coarser; 0 gives each receiver its row.
    pub spacing: f32,
    /// How operators are stored.
    pub encoding: Encoding,
    /// What the encoding of the diffuse final gather may lose, relative to all light, 0.001 to 1, of `low-rank`; `None` is what `quality` spends
    /// bytes for. The bounces may lose three times as much; reflections are stored at the final gather's price of a byte.
    pub error: Option<f32>,
    /// By what an encoding chooses the coefficients that it keeps; `None` stands for its own way ([`Encoding::selection`]).
    pub selection: Option<Selection>,
    /// How rows are estimated.
    pub rows: RowMethod,
    /// What the bounce operator holds, and how it is estimated.
    pub multibounce: Multibounce,
    /// Of [`Multibounce::Photon`].
    pub photons: PhotonSettings,
    /// Whether surfaces also show reflections of indirect light, along their specular lobes.
    pub glossy: bool,
    /// Coefficients a row of `haar-rows` and `haar-blocks`; the paper keeps 100.
    pub coefficients: usize,
    /// Of all random numbers.
    pub seed: u32,
}

/// The steps before what was asked for: quality, spacing of records at least, and gather samples at most. The first is there in seconds.
const STEPS: [(Quality, f32, usize); 2] = [(Quality::Glance, 1.0, 4096), (Quality::Draft, 0.4, 16_384)];
/// Pixels that records of the final gather lie apart at least: so many, and so many times the spacing, the latter in images of
const LEAST_PIXELS: (f32, f32) = (1.0, 14.0);
/// so many pixels or more; in smaller ones, whose pixels are wider, fewer.
const LARGE: f32 = 640.0 * 480.0;
/// Steps of small images have records closer together, by their pixels; at less than this there is nothing to gain.
const LEAST_SPACING: f32 = 0.02;
/// How far normals of records may differ from those that they speak for, as a distance of unit vectors: so far, and as far again as many times the
/// spacing.
const TILT: (f32, f32) = (0.1, 0.7);
/// How much farther apart than those of the final gather records of the bounces lie.
const BOUNCE_SPACING: f32 = 2.0;
/// Photons of these steps.
const STEPS_PHOTONS: usize = 1 << 16;

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: (640, 480),
            camera: 0,
            gather: 65_536,
            cloud: CloudMethod::Adaptive,
            sky: true,
            quality: Quality::Standard,
            spacing: 0.0,
            encoding: Encoding::LowRank,
            error: None,
            selection: None,
            rows: RowMethod::Balanced,
            multibounce: Multibounce::default(),
            photons: PhotonSettings::default(),
            glossy: true,
            coefficients: 100,
            seed: 0,
        }
    }
}

impl Settings {
    /// By what the encoding chooses coefficients.
    pub fn selection(&self) -> Selection {
        self.selection.unwrap_or_else(|| self.encoding.selection())
    }

    /// Where there are records of the final gather; `None` where each receiver has a row.
    pub(super) fn gather_spacing(&self) -> Option<Spacing> {
        let (width, height) = self.size;
        let large = ((width * height) as f32 / LARGE).sqrt().min(1.0);
        let least = LEAST_PIXELS.0 + LEAST_PIXELS.1 * self.spacing * large;
        Some(Spacing { share: self.spacing, least, tilt: self.tilt() }).filter(|spacing| spacing.share > 0.0)
    }

    fn tilt(&self) -> f32 {
        TILT.0 + TILT.1 * self.spacing
    }

    /// The same of the bounces.
    pub(super) fn bounce_spacing(&self) -> Option<Spacing> {
        let share = BOUNCE_SPACING * self.spacing;
        Some(Spacing { share, least: 0.0, tilt: self.tilt() }).filter(|spacing| spacing.share > 0.0)
    }

    /// What is prepared before this, for a first look and a second one.
    pub(super) fn coarser(&self) -> Vec<Self> {
        let (width, height) = self.size;
        let large = ((width * height) as f32 / LARGE).min(1.0);
        let step = |(quality, spacing, gather): (Quality, f32, usize)| Self {
            spacing: self.spacing.max(if large * spacing > LEAST_SPACING { large * spacing } else { 0.0 }),
            gather: self.gather.min(gather),
            quality,
            error: None,
            photons: PhotonSettings { count: self.photons.count.min(STEPS_PHOTONS), ..self.photons },
            ..self.clone()
        };
        let mut steps: Vec<Self> = STEPS.map(step).into();
        steps.retain(|step| match step.quality.cmp(&self.quality) {
            Ordering::Less => true,
            Ordering::Equal => 2 * step.gather <= self.gather,
            Ordering::Greater => false,
        });
        steps
    }

    /// The camera, if all settings are within their ranges.
    ///
    /// # Errors
    /// [`Error::Setting`] otherwise.
    pub(super) fn check<'a>(&self, scene: &'a Scene) -> Result<&'a Camera> {
        let (width, height) = self.size;
        if !(1..=16_384).contains(&width) || !(1..=16_384).contains(&height) {
            return Err(Error::Setting(format!(
                "an image of {width}x{height}: each side must be 1 to 16384 pixels"
            )));
        }
        if !(0.0..=1.0).contains(&self.spacing) {
            return Err(Error::Setting(format!("a spacing of {}: must be 0 to 1", self.spacing)));
        }
        if !(1..=4096).contains(&self.coefficients) {
            return Err(Error::Setting(format!(
                "{} coefficients a row: must be 1 to 4096",
                self.coefficients
            )));
        }
        if let Some(error) = self.error {
            if !(0.001..=1.0).contains(&error) {
                return Err(Error::Setting(format!("an error of {error} of the light: must be 0.001 to 1")));
            }
            if self.encoding != Encoding::LowRank {
                return Err(Error::Setting(
                    "an error that the encoding may have is for low-rank; the others keep a number of coefficients".to_owned(),
                ));
            }
        }
        self.photons.check()?;
        scene.cameras.get(self.camera).ok_or_else(|| {
            Error::Setting(format!(
                "no camera {}: the scene has {}, numbered from 0",
                self.camera,
                scene.cameras.len()
            ))
        })
    }
}
