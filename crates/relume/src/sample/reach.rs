//! Which surfaces light can leave for the camera, after any number of bounces.
//!
//! The backs of two-sided surfaces, the inside of solid walls and whatever lies in closed rooms elsewhere get no
//! gather samples. A cell is reached if the camera sees it or if a ray connects it with a reached one.

use glam::Vec3;
use rayon::prelude::*;

use super::CellMap;
use super::cells::{Cell, Facet};
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use crate::trace::{Accel, Hit, Ray, offset_origin};

/// What rays from a cell found.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// The cells that were hit.
    links: Vec<u32>,
    /// How open the cell lies: the mean of `t / (t + scale)` over the rays' lengths `t`; near 0 for what is covered, 1
    /// under the open sky.
    pub(super) openness: f32,
    /// The cell's normal, if a ray met nothing.
    open: Option<Vec3>,
}

/// Least cosine between the normals of neighbouring cells that lie on a surface which goes on.
const GOES_ON: f32 = 0.7;

/// Sends `rays` rays from each cell. `scale` is the length in metres that counts as half open.
pub(super) fn explore(
    geometry: &Geometry,
    accel: &Accel,
    cells: &[Cell],
    map: &CellMap,
    (rays, scale): (usize, f32),
    seed: u32,
) -> Vec<Surroundings> {
    let explore = |(index, cell): (usize, &Cell)| {
        let seed = hash(index as u32, seed);
        let rays: Vec<Ray> = cell
            .points(geometry, rays, seed)
            .iter()
            .enumerate()
            .map(|(index, (facet, uv))| {
                let [a, b, c] = geometry.corners(facet.triangle as usize);
                let position = a + (b - a) * uv.x + (c - a) * uv.y;
                let direction = cosine_hemisphere(facet.normal, sobol_2d(index as u32, 0, seed));
                Ray::new(offset_origin(position, facet.normal), direction)
            })
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        accel.closest_batch(&rays, &mut hits);
        let open = |hit: &Hit| if hit.is_hit() { hit.t / (hit.t + scale) } else { 1.0 };
        let openness = hits.iter().map(open).sum::<f32>() / hits.len() as f32;
        let missed = hits.iter().any(|hit| !hit.is_hit());
        let hits = rays.iter().zip(&hits);
        let mut links: Vec<u32> = hits
            .filter_map(|(ray, hit)| map.sample_at(geometry, hit, ray.direction))
            .map(|cell| cell as u32)
            .collect();
        links.sort_unstable();
        links.dedup();
        Surroundings { links, openness, open: missed.then(|| cell.normal()) }
    };
    cells.par_iter().enumerate().with_min_len(64).map(explore).collect()
}

/// How often each cell is seen: by rays from the surfaces that the camera sees, which is how the final gather sees it,
/// and, at a lower weight, by the rays that explored the other cells, which is how bounces see it.
pub(super) fn sightings(
    geometry: &Geometry,
    accel: &Accel,
    surroundings: &[Surroundings],
    map: &CellMap,
    seen: &[(Hit, Vec3)],
    seed: u32,
) -> Vec<f32> {
    const RAYS: u32 = 32;
    const BOUNCE_WEIGHT: f32 = 0.25;
    let look = |mut counts: Vec<u32>, (index, (hit, direction)): (usize, &(Hit, Vec3))| {
        if map.sample_at(geometry, hit, *direction).is_none() {
            return counts;
        }
        let [a, b, c] = geometry.corners(hit.triangle as usize);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let normal = if normal.dot(*direction) > 0.0 { -normal } else { normal };
        let origin = offset_origin(a + (b - a) * hit.u + (c - a) * hit.v, normal);
        let seed = hash(index as u32, seed ^ 0x5164_7e11);
        let ray = |ray| Ray::new(origin, cosine_hemisphere(normal, sobol_2d(ray, 0, seed)));
        let rays: Vec<Ray> = (0..RAYS).map(ray).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        accel.closest_batch(&rays, &mut hits);
        for (ray, hit) in rays.iter().zip(&hits) {
            if let Some(cell) = map.sample_at(geometry, hit, ray.direction) {
                counts[cell] += 1;
            }
        }
        counts
    };
    let add = |mut a: Vec<u32>, b: Vec<u32>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    // whole numbers, so that the order of the sums does not matter; few tasks, since each counts for all cells
    let none = || vec![0_u32; surroundings.len()];
    let task = (seen.len() / 16).max(1024);
    let counts = seen.par_iter().enumerate().with_min_len(task).fold(none, look).reduce(none, add);
    let mut sightings: Vec<f32> = counts.into_iter().map(|count| count as f32).collect();
    for &cell in surroundings.iter().flat_map(|cell| &cell.links) {
        sightings[cell as usize] += BOUNCE_WEIGHT;
    }
    sightings
}

/// For each cell, whether light can leave it for the camera: it is `seen`, or linked to one that is by any chain.
pub(super) fn reached(
    geometry: &Geometry,
    surroundings: &[Surroundings],
    map: &CellMap,
    seen: &[(Hit, Vec3)],
) -> Vec<bool> {
    let mut components = Components::new(surroundings.len());
    for (index, cell) in surroundings.iter().enumerate() {
        cell.links.iter().for_each(|&other| components.join(index as u32, other));
    }
    // In the open, rays between distant surfaces are few and miss most cells of a wide plain: where a part of a surface
    // is reached, so is what it goes on to. Cells come in an order in which neighbours follow each other.
    for (index, pair) in surroundings.windows(2).enumerate() {
        if let [Some(one), Some(next)] = [pair[0].open, pair[1].open]
            && one.dot(next) > GOES_ON
        {
            components.join(index as u32, index as u32 + 1);
        }
    }
    let mut lit = vec![false; surroundings.len()];
    for (hit, direction) in seen {
        if let Some(cell) = map.sample_at(geometry, hit, *direction) {
            lit[components.root(cell as u32) as usize] = true;
        }
    }
    (0..surroundings.len() as u32).map(|cell| lit[components.root(cell) as usize]).collect()
}

/// The facets of reached cells, each once.
pub(super) fn keep_reached(cells: &[Cell], reached: &[bool], facets: Vec<Facet>) -> Vec<Facet> {
    let mut kept = std::collections::HashSet::new();
    for (cell, _) in cells.iter().zip(reached).filter(|&(_, &reached)| reached) {
        match cell {
            Cell::Group(group) => kept.extend(group.iter().map(Facet::side)),
            Cell::Piece(facet, _) => {
                kept.insert(facet.side());
            }
        }
    }
    facets.into_iter().filter(|facet| kept.contains(&facet.side())).collect()
}

/// Disjoint sets with path halving.
struct Components(Vec<u32>);

impl Components {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.0[node as usize] != node {
            let above = self.0[self.0[node as usize] as usize];
            self.0[node as usize] = above;
            node = above;
        }
        node
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        // the smaller number wins, so that the result does not depend on the order of joins
        self.0[a.max(b) as usize] = a.min(b);
    }
}
