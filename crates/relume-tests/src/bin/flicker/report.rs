//! What is reported: `flicker.json`, and its table.

use relume::Result;
use relume::image::Image;
use relume::transfer::Quality;
use relume_tests::command_line::name_of;
use relume_tests::reports::table;
use relume_tests::truth::{Truth, median_and_worst, unbiased_relative_l2};
use serde::Serialize;

use crate::figures::{self, Spread, error_squares, largest_pixel, rms_uncertainty, root, squares};

/// A run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// Of Relume.
    pub(crate) version: &'static str,
    /// Without folder and ending.
    pub(crate) scene: String,
    /// Pixels: width and height.
    pub(crate) size: (usize, usize),
    pub(crate) gather_samples: usize,
    pub(crate) quality: Quality,
    /// From each pixel, in either set of the exact transfer.
    pub(crate) rays: u32,
    pub(crate) seed: u32,
    /// Rigs with the spot where it begins and where it ends.
    pub(crate) rigs: [String; 2],
    /// Of the exact transfer's root mean square.
    pub(crate) exact_uncertainty: f64,
    /// Steps after which the exact transfer's second difference is lost in its grain.
    pub(crate) lost_in_grain: usize,
    /// The exact transfer, one set of its rays with the grain it has, then the engine.
    pub(crate) rows: Vec<Row>,
}

/// A sequence of images, by one way to make them.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) label: String,
    /// Relative second difference after each step but the last; 0 where it is lost in grain.
    pub(crate) second_differences: Vec<f64>,
    pub(crate) spread: Spread,
    /// Of the difference from the exact transfer's images, relative to these; grain taken out.
    pub(crate) of_error: Option<Spread>,
    /// As multiples of the exact transfer's.
    pub(crate) over_exact: Option<Spread>,
    /// See [`largest_pixel`].
    pub(crate) largest_pixel: f64,
    /// Relative L2 error of the images against the exact ones, whose grain is taken out: median and worst.
    pub(crate) error: Option<(f64, f64)>,
    /// Shadow rays on the cloud, an image.
    pub(crate) shadow_rays: Option<f64>,
}

/// The exact transfer's images, from two independent sets of rays.
pub(crate) struct Exact {
    truths: Vec<Truth>,
    halves: [Vec<Image>; 2],
    spread: Spread,
}

impl Row {
    fn new(label: &str, squares: &[f64], largest_pixel: f64) -> Self {
        Self {
            label: label.to_owned(),
            second_differences: squares.iter().map(|&square| root(square)).collect(),
            spread: Spread::of_squares(squares),
            of_error: None,
            over_exact: None,
            largest_pixel,
            error: None,
            shadow_rays: None,
        }
    }
}

impl Exact {
    /// From the images of both sets.
    pub(crate) fn new(halves: [Vec<Image>; 2]) -> Self {
        let [a, b] = &halves;
        let truth = |(a, b): (&Image, &Image)| Truth { halves: [a.clone(), b.clone()] };
        Self {
            truths: a.iter().zip(b).map(truth).collect(),
            spread: Spread::of_squares(&squares(a, b)),
            halves,
        }
    }

    /// The first image that light does not reach.
    pub(crate) fn first_black(&self) -> Option<usize> {
        self.halves.iter().filter_map(|images| images.iter().position(is_black)).min()
    }

    /// The exact transfer's own row, that of one set with its grain, and after how many steps the former is lost in the latter.
    pub(crate) fn rows(&self) -> ([Row; 2], usize) {
        let [a, b] = &self.halves;
        let exact = squares(a, b);
        let lost = exact.iter().filter(|square| **square <= 0.0).count();
        let grainy: Vec<f64> = squares(a, a).iter().zip(squares(b, b)).map(|(a, b)| 0.5 * (a + b)).collect();
        let mut with_grain = Row::new("exact, one set with its grain", &grainy, largest_pixel(a));
        with_grain.over_exact = with_grain.spread.over(&self.spread);
        ([Row::new("exact", &exact, largest_pixel(&figures::mean(a, b))), with_grain], lost)
    }

    /// See [`rms_uncertainty`].
    pub(crate) fn uncertainty(&self) -> f64 {
        let [a, b] = &self.halves;
        rms_uncertainty(a, b)
    }

    /// The row of relit images.
    pub(crate) fn judge(&self, label: &str, images: &[Image], shadow_rays: f64) -> Row {
        let row = Row::new(label, &squares(images, images), largest_pixel(images));
        let errors = images.iter().zip(&self.truths).map(|(image, truth)| unbiased_relative_l2(image, truth));
        Row {
            of_error: Some(Spread::of_squares(&error_squares(images, &self.halves))),
            over_exact: row.spread.over(&self.spread),
            error: Some(median_and_worst(&errors.collect::<Vec<_>>())),
            shadow_rays: Some(shadow_rays),
            ..row
        }
    }
}

fn is_black(image: &Image) -> bool {
    image.pixels.iter().all(|pixel| pixel.max_element() <= 0.0)
}

impl Report {
    /// `flicker.md`.
    pub(crate) fn page(&self, command: &str) -> String {
        let (width, height) = self.size;
        let steps = self.rows.first().map_or(0, |row| row.second_differences.len() + 1);
        format!(
            "# Flicker\n\n    {command}\n\n{}, {width}x{height}, {} gather samples, quality {}, {steps} steps. Indirect light of one bounce, \
             without reflections. The second difference over time of the image, root mean square over pixels, linear RGB, relative to the \
             image's own, in percent. *Exact* is the product of two independent sets of {} rays from each pixel, which is free of their grain \
             on average; its rms is uncertain by {} for want of more rays, and after {} of the steps it is lost in the grain and counts as 0. *Of the error* is the same of the \
             difference between relit and exact images: what moves and should not, or should and does not. Errors of images are relative L2; \
             in both the grain is taken out.\n\n{}\n![second difference by step](flicker.svg)\n",
            self.scene,
            self.gather_samples,
            name_of(&self.quality),
            self.rays,
            percent(self.exact_uncertainty),
            self.lost_in_grain,
            self.table()
        )
    }

    /// A line for each row.
    pub(crate) fn table(&self) -> String {
        let cells = |row: &Row| {
            let Spread { median, worst, rms } = row.spread;
            let multiple = |of: fn(&Spread) -> f64| {
                row.over_exact.as_ref().map_or_else(|| "-".to_owned(), |over| format!("{:.2}", of(over)))
            };
            let of_error = |of: fn(&Spread) -> f64| {
                row.of_error.as_ref().map_or_else(|| "-".to_owned(), |spread| percent(of(spread)))
            };
            let error = |of: fn((f64, f64)) -> f64| {
                row.error.map_or_else(|| "-".to_owned(), |error| format!("{:.1}", 100.0 * of(error)))
            };
            vec![
                row.label.clone(),
                percent(median),
                percent(worst),
                percent(rms),
                multiple(|over| over.median),
                multiple(|over| over.worst),
                multiple(|over| over.rms),
                of_error(|spread| spread.median),
                of_error(|spread| spread.worst),
                of_error(|spread| spread.rms),
                format!("{:.1}", 100.0 * row.largest_pixel),
                error(|(median, _)| median),
                error(|(_, worst)| worst),
                row.shadow_rays.map_or_else(|| "-".to_owned(), |rays| format!("{rays:.0}")),
            ]
        };
        let header = [
            "transfer",
            "second difference: median",
            "worst",
            "rms",
            "over exact: median",
            "worst",
            "rms",
            "of the error: median",
            "worst",
            "rms",
            "largest of a pixel",
            "error of the images: median",
            "worst",
            "shadow rays an image",
        ];
        table(&header, &self.rows.iter().map(cells).collect::<Vec<_>>())
    }

    /// `flicker.json`.
    ///
    /// # Errors
    /// None that are known.
    pub(crate) fn json(&self) -> Result<String> {
        serde_json::to_string_pretty(self)
            .map_err(|error| relume::Error::io("flicker.json", "write", std::io::Error::other(error)))
    }
}

fn percent(value: f64) -> String {
    format!("{:.3}", 100.0 * value)
}
