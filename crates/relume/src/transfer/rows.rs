//! Rows of the diffuse final gather by two estimators, balanced.
//!
//! `F_d[v, g]` is estimated by `N` cosine-distributed hemisphere rays and by one form factor a patch, combined by the
//! balance heuristic: with `f = cos_v cos_g A / (pi r^2)`, a patch's form factor counts `f V / (N f + 1)` and a
//! hemisphere ray that hits the patch counts `f / (N f + 1)` with `f` at the hit. Both are at most `1 / N`: near
//! patches, whose form factor is wrong and would have to be clamped (Hasan 2006, section 4.3), are left to the rays, far
//! small ones to their form factors.
//!
//! Visibility `V` is shared: a *tile* of up to 16 neighbouring points asks a cluster of 16 patches by two sets of a few
//! rays. The first set, with the tile's hemisphere rays, decides: where it finds the cluster neither wholly visible nor
//! wholly hidden, every point asks for every four patches. Elsewhere the mean of the second set is the visibility. A set
//! that decided could not be used as well: a cluster seen by a fifth would mostly be found hidden, and its light lost;
//! with two sets every entry is right on average.

use glam::Vec3;

use super::form_factors::Patches;
use crate::sample::CellMap;
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, unit};
use crate::trace::{Accel, Hit, Ray, offset_origin};

/// Patches whose visibility is asked for together.
const CLUSTER: usize = 16;
/// Patches that share a ray where a cluster is partly visible.
const SUB_CLUSTER: usize = 4;
/// Patches whose form factors are computed together: they stay in the first-level cache.
const CHUNK: usize = 1024;
/// Points that ask together.
pub(super) const TILE: usize = 16;

/// How rows are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowSettings {
    /// Hemisphere rays a point. More leave less noise in rows near corners.
    pub(super) hemisphere_rays: usize,
    /// Rays of each of the two sets by which a tile asks for a cluster.
    pub(super) probes: usize,
    /// Clusters whose unshadowed form factors add up to less than this are not asked about twice: their visibility is
    /// the mean of the probes.
    pub(super) faint: f32,
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
    rays: Vec<Ray>,
    blocked: Vec<bool>,
    hits: Vec<Hit>,
    /// By cluster: whether a hemisphere ray of the tile has hit it.
    seen: Vec<bool>,
    /// Per cluster of the chunk: index of its first probe, and how many.
    probes: Vec<(u32, u32)>,
    /// Which point and patches a ray of the second round speaks for, and their form factors' sum.
    asked: Vec<(u32, u32)>,
}

impl RowSource<'_> {
    /// Adds the rows of the up to [`TILE`] points `tile` (numbers in `points`) to `rows`, which has a row of one entry
    /// a patch for each of `points`, zero on entry. Returns the number of rays.
    pub(super) fn tile(
        &self,
        points: &[GatherPoint],
        tile: &[u32],
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) -> u64 {
        let count = self.patches.len();
        let points: Vec<GatherPoint> = tile.iter().map(|&point| points[point as usize]).collect();
        scratch.seen.clear();
        scratch.seen.resize(count / CLUSTER, false);
        let mut rays = 0;
        for (point, &row) in points.iter().zip(tile) {
            let row = &mut rows[row as usize * count..(row as usize + 1) * count];
            rays += self.hemisphere(point, row, scratch);
        }
        for first in (0..count).step_by(CHUNK) {
            let width = CHUNK.min(count - first);
            scratch.factors.resize(points.len() * width, 0.0);
            for (point, factors) in points.iter().zip(scratch.factors.chunks_exact_mut(width)) {
                self.patches.form_factors(first, point.position, point.shading_normal, factors);
            }
            rays += self.probe_clusters(&points, first, width, scratch);
            rays += self.settle_clusters(&points, tile, (first, width), rows, scratch);
        }
        rays
    }

    /// First round: a few rays from the tile to each cluster that could light it.
    fn probe_clusters(
        &self,
        points: &[GatherPoint],
        first: usize,
        width: usize,
        scratch: &mut RowScratch,
    ) -> u64 {
        scratch.rays.clear();
        scratch.probes.clear();
        for cluster in (0..width).step_by(CLUSTER) {
            let begin = scratch.rays.len() as u32;
            let mut share = [0.0; TILE];
            for (share, factors) in share.iter_mut().zip(scratch.factors.chunks_exact(width)) {
                *share = factors[cluster..cluster + CLUSTER].iter().sum();
            }
            let total: f32 = share.iter().sum();
            if total > 0.0 {
                let seed = hash((first + cluster) as u32, points[0].seed);
                for probe in 0..self.settings.probes {
                    let at =
                        (probe as f32 + unit(hash(2 * probe as u32, seed))) / self.settings.probes as f32;
                    let point = pick(&share[..points.len()], at * total);
                    let factors = &scratch.factors[point * width + cluster..][..CLUSTER];
                    let patch = pick(factors, unit(hash(2 * probe as u32 + 1, seed)) * share[point]);
                    let target = self.patches.targets[first + cluster + patch];
                    scratch.rays.push(Ray::between(points[point].origin(), target));
                }
            }
            scratch.probes.push((begin, scratch.rays.len() as u32 - begin));
        }
        self.occlude(scratch)
    }

    /// Second round: settles each cluster by its probes, or by a ray from each point to each four patches.
    fn settle_clusters(
        &self,
        points: &[GatherPoint],
        tile: &[u32],
        (first, width): (usize, usize),
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) -> u64 {
        scratch.rays.clear();
        scratch.asked.clear();
        let rays = self.settings.hemisphere_rays as f32;
        let stride = self.patches.len();
        for (cluster, &(begin, probes)) in scratch.probes.iter().enumerate() {
            if probes == 0 {
                continue;
            }
            let begin = begin as usize;
            let (deciding, valuing) =
                scratch.blocked[begin..begin + probes as usize].split_at(probes as usize / 2);
            let open = |set: &[bool]| set.iter().filter(|&&blocked| !blocked).count();
            let hidden = open(deciding) == 0 && !scratch.seen[(first + cluster * CLUSTER) / CLUSTER];
            let alike = hidden || open(deciding) == deciding.len();
            let visible = open(valuing) as f32 / valuing.len() as f32;
            let (low, high) = (cluster * CLUSTER, (cluster + 1) * CLUSTER);
            for (index, point) in points.iter().enumerate() {
                let factors = &scratch.factors[index * width + low..index * width + high];
                let total: f32 = factors.iter().sum();
                if alike || total < self.settings.faint {
                    let start = tile[index] as usize * stride + first;
                    let row = &mut rows[start + low..start + high];
                    if visible > 0.0 {
                        add_balanced(row, factors, rays, visible);
                    }
                    continue;
                }
                for sub in (0..CLUSTER).step_by(SUB_CLUSTER) {
                    let factors = &factors[sub..sub + SUB_CLUSTER];
                    let share: f32 = factors.iter().sum();
                    if share > 0.0 {
                        let patch = first + low + sub;
                        let random = unit(hash(patch as u32, point.seed));
                        let target = self.patches.targets[patch + pick(factors, random * share)];
                        scratch.rays.push(Ray::between(point.origin(), target));
                        scratch.asked.push((index as u32, patch as u32));
                    }
                }
            }
        }
        let count = self.occlude(scratch);
        for (&(point, patch), _) in
            scratch.asked.iter().zip(&scratch.blocked).filter(|&(_, &blocked)| !blocked)
        {
            let (point, patch) = (point as usize, patch as usize);
            let factors = &scratch.factors[point * width + patch - first..][..SUB_CLUSTER];
            let row = &mut rows[tile[point] as usize * stride + patch..][..SUB_CLUSTER];
            add_balanced(row, factors, rays, 1.0);
        }
        count
    }

    fn occlude(&self, scratch: &mut RowScratch) -> u64 {
        scratch.blocked.resize(scratch.rays.len(), false);
        self.accel.occluded_batch(&scratch.rays, &mut scratch.blocked);
        scratch.rays.len() as u64
    }

    /// The share of the hemisphere rays.
    fn hemisphere(&self, point: &GatherPoint, row: &mut [f32], scratch: &mut RowScratch) -> u64 {
        let count = self.settings.hemisphere_rays;
        let origin = point.origin();
        scratch.rays.clear();
        scratch.rays.extend(
            (0..count as u32)
                .map(|index| cosine_hemisphere(point.shading_normal, sobol_2d(index, 0, point.seed)))
                .filter(|direction| direction.dot(point.geometric_normal) > 0.0)
                .map(|direction| Ray::new(origin, direction)),
        );
        scratch.hits.resize(scratch.rays.len(), Hit::MISS);
        self.accel.closest_batch(&scratch.rays, &mut scratch.hits);
        for (ray, hit) in scratch.rays.iter().zip(&scratch.hits) {
            let Some(patch) = self.map.sample_at(self.geometry, hit, ray.direction) else { continue };
            let normal = self.geometry.area_vector(hit.triangle as usize).normalize_or_zero();
            let cosines = point.shading_normal.dot(ray.direction) * normal.dot(ray.direction).abs();
            let square = (hit.t * hit.t).max(1e-12);
            let factor = cosines * self.patches.area(patch) * std::f32::consts::FRAC_1_PI / square;
            row[patch] += factor / (count as f32 * factor + 1.0);
            scratch.seen[patch / CLUSTER] = true;
        }
        scratch.rays.len() as u64
    }
}

/// `row += visible * f / (N f + 1)`.
fn add_balanced(row: &mut [f32], factors: &[f32], rays: f32, visible: f32) {
    for (entry, &factor) in row.iter_mut().zip(factors) {
        *entry += visible * factor / (rays * factor + 1.0);
    }
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

/// Parts points into tiles of at most [`TILE`] that lie close together and face alike, so that what one sees the
/// others mostly see too. Points that follow each other are tried together. Returns the points' numbers.
pub(super) fn tiles(points: &[GatherPoint]) -> Vec<Vec<u32>> {
    let mut tiles: Vec<Vec<u32>> = Vec::new();
    for start in (0..points.len()).step_by(TILE) {
        let first = tiles.len();
        for candidate in start as u32..(start + TILE).min(points.len()) as u32 {
            let point = &points[candidate as usize];
            let home = tiles[first..].iter_mut().find(|tile| {
                let head = &points[tile[0] as usize];
                let apart = point.position - head.position;
                let off_plane = apart.dot(head.geometric_normal).abs();
                let like = point.geometric_normal.dot(head.geometric_normal) > 0.8
                    && point.shading_normal.dot(head.shading_normal) > 0.8;
                like && off_plane < 0.25 * apart.length() + 1e-4
            });
            match home {
                Some(tile) => tile.push(candidate),
                None => tiles.push(vec![candidate]),
            }
        }
    }
    tiles
}
