//! Rows of the diffuse final gather by two estimators, balanced, with visibility shared between neighbouring points.
//!
//! Points that see the same surfaces gather together, as *tiles* (`tiles.rs`).
//!
//! - *Hemisphere rays.* Each point of a tile sends `n` cosine-distributed rays, and each hit counts for all points of the
//!   tile, weighted by what the others could have found there: with `G_p = cos_p cos_x / (pi r^2)`, a hit at `x` on a cell of
//!   area `A` adds `G_p(x) / (n sum_q G_q(x)) w(x)` to the row of `p`, where `w = m sum_q G_q A / (m sum_q G_q A + 1)`. Sixteen
//!   points with a hundred rays each gather as by sixteen hundred.
//! - *Form factors.* Every cell's own, `f_p = G_p A`, adds `V_p f_p (1 - w)`. Each tile asks for the visibility of each cell once, by a
//!   ray from a random point of the tile to a random point of the cell; `V_p` is the mean of what the tiles near `p` were told. Of
//!   a cluster of cells that matter little together, one is chosen by its form factor and stands for all (`faint.rs`); so it does of
//!   a cluster that matters more, where no hemisphere ray of the points around found it: most rays would be blocked otherwise.
//!
//! With `m = n` this is the balance heuristic (Veach 1997, section 9.2.2) over the tile's strategies. Here `m` is smaller, as if
//! the tile had sent [`BALANCE`] rays: any weights that add up to one are right on average, and form factors of cells that are
//! small to the eye vary less than one random point a cell would. Near cells, whose form factor says little and would have to
//! be clamped (Hasan 2006, section 4.3), are left to the hits, far and small ones to their form factors.
//!
//! Visibility is shared between points, not between cells. The converse, one ray from each point to a cluster of cells,
//! gives what is visible of the cluster to all its cells alike, the hidden ones too. These are mostly hidden from the lights
//! as well: every row has the right sum, and the image is too dark.

use std::f32::consts::{FRAC_1_PI, GOLDEN_RATIO};
use std::ops::Range;

use glam::Vec3;
use multiversion::multiversion;

use super::faint::{FAINT_CLUSTER, choose_speakers};
use super::form_factors::Patches;
use super::sight::{Answers, Sight};
use super::tiles::{GatherPoint, Spread, TILE, Tiling};
use crate::sample::CellMap;
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, unit};
use crate::trace::{Accel, Hit, Ray};

/// Cells whose form factors are computed together.
pub(super) const CHUNK: usize = 1024;
/// Hemisphere rays that a tile counts as if it had sent, when hits are weighed against form factors. More leave more to the
/// hits, which are noisier; fewer leave cells to form factors that are large enough for these to be wrong.
const BALANCE: f32 = 320.0;
/// Rays that measure how far away a point's surroundings are.
const CLEARANCE_RAYS: u32 = 16;

/// How rows are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowSettings {
    /// Hemisphere rays a point. More leave less noise in rows near corners.
    pub(super) hemisphere_rays: usize,
    /// Points of small tiles send more, until the tile has this many.
    pub(super) tile_rays: usize,
    /// Clusters of cells whose form factors add up to less than this, in the mean over the tile, are answered for by one of
    /// their cells; to less than eight times as much, where rays found none of them. Larger spends fewer rays and leaves more noise.
    pub(super) faint: f32,
    /// Rays along the specular lobe of a point that has one, a quarter in tiles where none is sharp; points of small tiles send more, as
    /// above.
    pub(super) lobe_rays: usize,
    /// What counts as near.
    pub(super) spread: Spread,
}

/// What rows are made of, shared by all threads.
#[derive(Clone, Copy)]
pub(super) struct RowSource<'a> {
    pub(super) accel: &'a Accel,
    pub(super) geometry: &'a Geometry,
    pub(super) map: &'a CellMap,
    pub(super) patches: &'a Patches,
    pub(super) settings: RowSettings,
}

/// Scratch memory of one thread, and what the points of the last block saw.
#[derive(Default)]
pub(super) struct RowScratch {
    pub(super) rays: Vec<Ray>,
    blocked: Vec<bool>,
    pub(super) hits: Vec<Hit>,
    pub(super) tiling: Tiling,
    /// Whether what was found and seen is kept for the glossy rows of the same points.
    pub(super) keep: bool,
    /// Hemisphere hits of all tiles, tile by tile.
    pub(super) found: Vec<Found>,
    /// Where each tile's end, and how many rays each of its points sent.
    pub(super) found_ends: Vec<(usize, usize)>,
    /// Cells that rays of each run of [`TILE`] points hit: a bit a cell, a word a cluster of [`FAINT_CLUSTER`].
    hit_cells: Vec<u64>,
    /// Which cell of the chunk a visibility ray goes to, and what its form factor counts for if it is seen.
    asked: Vec<(u32, f32)>,
    /// Of each of `asked`, the tile that asks.
    askers: Vec<u32>,
    /// Where each tile's end.
    asked_ends: Vec<usize>,
    by_cell: ByCell,
    /// Of each of `asked`, whether it is hidden.
    hidden: Vec<bool>,
    /// Unshadowed form factors of a chunk of cells, a row a point.
    factors: Vec<f32>,
    /// Their sums over the tiles, a row a tile.
    shares: Vec<f32>,
    /// What tiles see: of all chunks if it is kept, else of the chunk at hand.
    answers: Answers,
    pub(super) sight: Sight,
}

/// Visibility rays ordered by the cell that they go to, so that those from tiles side by side to the same cell run side by side.
#[derive(Default)]
struct ByCell {
    /// Places among what was asked.
    order: Vec<u32>,
    /// Where the next ray to each cell of the chunk goes in `order`.
    next: Vec<u32>,
}

impl ByCell {
    fn sort(&mut self, asked: &[(u32, f32)], cells: usize) {
        self.next.clear();
        self.next.resize(cells + 1, 0);
        asked.iter().for_each(|&(cell, _)| self.next[cell as usize + 1] += 1);
        (0..cells).for_each(|cell| self.next[cell + 1] += self.next[cell]);
        self.order.resize(asked.len(), 0);
        for (place, &(cell, _)) in asked.iter().enumerate() {
            let next = &mut self.next[cell as usize];
            self.order[*next as usize] = place as u32;
            *next += 1;
        }
    }
}

/// A cell that a ray hit, and where; of the sky, far away.
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub(super) cell: u32,
    pub(super) position: Vec3,
    /// Unit, towards where the ray came from.
    pub(super) normal: Vec3,
}

impl Found {
    /// `None` where no gather sample stands.
    pub(super) fn new(map: &CellMap, geometry: &Geometry, ray: &Ray, hit: &Hit) -> Option<Self> {
        let cell = map.sample_at(geometry, hit, ray.direction)?;
        if !hit.is_hit() {
            let position = ray.origin + ray.direction * map.sky_distance();
            return Some(Self { cell: cell as u32, position, normal: -ray.direction });
        }
        let area_vector = geometry.area_vector(hit.triangle as usize).normalize_or_zero();
        let normal = if area_vector.dot(ray.direction) > 0.0 { -area_vector } else { area_vector };
        Some(Self { cell: cell as u32, position: ray.origin + ray.direction * hit.t, normal })
    }
}

/// The points of a tile, as structure of arrays.
pub(super) struct Tile<'a> {
    /// Their numbers in the block.
    pub(super) members: &'a [u32],
    pub(super) points: Vec<&'a GatherPoint>,
    pub(super) x: [Vec<f32>; 3],
    /// Shading normals.
    pub(super) n: [Vec<f32>; 3],
}

/// A chunk of cells.
#[derive(Clone, Copy)]
pub(super) struct Chunk {
    number: usize,
    pub(super) first: usize,
    pub(super) width: usize,
}

impl<'a> Tile<'a> {
    pub(super) fn new(points: &'a [GatherPoint], members: &'a [u32]) -> Self {
        let points: Vec<&GatherPoint> = members.iter().map(|&member| &points[member as usize]).collect();
        let axes = |of: &dyn Fn(&GatherPoint) -> Vec3| {
            std::array::from_fn(|axis| points.iter().map(|point| of(point)[axis]).collect())
        };
        Self { members, x: axes(&|point| point.position), n: axes(&|point| point.shading_normal), points }
    }

    /// `m`: what a form factor, added up over the tile, is multiplied by where it is weighed against hits.
    fn balance(&self) -> f32 {
        BALANCE / self.members.len() as f32
    }
}

impl Chunk {
    #[cfg(test)]
    pub(super) fn new(number: usize, first: usize, width: usize) -> Self {
        Self { number, first, width }
    }

    /// Its part of row `row` of a matrix with a column a cell of the chunk.
    pub(super) fn row(self, row: usize) -> Range<usize> {
        row * self.width..(row + 1) * self.width
    }
}

impl RowSource<'_> {
    /// Adds the rows of a block of points that lie close together to `rows`, which has one entry a cell for each of
    /// `points`, zero on entry. Returns the number of rays.
    pub(super) fn block(&self, points: &[GatherPoint], rows: &mut [f32], scratch: &mut RowScratch) -> u64 {
        let clearances = self.clearances(points, scratch);
        let mut rays = scratch.rays.len() as u64;
        let tiling = Tiling::new(points, &clearances, self.settings.spread);
        let tiles: Vec<Tile<'_>> = tiling.tiles.iter().map(|members| Tile::new(points, members)).collect();
        scratch.hit_cells.clear();
        scratch.hit_cells.resize(points.len().div_ceil(TILE) * self.clusters(), 0);
        scratch.found.clear();
        scratch.found_ends.clear();
        scratch.answers.clear();
        for tile in &tiles {
            rays += self.add_hits(tile, rows, scratch);
        }
        for chunk in self.chunks() {
            self.form_factors(points, &tiles, chunk, scratch);
            rays += self.look(&tiles, chunk, points[0].seed, scratch);
            self.add_form_factors(&tiles, &tiling, chunk, rows, scratch);
        }
        drop(tiles);
        scratch.tiling = tiling;
        rays
    }

    /// All cells, in chunks.
    pub(super) fn chunks(&self) -> impl Iterator<Item = Chunk> + use<> {
        let count = self.patches.len();
        (0..count).step_by(CHUNK).enumerate().map(move |(number, first)| Chunk {
            number,
            first,
            width: CHUNK.min(count - first),
        })
    }

    /// The harmonic mean distance of what each point sees, metres.
    fn clearances(&self, points: &[GatherPoint], scratch: &mut RowScratch) -> Vec<f32> {
        scratch.rays.clear();
        for point in points {
            let origin = point.origin();
            scratch.rays.extend((0..CLEARANCE_RAYS).map(|index| {
                Ray::new(
                    origin,
                    cosine_hemisphere(point.geometric_normal, sobol_2d(index, 0, hash(3, point.seed))),
                )
            }));
        }
        scratch.hits.resize(scratch.rays.len(), Hit::MISS);
        self.accel.closest_batch(&scratch.rays, &mut scratch.hits);
        // a ray that meets nothing is infinitely long
        let nearness = |hits: &[Hit]| hits.iter().map(|hit| 1.0 / hit.t.max(1e-6)).sum::<f32>();
        let hits = scratch.hits.chunks_exact(CLEARANCE_RAYS as usize);
        hits.map(|hits| CLEARANCE_RAYS as f32 / nearness(hits)).collect()
    }

    /// The hemisphere rays' share of a tile.
    fn add_hits(&self, tile: &Tile<'_>, rows: &mut [f32], scratch: &mut RowScratch) -> u64 {
        let each = self.rays_each(tile, self.settings.hemisphere_rays);
        scratch.rays.clear();
        for point in &tile.points {
            let origin = point.origin();
            scratch.rays.extend(
                (0..each as u32)
                    .map(|index| cosine_hemisphere(point.shading_normal, sobol_2d(index, 0, point.seed)))
                    .filter(|direction| direction.dot(point.geometric_normal) > 0.0)
                    .map(|direction| Ray::new(origin, direction)),
            );
        }
        scratch.hits.resize(scratch.rays.len(), Hit::MISS);
        self.accel.closest_batch(&scratch.rays, &mut scratch.hits);
        let (count, balance, first_word) = (self.patches.len(), tile.balance(), self.hit_words(tile));
        let mut geometry_terms = [0.0; TILE];
        let terms = &mut geometry_terms[..tile.points.len()];
        for (ray, hit) in scratch.rays.iter().zip(&scratch.hits) {
            let Some(found) = self.found(ray, hit) else { continue };
            if scratch.keep {
                scratch.found.push(found);
            }
            let cell = found.cell as usize;
            scratch.hit_cells[first_word + cell / FAINT_CLUSTER] |= 1 << (cell % FAINT_CLUSTER);
            let total = geometry_factors(tile, found.position, found.normal, terms);
            if total <= 0.0 {
                continue;
            }
            // a cell whose area nothing has seen before has no form factor: the hits count alone
            let area = self.patches.area(cell);
            let by_area = if area > 0.0 { 1.0 / area } else { 0.0 };
            let weight = balance / (each as f32 * (balance * total + by_area));
            for (&member, &term) in tile.members.iter().zip(&*terms) {
                rows[member as usize * count + cell] += weight * term;
            }
        }
        scratch.found_ends.push((scratch.found.len(), each));
        scratch.rays.len() as u64
    }

    /// Clusters of [`FAINT_CLUSTER`] cells.
    fn clusters(&self) -> usize {
        self.patches.len().div_ceil(FAINT_CLUSTER)
    }

    /// Where what the rays of a tile's run of points hit begins among [`RowScratch::hit_cells`].
    fn hit_words(&self, tile: &Tile<'_>) -> usize {
        tile.members[0] as usize / TILE * self.clusters()
    }

    /// The cell that a ray hit.
    pub(super) fn found(&self, ray: &Ray, hit: &Hit) -> Option<Found> {
        Found::new(self.map, self.geometry, ray, hit)
    }

    /// How many rays each point of a tile sends where it sends `least` in the open.
    pub(super) fn rays_each(&self, tile: &Tile<'_>, least: usize) -> usize {
        let of_tile = self.settings.tile_rays.div_ceil(tile.points.len());
        of_tile.clamp(least, 16 * least)
    }

    /// Unshadowed form factors of a chunk of cells, and their sums over the tiles.
    pub(super) fn form_factors(
        &self,
        points: &[GatherPoint],
        tiles: &[Tile<'_>],
        chunk: Chunk,
        scratch: &mut RowScratch,
    ) {
        let RowScratch { factors, shares, .. } = scratch;
        factors.resize(points.len() * chunk.width, 0.0);
        for (point, factors) in points.iter().zip(factors.chunks_exact_mut(chunk.width)) {
            self.patches.form_factors(chunk.first, point.position, point.shading_normal, factors);
        }
        shares.clear();
        shares.resize(tiles.len() * chunk.width, 0.0);
        for (tile, shares) in tiles.iter().zip(shares.chunks_exact_mut(chunk.width)) {
            for &member in tile.members {
                add(shares, &factors[chunk.row(member as usize)]);
            }
        }
    }

    /// Which cells of a chunk the tiles see: one ray for each tile and cell, or for a cluster of cells that matter little to the
    /// tile together.
    fn look(&self, tiles: &[Tile<'_>], chunk: Chunk, block_seed: u32, scratch: &mut RowScratch) -> u64 {
        if !scratch.keep {
            scratch.answers.clear();
        }
        scratch.asked.clear();
        scratch.askers.clear();
        scratch.asked_ends.clear();
        for (number, tile) in tiles.iter().enumerate() {
            self.ask(tile, (number, block_seed), chunk, scratch);
            scratch.askers.resize(scratch.asked.len(), number as u32);
            scratch.asked_ends.push(scratch.asked.len());
        }
        let RowScratch { rays, blocked, hidden, asked, askers, asked_ends, by_cell, factors, .. } = scratch;
        by_cell.sort(asked, chunk.width);
        rays.clear();
        rays.extend(by_cell.order.iter().map(|&place| {
            let (tile, cell) = (askers[place as usize], asked[place as usize].0);
            self.probe(&tiles[tile as usize], chunk, cell as usize, factors)
        }));
        blocked.resize(rays.len(), false);
        self.accel.occluded_batch(rays, blocked);
        hidden.resize(rays.len(), false);
        by_cell.order.iter().zip(&*blocked).for_each(|(&place, &blocked)| hidden[place as usize] = blocked);
        let mut first = 0;
        for &end in &*asked_ends {
            let asked = asked[first..end].iter().zip(&hidden[first..end]);
            scratch.answers.add(asked.filter(|&(_, &hidden)| !hidden).map(|(&asked, _)| asked));
            first = end;
        }
        scratch.rays.len() as u64
    }

    /// Chooses the cells of a chunk that tile `number` asks for.
    fn ask(
        &self,
        tile: &Tile<'_>,
        (number, block_seed): (usize, u32),
        chunk: Chunk,
        scratch: &mut RowScratch,
    ) {
        let shares = &scratch.shares[chunk.row(number)];
        let faint = self.settings.faint * tile.members.len() as f32;
        // near tiles, whose answers a point puts together, mostly follow each other: their draws are spread evenly
        let draw = |cluster: usize| {
            let start = unit(hash((chunk.first + cluster) as u32, hash(9, block_seed)));
            (start + number as f32 * GOLDEN_RATIO).fract()
        };
        debug_assert!(chunk.width.is_power_of_two(), "clouds are powers of four");
        let first_word = self.hit_words(tile) + chunk.first / FAINT_CLUSTER;
        for cluster in (0..chunk.width).step_by(FAINT_CLUSTER) {
            let count = FAINT_CLUSTER.min(chunk.width);
            let hits = scratch.hit_cells[first_word + cluster / FAINT_CLUSTER];
            choose_speakers(shares, (cluster, count), hits, faint, &draw, &mut scratch.asked);
        }
    }

    /// A ray from a random point of the tile, of those that face the cell, to a point of a cell of the chunk.
    fn probe(&self, tile: &Tile<'_>, chunk: Chunk, cell: usize, factors: &[f32]) -> Ray {
        let seed = hash(cell as u32, hash(2, hash(chunk.first as u32, tile.points[0].seed)));
        let count = tile.members.len();
        let start = (unit(hash(1, seed)) * count as f32) as usize;
        let faces = |&point: &usize| factors[chunk.row(tile.members[point] as usize)][cell] > 0.0;
        let point = (start..count).chain(0..count).find(faces).unwrap_or(0);
        let target = self.patches.target(chunk.first + cell, hash(2, seed));
        Ray::between(tile.points[point].origin(), target)
    }

    /// The form factors' share of a chunk.
    fn add_form_factors(
        &self,
        tiles: &[Tile<'_>],
        tiling: &Tiling,
        chunk: Chunk,
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) {
        for (number, tile) in tiles.iter().enumerate() {
            scratch.gather_sight(tiling, chunk, tile.members);
            for &member in tile.members {
                scratch.see(tiling, chunk, member as usize);
                let row = &mut rows[member as usize * self.patches.len() + chunk.first..][..chunk.width];
                scratch.sight.add_balanced(row, scratch.shares(chunk, number), tile.balance());
            }
        }
    }
}

impl RowScratch {
    /// What it takes, bytes.
    pub(super) fn bytes(&self) -> usize {
        fn of<T>(values: &Vec<T>) -> usize {
            values.capacity() * size_of::<T>()
        }
        of(&self.rays)
            + of(&self.blocked)
            + of(&self.hits)
            + self.tiling.near.iter().map(of).sum::<usize>()
            + of(&self.found)
            + of(&self.found_ends)
            + of(&self.hit_cells)
            + of(&self.asked)
            + of(&self.askers)
            + of(&self.asked_ends)
            + of(&self.hidden)
            + of(&self.by_cell.order)
            + of(&self.by_cell.next)
            + of(&self.factors)
            + of(&self.shares)
            + self.answers.bytes()
            + self.sight.bytes()
    }

    /// Gathers the cells of a chunk, whose form factors are at hand, that the tiles near a tile's points see.
    pub(super) fn gather_sight(&mut self, tiling: &Tiling, chunk: Chunk, members: &[u32]) {
        let first = self.first_answer(tiling, chunk);
        self.sight.gather(tiling, members, chunk, (&self.answers, first), &self.shares);
    }

    /// What the tiles near a point told of these cells: visibility from the point.
    pub(super) fn see(&mut self, tiling: &Tiling, chunk: Chunk, member: usize) {
        let first = self.first_answer(tiling, chunk);
        self.sight.see(&tiling.near[member], (&self.answers, first), &self.factors[chunk.row(member)]);
    }

    /// Where the answers of a chunk's tiles begin.
    fn first_answer(&self, tiling: &Tiling, chunk: Chunk) -> usize {
        if self.keep { chunk.number * tiling.tiles.len() } else { 0 }
    }

    /// Unshadowed form factors added up over a tile, of the chunk at hand.
    pub(super) fn shares(&self, chunk: Chunk, tile: usize) -> &[f32] {
        &self.shares[chunk.row(tile)]
    }
}

/// `G_p = cos_p cos_x / (pi r^2)` between every point of the tile and a point `x` with a normal; returns their sum.
fn geometry_factors(tile: &Tile<'_>, x: Vec3, normal: Vec3, out: &mut [f32]) -> f32 {
    geometry_factors_of(
        [&tile.x[0], &tile.x[1], &tile.x[2]],
        [&tile.n[0], &tile.n[1], &tile.n[2]],
        x.to_array(),
        (normal * FRAC_1_PI).to_array(),
        out,
    );
    out.iter().sum()
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn geometry_factors_of(p: [&[f32]; 3], n: [&[f32]; 3], x: [f32; 3], normal: [f32; 3], out: &mut [f32]) {
    let count = out.len();
    let [px, py, pz] = p.map(|axis| &axis[..count]);
    let [nx, ny, nz] = n.map(|axis| &axis[..count]);
    for i in 0..count {
        let (dx, dy, dz) = (x[0] - px[i], x[1] - py[i], x[2] - pz[i]);
        let square = dx * dx + dy * dy + dz * dz + 1e-12;
        let cos_point = dx * nx[i] + dy * ny[i] + dz * nz[i];
        let cos_hit = -(dx * normal[0] + dy * normal[1] + dz * normal[2]);
        let above = if cos_point > 0.0 { cos_point } else { 0.0 };
        let facing = if cos_hit > 0.0 { cos_hit } else { 0.0 };
        let inverse = 1.0 / square;
        out[i] = (above * inverse) * (facing * inverse);
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn add(sums: &mut [f32], values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
    }
}

#[cfg(test)]
#[path = "rows_tests.rs"]
mod tests;
