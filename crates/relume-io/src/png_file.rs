//! PNG images: 8-bit sRGB out, and back to scene-linear values for comparing.

use std::fs::File;
use std::io::{BufReader, Write};
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, DecodingError, Encoder, EncodingError, Limits, Transformations};
use relume::glam::Vec3;
use relume::image::Image;
use relume::image::display::linear_from_srgb;
use relume::{Error, Result, atomic_write};

/// Writes 8-bit sRGB pixels, row by row from the top, as [`relume::image::display::display`] makes them. The
/// file carries the sRGB chunk (with its gAMA and cHRM fallback) and appears whole or not at all.
///
/// # Errors
/// [`Error::Setting`] where the pixels are not `width * height`, or none; otherwise as [`atomic_write`].
pub fn write_png(path: impl AsRef<Path>, width: usize, height: usize, pixels: &[[u8; 3]]) -> Result<()> {
    let path = path.as_ref();
    let size = u32::try_from(width).ok().zip(u32::try_from(height).ok());
    let whole = width.checked_mul(height) == Some(pixels.len()) && !pixels.is_empty();
    let Some((columns, rows)) = size.filter(|_| whole) else {
        let count = pixels.len();
        return Err(Error::Setting(format!(
            "{count} pixels are no image of {width}x{height}; it was not written"
        )));
    };
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encode(encoder, pixels).map_err(|error| match error {
        EncodingError::IoError(error) => Error::io(path, "write", error),
        other => Error::Setting(format!("{} cannot be written as PNG: {other}", path.display())),
    })?;
    atomic_write(path, |file| file.write_all(&bytes).map_err(|error| Error::io(path, "write", error)))
}

fn encode(encoder: Encoder<'_, &mut Vec<u8>>, pixels: &[[u8; 3]]) -> Result<(), EncodingError> {
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels.as_flattened())?;
    writer.finish()
}

/// Reads a PNG as scene-linear values `0..=1` by the inverse of the sRGB curve; no tone curve is undone. Grey
/// and palette images become RGB, 16 bits become 8, alpha and colour profiles are left aside.
///
/// # Errors
/// [`Error::File`] for a file that is no PNG, cut short or altered; [`Error::Io`] where the system refuses to
/// read it.
pub fn read_png(path: impl AsRef<Path>) -> Result<Image> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|error| Error::io(path, "read", error))?;
    decode(file).map_err(|error| match error {
        DecodingError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::io(path, "read", error)
        }
        DecodingError::LimitsExceeded => {
            Error::file(path, "is larger than Relume reads (1 GiB); scale it down")
        }
        other => Error::file(path, format!("is no PNG file, cut short or altered ({other}); write it again")),
    })
}

fn decode(file: File) -> Result<Image, DecodingError> {
    const LARGEST: usize = 1 << 30;
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), Limits { bytes: LARGEST });
    decoder.set_transformations(Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let size =
        reader.output_buffer_size().filter(|&size| size <= LARGEST).ok_or(DecodingError::LimitsExceeded)?;
    let mut bytes = vec![0; size];
    let frame = reader.next_frame(&mut bytes)?;
    reader.finish()?;
    let samples = frame.color_type.samples();
    let linear: [f32; 256] = std::array::from_fn(|byte| linear_from_srgb(byte as f32 / 255.0));
    let color = |pixel: &[u8]| match *pixel {
        [r, g, b, ..] => Vec3::new(linear[r as usize], linear[g as usize], linear[b as usize]),
        [grey, ..] => Vec3::splat(linear[grey as usize]),
        [] => Vec3::ZERO,
    };
    let pixels = bytes.chunks_exact(samples).map(color).collect();
    Ok(Image { width: frame.width as usize, height: frame.height as usize, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: [[u8; 3]; 6] =
        [[0, 1, 2], [10, 100, 200], [255, 0, 128], [3, 3, 3], [77, 88, 99], [255; 3]];

    #[test]
    fn writes_srgb_that_reads_back_linear() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        write_png(&path, 3, 2, &PIXELS).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.windows(4).any(|chunk| chunk == b"sRGB"));
        let image = read_png(&path).unwrap();
        assert_eq!((image.width, image.height), (3, 2));
        assert_eq!(relume::image::display(&image, 0.0, relume::image::Tonemap::Srgb), PIXELS);
        assert_eq!(image.pixels[5], Vec3::ONE);
        // Half of the encoded range is about a fifth of the light.
        assert!((image.pixels[2].z - 0.2158).abs() < 1e-3);
    }

    #[test]
    fn reads_grey_palette_alpha_and_16_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.png");
        let kinds: [(ColorType, BitDepth, &[u8], [u8; 3]); 5] = [
            (ColorType::Grayscale, BitDepth::Eight, &[120], [120; 3]),
            (ColorType::GrayscaleAlpha, BitDepth::Eight, &[120, 7], [120; 3]),
            (ColorType::Rgba, BitDepth::Eight, &[1, 2, 3, 4], [1, 2, 3]),
            (ColorType::Rgb, BitDepth::Sixteen, &[9, 0, 8, 0, 7, 0], [9, 8, 7]),
            (ColorType::Indexed, BitDepth::Eight, &[1], [40, 50, 60]),
        ];
        for (color, depth, bytes, expected) in kinds {
            let mut encoder = Encoder::new(File::create(&path).unwrap(), 1, 1);
            encoder.set_color(color);
            encoder.set_depth(depth);
            if color == ColorType::Indexed {
                encoder.set_palette(&[10_u8, 20, 30, 40, 50, 60][..]);
            }
            encoder.write_header().unwrap().write_image_data(bytes).unwrap();
            let image = read_png(&path).unwrap();
            assert_eq!(
                relume::image::display(&image, 0.0, relume::image::Tonemap::Srgb),
                [expected],
                "{color:?}"
            );
        }
    }

    #[test]
    fn cut_short_altered_and_missing_files_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        write_png(&path, 3, 2, &PIXELS).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() - 12 {
            std::fs::write(&path, &whole[..length]).unwrap();
            let error = read_png(&path).unwrap_err();
            assert!(error.is_bad_input() && error.to_string().contains("cut short"), "{length}: {error}");
        }
        assert!(read_png(folder.path().join("none.png")).unwrap_err().to_string().contains("cannot read"));
    }

    #[test]
    fn pixels_that_do_not_fill_the_image_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        let error = write_png(&path, 4, 2, &PIXELS).unwrap_err().to_string();
        assert_eq!(error, "6 pixels are no image of 4x2; it was not written");
        assert!(write_png(&path, 0, 0, &[]).is_err());
        assert!(!path.exists());
        assert!(
            write_png(folder.path().join("no/image.png"), 3, 2, &PIXELS)
                .unwrap_err()
                .to_string()
                .contains("does not exist")
        );
    }
}
