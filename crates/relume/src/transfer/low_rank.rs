//! `low-rank`, the default encoding: each block of rows shares one fine basis.
//!
//! `F_b ~= U_b V_b D^-1 W E^-1`: `E` the expected radiance of each gather sample, `W` the Haar transform, `D` the expected magnitude of light's coefficients, `V_b` the block's
//! strongest directions in that weighted space cut to its most important coefficients, `U_b` the weights of each row. Both are
//! quantised in equal steps of what they do to a row, in as few bits as that takes (`packed_runs`). This is clustered
//! principal component analysis (Huang and Ramamoorthi 2010) in the wavelet basis of Hasan 2006. How it is found is in
//! `low_rank_encoder.rs`; here it is kept and applied.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::culling::{Cut, Norms, Work};
use super::low_rank_encoder::Encoded;
use super::packed_runs::{PackedRuns, Product, RUN, Runs, runs_of};
use super::{Buffer, Coefficients};

/// How finely blocks are encoded.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LowRankSettings {
    /// Most directions a block.
    pub rank: usize,
    /// Most coefficients of each direction that are kept.
    pub kept: usize,
    /// What a byte must bring to be spent: the square of the light that it adds to a row, under light whose mean square on
    /// the cloud is one. Light from everywhere sends 1 to a row.
    pub price: f32,
}

/// Rows of the blocks that prices are meant for.
const USUAL_ROWS: f32 = 1024.0;

impl LowRankSettings {
    /// For blocks of so many rows. A direction of a small block is shared by fewer rows and brings less for its coefficients; small images
    /// have small blocks, and can afford it.
    #[must_use]
    pub(super) fn of_blocks(self, rows: usize) -> Self {
        Self { price: self.price * (rows as f32 / USUAL_ROWS).min(1.0), ..self }
    }
}

/// How large the parts of a block are.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable, serde::Serialize, serde::Deserialize,
)]
#[repr(C)]
pub struct BlockShape {
    /// Rows.
    pub rows: u32,
    /// Directions.
    pub rank: u32,
    /// Coefficients of each direction.
    pub kept: u32,
}

/// The blocks of one operator.
#[derive(Clone, Debug, Default)]
pub struct LowRank {
    /// One a block.
    pub shapes: Buffer<BlockShape>,
    /// Kept coefficients of all blocks, the most important first: the low 16 bits of their numbers.
    pub indices: Buffer<u16>,
    /// High bits of `indices`; empty where 16 bits are enough.
    pub high: Buffer<u8>,
    /// For each block, direction after direction: a value a kept coefficient.
    pub v: PackedRuns,
    /// One a direction.
    pub v_scales: Buffer<f32>,
    /// For each block, column after column: a weight a row.
    pub u: PackedRuns,
    /// One a column.
    pub u_scales: Buffer<f32>,
}

/// All of one part, block after block.
fn joined<T: bytemuck::Pod>(blocks: &[Encoded], part: impl Fn(&Encoded) -> &[T]) -> Buffer<T> {
    blocks.iter().flat_map(|block| part(block).iter().copied()).collect::<Vec<_>>().into()
}

impl LowRank {
    /// Puts blocks together, of light on `count` gather samples.
    pub(super) fn from_blocks(blocks: &[Encoded], count: usize) -> Self {
        let kept = || blocks.iter().flat_map(|block| &block.indices);
        let low = || kept().map(|index| *index as u16);
        let high =
            if count > 1 << 16 { kept().map(|index| (index >> 16) as u8).collect() } else { Vec::new() };
        Self {
            shapes: blocks.iter().map(|block| block.shape).collect::<Vec<_>>().into(),
            indices: low().collect::<Vec<u16>>().into(),
            high: high.into(),
            v: PackedRuns { widths: joined(blocks, |b| &b.v.widths), bytes: joined(blocks, |b| &b.v.bytes) },
            v_scales: joined(blocks, |b| &b.v_scales),
            u: PackedRuns { widths: joined(blocks, |b| &b.u.widths), bytes: joined(blocks, |b| &b.u.bytes) },
            u_scales: joined(blocks, |b| &b.u_scales),
        }
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.shapes)
            + size_of_val(&*self.indices)
            + self.high.len()
            + self.v.bytes()
            + size_of_val(&*self.v_scales)
            + self.u.bytes()
            + size_of_val(&*self.u_scales)
    }

    /// Whether all parts have the lengths that the shapes ask for, and no coefficient lies past `count`.
    pub(super) fn is_sound(&self, rows: usize, count: usize) -> bool {
        let sum = |of: fn(&BlockShape) -> u64| {
            self.shapes.iter().try_fold(0_u64, |sum, shape| sum.checked_add(of(shape)))
        };
        let is = |sum: Option<u64>, length: usize| sum == Some(length as u64);
        is(sum(|s| u64::from(s.rows)), rows)
            && is(sum(|s| u64::from(s.kept)), self.indices.len())
            && (self.high.is_empty() || self.high.len() == self.indices.len())
            && is(
                sum(|s| u64::from(s.rank).saturating_mul(runs_of(s.kept as usize) as u64)),
                self.v.widths.len(),
            )
            && is(
                sum(|s| u64::from(s.rank).saturating_mul(runs_of(s.rows as usize) as u64)),
                self.u.widths.len(),
            )
            && is(sum(|s| u64::from(s.rank)), self.v_scales.len())
            && self.v_scales.len() == self.u_scales.len()
            && self
                .v_scales
                .iter()
                .zip(&*self.u_scales)
                .all(|(v, u)| v.is_finite() && u.is_finite() && (v * u).is_finite())
            && self.v.is_sound()
            && self.u.is_sound()
            && (0..self.indices.len()).all(|at| self.index(at) < count)
    }

    fn index(&self, at: usize) -> usize {
        let high = self.high.get(at).copied().unwrap_or(0);
        usize::from(self.indices[at]) | usize::from(high) << 16
    }

    /// Light on the coefficients at these places, colour by colour.
    fn fetch(&self, places: Range<usize>, coefficients: &Coefficients, colors: [&mut [f32]; 3]) {
        let low = self.indices[places.clone()].iter().map(|&low| usize::from(low));
        if self.high.is_empty() {
            coefficients.fetch(low, colors);
        } else {
            let high = self.high[places].iter().map(|&high| usize::from(high) << 16);
            coefficients.fetch(low.zip(high).map(|(low, high)| low | high), colors);
        }
    }

    /// The parts are runs of kept coefficients of a block, as they are packed. Directions are taken as orthogonal.
    pub(super) fn norms(&self, count: usize) -> Norms {
        let (mut columns, mut runs) = (vec![0.0; count], Vec::new());
        let mut none = vec![Vec3::ZERO; self.rows()];
        let parts = self.parts(&mut none);
        let squares: Vec<_> = parts.par_iter().map(Part::column_squares).collect();
        for (part, squares) in parts.iter().zip(squares) {
            runs.extend(squares.chunks(RUN).map(|run| run.iter().fold(0.0, |most, &s| f32::max(most, s))));
            for (place, square) in part.kept.clone().zip(squares) {
                columns[self.index(place)] += f64::from(square);
            }
        }
        Norms::new(columns, runs)
    }

    fn rows(&self) -> usize {
        self.shapes.iter().map(|shape| shape.rows as usize).sum()
    }

    /// `out = F g`, for all rows in block order, from the weighted coefficients `D^-1 W E^-1 g`, without runs of coefficients that `cut`
    /// calls faint.
    pub(super) fn apply(&self, coefficients: &Coefficients, cut: Option<Cut<'_>>, out: &mut [Vec3]) -> Work {
        self.parts(out).into_par_iter().map(|part| part.apply(self, coefficients, cut)).sum()
    }

    fn parts<'a>(&'a self, mut out: &'a mut [Vec3]) -> Vec<Part<'a>> {
        let (mut v, mut u, mut first) = (self.v.runs(), self.u.runs(), 0);
        let (mut v_scales, mut u_scales) = (&self.v_scales[..], &self.u_scales[..]);
        let (mut parts, mut first_run) = (Vec::with_capacity(self.shapes.len()), 0);
        for shape in self.shapes.iter() {
            let (rows, rank, kept) = (shape.rows as usize, shape.rank as usize, shape.kept as usize);
            let (head, tail) = out.split_at_mut(rows);
            out = tail;
            parts.push(Part {
                kept: first..first + kept,
                v: v.take(rank * runs_of(kept)),
                v_scales: take(&mut v_scales, rank),
                u: u.take(rank * runs_of(rows)),
                u_scales: take(&mut u_scales, rank),
                out: head,
                first_run,
            });
            first += kept;
            first_run += runs_of(kept);
        }
        parts
    }
}

/// The sum of a run's squares.
fn square(run: &[f32; RUN]) -> f32 {
    let mut lanes = [0.0; 8];
    for part in run.as_chunks::<8>().0 {
        for (lane, value) in lanes.iter_mut().zip(part) {
            *lane += value * value;
        }
    }
    lanes.iter().sum()
}

fn take<'a, T>(slice: &mut &'a [T], count: usize) -> &'a [T] {
    let (head, tail) = slice.split_at(count);
    *slice = tail;
    head
}

/// One block's arrays and where its rows go.
struct Part<'a> {
    /// Which of the operator's places are the block's.
    kept: Range<usize>,
    v: Runs<'a>,
    v_scales: &'a [f32],
    u: Runs<'a>,
    u_scales: &'a [f32],
    out: &'a mut [Vec3],
    /// Runs of coefficients of all blocks before this one.
    first_run: usize,
}

impl Part<'_> {
    /// For each kept coefficient the squared norm of what it adds to the rows.
    fn column_squares(&self) -> Vec<f32> {
        let (runs, rows) = (runs_of(self.kept.len()), runs_of(self.out.len()));
        let (mut v, mut u) = (self.v, self.u);
        let mut squares = vec![0.0; runs * RUN];
        for (&v_scale, &u_scale) in self.v_scales.iter().zip(self.u_scales) {
            let scale = (v_scale * u_scale).powi(2) * u.take(rows).square();
            v.take(runs).add_squares(scale, &mut squares);
        }
        squares.truncate(self.kept.len());
        squares
    }

    /// Which runs of kept coefficients, whose light this is, are not left out.
    fn bright(&self, light: [&[f32]; 3], cut: Option<Cut<'_>>) -> Vec<bool> {
        let Some(cut) = cut else { return vec![true; runs_of(self.kept.len())] };
        let [(red, _), (green, _), (blue, _)] = light.map(|light| light.as_chunks::<RUN>());
        let runs = red.iter().zip(green).zip(blue).enumerate();
        runs.map(|(run, ((red, green), blue))| {
            let energy = [red, green, blue].map(square).iter().sum();
            !cut.is_faint(self.first_run + run, energy)
        })
        .collect()
    }

    fn apply(self, matrix: &LowRank, coefficients: &Coefficients, cut: Option<Cut<'_>>) -> Work {
        let runs = runs_of(self.kept.len());
        let mut gathered = vec![0.0; 3 * runs * RUN];
        let (red, rest) = gathered.split_at_mut(runs * RUN);
        let (green, blue) = rest.split_at_mut(runs * RUN);
        matrix.fetch(self.kept.clone(), coefficients, [red, green, blue]);
        let bright = self.bright([red, green, blue], cut);
        let rows = runs_of(self.out.len());
        let mut sums = vec![0.0; 3 * rows * RUN];
        let (red_sums, rest) = sums.split_at_mut(rows * RUN);
        let (green_sums, blue_sums) = rest.split_at_mut(rows * RUN);
        let product = Product { v: self.v, v_scales: self.v_scales, u: self.u, u_scales: self.u_scales };
        product.add([red, green, blue], &bright, [red_sums, green_sums, blue_sums]);
        for (row, out) in self.out.iter_mut().enumerate() {
            *out = Vec3::new(red_sums[row], green_sums[row], blue_sums[row]);
        }
        let culled = RUN * bright.iter().filter(|bright| !**bright).count();
        let entries = |a_direction: usize| (a_direction * self.v_scales.len()) as u64;
        Work { all: entries((runs + rows) * RUN), culled: entries(culled) }
    }
}
