//! The picture of a scene: reference, result and their difference, side by side.

use std::path::Path;

use relume::Result;
use relume::glam::Vec3;
use relume::image::{Image, Layers, Tonemap, display};
use relume_io::write_png;
use relume_tests::truth::Truth;

/// Pixels between two tiles.
const GAP: usize = 4;
/// sRGB of the gaps.
const GAP_COLOR: [u8; 3] = [255; 3];
/// The difference at which the third picture is fully red or blue, as a share of what is shown as white.
const FULL_DIFFERENCE: f32 = 0.25;
/// Tiles of a row.
const COLUMNS: usize = 6;

/// What the columns and colours of a sheet mean.
pub(crate) const CAPTION: &str = "Each row: whole image as the reference, as the result, and their difference; then the \
     same of the indirect light alone, brightened. Red is too bright, blue too dark; full colour is a quarter of what is \
     shown as white. The difference is blurred a little against the noise of the reference, which the figures are free \
     of.";

/// Rows of tiles of one size.
pub(crate) struct Sheet {
    size: (usize, usize),
    rows: Vec<[Vec<[u8; 3]>; COLUMNS]>,
}

impl Sheet {
    /// An empty sheet of tiles of `size`.
    pub(crate) fn new(size: (usize, usize)) -> Self {
        Self { size, rows: Vec::new() }
    }

    /// Adds what one light shows.
    pub(crate) fn add(&mut self, relit: &Layers, direct: &Truth, indirect: &Truth) {
        let [a, b, c] = tiles(&direct.plus(indirect).mean(), &relit.full());
        let [d, e, f] = tiles(&indirect.mean(), &relit.indirect);
        self.rows.push([a, b, c, d, e, f]);
    }

    /// Writes all rows as one PNG.
    ///
    /// # Errors
    /// As [`write_png`].
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let (width, height) = self.size;
        let sheet_width = COLUMNS * (width + GAP) - GAP;
        let sheet_height = (self.rows.len() * (height + GAP)).saturating_sub(GAP);
        let mut pixels = vec![GAP_COLOR; sheet_width * sheet_height];
        for (row, tiles) in self.rows.iter().enumerate() {
            for (column, tile) in tiles.iter().enumerate() {
                for (y, line) in tile.chunks_exact(width).enumerate() {
                    let start = (row * (height + GAP) + y) * sheet_width + column * (width + GAP);
                    pixels[start..start + width].copy_from_slice(line);
                }
            }
        }
        write_png(path, sheet_width, sheet_height, &pixels)
    }
}

/// Reference, result and difference, all at the reference's exposure.
fn tiles(reference: &Image, result: &Image) -> [Vec<[u8; 3]>; 3] {
    let white = white(reference);
    let stops = (1.0 / white).log2();
    let shown = |image: &Image| display(image, stops, Tonemap::Srgb);
    let pairs = result.pixels.iter().zip(&reference.pixels);
    let difference = pairs.map(|(result, truth)| (*result - *truth) / (FULL_DIFFERENCE * white)).collect();
    let difference = box_filtered(&Image { pixels: difference, ..*result }, result.height.div_ceil(120));
    [shown(reference), shown(result), difference.pixels.into_iter().map(signed).collect()]
}

/// Means over squares that reach `radius` pixels to each side, cut at the image's border.
fn box_filtered(image: &Image, radius: usize) -> Image {
    let along = |image: &Image, step: usize, count: usize| {
        let mean = |pixel: usize| {
            let place = pixel / step % count;
            let (first, last) = (place.saturating_sub(radius), (place + radius).min(count - 1));
            let line = pixel - place * step;
            (first..=last).map(|at| image.pixels[line + at * step]).sum::<Vec3>() / (last - first + 1) as f32
        };
        Image { pixels: (0..image.pixels.len()).map(mean).collect(), ..*image }
    };
    along(&along(image, 1, image.width), image.width, image.height)
}

/// What is shown as white: the brightest channel of the pixel that 97% of all are darker than.
fn white(image: &Image) -> f32 {
    let mut bright: Vec<_> = image.pixels.iter().map(|pixel| pixel.max_element()).collect();
    bright.sort_by(f32::total_cmp);
    bright.get(bright.len() * 97 / 100).copied().unwrap_or(1.0).max(1e-20)
}

/// White for no difference, red for 1 and more, blue for -1 and less; by luminance (Rec. 709).
fn signed(difference: Vec3) -> [u8; 3] {
    let difference = difference.dot(Vec3::new(0.2126, 0.7152, 0.0722)).clamp(-1.0, 1.0);
    let faded = (255.0 * (1.0 - difference.abs()) + 0.5) as u8;
    if difference > 0.0 { [255, faded, faded] } else { [faded, faded, 255] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blurring_keeps_the_mean_inside_and_reaches_as_far_as_said() {
        let mut image = Image::new(9, 7);
        image.pixels[3 * 9 + 4] = Vec3::splat(9.0);
        let blurred = box_filtered(&image, 1);
        let at = |x: usize, y: usize| blurred.pixels[y * 9 + x].x;
        assert!((2..5).all(|y| (3..6).all(|x| (at(x, y) - 1.0).abs() < 1e-6)));
        assert!((blurred.pixels.iter().map(|pixel| pixel.x).sum::<f32>() - 9.0).abs() < 1e-5);
        assert_eq!((at(2, 3), at(4, 5)), (0.0, 0.0));
        // at a corner fewer count
        assert_eq!(box_filtered(&Image { pixels: vec![Vec3::ONE; 63], ..image }, 2).pixels[0], Vec3::ONE);
    }

    #[test]
    fn differences_have_signs_and_tiles_their_places() {
        let image = |light: f32| Image { width: 3, height: 2, pixels: vec![Vec3::splat(light); 6] };
        let truth = |light| Truth { halves: [image(light), image(light)] };
        let relit = Layers { direct: image(1.0), indirect: image(0.5), ..Layers::default() };
        let mut sheet = Sheet::new((3, 2));
        sheet.add(&relit, &truth(1.0), &truth(1.0));
        let [reference, result, whole, .., indirect] = &sheet.rows[0];
        assert_eq!(reference[0], [255; 3]);
        assert!(result[0][0] < 255);
        assert_eq!(
            (whole[0], indirect[0]),
            ([0, 0, 255], [0, 0, 255]),
            "1.5 for 2 and 0.5 for 1 are too dark"
        );
        assert_eq!(signed(Vec3::ZERO), [255; 3]);
        assert_eq!(signed(Vec3::splat(0.5)), [255, 128, 128]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.png");
        sheet.write(&path).unwrap();
        let written = relume_io::read_png(&path).unwrap();
        assert_eq!((written.width, written.height), (6 * (3 + GAP) - GAP, 2));
        assert_eq!(written.pixels[2 * (3 + GAP)], Vec3::Z);
    }
}
