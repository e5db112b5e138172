//! Packing rectangles into square textures (Hasan 2006, section 4.4).
//!
//! Rectangles are packed once, all known beforehand, and sorted by height, so that shelves of one height after the other are
//! nearly full: next-fit by decreasing height. Libraries for atlases (`etagere`, `guillotiere`) are made for rectangles that
//! come and go one by one.

use super::haar_blocks::ATLAS;

/// Where a rectangle lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Which atlas.
    pub(super) atlas: u32,
    /// Its first column there.
    pub(super) column: u16,
    /// Its first line there.
    pub(super) line: u16,
}

/// Rectangles in atlases.
#[derive(Clone, Debug, Default)]
pub(super) struct Packing {
    /// Of each rectangle.
    pub(super) places: Vec<Place>,
    /// Lines of all atlases together; all but the last are whole.
    pub(super) lines: usize,
}

impl Packing {
    /// Packs rectangles of these widths and heights, each from 1 to [`ATLAS`]. Among those of one height neighbours stay neighbours.
    pub(super) fn of(sizes: &[[usize; 2]]) -> Self {
        let mut order: Vec<usize> = (0..sizes.len()).collect();
        order.sort_by_key(|&number| std::cmp::Reverse(sizes[number][1]));
        let mut places = vec![Place::default(); sizes.len()];
        let mut shelf = Shelf::default();
        for number in order {
            places[number] = shelf.put(sizes[number]);
        }
        Self { places, lines: shelf.atlas * ATLAS + shelf.line + shelf.height }
    }
}

/// The shelf that is being filled.
#[derive(Default)]
struct Shelf {
    atlas: usize,
    line: usize,
    height: usize,
    column: usize,
}

impl Shelf {
    fn put(&mut self, [width, height]: [usize; 2]) -> Place {
        if self.column + width > ATLAS || height > self.height {
            (self.line, self.column, self.height) = (self.line + self.height, 0, height);
            if self.line + height > ATLAS {
                (self.atlas, self.line) = (self.atlas + 1, 0);
            }
        }
        let place = Place { atlas: self.atlas as u32, column: self.column as u16, line: self.line as u16 };
        self.column += width;
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    fn sizes(count: u32, most: usize) -> Vec<[usize; 2]> {
        let side = |i: u32| 1 + (unit(hash(i, 9)).powi(2) * most as f32) as usize;
        (0..count).map(|i| [side(2 * i).min(most), side(2 * i + 1).min(most)]).collect()
    }

    /// How many texels of all atlases are taken; panics where two rectangles overlap.
    fn taken(sizes: &[[usize; 2]], packing: &Packing) -> usize {
        let mut texels = vec![false; packing.lines * ATLAS];
        let mut taken = 0;
        for (&[width, height], place) in sizes.iter().zip(&packing.places) {
            assert!(usize::from(place.column) + width <= ATLAS && usize::from(place.line) + height <= ATLAS);
            for line in 0..height {
                let line = place.atlas as usize * ATLAS + usize::from(place.line) + line;
                let row = &mut texels[line * ATLAS + usize::from(place.column)..][..width];
                assert!(!row.contains(&true), "two rectangles overlap");
                row.fill(true);
                taken += width;
            }
        }
        taken
    }

    #[test]
    fn rectangles_do_not_overlap_and_leave_little_empty() {
        for (count, most, least) in [(20_000, 64, 0.95), (200, 2000, 0.5), (1, 64, 0.0)] {
            let sizes = sizes(count, most);
            let packing = Packing::of(&sizes);
            let full = taken(&sizes, &packing) as f64 / (packing.lines * ATLAS) as f64;
            println!("{count} rectangles up to {most}: {full:.3} full, {} lines", packing.lines);
            assert!(full > least, "{full}");
        }
        assert_eq!(Packing::of(&[]).lines, 0);
    }

    #[test]
    fn a_second_atlas_begins_where_the_first_is_full() {
        let packing = Packing::of(&[[ATLAS, ATLAS], [1, 1], [ATLAS, 2]]);
        let atlases: Vec<u32> = packing.places.iter().map(|place| place.atlas).collect();
        assert_eq!((atlases, packing.lines), (vec![0, 1, 1], ATLAS + 3));
        taken(&[[ATLAS, ATLAS], [1, 1], [ATLAS, 2]], &packing);
    }

    #[test]
    #[should_panic(expected = "overlap")]
    fn an_overlap_is_noticed() {
        let packing = Packing { places: vec![Place::default(); 2], lines: 2 };
        taken(&[[2, 2], [1, 1]], &packing);
    }
}
