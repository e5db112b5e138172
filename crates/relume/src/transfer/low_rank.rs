//! `low-rank`, the default encoding: each block of rows shares one fine basis.
//!
//! `F_b ~= U_b V_b D^-1 W`: `W` the Haar transform, `D` the expected magnitude of light's coefficients, `V_b` the block's
//! strongest directions in that weighted space cut to its most important coefficients, `U_b` the weights of each row. `V` is
//! companded to 8 bits (`q |q| scale`, a scale a direction), `U` linear in 8 bits (a scale a column). This is clustered
//! principal component analysis (Huang and Ramamoorthi 2010) in the wavelet basis of Hasan 2006. How it is found is in
//! `low_rank_encoder.rs`; here it is kept and applied.

use std::ops::Range;

use glam::Vec3;
use multiversion::multiversion;
use rayon::prelude::*;

use super::culling::{Cut, Norms, Work, energy};
use super::low_rank_encoder::Encoded;
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

/// Where a block's parts begin, and how large they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
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
    /// Kept coefficients of all blocks, ascending within a block, each as its distance from the one before.
    pub steps: Buffer<u16>,
    /// For each block, direction after direction.
    pub v: Buffer<i8>,
    /// One a direction.
    pub v_scales: Buffer<f32>,
    /// For each block, column after column of one weight a row.
    pub u: Buffer<i8>,
    /// One a column.
    pub u_scales: Buffer<f32>,
}

impl LowRank {
    pub(super) fn from_blocks(blocks: Vec<Encoded>) -> Self {
        let shapes: Vec<BlockShape> = blocks.iter().map(|block| block.shape).collect();
        Self {
            shapes: shapes.into(),
            steps: blocks.iter().flat_map(|b| b.steps.iter().copied()).collect::<Vec<_>>().into(),
            v: blocks.iter().flat_map(|b| b.v.iter().copied()).collect::<Vec<_>>().into(),
            v_scales: blocks.iter().flat_map(|b| b.v_scales.iter().copied()).collect::<Vec<_>>().into(),
            u: blocks.iter().flat_map(|b| b.u.iter().copied()).collect::<Vec<_>>().into(),
            u_scales: blocks.iter().flat_map(|b| b.u_scales.iter().copied()).collect::<Vec<_>>().into(),
        }
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.shapes)
            + size_of_val(&*self.steps)
            + self.v.len()
            + size_of_val(&*self.v_scales)
            + self.u.len()
            + size_of_val(&*self.u_scales)
    }

    /// Whether all parts have the lengths that the shapes ask for, and no coefficient lies past `count`.
    pub(super) fn is_sound(&self, rows: usize, count: usize) -> bool {
        let sum = |of: fn(&BlockShape) -> u64| self.shapes.iter().map(of).sum::<u64>();
        let in_range = |steps: &[u16]| {
            steps.iter().map(|&step| u64::from(step)).sum::<u64>() < count as u64 || steps.is_empty()
        };
        sum(|s| u64::from(s.rows)) == rows as u64
            && sum(|s| u64::from(s.kept)) == self.steps.len() as u64
            && sum(|s| u64::from(s.rank) * u64::from(s.kept)) == self.v.len() as u64
            && sum(|s| u64::from(s.rank) * u64::from(s.rows)) == self.u.len() as u64
            && sum(|s| u64::from(s.rank)) == self.v_scales.len() as u64
            && self.v_scales.len() == self.u_scales.len()
            && self.steps_of_blocks().all(in_range)
    }

    fn steps_of_blocks(&self) -> impl Iterator<Item = &[u16]> {
        let mut rest = &self.steps[..];
        self.shapes.iter().map(move |shape| {
            let (steps, after) = rest.split_at(shape.kept as usize);
            rest = after;
            steps
        })
    }

    /// The parts are runs of [`LANES`] kept coefficients of a block. Directions are taken as orthogonal.
    pub(super) fn norms(&self, count: usize) -> Norms {
        let (mut columns, mut runs) = (vec![0.0; count], Vec::new());
        for part in self.parts(&mut vec![Vec3::ZERO; self.rows()]) {
            let squares = part.column_squares();
            runs.extend(squares.chunks(LANES).map(|run| run.iter().fold(0.0, |most, &s| f32::max(most, s))));
            for (index, square) in part.indices().zip(squares) {
                columns[index] += f64::from(square);
            }
        }
        Norms::new(columns, runs)
    }

    fn rows(&self) -> usize {
        self.shapes.iter().map(|shape| shape.rows as usize).sum()
    }

    /// `out = F g`, for all rows in block order, from the weighted coefficients `D^-1 W g`, without runs of coefficients that `cut`
    /// calls faint.
    pub(super) fn apply(&self, coefficients: &Coefficients, cut: Option<Cut<'_>>, out: &mut [Vec3]) -> Work {
        self.parts(out).into_par_iter().map(|part| part.apply(coefficients, cut)).sum()
    }

    fn parts<'a>(&'a self, mut out: &'a mut [Vec3]) -> Vec<Part<'a>> {
        let (mut steps, mut v, mut u) = (&self.steps[..], &self.v[..], &self.u[..]);
        let (mut v_scales, mut u_scales) = (&self.v_scales[..], &self.u_scales[..]);
        let (mut parts, mut first_run) = (Vec::with_capacity(self.shapes.len()), 0);
        for shape in self.shapes.iter() {
            let (rows, rank, kept) = (shape.rows as usize, shape.rank as usize, shape.kept as usize);
            let (head, tail) = out.split_at_mut(rows);
            out = tail;
            parts.push(Part {
                steps: take(&mut steps, kept),
                v: take(&mut v, kept * rank),
                v_scales: take(&mut v_scales, rank),
                u: take(&mut u, rows * rank),
                u_scales: take(&mut u_scales, rank),
                out: head,
                first_run,
            });
            first_run += kept.div_ceil(LANES);
        }
        parts
    }
}

fn take<'a, T>(slice: &mut &'a [T], count: usize) -> &'a [T] {
    let (head, tail) = slice.split_at(count);
    *slice = tail;
    head
}

/// One block's arrays and where its rows go.
struct Part<'a> {
    steps: &'a [u16],
    v: &'a [i8],
    v_scales: &'a [f32],
    u: &'a [i8],
    u_scales: &'a [f32],
    out: &'a mut [Vec3],
    /// Runs of coefficients of all blocks before this one.
    first_run: usize,
}

/// Coefficients that are taken, or left out, together.
const LANES: usize = 16;

impl Part<'_> {
    /// The kept coefficients, ascending.
    fn indices(&self) -> impl Iterator<Item = usize> {
        self.steps.iter().scan(0, |index, &step| {
            *index += usize::from(step);
            Some(*index)
        })
    }

    /// For each kept coefficient the squared norm of what it adds to the rows.
    fn column_squares(&self) -> Vec<f32> {
        let mut squares = vec![0.0; self.steps.len()];
        for (direction, (&v_scale, &u_scale)) in self.v_scales.iter().zip(self.u_scales).enumerate() {
            let u = &self.u[direction * self.out.len()..(direction + 1) * self.out.len()];
            let u: f32 = u.iter().map(|&q| f32::from(q).powi(2)).sum();
            let scale = (v_scale * u_scale).powi(2) * u;
            let v = &self.v[direction * squares.len()..(direction + 1) * squares.len()];
            squares.iter_mut().zip(v).for_each(|(sum, &q)| *sum += scale * f32::from(q).powi(4));
        }
        squares
    }

    /// Which of the kept coefficients, whose light this is, are not left out.
    fn bright(&self, [red, green, blue]: [&[f32]; 3], cut: Option<Cut<'_>>) -> Vec<Range<usize>> {
        let kept = red.len();
        let Some(cut) = cut else { return std::iter::once(0..kept).collect() };
        let mut bright: Vec<Range<usize>> = Vec::new();
        for (run, start) in (0..kept).step_by(LANES).enumerate() {
            let run_end = (start + LANES).min(kept);
            let light: f32 =
                (start..run_end).map(|place| energy([red[place], green[place], blue[place]])).sum();
            if cut.is_faint(self.first_run + run, light) {
                continue;
            }
            match bright.last_mut() {
                Some(last) if last.end == start => last.end = run_end,
                _ => bright.push(start..run_end),
            }
        }
        bright
    }

    fn apply(self, coefficients: &Coefficients, cut: Option<Cut<'_>>) -> Work {
        let kept = self.steps.len();
        let mut gathered = vec![0.0; 3 * kept];
        let (red, rest) = gathered.split_at_mut(kept);
        let (green, blue) = rest.split_at_mut(kept);
        for (place, index) in self.indices().enumerate() {
            let [r, g, b] = coefficients.at(index);
            (red[place], green[place], blue[place]) = (r, g, b);
        }
        let bright = self.bright([red, green, blue], cut);
        let mut sums = vec![0.0; 3 * self.out.len()];
        for (direction, (&v_scale, &u_scale)) in self.v_scales.iter().zip(self.u_scales).enumerate() {
            let v = &self.v[direction * kept..(direction + 1) * kept];
            let y = dot_companded(v, [red, green, blue], &bright).map(|y| y * v_scale * u_scale);
            let u = &self.u[direction * self.out.len()..(direction + 1) * self.out.len()];
            add_weighted(&mut sums, u, y);
        }
        let rows = self.out.len();
        for (row, out) in self.out.iter_mut().enumerate() {
            *out = Vec3::new(sums[row], sums[rows + row], sums[2 * rows + row]);
        }
        let culled = kept - bright.iter().map(ExactSizeIterator::len).sum::<usize>();
        let rank = self.v_scales.len();
        Work { all: ((kept + rows) * rank) as u64, culled: (culled * rank) as u64 }
    }
}

/// `sum q |q| x` for three vectors `x`, over the places in `ranges`, of which all but the last are whole runs of [`LANES`].
#[multiversion(targets("x86_64+avx2+fma"))]
fn dot_companded(v: &[i8], [red, green, blue]: [&[f32]; 3], ranges: &[Range<usize>]) -> [f32; 3] {
    let mut sums = [[0.0_f32; LANES]; 3];
    let mut rest = 0..0;
    for range in ranges {
        let whole = range.start + range.len() / LANES * LANES;
        for start in (range.start..whole).step_by(LANES) {
            let (v, r) = (&v[start..start + LANES], &red[start..start + LANES]);
            let (g, b) = (&green[start..start + LANES], &blue[start..start + LANES]);
            for lane in 0..LANES {
                let q = f32::from(v[lane]);
                let weight = q * q.abs();
                sums[0][lane] += weight * r[lane];
                sums[1][lane] += weight * g[lane];
                sums[2][lane] += weight * b[lane];
            }
        }
        rest = whole..range.end;
    }
    let mut totals = sums.map(|lanes| lanes.iter().sum::<f32>());
    for place in rest {
        let q = f32::from(v[place]);
        let weight = q * q.abs();
        totals[0] += weight * red[place];
        totals[1] += weight * green[place];
        totals[2] += weight * blue[place];
    }
    totals
}

/// Adds `u * y` to three planes of sums.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_weighted(sums: &mut [f32], u: &[i8], y: [f32; 3]) {
    let rows = u.len();
    for (plane, y) in sums.chunks_exact_mut(rows).zip(y) {
        for (sum, &weight) in plane.iter_mut().zip(u) {
            *sum += f32::from(weight) * y;
        }
    }
}
