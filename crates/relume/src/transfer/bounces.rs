//! Light that goes round within the cloud.

use glam::Vec3;
use rayon::prelude::*;

use super::Operator;

/// Light is followed until what a further bounce adds falls below this share of the whole.
const NEGLIGIBLE: f64 = 5e-4;
/// And never farther than this.
const MOST: u32 = 64;

/// `g + A M g + (A M)^2 g + ...`: the light on the cloud after `times` bounces within it, `A` the albedo of each gather
/// sample. `None` goes on until nothing worth mention is added. Also returns how often `M` was applied.
pub fn gather_bounces(
    bounce: &Operator,
    albedo: &[Vec3],
    direct: &[Vec3],
    times: Option<u32>,
) -> (Vec<Vec3>, u32) {
    let mut total = direct.to_vec();
    let mut last = direct.to_vec();
    let mut sum = magnitude(direct);
    for step in 0..times.unwrap_or(MOST).min(MOST) {
        last = bounce.apply(&last);
        last.par_iter_mut().zip(albedo).with_min_len(4096).for_each(|(light, albedo)| *light *= *albedo);
        total.par_iter_mut().zip(&last).with_min_len(4096).for_each(|(total, light)| *total += *light);
        let added = magnitude(&last);
        sum += added;
        if added <= NEGLIGIBLE * sum {
            return (total, step + 1);
        }
    }
    (total, times.unwrap_or(MOST).min(MOST))
}

fn magnitude(light: &[Vec3]) -> f64 {
    light.iter().map(|rgb| f64::from(rgb.abs().element_sum())).sum()
}
