//! Relit images against the path tracer, with the path tracer's own noise taken out.

use relume::image::Image;
use relume::reference::{MAX_BOUNCE_IMAGES, Paths, Reference, Settings, render};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::trace::sampling::hash;
use relume::{LightRig, Progress, Result, Scene};

use crate::scenes::TestScene;

/// One layer as the path tracer sees it, twice, with independent noise.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Two estimates of the same image.
    pub halves: [Image; 2],
}

/// Path-traced direct light, and indirect light after each number of bounces.
#[derive(Clone, Debug)]
pub struct Truths {
    /// What surfaces emit, and light that met none on its way to what the camera sees.
    pub direct: Truth,
    /// Entry `k` holds all light of up to the `k`-th number of indirect bounces asked for; `k + 1` from [`trace`].
    pub indirect: Vec<Truth>,
}

/// Traces the paths that the transfer models, up to `bounces`, with `spp` paths a pixel.
///
/// # Panics
/// If the settings are out of range.
pub fn trace(built: &TestScene, rig: &LightRig, size: (usize, usize), bounces: u32, spp: u32) -> Truths {
    let settings =
        Settings { width: size.0, height: size.1, spp, aa: 1, paths: Paths::Transfer, ..Settings::default() };
    let counts: Vec<_> = (1..=bounces).map(Some).collect();
    let TestScene { scene, geometry, accel } = built;
    trace_bounces(scene, geometry, accel, rig, &settings, &counts, &()).expect("valid settings")
}

/// Traces two halves of `settings.spp / 2` paths a pixel each. Entry `k` of the indirect light holds all light of up to
/// `counts[k]` bounces, at most [`MAX_BOUNCE_IMAGES`]; `None` is unlimited. Bounces and seed of `settings` do not count.
///
/// # Errors
/// As [`render`].
///
/// # Panics
/// If a count is 0 or more than [`MAX_BOUNCE_IMAGES`].
pub fn trace_bounces(
    scene: &Scene,
    geometry: &Geometry,
    accel: &Accel,
    rig: &LightRig,
    settings: &Settings,
    counts: &[Option<u32>],
    progress: &dyn Progress,
) -> Result<Truths> {
    assert!(counts.iter().flatten().all(|count| (1..=MAX_BOUNCE_IMAGES).contains(count)), "{counts:?}");
    let unlimited = counts.contains(&None);
    let half = |seed| {
        let settings = Settings {
            spp: settings.spp.div_ceil(2),
            bounces: if unlimited { None } else { counts.iter().copied().flatten().max() },
            seed,
            per_bounce: counts.iter().any(Option::is_some),
            ..settings.clone()
        };
        render(scene, geometry, accel, rig, &settings, progress)
    };
    let halves = [half(1)?, half(2)?];
    let both = |image: &dyn Fn(&Reference) -> Image| Truth { halves: halves.each_ref().map(image) };
    Ok(Truths {
        direct: both(&|half| half.layers.direct.clone()),
        indirect: counts.iter().map(|&count| both(&|half| up_to(half, count))).collect(),
    })
}

/// All indirect light of up to `count` bounces.
fn up_to(reference: &Reference, count: Option<u32>) -> Image {
    let Some(count) = count else { return reference.layers.indirect.clone() };
    let parts = &reference.indirect_by_bounce[..count as usize];
    let mut sum = parts[0].clone();
    for part in &parts[1..] {
        sum.pixels.iter_mut().zip(&part.pixels).for_each(|(sum, pixel)| *sum += *pixel);
    }
    sum
}

impl Truth {
    /// The mean of the halves.
    pub fn mean(&self) -> Image {
        let [a, b] = &self.halves;
        Image { pixels: a.pixels.iter().zip(&b.pixels).map(|(a, b)| 0.5 * (*a + *b)).collect(), ..*a }
    }

    /// Both layers together, half by half.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let mut sum = self.clone();
        for (sum, other) in sum.halves.iter_mut().zip(&other.halves) {
            sum.pixels.iter_mut().zip(&other.pixels).for_each(|(sum, pixel)| *sum += *pixel);
        }
        sum
    }

    /// Relative L2 noise of [`Self::mean`]: `norm(a - b) / 2` over its norm without the noise.
    pub fn noise(&self) -> f64 {
        let [a, b] = &self.halves;
        let (mut noise, mut norm) = (0.0, 0.0);
        for (a, b) in a.pixels.iter().zip(&b.pixels) {
            let (a, b) = (a.as_dvec3(), b.as_dvec3());
            noise += 0.25 * (a - b).length_squared();
            norm += a.dot(b);
        }
        (noise / norm.max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// `norm(image - truth) / norm(truth)`, both squared norms taken as products with independent halves: the noise of
/// the truth adds nothing on average.
pub fn unbiased_relative_l2(image: &Image, truth: &Truth) -> f64 {
    unbiased_relative_l2_where(image, truth, |_| true)
}

/// The same over the pixels that count, told by their index. 0 where chance makes the square negative; see
/// [`uncertainty`].
pub fn unbiased_relative_l2_where(image: &Image, truth: &Truth, counts: impl Fn(usize) -> bool) -> f64 {
    unbiased_square(image, truth, counts).max(0.0).sqrt()
}

/// Squared relative L2, negative where the noise that is left is larger than the error.
fn unbiased_square(image: &Image, truth: &Truth, counts: impl Fn(usize) -> bool) -> f64 {
    let [a, b] = &truth.halves;
    let (mut error, mut norm) = (0.0, 0.0);
    for (index, (pixel, (a, b))) in image.pixels.iter().zip(a.pixels.iter().zip(&b.pixels)).enumerate() {
        if counts(index) {
            let (pixel, a, b) = (pixel.as_dvec3(), a.as_dvec3(), b.as_dvec3());
            error += (pixel - a).dot(pixel - b);
            norm += a.dot(b);
        }
    }
    error / norm.max(f64::MIN_POSITIVE)
}

/// How much larger than [`unbiased_relative_l2`] the error is when its square is one standard error larger: a bound that
/// holds its meaning where the error itself comes out as 0. The standard error is a jackknife's over sixteen groups of
/// pixels, each scattered over the whole image.
pub fn uncertainty(image: &Image, truth: &Truth) -> f64 {
    const GROUPS: u32 = 16;
    let group = |index: usize| hash(index as u32, 0) % GROUPS;
    let without = (0..GROUPS).map(|left_out| unbiased_square(image, truth, |i| group(i) != left_out));
    let without: Vec<f64> = without.collect();
    let count = f64::from(GROUPS);
    let mean = without.iter().sum::<f64>() / count;
    let spread: f64 = without.iter().map(|square| (square - mean).powi(2)).sum();
    let standard_error = ((count - 1.0) / count * spread).sqrt();
    let square = unbiased_square(image, truth, |_| true).max(0.0);
    (square + standard_error).sqrt() - square.sqrt()
}

/// The median and the largest of some errors.
pub fn median_and_worst(errors: &[f64]) -> (f64, f64) {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[sorted.len() / 2], sorted[sorted.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::{Truth, unbiased_relative_l2, uncertainty};
    use relume::glam::Vec3;
    use relume::image::Image;
    use relume::trace::sampling::{hash, unit};

    #[test]
    fn noise_of_the_truth_does_not_count_but_error_does() {
        let noisy = |seed| Image {
            width: 100,
            height: 100,
            pixels: (0..10_000).map(|i| Vec3::splat(0.5 + unit(hash(i, seed)))).collect(),
        };
        let truth = Truth { halves: [noisy(1), noisy(2)] };
        let flat = |value| Image { width: 100, height: 100, pixels: vec![Vec3::splat(value); 10_000] };
        // the noise is 29%; what is left of it is at most the square root of 0.083 / sqrt(10,000)
        assert!(unbiased_relative_l2(&flat(1.0), &truth) < 0.05);
        let off = unbiased_relative_l2(&flat(1.1), &truth);
        assert!((off - 0.1).abs() < 0.02);
        let told = uncertainty(&flat(1.1), &truth);
        assert!(told > 1e-4 && (off - 0.1).abs() < 4.0 * told && told < 0.02, "{off} {told}");
        // at no error the noise that is left is told: 0.083 / sqrt(10,000) in the square, give or take its own spread
        let told = uncertainty(&flat(1.0), &truth);
        assert!((0.01..0.05).contains(&told), "{told}");
        // 29% a half is 20% for the mean of two; the wrong input is a truth without noise
        assert!((truth.noise() - 0.204).abs() < 0.01, "{}", truth.noise());
        let [a, _] = truth.halves;
        assert_eq!(Truth { halves: [a.clone(), a] }.noise(), 0.0);
    }
}
