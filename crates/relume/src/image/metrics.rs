//! How far an image is from its reference.

use glam::Vec3;
use serde::Serialize;

use super::Image;
use super::display::{Tonemap, encode};
use super::flip::{PIXELS_PER_DEGREE, STEPS_A_ROW, flip_watched};
use crate::{Error, Progress, Result};

/// The figures of one image against its reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// `norm(image - reference) / norm(reference)` over all channels of the linear RGB, summed in f64.
    /// Against a black reference it is 0 for a black image and infinite for any other.
    pub relative_l2: f64,
    /// The same over the pixels that are not on a geometric edge; `None` where edges are not known or every
    /// pixel is on one.
    pub relative_l2_no_edges: Option<f64>,
    /// Peak signal-to-noise ratio, dB, of the display images ([`Tonemap::Neutral`], exposure 0, sRGB-encoded,
    /// peak 1, not rounded to 8 bits). Infinite where they are equal.
    pub psnr: f64,
    /// Mean LDR-FLIP of the same display images at [`PIXELS_PER_DEGREE`], `0..=1`.
    pub flip: f64,
}

/// Compares `image` with `reference`; `edges` marks pixels on a geometric edge.
///
/// # Errors
/// [`Error::Setting`] for images without pixels, of different sizes, with edges of another size, or with a
/// pixel that is not finite, which is named.
pub fn compare(image: &Image, reference: &Image, edges: Option<&[bool]>) -> Result<Comparison> {
    compare_watched(image, reference, edges, &())
}

/// The same, with `progress` told how far it is and asked whether to stop.
///
/// # Errors
/// As [`compare`], and [`Error::Cancelled`].
pub fn compare_watched(
    image: &Image,
    reference: &Image,
    edges: Option<&[bool]>,
    progress: &dyn Progress,
) -> Result<Comparison> {
    check(image, reference, edges)?;
    progress.stage("comparing", (STEPS_A_ROW * image.height) as u64);
    let relative_l2_no_edges = edges
        .filter(|edges| edges.contains(&false))
        .map(|edges| relative_l2_where(image, reference, |pixel| !edges[pixel]));
    let shown = |image: &Image| -> Vec<Vec3> {
        image.pixels.iter().map(|&color| encode(color, 0.0, Tonemap::Neutral)).collect()
    };
    let (shown, shown_reference) = (shown(image), shown(reference));
    let errors = flip_watched(&shown_reference, &shown, image.width, PIXELS_PER_DEGREE, progress)?;
    Ok(Comparison {
        relative_l2: relative_l2_where(image, reference, |_| true),
        relative_l2_no_edges,
        psnr: psnr(&shown, &shown_reference),
        flip: errors.iter().map(|&error| f64::from(error)).sum::<f64>() / errors.len() as f64,
    })
}

/// [`Comparison::relative_l2`] alone.
///
/// # Errors
/// As [`compare`].
pub fn relative_l2(image: &Image, reference: &Image) -> Result<f64> {
    check(image, reference, None)?;
    Ok(relative_l2_where(image, reference, |_| true))
}

fn relative_l2_where(image: &Image, reference: &Image, counts: impl Fn(usize) -> bool) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (pixel, (color, truth)) in image.pixels.iter().zip(&reference.pixels).enumerate() {
        if counts(pixel) {
            error += (color.as_dvec3() - truth.as_dvec3()).length_squared();
            norm += truth.as_dvec3().length_squared();
        }
    }
    if error == 0.0 { 0.0 } else { (error / norm).sqrt() }
}

fn psnr(shown: &[Vec3], reference: &[Vec3]) -> f64 {
    let squares = shown.iter().zip(reference).map(|(a, b)| (a.as_dvec3() - b.as_dvec3()).length_squared());
    let mean = squares.sum::<f64>() / (3 * shown.len()) as f64;
    -10.0 * mean.log10()
}

fn check(image: &Image, reference: &Image, edges: Option<&[bool]>) -> Result<()> {
    let size = |image: &Image| (image.width, image.height);
    if size(image) != size(reference) {
        return Err(Error::Setting(format!(
            "the image is {}x{} and the reference {}x{}; compare images of one size",
            image.width, image.height, reference.width, reference.height
        )));
    }
    for (image, which) in [(image, "image"), (reference, "reference")] {
        if image.pixels.is_empty() || image.width.checked_mul(image.height) != Some(image.pixels.len()) {
            return Err(Error::Setting(format!(
                "the {which} has {} pixels for a size of {}x{}",
                image.pixels.len(),
                image.width,
                image.height
            )));
        }
        if let Some(pixel) = image.pixels.iter().position(|color| !color.is_finite()) {
            let color = image.pixels[pixel];
            return Err(Error::Setting(format!(
                "the {which} has ({}, {}, {}) at column {}, row {} (counted from 0 at the top left); every value must be finite",
                color.x,
                color.y,
                color.z,
                pixel % image.width,
                pixel / image.width
            )));
        }
    }
    match edges {
        Some(edges) if edges.len() != image.pixels.len() => Err(Error::Setting(format!(
            "{} edge marks for {} pixels; they belong to an image of another size",
            edges.len(),
            image.pixels.len()
        ))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    fn image(width: usize, height: usize, color: impl Fn(usize, usize) -> Vec3) -> Image {
        let pixels = (0..width * height).map(|i| color(i % width, i / width)).collect();
        Image { width, height, pixels }
    }

    fn ramp() -> Image {
        image(16, 12, |x, y| Vec3::new(x as f32 / 15.0, 0.4, y as f32 / 11.0))
    }

    #[test]
    fn equal_images_have_no_error() {
        let figures = compare(&ramp(), &ramp(), Some(&[false; 192])).unwrap();
        assert_eq!((figures.relative_l2, figures.relative_l2_no_edges, figures.flip), (0.0, Some(0.0), 0.0));
        assert_eq!(figures.psnr, f64::INFINITY);
    }

    /// Asks to stop once `most` steps are done.
    #[derive(Default)]
    struct Counted {
        most: u64,
        steps: AtomicU64,
        done: AtomicU64,
    }

    impl Progress for Counted {
        fn stage(&self, _: &str, steps: u64) {
            self.steps.fetch_add(steps, Ordering::Relaxed);
        }

        fn advance(&self, steps: u64) {
            self.done.fetch_add(steps, Ordering::Relaxed);
        }

        fn cancelled(&self) -> bool {
            self.done.load(Ordering::Relaxed) >= self.most
        }
    }

    #[test]
    fn a_watched_comparison_tells_every_step_and_can_be_stopped() {
        let other = image(16, 12, |x, y| ramp().pixels[y * 16 + x] * 0.7);
        let listener = Counted { most: u64::MAX, ..Counted::default() };
        let watched = compare_watched(&other, &ramp(), None, &listener).unwrap();
        assert_eq!(watched, compare(&other, &ramp(), None).unwrap());
        assert_eq!(listener.steps.into_inner(), 8 * 12);
        assert_eq!(listener.done.into_inner(), 8 * 12);
        for most in [0, 20, 90] {
            let listener = Counted { most, ..Counted::default() };
            let stopped = compare_watched(&other, &ramp(), None, &listener);
            assert!(matches!(stopped, Err(Error::Cancelled)), "{most}: {stopped:?}");
        }
    }

    #[test]
    fn relative_l2_is_the_quotient_of_norms() {
        // Ten per cent off everywhere is ten per cent; one pixel (3, 0, 4) against norm 2 * sqrt(192 * 3) is
        // 5 / 48.
        let scaled = image(16, 12, |x, y| ramp().pixels[y * 16 + x] * 1.1);
        assert!((relative_l2(&scaled, &ramp()).unwrap() - 0.1).abs() < 1e-6);
        let flat = image(16, 12, |_, _| Vec3::splat(2.0));
        let mut spot = flat.clone();
        spot.pixels[7] += Vec3::new(3.0, 0.0, 4.0);
        assert!((relative_l2(&spot, &flat).unwrap() - 5.0 / 48.0).abs() < 1e-9);
        assert!(
            (relative_l2(&flat, &spot).unwrap() - 5.0 / 48.0).abs() > 1e-4,
            "the norm is the reference's"
        );
    }

    #[test]
    fn edges_are_left_out_of_the_second_figure_alone() {
        let flat = image(16, 12, |_, _| Vec3::ONE);
        let mut wrong = flat.clone();
        let mut edges = vec![false; 192];
        wrong.pixels[5] = Vec3::ZERO;
        edges[5] = true;
        let figures = compare(&wrong, &flat, Some(&edges)).unwrap();
        assert!(figures.relative_l2 > 0.05);
        assert_eq!(figures.relative_l2_no_edges, Some(0.0));
        assert_eq!(compare(&wrong, &flat, Some(&[true; 192])).unwrap().relative_l2_no_edges, None);
        assert_eq!(compare(&wrong, &flat, None).unwrap().relative_l2_no_edges, None);
    }

    #[test]
    fn psnr_is_that_of_the_display_images() {
        // Display values of linear 0.5 and 0.3 grey, by hand: neutral takes 0.04 away, then sRGB.
        let srgb = |linear: f64| 1.055 * linear.powf(1.0 / 2.4) - 0.055;
        let expected = -20.0 * (srgb(0.46) - srgb(0.26)).abs().log10();
        let [a, b] = [0.5, 0.3].map(|grey| image(16, 12, |_, _| Vec3::splat(grey)));
        assert!((compare(&a, &b, None).unwrap().psnr - expected).abs() < 1e-3);
    }

    #[test]
    fn a_black_reference_has_the_documented_error() {
        let black = image(4, 4, |_, _| Vec3::ZERO);
        let grey = image(4, 4, |_, _| Vec3::splat(0.1));
        assert_eq!(relative_l2(&black, &black).unwrap(), 0.0);
        assert_eq!(relative_l2(&grey, &black).unwrap(), f64::INFINITY);
    }

    #[test]
    fn what_cannot_be_compared_is_told() {
        let told = |image: &Image, reference: &Image, edges: Option<&[bool]>| {
            compare(image, reference, edges).unwrap_err().to_string()
        };
        let other = image(8, 24, |_, _| Vec3::ONE);
        assert!(told(&other, &ramp(), None).contains("the image is 8x24 and the reference 16x12"));
        let mut broken = ramp();
        broken.pixels[3 * 16 + 5].y = f32::NAN;
        assert!(
            told(&ramp(), &broken, None)
                .contains("the reference has (0.33333334, NaN, 0.27272728) at column 5, row 3")
        );
        assert!(told(&broken, &ramp(), None).starts_with("the image has"));
        assert!(told(&ramp(), &ramp(), Some(&[true])).contains("1 edge marks for 192 pixels"));
        assert!(told(&Image::default(), &Image::default(), None).contains("0 pixels"));
    }
}
