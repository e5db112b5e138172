use std::path::Path;

use relume::Result;
use relume::image::{Image, Tonemap, display};
use relume_io::write_png;

/// Pixels between two pictures, and between the rows.
const GAP: usize = 4;
/// sRGB of the gaps.
const GAP_COLOR: [u8; 3] = [255; 3];

/// Pictures as a display shows them, in one image.
pub(super) struct ContactSheet {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

/// Rows of pictures of one size, with a thin gap between them, shown at `exposure` stops.
pub(super) fn contact_sheet(rows: &[Vec<Image>], exposure: f32) -> ContactSheet {
    let (width, height) =
        rows.iter().flatten().next().map_or((0, 0), |picture| (picture.width, picture.height));
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let spread = |count: usize, side: usize| (count * (side + GAP)).saturating_sub(GAP);
    let (sheet_width, sheet_height) = (spread(columns, width), spread(rows.len(), height));
    let mut pixels = vec![GAP_COLOR; sheet_width * sheet_height];
    for (row, pictures) in rows.iter().enumerate() {
        for (column, picture) in pictures.iter().enumerate() {
            let shown = display(picture, exposure, Tonemap::default());
            let corner = row * (height + GAP) * sheet_width + column * (width + GAP);
            for (y, line) in shown.chunks_exact(width).enumerate() {
                let start = corner + y * sheet_width;
                pixels[start..start + width].copy_from_slice(line);
            }
        }
    }
    ContactSheet { width: sheet_width, height: sheet_height, pixels }
}

impl ContactSheet {
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        write_png(path, self.width, self.height, &self.pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::glam::Vec3;

    #[test]
    fn pictures_stand_in_rows_with_gaps() {
        let picture = |light: f32| Image { width: 3, height: 2, pixels: vec![Vec3::splat(light); 6] };
        let sheet = contact_sheet(&[vec![picture(0.0), picture(1e6)], vec![picture(0.0), picture(0.0)]], 0.0);
        assert_eq!((sheet.width, sheet.height), (3 + GAP + 3, 2 + GAP + 2));
        let at = |x: usize, y: usize| sheet.pixels[y * sheet.width + x];
        assert_eq!(at(2, 1), [0; 3]);
        assert_eq!(at(3, 1), GAP_COLOR);
        assert_eq!(at(2, 2), GAP_COLOR);
        assert!(at(3 + GAP, 0)[0] > 250);
        assert_eq!(at(3 + GAP + 2, 2 + GAP + 1), [0; 3]);
    }
}
