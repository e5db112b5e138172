//! Finding the basis of a block of rows: the encoder of [`low_rank`](super::low_rank).
//!
//! What light can be, over what is expected of it, is known in two ways. Each Haar coefficient has its magnitude `D` by itself; and some hundred *training
//! lights* say how coefficients go together. Their covariance, in units of `D`, is taken as `S = (1 - a) I + a C C^T / L`, with
//! a column of `C` for each of `L` lights. For a block `X = F E W^T D`:
//!
//! - The directions are the strongest of `X S X^T`: noise in the rows, which is strong in `X X^T`, answers to no real light.
//! - As many are kept, and as many coefficients of them, as bring more light than they cost in bytes.
//! - The light of the coefficients that are dropped is guessed from those that are kept, as `S` has it:
//!   `V_K + V_d C_d (C_K^T C_K + m I)^-1 C_K^T`, `m = L (1 - a) / a`. Without it the image is too dark, for where a surface
//!   is seen, there it is lit, on all scales alike.
//! - The weights of each row are those of the least expected error under `S`, for the directions as they were quantised.
//!
//! Huang and Ramamoorthi (2010) weigh by nothing and keep a fixed rank; Hasan et al. (2006) weigh by area.

use nalgebra::DMatrix;

use super::directions::strongest_directions;
use super::gemm::{View, product};
use super::low_rank::{BlockShape, LowRankSettings};
use super::low_rank_run::{LEARNED, PLACE_BYTES, Part, WEAKEST, column_energies, rows_of, strongest};
use super::packed_runs::{RunWriter, runs_of};
use super::prior::LightPrior;

/// Steps of quantisation, in units of the root of the price of a byte. A step `s` loses `s^2 / 12` a value, and half of it saves three quarters
/// of that for a bit: at 1.4 the last bit brings what an eighth of a byte must. From 0.7 to 2 the error at equal bytes is nearly the same.
const STEP: f64 = 1.4;
/// Values up to this part of a step from zero are none: a zero costs less than it loses.
const DEAD_ZONE: f32 = 0.58;

/// One encoded block, and how well it fits.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Encoded {
    pub(super) shape: BlockShape,
    /// Numbers of the kept coefficients, the most important first.
    pub(super) indices: Vec<u32>,
    pub(super) v: RunWriter,
    pub(super) v_scales: Vec<f32>,
    pub(super) u: RunWriter,
    pub(super) u_scales: Vec<f32>,
    /// For each light that nothing was learned from: the squared norm of what it sends to the rows.
    pub(super) energy: Vec<f64>,
    /// And of what the encoding misses of it.
    pub(super) lost: Vec<f64>,
}

impl Encoded {
    /// Whether its parts are as many as its shape says, over `count` coefficients, and its numbers are finite; judged under so many lights.
    pub(super) fn is_sound(&self, count: usize, lights: usize) -> bool {
        let BlockShape { rows, rank, kept } = self.shape;
        let (rows, rank, kept) = (rows as usize, rank as usize, kept as usize);
        let runs = |columns: usize, length: usize| columns.checked_mul(runs_of(length));
        self.indices.len() == kept
            && self.indices.iter().all(|&index| (index as usize) < count)
            && self.v_scales.len() == rank
            && self.u_scales.len() == rank
            && self.v.is_sound()
            && self.u.is_sound()
            && runs(rank, kept) == Some(self.v.widths.len())
            && runs(rank, rows) == Some(self.u.widths.len())
            && self.v_scales.iter().chain(&self.u_scales).all(|scale| scale.is_finite())
            && self.energy.len() == lights
            && self.lost.len() == lights
            && self.energy.iter().chain(&self.lost).all(|value| value.is_finite())
    }

    /// What it takes in memory, bytes.
    pub(super) fn memory(&self) -> usize {
        size_of::<Self>()
            + self.bytes(size_of::<u32>())
            + size_of_val(&*self.energy)
            + size_of_val(&*self.lost)
    }

    /// Of all that is stored of it, where a coefficient's number takes `place` bytes.
    fn bytes(&self, place: usize) -> usize {
        size_of::<BlockShape>()
            + place * self.indices.len()
            + [&self.v, &self.u].map(|runs| runs.widths.len() + runs.bytes.len()).iter().sum::<usize>()
            + size_of_val(&*self.v_scales)
            + size_of_val(&*self.u_scales)
    }
}

/// A block that was encoded, to be judged.
pub(super) struct Draft {
    /// Without what it sends and misses.
    encoded: Encoded,
    /// What is stored for `V`, `rank x kept`.
    directions: Vec<f32>,
    /// What is stored for `U`, `rows x rank`.
    weights: Vec<f32>,
    /// The squared norm of what it is expected to miss, under `S`.
    pub(super) expected_loss: f64,
    /// All of it.
    pub(super) bytes: usize,
}

impl Draft {
    /// Of some of the rows of a run.
    pub(super) fn new(part: &Part<'_>) -> Self {
        let (run, rows) = (part.run, part.x.rows());
        let (basis, rank, places) = chosen(part, &run.settings);
        let kept = Kept::new(part, &places);
        let basis = View::new(&basis, rank, rows);
        let directions = product(basis, View::new(&kept.x, rows, kept.count));
        let whole = kept.with_dropped_light(&directions, rank, &product(basis, part.responses));
        let step = (STEP * f64::from(run.settings.price).sqrt()) as f32;
        let v = Quantised::of_directions(&whole, kept.count, step);
        let fit = kept.fit(part.responses, &v.values, rank);
        let (u, weights) = fit.quantised(f64::from(step));
        let sent =
            (1.0 - LEARNED) * part.energy + LEARNED / run.lights.max(1) as f64 * squares(part.responses);
        let encoded = Encoded {
            shape: BlockShape { rows: rows as u32, rank: rank as u32, kept: kept.count as u32 },
            indices: places.iter().map(|&place| run.candidates[place as usize]).collect(),
            v: v.runs,
            v_scales: v.scales,
            u: u.runs,
            u_scales: u.scales,
            energy: Vec::new(),
            lost: Vec::new(),
        };
        Self {
            bytes: encoded.bytes(if run.count > 1 << 16 { 3 } else { 2 }),
            expected_loss: (sent - fit.told(&weights)).max(0.0),
            encoded,
            directions: v.values,
            weights,
        }
    }

    /// Directions.
    pub(super) fn rank(&self) -> usize {
        self.encoded.shape.rank as usize
    }

    /// With what the lights that nothing was learned from send to the rows `x`, and what is missed of it.
    pub(super) fn judged(self, x: &[f32], prior: &LightPrior) -> Encoded {
        let BlockShape { rows, rank, kept } = self.encoded.shape;
        let (rows, rank, kept, lights) = (rows as usize, rank as usize, kept as usize, prior.held_lights);
        let held = rows_of(&prior.held, lights, self.encoded.indices.iter().copied());
        let sent = product(View::new(&self.directions, rank, kept), View::new(&held, kept, lights));
        let told = product(View::new(&self.weights, rows, rank), View::new(&sent, rank, lights));
        let count = x.len().checked_div(rows).unwrap_or(0);
        let truth = product(View::new(x, rows, count), View::new(&prior.held, count, lights));
        let missed: Vec<f32> = truth.iter().zip(&told).map(|(truth, told)| truth - told).collect();
        let [energy, lost] = [&truth, &missed].map(|values| {
            let energies = column_energies(values, lights);
            energies.into_iter().map(f64::from).collect()
        });
        Encoded { energy, lost, ..self.encoded }
    }
}

fn squares(values: View<'_>) -> f64 {
    let row = |row| (0..values.columns()).map(move |column| f64::from(values.at(row, column)).powi(2));
    (0..values.rows()).flat_map(row).sum()
}

/// `rows` rows of zeros.
pub(super) fn nothing(rows: usize, prior: &LightPrior) -> Encoded {
    Encoded {
        shape: BlockShape { rows: rows as u32, rank: 0, kept: 0 },
        indices: Vec::new(),
        v: RunWriter::default(),
        v_scales: Vec::new(),
        u: RunWriter::default(),
        u_scales: Vec::new(),
        energy: vec![0.0; prior.held_lights],
        lost: vec![0.0; prior.held_lights],
    }
}

/// The directions to keep of some rows, one after the other, how many, and which of the coefficients.
fn chosen(part: &Part<'_>, settings: &LowRankSettings) -> (Vec<f32>, usize, Vec<u32>) {
    let (rows, width) = (part.x.rows(), part.x.columns());
    let price = f64::from(settings.price);
    let worth = |gains: &[f64], kept: usize| {
        let cost = WEAKEST.0 * rows as f64 + WEAKEST.1 * kept as f64;
        // rounding may leave the least of them below zero
        gains.iter().take_while(|gain| gain.max(0.0) >= price * cost).count()
    };
    let (basis, gains) = strongest_directions(part, settings.rank, price * WEAKEST.0 * rows as f64);
    // what a direction costs depends on how many coefficients are kept, and these on how many directions
    let known = worth(&gains, 0);
    let directions = product(View::new(&basis[..known * rows], known, rows), part.x);
    let places = |rank: usize| {
        let importance = column_energies(&directions[..rank * width], width);
        let mut places = strongest(&importance, settings.kept.min(width));
        let cost = price * (WEAKEST.1 * rank as f64 + PLACE_BYTES);
        places.retain(|&place| f64::from(importance[place as usize]) > cost);
        places.sort_by(|&a, &b| importance[b as usize].total_cmp(&importance[a as usize]).then(a.cmp(&b)));
        places
    };
    let kept = places(known).len();
    let rank = worth(&gains, kept);
    let places = places(rank);
    // directions without coefficients say nothing
    let rank = if places.is_empty() { 0 } else { rank };
    (basis[..rank * rows].to_vec(), rank, places)
}

/// A block cut to the coefficients that are kept.
struct Kept {
    /// `X_K`, `rows x count`.
    x: Vec<f32>,
    /// `C_K`, `count x lights`.
    learned: Vec<f32>,
    count: usize,
    lights: usize,
}

impl Kept {
    /// `places` are columns of the run.
    fn new(part: &Part<'_>, places: &[u32]) -> Self {
        let rows = 0..part.x.rows();
        Self {
            x: rows.flat_map(|row| places.iter().map(move |&place| part.x.at(row, place as usize))).collect(),
            learned: rows_of(&part.run.learned, part.run.lights, places.iter().copied()),
            count: places.len(),
            lights: part.run.lights,
        }
    }

    fn learned(&self) -> View<'_> {
        View::new(&self.learned, self.count, self.lights)
    }

    /// `directions` (`V_K`) with what the dropped coefficients are expected to bring, given those that are kept.
    /// `responses` are `V C`.
    fn with_dropped_light(&self, directions: &[f32], rank: usize, responses: &[f32]) -> Vec<f32> {
        let lights = self.lights;
        let told = product(View::new(directions, rank, self.count), self.learned());
        let square = product(self.learned().transposed(), self.learned());
        let trust = lights as f64 * (1.0 - LEARNED) / LEARNED;
        let square = DMatrix::from_fn(lights, lights, |i, j| {
            f64::from(square[i * lights + j]) + if i == j { trust } else { 0.0 }
        });
        let missed = DMatrix::from_fn(lights, rank, |light, direction| {
            let at = direction * lights + light;
            f64::from(responses[at]) - f64::from(told[at])
        });
        // positive definite by `trust`, unless light is not finite: then there is nothing to learn
        let Some(factor) = square.cholesky() else { return directions.to_vec() };
        // column after column, a column a direction
        let solved: Vec<f32> = factor.solve(&missed).iter().map(|&value| value as f32).collect();
        let mut whole = product(View::new(&solved, rank, lights), self.learned().transposed());
        whole.iter_mut().zip(directions).for_each(|(whole, kept)| *whole += kept);
        whole
    }

    /// What the weights of the rows on the directions `v` are to be fitted to.
    fn fit(&self, responses: View<'_>, v: &[f32], rank: usize) -> Fit {
        let rows = responses.rows();
        let (x, v) = (View::new(&self.x, rows, self.count), View::new(v, rank, self.count));
        let sent = product(v, self.learned());
        let sent = View::new(&sent, rank, self.lights);
        let mixed = |alone: Vec<f32>, together: Vec<f32>, rows: usize| {
            DMatrix::from_fn(rows, rank, |i, j| {
                let at = i * rank + j;
                (1.0 - LEARNED) * f64::from(alone[at])
                    + LEARNED / self.lights as f64 * f64::from(together[at])
            })
        };
        Fit {
            rows,
            rank,
            cross: mixed(product(x, v.transposed()), product(responses, sent.transposed()), rows),
            square: mixed(product(v, v.transposed()), product(sent, sent.transposed()), rank),
        }
    }
}

/// Rows of values in equal steps, and the values that these stand for.
struct Quantised {
    runs: RunWriter,
    /// The step of each row.
    scales: Vec<f32>,
    /// Row after row.
    values: Vec<f32>,
}

impl Quantised {
    /// `V`, a direction a row.
    fn of_directions(v: &[f32], count: usize, step: f32) -> Self {
        let mut quantised = Self::of(0);
        for direction in v.chunks_exact(count.max(1)) {
            quantised.add(direction, step, DEAD_ZONE);
        }
        quantised
    }

    fn of(capacity: usize) -> Self {
        Self { runs: RunWriter::default(), scales: Vec::new(), values: Vec::with_capacity(capacity) }
    }

    /// Adds a row in steps of `step`, or larger ones if it takes more than 16 bits' worth of these: a few large values must not make all
    /// others coarse. Values that are less than `dead_zone` steps become zero.
    fn add(&mut self, row: &[f32], step: f32, dead_zone: f32) {
        let largest = row.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        let most = f32::from(i16::MAX);
        let step = step.max(largest / most);
        let inverse = if step > 0.0 { 1.0 / step } else { 0.0 };
        let round = |value: &f32| {
            let steps = value.abs() * inverse;
            let whole = if steps < dead_zone { 0.0 } else { steps.round().min(most) };
            whole.copysign(*value) as i16
        };
        let steps: Vec<i16> = row.iter().map(round).collect();
        self.runs.add(&steps);
        self.scales.push(step);
        self.values.extend(steps.iter().map(|&q| f32::from(q) * step));
    }
}

/// The weights of each row on the directions as they were quantised: those of the least expected error.
struct Fit {
    rows: usize,
    rank: usize,
    /// `X S V^T`, `rows x rank`.
    cross: DMatrix<f64>,
    /// `V S V^T`.
    square: DMatrix<f64>,
}

impl Fit {
    /// How much of the rows' expected light `weights` tell, row after row: its squared norm less that of what they miss.
    fn told(&self, weights: &[f32]) -> f64 {
        let weights = DMatrix::from_row_iterator(self.rows, self.rank, weights.iter().map(|&w| f64::from(w)));
        2.0 * weights.dot(&self.cross) - (&weights * &self.square).dot(&weights)
    }

    /// The weights, a column a row of what is returned, in steps that change a row's light by `step` in the mean; and the weights that
    /// these stand for, row after row.
    fn quantised(&self, step: f64) -> (Quantised, Vec<f32>) {
        // products in single precision may leave a singular matrix slightly indefinite: then the ridge is raised
        let factor = (-7..0).find_map(|power| {
            let ridge = 10.0_f64.powi(power) * self.square.trace() + 1e-300;
            (&self.square + DMatrix::identity(self.rank, self.rank) * ridge).cholesky()
        });
        let solved = factor.map(|factor| factor.solve(&self.cross.transpose()).transpose());
        let weights = solved.unwrap_or_else(|| DMatrix::zeros(self.rows, self.rank));
        let mut quantised = Quantised::of(self.rows * self.rank);
        for column in 0..self.rank {
            let brings = self.square[(column, column)].sqrt().max(1e-30);
            let weights: Vec<f32> = weights.column(column).iter().map(|&weight| weight as f32).collect();
            quantised.add(&weights, (step / brings) as f32, 0.5);
        }
        let turned = |k: usize| quantised.values[k % self.rank * self.rows + k / self.rank];
        let coarse = (0..self.rows * self.rank).map(turned).collect();
        (quantised, coarse)
    }
}

#[cfg(test)]
#[path = "low_rank_encoder_tests.rs"]
mod tests;
