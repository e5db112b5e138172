//! `haar-rows`: the paper's row-based encoding, for comparison.
//!
//! Each row keeps its `N` most important Haar coefficients by itself, chosen by value times the area of the
//! basis function (Hasan 2006, section 4.3) unless told otherwise ([`Selection`](super::Selection)), as 16-bit numbers and linear
//! 8-bit values with a scale a row.

use glam::Vec3;
use rayon::prelude::*;

use super::culling::{Cut, Norms, Work, energy};
use super::selection::KeptRows;
use super::{Buffer, Coefficients};

/// All rows of one operator.
#[derive(Clone, Debug, Default)]
pub struct HaarRows {
    /// Coefficients a row, `N`.
    pub per_row: usize,
    /// `N` a row: the low 16 bits of which coefficients.
    pub indices: Buffer<u16>,
    /// High bits of `indices`; empty where 16 bits are enough.
    pub high: Buffer<u8>,
    /// `N` a row.
    pub values: Buffer<i8>,
    /// One a row: `value * scale` is the coefficient.
    pub scales: Buffer<f32>,
}

impl HaarRows {
    /// Quantises rows over a cloud of `count` samples. Also returns what that loses of them: the sum of squares, weighted as the
    /// rows are.
    pub(super) fn encode(rows: &[KeptRows], count: usize) -> (Self, f64) {
        let (mut values, mut scales, mut lost) = (Vec::new(), Vec::new(), 0.0);
        for kept in rows {
            for (_, row, _) in kept.rows() {
                let largest = row.iter().fold(0.0_f32, |m, value| m.max(value.abs()));
                let scale = largest / 127.0;
                for value in row {
                    let q = if scale > 0.0 { (value / scale).round() } else { 0.0 };
                    values.push(q as i8);
                    lost += kept.weight * f64::from(value - q * scale).powi(2);
                }
                scales.push(scale);
            }
        }
        let wide = count > 1 << 16;
        let indices = || rows.iter().flat_map(|kept| kept.indices.iter().copied());
        let high = if wide { indices().map(|i| (i >> 16) as u8).collect::<Vec<_>>() } else { Vec::new() };
        let encoded = Self {
            per_row: rows.first().map_or(0, |kept| kept.per_row),
            high: high.into(),
            indices: indices().map(|i| i as u16).collect::<Vec<_>>().into(),
            values: values.into(),
            scales: scales.into(),
        };
        (encoded, lost)
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.indices) + self.high.len() + self.values.len() + size_of_val(&*self.scales)
    }

    /// Whether all parts have the right lengths and no coefficient lies past `count`.
    pub(super) fn is_sound(&self, rows: usize, count: usize) -> bool {
        let entries = rows.checked_mul(self.per_row);
        entries == Some(self.indices.len())
            && entries == Some(self.values.len())
            && (self.high.is_empty() || entries == Some(self.high.len()))
            && self.scales.len() == rows
            && self.scales.iter().all(|scale| scale.is_finite())
            && (0..self.indices.len()).all(|place| self.index(place) < count)
    }

    fn index(&self, place: usize) -> usize {
        let high = self.high.get(place).copied().unwrap_or(0);
        usize::from(self.indices[place]) | usize::from(high) << 16
    }

    /// The parts are columns.
    pub(super) fn norms(&self, count: usize) -> Norms {
        let mut columns = vec![0.0; count];
        for (row, &scale) in self.scales.iter().enumerate() {
            for place in row * self.per_row..(row + 1) * self.per_row {
                columns[self.index(place)] += f64::from(f32::from(self.values[place]) * scale).powi(2);
            }
        }
        let parts = columns.iter().map(|&square| square as f32).collect();
        Norms::new(columns, parts)
    }

    /// `out = F g`, for all rows, from the coefficients `W g`, without those that `cut` calls faint.
    pub(super) fn apply(&self, coefficients: &Coefficients, cut: Option<Cut<'_>>, out: &mut [Vec3]) -> Work {
        let Some(cut) = cut else {
            out.par_iter_mut().enumerate().with_min_len(256).for_each(|(row, out)| {
                let mut sum = Vec3::ZERO;
                for place in row * self.per_row..(row + 1) * self.per_row {
                    sum += Vec3::from(coefficients.at(self.index(place))) * f32::from(self.values[place]);
                }
                *out = sum * self.scales[row];
            });
            return Work { all: self.values.len() as u64, culled: 0 };
        };
        let lights = coefficients.as_slice().iter().enumerate();
        let faint: Vec<bool> = lights.map(|(part, &light)| cut.is_faint(part, energy(light))).collect();
        let row_without = |(row, out): (usize, &mut Vec3)| {
            let (mut sum, mut culled) = (Vec3::ZERO, 0);
            for place in row * self.per_row..(row + 1) * self.per_row {
                let index = self.index(place);
                if faint[index] {
                    culled += 1;
                } else {
                    sum += Vec3::from(coefficients.at(index)) * f32::from(self.values[place]);
                }
            }
            *out = sum * self.scales[row];
            culled
        };
        let culled = out.par_iter_mut().enumerate().with_min_len(256).map(row_without).sum();
        Work { all: self.values.len() as u64, culled }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused() {
        let weights = vec![1.0; 64];
        let rows: Vec<f32> = (0..3 * 64).map(|i| (i % 7) as f32 - 3.0).collect();
        let (whole, _) = HaarRows::encode(&[KeptRows::of(&rows, &weights, 5)], 64);
        assert!(whole.is_sound(3, 64));
        assert!(!whole.is_sound(2, 64) && !whole.is_sound(3, 4) && !whole.is_sound(usize::MAX, 64));
        let wrong = [
            HaarRows { per_row: 4, ..whole.clone() },
            HaarRows { indices: whole.indices[1..].to_vec().into(), ..whole.clone() },
            HaarRows { high: vec![1; 15].into(), ..whole.clone() },
            HaarRows { high: vec![0].into(), ..whole.clone() },
            HaarRows { values: whole.values[1..].to_vec().into(), ..whole.clone() },
            HaarRows { scales: vec![1.0; 2].into(), ..whole.clone() },
            HaarRows { scales: vec![f32::INFINITY; 3].into(), ..whole.clone() },
        ];
        for (number, wrong) in wrong.iter().enumerate() {
            assert!(!wrong.is_sound(3, 64), "{number}");
        }
    }

    #[test]
    fn rows_of_nothing_are_those_of_zeros() {
        let (rows, count, per_row) = (3, 64, 5);
        let zeros = KeptRows::of(&vec![0.0; rows * count], &vec![1.0; count], per_row);
        let nothing = KeptRows::nothing(rows, count, per_row);
        assert_eq!((zeros.values, zeros.energies), (nothing.values, nothing.energies));
        assert_eq!(zeros.indices, nothing.indices);
    }
}
