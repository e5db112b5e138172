//! The FLIP difference of two display images: how visible their difference is when one is flipped to the
//! other.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Moller, M. Oskarsson, K. Astrom and M. D. Fairchild, "FLIP: A
//! Difference Evaluator for Alternating Images", HPG 2020. Every filter of the paper is separable (or a sum
//! of two that are), so rows and columns are filtered one after the other; the four lanes of a `Vec4` carry
//! the filters that share a pass.

use glam::{DMat3, Mat3, Vec3, Vec4};
use rayon::prelude::*;

use super::display::linear_from_srgb;
use crate::{Error, Progress, Result};

/// Pixels per degree of visual angle: a 0.7 m wide display of 3840 pixels seen from 0.7 m, the paper's
/// default.
pub const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// Linear sRGB to CIE XYZ, by columns (IEC 61966-2-1 primaries and white).
const XYZ_FROM_RGB: DMat3 = DMat3::from_cols_array(&[
    0.412_386_56,
    0.212_636_82,
    0.019_330_62, // red
    0.357_591_49,
    0.715_182_98,
    0.119_197_16, // green
    0.180_450_49,
    0.072_180_2,
    0.950_372_59, // blue
]);

/// The FLIP error of each pixel, `0` (no visible difference) to `1`, row by row.
///
/// `reference` and `test` are sRGB-encoded, `0..=1`, `width` pixels a row, and of one length, a multiple of `width`.
/// A larger `pixels_per_degree` (a display farther away) makes fine differences less visible.
///
/// # Panics
/// Where the images differ in length or are no whole number of rows; [`super::compare`] checks its images first.
pub fn flip(reference: &[Vec3], test: &[Vec3], width: usize, pixels_per_degree: f32) -> Vec<f32> {
    // nobody asks to stop
    flip_watched(reference, test, width, pixels_per_degree, &()).unwrap_or_default()
}

/// Steps of [`flip_watched`] a row of pixels: two images go through two pairs of filters, along rows and along columns.
pub(super) const STEPS_A_ROW: usize = 8;

/// The same, with `progress` told of every row that is filtered, [`STEPS_A_ROW`] times each, and asked whether to stop.
///
/// # Errors
/// [`Error::Cancelled`].
///
/// # Panics
/// As [`flip`].
pub(super) fn flip_watched(
    reference: &[Vec3],
    test: &[Vec3],
    width: usize,
    pixels_per_degree: f32,
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    assert!(reference.len() == test.len() && (width == 0 || reference.len().is_multiple_of(width)));
    if reference.is_empty() {
        return Ok(Vec::new());
    }
    let colors = Colors::new();
    let seen = |image| Seen::new(image, width, pixels_per_degree, &colors, progress);
    let (reference, test) = (seen(reference)?, seen(test)?);
    let largest = colors.largest_difference();
    let pixels =
        reference.lab.par_iter().zip(&test.lab).zip(reference.features.par_iter().zip(&test.features));
    Ok(pixels
        .map(|((&lab_reference, &lab_test), (features_reference, features_test))| {
            let color = color_difference(lab_reference, lab_test, largest);
            let feature = feature_difference(features_reference, features_test);
            color.powf(1.0 - feature)
        })
        .collect())
}

/// Section 4.1.3: HyAB, compressed, and mapped to `0..=1` so that large differences share the last 5%.
fn color_difference(a: Vec3, b: Vec3, largest: f32) -> f32 {
    /// The share of the largest difference that is mapped linearly, and where it ends.
    const LINEAR: [f32; 2] = [0.4, 0.95];
    let [share, end] = LINEAR;
    let difference = compressed_hyab(a, b);
    let knee = share * largest;
    if difference < knee {
        difference * end / knee
    } else {
        end + (difference - knee) / (largest - knee) * (1.0 - end)
    }
}

/// Section 4.2: the larger of the differences in edge and point contrast.
fn feature_difference(a: &[f32; 2], b: &[f32; 2]) -> f32 {
    let difference = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    (difference * std::f32::consts::FRAC_1_SQRT_2).sqrt().min(1.0)
}

/// The HyAB distance (equation 2) to the power 0.7.
fn compressed_hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    (d.x.abs() + d.y.hypot(d.z)).powf(0.7)
}

/// The colour spaces of the pipeline, all by way of XYZ relative to the white of sRGB.
struct Colors {
    relative_xyz_from_rgb: Mat3,
    rgb_from_relative_xyz: Mat3,
}

impl Colors {
    fn new() -> Self {
        let white = XYZ_FROM_RGB * glam::DVec3::ONE;
        let relative = DMat3::from_diagonal(white.recip()) * XYZ_FROM_RGB;
        Self {
            relative_xyz_from_rgb: relative.as_mat3(),
            rgb_from_relative_xyz: relative.inverse().as_mat3(),
        }
    }

    /// The linearised CIELab of section 4.1.1: lightness, red-green, blue-yellow.
    fn opponent_from_srgb(&self, srgb: Vec3) -> Vec3 {
        let xyz = self.relative_xyz_from_rgb * Vec3::from_array(srgb.to_array().map(linear_from_srgb));
        Vec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
    }

    fn rgb_from_opponent(&self, opponent: Vec3) -> Vec3 {
        let y = (opponent.x + 16.0) / 116.0;
        self.rgb_from_relative_xyz * Vec3::new(y + opponent.y / 500.0, y, y - opponent.z / 200.0)
    }

    /// CIELab with chroma scaled by lightness for the Hunt effect (section 4.1.2).
    fn hunt_lab_from_rgb(&self, linear: Vec3) -> Vec3 {
        const DELTA: f32 = 6.0 / 29.0;
        let f = |t: f32| {
            if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let [x, y, z] = (self.relative_xyz_from_rgb * linear).to_array().map(f);
        let lightness = 116.0 * y - 16.0;
        let hunt = 0.01 * lightness;
        Vec3::new(lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z))
    }

    /// The largest difference two colours can have: green against blue.
    fn largest_difference(&self) -> f32 {
        compressed_hyab(self.hunt_lab_from_rgb(Vec3::Y), self.hunt_lab_from_rgb(Vec3::Z))
    }
}

/// One image as the eye takes it in.
struct Seen {
    /// Hunt-adjusted CIELab after the contrast sensitivity filter.
    lab: Vec<Vec3>,
    /// Strength of edges and of points.
    features: Vec<[f32; 2]>,
}

impl Seen {
    fn new(
        srgb: &[Vec3],
        width: usize,
        pixels_per_degree: f32,
        colors: &Colors,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let opponent: Vec<Vec3> = srgb.par_iter().map(|&pixel| colors.opponent_from_srgb(pixel)).collect();
        // Blue-yellow is filtered by two Gaussians, so it takes two lanes.
        let lanes: Vec<Vec4> = opponent.iter().map(|c| c.extend(c.z)).collect();
        let [rows, columns] = contrast_sensitivity(pixels_per_degree);
        let lab = separable(&lanes, width, &rows, &columns, progress)?
            .par_iter()
            .map(|c| {
                let filtered = Vec3::new(c.x, c.y, c.z + c.w);
                let rgb = colors.rgb_from_opponent(filtered).clamp(Vec3::ZERO, Vec3::ONE);
                colors.hunt_lab_from_rgb(rgb)
            })
            .collect();
        // Lightness in 0..=1.
        let lanes: Vec<Vec4> = opponent.iter().map(|c| Vec4::splat((c.x + 16.0) / 116.0)).collect();
        let [rows, columns] = feature_filters(pixels_per_degree);
        let features = separable(&lanes, width, &rows, &columns, progress)?
            .par_iter()
            .map(|c| [c.x.hypot(c.z), c.y.hypot(c.w)])
            .collect();
        Ok(Self { lab, features })
    }
}

/// The contrast sensitivity filters of section 4.1.1, along rows and along columns. Lanes: lightness,
/// red-green, and the two Gaussians of blue-yellow. The paper writes each as `a sqrt(pi / b) exp(-pi^2 d^2 /
/// b)`, with `d` in degrees, and scales each channel's filter to a sum of 1.
fn contrast_sensitivity(pixels_per_degree: f32) -> [Vec<Vec4>; 2] {
    const B: Vec4 = Vec4::new(0.0047, 0.0053, 0.04, 0.025);
    const BLUE_YELLOW_A: [f32; 2] = [34.1, 13.5];
    let pi = std::f32::consts::PI;
    // Three standard deviations of the widest.
    let radius = (3.0 * (0.04 / (2.0 * pi * pi)).sqrt() * pixels_per_degree).ceil() as i32;
    let taps = |weight: Vec4| -> Vec<Vec4> {
        let gaussian = |offset: i32| {
            let degrees = offset as f32 / pixels_per_degree;
            Vec4::from_array((-pi * pi * degrees * degrees / B).to_array().map(f32::exp))
        };
        let sum: Vec4 = (-radius..=radius).map(gaussian).sum();
        (-radius..=radius).map(|offset| gaussian(offset) / sum * weight).collect()
    };
    // Weight of a Gaussian within its filter: its share of the filter's sum over all taps.
    let sum_1d: Vec4 = taps(Vec4::ONE).get(radius as usize).map_or(Vec4::ONE, |centre| centre.recip());
    let total = |a: f32, b: f32, sum: f32| a * (pi / b).sqrt() * sum * sum;
    let wide = total(BLUE_YELLOW_A[0], B.z, sum_1d.z);
    let narrow = total(BLUE_YELLOW_A[1], B.w, sum_1d.w);
    let share = wide / (wide + narrow);
    [taps(Vec4::ONE), taps(Vec4::new(1.0, 1.0, share, 1.0 - share))]
}

/// The edge and point detectors of section 4.2, along rows and along columns: first and second derivatives of
/// a Gaussian whose width matches human contrast sensitivity, positive and negative weights each scaled to a
/// sum of one. Lanes: edges along y, points along y, edges along x, points along x.
fn feature_filters(pixels_per_degree: f32) -> [Vec<Vec4>; 2] {
    /// Degrees between peak and trough of a feature the eye sees best.
    const FEATURE_WIDTH: f32 = 0.082;
    let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i32;
    let shape = |offset: i32| {
        let x = offset as f32 / deviation;
        let gaussian = (-0.5 * x * x).exp();
        Vec3::new(gaussian, -x * gaussian, (x * x - 1.0) * gaussian)
    };
    let positive: Vec3 = (-radius..=radius).map(|offset| shape(offset).max(Vec3::ZERO)).sum();
    let negative: Vec3 = (-radius..=radius).map(|offset| (-shape(offset)).max(Vec3::ZERO)).sum();
    let scaled = |value: f32, lane: usize| value / if value < 0.0 { negative[lane] } else { positive[lane] };
    let taps: Vec<[f32; 3]> = (-radius..=radius)
        .map(|offset| {
            let [smooth, edge, point] = shape(offset).to_array();
            [scaled(smooth, 0), scaled(edge, 1), scaled(point, 2)]
        })
        .collect();
    let rows = taps.iter().map(|&[smooth, edge, point]| Vec4::new(smooth, smooth, edge, point)).collect();
    let columns = taps.iter().map(|&[smooth, edge, point]| Vec4::new(edge, point, smooth, smooth)).collect();
    [rows, columns]
}

/// Filters each lane along rows, then along columns. Beyond the border the border's pixels go on. Each row is two steps.
fn separable(
    image: &[Vec4],
    width: usize,
    rows: &[Vec4],
    columns: &[Vec4],
    progress: &dyn Progress,
) -> Result<Vec<Vec4>> {
    let height = image.len() / width;
    let mut along_rows = vec![Vec4::ZERO; image.len()];
    every_row(&mut along_rows, width, progress, |y, x| {
        let line = &image[y * width..][..width];
        weighted(rows, x, width, |x| line[x])
    })?;
    let mut along_columns = vec![Vec4::ZERO; image.len()];
    every_row(&mut along_columns, width, progress, |y, x| {
        weighted(columns, y, height, |y| along_rows[y * width + x])
    })?;
    Ok(along_columns)
}

/// Fills rows of pixels with the values `at` each row and column.
fn every_row(
    pixels: &mut [Vec4],
    width: usize,
    progress: &dyn Progress,
    at: impl Fn(usize, usize) -> Vec4 + Sync,
) -> Result<()> {
    pixels.par_chunks_mut(width).enumerate().try_for_each(|(y, row)| {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        for (x, pixel) in row.iter_mut().enumerate() {
            *pixel = at(y, x);
        }
        progress.advance(1);
        Ok(())
    })
}

fn weighted(taps: &[Vec4], centre: usize, size: usize, at: impl Fn(usize) -> Vec4) -> Vec4 {
    let radius = taps.len() / 2;
    let clamped = |tap: usize| (centre + tap).saturating_sub(radius).min(size - 1);
    taps.iter().enumerate().map(|(tap, &weight)| weight * at(clamped(tap))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_at(reference: &[Vec3], test: &[Vec3], width: usize, pixels_per_degree: f32) -> f64 {
        let map = flip(reference, test, width, pixels_per_degree);
        map.iter().map(|&error| f64::from(error)).sum::<f64>() / map.len() as f64
    }

    fn mean(reference: &[Vec3], test: &[Vec3], width: usize) -> f64 {
        mean_at(reference, test, width, PIXELS_PER_DEGREE)
    }

    /// A pattern that anything can make again: smooth ramps with a checkerboard of 5 x 3 pixels.
    fn pattern(width: usize, height: usize) -> Vec<Vec3> {
        (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let checker = ((x / 5 + y / 3) % 2) as f32;
                let (u, v) = (x as f32 / (width - 1) as f32, y as f32 / (height - 1) as f32);
                Vec3::new(u, 0.25 + 0.5 * checker, v)
            })
            .collect()
    }

    #[test]
    fn identical_images_do_not_differ() {
        let image = pattern(40, 24);
        assert!(flip(&image, &image, 40, PIXELS_PER_DEGREE).iter().all(|&error| error == 0.0));
    }

    #[test]
    fn the_ends_of_the_scale_are_where_the_paper_puts_them() {
        let flat = |color: Vec3| vec![color; 30 * 20];
        // The largest difference of all is 1; black against white lies in the last 5%.
        assert!((mean(&flat(Vec3::Y), &flat(Vec3::Z), 30) - 1.0).abs() < 1e-4);
        let black_white = mean(&flat(Vec3::ZERO), &flat(Vec3::ONE), 30);
        assert!((0.95..0.999).contains(&black_white), "{black_white}");
    }

    #[test]
    fn is_symmetric_and_sees_a_change_of_one_channel() {
        let image = pattern(40, 24);
        for channel in 0..3 {
            let mut changed = image.clone();
            for pixel in &mut changed {
                pixel[channel] = (pixel[channel] + 0.1).min(1.0);
            }
            let there = mean(&image, &changed, 40);
            let back = mean(&changed, &image, 40);
            assert!(there > 0.01, "channel {channel}: {there}");
            assert!((there - back).abs() < 1e-5, "channel {channel}: {there} and {back}");
        }
    }

    #[test]
    fn filters_keep_constant_images() {
        let [rows, columns] = contrast_sensitivity(PIXELS_PER_DEGREE);
        assert_eq!(rows.len(), 21);
        assert!((rows.iter().sum::<Vec4>() - Vec4::ONE).abs().max_element() < 1e-5);
        let total = columns.iter().sum::<Vec4>();
        assert!((total.z + total.w - 1.0).abs() < 1e-5);
        let [rows, columns] = feature_filters(PIXELS_PER_DEGREE);
        assert_eq!(rows.len(), 19);
        let flat = separable(&[Vec4::ONE; 60], 10, &rows, &columns, &()).unwrap();
        assert!(flat.iter().all(|lanes| lanes.abs().max_element() < 1e-5));
    }
    /// The figures of the authors' own implementation (flip-evaluator 1.7 from PyPI, 67 pixels per degree).
    #[test]
    fn agrees_with_the_published_implementation() {
        let (width, height) = (96, 64);
        let reference = pattern(width, height);
        let rolled: Vec<Vec3> = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                reference[(y + height - 1) % height * width + (x + width - 2) % width]
            })
            .collect();
        let tinted: Vec<Vec3> =
            reference.iter().map(|&c| (c * Vec3::new(1.1, 1.0, 0.9)).min(Vec3::ONE)).collect();
        let flat = |color: Vec3| vec![color; width * height];
        let cases = [
            ("rolled", reference.clone(), rolled, 0.453_391),
            ("tinted", reference, tinted, 0.232_810),
            ("black and white", flat(Vec3::ZERO), flat(Vec3::ONE), 0.967_387),
            ("a shade of red", flat(Vec3::splat(0.5)), flat(Vec3::new(0.6, 0.5, 0.5)), 0.249_648),
        ];
        for (name, reference, test, published) in cases {
            let mean = mean_at(&reference, &test, width, 67.0);
            assert!((mean - published).abs() < 1e-5, "{name}: {mean} instead of {published}");
            if name == "rolled" {
                assert!((mean_at(&reference, &test, width, 60.0) - published).abs() > 1e-3);
            }
        }
    }
}
