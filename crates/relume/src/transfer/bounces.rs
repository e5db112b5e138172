//! Light that goes round within the cloud.
//!
//! `g + T g + T^2 g + ...` with `T = A M` has no end. Its late terms are all alike: each is the one before times the
//! largest eigenvalue of `T`, so that what is left out after enough of them is a geometric series. That eigenvalue is
//! found once for the operator and not for each light. The number of terms and the weight of the last ones are therefore
//! the same for every light, and the sum is as linear in the light as its terms are.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{Operator, Work};

/// Terms are computed one by one until a further one would be this share of the whole, for light that has settled.
const NEGLIGIBLE: f64 = 1e-3;
/// And never more than this.
const MOST: u32 = 64;
/// Terms of a coarse sum.
const COARSE_TERMS: u32 = 2;
/// A light whose terms shrink faster than the operator's worst ends earlier, where what is left is this share of the light
/// it began with: the rounding of its sum, so that no light can be told from another by where it ended.
const ROUNDING: f64 = 1e-7;
/// Whether that is so is asked once in so many terms, for it costs a good part of one.
const ASKED_EVERY: u32 = 4;
/// Light that loses less than a hundredth a bounce is followed as if it lost that: in a closed white room it would go
/// round forever.
const LARGEST_RATIO: f64 = 0.99;
/// Steps of the power iteration: rarely more than ten are taken.
const POWER_STEPS: u32 = 40;
/// It ends where two estimates differ by less. Of a tail that is 0.2% of the whole this leaves a hundredth.
const STEADY: f64 = 1e-4;

/// The sum of all bounces within the cloud, for one bounce operator and albedo.
#[derive(Clone, Debug)]
pub struct BounceSeries {
    /// Albedo of each gather sample, times what keeps the operator from making light.
    albedo: Vec<Vec3>,
    /// The largest eigenvalue of `A M` in each channel, at most [`LARGEST_RATIO`].
    ratio: DVec3,
    /// Terms that are computed one by one.
    terms: u32,
}

impl BounceSeries {
    /// Finds out how fast light fades. `albedo` has one entry a gather sample.
    ///
    /// No light goes round with less loss than at the highest albedo. Where the noise of the rows makes the operator
    /// do so, it is scaled down, channel by channel: the series converges whatever the operator.
    ///
    /// # Panics
    /// If `bounce` and `albedo` are of different clouds.
    pub fn new(bounce: &Operator, albedo: &[Vec3]) -> Self {
        let highest = albedo.iter().fold(Vec3::ZERO, |highest, albedo| highest.max(*albedo));
        let limit = highest.as_dvec3().min(DVec3::splat(LARGEST_RATIO));
        let found = largest_eigenvalues(bounce, albedo);
        let scale = DVec3::from_array([0, 1, 2].map(|c| {
            let excess = found[c] > limit[c];
            if excess { limit[c] / found[c] } else { 1.0 }
        }));
        let ratio = found.min(limit);
        let terms = terms(ratio.max_element());
        Self { albedo: albedo.iter().map(|albedo| *albedo * scale.as_vec3()).collect(), ratio, terms }
    }

    /// The same sum from few terms: what is left out after two is taken to fade like light that has settled. For a look while a light moves.
    #[must_use]
    pub fn coarse(&self) -> Self {
        Self { terms: self.terms.min(COARSE_TERMS), ..self.clone() }
    }

    /// What light keeps in one bounce once it has settled, in each channel.
    pub fn ratio(&self) -> DVec3 {
        self.ratio
    }

    /// `A M g`: light on the cloud after one bounce of `light`, and how much there was to do for it. `bounce` is the operator that the series
    /// was made for, `epsilon` that of culling.
    pub fn reflect(&self, bounce: &Operator, light: &[Vec3], epsilon: f32) -> (Vec<Vec3>, Work) {
        reflected(bounce, &self.albedo, light, epsilon)
    }

    /// `g + A M g + (A M)^2 g + ...`: the light on the cloud after `times` bounces within it; `None` sums them all. Also
    /// returns how often `M` was applied, and how much there was to do for it. `bounce` is the operator that the series was made
    /// for, `epsilon` that of culling ([`Operator::apply_coefficients`]), relative to all light there is: of a late and faint bounce more is
    /// left out. 0 leaves out nothing.
    pub fn sum(
        &self,
        bounce: &Operator,
        direct: &[Vec3],
        times: Option<u32>,
        epsilon: f32,
    ) -> (Vec<Vec3>, u32, Work) {
        let terms = times.unwrap_or(u32::MAX).min(self.terms);
        let (mut total, mut before, mut last) = (direct.to_vec(), Vec::new(), direct.to_vec());
        let enough = ROUNDING * norm(direct);
        let (mut done, mut work) = (0, Work::default());
        while done < terms {
            let epsilon = if epsilon > 0.0 { share_of(epsilon, &total, &last) } else { 0.0 };
            let (next, step) = reflected(bounce, &self.albedo, &last, epsilon);
            work += step;
            before = std::mem::replace(&mut last, next);
            add(&mut total, &last, Vec3::ONE);
            done += 1;
            if done % ASKED_EVERY == 0 && (norm(&last) * self.tail(None)).cmple(enough).all() {
                break;
            }
        }
        if done > 0 && times.is_none_or(|times| times > done) {
            // Light thrown to and fro between two walls has an eigenvalue near `-ratio`. The mean of the last two terms,
            // brought to the same bounce, holds none of it.
            let tail = self.tail(times.map(|times| times - done));
            add(&mut total, &before, (0.5 * self.ratio * tail).as_vec3());
            add(&mut total, &last, (0.5 * tail).as_vec3());
        }
        (total, done, work)
    }

    /// `r + r^2 + ... + r^times`, for each channel.
    fn tail(&self, times: Option<u32>) -> DVec3 {
        let whole = self.ratio / (1.0 - self.ratio);
        let left_out = times.map_or(DVec3::ZERO, |times| self.ratio.powf(f64::from(times)));
        whole * (1.0 - left_out)
    }
}

/// The `epsilon` for the bounce after `last`, where `total` may lose this one in all; at most 1. Squares of what the bounces lose add up to that of
/// what the whole may lose, if each is given its share of it.
fn share_of(epsilon: f32, total: &[Vec3], last: &[Vec3]) -> f32 {
    let share = norm(total).element_sum() / norm(last).element_sum().max(1e-300);
    (f64::from(epsilon) * share.sqrt()).min(1.0) as f32
}

/// The same sum term by term, of [`MOST`] at most, without a look at how fast light fades: for a few bounces of many
/// lights under an operator that is used for nothing else.
pub(super) fn gather_bounces(
    bounce: &Operator,
    albedo: &[Vec3],
    direct: &[Vec3],
    times: Option<u32>,
) -> (Vec<Vec3>, u32) {
    let (mut total, mut last) = (direct.to_vec(), direct.to_vec());
    let times = times.unwrap_or(MOST).min(MOST);
    for _ in 0..times {
        last = reflected(bounce, albedo, &last, 0.0).0;
        add(&mut total, &last, Vec3::ONE);
    }
    (total, times)
}

/// After how many terms a further one is negligible where each is `ratio` times the one before.
fn terms(ratio: f64) -> u32 {
    // ratio^n (1 - ratio) <= NEGLIGIBLE; below it needs one term, for the tail to stand on
    let count = (NEGLIGIBLE / (1.0 - ratio)).ln() / ratio.ln();
    if ratio > 0.0 { (count.ceil() as u32).clamp(1, MOST) } else { 1 }
}

/// `A M light`.
pub(super) fn reflected(
    bounce: &Operator,
    albedo: &[Vec3],
    light: &[Vec3],
    epsilon: f32,
) -> (Vec<Vec3>, Work) {
    let mut reflected = vec![Vec3::ZERO; bounce.rows];
    let work = bounce.apply_coefficients(&bounce.coefficients(light), epsilon, &mut reflected);
    // the sky, whose samples come last, reflects nothing
    reflected.resize(light.len(), Vec3::ZERO);
    reflected.par_iter_mut().zip(albedo).with_min_len(4096).for_each(|(light, albedo)| *light *= *albedo);
    (reflected, work)
}

fn add(total: &mut [Vec3], light: &[Vec3], weight: Vec3) {
    let both = total.par_iter_mut().zip(light).with_min_len(4096);
    both.for_each(|(total, light)| *total += weight * *light);
}

/// The largest eigenvalue of `A M` in each channel, by power iteration from light everywhere.
///
/// Over two steps at a time: light that is thrown to and fro grows and shrinks by turns.
fn largest_eigenvalues(bounce: &Operator, albedo: &[Vec3]) -> DVec3 {
    if albedo.is_empty() {
        return DVec3::ZERO; // a shot of direct light alone
    }
    let mut light = albedo.to_vec();
    let mut growth = [DVec3::ZERO; 2];
    let mut found = DVec3::ZERO;
    for step in 0..POWER_STEPS {
        let size = norm(&light);
        let inverse = size.map(|size| if size > 0.0 { 1.0 / size } else { 0.0 }).as_vec3();
        light.iter_mut().for_each(|light| *light *= inverse);
        light = reflected(bounce, albedo, &light, 0.0).0;
        growth = [growth[1], norm(&light)];
        let estimate = (growth[0] * growth[1]).map(f64::sqrt);
        let steady = (estimate - found).abs().max_element() < STEADY;
        found = estimate;
        if step > 2 && steady {
            break;
        }
    }
    found
}

/// The norm of each channel.
fn norm(light: &[Vec3]) -> DVec3 {
    // in parts that do not depend on the number of threads
    let part = |light: &[Vec3]| light.iter().map(|rgb| rgb.as_dvec3() * rgb.as_dvec3()).sum();
    let parts: Vec<DVec3> = light.par_chunks(4096).map(part).collect();
    parts.into_iter().sum::<DVec3>().map(f64::sqrt)
}

#[cfg(test)]
#[path = "bounces_tests.rs"]
mod tests;
