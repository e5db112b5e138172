//! Cutting the non-zero parts of an image into rectangles (Hasan 2006, section 4.4).
//!
//! The tightest rectangle round all of them is cut in two where that leaves the least waste, and so on. The paper stops where a
//! rectangle's waste falls below a threshold; here a cut must also save more than the record of one more rectangle takes.

/// Share of zeros up to which a rectangle is not cut.
///
/// Less makes more and smaller rectangles, with fewer zeros and more records.
pub(super) const WASTE: f64 = 0.1;

/// Most columns and lines of an image that is cut.
pub(super) const SIDE: usize = 64;

/// A non-zero entry of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Entry {
    /// Column, below [`SIDE`].
    pub(super) x: u8,
    /// Line, below [`SIDE`].
    pub(super) y: u8,
    /// Its value.
    pub(super) value: f32,
}

/// Part of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rectangle {
    /// First column and line.
    pub(super) low: [u8; 2],
    /// Last column and line.
    pub(super) high: [u8; 2],
}

impl Rectangle {
    const EMPTY: Self = Self { low: [u8::MAX; 2], high: [0; 2] };

    fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    fn including(mut self, at: [u8; 2]) -> Self {
        for axis in 0..2 {
            self.low[axis] = self.low[axis].min(at[axis]);
            self.high[axis] = self.high[axis].max(at[axis]);
        }
        self
    }

    fn around(entries: &[Entry]) -> Self {
        entries.iter().fold(Self::EMPTY, |all, entry| all.including([entry.x, entry.y]))
    }

    fn and(self, other: Self) -> Self {
        if other.is_empty() { self } else { self.including(other.low).including(other.high) }
    }

    /// Columns.
    pub(super) fn width(&self) -> usize {
        usize::from(self.high[0] - self.low[0]) + 1
    }

    /// Lines.
    pub(super) fn height(&self) -> usize {
        usize::from(self.high[1] - self.low[1]) + 1
    }

    fn area(&self) -> usize {
        if self.is_empty() { 0 } else { self.width() * self.height() }
    }
}

/// Cuts `entries`, no two at one place, into rectangles, each with those that it holds; every entry is in exactly one. `record` is
/// what a rectangle costs by itself, in the area that it could have instead. Entries come out in another order.
pub(super) fn cut(entries: &mut [Entry], record: usize) -> Vec<(Rectangle, Vec<Entry>)> {
    let mut rectangles = Vec::new();
    if !entries.is_empty() {
        cut_further(Rectangle::around(entries), entries, record, &mut rectangles);
    }
    rectangles
}

/// Adds the rectangles of `entries`, which fill `bounds` tightly; returns their area and records together.
fn cut_further(
    bounds: Rectangle,
    entries: &mut [Entry],
    record: usize,
    rectangles: &mut Vec<(Rectangle, Vec<Entry>)>,
) -> usize {
    let whole = bounds.area() + record;
    let waste = bounds.area() - entries.len();
    // without any waste two would still take a record more
    if waste as f64 > WASTE * bounds.area() as f64 && waste > record {
        let before = rectangles.len();
        let (axis, place) = best_cut(bounds, entries);
        let at = |entry: &Entry| [entry.x, entry.y][axis];
        entries.sort_unstable_by_key(|entry| (at(entry) >= place, entry.y, entry.x));
        let (first, second) = entries.split_at_mut(entries.partition_point(|entry| at(entry) < place));
        let mut parts = 0;
        for part in [first, second] {
            parts += cut_further(Rectangle::around(part), part, record, rectangles);
        }
        if parts < whole {
            return parts;
        }
        rectangles.truncate(before);
    }
    rectangles.push((bounds, entries.to_vec()));
    whole
}

/// The axis and the first column or line after the cut that leaves the least area.
fn best_cut(bounds: Rectangle, entries: &[Entry]) -> (usize, u8) {
    let mut best = (usize::MAX, 0, 0);
    for axis in 0..2 {
        let low = bounds.low[axis];
        let mut lines = [Rectangle::EMPTY; SIDE];
        for entry in entries {
            let at = [entry.x, entry.y];
            let line = &mut lines[usize::from(at[axis] - low)];
            *line = line.including(at);
        }
        let lines = &lines[..usize::from(bounds.high[axis] - low) + 1];
        let mut after = [0; SIDE];
        let mut rest = Rectangle::EMPTY;
        for (place, line) in lines.iter().enumerate().rev() {
            rest = rest.and(*line);
            after[place] = rest.area();
        }
        let mut first = Rectangle::EMPTY;
        for (place, line) in lines.iter().enumerate().skip(1) {
            first = first.and(lines[place - 1]);
            if first.area() + after[place] < best.0 && !line.is_empty() {
                best = (first.area() + after[place], axis, low + place as u8);
            }
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    const RECORD: usize = 24;

    /// Entries of a 64x64 image where `is_there`.
    fn entries(is_there: impl Fn(u8, u8) -> bool) -> Vec<Entry> {
        let all = (0..64).flat_map(|y| (0..64).map(move |x| (x, y)));
        all.filter(|&(x, y)| is_there(x, y))
            .map(|(x, y)| Entry { x, y, value: 1.0 + f32::from(x) + 64.0 * f32::from(y) })
            .collect()
    }

    fn noise(share: f32) -> impl Fn(u8, u8) -> bool {
        move |x, y| unit(hash(u32::from(x) + 64 * u32::from(y), 5)) < share
    }

    /// How many rectangles hold each place.
    fn cover(rectangles: &[(Rectangle, Vec<Entry>)]) -> Vec<u32> {
        let mut cover = vec![0; 64 * 64];
        for (rectangle, _) in rectangles {
            for y in rectangle.low[1]..=rectangle.high[1] {
                for x in rectangle.low[0]..=rectangle.high[0] {
                    cover[usize::from(y) * 64 + usize::from(x)] += 1;
                }
            }
        }
        cover
    }

    #[test]
    fn every_entry_is_in_exactly_one_rectangle() {
        let disc = |x: u8, y: u8| (i32::from(x) - 20).pow(2) + (i32::from(y) - 30).pow(2) < 300;
        let diagonal = |x: u8, y: u8| x.abs_diff(y) < 2;
        let shapes: [&dyn Fn(u8, u8) -> bool; 6] =
            [&disc, &diagonal, &noise(0.02), &noise(0.5), &|_, _| true, &|x, y| (x, y) == (63, 63)];
        for (number, shape) in shapes.iter().enumerate() {
            let given = entries(shape);
            let cut = cut(&mut given.clone(), RECORD);
            let mut held: Vec<Entry> = cut.iter().flat_map(|(_, entries)| entries.iter().copied()).collect();
            held.sort_by_key(|entry| (entry.y, entry.x));
            assert_eq!(held, given, "shape {number}");
            let cover = cover(&cut);
            assert!(
                given.iter().all(|e| cover[usize::from(e.y) * 64 + usize::from(e.x)] == 1),
                "shape {number}"
            );
            for (rectangle, entries) in &cut {
                assert_eq!(*rectangle, Rectangle::around(entries), "shape {number}: each is tight");
            }
        }
        assert!(cut(&mut [], RECORD).is_empty());
    }

    #[test]
    fn a_cut_saves_more_than_it_costs() {
        let cost =
            |cut: &[(Rectangle, Vec<Entry>)]| -> usize { cut.iter().map(|(r, _)| r.area() + RECORD).sum() };
        // two squares far apart are two rectangles; two that nearly touch are one
        let far = cut(&mut entries(|x, y| (x < 10 && y < 10) || (x > 50 && y > 50)), RECORD);
        assert_eq!((far.len(), cost(&far)), (2, 100 + 13 * 13 + 2 * RECORD));
        let near = cut(&mut entries(|x, y| (x < 4 || (5..9).contains(&x)) && y < 10), RECORD);
        assert_eq!((near.len(), cost(&near)), (1, 90 + RECORD));
        // scattered entries lie nearly alone, where a rectangle costs nothing
        let mut scattered = entries(noise(0.02));
        let alone = cut(&mut scattered.clone(), 0);
        let area: usize = alone.iter().map(|(rectangle, _)| rectangle.area()).sum();
        assert!(
            (1.0 - WASTE) * area as f64 <= scattered.len() as f64 && 10 * alone.len() > 9 * scattered.len()
        );
        let few = cut(&mut scattered, RECORD);
        assert!(2 * few.len() < alone.len() && cost(&few) < cost(&alone), "{} {}", few.len(), alone.len());
    }
}
