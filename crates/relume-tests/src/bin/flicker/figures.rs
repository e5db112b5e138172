//! The second difference over time of a sequence of images.

use relume::glam::DVec3;
use relume::image::Image;
use serde::Serialize;

/// Median, largest and root mean square over the steps of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    pub(crate) worst: f64,
    pub(crate) rms: f64,
}

impl Spread {
    /// Of roots of these squares. Where chance makes one negative, or the mean, its root is 0.
    ///
    /// # Panics
    /// If there are none.
    pub(crate) fn of_squares(squares: &[f64]) -> Self {
        let mut sorted = squares.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self {
            median: root(sorted[sorted.len() / 2]),
            worst: root(sorted[sorted.len() - 1]),
            rms: root(squares.iter().sum::<f64>() / squares.len() as f64),
        }
    }

    /// As multiples of another's; `None` where one of those is 0.
    pub(crate) fn over(&self, other: &Self) -> Option<Self> {
        let all = other.median > 0.0 && other.worst > 0.0 && other.rms > 0.0;
        all.then(|| Self {
            median: self.median / other.median,
            worst: self.worst / other.worst,
            rms: self.rms / other.rms,
        })
    }
}

/// The root, of 0 where chance makes a square negative.
pub(crate) fn root(square: f64) -> f64 {
    square.max(0.0).sqrt()
}

/// The relative second difference of an image sequence `I`, squared, for every image but the first and last: the norm of
/// `I[k - 1] - 2 I[k] + I[k + 1]` over that of `I[k]`, linear RGB.
///
/// Norms are products of two sequences: given twice the same one they are its own, given two estimates of it with independent
/// noise they are free of that on average, and may be negative.
pub(crate) fn squares(first: &[Image], second: &[Image]) -> Vec<f64> {
    let square = |(a, b): (&[Image], &[Image])| {
        let (mut difference, mut norm) = (0.0, 0.0);
        for pixel in 0..a[1].pixels.len() {
            difference += change(a, pixel).dot(change(b, pixel));
            norm += a[1].pixels[pixel].as_dvec3().dot(b[1].pixels[pixel].as_dvec3());
        }
        difference / norm.max(f64::MIN_POSITIVE)
    };
    first.windows(3).zip(second.windows(3)).map(square).collect()
}

/// The same for the difference between `images` and the sequence that `halves` are two independent estimates of, relative to the
/// latter: what moves in `images` and should not, or should and does not.
pub(crate) fn error_squares(images: &[Image], halves: &[Vec<Image>; 2]) -> Vec<f64> {
    let square = |first: usize| {
        let [own, a, b] = [images, &halves[0], &halves[1]].map(|images| &images[first..first + 3]);
        let (mut error, mut norm) = (0.0, 0.0);
        for pixel in 0..own[1].pixels.len() {
            let found = change(own, pixel);
            error += (found - change(a, pixel)).dot(found - change(b, pixel));
            norm += a[1].pixels[pixel].as_dvec3().dot(b[1].pixels[pixel].as_dvec3());
        }
        error / norm.max(f64::MIN_POSITIVE)
    };
    (0..images.len().saturating_sub(2)).map(square).collect()
}

/// The second difference of a pixel in three images.
fn change(images: &[Image], pixel: usize) -> DVec3 {
    let at = |image: usize| images[image].pixels[pixel].as_dvec3();
    at(0) - 2.0 * at(1) + at(2)
}

/// How much larger the root mean square over the steps that [`squares`] has of two estimates is when its square is one standard error larger.
///
/// Each pixel has rays of its own, so that grain is independent from pixel to pixel, but not from step to step. What a pixel adds
/// errs by half of the difference between what it adds to the one's own squares and to the other's: that has the same variance, `4 (s n)^2`
/// with the mean `s` of the two and half their difference `n`, and where there is nothing but grain, too.
pub(crate) fn rms_uncertainty(first: &[Image], second: &[Image]) -> f64 {
    let pixels = first.first().map_or(0, |image| image.pixels.len());
    let mut errors = vec![0.0; pixels];
    let mut steps = 0.0_f64;
    for (a, b) in first.windows(3).zip(second.windows(3)) {
        let products = a[1].pixels.iter().zip(&b[1].pixels).map(|(a, b)| a.as_dvec3().dot(b.as_dvec3()));
        let norm = products.sum::<f64>().max(f64::MIN_POSITIVE);
        for (pixel, error) in errors.iter_mut().enumerate() {
            *error += 0.5 * (change(a, pixel).length_squared() - change(b, pixel).length_squared()) / norm;
        }
        steps += 1.0;
    }
    let standard_error = errors.iter().map(|error| error * error).sum::<f64>().sqrt() / steps.max(1.0);
    let rms = Spread::of_squares(&squares(first, second)).rms;
    (rms * rms + standard_error).sqrt() - rms
}

/// The largest second difference of a single pixel, over the root mean square pixel of its image.
pub(crate) fn largest_pixel(images: &[Image]) -> f64 {
    let largest = |images: &[Image]| {
        let pixels = &images[1].pixels;
        let mean =
            pixels.iter().map(|pixel| pixel.as_dvec3().length_squared()).sum::<f64>() / pixels.len() as f64;
        let most = (0..pixels.len()).map(|pixel| change(images, pixel).length()).fold(0.0, f64::max);
        most / mean.sqrt().max(f64::MIN_POSITIVE)
    };
    images.windows(3).map(largest).fold(0.0, f64::max)
}

/// The mean of two sequences, image by image.
pub(crate) fn mean(first: &[Image], second: &[Image]) -> Vec<Image> {
    let mean = |(a, b): (&Image, &Image)| Image {
        pixels: a.pixels.iter().zip(&b.pixels).map(|(a, b)| 0.5 * (*a + *b)).collect(),
        ..*a
    };
    first.iter().zip(second).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::Vec3;
    use relume::trace::sampling::{hash, unit};

    const PIXELS: u32 = 4096;

    fn sequence(steps: u32, pixel: impl Fn(u32, u32) -> f32) -> Vec<Image> {
        let image = |step: u32| Image {
            width: 64,
            height: 64,
            pixels: (0..PIXELS).map(|index| Vec3::splat(pixel(step, index))).collect(),
        };
        (0..steps).map(image).collect()
    }

    #[test]
    fn what_grows_evenly_does_not_flicker_and_a_jump_does() {
        let even = sequence(6, |step, pixel| 1.0 + 0.125 * step as f32 * (1 + pixel % 3) as f32);
        assert_eq!(squares(&even, &even), [0.0; 4]);
        assert_eq!(largest_pixel(&even), 0.0);
        // from 1 to 1.5 after the third image: that one and the next see it, against 1 and 1.5
        let jump = sequence(6, |step, _| if step < 3 { 1.0 } else { 1.5 });
        let expected = [0.0, 0.25, 0.25 / 2.25, 0.0];
        assert_eq!(squares(&jump, &jump), expected);
        let spread = Spread::of_squares(&expected);
        assert!((spread.worst - 0.5).abs() < 1e-12 && (spread.median - 1.0 / 3.0).abs() < 1e-12);
        assert!((spread.rms - (expected.iter().sum::<f64>() / 4.0).sqrt()).abs() < 1e-12);
        assert_eq!(largest_pixel(&jump), 0.5);
        // a single pixel of a half: the whole image hardly moves
        let one = sequence(6, |step, pixel| if step < 3 || pixel > 0 { 1.0 } else { 1.5 });
        assert!(
            Spread::of_squares(&squares(&one, &one)).worst < 0.01 && (largest_pixel(&one) - 0.5).abs() < 1e-3
        );
    }

    /// Each estimate has a grain of 0.1 an image, which is `sqrt(6)` as much in second differences, and a true one of 0.02.
    #[test]
    fn independent_grain_does_not_count() {
        let grainy = |seed: u32| {
            sequence(20, move |step, pixel| {
                let grain = unit(hash(pixel, hash(step, seed))) - 0.5;
                1.0 + true_light(step) + 0.1 * 12_f32.sqrt() * grain
            })
        };
        let (a, b) = (grainy(1), grainy(2));
        let alone = Spread::of_squares(&squares(&a, &a)).rms;
        assert!((alone - 0.245).abs() < 0.01, "{alone}");
        let rms = Spread::of_squares(&squares(&a, &b)).rms;
        let told = rms_uncertainty(&a, &b);
        // grain of 0.245 in 20 images of 4096 pixels leaves about 0.06 / 64 / 3 in the square; one set would be told without any
        assert!((rms - 0.02).abs() < 4.0 * told && (0.002..0.02).contains(&told), "{rms} +- {told}");
        assert_eq!(rms_uncertainty(&a, &a), 0.0);
        // a sequence that moves as the true one does has no error, one that rests has it all
        let own = sequence(20, |step, _| 1.0 + true_light(step));
        let still = sequence(20, |_, _| 1.0);
        let halves = [a.clone(), b.clone()];
        let error = |images: &[Image]| Spread::of_squares(&error_squares(images, &halves)).rms;
        assert!(
            error(&own) < 0.01 && (error(&still) - rms).abs() < 1e-6,
            "{} {}",
            error(&own),
            error(&still)
        );
        let both = mean(&a, &b);
        assert!(Spread::of_squares(&squares(&both, &both)).rms > 0.15);
    }

    /// To and fro by 0.005: a second difference of 0.02.
    fn true_light(step: u32) -> f32 {
        if step.is_multiple_of(2) { 0.005 } else { -0.005 }
    }
}
