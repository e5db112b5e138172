//! `relume compare`: how far an image is from its reference.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relume::glam::Vec3;
use relume::image::{Comparison, Image, Tonemap, compare_watched};
use relume::{Error, Progress, Result};
use relume_io::{ExrImage, read_exr, read_png, stored_number};
use serde::Serialize;

use crate::console::Console;
use crate::interrupt;
use crate::output::{check_output, ending, write_shown};
use crate::report::{Table, percent};

/// Compare an image with its reference: relative L2, the same without geometric edges, PSNR and FLIP.
///
/// Relative L2 is over scene-linear RGB. PSNR and FLIP are of the images as a display shows them: Khronos PBR Neutral
/// at exposure 0. Edges come from the layer `edges` of either EXR; without one their figure is `null`.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The image: .exr or .png.
    image: PathBuf,
    /// What it should be.
    reference: PathBuf,
    /// Which light to compare; the layers are read from EXR files.
    #[arg(long, value_enum, default_value_t)]
    layer: Layer,
    /// Also write a picture of the difference in brightness: red where the image is too bright, blue where it is too
    /// dark, at full strength where it is off by half of the reference's root mean square.
    #[arg(long, value_name = "OUT.png")]
    diff: Option<PathBuf>,
    /// Print one JSON object on stdout; a PSNR of `null` is infinite.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example:
  relume prepare assets/arcade.glb -o arcade.relume
  relume relight arcade.relume --rig assets/rigs/arcade.toml -o arcade.exr
  relume reference assets/arcade.glb --rig assets/rigs/arcade.toml -o truth.exr --spp 64
  relume compare arcade.exr truth.exr --layer indirect";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Layer {
    /// Direct and indirect.
    #[default]
    Full,
    /// Direct alone.
    Direct,
    /// Indirect alone.
    Indirect,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    image: &'a Path,
    reference: &'a Path,
    layer: Layer,
    #[serde(flatten)]
    comparison: Comparison,
    /// The reference's own relative L2 noise, where it is stored.
    reference_noise: Option<f64>,
    /// `relative_l2` without the reference's noise, where that is stored.
    relative_l2_less_noise: Option<f64>,
}

/// The relative L2 to what the reference would be without noise. The noise is independent of the image, so squares add
/// up: `e^2 = (E^2 + N^2) / |mean|^2` with `|mean|^2 = |truth|^2 + N^2`. 0 where the noise drowns the difference.
fn less_noise(error: f64, noise: f64) -> f64 {
    ((error * error - noise * noise) / (1.0 - noise * noise).max(1e-12)).max(0.0).sqrt()
}

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let (image_path, reference_path) = (&arguments.image, &arguments.reference);
    if let Some(diff) = &arguments.diff {
        check_output(diff, "the name of the difference", &["png"], &[image_path, reference_path])?;
    }
    if ending(image_path) != ending(reference_path) {
        console.warning(
            "one image is scene-linear and the other as a display shows it; compare two EXR files for figures that mean something",
        );
    }
    interrupt::listen()?;
    let progress = console.progress();
    progress.stage("reading the images", 2);
    let mut image = read(image_path)?;
    progress.advance(1);
    let mut reference = read(reference_path)?;
    let edges = reference.edges.take().or(image.edges.take());
    let reference_noise = stored_number(&reference.attributes, arguments.layer.noise_attribute());
    let image = arguments.layer.of(image, image_path)?;
    let reference = arguments.layer.of(reference, reference_path)?;
    let comparison = compare_watched(&image, &reference, edges.as_deref(), &progress)?;
    if let Some(diff) = &arguments.diff {
        progress.stage("writing the difference", 1);
        write_shown(diff, &difference(&image, &reference), (0.0, Tonemap::Srgb))?;
    }
    drop(progress);
    let relative_l2_less_noise = reference_noise.map(|noise| less_noise(comparison.relative_l2, noise));
    let figures = Figures {
        image: image_path,
        reference: reference_path,
        layer: arguments.layer,
        comparison,
        reference_noise,
        relative_l2_less_noise,
    };
    if arguments.json { console.json(&figures) } else { console.result(&figures.to_string()) }
}

/// An EXR with its layers, or a PNG with nothing but its colours.
fn read(path: &Path) -> Result<ExrImage> {
    match ending(path).as_deref() {
        Some("exr") => read_exr(path),
        Some("png") => Ok(ExrImage { image: read_png(path)?, ..ExrImage::default() }),
        _ => Err(Error::file(path, "is of a kind Relume does not read; use an .exr or a .png")),
    }
}

impl Layer {
    fn of(self, file: ExrImage, path: &Path) -> Result<Image> {
        let (layer, name) = match self {
            Self::Full => return Ok(file.image),
            Self::Direct => (file.direct, "direct"),
            Self::Indirect => (file.indirect, "indirect"),
        };
        layer.ok_or_else(|| {
            Error::file(path, format!("has no layer `{name}`; use an EXR that relume has written"))
        })
    }

    fn noise_attribute(self) -> &'static str {
        match self {
            Self::Full => "noise",
            Self::Direct => "noise_direct",
            Self::Indirect => "noise_indirect",
        }
    }
}

/// The difference in luminance as a picture; see [`Arguments::diff`]. Both images have one size.
fn difference(image: &Image, reference: &Image) -> Image {
    /// Luminance of linear Rec. 709.
    const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);
    let squares = reference.pixels.iter().map(|color| f64::from(color.dot(LUMINANCE)).powi(2));
    let mean = squares.sum::<f64>() / reference.pixels.len().max(1) as f64;
    let full = (0.5 * mean.sqrt() as f32).max(f32::MIN_POSITIVE);
    let shown = |(image, reference): (&Vec3, &Vec3)| {
        let off = (*image - *reference).dot(LUMINANCE) / full;
        Vec3::new(off.max(0.0), 0.0, (-off).max(0.0))
    };
    Image { pixels: image.pixels.iter().zip(&reference.pixels).map(shown).collect(), ..*image }
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let figures = &self.comparison;
        let mut table = Table::new();
        table.line("relative L2", percent(figures.relative_l2));
        table.line(
            "  without edges",
            figures.relative_l2_no_edges.map_or("edges not known".to_owned(), percent),
        );
        table.line("PSNR", format!("{:.2} dB", figures.psnr));
        table.line("FLIP", format!("{:.4}", figures.flip));
        if let Some(noise) = self.reference_noise {
            table.line("reference's own noise", percent(noise));
        }
        if let Some(error) = self.relative_l2_less_noise {
            table.line("relative L2 less that noise", percent(error));
        }
        write!(f, "{table}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_the_reference_is_taken_off_the_error() {
        // truth of norm 1, an image off by 0.3, a reference whose noise has norm 0.4: all at right angles
        let mean = (1.0_f64 + 0.16).sqrt();
        let (error, noise) = ((0.09_f64 + 0.16).sqrt() / mean, 0.4 / mean);
        assert!((less_noise(error, noise) - 0.3).abs() < 1e-12);
        assert_eq!(less_noise(0.1, 0.2), 0.0);
    }

    #[test]
    fn the_difference_is_red_above_and_blue_below() {
        let of = |pixels: [f32; 3]| Image { width: 3, height: 1, pixels: pixels.map(Vec3::splat).to_vec() };
        let shown = difference(&of([1.0, 1.25, 0.5]), &of([1.0; 3]));
        let expected = [Vec3::ZERO, Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.0, 1.0)];
        for (shown, expected) in shown.pixels.iter().zip(expected) {
            assert!((*shown - expected).abs().max_element() < 1e-5, "{shown} {expected}");
        }
    }
}
