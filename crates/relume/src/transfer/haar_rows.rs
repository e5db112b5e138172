//! `haar-rows`: the paper's row-based encoding, for comparison.
//!
//! Each row keeps its `N` most important Haar coefficients by itself, chosen by value times the area of the
//! basis function (section 4.3), as 16-bit numbers and linear 8-bit values with a scale a row.

use glam::Vec3;
use rayon::prelude::*;

use super::haar;
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

/// Some encoded rows, and how well they fit.
#[derive(Clone, Debug, Default)]
pub(super) struct EncodedRows {
    indices: Vec<u32>,
    values: Vec<i8>,
    scales: Vec<f32>,
    pub(super) energy: f64,
    pub(super) lost: f64,
}

/// Encodes rows of plain Haar coefficients (`F W^T`), `count` a row.
pub(super) fn encode(x: &[f32], count: usize, per_row: usize) -> EncodedRows {
    let mut encoded = EncodedRows::default();
    // "area-weighted wavelet culling", Hasan 2006, section 4.3: value times the number of non-zeros
    let weights: Vec<f32> = (0..count).map(|i| haar::support(i, count) as f32).collect();
    for row in x.chunks_exact(count) {
        let mut order: Vec<u32> = (0..count as u32).collect();
        let score = |i: u32| row[i as usize].abs() * weights[i as usize];
        order.select_nth_unstable_by(per_row.min(count - 1), |&a, &b| {
            score(b).total_cmp(&score(a)).then(a.cmp(&b))
        });
        order.truncate(per_row);
        order.sort_unstable();
        let largest = order.iter().fold(0.0_f32, |m, &i| m.max(row[i as usize].abs()));
        let scale = largest / 127.0;
        let mut explained = 0.0;
        for &index in &order {
            let value = row[index as usize];
            let q = if scale > 0.0 { (value / scale).round() } else { 0.0 };
            encoded.values.push(q as i8);
            explained += f64::from(value).powi(2) - f64::from(value - q * scale).powi(2);
        }
        let energy: f64 = row.iter().map(|&v| f64::from(v).powi(2)).sum();
        encoded.energy += energy;
        encoded.lost += (energy - explained).max(0.0);
        encoded.indices.extend(order);
        encoded.scales.push(scale);
    }
    encoded
}

impl HaarRows {
    pub(super) fn from_blocks(blocks: Vec<EncodedRows>, per_row: usize, count: usize) -> Self {
        let (wide, per_row) = (count > 1 << 16, per_row.min(count));
        let indices = || blocks.iter().flat_map(|b| b.indices.iter().copied());
        Self {
            per_row,
            high: if wide { indices().map(|i| (i >> 16) as u8).collect::<Vec<_>>() } else { Vec::new() }
                .into(),
            indices: indices().map(|i| i as u16).collect::<Vec<_>>().into(),
            values: blocks.iter().flat_map(|b| b.values.iter().copied()).collect::<Vec<_>>().into(),
            scales: blocks.iter().flat_map(|b| b.scales.iter().copied()).collect::<Vec<_>>().into(),
        }
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
            && (0..self.indices.len()).all(|place| self.index(place) < count)
    }

    fn index(&self, place: usize) -> usize {
        let high = self.high.get(place).copied().unwrap_or(0);
        usize::from(self.indices[place]) | usize::from(high) << 16
    }

    /// `out = F g`, for all rows, from the coefficients `W g`.
    pub(super) fn apply(&self, coefficients: &Coefficients, out: &mut [Vec3]) {
        out.par_iter_mut().enumerate().with_min_len(256).for_each(|(row, out)| {
            let mut sum = Vec3::ZERO;
            for place in row * self.per_row..(row + 1) * self.per_row {
                sum += Vec3::from(coefficients.at(self.index(place))) * f32::from(self.values[place]);
            }
            *out = sum * self.scales[row];
        });
    }
}
