//! The strongest directions of a block: eigenvectors of `X S X^T` by subspace iteration, as many as may be worth their bytes.

use nalgebra::{DMatrix, DMatrixView, SymmetricEigen};

use super::gemm::View;
use super::low_rank_run::{LEARNED, Part};

/// Directions beyond the rank that the search carries along, for accuracy.
const OVERSAMPLING: usize = 8;
/// Training lights from whose responses the search starts, at most.
pub(super) const STARTING_LIGHTS: usize = 128;

/// The up to `most` strongest eigenvectors of `X S X^T` that may be worth `least`, one after the other, and their eigenvalues: with ever
/// more directions until the last is worth too little.
pub(super) fn strongest_directions(part: &Part<'_>, most: usize, least: f64) -> (Vec<f32>, Vec<f64>) {
    let rows = part.x.rows();
    let (start, covariance) = (Start::new(part.responses), part.covariance());
    let widest = (most + OVERSAMPLING).min(rows);
    let mut width = (3 * start.worth(least) / 2 + OVERSAMPLING).min(widest);
    loop {
        let (vectors, gains) = subspace(covariance, &start.directions(width));
        let rank = most.min(width);
        if width == widest || gains[rank - 1] < least {
            return (vectors[..rank * rows].to_vec(), gains[..rank].to_vec());
        }
        width = (2 * width).min(widest);
    }
}

/// What the search starts from: the responses to some of the training lights, which are in no order.
struct Start {
    /// `rows x lights`.
    responses: DMatrix<f64>,
    /// Right singular vectors of the responses, a column each, the strongest first.
    turned: DMatrix<f64>,
    /// Their squared singular values.
    energies: Vec<f64>,
}

impl Start {
    fn new(responses: View<'_>) -> Self {
        let stride = responses.columns().div_ceil(STARTING_LIGHTS).max(1);
        let some = responses.transposed().every(stride).transposed();
        let responses = DMatrix::from_fn(some.rows(), some.columns(), |i, j| f64::from(some.at(i, j)));
        let (turned, energies) = eigenvectors(responses.transpose() * &responses);
        Self { responses, turned, energies }
    }

    fn lights(&self) -> usize {
        self.energies.len()
    }

    /// How many directions bring more than `least` under the lights alone.
    fn worth(&self, least: f64) -> usize {
        self.energies.iter().take_while(|&&energy| LEARNED / self.lights() as f64 * energy > least).count()
    }

    /// `width` directions, a column each: the strongest of the responses, and where these are too few, evenly spaced rows.
    fn directions(&self, width: usize) -> DMatrix<f64> {
        let (rows, known) = (self.responses.nrows(), width.min(self.lights()).div_ceil(2));
        let mut start = DMatrix::zeros(rows, width);
        start.columns_mut(0, known).copy_from(&(&self.responses * self.turned.columns(0, known)));
        for column in known..width {
            start[((column - known) * rows / (width - known), column)] = 1.0;
        }
        start
    }
}

/// The eigenvectors of a positive matrix within what a step of subspace iteration makes of the columns of `start`, one after the other, the
/// strongest first, and their eigenvalues.
fn subspace(matrix: DMatrixView<'_, f64>, start: &DMatrix<f64>) -> (Vec<f32>, Vec<f64>) {
    let basis = orthonormalised(matrix * start);
    let (turned, energies) = eigenvectors(basis.transpose() * (matrix * &basis));
    // the columns of a matrix lie one after the other
    ((basis * turned).iter().map(|&value| value as f32).collect(), energies)
}

/// The eigenvectors of a symmetric matrix, a column each, and their eigenvalues, the largest first.
pub(super) fn eigenvectors(matrix: DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    let eigen = SymmetricEigen::new(matrix);
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let energies = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
    (eigen.eigenvectors.select_columns(&order), energies)
}

/// An orthonormal basis of the columns of a matrix, by two rounds of Cholesky QR: those of a power iteration are nearly parallel.
fn orthonormalised(mut matrix: DMatrix<f64>) -> DMatrix<f64> {
    for _ in 0..2 {
        let mut square = matrix.transpose() * &matrix;
        let ridge = 1e-14 * square.trace() + 1e-300;
        (0..square.nrows()).for_each(|i| square[(i, i)] += ridge);
        let inverse = square.cholesky().and_then(|factor| factor.l().try_inverse());
        let Some(inverse) = inverse else { break };
        matrix *= inverse.transpose();
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    #[test]
    fn orthonormal_bases_of_nearly_parallel_columns_are_orthonormal() {
        let nearly_one = |i: usize, j: usize| 1.0 + 1e-3 * f64::from(unit(hash(j as u32, i as u32)));
        let basis = orthonormalised(DMatrix::from_fn(64, 6, nearly_one));
        let square = basis.transpose() * basis;
        assert!((square - DMatrix::identity(6, 6)).abs().max() < 1e-5);
    }
}
