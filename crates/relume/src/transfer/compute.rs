//! Computing an operator: blocks of rows are made, transformed, encoded and dropped.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::block_file::{BlockFile, Part, Shard};
use super::block_lengths;
use super::blocks::{Blocks, Served};
use super::haar_blocks::HaarBlocks;
use super::haar_rows::HaarRows;
use super::low_rank::{LowRank, LowRankSettings};
use super::low_rank_encoder;
use super::memory::Memory;
use super::needs::{BlockNeeds, encoded_coefficients, encoded_low_rank};
use super::paper_rows::PaperRows;
use super::photons::PhotonMap;
use super::prior::LightPrior;
use super::rows::{RowScratch, RowSource};
use super::selection::KeptRows;
use super::tiles::GatherPoint;
use super::workers::{self, side_by_side};
use super::{EncodingError, ImageLayout, Interpolation, Matrix, Operator, haar};
use crate::progress::Progress;
use crate::{Error, Result};

/// How rows are estimated.
#[derive(Clone, Copy)]
pub(super) enum RowEstimator<'a> {
    /// Two balanced estimators with shared visibility.
    Balanced(RowSource<'a>),
    /// A cluster cut with one representative a cluster (Hasan 2006, section 4.3).
    Paper(PaperRows<'a>),
    /// Photons, for rows of the multi-bounce operator (same section).
    Photons(&'a PhotonMap<'a>),
}

/// How rows are stored.
#[derive(Clone, Copy)]
pub(super) enum Encoder<'a> {
    LowRank { settings: LowRankSettings, prior: &'a LightPrior },
    Haar(Haar<'a>),
}

/// How rows are stored that keep coefficients of their own.
#[derive(Clone, Copy)]
pub(super) struct Haar<'a> {
    /// Coefficients a row.
    pub(super) per_row: usize,
    /// What their values are weighted by where some are dropped, one a coefficient.
    pub(super) weights: &'a [f32],
    /// Where rows lie, to be stored as images; else they are stored as rows.
    pub(super) layout: Option<&'a ImageLayout>,
}

/// What the errors of a row count for at least.
const LEAST_SERVED: f32 = 0.05;
/// The reflectance that the price of a byte is meant for: what a diffuse row says is multiplied by about this.
const USUAL_REFLECTANCE: f32 = 0.5;

/// The mean square of what the points' specular lobes reflect.
fn mean_square_reflectance(points: &[GatherPoint]) -> f32 {
    let square = |point: &GatherPoint| point.lobe.map_or(0.0, |lobe| lobe.reflectance().powi(2));
    points.iter().map(square).sum::<f32>() / points.len().max(1) as f32
}

/// Above how many times the usual price of a byte fewer coefficients are looked at.
const DEAR: f32 = 8.0;

impl Encoder<'_> {
    /// The encoder of rows whose errors count for so much of the picture: a byte is worth as much more.
    fn for_rows(self, served: Served) -> Self {
        let Self::LowRank { mut settings, prior } = self else { return self };
        settings.price /= served.errors.max(LEAST_SERVED);
        Self::LowRank { settings, prior }
    }

    /// The encoder of rows that are multiplied by something of this mean square: a byte brings so much less light.
    fn worth(self, mean_square: f32) -> Self {
        let Self::LowRank { mut settings, prior } = self else { return self };
        let dearer = USUAL_REFLECTANCE * USUAL_REFLECTANCE / mean_square;
        settings.price *= dearer;
        if dearer > DEAR {
            // it will not buy as many, and looking at fewer takes less time
            settings.kept /= 2;
        }
        Self::LowRank { settings, prior }
    }

    /// What a block of up to `rows` rows takes.
    fn needs(self, rows: usize, count: usize) -> BlockNeeds {
        match self {
            Self::LowRank { settings, prior } => {
                BlockNeeds::of_low_rank(rows, count, &settings, prior.lights + prior.held_lights)
            }
            Self::Haar(_) => BlockNeeds::of_rows(rows, count),
        }
    }

    /// What so many rows are expected to take once they are encoded, bytes.
    fn encoded(self, rows: usize) -> u64 {
        match self {
            Self::LowRank { settings, .. } => encoded_low_rank(rows, &settings),
            Self::Haar(haar) => encoded_coefficients(rows, haar.per_row),
        }
    }

    /// `rows` rows of `count` zeros.
    fn nothing(self, rows: usize, count: usize) -> EncodedBlock {
        match self {
            Self::LowRank { prior, .. } => {
                EncodedBlock::LowRank(vec![low_rank_encoder::nothing(rows, prior)])
            }
            Self::Haar(haar) => EncodedBlock::Haar(KeptRows::nothing(rows, count, haar.per_row)),
        }
    }
}

impl EncodedBlock {
    /// What it takes in memory.
    fn bytes(&self) -> usize {
        match self {
            Self::LowRank(blocks) => blocks.iter().map(low_rank_encoder::Encoded::memory).sum(),
            Self::Haar(rows) => rows.memory(),
        }
    }

    /// Makes what the block holds and misses count so many times.
    fn weigh(&mut self, weight: f64, served: Served) {
        let (light, errors) = (weight * f64::from(served.light), weight * f64::from(served.errors));
        match self {
            Self::LowRank(blocks) => {
                for block in blocks {
                    block.energy.iter_mut().for_each(|value| *value *= light);
                    block.lost.iter_mut().for_each(|value| *value *= errors);
                }
            }
            // these tell their losses as shares of the light
            Self::Haar(rows) => rows.weight *= light,
        }
    }
}

/// How operators are computed: estimated and stored.
#[derive(Clone, Copy)]
pub(super) struct Plan<'a> {
    pub(super) estimator: RowEstimator<'a>,
    pub(super) encoder: Encoder<'a>,
    /// Also the operator along the points' specular lobes, where any has one.
    pub(super) glossy: bool,
    /// Columns: cells of the cloud.
    pub(super) count: usize,
    /// How much of it blocks may take.
    pub(super) memory: Memory,
}

/// Operators and what they took.
pub(super) struct Computed {
    pub(super) operator: Operator,
    /// Along specular lobes, where it was asked for and there are any.
    pub(super) glossy: Option<Operator>,
    pub(super) rays: u64,
}

impl Computed {
    /// The same rows, from which all points take theirs, if that is how they do.
    pub(super) fn interpolated(self, interpolation: Option<Arc<Interpolation>>) -> Self {
        let Some(interpolation) = interpolation else { return self };
        Self {
            operator: self.operator.interpolated(Arc::clone(&interpolation)),
            glossy: self.glossy.map(|glossy| glossy.interpolated(interpolation)),
            ..self
        }
    }
}

/// Rows of one block and scratch memory; one a thread, reused.
#[derive(Default)]
struct Workplace {
    rows: Vec<f32>,
    haar: Vec<f32>,
    scratch: RowScratch,
}

/// A block of rows, as what it became.
#[derive(Serialize, Deserialize)]
enum EncodedBlock {
    /// One after the other.
    LowRank(Vec<low_rank_encoder::Encoded>),
    Haar(KeptRows),
}

/// A block of rows of both operators.
#[derive(Serialize, Deserialize)]
struct Done {
    diffuse: EncodedBlock,
    glossy: Option<EncodedBlock>,
    rays: u64,
}

impl Done {
    /// What it takes in memory, bytes.
    fn bytes(&self) -> u64 {
        (self.diffuse.bytes() + self.glossy.as_ref().map_or(0, EncodedBlock::bytes)) as u64
    }

    /// Whether it is what `plan` would make of so many rows, as far as one can see.
    fn is_sound(&self, plan: Plan<'_>, rows: usize) -> bool {
        let sound = |block: &EncodedBlock| match (block, plan.encoder) {
            (EncodedBlock::LowRank(blocks), Encoder::LowRank { prior, .. }) => {
                let all =
                    blocks.iter().try_fold(0_usize, |sum, block| sum.checked_add(block.shape.rows as usize));
                all == Some(rows) && blocks.iter().all(|block| block.is_sound(plan.count, prior.held_lights))
            }
            (EncodedBlock::Haar(kept), Encoder::Haar(haar)) => {
                kept.per_row == haar.per_row.min(plan.count) && kept.is_sound(rows, plan.count)
            }
            _ => false,
        };
        // as many rays as could have been traced, so that sums stay small
        self.rays <= MOST_RAYS
            && self.glossy.is_some() == plan.glossy
            && sound(&self.diffuse)
            && self.glossy.as_ref().is_none_or(sound)
    }
}

/// Most rays of a block that are believed.
const MOST_RAYS: u64 = 1 << 40;

/// Where finished blocks are found, and where they are kept.
#[derive(Clone, Copy, Default)]
pub(super) struct Finished<'a> {
    /// Read, and added to.
    pub(super) own: Option<&'a BlockFile>,
    /// Read.
    pub(super) others: &'a [BlockFile],
    /// Whether all are there, and none is to be computed.
    pub(super) complete: bool,
}

impl Finished<'_> {
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] where the content is no block of `rows` rows by `plan`.
    fn get(&self, part: Part, block: usize, plan: Plan<'_>, rows: usize) -> Result<Option<Done>> {
        for file in self.own.into_iter().chain(self.others) {
            if let Some(content) = file.get(part, block as u32)? {
                let done =
                    postcard::from_bytes(&content).ok().filter(|done: &Done| done.is_sound(plan, rows));
                let damaged = || {
                    Error::file(file.path(), "holds a block that makes no sense; remove it and prepare again")
                };
                return done.map(Some).ok_or_else(damaged);
            }
        }
        Ok(None)
    }

    /// # Errors
    /// [`Error::Io`].
    fn put(&self, part: Part, block: usize, done: &Done) -> Result<()> {
        let Some(file) = self.own else { return Ok(()) };
        let content = postcard::to_stdvec(done)
            .map_err(|error| Error::io(file.path(), "write", std::io::Error::other(error)))?;
        file.put(part, block as u32, &content)
    }
}

/// Blocks of rows that are estimated and encoded, or were before.
struct Work<'a> {
    plan: Plan<'a>,
    part: Part,
    runs: Vec<(&'a [GatherPoint], Served)>,
    finished: Finished<'a>,
}

impl<'a> Work<'a> {
    fn new(plan: Plan<'a>, part: Part, blocks: &'a Blocks, finished: Finished<'a>) -> Self {
        let mut runs = Vec::with_capacity(blocks.lengths.len());
        let mut rest = &blocks.points[..];
        for (&length, &served) in blocks.lengths.iter().zip(&blocks.served) {
            let (run, after) = rest.split_at(length);
            runs.push((run, served));
            rest = after;
        }
        let plan = Plan { glossy: plan.glossy && blocks.points.iter().any(|p| p.lobe.is_some()), ..plan };
        Self { plan, part, runs, finished }
    }

    /// What memory there is for blocks, and what they take; finished, all of them together.
    fn needs(&self) -> (Memory, BlockNeeds, u64) {
        let longest = self.runs.iter().map(|(run, _)| run.len()).max().unwrap_or(0);
        let encoded = self.plan.encoder.encoded(self.runs.iter().map(|(run, _)| run.len()).sum());
        let block = match self.finished.complete {
            true => BlockNeeds::default(),
            false => self.plan.encoder.needs(longest, self.plan.count),
        };
        (self.plan.memory, block, encoded)
    }

    fn block(&self, block: usize, workplace: &mut Workplace, progress: &dyn Progress) -> Result<Done> {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        let (points, served) = self.runs[block];
        let done = match self.finished.get(self.part, block, self.plan, points.len())? {
            Some(done) => done,
            None if self.finished.complete => {
                return Err(Error::Setting(format!(
                    "block {} of {} of the {} is in none of the files; give those of all shards, and run those again that did not end",
                    block + 1,
                    self.runs.len(),
                    self.part.name()
                )));
            }
            None => {
                let done = workplace.run(self.plan, points, served);
                self.finished.put(self.part, block, &done)?;
                done
            }
        };
        progress.advance(points.len() as u64);
        Ok(done)
    }
}

/// Computes the operators that gather at the points of `blocks`, but for what is there already.
///
/// # Errors
/// [`Error::Cancelled`]; of what is finished.
pub(super) fn compute(
    plan: Plan<'_>,
    (part, blocks): (Part, &Blocks),
    finished: Finished<'_>,
    progress: &dyn Progress,
) -> Result<Computed> {
    let work = Work::new(plan, part, blocks, finished);
    let done: Vec<Done> = side_by_side(work.runs.len(), work.needs(), |block, workplace| {
        let done = work.block(block, workplace, progress)?;
        let bytes = done.bytes();
        Ok((done, bytes))
    })?;
    let plan = work.plan;
    let rays = done.iter().map(|block| block.rays).sum();
    let (mut diffuse, mut glossy) = (Vec::new(), Vec::new());
    for block in done {
        diffuse.push(block.diffuse);
        glossy.extend(block.glossy);
    }
    let rows = blocks.points.len();
    let operator = assemble(diffuse, plan.encoder, rows, plan.count);
    let glossy = plan.glossy.then(|| assemble(glossy, plan.encoder, rows, plan.count));
    Ok(Computed { operator, glossy, rays })
}

/// Computes the blocks of a shard, but for what is there already, and keeps them in the file. Returns how many they are.
///
/// # Errors
/// As of [`compute`].
pub(super) fn compute_share(
    plan: Plan<'_>,
    (part, blocks): (Part, &Blocks),
    finished: Finished<'_>,
    shard: Shard,
    progress: &dyn Progress,
) -> Result<usize> {
    let work = Work::new(plan, part, blocks, finished);
    let share: Vec<usize> = (0..work.runs.len()).filter(|&block| shard.has(block as u32)).collect();
    progress.stage(part.name(), share.iter().map(|&block| work.runs[block].0.len() as u64).sum());
    let (memory, block, _) = work.needs();
    let made = side_by_side(share.len(), (memory, block, 0), |place, workplace| {
        work.block(share[place], workplace, progress).map(|_| ((), 0))
    })?;
    Ok(made.len())
}

/// What the blocks `which` lose of the light that is sent to them when they are encoded at each of `prices`, in units of the plan's: squares, relative.
/// Zero where no light is sent, and for encodings that know no price.
///
/// # Errors
/// [`Error::Cancelled`].
pub(super) fn losses(
    plan: Plan<'_>,
    blocks: &Blocks,
    which: &[usize],
    prices: &[f32],
    progress: &dyn Progress,
) -> Result<Vec<f64>> {
    let Encoder::LowRank { settings, prior } = plan.encoder else { return Ok(vec![0.0; prices.len()]) };
    let plan = Plan { glossy: false, ..plan };
    let of_block = |block: usize, workplace: &mut Workplace| {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        let first: usize = blocks.lengths[..block].iter().sum();
        let points = &blocks.points[first..first + blocks.lengths[block]];
        workplace.estimate(plan, points);
        workplace.transform(plan.count, Some(prior));
        let served = blocks.served[block];
        let dear = settings.price / served.errors.max(LEAST_SERVED);
        let at = |price: &f32| LowRankSettings { price: dear * price, ..settings };
        let encode = |price: &f32| block_lengths::encode(&workplace.rows, points.len(), &at(price), prior);
        let alike = |values: &[f64]| values[..prior.held_alike].iter().sum::<f64>();
        let sums = |blocks: Vec<low_rank_encoder::Encoded>| {
            blocks.iter().fold((0.0, 0.0), |(energy, lost), block| {
                let (light, errors) = (f64::from(served.light), f64::from(served.errors));
                (energy + light * alike(&block.energy), lost + errors * alike(&block.lost))
            })
        };
        let lost = prices.iter().map(encode).map(sums).collect::<Vec<_>>();
        progress.advance(points.len() as u64);
        Ok(lost)
    };
    let longest = blocks.lengths.iter().copied().max().unwrap_or(0);
    let needs = (plan.memory, plan.encoder.needs(longest, plan.count), 0);
    let blocks =
        side_by_side(which.len(), needs, |place, workplace| Ok((of_block(which[place], workplace)?, 0)))?;
    let sum = |price: usize| {
        blocks
            .iter()
            .fold((0.0, 0.0), |(energy, lost), block| (energy + block[price].0, lost + block[price].1))
    };
    Ok((0..prices.len())
        .map(sum)
        .map(|(energy, lost)| if energy > 0.0 { lost / energy } else { 0.0 })
        .collect())
}

impl workers::Workplace for Workplace {
    fn bytes(&self) -> u64 {
        let values = self.rows.capacity() + self.haar.capacity();
        (values * size_of::<f32>() + self.scratch.bytes()) as u64
    }
}

impl Workplace {
    fn run(&mut self, plan: Plan<'_>, points: &[GatherPoint], served: Served) -> Done {
        let mut rays = self.estimate(plan, points);
        let encoder = plan.encoder.for_rows(served);
        let mut diffuse = self.encode(encoder, plan.count, points.len());
        diffuse.weigh(1.0, served);
        let glossy = plan.glossy.then(|| {
            let square = mean_square_reflectance(points);
            if square == 0.0 {
                return plan.encoder.nothing(points.len(), plan.count);
            }
            rays += self.estimate_glossy(plan, points);
            let mut block = self.encode(encoder.worth(square), plan.count, points.len());
            block.weigh(f64::from(square), served);
            block
        });
        Done { diffuse, glossy, rays }
    }

    fn estimate(&mut self, plan: Plan<'_>, points: &[GatherPoint]) -> u64 {
        self.scratch.keep = plan.glossy && points.iter().any(|point| point.lobe.is_some());
        self.clear(points.len() * plan.count);
        match plan.estimator {
            RowEstimator::Balanced(source) => source.block(points, &mut self.rows, &mut self.scratch),
            RowEstimator::Paper(source) => points
                .iter()
                .zip(self.rows.chunks_exact_mut(plan.count))
                .map(|(point, row)| source.row(point, row))
                .sum(),
            RowEstimator::Photons(photons) => points
                .iter()
                .zip(self.rows.chunks_exact_mut(plan.count))
                .map(|(point, row)| photons.row(point, row))
                .sum(),
        }
    }

    /// The glossy rows of the points that [`Self::estimate`] was last called for.
    fn estimate_glossy(&mut self, plan: Plan<'_>, points: &[GatherPoint]) -> u64 {
        self.clear(points.len() * plan.count);
        match plan.estimator {
            RowEstimator::Balanced(source) => source.glossy_block(points, &mut self.rows, &mut self.scratch),
            RowEstimator::Paper(source) => points
                .iter()
                .zip(self.rows.chunks_exact_mut(plan.count))
                .map(|(point, row)| source.glossy_row(point, row))
                .sum(),
            // photons are counted on gather samples, which reflect diffusely
            RowEstimator::Photons(_) => 0,
        }
    }

    fn clear(&mut self, length: usize) {
        self.rows.clear();
        self.rows.resize(length, 0.0);
    }

    /// Replaces the rows by their Haar coefficients, weighted by the prior before and after if there is one.
    fn transform(&mut self, count: usize, prior: Option<&LightPrior>) {
        self.haar.resize(count, 0.0);
        let weigh =
            |row: &mut [f32], by: &[f32]| row.iter_mut().zip(by).for_each(|(value, weight)| *value *= weight);
        for row in self.rows.chunks_exact_mut(count) {
            if let Some(prior) = prior {
                weigh(row, &prior.expected);
            }
            haar::forward(row, &mut self.haar);
            if let Some(prior) = prior {
                weigh(row, &prior.magnitudes);
            }
        }
    }

    fn encode(&mut self, encoder: Encoder<'_>, count: usize, rows: usize) -> EncodedBlock {
        match encoder {
            Encoder::LowRank { settings, prior } => {
                self.transform(count, Some(prior));
                EncodedBlock::LowRank(block_lengths::encode(&self.rows, rows, &settings, prior))
            }
            Encoder::Haar(haar) => {
                self.transform(count, None);
                EncodedBlock::Haar(KeptRows::of(&self.rows, haar.weights, haar.per_row))
            }
        }
    }
}

fn assemble(blocks: Vec<EncodedBlock>, encoder: Encoder<'_>, rows: usize, count: usize) -> Operator {
    let (mut low_rank, mut kept) = (Vec::new(), Vec::new());
    for block in blocks {
        match block {
            EncodedBlock::LowRank(blocks) => low_rank.extend(blocks),
            EncodedBlock::Haar(rows) => kept.push(rows),
        }
    }
    match encoder {
        Encoder::LowRank { prior, .. } => {
            let (mut energy, mut lost) = (Vec::new(), Vec::new());
            for block in &low_rank {
                add(&mut energy, &block.energy);
                add(&mut lost, &block.lost);
            }
            let inverse =
                |values: &[f32]| values.iter().map(|value| 1.0 / value).collect::<Vec<f32>>().into();
            let weights = (inverse(&prior.expected), inverse(&prior.magnitudes));
            let matrix = Matrix::LowRank(LowRank::from_blocks(&low_rank, count));
            let ((alike, others), (lost_alike, lost_others)) = (
                energy.split_at(prior.held_alike.min(energy.len())),
                lost.split_at(prior.held_alike.min(lost.len())),
            );
            let error = EncodingError {
                expected: relative_error(alike, lost_alike),
                other_lights: relative_error(others, lost_others),
            };
            Operator::new(rows, matrix, weights, error)
        }
        Encoder::Haar(haar) => {
            let (energy, dropped) = energy_of(&kept);
            let (matrix, coarse) = match haar.layout {
                None => {
                    let (matrix, coarse) = HaarRows::encode(&kept, count);
                    (Matrix::HaarRows(matrix), coarse)
                }
                Some(layout) => {
                    let (matrix, coarse) = HaarBlocks::encode(&kept, layout.clone());
                    (Matrix::HaarBlocks(matrix), coarse)
                }
            };
            let error = EncodingError {
                expected: relative_error(&[energy], &[dropped + coarse]),
                other_lights: None,
            };
            Operator::new(rows, matrix, Default::default(), error)
        }
    }
}

/// The weighted energy of rows, and that of the coefficients which they do not keep.
fn energy_of(rows: &[KeptRows]) -> (f64, f64) {
    let (mut all, mut dropped) = (0.0, 0.0);
    for block in rows {
        for (_, values, energy) in block.rows() {
            let kept: f64 = values.iter().map(|&value| f64::from(value).powi(2)).sum();
            all += block.weight * energy;
            dropped += block.weight * (energy - kept).max(0.0);
        }
    }
    (all, dropped)
}

fn add(sums: &mut Vec<f64>, values: &[f64]) {
    sums.resize(values.len().max(sums.len()), 0.0);
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

/// The relative error of all lights' images taken as one; `None` without light.
fn relative_error(energy: &[f64], lost: &[f64]) -> Option<f64> {
    let energy: f64 = energy.iter().sum();
    (energy > 0.0).then(|| (lost.iter().sum::<f64>() / energy).sqrt())
}
