//! The worker that makes of light what a display is sent: exposure, tone curve, false colours, histogram.

use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{Color32, ColorImage};
use rayon::prelude::*;
use relume::glam::Vec3;
use relume::image::display::Encoder;
use relume::image::{Image, Tonemap};

use crate::lighting::Frame;
use crate::view::{Pixels, Scale, Source, View};
use crate::worker::{Desk, Worker};

/// Rec. 709.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);
/// What is neither bright nor dark.
const MIDDLE_GREY: f32 = 0.18;
/// Pixels that one task develops.
const CHUNK: usize = 4096;

/// What of a frame is shown, and how.
#[derive(Clone)]
pub(crate) struct Recipe {
    /// What fills the picture, or is left of a wipe.
    pub(crate) left: View,
    /// What a wipe shows beside it.
    pub(crate) right: Option<View>,
    /// Stops.
    pub(crate) exposure: f32,
    pub(crate) curve: Tonemap,
    /// The path-traced image, once there is one.
    pub(crate) truth: Option<Arc<Image>>,
    /// Stored images, with their numbers.
    pub(crate) snapshots: Vec<(u64, Arc<Image>)>,
}

impl PartialEq for Recipe {
    fn eq(&self, other: &Self) -> bool {
        let look = |recipe: &Self| (recipe.left.clone(), recipe.right.clone(), recipe.exposure, recipe.curve);
        let truth = |recipe: &Self| recipe.truth.as_ref().map(Arc::as_ptr);
        let numbers = |recipe: &Self| recipe.snapshots.iter().map(|(number, _)| *number).collect::<Vec<_>>();
        look(self) == look(other) && truth(self) == truth(other) && numbers(self) == numbers(other)
    }
}

/// A frame to develop.
pub(crate) struct Negative {
    pub(crate) number: u64,
    pub(crate) frame: Arc<Frame>,
    pub(crate) recipe: Recipe,
}

/// What came of it.
pub(crate) struct Print {
    pub(crate) left: Arc<ColorImage>,
    pub(crate) right: Option<Arc<ColorImage>>,
    /// Of the left one.
    pub(crate) histogram: Histogram,
    /// What developing took.
    pub(crate) took: Duration,
}

/// The worker.
pub(crate) type Developer = Worker<Negative, (u64, Print)>;

/// Starts it; `wake` is called whenever there is a print, which comes with the number of its negative.
pub(crate) fn start(wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<Developer> {
    Worker::start("developing", wake, |desk: &Desk<Negative, _>| {
        while let Some(Negative { number, frame, recipe }) = desk.take() {
            desk.tell((number, recipe.print(&frame)));
        }
    })
}

impl Recipe {
    /// Develops a frame.
    pub(crate) fn print(&self, frame: &Arc<Frame>) -> Print {
        let began = Instant::now();
        let size = [frame.layers.direct.width, frame.layers.direct.height];
        let developed = |view: &View| {
            let source = self.source(view, frame);
            let pixels = source.as_ref().and_then(|source| Some((source.light.pixels()?, source.scale)));
            // what is not there is black, and its name says so
            let (pixels, scale) = pixels
                .unwrap_or_else(|| (Pixels::One(vec![Vec3::ZERO; size[0] * size[1]].into()), Scale::Plain));
            self.develop(&pixels, size, scale)
        };
        let (left, histogram) = developed(&self.left);
        let right = self.right.as_ref().map(|right| Arc::new(developed(right).0));
        Print { left: left.into(), right, histogram, took: began.elapsed() }
    }

    fn source(&self, view: &View, frame: &Arc<Frame>) -> Option<Source> {
        let stored = |number| {
            let found = self.snapshots.iter().find(|(known, _)| *known == number);
            found.map(|(_, image)| Arc::clone(image))
        };
        view.source(frame, self.truth.as_ref(), stored)
    }

    /// What a display is sent of `pixels`, and how many are how bright.
    fn develop(&self, pixels: &Pixels<'_>, size: [usize; 2], scale: Scale) -> (ColorImage, Histogram) {
        let all = size[0] * size[1];
        let farthest = match scale {
            Scale::Distance => {
                let depths = (0..all).map(|index| pixels.at(index).x);
                depths.filter(|depth| depth.is_finite()).fold(0.0, f32::max)
            }
            _ => 0.0,
        };
        let encoder = Encoder::new(self.exposure, self.curve);
        let byte = |value: f32| (value * 255.0 + 0.5) as u8;
        let bytes = |encoded: Vec3| encoded.to_array().map(byte);
        let color = |pixel: Vec3| -> [u8; 3] {
            match scale {
                Scale::Exposed => encoder.bytes(pixel),
                Scale::Stops => bytes(color_of_stops(stops(pixel, self.exposure))),
                Scale::Plain => pixel.to_array().map(|linear| encoder.byte(linear)),
                Scale::Signed if pixel == Vec3::ZERO => [0; 3],
                Scale::Signed => bytes(0.5 * (pixel + 1.0)),
                Scale::Distance => bytes(Vec3::splat(nearness(pixel.x, farthest))),
            }
        };
        let exposure = if matches!(scale, Scale::Exposed | Scale::Stops) { self.exposure } else { 0.0 };
        let gain = exposure.exp2();
        let mut colors = vec![Color32::BLACK; all];
        let counts = colors.par_chunks_mut(CHUNK).enumerate().map(|(chunk, colors)| {
            let mut counts = Counts::default();
            for (place, to) in colors.iter_mut().enumerate() {
                let pixel = pixels.at(chunk * CHUNK + place);
                counts.add(pixel * gain);
                let [r, g, b] = color(pixel);
                *to = Color32::from_rgb(r, g, b);
            }
            counts
        });
        let counts = counts.reduce(Counts::default, Counts::plus);
        (ColorImage::new(size, colors), Histogram::new(&counts, all))
    }
}

/// Stops above middle grey; far below where there is no light at all.
pub(crate) fn stops(pixel: Vec3, exposure: f32) -> f32 {
    (pixel.dot(LUMINANCE).max(1e-12) / MIDDLE_GREY).log2() + exposure
}

/// 1 before the camera, a tenth at the farthest that is seen, 0 where nothing is.
fn nearness(depth: f32, farthest: f32) -> f32 {
    if depth.is_finite() { 1.0 - 0.9 * depth / farthest.max(f32::MIN_POSITIVE) } else { 0.0 }
}

/// The ends of the scale of false colours, stops from middle grey.
pub(crate) const STOPS: std::ops::RangeInclusive<i32> = -6..=6;

/// The colour of so many stops from middle grey, sRGB encoded: violet and blue below, grey in the middle, yellow and red above; a step each half stop, so that
/// steps can be counted.
pub(crate) fn color_of_stops(stops: f32) -> Vec3 {
    const COLORS: [Vec3; 7] = [
        Vec3::new(0.10, 0.02, 0.20),
        Vec3::new(0.20, 0.10, 0.65),
        Vec3::new(0.05, 0.55, 0.75),
        Vec3::new(0.50, 0.50, 0.50),
        Vec3::new(0.45, 0.75, 0.15),
        Vec3::new(1.00, 0.80, 0.10),
        Vec3::new(0.95, 0.15, 0.10),
    ];
    if stops > *STOPS.end() as f32 {
        return Vec3::ONE;
    }
    let place = ((2.0 * stops).round() / 2.0 - *STOPS.start() as f32) / 2.0;
    let place = place.clamp(0.0, (COLORS.len() - 1) as f32);
    let below = (place as usize).min(COLORS.len() - 2);
    COLORS[below].lerp(COLORS[below + 1], place - below as f32)
}

/// How many pixels are how bright: of each channel and of luminance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Histogram {
    /// Shares of all pixels, by channel (red, green, blue), from dark to bright, a bin a quarter stop.
    pub(crate) channels: [Vec<f32>; 3],
    /// Share of pixels above 1, which is where a display ends without a curve.
    pub(crate) clipped: f32,
}

impl Histogram {
    /// Stops from 1 at which the first bin begins and the last one ends.
    pub(crate) const RANGE: (f32, f32) = (-12.0, 4.0);
    const BINS: usize = 64;

    fn new(counts: &Counts, pixels: usize) -> Self {
        let share = |count: u32| count as f32 / pixels.max(1) as f32;
        Self { channels: counts.bins.map(|bins| bins.map(share).to_vec()), clipped: share(counts.clipped) }
    }

    /// The bin of a value: four times its log2, cut off, from its exponent and three comparisons.
    fn bin(value: f32) -> usize {
        /// A quarter of a stop above 1, two, and three.
        const QUARTERS: [f32; 3] = [1.189_207_1, std::f32::consts::SQRT_2, 1.681_792_8];
        let bits = value.max(1e-9).to_bits();
        let mantissa = f32::from_bits((bits & 0x007f_ffff) | 1.0_f32.to_bits());
        let quarter = QUARTERS.iter().filter(|&&quarter| mantissa >= quarter).count() as i32;
        let exponent = (bits >> 23) as i32 - 127;
        let place = 4 * (exponent - Self::RANGE.0 as i32) + quarter;
        place.clamp(0, Self::BINS as i32 - 1) as usize
    }
}

/// How many pixels are in each bin.
struct Counts {
    bins: [[u32; Histogram::BINS]; 3],
    clipped: u32,
}

impl Default for Counts {
    fn default() -> Self {
        Self { bins: [[0; Histogram::BINS]; 3], clipped: 0 }
    }
}

impl Counts {
    fn add(&mut self, exposed: Vec3) {
        self.clipped += u32::from(exposed.max_element() > 1.0);
        for (bins, value) in self.bins.iter_mut().zip(exposed.to_array()) {
            bins[Histogram::bin(value)] += 1;
        }
    }

    fn plus(mut self, other: Self) -> Self {
        for (bins, more) in self.bins.iter_mut().flatten().zip(other.bins.iter().flatten()) {
            *bins += more;
        }
        self.clipped += other.clipped;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipe(exposure: f32) -> Recipe {
        let (left, curve) = (View::Full, Tonemap::Srgb);
        Recipe { left, right: None, exposure, curve, truth: None, snapshots: Vec::new() }
    }

    fn developed(values: &[f32], scale: Scale, exposure: f32) -> (Vec<Color32>, Histogram) {
        let pixels = Pixels::One(values.iter().map(|&value| Vec3::splat(value)).collect());
        let (image, histogram) = recipe(exposure).develop(&pixels, [values.len(), 1], scale);
        (image.pixels, histogram)
    }

    fn print(values: &[f32], scale: Scale, exposure: f32) -> Vec<Color32> {
        developed(values, scale, exposure).0
    }

    #[test]
    fn exposure_is_in_stops() {
        assert_eq!(print(&[0.1, 0.4], Scale::Exposed, 1.0), print(&[0.2, 0.8], Scale::Exposed, 0.0));
        assert_eq!(print(&[0.18], Scale::Exposed, 0.0), [Color32::from_gray(118)]);
        // what is no light keeps its values
        assert_eq!(print(&[0.3], Scale::Plain, 3.0), print(&[0.3], Scale::Plain, 0.0));
    }

    #[test]
    fn false_colours_tell_stops_apart() {
        let colors = print(&[0.18, 0.18 * 1.05, 0.36, 0.09, 0.18 * 200.0, 0.0], Scale::Stops, 0.0);
        assert_eq!(colors[0], Color32::from_gray(128));
        assert_eq!(colors[1], colors[0], "a tenth of a stop is no step");
        assert!(colors[2] != colors[0] && colors[3] != colors[0] && colors[2] != colors[3]);
        assert_eq!(colors[4], Color32::WHITE, "beyond the scale");
        assert_eq!(print(&[0.09], Scale::Stops, 1.0), print(&[0.18], Scale::Stops, 0.0));
    }

    #[test]
    fn near_is_bright() {
        let colors = print(&[1.0, 5.0, 10.0, f32::INFINITY], Scale::Distance, 0.0);
        assert!(colors.is_sorted_by(|a, b| a.r() > b.r()));
        assert_eq!(colors[3], Color32::BLACK);
    }

    #[test]
    fn bins_are_quarters_of_a_stop() {
        for step in -300..200 {
            let stops = step as f32 / 16.0 + 0.03;
            let expected = ((stops + 12.0) * 4.0).clamp(0.0, 63.0) as usize;
            assert_eq!(Histogram::bin(stops.exp2()), expected, "{stops}");
        }
        assert_eq!([0.0, -1.0, f32::NAN].map(Histogram::bin), [0; 3]);
        assert_eq!(Histogram::bin(f32::INFINITY), 63);
    }

    #[test]
    fn histograms_count_all_pixels_once() {
        let (_, histogram) = developed(&[0.0, 0.5, 0.5, 2.0], Scale::Exposed, 0.0);
        for channel in &histogram.channels {
            assert!((channel.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert_eq!(channel[0], 0.25);
            assert!(channel.contains(&0.5));
        }
        assert_eq!(histogram.clipped, 0.25);
        assert_eq!(developed(&[0.6], Scale::Exposed, 1.0).1.clipped, 1.0);
    }
}
