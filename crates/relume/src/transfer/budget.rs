//! Meeting an error budget: the price of a byte at which an operator loses as much as it may.
//!
//! One price for all blocks spends bytes where they bring most: hard blocks get more. How much all of them lose at a price is
//! told by a few, spread over the picture, that are encoded at several prices.

use super::blocks::Blocks;
use super::compute::{Plan, losses};
use crate::Result;
use crate::progress::Progress;

/// Blocks that are tried: so many, of fewer than ten times as many one in ten.
const PROBES: usize = 12;
/// Prices that are tried, in units of the usual one. High ones buy little and take little time.
const PRICES: [f32; 7] = [1.0 / 16.0, 0.25, 1.0, 4.0, 16.0, 64.0, 256.0];

/// The price, in units of that of `plan`, at which the rows of `blocks` are expected to lose `budget`, relative to the light that they
/// receive: within [`PRICES`].
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub(super) fn price_for(
    plan: Plan<'_>,
    blocks: &Blocks,
    budget: f64,
    progress: &dyn Progress,
) -> Result<f32> {
    let count = blocks.lengths.len();
    let probes = PROBES.min(count.div_ceil(10));
    let which: Vec<usize> = (0..probes).map(|probe| (2 * probe + 1) * count / (2 * probes)).collect();
    progress.stage("error budget", which.iter().map(|&block| blocks.lengths[block] as u64).sum());
    let lost = losses(plan, blocks, &which, &PRICES, progress)?;
    Ok(price_of(&lost, budget * budget))
}

/// Where losses at [`PRICES`], which rise with the price, meet what may be lost; both are squares.
fn price_of(lost: &[f64], budget: f64) -> f32 {
    let logarithm = |value: f64| value.max(1e-30).ln();
    let goal = logarithm(budget);
    let points: Vec<(f64, f64)> =
        PRICES.iter().zip(lost).map(|(&price, &lost)| (f64::from(price).ln(), logarithm(lost))).collect();
    let (first, last) = (points[0], points[points.len() - 1]);
    if goal <= first.1 {
        return PRICES[0];
    }
    for pair in points.windows(2) {
        let [(from, low), (to, high)] = [pair[0], pair[1]];
        if goal <= high && high > low {
            return (from + (to - from) * (goal - low) / (high - low)).exp() as f32;
        }
    }
    last.0.exp() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_price_is_where_the_loss_meets_the_budget() {
        // the square of the error grows with the root of the price
        let lost: Vec<f64> = PRICES.iter().map(|&price| 0.0016 * f64::from(price).sqrt()).collect();
        assert!((price_of(&lost, 0.0016) - 1.0).abs() < 1e-5);
        assert!((price_of(&lost, 0.0032) - 4.0).abs() < 1e-4);
        assert!((price_of(&lost, 0.0024) - 2.25).abs() < 1e-4);
        assert_eq!(price_of(&lost, 1e-9), PRICES[0], "no more can be had");
        assert!((price_of(&lost, 1.0) - 256.0).abs() < 1e-3, "nor less");
        assert!((price_of(&[0.0; 7], 0.01) - 256.0).abs() < 1e-3, "nothing is lost where there is no light");
    }
}
