//! The light prior: how much each wavelet coefficient of light on the cloud is expected to vary.
//!
//! Light is told as a multiple of what is expected of each sample, a lamp being as likely anywhere: a dark cloth beside a white wall and a niche that hardly
//! a lamp shines into are so under any light, and take no coefficients. How large each coefficient of these multiples is, and which go together, is learned
//! from random lights (`training.rs`) and from light from everywhere, each scaled so that it carries the same energy on the cloud. The spread
//! falls with the area of the basis function by far less than area-weighted selection assumes.

use glam::Vec3;

use super::outlook::Outlook;
use super::training::Training;
use super::{Coefficients, Encoding, Operator, Settings, bounces, haar};
use crate::progress::Progress;
use crate::sample::GatherCloud;
use crate::{Error, Result};

/// Share of a coefficient's own measured variance in its prior; the rest is the mean of its level, so that a
/// coefficient that no training light happened to touch is not thought impossible.
const OWN_SHARE: f64 = 0.6;

/// What is known of light on the cloud before a lamp is set. Errors are relative to each image: a light that shines on little, and
/// brightly, counts no more than others. All are scaled to the same energy, a mean square of one on the cloud as multiples of what is expected.
pub(super) struct LightPrior {
    /// `E`: the expected radiance of each gather sample on white paint, over the mean of those of surfaces. Light is
    /// told as a multiple of it.
    pub(super) expected: Vec<f32>,
    /// `D`: the expected magnitude of each Haar coefficient, all channels; its mean square is one. Learned, or what another
    /// [`Selection`](super::Selection) puts in its place.
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
/// What light from elsewhere adds to the expected radiance of a surface of mean albedo, as a share of the mean.
const ELSEWHERE: f32 = 0.05;
/// The least expected radiance, as a share of the mean: nothing is thought to stay dark.
const LEAST_EXPECTED: f32 = 0.02;
/// One light in so many is held out: the last ones.
const HELD_OUT: usize = 4;
/// Most lights that are held out. Each costs a product with all rows.
const MOST_HELD_OUT: usize = 48;

/// Of `alike` random lights, the number of the first that is held out.
fn first_held(alike: usize) -> usize {
    alike - alike.div_ceil(HELD_OUT).min(MOST_HELD_OUT)
}

/// Whether the light of this number, of `alike` and of others, falls on white paint: every second one that is learned from, so that what is learned holds for
/// surfaces that a rig paints.
pub(super) fn is_white(number: usize, alike: usize) -> bool {
    number < first_held(alike) && number % 2 == 1
}

/// How far a prior has learned.
struct Lessons<'a> {
    /// `E^-1`.
    inverse: &'a [f32],
    /// Grey coefficients of each light.
    grey: Vec<Vec<f32>>,
    /// Sum over lights of the squares of each coefficient, all channels.
    variance: Vec<f64>,
}

impl LightPrior {
    /// Learns from `lights` on the cloud, with their bounces where a bounce operator is given and how often to apply it. By `settings`
    /// magnitudes are learned as well or not; the Haar encodings, which are the paper's, take light as it is.
    pub(super) fn new(
        cloud: &GatherCloud,
        (lights, outlook): (&Training, &Outlook),
        settings: &Settings,
        bounce: Option<(&Operator, u32)>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let count = cloud.len();
        let albedo: Vec<Vec3> = cloud.samples.iter().map(|sample| sample.albedo).collect();
        let mut held = Vec::new();
        let alike = lights.alike.len();
        let first_held = first_held(alike);
        let mut held_alike = 0;
        // what reflects nothing has no colour of its own: the sky, and black lamps that shine
        let tint = |rgb: &Vec3| match rgb.element_sum() {
            sum if sum > 0.0 => *rgb * (3.0 / sum),
            _ => Vec3::ONE,
        };
        let tints = [&albedo, &lights.white].map(|albedo| albedo.iter().map(tint).collect::<Vec<_>>());
        let arrives = |light: &[f32], white: bool| -> Vec<Vec3> {
            let tints = &tints[usize::from(white)];
            let light: Vec<Vec3> = light.iter().zip(tints).map(|(grey, tint)| *grey * *tint).collect();
            match bounce {
                Some((bounce, times)) => bounces::gather_bounces(bounce, &albedo, &light, Some(times)).0,
                None => light,
            }
        };
        let expected = match settings.encoding {
            Encoding::LowRank => {
                let white = &lights.white[..cloud.surfaces().len()];
                expected_radiance(outlook, white, &arrives(&outlook.anywhere, true))
            }
            Encoding::HaarRows | Encoding::HaarBlocks => vec![1.0; count],
        };
        let inverse: Vec<f32> = expected.iter().map(|expected| 1.0 / expected).collect();
        let mut lessons = Lessons { inverse: &inverse, grey: Vec::new(), variance: vec![0.0; count] };
        // light from everywhere: a closed room under an even sky, and what is left where no lamp shines on anything
        lessons.learn(&vec![Vec3::ONE; count], 1.0);
        for shining in &lights.shining {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            lessons.learn(&arrives(shining, false), SHINING / lights.shining.len() as f64);
        }
        for (index, light) in lights.alike.iter().chain(&lights.others).enumerate() {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let light = arrives(light, is_white(index, alike));
            if index < first_held {
                lessons.learn(&light, 1.0);
            } else {
                held.extend(scaled(&light, &inverse).map(|(_, grey)| grey));
                if index < alike {
                    held_alike = held.len();
                }
            }
            progress.advance(1);
        }
        let Lessons { grey, variance, .. } = lessons;
        let magnitudes = settings.selection().unlearned(count).unwrap_or_else(|| magnitudes(&variance));
        Ok(Self {
            training: columns(&grey, &magnitudes),
            lights: grey.len(),
            held: columns(&held, &magnitudes),
            held_lights: held.len(),
            held_alike,
            magnitudes,
            expected,
        })
    }
}

impl Lessons<'_> {
    /// `weight` is how many lights it counts as.
    fn learn(&mut self, light: &[Vec3], weight: f64) {
        let Some((shares, mut grey)) = scaled(light, self.inverse) else { return };
        for (variance, share) in self.variance.iter_mut().zip(shares) {
            *variance += weight * share;
        }
        grey.iter_mut().for_each(|coefficient| *coefficient *= weight.sqrt() as f32);
        self.grey.push(grey);
    }
}

/// The share of a light's energy in each coefficient, all channels, and its grey coefficients, scaled to the energy that all lights
/// have. `None` for one that meets nothing: it teaches nothing.
fn scaled(light: &[Vec3], inverse: &[f32]) -> Option<(Vec<f64>, Vec<f32>)> {
    let coefficients = Coefficients::new(light, inverse, &[]);
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

/// `E`, from the light of lamps anywhere with its bounces, up to a common factor, and what surfaces reflect on `white` paint. What they leave dark may be lit otherwise, and then as brightly as it reflects. The
/// sky is expected to be as bright as the surfaces in the mean, and so is at least, whatever it reflects, the brightest place of what shines.
fn expected_radiance(outlook: &Outlook, white: &[Vec3], lights: &[Vec3]) -> Vec<f32> {
    let mean = |values: &mut dyn Iterator<Item = Vec3>| {
        let sum: f64 = values.map(|rgb| f64::from(rgb.element_sum())).sum();
        (sum / white.len().max(1) as f64).max(1e-30) as f32
    };
    let brightness = mean(&mut lights[..white.len()].iter().copied());
    let albedo = mean(&mut white.iter().copied());
    let expected = |(own, light): (&Vec3, &Vec3)| {
        let elsewhere = ELSEWHERE * own.element_sum() / albedo;
        (light.element_sum() / brightness + elsewhere).max(LEAST_EXPECTED)
    };
    let mut expected: Vec<f32> = white.iter().zip(lights).map(expected).collect();
    expected.resize(lights.len(), 1.0);
    let shining = expected.iter_mut().zip(&outlook.shining);
    shining.for_each(|(expected, &share)| *expected = expected.max(share));
    expected
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::GatherSample;
    use crate::trace::sampling::{hash, unit};
    use bytemuck::Zeroable;

    const COUNT: usize = 1024;

    /// Light and dark surfaces in no order.
    fn albedo(sample: usize) -> f32 {
        if hash(sample as u32, 3).is_multiple_of(2) { 0.9 } else { 0.1 }
    }

    fn cloud() -> GatherCloud {
        let sample = |sample| GatherSample { albedo: Vec3::splat(albedo(sample)), ..GatherSample::zeroed() };
        GatherCloud { samples: (0..COUNT).map(sample).collect(), ..GatherCloud::default() }
    }

    /// Lamps whose light grows and fades along the cloud, as surfaces reflect it; none is to be expected at those of `dark`.
    fn lights(count: u32, dark: impl Fn(usize) -> bool) -> (Training, Outlook) {
        let lamp = |lamp: u32| {
            let (middle, width) = (unit(hash(lamp, 1)), 0.1 + 0.4 * unit(hash(lamp, 2)));
            let off = |place: usize| (place as f32 / COUNT as f32 - middle) / width;
            (0..COUNT).map(|place| albedo(place) / (1.0 + off(place).powi(2))).collect()
        };
        let anywhere = |place| if dark(place) { 0.0 } else { albedo(place) };
        let outlook = Outlook { anywhere: (0..COUNT).map(anywhere).collect(), shining: Vec::new() };
        let white = (0..COUNT).map(|place| Vec3::splat(albedo(place))).collect();
        (Training { alike: (0..count).map(lamp).collect(), white, ..Training::default() }, outlook)
    }

    fn prior((lights, outlook): &(Training, Outlook), encoding: Encoding) -> LightPrior {
        let settings =
            Settings { encoding, selection: Some(super::super::Selection::Prior), ..Settings::default() };
        LightPrior::new(&cloud(), (lights, outlook), &settings, None, &()).unwrap()
    }

    /// The share of the lights that nothing was learned from in the finest details.
    fn finest(prior: &LightPrior) -> f64 {
        let row = |index: usize| &prior.held[index * prior.held_lights..][..prior.held_lights];
        let energy = |index: usize| -> f64 {
            let all = row(index).iter().map(|value| f64::from(value * prior.magnitudes[index]).powi(2));
            all.sum()
        };
        let total: f64 = (0..COUNT).map(energy).sum();
        (COUNT / 4..COUNT).map(energy).sum::<f64>() / total
    }

    #[test]
    fn nothing_is_judged_on_white_paint() {
        for alike in [0, 1, 64, 384] {
            let white = (0..alike + 24).filter(|&number| is_white(number, alike)).count();
            assert_eq!(white, first_held(alike) / 2, "of {alike}");
        }
    }

    #[test]
    fn what_surfaces_always_reflect_takes_no_details() {
        let lights = lights(40, |_| false);
        let plain = finest(&prior(&lights, Encoding::HaarRows));
        let told = finest(&prior(&lights, Encoding::LowRank));
        assert!(plain > 0.2, "as light is, details hold {plain} of it");
        assert!(told < 0.01 * plain, "as a multiple of what is expected {told}, for {plain}");
    }

    #[test]
    fn nothing_is_thought_to_stay_dark_and_the_sky_is_as_bright_as_the_rest() {
        let dark = |place: usize| place < COUNT / 2;
        let prior = prior(&lights(40, dark), Encoding::LowRank);
        let mean = |places: std::ops::Range<usize>| {
            let length = places.len() as f32;
            prior.expected[places].iter().sum::<f32>() / length
        };
        let (below, above) = (mean(0..COUNT / 2), mean(COUNT / 2..COUNT));
        assert!((below - ELSEWHERE).abs() < 0.2 * ELSEWHERE && above > 1.8, "{below} and {above}");
        assert!(prior.expected.iter().all(|&expected| expected >= LEAST_EXPECTED));
        let none = expected_radiance(&Outlook::default(), &[Vec3::ZERO; COUNT], &[Vec3::ZERO; COUNT]);
        assert!(none.iter().all(|&expected| expected == LEAST_EXPECTED));
        let surfaces = COUNT - COUNT / 16;
        let open = expected_radiance(&Outlook::default(), &vec![Vec3::ONE; surfaces], &[Vec3::ONE; COUNT]);
        assert!(open.len() == COUNT && open[surfaces..].iter().all(|&expected| expected == 1.0));
    }

    #[test]
    fn what_shines_is_expected_to_be_bright_whatever_it_reflects() {
        let mut lamp = vec![0.0; COUNT];
        (lamp[7], lamp[8]) = (1.0, 0.5);
        let expected = expected_radiance(
            &Outlook { shining: lamp, ..Outlook::default() },
            &[Vec3::ZERO; COUNT],
            &[Vec3::ZERO; COUNT],
        );
        assert_eq!(expected[6..10], [LEAST_EXPECTED, 1.0, 0.5, LEAST_EXPECTED]);
    }
}
