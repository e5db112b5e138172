//! The orthonormal 2D Haar basis on the flattened gather image (Hasan 2006, section 3.4).
//!
//! Samples come in Morton order, so that the four pixels of every 2x2 block follow each other and a level of the
//! transform reads straight through memory. Coefficients are ordered from coarse to fine: the scaling coefficient,
//! then for each level of `4^j` blocks their `4^j` horizontal, `4^j` vertical and `4^j` diagonal details.

use glam::{Vec3, Vec3A};
use multiversion::multiversion;
use rayon::prelude::*;

/// Replaces `values` (`4^k` of them, Morton order) by their Haar coefficients. `scratch` is as long.
///
/// # Panics
/// If the lengths differ or are no power of four.
pub fn forward(values: &mut [f32], scratch: &mut [f32]) {
    check(values, scratch);
    let mut count = values.len();
    while count > 1 {
        analyse(&values[..count], &mut scratch[..count]);
        values[..count].copy_from_slice(&scratch[..count]);
        count /= 4;
    }
}

/// The coefficients of three channels at once, each bit for bit those of [`forward`], of `values` times `weights`; no weights
/// stand for ones. `coefficients` is as long as `values`.
///
/// # Panics
/// If the lengths differ or are no power of four.
pub fn forward_rgb(values: &[Vec3], weights: &[f32], coefficients: &mut [[f32; 3]]) {
    let fits = coefficients.len() == values.len() && (weights.is_empty() || weights.len() == values.len());
    assert!(is_power_of_four(values.len()) && fits, "{} values, {} weights", values.len(), weights.len());
    let (blocks, weights_of_blocks) = (values.as_chunks::<4>().0, weights.as_chunks::<4>().0);
    let weighted = |block: usize| {
        let weights = weights_of_blocks.get(block).unwrap_or(&[1.0; 4]);
        std::array::from_fn(|i| Vec3A::from(blocks[block][i]) * weights[i])
    };
    let mut sums = match values {
        [one] => vec![Vec3A::from(*one) * weights.first().copied().unwrap_or(1.0)],
        _ => analyse_rgb(weighted, coefficients),
    };
    while sums.len() > 1 {
        let blocks = sums.as_chunks::<4>().0;
        sums = analyse_rgb(|block| blocks[block], &mut coefficients[..sums.len()]);
    }
    coefficients[0] = sums[0].into();
}

/// Writes the details of one level, the last three quarters of `coefficients`, and returns the sums. `block` gives the values of each
/// block of four.
fn analyse_rgb(block: impl Fn(usize) -> [Vec3A; 4] + Sync, coefficients: &mut [[f32; 3]]) -> Vec<Vec3A> {
    let quarter = coefficients.len() / 4;
    let (_, details) = coefficients.split_at_mut(quarter);
    let (horizontal, details) = details.split_at_mut(quarter);
    let (vertical, diagonal) = details.split_at_mut(quarter);
    let mut sums = vec![Vec3A::ZERO; quarter];
    let details = horizontal.par_iter_mut().zip(vertical).zip(diagonal);
    let places = sums.par_iter_mut().enumerate().zip(details).with_min_len(2048);
    places.for_each(|((place, sum), ((horizontal, vertical), diagonal))| {
        let block = block(place);
        let (top, bottom) = (block[0] + block[1], block[2] + block[3]);
        let (left, right) = (block[0] - block[1], block[2] - block[3]);
        *sum = 0.5 * (top + bottom);
        *horizontal = (0.5 * (left + right)).into();
        *vertical = (0.5 * (top - bottom)).into();
        *diagonal = (0.5 * (left - right)).into();
    });
    sums
}

/// The inverse of [`forward`].
///
/// # Panics
/// As [`forward`].
pub fn inverse(coefficients: &mut [f32], scratch: &mut [f32]) {
    check(coefficients, scratch);
    let mut count = 4;
    while count <= coefficients.len() {
        synthesise(&coefficients[..count], &mut scratch[..count]);
        coefficients[..count].copy_from_slice(&scratch[..count]);
        count *= 4;
    }
}

fn check(values: &[f32], scratch: &[f32]) {
    assert!(
        is_power_of_four(values.len()) && scratch.len() == values.len(),
        "{} values, {} scratch",
        values.len(),
        scratch.len()
    );
}

fn is_power_of_four(count: usize) -> bool {
    count.is_power_of_two() && count.trailing_zeros().is_multiple_of(2)
}

/// The level of a coefficient in a transform of any size: 0 for the scaling coefficient and the coarsest details,
/// `j` for the details of `4^j` blocks.
pub fn level(coefficient: usize) -> usize {
    (coefficient.max(1).ilog2() / 2) as usize
}

/// How many samples the coefficient's basis function covers in a transform of `count` samples.
pub fn support(coefficient: usize, count: usize) -> usize {
    count >> (2 * level(coefficient))
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn analyse(values: &[f32], out: &mut [f32]) {
    let quarter = values.len() / 4;
    let (sums, details) = out.split_at_mut(quarter);
    let (horizontal, details) = details.split_at_mut(quarter);
    let (vertical, diagonal) = details.split_at_mut(quarter);
    for (i, block) in values.chunks_exact(4).enumerate() {
        let (top, bottom) = (block[0] + block[1], block[2] + block[3]);
        let (left, right) = (block[0] - block[1], block[2] - block[3]);
        sums[i] = 0.5 * (top + bottom);
        horizontal[i] = 0.5 * (left + right);
        vertical[i] = 0.5 * (top - bottom);
        diagonal[i] = 0.5 * (left - right);
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn synthesise(coefficients: &[f32], out: &mut [f32]) {
    let quarter = coefficients.len() / 4;
    let (sums, details) = coefficients.split_at(quarter);
    let (horizontal, details) = details.split_at(quarter);
    let (vertical, diagonal) = details.split_at(quarter);
    for (i, block) in out.chunks_exact_mut(4).enumerate() {
        let (top, bottom) = (sums[i] + vertical[i], sums[i] - vertical[i]);
        let (left, right) = (horizontal[i] + diagonal[i], horizontal[i] - diagonal[i]);
        block[0] = 0.5 * (top + left);
        block[1] = 0.5 * (top - left);
        block[2] = 0.5 * (bottom + right);
        block[3] = 0.5 * (bottom - right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    fn noise(count: usize) -> Vec<f32> {
        (0..count as u32).map(|i| unit(hash(i, 3)) - 0.4).collect()
    }

    fn norm(values: &[f32]) -> f64 {
        values.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn norms_are_kept_and_the_inverse_returns_the_input() {
        for count in [1, 4, 16, 1024, 65_536] {
            let values = noise(count);
            let (mut work, mut scratch) = (values.clone(), vec![0.0; count]);
            forward(&mut work, &mut scratch);
            assert!((norm(&work) / norm(&values) - 1.0).abs() < 1e-5, "{count}");
            inverse(&mut work, &mut scratch);
            let unlike: Vec<f32> = work.iter().zip(&values).map(|(a, b)| a - b).collect();
            assert!(norm(&unlike) < 1e-5 * norm(&values), "{count}");
        }
    }

    #[test]
    fn three_channels_at_once_are_those_one_by_one() {
        for count in [1, 4, 64, 65_536] {
            let planes = [noise(count), noise(2 * count)[count..].to_vec(), vec![0.5; count]];
            let rgb: Vec<Vec3> =
                (0..count).map(|i| Vec3::from(planes.each_ref().map(|plane| plane[i]))).collect();
            for weights in [Vec::new(), noise(count)] {
                let mut found = vec![[0.0; 3]; count];
                forward_rgb(&rgb, &weights, &mut found);
                for (channel, mut plane) in planes.clone().into_iter().enumerate() {
                    plane.iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight);
                    forward(&mut plane, &mut vec![0.0; count]);
                    let found = found.iter().map(|rgb| rgb[channel]);
                    assert!(found.eq(plane), "{count} values, {} weights, channel {channel}", weights.len());
                }
            }
        }
    }

    #[test]
    fn the_basis_is_orthonormal() {
        let count = 64;
        let mut scratch = vec![0.0; count];
        let basis: Vec<Vec<f32>> = (0..count)
            .map(|i| {
                let mut function = vec![0.0; count];
                function[i] = 1.0;
                inverse(&mut function, &mut scratch);
                function
            })
            .collect();
        for (i, a) in basis.iter().enumerate() {
            for (j, b) in basis.iter().enumerate() {
                let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((dot - expected).abs() < 1e-6, "functions {i} and {j}: {dot}");
            }
            let covered = a.iter().filter(|v| v.abs() > 1e-7).count();
            assert_eq!(covered, support(i, count), "function {i}");
        }
    }

    #[test]
    fn a_constant_has_one_coefficient() {
        let (mut values, mut scratch) = (vec![2.0; 256], vec![0.0; 256]);
        forward(&mut values, &mut scratch);
        assert!((values[0] - 32.0).abs() < 1e-4 && values[1..].iter().all(|v| v.abs() < 1e-6));
    }
}
