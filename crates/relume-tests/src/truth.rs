//! Relit images against the path tracer, with the path tracer's own noise taken out.

use relume::LightRig;
use relume::image::Image;
use relume::reference::{Paths, Settings, render};

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
    /// Entry `k` holds all light of up to `k + 1` indirect bounces.
    pub indirect: Vec<Truth>,
}

/// Traces the paths that the transfer models, up to `bounces`, with `spp` paths a pixel.
///
/// # Panics
/// If the settings are out of range.
pub fn trace(built: &TestScene, rig: &LightRig, size: (usize, usize), bounces: u32, spp: u32) -> Truths {
    let settings = |seed| Settings {
        width: size.0,
        height: size.1,
        spp: spp / 2,
        bounces: Some(bounces),
        aa: 1,
        paths: Paths::Transfer,
        seed,
        per_bounce: true,
        ..Settings::default()
    };
    let halves = [1, 2].map(|seed| {
        render(&built.scene, &built.geometry, &built.accel, rig, &settings(seed), &())
            .expect("valid settings")
    });
    let both = |image: &dyn Fn(usize) -> Image| Truth { halves: [image(0), image(1)] };
    let up_to = |bounce: usize, half: usize| {
        let parts = &halves[half].indirect_by_bounce[..=bounce];
        let mut sum = parts[0].clone();
        for part in &parts[1..] {
            sum.pixels.iter_mut().zip(&part.pixels).for_each(|(sum, pixel)| *sum += *pixel);
        }
        sum
    };
    Truths {
        direct: both(&|half| halves[half].layers.direct.clone()),
        indirect: (0..bounces as usize).map(|bounce| both(&|half| up_to(bounce, half))).collect(),
    }
}

/// `norm(image - truth) / norm(truth)`, both squared norms taken as products with independent halves: the noise of
/// the truth adds nothing on average.
pub fn unbiased_relative_l2(image: &Image, truth: &Truth) -> f64 {
    let [a, b] = &truth.halves;
    let (mut error, mut norm) = (0.0, 0.0);
    for (pixel, (a, b)) in image.pixels.iter().zip(a.pixels.iter().zip(&b.pixels)) {
        let (pixel, a, b) = (pixel.as_dvec3(), a.as_dvec3(), b.as_dvec3());
        error += (pixel - a).dot(pixel - b);
        norm += a.dot(b);
    }
    (error.max(0.0) / norm.max(f64::MIN_POSITIVE)).sqrt()
}

/// The median and the largest of some errors.
pub fn median_and_worst(errors: &[f64]) -> (f64, f64) {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[sorted.len() / 2], sorted[sorted.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::{Truth, unbiased_relative_l2};
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
        assert!((unbiased_relative_l2(&flat(1.1), &truth) - 0.1).abs() < 0.02);
    }
}
