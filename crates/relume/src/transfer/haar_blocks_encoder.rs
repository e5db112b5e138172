//! From rows to the images of wavelet lights: the encoder of [`haar_blocks`](super::haar_blocks).

use rayon::prelude::*;

use super::ImageLayout;
use super::atlas::Packing;
use super::haar_blocks::{ATLAS, HaarBlocks, ImageBlock, TILE};
use super::rectangles::{self, Entry, Rectangle};
use super::selection::KeptRows;

/// One kept coefficient of one row on its way into a tile.
#[derive(Clone, Copy)]
struct Spot {
    coefficient: u32,
    entry: Entry,
    /// How much the row counts in the expected error.
    weight: f64,
}

/// A tile's blocks before they are packed.
#[derive(Default)]
struct EncodedTile {
    blocks: Vec<ImageBlock>,
    /// Of one block after the other, line by line.
    texels: Vec<u8>,
    /// What quantisation loses of the rows, squared and weighted.
    lost: f64,
}

impl HaarBlocks {
    /// Regroups rows by wavelet light. Also returns what 8 bits lose of them: the sum of squares, weighted as the rows are.
    pub(super) fn encode(rows: &[KeptRows], layout: ImageLayout) -> (Self, f64) {
        let across = layout.width.div_ceil(TILE);
        let mut tiles = vec![Vec::new(); across * layout.height.div_ceil(TILE)];
        let all = rows.iter().flat_map(|rows| rows.rows().map(|row| (row, rows.weight)));
        for (((indices, values, _), weight), &place) in all.zip(layout.places.iter()) {
            let (line, column) = (place as usize / layout.width, place as usize % layout.width);
            let tile = &mut tiles[line / TILE * across + column / TILE];
            let (x, y) = ((column % TILE) as u8, (line % TILE) as u8);
            let kept = indices.iter().zip(values).filter(|(_, value)| **value != 0.0);
            tile.extend(kept.map(|(&coefficient, &value)| Spot {
                coefficient,
                entry: Entry { x, y, value },
                weight,
            }));
        }
        let encoded: Vec<EncodedTile> = tiles.into_par_iter().with_max_len(1).map(EncodedTile::of).collect();
        let lost = encoded.iter().map(|tile| tile.lost).sum();
        (Self::packed(encoded, layout), lost)
    }

    fn packed(encoded: Vec<EncodedTile>, layout: ImageLayout) -> Self {
        let size = |block: &ImageBlock| [usize::from(block.width), usize::from(block.height)];
        let sizes: Vec<_> = encoded.iter().flat_map(|tile| tile.blocks.iter().map(size)).collect();
        let Packing { places, lines } = Packing::of(&sizes);
        let mut texels = vec![0; lines * ATLAS];
        let mut places = places.into_iter();
        let mut blocks = Vec::with_capacity(sizes.len());
        let tiles: Vec<u32> = encoded.iter().map(|tile| tile.blocks.len() as u32).collect();
        for tile in encoded {
            let mut rest = &tile.texels[..];
            for (mut block, place) in tile.blocks.into_iter().zip(places.by_ref()) {
                (block.atlas, block.column, block.line) = (place.atlas, place.column, place.line);
                for line in 0..usize::from(block.height) {
                    let (texels_of_line, after) = rest.split_at(usize::from(block.width));
                    rest = after;
                    texels[block.start(line)..][..texels_of_line.len()].copy_from_slice(texels_of_line);
                }
                blocks.push(block);
            }
        }
        Self { layout, tiles: tiles.into(), blocks: blocks.into(), texels: texels.into() }
    }
}

impl EncodedTile {
    fn of(mut spots: Vec<Spot>) -> Self {
        // by place within a coefficient, so that the order of rows leaves no trace
        spots.sort_unstable_by_key(|spot| (spot.coefficient, spot.entry.y, spot.entry.x));
        let mut tile = Self::default();
        let mut weights = vec![0.0; TILE * TILE];
        for light in spots.chunk_by(|a, b| a.coefficient == b.coefficient) {
            for spot in light {
                weights[spot.entry.place()] = spot.weight;
            }
            let mut entries: Vec<Entry> = light.iter().map(|spot| spot.entry).collect();
            for (rectangle, entries) in rectangles::cut(&mut entries, size_of::<ImageBlock>()) {
                tile.add(light[0].coefficient, rectangle, &entries, &weights);
            }
        }
        tile
    }

    fn add(&mut self, coefficient: u32, rectangle: Rectangle, entries: &[Entry], weights: &[f64]) {
        let [x, y] = rectangle.low;
        let (width, height) = (rectangle.width(), rectangle.height());
        let (low, high) = entries.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), entry| {
            (low.min(entry.value), high.max(entry.value))
        });
        let levels = Levels::new(low, high, entries.len() < width * height);
        let before = self.texels.len();
        self.texels.resize(before + width * height, levels.nearest(0.0));
        for entry in entries {
            let q = levels.nearest(entry.value);
            self.texels[before + usize::from(entry.y - y) * width + usize::from(entry.x - x)] = q;
            self.lost += weights[entry.place()] * f64::from(entry.value - levels.value(q)).powi(2);
        }
        self.blocks.push(ImageBlock {
            coefficient,
            x,
            y,
            width: width as u8,
            height: height as u8,
            scale: levels.scale,
            offset: levels.offset,
            ..ImageBlock::default()
        });
    }
}

impl Entry {
    /// Its number in a tile, line by line.
    fn place(&self) -> usize {
        usize::from(self.y) * TILE + usize::from(self.x)
    }
}

/// What the texels of a block stand for.
#[derive(Debug)]
struct Levels {
    scale: f32,
    offset: f32,
}

impl Levels {
    /// 256 levels from `low` to `high`, one of which is zero where `with_zero`.
    fn new(low: f32, high: f32, with_zero: bool) -> Self {
        if !with_zero {
            return Self { scale: (high - low) / 255.0, offset: low };
        }
        let (low, high) = (low.min(0.0), high.max(0.0));
        // of the 255 steps as many below zero as that takes, rounded to whole ones, and a scale that reaches both ends
        let below = (255.0 * -low / (high - low).max(f32::MIN_POSITIVE)).round();
        let reach = |end: f32, steps: f32| if steps > 0.0 { end / steps } else { 0.0 };
        let scale = reach(-low, below).max(reach(high, 255.0 - below));
        Self { scale, offset: -(below * scale) }
    }

    fn nearest(&self, value: f32) -> u8 {
        if self.scale > 0.0 {
            ((value - self.offset) / self.scale).round().clamp(0.0, 255.0) as u8
        } else {
            0
        }
    }

    fn value(&self, q: u8) -> f32 {
        f32::from(q) * self.scale + self.offset
    }
}

#[cfg(test)]
#[path = "haar_blocks_tests.rs"]
mod tests;
