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

/// Rays sent from each cell.
const RAYS: usize = 32;

/// For each cell, whether light can leave it for the camera.
pub(super) fn reached(
    geometry: &Geometry,
    accel: &Accel,
    cells: &[Cell],
    map: &CellMap,
    seen: &[(Hit, Vec3)],
    seed: u32,
) -> Vec<bool> {
    // Surfaces have many cells, few of which need to be told apart here: neighbours by light are one component.
    let mut components = Components::new(cells.len());
    let links: Vec<Vec<u32>> = cells
        .par_iter()
        .enumerate()
        .map(|(index, cell)| links_of(geometry, accel, cell, map, hash(index as u32, seed)))
        .collect();
    for (index, linked) in links.iter().enumerate() {
        linked.iter().for_each(|&other| components.join(index as u32, other));
    }
    let mut lit = vec![false; cells.len()];
    for (hit, direction) in seen {
        if let Some(cell) = map.sample_at(geometry, hit, *direction) {
            lit[components.root(cell as u32) as usize] = true;
        }
    }
    (0..cells.len() as u32).map(|cell| lit[components.root(cell) as usize]).collect()
}

/// The cells that rays from points of `cell` hit.
fn links_of(geometry: &Geometry, accel: &Accel, cell: &Cell, map: &CellMap, seed: u32) -> Vec<u32> {
    let rays: Vec<Ray> = cell
        .points(geometry, RAYS, seed)
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
    let mut linked: Vec<u32> = rays
        .iter()
        .zip(&hits)
        .filter_map(|(ray, hit)| map.sample_at(geometry, hit, ray.direction))
        .map(|cell| cell as u32)
        .collect();
    linked.sort_unstable();
    linked.dedup();
    linked
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
