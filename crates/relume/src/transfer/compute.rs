//! Computing an operator: blocks of rows are made, transformed, encoded and dropped.

use std::sync::Mutex;

use rayon::prelude::*;

use super::form_factors::Patches;
use super::haar_rows::{self, HaarRows};
use super::low_rank::{self, LowRank, LowRankSettings};
use super::paper_rows::PaperRows;
use super::rows::{self, GatherPoint, RowScratch, RowSource};
use super::{Matrix, Operator, haar};
use crate::progress::Progress;
use crate::{Error, Result};

/// How rows are estimated.
#[derive(Clone, Copy)]
pub(super) enum RowEstimator<'a> {
    /// Two balanced estimators with shared visibility.
    Balanced(RowSource<'a>),
    /// A cluster cut with one representative a cluster (Hasan 2006, section 4.3).
    Paper(PaperRows<'a>),
}

/// How rows are stored.
#[derive(Clone, Copy)]
pub(super) enum Encoder<'a> {
    LowRank {
        settings: LowRankSettings,
        /// `D`, one a coefficient.
        prior: &'a [f32],
    },
    HaarRows {
        per_row: usize,
    },
}

/// An operator and what it took.
pub(super) struct Computed {
    pub(super) operator: Operator,
    pub(super) rays: u64,
}

/// Rows of one block and scratch memory; one a thread, reused.
#[derive(Default)]
struct Workplace {
    rows: Vec<f32>,
    haar: Vec<f32>,
    scratch: RowScratch,
}

enum EncodedBlock {
    LowRank(low_rank::Encoded),
    HaarRows(haar_rows::EncodedRows),
}

/// Computes the operator that gathers at `points`, whose blocks are runs of the lengths `blocks`.
pub(super) fn compute(
    estimator: RowEstimator<'_>,
    encoder: Encoder<'_>,
    patches: &Patches,
    points: &[GatherPoint],
    blocks: &[usize],
    progress: &dyn Progress,
) -> Result<Computed> {
    let mut runs = Vec::with_capacity(blocks.len());
    let mut rest = points;
    for &length in blocks {
        let (run, after) = rest.split_at(length);
        runs.push(run);
        rest = after;
    }
    let workplaces: Mutex<Vec<Workplace>> = Mutex::default();
    let encoded: Vec<(EncodedBlock, u64)> = runs
        .into_par_iter()
        .with_max_len(1)
        .map(|points| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let taken = workplaces.lock().map(|mut idle| idle.pop());
            let mut workplace = taken.ok().flatten().unwrap_or_default();
            let rays = workplace.estimate(estimator, patches.len(), points);
            let encoded = workplace.encode(encoder, patches.len(), points.len());
            if let Ok(mut idle) = workplaces.lock() {
                idle.push(workplace);
            }
            progress.advance(points.len() as u64);
            Ok((encoded, rays))
        })
        .collect::<Result<_>>()?;
    let rays = encoded.iter().map(|(_, rays)| rays).sum();
    let operator = assemble(encoded, encoder, points.len(), patches.len());
    Ok(Computed { operator, rays })
}

impl Workplace {
    fn estimate(&mut self, estimator: RowEstimator<'_>, count: usize, points: &[GatherPoint]) -> u64 {
        self.rows.clear();
        self.rows.resize(points.len() * count, 0.0);
        match estimator {
            RowEstimator::Balanced(source) => rows::tiles(points)
                .iter()
                .map(|tile| source.tile(points, tile, &mut self.rows, &mut self.scratch))
                .sum(),
            RowEstimator::Paper(source) => points
                .iter()
                .zip(self.rows.chunks_exact_mut(count))
                .map(|(point, row)| source.row(point, row))
                .sum(),
        }
    }

    fn encode(&mut self, encoder: Encoder<'_>, count: usize, rows: usize) -> EncodedBlock {
        self.haar.resize(count, 0.0);
        for row in self.rows.chunks_exact_mut(count) {
            haar::forward(row, &mut self.haar);
            if let Encoder::LowRank { prior, .. } = encoder {
                row.iter_mut().zip(prior).for_each(|(value, magnitude)| *value *= magnitude);
            }
        }
        match encoder {
            Encoder::LowRank { settings, .. } => {
                EncodedBlock::LowRank(low_rank::encode(&self.rows, rows, &settings))
            }
            Encoder::HaarRows { per_row } => {
                EncodedBlock::HaarRows(haar_rows::encode(&self.rows, count, per_row))
            }
        }
    }
}

fn assemble(blocks: Vec<(EncodedBlock, u64)>, encoder: Encoder<'_>, rows: usize, count: usize) -> Operator {
    let (mut low_rank, mut haar_rows) = (Vec::new(), Vec::new());
    let (mut energy, mut lost) = (0.0, 0.0);
    for (block, _) in blocks {
        match block {
            EncodedBlock::LowRank(block) => {
                energy += block.energy;
                lost += block.lost;
                low_rank.push(block);
            }
            EncodedBlock::HaarRows(block) => {
                energy += block.energy;
                lost += block.lost;
                haar_rows.push(block);
            }
        }
    }
    let expected_error = if energy > 0.0 { (lost / energy).sqrt() } else { 0.0 };
    let (matrix, weights) = match encoder {
        Encoder::LowRank { prior, .. } => (
            Matrix::LowRank(LowRank::from_blocks(low_rank)),
            prior.iter().map(|magnitude| 1.0 / magnitude).collect::<Vec<_>>(),
        ),
        Encoder::HaarRows { per_row } => {
            (Matrix::HaarRows(HaarRows::from_blocks(haar_rows, per_row, count)), Vec::new())
        }
    };
    Operator { rows, matrix, weights: weights.into(), expected_error }
}
