//! A linear operator from light on the cloud to light on points, whatever its encoding.

use glam::Vec3;

use super::haar_rows::HaarRows;
use super::low_rank::LowRank;
use super::{Buffer, Coefficients};

/// How an operator is stored. Both stand for the same matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// Blocks of rows share a basis; the default.
    #[default]
    LowRank,
    /// Every row keeps its own Haar coefficients, as in Hasan 2006.
    HaarRows,
}

/// The stored matrix.
#[derive(Clone, Debug)]
pub enum Matrix {
    /// See [`LowRank`].
    LowRank(LowRank),
    /// See [`HaarRows`].
    HaarRows(HaarRows),
}

/// Applied to outgoing radiance on the cloud, gives for each row the mean radiance that arrives, W/(sr m^2): weighted by the cosine (`F_d g`,
/// irradiance over pi), or by a specular lobe (`F_g g`).
#[derive(Clone, Debug)]
pub struct Operator {
    /// Rows.
    pub rows: usize,
    /// The matrix.
    pub matrix: Matrix,
    /// `D^-1`, one a coefficient; empty where the encoding uses no prior.
    pub weights: Buffer<f32>,
    /// Expected relative error of the encoding alone: of `low-rank` over lights like those it learned from, which were
    /// held out; of `haar-rows` that of the matrix.
    pub expected_error: f64,
}

impl Operator {
    /// `F g`, one RGB a row.
    ///
    /// # Panics
    /// If `light` has not one entry a gather sample.
    pub fn apply(&self, light: &[Vec3]) -> Vec<Vec3> {
        let coefficients = Coefficients::new(light, &self.weights);
        let mut out = vec![Vec3::ZERO; self.rows];
        self.apply_coefficients(&coefficients, &mut out);
        out
    }

    /// `F g` from coefficients weighted with [`Self::weights`].
    pub fn apply_coefficients(&self, coefficients: &Coefficients, out: &mut [Vec3]) {
        match &self.matrix {
            Matrix::LowRank(matrix) => {
                matrix.apply(coefficients, None, out);
            }
            Matrix::HaarRows(matrix) => matrix.apply(coefficients, out),
        }
    }

    /// Bytes stored, the prior included.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.weights)
            + match &self.matrix {
                Matrix::LowRank(matrix) => matrix.bytes(),
                Matrix::HaarRows(matrix) => matrix.bytes(),
            }
    }

    /// Which encoding it has.
    pub fn encoding(&self) -> Encoding {
        match self.matrix {
            Matrix::LowRank(_) => Encoding::LowRank,
            Matrix::HaarRows(_) => Encoding::HaarRows,
        }
    }

    /// Whether the parts fit together and a cloud of `count` samples: what a file must be before it is used.
    pub(super) fn is_sound(&self, count: usize) -> bool {
        match &self.matrix {
            Matrix::LowRank(matrix) => self.weights.len() == count && matrix.is_sound(self.rows, count),
            Matrix::HaarRows(matrix) => self.weights.is_empty() && matrix.is_sound(self.rows, count),
        }
    }
}
