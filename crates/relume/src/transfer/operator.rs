//! A linear operator from light on the cloud to light on points, whatever its encoding.

use std::sync::{Arc, OnceLock};

use glam::Vec3;

use super::culling::{Norms, Work};
use super::haar_blocks::HaarBlocks;
use super::haar_rows::HaarRows;
use super::low_rank::LowRank;
use super::{Buffer, Coefficients, Interpolation, Selection};

/// By how much more than independent parts those of `low-rank` that are left out may add up: light is told as a multiple of what is expected, and what
/// is bright is mostly what is seen. Under a sun in the demo's scene it is twice as much.
const ADD_UP: f32 = 3.0;

/// How an operator is stored. All stand for the same matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Blocks of rows share a basis; the default.
    #[default]
    LowRank,
    /// Every row keeps its own Haar coefficients, as in Hasan 2006.
    HaarRows,
    /// The same, regrouped as images of wavelet lights, as Hasan 2006 has it on the GPU.
    HaarBlocks,
}

impl Encoding {
    /// What coefficients are chosen by unless told otherwise: by their areas in the paper's encodings, by the learned prior in
    /// `low-rank`.
    pub fn selection(self) -> Selection {
        match self {
            Self::LowRank => Selection::Prior,
            Self::HaarRows | Self::HaarBlocks => Selection::Area,
        }
    }

    /// The `epsilon` of culling on the fly unless told otherwise ([`RelightSettings::cull`](crate::relight::RelightSettings::cull)):
    /// one that adds less than half a percent of error where culling gains time, else 0.
    pub fn cull(self) -> f32 {
        match self {
            Self::HaarBlocks => 0.01,
            Self::HaarRows | Self::LowRank => 0.0,
        }
    }
}

/// Expected relative error of an encoding alone, over some lights' images taken as one. `None` where none of them reaches a row, or the matrix
/// is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EncodingError {
    /// Of `low-rank`, under lights like those it learned from, which were held out; of the other encodings, of the matrix itself.
    pub expected: Option<f64>,
    /// Of `low-rank`, under lights of kinds that it did not learn from: needles of light, lamps at a wall, strings of lamps, low suns, an even
    /// sky, and what surfaces emit, as far as the scene lets them in. `None` for the other encodings, which learn at most magnitudes.
    pub other_lights: Option<f64>,
}

/// The stored matrix.
#[derive(Clone, Debug)]
pub enum Matrix {
    /// See [`LowRank`].
    LowRank(LowRank),
    /// See [`HaarRows`].
    HaarRows(HaarRows),
    /// See [`HaarBlocks`].
    HaarBlocks(HaarBlocks),
}

/// Applied to outgoing radiance on the cloud, gives for each row the mean radiance that arrives, W/(sr m^2): weighted by the cosine (`F_d g`,
/// irradiance over pi), or by a specular lobe (`F_g g`).
#[derive(Clone, Debug)]
pub struct Operator {
    /// Points at which light arrives, one value each.
    pub rows: usize,
    /// From the matrix's rows to those; `None` where each has the row of its number.
    pub interpolation: Option<Arc<Interpolation>>,
    /// The matrix.
    pub matrix: Matrix,
    /// `E^-1`, one a gather sample: what light is multiplied by before it is transformed; empty where the encoding uses no prior.
    pub sample_weights: Buffer<f32>,
    /// `D^-1`, one a coefficient; empty likewise.
    pub weights: Buffer<f32>,
    /// Expected error of the encoding alone.
    pub expected_error: EncodingError,
    norms: OnceLock<Norms>,
}

impl Operator {
    /// An operator of these parts, which fit together.
    pub(super) fn new(
        rows: usize,
        matrix: Matrix,
        (sample_weights, weights): (Buffer<f32>, Buffer<f32>),
        expected_error: EncodingError,
    ) -> Self {
        let (interpolation, norms) = (None, OnceLock::new());
        Self { rows, interpolation, matrix, sample_weights, weights, expected_error, norms }
    }

    /// The coefficients of light on the cloud, one RGB a gather sample, as [`Self::apply_coefficients`] takes them.
    ///
    /// # Panics
    /// If `light` is of another cloud.
    pub fn coefficients(&self, light: &[Vec3]) -> Coefficients {
        Coefficients::new(light, &self.sample_weights, &self.weights)
    }

    /// Whether the coefficients of one are those of the other: both learned from the same prior.
    pub(super) fn weighs_like(&self, other: &Self) -> bool {
        *self.weights == *other.weights && *self.sample_weights == *other.sample_weights
    }

    /// The same rows, from which all points take theirs.
    #[must_use]
    pub(super) fn interpolated(self, interpolation: Arc<Interpolation>) -> Self {
        Self { rows: interpolation.receivers(), interpolation: Some(interpolation), ..self }
    }

    /// Rows of the matrix.
    pub fn records(&self) -> usize {
        self.interpolation.as_ref().map_or(self.rows, |interpolation| interpolation.records)
    }

    /// `F g`, one RGB a row. Nothing is culled.
    ///
    /// # Panics
    /// If `light` has not one entry a gather sample.
    pub fn apply(&self, light: &[Vec3]) -> Vec<Vec3> {
        let coefficients = self.coefficients(light);
        let mut out = vec![Vec3::ZERO; self.rows];
        self.apply_coefficients(&coefficients, 0.0, &mut out);
        out
    }

    /// `F g` from [`Self::coefficients`], without parts that add next to nothing: those whose square is at
    /// most `epsilon`'s of the mean over all parts (of `low-rank`, a third of `epsilon`'s), as Hasan 2006 (section 3.5) has it but for what `epsilon` is relative to. 0 leaves
    /// out nothing. Returns how much there was to do.
    ///
    /// # Panics
    /// If the coefficients are of another cloud, or `out` has not [`Self::rows`] entries.
    pub fn apply_coefficients(&self, coefficients: &Coefficients, epsilon: f32, out: &mut [Vec3]) -> Work {
        let epsilon = match self.matrix {
            Matrix::LowRank(_) => epsilon / ADD_UP,
            Matrix::HaarRows(_) | Matrix::HaarBlocks(_) => epsilon,
        };
        let cut = if epsilon > 0.0 {
            self.norms(coefficients.as_slice().len()).cut(coefficients, epsilon)
        } else {
            None
        };
        let apply = |out: &mut [Vec3]| match &self.matrix {
            Matrix::LowRank(matrix) => matrix.apply(coefficients, cut, out),
            Matrix::HaarRows(matrix) => matrix.apply(coefficients, cut, out),
            Matrix::HaarBlocks(matrix) => matrix.apply(coefficients, cut, out),
        };
        let Some(interpolation) = &self.interpolation else { return apply(out) };
        let mut rows = vec![Vec3::ZERO; interpolation.records];
        let work = apply(&mut rows);
        interpolation.apply(&rows, out);
        work
    }

    /// What culling asks, for a cloud of `count` samples: found once.
    pub(super) fn norms(&self, count: usize) -> &Norms {
        self.norms.get_or_init(|| match &self.matrix {
            Matrix::LowRank(matrix) => matrix.norms(count),
            Matrix::HaarRows(matrix) => matrix.norms(count),
            Matrix::HaarBlocks(matrix) => matrix.norms(count),
        })
    }

    /// Bytes stored, the prior included, but without the interpolation, which operators may share.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.sample_weights)
            + size_of_val(&*self.weights)
            + match &self.matrix {
                Matrix::LowRank(matrix) => matrix.bytes(),
                Matrix::HaarRows(matrix) => matrix.bytes(),
                Matrix::HaarBlocks(matrix) => matrix.bytes(),
            }
    }

    /// Which encoding it has.
    pub fn encoding(&self) -> Encoding {
        match self.matrix {
            Matrix::LowRank(_) => Encoding::LowRank,
            Matrix::HaarRows(_) => Encoding::HaarRows,
            Matrix::HaarBlocks(_) => Encoding::HaarBlocks,
        }
    }

    /// Whether the parts fit together and a cloud of `count` samples: what a file must be before it is used.
    pub(super) fn is_sound(&self, count: usize) -> bool {
        let mut weights = self.sample_weights.iter().chain(&*self.weights);
        if !weights.all(|weight| weight.is_finite())
            || !self.interpolation.as_ref().is_none_or(|interpolation| interpolation.is_sound())
        {
            return false;
        }
        let rows = self.records();
        let of_each = [&self.sample_weights, &self.weights].map(|weights| weights.len());
        match &self.matrix {
            Matrix::LowRank(matrix) => of_each == [count; 2] && matrix.is_sound(rows, count),
            Matrix::HaarRows(matrix) => of_each == [0; 2] && matrix.is_sound(rows, count),
            Matrix::HaarBlocks(matrix) => of_each == [0; 2] && matrix.is_sound(rows, count),
        }
    }
}
