//! Culling on the fly: leaving out what would add next to nothing under the light of the moment.
//!
//! Hasan 2006 (section 3.5) ignores a wavelet light where its intensity times the norm of its image falls below an `epsilon`. Here
//! operators fall into *parts*, as small as each encoding can leave out with gain: blocks of an image, columns, runs of
//! coefficients of a block. What a part adds is its norm times the light on it. A part is left out where that, squared, is at most
//! `epsilon^2` of the mean over all parts. If parts were independent, what is left out would never be more than `epsilon` of the
//! result in the relative L2 norm; mostly it is far less. Those of `low-rank` are not, and are held to a third of it
//! (`Operator::apply_coefficients`). Being relative to the result of the one light it is applied to, it does not
//! depend on how bright that is, and changes slowly as that moves.

use rayon::prelude::*;

use super::Coefficients;

/// Multiply-adds of each colour: what an operator's stored numbers took, or would have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// All there are.
    pub all: u64,
    /// Those that were left out.
    pub culled: u64,
}

impl Work {
    /// So many more, left out or not.
    pub(super) fn count(&mut self, entries: u64, is_culled: bool) {
        self.all += entries;
        self.culled += if is_culled { entries } else { 0 };
    }
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.all += other.all;
        self.culled += other.culled;
    }
}

impl std::iter::Sum for Work {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |mut sum, work| {
            sum += work;
            sum
        })
    }
}

/// How strong an operator is, in parts. Derived from it, never stored.
#[derive(Clone, Debug, Default)]
pub(super) struct Norms {
    /// For each Haar coefficient, the squared norm of its column.
    columns: Vec<f32>,
    /// For each part, the most that light of energy one on it can add, squared.
    parts: Vec<f32>,
}

impl Norms {
    /// `columns` has one entry for each coefficient.
    pub(super) fn new(columns: Vec<f64>, parts: Vec<f32>) -> Self {
        Self { columns: columns.into_iter().map(|square| square as f32).collect(), parts }
    }

    /// The squared norm of one column.
    #[cfg(test)]
    pub(super) fn column(&self, coefficient: usize) -> f32 {
        self.columns[coefficient]
    }

    /// What to leave out under this light; `None` where `epsilon` is 0: nothing.
    pub(super) fn cut(&self, coefficients: &Coefficients, epsilon: f32) -> Option<Cut<'_>> {
        if epsilon <= 0.0 {
            return None;
        }
        // in parts that do not depend on the number of threads
        let lit = coefficients.as_slice().par_chunks(4096).zip(self.columns.par_chunks(4096));
        let part = |(light, squares): (&[[f32; 3]], &[f32])| -> f64 {
            light
                .iter()
                .zip(squares)
                .map(|(&light, &square)| f64::from(energy(light)) * f64::from(square))
                .sum()
        };
        let parts: Vec<f64> = lit.map(part).collect();
        let all: f64 = parts.iter().sum();
        let mean = all / self.parts.len().max(1) as f64;
        Some(Cut { parts: &self.parts, most: f64::from(epsilon).powi(2) * mean })
    }
}

/// The square of a coefficient of light, all colours.
pub(super) fn energy([red, green, blue]: [f32; 3]) -> f32 {
    red * red + green * green + blue * blue
}

/// What to leave out of one application.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut<'a> {
    parts: &'a [f32],
    most: f64,
}

impl Cut<'_> {
    /// Whether a part adds next to nothing under light of this energy.
    pub(super) fn is_faint(&self, part: usize, energy: f32) -> bool {
        f64::from(energy) * f64::from(self.parts[part]) <= self.most
    }
}
