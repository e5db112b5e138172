//! What a transfer is prepared with.

use std::cmp::Ordering;

use super::photons::PhotonSettings;
use super::{Encoding, Multibounce, Quality, Selection};
use crate::sample::CloudMethod;
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
    /// How many receivers that are alike may share a row, also of several pixels: 1 to 256. For a first look; 1 shares none.
    #[serde(default = "alone")]
    pub sharing: usize,
    /// How operators are stored.
    pub encoding: Encoding,
    /// What the encoding of the diffuse final gather may lose, relative to all light, 0.001 to 1, of `low-rank`; `None` is what `quality` spends
    /// bytes for. Reflections are stored at the same price of a byte.
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

fn alone() -> usize {
    1
}

/// The steps before what was asked for: quality, receivers that share a row, gather samples at most. The first is there in seconds, the second
/// in about a tenth of the time of a `standard` preparation.
const STEPS: [(Quality, usize, usize); 2] = [(Quality::Glance, 64, 4096), (Quality::Draft, 8, 16_384)];
/// Pixels at which so many share: fewer do in smaller images.
const STEPS_PIXELS: usize = 640 * 480;
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
            sharing: alone(),
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

    /// What is prepared before this, for a first look and a second one.
    pub(super) fn coarser(&self) -> Vec<Self> {
        let (width, height) = self.size;
        let step = |(quality, sharing, gather): (Quality, usize, usize)| {
            let sharing = sharing * (width * height) / STEPS_PIXELS;
            Self {
                sharing: self.sharing.max(sharing.clamp(1, 256).next_power_of_two()),
                gather: self.gather.min(gather),
                quality,
                error: None,
                photons: PhotonSettings { count: self.photons.count.min(STEPS_PHOTONS), ..self.photons },
                ..self.clone()
            }
        };
        let mut steps: Vec<Self> = STEPS.map(step).into();
        // rows times columns: what takes most of the time
        let work = |settings: &Self| settings.gather as f64 / settings.sharing as f64;
        steps.retain(|step| match step.quality.cmp(&self.quality) {
            Ordering::Less => true,
            Ordering::Equal => 2.0 * work(step) <= work(self),
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
        if !(1..=256).contains(&self.sharing) {
            return Err(Error::Setting(format!(
                "{} receivers that share a row: must be 1 to 256",
                self.sharing
            )));
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
