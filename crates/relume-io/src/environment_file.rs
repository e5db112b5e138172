use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::codecs::hdr::HdrDecoder;
use image::{DynamicImage, ImageDecoder};
use relume::glam::Vec3;
use relume::scene::EnvironmentMap;
use relume::{Error, Result};

use crate::read_exr;

/// Pixels of a Radiance file that a byte of it may stand for: runs of 127 take two bytes in each of four channels.
const MOST_PIXELS_A_BYTE: u64 = 64;
/// So many may be there whatever the size of the file.
const ALWAYS_ALLOWED: u64 = 1 << 20;

/// Reads an equirectangular map by its ending: `.hdr` (Radiance) or `.exr`. `name` is what a rig calls it by.
///
/// # Errors
/// [`Error::File`] for any other ending, a file that is cut short or altered, and pixels that are no light; [`Error::Io`] where the system
/// refuses to read it.
pub fn read_environment(path: impl AsRef<Path>, name: &str) -> Result<EnvironmentMap> {
    let path = path.as_ref();
    let (width, height, texels) =
        match path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase).as_deref() {
            Some("hdr") => read_radiance(path)?,
            Some("exr") => {
                let image = read_exr(path)?.image;
                (image.width, image.height, image.pixels)
            }
            _ => {
                return Err(Error::file(
                    path,
                    "is no environment map that Relume reads; use an .hdr or an .exr",
                ));
            }
        };
    EnvironmentMap::new(name, width, height, texels).map_err(|error| Error::file(path, format!("is {error}")))
}

fn read_radiance(path: &Path) -> Result<(usize, usize, Vec<Vec3>)> {
    let io = |error| Error::io(path, "read", error);
    let file = File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    let altered = |what: String| {
        Error::file(
            path,
            format!("is no Radiance file (`#?RADIANCE`), cut short or altered ({what}); write it again"),
        )
    };
    let decoder = HdrDecoder::new(BufReader::new(file)).map_err(|error| altered(error.to_string()))?;
    let (width, height) = decoder.dimensions();
    if width.max(height) as usize > EnvironmentMap::LONGEST {
        return Err(Error::file(
            path,
            format!(
                "is {width}x{height} pixels; scale it down to at most {} a side",
                EnvironmentMap::LONGEST
            ),
        ));
    }
    // pixels are multiplied by these when they are written
    let meta = decoder.metadata();
    let (red, green, blue) = meta.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let written = Vec3::new(red, green, blue) * meta.exposure.unwrap_or(1.0);
    if !written.is_finite() || written.min_element() <= 0.0 {
        return Err(Error::file(path, format!("has an exposure of {written}; it must be above 0")));
    }
    let pixels = u64::from(width) * u64::from(height);
    if pixels > ALWAYS_ALLOWED.max(bytes.saturating_mul(MOST_PIXELS_A_BYTE)) {
        return Err(altered(format!("its header asks for {pixels} pixels, the file has {bytes} bytes")));
    }
    let image =
        DynamicImage::from_decoder(decoder).map_err(|error| altered(error.to_string()))?.into_rgb32f();
    Ok((width as usize, height as usize, image.pixels().map(|pixel| Vec3::from(pixel.0) / written).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExrMeta, write_exr_image};
    use relume::image::Image;

    /// Two rows of three pixels without runs: mantissas and an exponent of 2^1 each.
    fn radiance() -> Vec<u8> {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n".to_vec();
        (0..6_u8).for_each(|i| bytes.extend([32 * i, 64, 128, 129]));
        bytes
    }

    #[test]
    fn both_kinds_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let hdr = folder.path().join("sky.HDR");
        std::fs::write(&hdr, radiance()).unwrap();
        let map = read_environment(&hdr, "maps/sky.HDR").unwrap();
        assert_eq!((map.size(), map.name()), ((3, 2), "maps/sky.HDR"));
        let last = map.texel(2, 1);
        assert!((last - Vec3::new(1.25, 0.5, 1.0)).length() < 0.02, "{last}");
        let text = b"#?RADIANCE\nEXPOSURE=2.0\nFORMAT=32-bit_rle_rgbe\n";
        let brighter = [text, &radiance()[b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n".len()..]].concat();
        std::fs::write(&hdr, brighter).unwrap();
        let half = read_environment(&hdr, "sky").unwrap().texel(2, 1);
        assert!((2.0 * half - last).length() < 1e-5, "{half} is half of {last}");
        let exr = folder.path().join("sky.exr");
        let mut image = Image::new(4, 2);
        image.pixels[5] = Vec3::new(1.0, 2.0, 0.5);
        write_exr_image(&exr, &image, &ExrMeta::default()).unwrap();
        let map = read_environment(&exr, "sky").unwrap();
        assert_eq!((map.size(), map.texel(1, 1)), ((4, 2), Vec3::new(1.0, 2.0, 0.5)));
    }

    #[test]
    fn what_is_no_map_is_told_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let told = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let told = read_environment(&path, name).unwrap_err().to_string();
            assert!(told.contains(name) && !told.contains('\n'), "{told}");
            told
        };
        assert!(told("sky.png", b"").contains("use an .hdr or an .exr"));
        assert!(told("empty.hdr", b"").contains("cut short or altered"));
        let whole = radiance();
        assert!(told("cut.hdr", &whole[..whole.len() - 5]).contains("cut short or altered"));
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8000 +X 8000\n";
        assert!(told("huge.hdr", huge).contains("64000000 pixels"));
        let larger = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 80000 +X 80000\n";
        assert!(told("larger.hdr", larger).contains("scale it down"));
        let mut image = Image::new(2, 1);
        image.pixels[1].x = -1.0;
        let path = folder.path().join("negative.exr");
        write_exr_image(&path, &image, &ExrMeta::default()).unwrap();
        let told = read_environment(&path, "negative").unwrap_err().to_string();
        assert!(told.contains("column 1, row 0"), "{told}");
    }
}
