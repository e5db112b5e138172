//! Rows of the diffuse final gather by two estimators, balanced, with visibility shared between neighbouring points.
//!
//! Points that face alike and lie close together, beside the distance of what surrounds them, see the same surfaces: a *tile* of
//! them gathers together. In the open a tile is large; in a corner every point may gather for itself.
//!
//! - *Hemisphere rays.* Each point of a tile sends `n` cosine-distributed rays, and each hit counts for all points of the
//!   tile, weighted by what the others could have found there: with `G_p = cos_p cos_x / (pi r^2)`, a hit at `x` on a cell of
//!   area `A` adds `G_p(x) / (n sum_q G_q(x)) w(x)` to the row of `p`, where `w = m sum_q G_q A / (m sum_q G_q A + 1)`. Sixteen
//!   points with a hundred rays each gather as by sixteen hundred.
//! - *Form factors.* Every cell's own, `f_p = G_p A`, adds `V f_p (1 - w)`, where `V` is the cell's visibility from the tile: a ray
//!   from a random point of the tile to a random point of the cell. Of a cluster of cells that matter little together, one is
//!   chosen by its form factor and stands for all.
//!
//! With `m = n` this is the balance heuristic (Veach 1997, section 9.2.2) over the tile's strategies. Here `m` is smaller, as if
//! the tile had sent [`BALANCE`] rays: any weights that add up to one are right on average, and form factors of cells that are
//! small to the eye vary less than one random point a cell would. Near cells, whose form factor says little and would have to
//! be clamped (Hasan 2006, section 4.3), are left to the hits, far and small ones to their form factors.
//!
//! Visibility is shared between points, not between cells. The converse, one ray from each point to a cluster of cells,
//! gives what is visible of the cluster to all its cells alike, the hidden ones too. These are mostly hidden from the lights
//! as well: every row has the right sum, and the image is too dark.

use glam::Vec3;
use multiversion::multiversion;

use super::form_factors::Patches;
use crate::sample::CellMap;
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, unit};
use crate::trace::{Accel, Hit, Ray, offset_origin};

/// Most cells that one of them may answer for: a power of four, a cluster of the tree.
const FAINT_CLUSTER: usize = 64;
/// Cells whose form factors are computed together: with those of a whole tile they stay in the second-level cache.
const CHUNK: usize = 1024;
/// Hemisphere rays that a tile counts as if it had sent, when hits are weighed against form factors. More leave more to the
/// hits, which are noisier; fewer leave cells to form factors that are large enough for these to be wrong.
const BALANCE: f32 = 320.0;
/// Rays that measure how far away a point's surroundings are.
const CLEARANCE_RAYS: u32 = 16;
/// A form factor that does not count; quotients of smaller ones might not be finite.
const NOTHING: f32 = 1e-30;
/// Most points of a tile.
pub(super) const TILE: usize = 64;

/// How rows are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowSettings {
    /// Hemisphere rays a point. More leave less noise in rows near corners.
    pub(super) hemisphere_rays: usize,
    /// Points of small tiles send more, until the tile has this many.
    pub(super) tile_rays: usize,
    /// Clusters of cells whose form factors add up to less than this, in the mean over the tile, are answered for by one of
    /// their cells. Larger spends fewer rays and leaves more noise.
    pub(super) faint: f32,
    /// Points of a tile, at most [`TILE`]. More share more.
    pub(super) tile: usize,
    /// Farthest that points of a tile lie from its first, as a share of the harmonic mean distance of what they see. More
    /// blurs what lies close to them.
    pub(super) spread: f32,
}

/// A point that gathers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GatherPoint {
    /// On the surface.
    pub(super) position: Vec3,
    /// For the cosine.
    pub(super) shading_normal: Vec3,
    /// For the horizon.
    pub(super) geometric_normal: Vec3,
    /// Distinguishes the points' random numbers.
    pub(super) seed: u32,
}

impl GatherPoint {
    fn origin(&self) -> Vec3 {
        offset_origin(self.position, self.geometric_normal)
    }

    /// Whether it faces as `head` does, lies in its plane, and no farther away than `reach`, in metres.
    fn is_like(&self, head: &Self, reach: f32) -> bool {
        let apart = self.position - head.position;
        let off_plane = apart.dot(head.geometric_normal).abs();
        self.geometric_normal.dot(head.geometric_normal) > 0.8
            && self.shading_normal.dot(head.shading_normal) > 0.8
            && off_plane < 0.25 * apart.length() + 1e-4
            && apart.length() < reach
    }
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

/// Scratch memory of one thread.
#[derive(Default)]
pub(super) struct RowScratch {
    /// Unshadowed form factors, `CHUNK` a point.
    factors: Vec<f32>,
    /// Their sums over the tile, one a cell of the chunk.
    shares: Vec<f32>,
    /// Visibility from the tile, one a cell of the chunk; more than one for a cell that stands for others.
    visible: Vec<f32>,
    rays: Vec<Ray>,
    blocked: Vec<bool>,
    hits: Vec<Hit>,
    /// Which cell of the chunk a visibility ray goes to, and what its form factor counts for if it is seen.
    asked: Vec<(u32, f32)>,
}

/// The points of a tile, as structure of arrays.
struct Tile<'a> {
    points: Vec<&'a GatherPoint>,
    x: [Vec<f32>; 3],
    /// Shading normals.
    n: [Vec<f32>; 3],
}

impl<'a> Tile<'a> {
    fn new(points: &'a [GatherPoint], members: &[u32]) -> Self {
        let points: Vec<&GatherPoint> = members.iter().map(|&member| &points[member as usize]).collect();
        let axes = |of: &dyn Fn(&GatherPoint) -> Vec3| {
            std::array::from_fn(|axis| points.iter().map(|point| of(point)[axis]).collect())
        };
        Self { x: axes(&|point| point.position), n: axes(&|point| point.shading_normal), points }
    }
}

impl RowSource<'_> {
    /// Parts points into tiles, so that what one point of a tile sees the others mostly see too: they face alike and lie
    /// close together beside the distance of what surrounds them. In the open a tile is large; in a corner every point may
    /// gather for itself. Points that follow each other are tried together. Returns the points' numbers, and the rays spent.
    pub(super) fn tiles(&self, points: &[GatherPoint], scratch: &mut RowScratch) -> (Vec<Vec<u32>>, u64) {
        let clearances = self.clearances(points, scratch);
        let mut tiles: Vec<Vec<u32>> = Vec::new();
        for start in (0..points.len()).step_by(self.settings.tile) {
            let first = tiles.len();
            for candidate in start..(start + self.settings.tile).min(points.len()) {
                let point = &points[candidate];
                let home = tiles[first..].iter_mut().find(|tile| {
                    let head = tile[0] as usize;
                    let clearance = clearances[candidate].min(clearances[head]);
                    point.is_like(&points[head], self.settings.spread * clearance)
                });
                match home {
                    Some(tile) => tile.push(candidate as u32),
                    None => tiles.push(vec![candidate as u32]),
                }
            }
        }
        (tiles, scratch.rays.len() as u64)
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

    /// Adds the rows of the up to [`TILE`] points `members` (numbers in `points`) to `rows`, which has a row of one entry
    /// a cell for each of `points`, zero on entry. Returns the number of rays.
    pub(super) fn tile(
        &self,
        points: &[GatherPoint],
        members: &[u32],
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) -> u64 {
        let count = self.patches.len();
        let tile = Tile::new(points, members);
        let of_tile = self.settings.tile_rays.div_ceil(members.len());
        let each = of_tile.clamp(self.settings.hemisphere_rays, 16 * self.settings.hemisphere_rays);
        let balance = BALANCE / members.len() as f32;
        let mut rays = self.hemisphere(&tile, members, each, rows, scratch);
        for first in (0..count).step_by(CHUNK) {
            let width = CHUNK.min(count - first);
            scratch.factors.resize(members.len() * width, 0.0);
            scratch.shares.clear();
            scratch.shares.resize(width, 0.0);
            for (point, factors) in tile.points.iter().zip(scratch.factors.chunks_exact_mut(width)) {
                self.patches.form_factors(first, point.position, point.shading_normal, factors);
                add(&mut scratch.shares, factors);
            }
            rays += self.ask(&tile, first, width, scratch);
            for (&member, factors) in members.iter().zip(scratch.factors.chunks_exact(width)) {
                let row = &mut rows[member as usize * count + first..][..width];
                add_balanced(row, factors, &scratch.shares, &scratch.visible, balance);
            }
        }
        rays
    }

    /// The visibility of the cells `first..first + width` from the tile: one ray a cell, or one a cluster of cells that
    /// matter little together.
    fn ask(&self, tile: &Tile<'_>, first: usize, width: usize, scratch: &mut RowScratch) -> u64 {
        scratch.rays.clear();
        scratch.asked.clear();
        let faint = self.settings.faint * tile.points.len() as f32;
        let seed = hash(first as u32, tile.points[0].seed);
        for cluster in (0..width).step_by(FAINT_CLUSTER) {
            let count = FAINT_CLUSTER.min(width);
            choose_speakers(&scratch.shares, (cluster, count), faint, seed, &mut scratch.asked);
        }
        for &(cell, _) in &scratch.asked {
            let seed = hash(cell, hash(2, seed));
            scratch.rays.push(self.probe(tile, (first, width), cell as usize, &scratch.factors, seed));
        }
        scratch.blocked.resize(scratch.rays.len(), false);
        self.accel.occluded_batch(&scratch.rays, &mut scratch.blocked);
        scratch.visible.clear();
        scratch.visible.resize(width, 0.0);
        let asked = scratch.asked.iter().zip(&scratch.blocked);
        for (&(cell, weight), _) in asked.filter(|&(_, &hidden)| !hidden) {
            scratch.visible[cell as usize] = weight;
        }
        scratch.rays.len() as u64
    }

    /// A ray from a random point of the tile, of those that face the cell, to a point of a cell of the chunk.
    fn probe(
        &self,
        tile: &Tile<'_>,
        (first, width): (usize, usize),
        cell: usize,
        factors: &[f32],
        seed: u32,
    ) -> Ray {
        let count = tile.points.len();
        let start = (unit(hash(1, seed)) * count as f32) as usize;
        let faces = |&point: &usize| factors[point * width + cell] > 0.0;
        let point = (start..count).chain(0..count).find(faces).unwrap_or(0);
        Ray::between(tile.points[point].origin(), self.patches.target(first + cell, hash(2, seed)))
    }

    /// The hemisphere rays' share: `each` rays from every point of the tile.
    fn hemisphere(
        &self,
        tile: &Tile<'_>,
        members: &[u32],
        each: usize,
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) -> u64 {
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
        let count = self.patches.len();
        let balance = BALANCE / members.len() as f32;
        let mut geometry_terms = [0.0; TILE];
        let terms = &mut geometry_terms[..members.len()];
        for (ray, hit) in scratch.rays.iter().zip(&scratch.hits) {
            let Some(cell) = self.map.sample_at(self.geometry, hit, ray.direction) else { continue };
            let area_vector = self.geometry.area_vector(hit.triangle as usize).normalize_or_zero();
            let normal = if area_vector.dot(ray.direction) > 0.0 { -area_vector } else { area_vector };
            let total = geometry_factors(tile, ray.origin + ray.direction * hit.t, normal, terms);
            if total <= 0.0 {
                continue;
            }
            // a cell whose area nothing has seen before has no form factor: the hits count alone
            let area = self.patches.area(cell);
            let by_area = if area > 0.0 { 1.0 / area } else { 0.0 };
            let weight = balance / (each as f32 * (balance * total + by_area));
            for (&member, &term) in members.iter().zip(&*terms) {
                rows[member as usize * count + cell] += weight * term;
            }
        }
        scratch.rays.len() as u64
    }
}

/// `G_p = cos_p cos_x / (pi r^2)` between every point of the tile and a point `x` with a normal; returns their sum.
fn geometry_factors(tile: &Tile<'_>, x: Vec3, normal: Vec3, out: &mut [f32]) -> f32 {
    geometry_factors_of(
        [&tile.x[0], &tile.x[1], &tile.x[2]],
        [&tile.n[0], &tile.n[1], &tile.n[2]],
        x.to_array(),
        (normal * std::f32::consts::FRAC_1_PI).to_array(),
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
        out[i] = above * facing / (square * square);
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn add(sums: &mut [f32], values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
    }
}

/// `row += V f / (m sum f + 1)`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn add_balanced(row: &mut [f32], factors: &[f32], shares: &[f32], visible: &[f32], balance: f32) {
    let count = row.len();
    let (factors, shares, visible) = (&factors[..count], &shares[..count], &visible[..count]);
    for i in 0..count {
        row[i] += visible[i] * factors[i] / (balance * shares[i] + 1.0);
    }
}

/// Chooses which of the `count` cells from `first` on, a cluster of the tree, are asked for, and what the form factor of each then
/// counts for: every cell by itself, or one for all of a cluster whose form factors (`shares`) add up to less than `faint`.
fn choose_speakers(
    shares: &[f32],
    (first, count): (usize, usize),
    faint: f32,
    seed: u32,
    chosen: &mut Vec<(u32, f32)>,
) {
    let cluster = &shares[first..first + count];
    let total: f32 = cluster.iter().sum();
    if total < NOTHING {
        return;
    }
    if count > 1 && total >= faint {
        for child in 0..4 {
            choose_speakers(shares, (first + child * count / 4, count / 4), faint, seed, chosen);
        }
        return;
    }
    let picked = pick(cluster, unit(hash((first + count) as u32, seed)) * total);
    chosen.push(((first + picked) as u32, total / cluster[picked].max(NOTHING)));
}

/// The entry in which the running sum of `weights` passes `at`; never one of weight zero unless all are.
fn pick(weights: &[f32], at: f32) -> usize {
    let (mut sum, mut last) = (0.0, 0);
    for (index, &weight) in weights.iter().enumerate() {
        if weight > 0.0 {
            last = index;
            sum += weight;
            if sum > at {
                break;
            }
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: GatherPoint =
        GatherPoint { position: Vec3::ZERO, shading_normal: Vec3::Y, geometric_normal: Vec3::Y, seed: 0 };

    #[test]
    fn points_are_alike_that_are_near_in_the_plane_and_face_alike() {
        let beside = GatherPoint { position: Vec3::new(0.09, 0.0, 0.0), ..HEAD };
        assert!(HEAD.is_like(&HEAD, 1e-3) && beside.is_like(&HEAD, 0.1));
        assert!(!beside.is_like(&HEAD, 0.08), "surroundings are closer than that");
        let tilted = Vec3::new(0.8, 0.6, 0.0);
        assert!(!GatherPoint { shading_normal: tilted, ..beside }.is_like(&HEAD, 0.1));
        assert!(!GatherPoint { geometric_normal: tilted, ..beside }.is_like(&HEAD, 0.1));
        let step = GatherPoint { position: Vec3::new(0.09, 0.03, 0.0), ..HEAD };
        assert!(!step.is_like(&HEAD, 0.1), "another plane");
    }

    /// What the cells of a cluster count for in the mean over many draws, of those of which `sees` says so.
    fn mean_visibility(shares: &[f32], faint: f32, sees: impl Fn(usize) -> bool) -> (Vec<f32>, usize) {
        const DRAWS: u32 = 20_000;
        let (mut sums, mut asked) = (vec![0.0; shares.len()], 0);
        for seed in 0..DRAWS {
            let mut chosen = Vec::new();
            choose_speakers(shares, (0, shares.len()), faint, hash(seed, 5), &mut chosen);
            asked += chosen.len();
            for (cell, weight) in chosen.into_iter().filter(|&(cell, _)| sees(cell as usize)) {
                sums[cell as usize] += weight / DRAWS as f32;
            }
        }
        (sums, asked / DRAWS as usize)
    }

    #[test]
    fn one_cell_answers_for_a_faint_cluster_and_every_cell_keeps_its_own_visibility() {
        let shares: Vec<f32> = (0..64).map(|cell| 1.0 + unit(hash(cell, 1))).collect();
        let total: f32 = shares.iter().sum();
        let hidden = |cell: usize| cell % 4 < 2;
        for (faint, rays) in [(2.0 * total, 1), (0.5 * total, 4), (0.1 * total, 16), (0.0, 64)] {
            let (seen, asked) = mean_visibility(&shares, faint, |cell| !hidden(cell));
            assert_eq!(asked, rays);
            for (cell, &visibility) in seen.iter().enumerate() {
                if hidden(cell) {
                    assert!(
                        visibility == 0.0,
                        "{cell} is hidden, and would not be if the answer were shared"
                    );
                } else {
                    assert!((visibility - 1.0).abs() < 0.25, "{faint}: {visibility} of cell {cell}");
                }
            }
            let sum: f32 = seen.iter().zip(&shares).map(|(seen, share)| seen * share).sum();
            let truth: f32 =
                shares.iter().enumerate().filter(|(cell, _)| !hidden(*cell)).map(|(_, s)| s).sum();
            assert!((sum / truth - 1.0).abs() < 0.02, "{faint}: {sum} of {truth}");
        }
    }

    #[test]
    fn cells_that_are_next_to_nothing_weigh_no_more_than_a_number_can() {
        let mut chosen = Vec::new();
        choose_speakers(&[1e-44, 0.0, 1e-3, 0.0], (0, 4), 1.0, 0, &mut chosen);
        assert!(chosen.len() == 1 && chosen[0].1.is_finite());
        chosen.clear();
        choose_speakers(&[1e-40, 1e-44, 0.0, 0.0], (0, 4), 1.0, 0, &mut chosen);
        assert!(chosen.is_empty(), "{chosen:?}");
    }

    #[test]
    fn what_weighs_nothing_is_never_picked() {
        let weights = [0.0, 1.0, 0.0, 3.0, 0.0];
        assert_eq!([0.0, 0.99, 1.0, 3.99, 4.0].map(|at| pick(&weights, at)), [1, 1, 3, 3, 3]);
        assert_eq!(pick(&[0.0; 4], 0.0), 0);
    }
}
