//! Arguments that several commands share, and how they are read.

use clap::{Args, ValueEnum};
use relume::image::Tonemap;
use relume::relight::{Only, RelightSettings};
use relume::{Error, Result};

/// Most pixels along a side of an image.
const LARGEST_SIDE: usize = 16_384;
/// Gather samples are a power of four in this range.
const GATHER_RANGE: std::ops::RangeInclusive<usize> = 256..=1 << 20;

/// `--threads`.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Threads {
    /// Threads to work on; results do not depend on it [default: one a processor].
    #[arg(long, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl Threads {
    /// How many; 0 stands for one a processor.
    #[cfg(feature = "viewer")]
    pub(crate) fn count(self) -> usize {
        self.threads.map_or(0, usize::from)
    }

    /// Starts the thread pool that everything runs on.
    ///
    /// # Errors
    /// [`Error::Io`] where the system gives no threads.
    pub(crate) fn start(self) -> Result<()> {
        rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads.map_or(0, usize::from))
            .build_global()
            .map_err(|error| Error::io("thread pool", "start", std::io::Error::other(error)))
    }
}

/// How a light is lit.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Lighting {
    /// Indirect bounces [default: all].
    #[arg(long, value_name = "N")]
    bounces: Option<u32>,
    /// Direct samples along each side of a pixel: 1 or 2.
    #[arg(long, value_name = "1|2", default_value = "2", value_parser = antialiasing)]
    aa: u32,
    /// Light everything coarsely, as a light is while it is dragged: fewer shadow rays, later bounces guessed.
    #[arg(long)]
    pub(crate) preview: bool,
    /// Leave out what adds next to nothing under a light: an error to accept, as 0.01; 0 leaves out nothing [default: as
    /// suits the encoding].
    #[arg(long, value_name = "EPSILON", allow_negative_numbers = true, value_parser = share)]
    cull: Option<f32>,
}

impl Lighting {
    pub(crate) fn settings(self) -> RelightSettings {
        let Self { bounces, aa, preview, cull } = self;
        RelightSettings { bounces, aa, preview, cull, ..RelightSettings::default() }
    }
}

fn share(text: &str) -> Result<f32, String> {
    let number = text.parse().ok().filter(|number| (0.0..=1.0).contains(number));
    number.ok_or_else(|| "must be a number from 0 to 1".to_owned())
}

/// `--only`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Part {
    /// Light straight from the lights, and what surfaces emit.
    Direct,
    /// Light that met another surface on its way.
    Indirect,
}

impl Part {
    /// The library's word for an `--only` that may be left out.
    pub(crate) fn only(part: Option<Self>) -> Only {
        match part {
            None => Only::Both,
            Some(Self::Direct) => Only::Direct,
            Some(Self::Indirect) => Only::Indirect,
        }
    }
}

/// `--tonemap`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Curve {
    /// Khronos PBR Neutral: keeps base colours, compresses highlights.
    #[default]
    Neutral,
    /// AgX: flatter, bright colours go to white as on film.
    Agx,
    /// No curve: what is brighter than white is clipped.
    Srgb,
}

impl From<Curve> for Tonemap {
    fn from(curve: Curve) -> Self {
        match curve {
            Curve::Neutral => Self::Neutral,
            Curve::Agx => Self::AgX,
            Curve::Srgb => Self::Srgb,
        }
    }
}

/// Width and height in pixels, written `640x480`.
pub(crate) fn image_size(text: &str) -> Result<(usize, usize), String> {
    let side = |side: &str| side.parse().ok().filter(|side| (1..=LARGEST_SIDE).contains(side));
    text.split_once(['x', 'X'])
        .and_then(|(width, height)| Some((side(width)?, side(height)?)))
        .ok_or_else(|| format!("write WIDTHxHEIGHT in pixels, each 1 to {LARGEST_SIDE}, as 640x480"))
}

/// A part of all light, in percent.
pub(crate) fn percent_of_light(text: &str) -> Result<f32, String> {
    let percent = text.strip_suffix('%').unwrap_or(text).parse().ok();
    percent
        .filter(|percent| (0.1..=100.0).contains(percent))
        .ok_or_else(|| "write a number of percent from 0.1 to 100, such as 4".to_owned())
}

/// A number of gather samples.
pub(crate) fn gather_count(text: &str) -> Result<usize, String> {
    text.parse::<usize>()
        .ok()
        .filter(|count| {
            GATHER_RANGE.contains(count) && count.is_power_of_two() && count.trailing_zeros() % 2 == 0
        })
        .ok_or_else(|| {
            format!("must be a power of four from {} to {}", GATHER_RANGE.start(), GATHER_RANGE.end())
        })
}

/// `1` or `2`: samples along each side of a pixel.
pub(crate) fn antialiasing(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        _ => Err("must be 1 (one ray through the pixel's centre) or 2 (2x2 rays)".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_numbers_in_range() {
        assert_eq!(image_size("640x480"), Ok((640, 480)));
        assert_eq!(image_size("1X16384"), Ok((1, 16_384)));
        for wrong in
            ["", "640", "640x", "x480", "0x480", "640x16385", "-1x4", "640x480x3", "640 x 480", "axb"]
        {
            assert!(image_size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn gather_counts_are_powers_of_four() {
        assert_eq!(["256", "65536", "1048576"].map(gather_count), [Ok(256), Ok(65_536), Ok(1 << 20)]);
        for wrong in ["64", "512", "65535", "4194304", "many", "-256"] {
            assert!(gather_count(wrong).is_err(), "{wrong}");
        }
    }
}
