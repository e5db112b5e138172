//! `haar-blocks`: the paper's image-based encoding, for comparison.
//!
//! Each row keeps its most important Haar coefficients, as in [`haar_rows`](super::haar_rows). They are stored the other way
//! round: for each coefficient, which stands for a *wavelet light*, the image of what that light does (Hasan 2006, section 3.5).
//! The non-zero parts of the images are cut into rectangles, of 8 bits with a scale and an offset each, and packed into
//! atlases (section 4.4). Applied, each rectangle is drawn with the light's intensity and added up, or left out as a whole where
//! that is faint. How rows are regrouped is in `haar_blocks_encoder.rs`; here they are kept and applied.
//!
//! Where this deviates: rectangles do not reach past tiles of the image, so that tiles are summed side by side, each in one order; and
//! where there are zeros in a rectangle, zero is one of its 256 levels.

use glam::{Vec3, Vec4};
use multiversion::multiversion;
use rayon::prelude::*;

use super::culling::{Cut, Norms, Work, energy};
use super::{Buffer, Coefficients, ImageLayout, rectangles};

/// Side of an atlas, texels.
pub const ATLAS: usize = 4096;
/// Side of a tile, places.
pub const TILE: usize = rectangles::SIDE;

/// A rectangle of one wavelet light's image.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ImageBlock {
    /// The wavelet light: which Haar coefficient.
    pub coefficient: u32,
    /// First column in the tile.
    pub x: u8,
    /// First line in the tile.
    pub y: u8,
    /// Columns, 1 to [`TILE`].
    pub width: u8,
    /// Lines, 1 to [`TILE`].
    pub height: u8,
    /// Where it lies: which atlas,
    pub atlas: u32,
    /// its first column there,
    pub column: u16,
    /// and its first line there.
    pub line: u16,
    /// A texel `q` stands for `q * scale + offset`.
    pub scale: f32,
    /// See `scale`.
    pub offset: f32,
}

/// All blocks of one operator.
#[derive(Clone, Debug, Default)]
pub struct HaarBlocks {
    /// Where the rows lie in the image.
    pub layout: ImageLayout,
    /// Blocks of each tile, tiles line by line.
    pub tiles: Buffer<u32>,
    /// Tile by tile, in each by coefficient.
    pub blocks: Buffer<ImageBlock>,
    /// The atlases, one below the other, [`ATLAS`] texels a line; the last ends where it is empty.
    pub texels: Buffer<u8>,
}

impl HaarBlocks {
    /// Bytes of all arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.layout.places)
            + size_of_val(&*self.tiles)
            + size_of_val(&*self.blocks)
            + self.texels.len()
    }

    /// Texels that belong to a block; the others of the atlases are empty.
    pub fn used_texels(&self) -> usize {
        self.blocks.iter().map(ImageBlock::area).sum()
    }

    /// Those of them that stand for zero.
    pub fn zeros(&self) -> usize {
        let of_block = |block: &ImageBlock| {
            let is_zero = |&&q: &&u8| block.value(q).abs() < 1e-5 * block.scale;
            (0..usize::from(block.height)).flat_map(|line| self.line(block, line)).filter(is_zero).count()
        };
        self.blocks.iter().map(of_block).sum()
    }

    /// Atlases.
    pub fn atlases(&self) -> usize {
        self.texels.len().div_ceil(ATLAS * ATLAS)
    }

    /// Whether all parts fit together, the rows and a cloud of `count` samples.
    pub(super) fn is_sound(&self, rows: usize, count: usize) -> bool {
        let across = self.layout.width.div_ceil(TILE);
        let tiles = across.checked_mul(self.layout.height.div_ceil(TILE));
        let fits = |block: &ImageBlock| {
            let [x, y, width, height] = [block.x, block.y, block.width, block.height].map(usize::from);
            (block.coefficient as usize) < count
                && width > 0
                && height > 0
                && x + width <= TILE
                && y + height <= TILE
                && usize::from(block.column) + width <= ATLAS
                && usize::from(block.line) + height <= ATLAS
                && block.end() <= self.texels.len() as u64
                && block.scale.is_finite()
                && block.offset.is_finite()
        };
        self.layout.is_sound(rows)
            && tiles == Some(self.tiles.len())
            && self.tiles.iter().map(|&blocks| u64::from(blocks)).sum::<u64>() == self.blocks.len() as u64
            && self.blocks.iter().all(fits)
    }

    /// The parts are blocks.
    pub(super) fn norms(&self, count: usize) -> Norms {
        let square = |block: &ImageBlock| -> f32 {
            let texels = (0..usize::from(block.height)).flat_map(|line| self.line(block, line));
            texels.map(|&q| f64::from(block.value(q)).powi(2)).sum::<f64>() as f32
        };
        let parts: Vec<f32> = self.blocks.par_iter().with_min_len(256).map(square).collect();
        let mut columns = vec![0.0; count];
        for (block, &square) in self.blocks.iter().zip(&parts) {
            columns[block.coefficient as usize] += f64::from(square);
        }
        Norms::new(columns, parts)
    }

    fn line(&self, block: &ImageBlock, line: usize) -> &[u8] {
        &self.texels[block.start(line)..][..usize::from(block.width)]
    }

    /// `out = F g`, for all rows, from the coefficients `W g`, without the blocks that `cut` calls faint.
    pub(super) fn apply(&self, coefficients: &Coefficients, cut: Option<Cut<'_>>, out: &mut [Vec3]) -> Work {
        let mut first = 0;
        let tiles: Vec<_> = self
            .tiles
            .iter()
            .map(|&blocks| {
                first += blocks as usize;
                first - blocks as usize..first
            })
            .collect();
        let drawn: Vec<(Vec<Vec4>, Work)> = tiles
            .into_par_iter()
            .with_max_len(1)
            .map(|blocks| self.tile(blocks, coefficients, cut))
            .collect();
        let across = self.layout.width.div_ceil(TILE);
        out.par_iter_mut().zip(&self.layout.places[..]).with_min_len(4096).for_each(|(out, &place)| {
            let (line, column) = (place as usize / self.layout.width, place as usize % self.layout.width);
            let tile = &drawn[line / TILE * across + column / TILE].0;
            *out = tile.get(line % TILE * TILE + column % TILE).map_or(Vec3::ZERO, |sum| sum.truncate());
        });
        drawn.iter().map(|(_, work)| *work).sum()
    }

    /// The sum of a tile's blocks; nothing where it has none.
    fn tile(
        &self,
        blocks: std::ops::Range<usize>,
        coefficients: &Coefficients,
        cut: Option<Cut<'_>>,
    ) -> (Vec<Vec4>, Work) {
        let mut work = Work::default();
        if blocks.is_empty() {
            return (Vec::new(), work);
        }
        let mut sums = vec![Vec4::ZERO; TILE * TILE];
        for number in blocks {
            let block = &self.blocks[number];
            let light = coefficients.at(block.coefficient as usize);
            let is_faint = cut.is_some_and(|cut| cut.is_faint(number, energy(light)));
            work.count(block.area() as u64, is_faint);
            if !is_faint {
                draw(&mut sums, block, &self.texels[block.start(0)..], Vec3::from(light).extend(0.0));
            }
        }
        (sums, work)
    }
}

/// Adds a block, whose texels begin with `texels`, to the sums of its tile.
#[multiversion(targets("x86_64+avx2+fma"))]
fn draw(sums: &mut [Vec4], block: &ImageBlock, texels: &[u8], light: Vec4) {
    let (scale, offset) = (light * block.scale, light * block.offset);
    let (width, first) = (usize::from(block.width), usize::from(block.y) * TILE + usize::from(block.x));
    for line in 0..usize::from(block.height) {
        let sums = &mut sums[first + line * TILE..][..width];
        for (sum, &q) in sums.iter_mut().zip(&texels[line * ATLAS..][..width]) {
            *sum += scale * f32::from(q) + offset;
        }
    }
}

impl ImageBlock {
    /// Texels.
    pub fn area(&self) -> usize {
        usize::from(self.width) * usize::from(self.height)
    }

    /// What a texel stands for.
    fn value(&self, q: u8) -> f32 {
        f32::from(q) * self.scale + self.offset
    }

    /// The first texel of one of its lines.
    pub(super) fn start(&self, line: usize) -> usize {
        (self.atlas as usize * ATLAS + usize::from(self.line) + line) * ATLAS + usize::from(self.column)
    }

    /// The texel after its last one.
    fn end(&self) -> u64 {
        let last = u64::from(self.atlas) * ATLAS as u64 + u64::from(self.line) + u64::from(self.height) - 1;
        last * ATLAS as u64 + u64::from(self.column) + u64::from(self.width)
    }
}
