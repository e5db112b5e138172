//! A run of rows as the encoder of [`low_rank`](super::low_rank) sees it: what is found once for all blocks that it may be parted into.
//!
//! The directions of a block are eigenvectors of `X S X^T`, which has a row and a column for each of the block's rows. That of the whole
//! run holds those of all its parts, where these look at the same coefficients: so it is computed once, and no part's search
//! has to go through its coefficients again.

use std::ops::Range;

use multiversion::multiversion;
use nalgebra::{DMatrix, DMatrixView};

use super::gemm::{View, product};
use super::low_rank::LowRankSettings;
use super::prior::LightPrior;

/// `a`: how far the training lights are trusted about what goes together.
pub(super) const LEARNED: f64 = 0.75;
/// Bytes of a kept coefficient that no direction pays for: its place.
pub(super) const PLACE_BYTES: f64 = 2.0;
/// Bytes of a weight of the weakest direction that is kept, and of one of its coefficients: half a byte and two bits. Half of these and
/// twice these were as good.
pub(super) const WEAKEST: (f64, f64) = (0.5, 0.25);
/// Coefficients that the search looks at beside the most that are kept: half as many again.
const CANDIDATES: f64 = 1.5;
/// The search does not look at coefficients of which all rows together have so small a part of what one must bring to be kept: together they tell of
/// the light on others. At 1, 3 and 6 the encoding of the same rows lost 2.64, 2.70 and 2.92%, when the responses were those of candidates alone.
const FAINTEST: f64 = 0.25;
/// Rows of `X S X^T` that are computed together: it is symmetric, and of each such strip what lies beyond is known.
const STRIP: usize = 256;
/// Columns that are added up in single precision. Rows have most of their light in common, and differ by the little that directions are worth: more
/// columns would lose it in rounding.
const SUMMED: usize = 1024;

/// Coefficients whose responses are computed together.
pub(super) const HEARD_TOGETHER: usize = 4096;
/// A coefficient of which all rows together have less than this share of what a candidate must have does not count in responses. Each of those in between is next
/// to nothing, but of a floor's light they are several percent together.
const INAUDIBLE: f64 = 0.05;

/// A run of rows of weighted coefficients (`X = F E W^T D`), cut to the coefficients that the search looks at.
pub(super) struct Run {
    /// The numbers of these, ascending.
    pub(super) candidates: Vec<u32>,
    /// `X`, `rows x width`.
    x: Vec<f32>,
    /// `C`, `width x lights`.
    pub(super) learned: Vec<f32>,
    /// `X C`: what training lights send to the rows, by candidates and by others, `rows x lights`.
    responses: Vec<f32>,
    /// `X S X^T`, `rows x rows`; of the candidates where light is not learned.
    covariance: DMatrix<f64>,
    /// The squared norm of each row, with what is not among the candidates.
    energies: Vec<f64>,
    rows: usize,
    /// Coefficients of a row, of which the candidates are some.
    pub(super) count: usize,
    pub(super) lights: usize,
    pub(super) settings: LowRankSettings,
}

/// Some of the rows of a run, one after the other.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) run: &'a Run,
    pub(super) x: View<'a>,
    pub(super) responses: View<'a>,
    rows: (usize, usize),
    /// The squared norm of its rows.
    pub(super) energy: f64,
}

impl Run {
    /// Of `rows` rows of `x`, row after row.
    pub(super) fn new(x: &[f32], rows: usize, settings: &LowRankSettings, prior: &LightPrior) -> Self {
        let count = x.len().checked_div(rows).unwrap_or(0);
        let (importance, energies) = column_and_row_energies(x, count);
        let most = ((CANDIDATES * settings.kept as f64) as usize).min(count);
        let mut candidates = strongest(&importance, most);
        // in no part and along no direction does a coefficient bring more than all that is in it
        let least = FAINTEST * f64::from(settings.price) * (PLACE_BYTES + WEAKEST.1);
        candidates.retain(|&candidate| f64::from(importance[candidate as usize]) > least);
        let (width, lights) = (candidates.len(), prior.lights);
        let compact = compacted(x, count, &candidates);
        let learned = rows_of(&prior.training, lights, candidates.iter().copied());
        let responses = responses((x, rows), &importance, INAUDIBLE * least, prior);
        let covariance = covariance(View::new(&compact, rows, width), View::new(&responses, rows, lights));
        Self {
            candidates,
            x: compact,
            learned,
            responses,
            covariance,
            energies,
            rows,
            count,
            lights,
            settings: *settings,
        }
    }

    /// Its rows `rows`.
    pub(super) fn part(&self, rows: Range<usize>) -> Part<'_> {
        let width = self.candidates.len();
        let whole = [(&self.x, width), (&self.responses, self.lights)];
        let [x, responses] = whole.map(|(values, columns)| View::new(values, self.rows, columns));
        Part {
            run: self,
            x: x.part(rows.clone(), 0..width),
            responses: responses.part(rows.clone(), 0..self.lights),
            rows: (rows.start, rows.len()),
            energy: self.energies[rows].iter().sum(),
        }
    }
}

impl Part<'_> {
    /// `X S X^T`.
    pub(super) fn covariance(&self) -> DMatrixView<'_, f64> {
        let (first, count) = self.rows;
        self.run.covariance.view((first, first), (count, count))
    }
}

/// `X S X^T`, from `X` and `X C`.
fn covariance(x: View<'_>, responses: View<'_>) -> DMatrix<f64> {
    let rows = x.rows();
    let mut sums = vec![0.0; rows * rows];
    for (values, weight) in [(x, 1.0 - LEARNED), (responses, LEARNED / responses.columns().max(1) as f64)] {
        for first in (0..values.columns()).step_by(SUMMED) {
            let columns = first..(first + SUMMED).min(values.columns());
            add_squared(values.part(0..rows, columns), weight, &mut sums);
        }
    }
    // row after row and below the diagonal, which is column after column and above it
    let mut all = DMatrix::from_vec(rows, rows, sums);
    all.fill_lower_triangle_with_upper_triangle();
    all
}

/// `X C` of `rows` rows of `x`, over the coefficients that have more than `least` by `importance`, the squares of all rows.
fn responses((x, rows): (&[f32], usize), importance: &[f32], least: f64, prior: &LightPrior) -> Vec<f32> {
    let heard: Vec<u32> = (0..importance.len() as u32)
        .filter(|&column| f64::from(importance[column as usize]) > least)
        .collect();
    let mut responses = vec![0.0; rows * prior.lights];
    for columns in heard.chunks(HEARD_TOGETHER) {
        let light = rows_of(&prior.training, prior.lights, columns.iter().copied());
        let part = product(
            View::new(&compacted(x, importance.len(), columns), rows, columns.len()),
            View::new(&light, columns.len(), prior.lights),
        );
        responses.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
    }
    responses
}

/// Adds `weight` times the product of a matrix with itself, transposed, below the diagonal.
fn add_squared(values: View<'_>, weight: f64, sums: &mut [f64]) {
    let (rows, columns) = (values.rows(), 0..values.columns());
    for first in (0..rows).step_by(STRIP) {
        let end = (first + STRIP).min(rows);
        let strip = values.part(first..end, columns.clone());
        let square = product(strip, values.part(0..end, columns.clone()).transposed());
        for (sums, square) in sums[first * rows..].chunks_exact_mut(rows).zip(square.chunks_exact(end)) {
            sums.iter_mut().zip(square).for_each(|(sum, square)| *sum += weight * f64::from(*square));
        }
    }
}

/// The sums of the squares of each of `count` columns, and of each row.
fn column_and_row_energies(x: &[f32], count: usize) -> (Vec<f32>, Vec<f64>) {
    let mut columns = vec![0.0; count];
    let of_row = |row: &[f32]| {
        add_squares(&mut columns, row);
        f64::from(square(row))
    };
    let rows = x.chunks_exact(count.max(1)).map(of_row).collect();
    (columns, rows)
}

/// The sum of the squares of each of `count` columns.
pub(super) fn column_energies(x: &[f32], count: usize) -> Vec<f32> {
    let mut energies = vec![0.0; count];
    for row in x.chunks_exact(count.max(1)) {
        add_squares(&mut energies, row);
    }
    energies
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn add_squares(sums: &mut [f32], values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value * value;
    }
}

/// The squared norm of a row.
fn square(row: &[f32]) -> f32 {
    let mut sums = [0.0; 64];
    let (chunks, rest) = row.as_chunks::<64>();
    chunks.iter().for_each(|chunk| add_squares(&mut sums, chunk));
    sums.iter().sum::<f32>() + rest.iter().map(|value| value * value).sum::<f32>()
}

/// The numbers of the `count` largest entries, ascending; ties go to the smaller number.
pub(super) fn strongest(values: &[f32], count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..values.len() as u32).collect();
    if count < order.len() {
        order.select_nth_unstable_by(count, |&a, &b| {
            values[b as usize].total_cmp(&values[a as usize]).then(a.cmp(&b))
        });
        order.truncate(count);
    }
    order.sort_unstable();
    order
}

/// The columns `candidates` of `x`.
fn compacted(x: &[f32], count: usize, candidates: &[u32]) -> Vec<f32> {
    let mut compact = Vec::with_capacity(x.len() / count.max(1) * candidates.len());
    for row in x.chunks_exact(count.max(1)) {
        compact.extend(candidates.iter().map(|&column| row[column as usize]));
    }
    compact
}

/// The rows `which` of a matrix of `columns` columns.
pub(super) fn rows_of(values: &[f32], columns: usize, which: impl ExactSizeIterator<Item = u32>) -> Vec<f32> {
    let mut picked = Vec::with_capacity(which.len() * columns);
    for row in which {
        picked.extend_from_slice(&values[row as usize * columns..(row as usize + 1) * columns]);
    }
    picked
}

#[cfg(test)]
#[path = "low_rank_run_tests.rs"]
mod tests;
