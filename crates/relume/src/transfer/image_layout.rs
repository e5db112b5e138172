//! Where the rows of an operator lie in an image.
//!
//! Hasan 2006 (section 3.5) takes the columns of a transfer matrix as images: what the scene looks like under one wavelet
//! light. Rows of the final gather lie at their pixels, those of the bounces at their samples' places in the flattened cloud.

use super::Buffer;
use crate::sample::Receivers;

/// Side of the cells in which further receivers are laid, a power of two.
const CELL: usize = 8;

/// An image with a place for every row of an operator; other places are holes.
#[derive(Clone, Debug, Default)]
pub struct ImageLayout {
    /// Places a line.
    pub width: usize,
    /// Lines.
    pub height: usize,
    /// For each row its place: `line * width + column`. No two are the same.
    pub places: Buffer<u32>,
}

impl ImageLayout {
    /// The final gather's rows, of which `owners` are the receivers: those of pixels' centres lie at their pixels, the
    /// further ones below the image, 8x8 places after each other in the order of rows, so that neighbours stay close.
    pub(super) fn of_receivers(image_width: usize, receivers: &Receivers, owners: &[u32]) -> Self {
        let mut pixels = vec![Receivers::NONE; receivers.points.len()];
        for (pixel, &receiver) in receivers.of_centers.iter().enumerate() {
            if receiver != Receivers::NONE {
                pixels[receiver as usize] = pixel as u32;
            }
        }
        let width = image_width.next_multiple_of(CELL);
        let lines = receivers.of_centers.len().div_ceil(image_width.max(1));
        let mut further = 0;
        let places = owners.iter().map(|&receiver| match pixels[receiver as usize] {
            Receivers::NONE => {
                further += 1;
                Self::further_place(further - 1, width, lines)
            }
            pixel => (pixel as usize / image_width * width + pixel as usize % image_width) as u32,
        });
        let places: Vec<u32> = places.collect();
        let height = lines + further.div_ceil(CELL * width) * CELL;
        Self { width, height, places: places.into() }
    }

    /// Rows of points all over the image: 8x8 places after each other, in the order of rows, so that neighbours stay close.
    pub(super) fn of_records(image_width: usize, rows: usize) -> Self {
        let width = image_width.next_multiple_of(CELL);
        let places: Vec<u32> = (0..rows).map(|row| Self::further_place(row, width, 0)).collect();
        Self { width, height: rows.div_ceil(CELL * width) * CELL, places: places.into() }
    }

    /// The place of a further receiver in an image of so many lines before it.
    fn further_place(number: usize, width: usize, lines: usize) -> u32 {
        let (cell, within) = (number / (CELL * CELL), number % (CELL * CELL));
        let (x, y) = morton_place(within);
        let across = width / CELL;
        let (column, line) = (cell % across * CELL + x, lines + cell / across * CELL + y);
        (line * width + column) as u32
    }

    /// The bounces' rows, the first `rows` of `count` samples: the flattened cloud, `2^k x 2^k` (Hasan 2006, section 3.4).
    pub(super) fn of_cloud(count: usize, rows: usize) -> Self {
        let width = 1 << (count.max(1).ilog2() / 2);
        let place = |sample: usize| {
            let (x, y) = morton_place(sample);
            (y * width + x) as u32
        };
        Self { width, height: width, places: (0..rows).map(place).collect::<Vec<_>>().into() }
    }

    /// Whether every one of `rows` has a place of its own within the image.
    pub(super) fn is_sound(&self, rows: usize) -> bool {
        let mut places = self.places.to_vec();
        places.sort_unstable();
        let area = self.width.checked_mul(self.height);
        places.len() == rows
            && places.windows(2).all(|pair| pair[0] < pair[1])
            && area.is_some_and(|area| places.last().is_none_or(|&last| (last as usize) < area))
    }
}

/// Column and line of a number in Morton order: even bits and odd bits.
fn morton_place(number: usize) -> (usize, usize) {
    let even = |bits: usize| (0..usize::BITS / 2).fold(0, |sum, bit| sum | (bits >> bit & 1 << bit));
    (even(number), even(number >> 1))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::sample::{Gloss, Receiver};

    #[test]
    fn morton_order_walks_blocks_of_four() {
        let first: Vec<_> = (0..8).map(morton_place).collect();
        assert_eq!(first, [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (3, 0), (2, 1), (3, 1)]);
        assert_eq!(morton_place(0b1101_1000), (0b1100, 0b1010));
    }

    #[test]
    fn the_cloud_fills_its_image() {
        let layout = ImageLayout::of_cloud(256, 240);
        assert!((layout.width, layout.height) == (16, 16) && layout.is_sound(240));
        assert!(!layout.is_sound(239) && !layout.is_sound(241));
    }

    #[test]
    fn receivers_lie_at_their_pixels_and_the_others_below() {
        // two lines of ten pixels, the third of which reflects nothing; seventy further receivers
        let of_centers: Vec<u32> = (0..20_u32)
            .map(|pixel| if pixel == 2 { Receivers::NONE } else { pixel - u32::from(pixel > 2) })
            .collect();
        let point = Receiver {
            position: Vec3::ZERO,
            shading_normal: Vec3::Y,
            geometric_normal: Vec3::Y,
            pixel: 0.0,
            gloss: Gloss::default(),
        };
        let points = vec![point; 19 + 70];
        let receivers = Receivers { of_centers, points, ..Receivers::default() };
        let owners: Vec<u32> = (0..89).rev().collect();
        let layout = ImageLayout::of_receivers(10, &receivers, &owners);
        assert_eq!((layout.width, layout.height), (16, 2 + 8));
        assert!(layout.is_sound(89));
        let place = |receiver: u32| layout.places[88 - receiver as usize];
        assert_eq!([0, 1, 2, 17, 18].map(place), [0, 1, 3, 16 + 8, 16 + 9]);
        assert_eq!([88, 87].map(place), [2 * 16, 2 * 16 + 1], "the first of the further rows");
        let mut twice = layout.places.to_vec();
        twice[5] = twice[6];
        assert!(!ImageLayout { places: twice.into(), ..layout }.is_sound(89), "two rows at one place");
    }
}
