//! Where the frames of a sequence go.

use std::io::{ErrorKind, IsTerminal, Write};
use std::ops::RangeInclusive;
use std::path::Path;

use clap::ValueEnum;
use relume::image::{Image, Layers, Tonemap, display};
use relume::{Error, Result};
use relume_io::{Attribute, FrameNames};

use super::Arguments;
use crate::console::Console;
use crate::output::{ImageOutput, check_replaced};

/// `--raw`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Raw {
    /// As a display shows it: three bytes a pixel.
    #[default]
    Rgb24,
    /// Scene-linear: three little-endian 32-bit floats a pixel.
    Rgbf32le,
}

/// A frame that is ready to be written.
pub(super) struct Frame {
    pub(super) number: i32,
    pub(super) layers: Layers,
    /// Stops.
    pub(super) exposure: f32,
}

/// What is done with every frame.
pub(super) enum Destination {
    Files { first: ImageOutput, names: FrameNames },
    Stdout(Raw),
}

impl Destination {
    /// Refuses what cannot be written, as far as one can tell without the frames.
    pub(super) fn new(arguments: &Arguments, inputs: &[&Path], console: &Console) -> Result<Self> {
        if arguments.output != Path::new("-") {
            if arguments.raw.is_some() {
                return Err(Error::Setting("--raw is of pixels on stdout; add -o -".to_owned()));
            }
            let first = ImageOutput::new(&arguments.output, inputs)?;
            arguments.check_kind(Some(first.kind), console)?;
            return Ok(Self::Files { names: FrameNames::new(&arguments.output)?, first });
        }
        if arguments.json {
            return Err(Error::Setting(
                "--json needs stdout, which -o - takes for pixels; leave one out".into(),
            ));
        }
        if std::io::stdout().is_terminal() {
            return Err(Error::Setting(
                "pixels are nothing for a terminal; pipe them to a program or a file".into(),
            ));
        }
        arguments.check_kind(None, console)?;
        let raw = arguments.raw.unwrap_or_default();
        if arguments.tonemap.is_some() && raw == Raw::Rgbf32le {
            console.warning("--tonemap changes nothing in rgbf32le, which stays scene-linear");
        }
        Ok(Self::Stdout(raw))
    }

    /// Refuses the files of `frames` that would replace one of `inputs`, or what is no file.
    pub(super) fn check(&self, frames: RangeInclusive<i32>, inputs: &[&Path]) -> Result<()> {
        match self {
            Self::Files { names, .. } => {
                frames.into_iter().try_for_each(|frame| check_replaced(&names.file(frame), inputs))
            }
            Self::Stdout(_) => Ok(()),
        }
    }

    /// # Errors
    /// As [`ImageOutput::write`]; [`Error::Io`] where stdout takes no more.
    pub(super) fn write(
        &self,
        frame: &Frame,
        tonemap: Tonemap,
        attributes: &[(String, Attribute)],
    ) -> Result<()> {
        match self {
            Self::Files { first, names } => first.renamed(names.file(frame.number)).write(
                &frame.layers,
                (frame.exposure, tonemap),
                attributes.to_vec(),
            ),
            Self::Stdout(raw) => to_stdout(&raw.bytes(&frame.layers.full(), (frame.exposure, tonemap)))
                .map_err(|error| Error::io("stdout", "write", told(error, frame.number))),
        }
    }
}

impl Raw {
    /// The pixels row by row from the top.
    fn bytes(self, image: &Image, (exposure, tonemap): (f32, Tonemap)) -> Vec<u8> {
        match self {
            Self::Rgb24 => display(image, exposure, tonemap).into_flattened(),
            Self::Rgbf32le => {
                image.pixels.iter().flat_map(|pixel| pixel.to_array()).flat_map(f32::to_le_bytes).collect()
            }
        }
    }
}

fn to_stdout(bytes: &[u8]) -> std::io::Result<()> {
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(bytes)?;
    stdout.flush()
}

/// A film without its end is no film, so unlike one of results, a reader that goes away fails the job.
fn told(error: std::io::Error, frame: i32) -> std::io::Error {
    if error.kind() == ErrorKind::BrokenPipe {
        return std::io::Error::new(error.kind(), format!("its reader went away at frame {frame}"));
    }
    error
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::Vec3;

    #[test]
    fn raw_pixels_are_row_by_row() {
        let mut image = Image::new(2, 2);
        image.pixels[1] = Vec3::new(1.0, 0.0, 0.25);
        let shown = (0.0, Tonemap::Srgb);
        assert_eq!(Raw::Rgb24.bytes(&image, shown), [0, 0, 0, 255, 0, 137, 0, 0, 0, 0, 0, 0]);
        let linear = Raw::Rgbf32le.bytes(&image, shown);
        assert_eq!(linear.len(), 48);
        assert_eq!(linear[12..24], [0, 0, 128, 63, 0, 0, 0, 0, 0, 0, 128, 62]);
    }
}
