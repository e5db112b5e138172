//! What the tiles of a block were told of the cells that they asked for, and what a point makes of the answers of the tiles near it.
//!
//! Of a chunk of cells a tile sees few, and those that none of the near tiles sees add nothing to a row. So a tile first gathers the cells
//! that matter to it, and its points go through these alone.

use multiversion::multiversion;

use super::rows::Chunk;
use super::tiles::Tiling;

/// What the tiles of a block see, chunk after chunk.
#[derive(Default)]
pub(super) struct Answers {
    /// Cells of a chunk, numbered within it, that tiles see, tile by tile; more than one for a cell that stands for others.
    seen: Vec<(u32, f32)>,
    /// Where each tile's end.
    ends: Vec<usize>,
}

impl Answers {
    pub(super) fn clear(&mut self) {
        self.seen.clear();
        self.ends.clear();
    }

    /// Adds those of the next tile.
    pub(super) fn add(&mut self, seen: impl Iterator<Item = (u32, f32)>) {
        self.seen.extend(seen);
        self.ends.push(self.seen.len());
    }

    /// What the `place`th tile sees, of all tiles that were added.
    fn of(&self, place: usize) -> &[(u32, f32)] {
        &self.seen[place.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[place]]
    }

    /// What they take, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.seen.capacity() * size_of::<(u32, f32)>() + self.ends.capacity() * size_of::<usize>()
    }
}

/// The cells of a chunk that the tiles near a tile see, and one of its points' view of them.
#[derive(Default)]
pub(super) struct Sight {
    /// Ascending, numbered within the chunk.
    pub(super) cells: Vec<u32>,
    /// For each cell of the chunk its place among `cells`.
    places: Vec<u32>,
    /// The tiles near any of the points, ascending.
    near: Vec<u32>,
    /// Their form factors towards `cells`, added up over each of them, a row a tile.
    shares: Vec<f32>,
    /// The point's own.
    factors: Vec<f32>,
    /// Visibility from the point, times what it is divided by:
    visible: Vec<f32>,
    /// the weight of the tiles that were asked.
    told: Vec<f32>,
}

/// Of no cell of the chunk at hand.
const NOWHERE: u32 = u32::MAX;

impl Sight {
    /// What it takes, bytes.
    pub(super) fn bytes(&self) -> usize {
        let integers = [&self.cells, &self.places, &self.near].map(Vec::capacity);
        let floats = [&self.shares, &self.factors, &self.visible, &self.told].map(Vec::capacity);
        size_of::<f32>() * integers.iter().chain(&floats).sum::<usize>()
    }

    /// Gathers the cells of a chunk that matter to a tile, of whose points `members` are the numbers. The answers of the chunk's first tile
    /// stand at place `first`; `shares` are form factors added up over each tile.
    pub(super) fn gather(
        &mut self,
        tiling: &Tiling,
        members: &[u32],
        chunk: Chunk,
        (answers, first): (&Answers, usize),
        shares: &[f32],
    ) {
        let Self { cells, places, near, shares: compact, .. } = self;
        near.clear();
        near.extend(
            members.iter().flat_map(|&member| tiling.near[member as usize].iter().map(|near| near.0)),
        );
        near.sort_unstable();
        near.dedup();
        cells.iter().for_each(|&cell| places[cell as usize] = NOWHERE);
        places.resize(chunk.width, NOWHERE);
        cells.clear();
        for &(cell, _) in near.iter().flat_map(|&tile| answers.of(first + tile as usize)) {
            if places[cell as usize] == NOWHERE {
                places[cell as usize] = 0;
                cells.push(cell);
            }
        }
        cells.sort_unstable();
        cells.iter().enumerate().for_each(|(place, &cell)| places[cell as usize] = place as u32);
        compact.clear();
        for &tile in &*near {
            let shares = &shares[chunk.row(tile as usize)];
            compact.extend(cells.iter().map(|&cell| shares[cell as usize]));
        }
    }

    /// What the tiles near a point, with their weights, were told of the cells that were gathered. `factors` are the point's form factors.
    pub(super) fn see(&mut self, near: &[(u32, f32)], (answers, first): (&Answers, usize), factors: &[f32]) {
        let Self { cells, places, near: tiles, shares, factors: compact, visible, told } = self;
        let count = cells.len();
        compact.clear();
        compact.extend(cells.iter().map(|&cell| factors[cell as usize]));
        for values in [&mut *visible, &mut *told] {
            values.clear();
            values.resize(count, 0.0);
        }
        for &(tile, weight) in near {
            let row = tiles.partition_point(|&before| before < tile);
            let shares = &shares[row * count..(row + 1) * count];
            add_where_asked(told, compact, shares, weight);
            for &(cell, counts) in answers.of(first + tile as usize) {
                let place = places[cell as usize] as usize;
                if is_asked(compact[place], shares[place]) {
                    visible[place] += weight * counts;
                }
            }
        }
    }

    /// Of each of `cells` that the point sees: its place among them, its number, and how much of it is visible.
    pub(super) fn seen(&self) -> impl Iterator<Item = (usize, usize, f32)> + '_ {
        let visible = self.visible.iter().zip(&self.told).zip(&self.cells).enumerate();
        // a cell that was not asked for is not seen
        visible
            .filter(|(_, ((visible, _), _))| **visible > 0.0)
            .map(|(place, ((visible, told), &cell))| (place, cell as usize, visible / told))
    }

    /// Adds the form factors' share of a tile to the row of the point, of which this is what it sees: `row += V f / (m sum f + 1)`. `shares` are form
    /// factors added up over the tile, and `balance` is `m`.
    pub(super) fn add_balanced(&self, row: &mut [f32], shares: &[f32], balance: f32) {
        for (place, cell, visible) in self.seen() {
            row[cell] += visible * self.factors[place] / (balance * shares[cell] + 1.0);
        }
    }
}

/// Whether a point with form factor `factor` takes a tile's answer for a cell whose form factors add up to `share` over the
/// tile. A tile that faces away from the cell has not asked; one that sees it edge-on has asked rarely, and a point would
/// make much of it.
fn is_asked(factor: f32, share: f32) -> bool {
    share >= 0.5 * factor
}

/// Adds `weight` where [`is_asked`].
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_where_asked(sums: &mut [f32], factors: &[f32], shares: &[f32], weight: f32) {
    let count = sums.len();
    let (factors, shares) = (&factors[..count], &shares[..count]);
    for i in 0..count {
        sums[i] += if is_asked(factors[i], shares[i]) { weight } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_that_faces_away_from_a_cell_says_nothing_of_it() {
        let (factors, asked, away) = (vec![1e-3; 4], vec![1e-3, 6e-4, 4e-4, 2e-3], vec![0.0; 4]);
        let mut told = vec![0.0; 4];
        add_where_asked(&mut told, &factors, &asked, 0.75);
        add_where_asked(&mut told, &factors, &away, 0.25);
        assert_eq!(told, [0.75, 0.75, 0.0, 0.75]);
    }

    /// Two tiles of a point each, of which the second is near the first one's point.
    fn tiling() -> Tiling {
        Tiling { tiles: vec![vec![0], vec![1]], near: vec![vec![(1, 0.25), (0, 0.75)], vec![(1, 1.0)]] }
    }

    #[test]
    fn a_point_takes_the_mean_of_what_the_tiles_near_it_see() {
        let chunk = Chunk::new(0, 0, 4);
        let mut answers = Answers::default();
        answers.add([(0, 1.0), (1, 1.0), (3, 2.0)].into_iter());
        answers.add([(3, 1.0), (0, 1.0)].into_iter());
        let factors = [1e-3; 4];
        // the second tile sees the first cell edge-on, so that the first point takes the first tile's word alone
        let shares = [1e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-3, 1e-3, 1e-3];
        let (tiling, mut sight) = (tiling(), Sight::default());
        let mut rows = [[0.0; 4]; 2];
        for (member, row) in rows.iter_mut().enumerate() {
            sight.gather(&tiling, &[member as u32], chunk, (&answers, 0), &shares);
            sight.see(&tiling.near[member], (&answers, 0), &factors);
            sight.add_balanced(row, &shares[chunk.row(member)], 0.0);
        }
        assert_eq!(rows[0], [1e-3, 0.75e-3, 0.0, 1.75e-3]);
        assert_eq!(rows[1], [0.0, 0.0, 0.0, 1e-3]);
        // of a hit and a form factor that are balanced, each gets its part
        let mut row = [0.0; 4];
        sight.add_balanced(&mut row, &[0.0, 0.0, 0.0, 2e-3], 500.0);
        assert_eq!(row[3], 0.5e-3);
    }
}
