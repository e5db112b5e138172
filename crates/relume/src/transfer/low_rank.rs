//! `low-rank`, the default encoding: each block of rows shares one fine basis.
//!
//! `F_b ~= U_b V_b D^-1 W`: `W` the Haar transform, `D` the light prior, `V_b` the block's strongest directions in that
//! weighted space cut to its `K` most important coefficients, `U_b` the weights of each row. `V` is companded to 8 bits
//! (`q |q| scale`, a scale a direction), `U` linear in 8 bits (a scale a column). This is clustered principal component
//! analysis (Huang and Ramamoorthi 2010) in the wavelet basis of Hasan 2006.

use glam::Vec3;
use multiversion::multiversion;
use nalgebra::{DMatrix, SymmetricEigen};
use rayon::prelude::*;

use super::gemm::{View, product};
use super::{Buffer, Coefficients};

/// How finely blocks are encoded.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LowRankSettings {
    /// Directions a block.
    pub rank: usize,
    /// Coefficients of each direction that are kept.
    pub kept: usize,
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

/// One encoded block, and how well it fits.
#[derive(Clone, Debug)]
pub(super) struct Encoded {
    shape: BlockShape,
    steps: Vec<u16>,
    v: Vec<i8>,
    v_scales: Vec<f32>,
    u: Vec<i8>,
    u_scales: Vec<f32>,
    /// Squared norm of the block, and of what the encoding leaves out, both in the weighted space.
    pub(super) energy: f64,
    pub(super) lost: f64,
}

/// Directions beyond the rank that the search carries along, for accuracy.
const OVERSAMPLING: usize = 8;
/// Coefficients that the search looks at, as a multiple of those kept.
const CANDIDATES: usize = 4;

/// Encodes a block of `rows` rows of weighted coefficients (`X = F W^T D`), row after row.
pub(super) fn encode(x: &[f32], rows: usize, settings: &LowRankSettings) -> Encoded {
    let count = x.len().checked_div(rows).unwrap_or(0);
    let columns = column_energies(x, count);
    let energy = columns.iter().map(|&e| f64::from(e)).sum();
    let candidates = strongest(&columns, (CANDIDATES * settings.kept).min(count));
    let compact = compacted(x, count, &candidates);
    let x = View::new(&compact, rows, candidates.len());
    let directions = strongest_directions(x, rows, candidates.len(), settings.rank);
    let rank = directions.len() / candidates.len().max(1);
    let importance = column_energies(&directions, candidates.len());
    let places = strongest(&importance, settings.kept.min(candidates.len()));
    let (places, steps) = with_short_steps(&candidates, &places);
    let cut: Vec<f32> = (0..rank)
        .flat_map(|r| places.iter().map(move |&p| (r, p)))
        .map(|(r, place)| place.map_or(0.0, |p| directions[r * candidates.len() + p as usize]))
        .collect();
    let (v, v_scales) = compand(&cut, places.len());
    let expanded = expand(&v, &v_scales, places.len());
    let kept: Vec<f32> = compact
        .chunks_exact(candidates.len().max(1))
        .flat_map(|row| places.iter().map(|place| place.map_or(0.0, |p| row[p as usize])))
        .collect();
    let fit = Fit::new(&kept, rows, &expanded, rank);
    let (u, u_scales, lost) = fit.quantised(energy);
    let shape = BlockShape { rows: rows as u32, rank: rank as u32, kept: steps.len() as u32 };
    Encoded { shape, steps, v, v_scales, u, u_scales, energy, lost }
}

fn column_energies(x: &[f32], count: usize) -> Vec<f32> {
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

/// The numbers of the `count` largest entries, ascending; ties go to the smaller number.
fn strongest(values: &[f32], count: usize) -> Vec<u32> {
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

/// `V = U^T X` for the `rank` strongest left singular vectors `U` of `X`, by subspace iteration that starts from the
/// rows themselves.
fn strongest_directions(x: View<'_>, rows: usize, columns: usize, rank: usize) -> Vec<f32> {
    let width = (rank + OVERSAMPLING).min(rows);
    let mut start = vec![0.0; rows * width];
    for column in 0..width {
        // evenly spaced rows
        start[(column * rows / width) * width + column] = 1.0;
    }
    let mut basis = start;
    for _ in 0..2 {
        let across = product(x.transposed(), View::new(&basis, rows, width));
        let image = product(x, View::new(&across, columns, width));
        basis = orthonormalised(image, rows, width);
    }
    let across = product(View::new(&basis, rows, width).transposed(), x);
    // rotate to the singular vectors
    let square = product(View::new(&across, width, columns), View::new(&across, width, columns).transposed());
    let eigen = SymmetricEigen::new(DMatrix::from_fn(width, width, |i, j| f64::from(square[i * width + j])));
    let mut order: Vec<usize> = (0..width).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    order.truncate(rank);
    let mut rotation = Vec::with_capacity(order.len() * width);
    for &direction in &order {
        rotation.extend((0..width).map(|i| eigen.eigenvectors[(i, direction)] as f32));
    }
    product(View::new(&rotation, order.len(), width), View::new(&across, width, columns))
}

/// An orthonormal basis of the columns of a `rows x width` matrix.
fn orthonormalised(values: Vec<f32>, rows: usize, width: usize) -> Vec<f32> {
    // in f64: the columns of a power iteration are nearly parallel
    let matrix = DMatrix::from_fn(rows, width, |i, j| f64::from(values[i * width + j]));
    let q = matrix.qr().q();
    (0..rows * width).map(|k| q[(k / width, k % width)] as f32).collect()
}

/// The kept coefficients as distances that fit 16 bits. A longer distance is walked by fillers (`None`), whose `V` is
/// zero; the first distance is from coefficient 0.
fn with_short_steps(candidates: &[u32], places: &[u32]) -> (Vec<Option<u32>>, Vec<u16>) {
    let (mut slots, mut steps, mut last) = (Vec::new(), Vec::new(), 0);
    for &place in places {
        let mut distance = candidates[place as usize] - last;
        while distance > u32::from(u16::MAX) {
            slots.push(None);
            steps.push(u16::MAX);
            distance -= u32::from(u16::MAX);
        }
        slots.push(Some(place));
        steps.push(distance as u16);
        last = candidates[place as usize];
    }
    (slots, steps)
}

/// 8-bit companding, a scale a direction: `v = q |q| scale`.
fn compand(v: &[f32], count: usize) -> (Vec<i8>, Vec<f32>) {
    let (mut bytes, mut scales) = (Vec::with_capacity(v.len()), Vec::new());
    for direction in v.chunks_exact(count.max(1)) {
        let largest = direction.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let scale = largest / (127.0 * 127.0);
        let inverse = if scale > 0.0 { 1.0 / scale } else { 0.0 };
        bytes.extend(direction.iter().map(|v| ((v.abs() * inverse).sqrt().round().copysign(*v)) as i8));
        scales.push(scale);
    }
    (bytes, scales)
}

fn expand(v: &[i8], scales: &[f32], count: usize) -> Vec<f32> {
    let decode = |(direction, &scale): (&[i8], &f32)| {
        direction.iter().map(|&q| f32::from(q) * f32::from(q).abs() * scale).collect::<Vec<_>>()
    };
    v.chunks_exact(count.max(1)).zip(scales).flat_map(decode).collect()
}

/// The least-squares weights of each row on the directions as they were quantised.
struct Fit {
    rows: usize,
    rank: usize,
    /// `X V^T`, `rows x rank`.
    cross: DMatrix<f64>,
    /// `V V^T`.
    square: DMatrix<f64>,
}

impl Fit {
    fn new(x: &[f32], rows: usize, v: &[f32], rank: usize) -> Self {
        let columns = v.len().checked_div(rank).unwrap_or(0);
        let (x, v) = (View::new(x, rows, columns), View::new(v, rank, columns));
        let cross = product(x, v.transposed());
        let square = product(v, v.transposed());
        Self {
            rows,
            rank,
            cross: DMatrix::from_fn(rows, rank, |i, j| f64::from(cross[i * rank + j])),
            square: DMatrix::from_fn(rank, rank, |i, j| f64::from(square[i * rank + j])),
        }
    }

    /// The weights in 8 bits, column after column, their scales, and the squared norm of what is left of `energy`.
    fn quantised(&self, energy: f64) -> (Vec<i8>, Vec<f32>, f64) {
        let mut ridged = self.square.clone();
        let ridge = 1e-7 * ridged.trace() + 1e-300;
        for i in 0..self.rank {
            ridged[(i, i)] += ridge;
        }
        let solved = ridged.cholesky().map(|factor| factor.solve(&self.cross.transpose()).transpose());
        let weights = solved.unwrap_or_else(|| DMatrix::zeros(self.rows, self.rank));
        let (mut bytes, mut scales) = (Vec::with_capacity(self.rows * self.rank), Vec::new());
        let mut coarse = weights.clone();
        for column in 0..self.rank {
            let scale = weights.column(column).amax() / 127.0;
            for row in 0..self.rows {
                let q = if scale > 0.0 { (weights[(row, column)] / scale).round() } else { 0.0 };
                bytes.push(q as i8);
                coarse[(row, column)] = q * scale;
            }
            scales.push(scale as f32);
        }
        let explained = 2.0 * coarse.dot(&self.cross) - (&coarse * &self.square).dot(&coarse);
        (bytes, scales, (energy - explained).max(0.0))
    }
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
        let in_range = |(shape, steps): (&BlockShape, &[u16])| {
            let _ = shape;
            steps.iter().map(|&step| u64::from(step)).sum::<u64>() < count as u64 || steps.is_empty()
        };
        sum(|s| u64::from(s.rows)) == rows as u64
            && sum(|s| u64::from(s.kept)) == self.steps.len() as u64
            && sum(|s| u64::from(s.rank) * u64::from(s.kept)) == self.v.len() as u64
            && sum(|s| u64::from(s.rank) * u64::from(s.rows)) == self.u.len() as u64
            && sum(|s| u64::from(s.rank)) == self.v_scales.len() as u64
            && self.v_scales.len() == self.u_scales.len()
            && self.shapes.iter().zip(self.steps_of_blocks()).all(in_range)
    }

    fn steps_of_blocks(&self) -> impl Iterator<Item = &[u16]> {
        let mut rest = &self.steps[..];
        self.shapes.iter().map(move |shape| {
            let (steps, after) = rest.split_at(shape.kept as usize);
            rest = after;
            steps
        })
    }

    /// `out = F g`, for all rows in block order, from the weighted coefficients `D^-1 W g`.
    pub(super) fn apply(&self, coefficients: &Coefficients, out: &mut [Vec3]) {
        self.parts(out).into_par_iter().for_each(|part| part.apply(coefficients));
    }

    fn parts<'a>(&'a self, mut out: &'a mut [Vec3]) -> Vec<Part<'a>> {
        let (mut steps, mut v, mut u) = (&self.steps[..], &self.v[..], &self.u[..]);
        let (mut v_scales, mut u_scales) = (&self.v_scales[..], &self.u_scales[..]);
        let mut parts = Vec::with_capacity(self.shapes.len());
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
            });
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
}

impl Part<'_> {
    fn apply(self, coefficients: &Coefficients) {
        let kept = self.steps.len();
        let mut gathered = vec![0.0; 3 * kept];
        let (red, rest) = gathered.split_at_mut(kept);
        let (green, blue) = rest.split_at_mut(kept);
        let mut index = 0;
        for (place, &step) in self.steps.iter().enumerate() {
            index += usize::from(step);
            let [r, g, b] = coefficients.at(index);
            (red[place], green[place], blue[place]) = (r, g, b);
        }
        let mut sums = vec![0.0; 3 * self.out.len()];
        for (direction, (&v_scale, &u_scale)) in self.v_scales.iter().zip(self.u_scales).enumerate() {
            let v = &self.v[direction * kept..(direction + 1) * kept];
            let y = dot_companded(v, red, green, blue).map(|y| y * v_scale * u_scale);
            let u = &self.u[direction * self.out.len()..(direction + 1) * self.out.len()];
            add_weighted(&mut sums, u, y);
        }
        let rows = self.out.len();
        for (row, out) in self.out.iter_mut().enumerate() {
            *out = Vec3::new(sums[row], sums[rows + row], sums[2 * rows + row]);
        }
    }
}

/// `sum q |q| x` for three vectors `x`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn dot_companded(v: &[i8], red: &[f32], green: &[f32], blue: &[f32]) -> [f32; 3] {
    const LANES: usize = 16;
    let mut sums = [[0.0_f32; LANES]; 3];
    let whole = v.len() / LANES * LANES;
    for start in (0..whole).step_by(LANES) {
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
    let mut totals = sums.map(|lanes| lanes.iter().sum::<f32>());
    for place in whole..v.len() {
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
