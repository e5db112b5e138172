//! Image files in memory to 8-bit RGBA texels.

use std::io::Cursor;

use image::{ImageFormat, ImageReader, Limits};

/// The longest side of a texture, texels.
const LONGEST_SIDE: u32 = 16_384;

/// The most bytes a decoder may hold: the largest texture in 16-bit RGBA and some room to work.
const DECODER_BYTES: u64 = 3 << 30;

/// The most texels all images of a scene may have together.
pub(crate) const MOST_TEXELS: u64 = 1 << 32;

/// A decoded image, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bitmap {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) texels: Vec<[u8; 4]>,
}

fn reader(bytes: &[u8]) -> Result<ImageReader<Cursor<&[u8]>>, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| format!("cannot be read: {e}"))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg)) {
        return Err("is neither PNG nor JPEG; convert it to one of them".to_owned());
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE);
    limits.max_image_height = Some(LONGEST_SIDE);
    limits.max_alloc = Some(DECODER_BYTES);
    reader.limits(limits);
    Ok(reader)
}

/// Width times height of a PNG or JPEG file without decoding it.
pub(crate) fn texel_count(bytes: &[u8]) -> Result<u64, String> {
    let (width, height) = reader(bytes)?.into_dimensions().map_err(|e| format!("cannot be decoded: {e}"))?;
    if width > LONGEST_SIDE || height > LONGEST_SIDE {
        return Err(format!(
            "is {width} x {height} texels; scale it down to at most {LONGEST_SIDE} texels a side"
        ));
    }
    Ok(u64::from(width) * u64::from(height))
}

/// Decodes a PNG or JPEG file of any depth and channel count. The error says what is wrong with the file,
/// but not which file it is.
pub(crate) fn decode(bytes: &[u8]) -> Result<Bitmap, String> {
    texel_count(bytes)?;
    let image = reader(bytes)?.decode().map_err(|e| format!("cannot be decoded: {e}"))?.into_rgba8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err("has no texels".to_owned());
    }
    Ok(Bitmap { width, height, texels: image.into_raw().as_chunks::<4>().0.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
        let mut bytes = Vec::new();
        image::RgbaImage::from_fn(width, height, |x, y| image::Rgba(pixel(x, y)))
            .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
            .unwrap();
        bytes
    }

    #[test]
    fn decodes_rows_from_the_top() {
        let bitmap = decode(&png(3, 2, |x, y| [x as u8, y as u8, 7, 200])).unwrap();
        assert_eq!((bitmap.width, bitmap.height), (3, 2));
        assert_eq!(bitmap.texels[3], [0, 1, 7, 200]);
        assert_eq!(bitmap.texels[2], [2, 0, 7, 200]);
    }

    #[test]
    fn decodes_16_bit_grey() {
        let mut bytes = Vec::new();
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(1, 1, vec![0x8080_u16])
            .unwrap()
            .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
            .unwrap();
        assert_eq!(decode(&bytes).unwrap().texels, [[0x80, 0x80, 0x80, 255]]);
    }

    #[test]
    fn refuses_what_is_no_image_and_what_is_too_large() {
        assert!(decode(b"not an image").unwrap_err().contains("neither PNG nor JPEG"));
        let whole = png(8, 8, |x, y| [(x * 31) as u8, (y * 57) as u8, 3, 255]);
        assert!(decode(&whole[..whole.len() / 2]).unwrap_err().contains("cannot be decoded"));
        let wide = png(LONGEST_SIDE + 1, 1, |_, _| [0; 4]);
        assert!(decode(&wide).is_err());
    }
}
