//! The light prior: how much each wavelet coefficient of light on the cloud is expected to vary.
//!
//! Learned from random lights (`training.rs`) and from light from everywhere, each scaled so that it carries the same energy on the cloud: how
//! large each coefficient is, and which go together. The spread falls with the area of the basis function by far less than area-weighted
//! selection assumes.

use glam::Vec3;

use super::training::Training;
use super::{Coefficients, Operator, Selection, bounces, haar};
use crate::progress::Progress;
use crate::sample::GatherCloud;
use crate::{Error, Result};

/// Share of a coefficient's own measured variance in its prior; the rest is the mean of its level, so that a
/// coefficient that no training light happened to touch is not thought impossible.
const OWN_SHARE: f64 = 0.6;

/// What is known of light on the cloud before a lamp is set. Errors are relative to each image: a light that shines on little, and
/// brightly, counts no more than others. All are scaled to the same energy, a mean square of one on the cloud.
pub(super) struct LightPrior {
    /// `D`: the expected magnitude of each Haar coefficient, all channels; its mean square is one. Learned, or what another
    /// [`Selection`] puts in its place.
    pub(super) magnitudes: Vec<f32>,
    /// `C`: the grey coefficients of the training lights over `D`. Row after row, a row a coefficient, a column a light.
    pub(super) training: Vec<f32>,
    /// Columns of `training`.
    pub(super) lights: usize,
    /// The same of lights from which nothing is learned: they tell how well what was learned holds.
    pub(super) held: Vec<f32>,
    /// Columns of `held`.
    pub(super) held_lights: usize,
    /// Those of them that are of the kinds that were learned from: the first.
    pub(super) held_alike: usize,
}

/// Random lights that all that shines in the scene counts as much as, together: it is known, where they are guesses.
const SHINING: f64 = 24.0;
/// One light in so many is held out: the last ones.
const HELD_OUT: usize = 4;
/// Most lights that are held out. Each costs a product with all rows.
const MOST_HELD_OUT: usize = 48;

/// How far a prior has learned.
struct Lessons {
    /// Grey coefficients of each light.
    grey: Vec<Vec<f32>>,
    /// Sum over lights of the squares of each coefficient, all channels.
    variance: Vec<f64>,
}

impl LightPrior {
    /// Learns from `lights` on the cloud, with their bounces where a bounce operator is given and how often to apply it. `selection` says
    /// whether magnitudes are learned as well.
    pub(super) fn new(
        cloud: &GatherCloud,
        lights: &Training,
        selection: Selection,
        bounce: Option<(&Operator, u32)>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let count = cloud.len();
        let albedo: Vec<Vec3> = cloud.samples.iter().map(|sample| sample.albedo).collect();
        let mut lessons = Lessons { grey: Vec::new(), variance: vec![0.0; count] };
        // light from everywhere: a closed room under an even sky, and what is left where no lamp shines on anything
        lessons.learn(&vec![Vec3::ONE; count], 1.0);
        let mut held = Vec::new();
        let alike = lights.alike.len();
        let first_held = alike - alike.div_ceil(HELD_OUT).min(MOST_HELD_OUT);
        let mut held_alike = 0;
        // what reflects nothing has no colour of its own: the sky, and black lamps that shine
        let tint = |rgb: &Vec3| match rgb.element_sum() {
            sum if sum > 0.0 => *rgb * (3.0 / sum),
            _ => Vec3::ONE,
        };
        let tints: Vec<Vec3> = albedo.iter().map(tint).collect();
        let arrives = |light: &[f32]| -> Vec<Vec3> {
            let light: Vec<Vec3> = light.iter().zip(&tints).map(|(grey, tint)| *grey * *tint).collect();
            match bounce {
                Some((bounce, times)) => bounces::gather_bounces(bounce, &albedo, &light, Some(times)).0,
                None => light,
            }
        };
        for shining in &lights.shining {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            lessons.learn(&arrives(shining), SHINING / lights.shining.len() as f64);
        }
        for (index, light) in lights.alike.iter().chain(&lights.others).enumerate() {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let light = arrives(light);
            if index < first_held {
                lessons.learn(&light, 1.0);
            } else {
                held.extend(scaled(&light).map(|(_, grey)| grey));
                if index < alike {
                    held_alike = held.len();
                }
            }
            progress.advance(1);
        }
        let Lessons { grey, variance } = lessons;
        let magnitudes = selection.unlearned(count).unwrap_or_else(|| magnitudes(&variance));
        Ok(Self {
            training: columns(&grey, &magnitudes),
            lights: grey.len(),
            held: columns(&held, &magnitudes),
            held_lights: held.len(),
            held_alike,
            magnitudes,
        })
    }
}

impl Lessons {
    /// `weight` is how many lights it counts as.
    fn learn(&mut self, light: &[Vec3], weight: f64) {
        let Some((shares, mut grey)) = scaled(light) else { return };
        for (variance, share) in self.variance.iter_mut().zip(shares) {
            *variance += weight * share;
        }
        grey.iter_mut().for_each(|coefficient| *coefficient *= weight.sqrt() as f32);
        self.grey.push(grey);
    }
}

/// The share of a light's energy in each coefficient, all channels, and its grey coefficients, scaled to the energy that all lights
/// have. `None` for one that meets nothing: it teaches nothing.
fn scaled(light: &[Vec3]) -> Option<(Vec<f64>, Vec<f32>)> {
    let coefficients = Coefficients::new(light, &[]);
    let squares = |rgb: &[f32; 3]| rgb.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>();
    let mut shares: Vec<f64> = coefficients.as_slice().iter().map(squares).collect();
    let energy: f64 = shares.iter().sum();
    if energy <= 0.0 {
        return None;
    }
    shares.iter_mut().for_each(|share| *share /= energy);
    let scale = (light.len() as f64 / (3.0 * energy)).sqrt() as f32;
    let grey = coefficients.as_slice().iter().map(|rgb| scale * rgb.iter().sum::<f32>());
    Some((shares, grey.collect()))
}

/// `D` from the sum over lights of the squares of each coefficient.
fn magnitudes(variance: &[f64]) -> Vec<f32> {
    let count = variance.len();
    let levels = haar::level(count.max(1) - 1) + 1;
    let (mut sums, mut members) = (vec![0.0; levels], vec![0.0; levels]);
    for (index, variance) in variance.iter().enumerate() {
        sums[haar::level(index)] += variance;
        members[haar::level(index)] += 1.0;
    }
    let blend = |index: usize| {
        let level = haar::level(index);
        OWN_SHARE * variance[index] + (1.0 - OWN_SHARE) * sums[level] / members[level]
    };
    let total: f64 = (0..count).map(blend).sum::<f64>().max(1e-300);
    let scale = count as f64 / total;
    // no coefficient is thought impossible
    (0..count).map(|index| ((blend(index) * scale).sqrt() as f32).max(1e-6)).collect()
}

/// Coefficients in units of their expected magnitudes, a column a light.
fn columns(lights: &[Vec<f32>], magnitudes: &[f32]) -> Vec<f32> {
    let mut columns = Vec::with_capacity(lights.len() * magnitudes.len());
    for (index, magnitude) in magnitudes.iter().enumerate() {
        columns.extend(lights.iter().map(|light| light[index] / magnitude));
    }
    columns
}
