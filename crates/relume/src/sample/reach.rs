//! Which surfaces light can leave for the camera, after any number of bounces.
//!
//! The backs of two-sided surfaces, the inside of solid walls and whatever lies in closed rooms elsewhere get no
//! gather samples. A cell is reached if the camera sees it or if a ray connects it with a reached one.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::cells::{Facet, at};
use super::refine::{Cuts, Part};
use super::sightings::{Sighting, Sightings, side_of};
use super::sky::code_of;
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use crate::trace::{Accel, Hit, Ray, offset_origin};
use crate::{Error, Progress, Result};

/// What rays from a cell found.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// The cells that were hit.
    links: Vec<u32>,
    /// Where they were hit, each with its side of a triangle.
    pub(super) sightings: Vec<(u32, Sighting)>,
    /// Where rays met nothing: places of the sky.
    pub(super) sky: Vec<u32>,
    /// The cell's normal, if a ray met nothing.
    open: Option<Vec3>,
}

/// Least cosine between the normals of neighbouring cells that lie on a surface which goes on.
const GOES_ON: f32 = 0.7;
/// Rays from each cell.
pub(super) const RAYS: usize = 32;

/// Sends rays from each cell; every ray is a step.
///
/// # Errors
/// [`Error::Cancelled`].
pub(super) fn explore(
    geometry: &Geometry,
    accel: &Accel,
    parts: &[Part],
    cuts: &Cuts,
    seed: u32,
    progress: &dyn Progress,
) -> Result<Vec<Surroundings>> {
    let explore = |(index, part): (usize, &Part)| {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        let seed = hash(index as u32, seed);
        let rays: Vec<Ray> = part
            .cell
            .points(geometry, RAYS, seed)
            .iter()
            .enumerate()
            .map(|(index, (facet, uv))| {
                let position = at(geometry.corners(facet.triangle as usize), *uv);
                let direction = cosine_hemisphere(facet.normal, sobol_2d(index as u32, 0, seed));
                Ray::new(offset_origin(position, facet.normal), direction)
            })
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        accel.closest_batch(&rays, &mut hits);
        let missed = rays.iter().zip(&hits).filter(|(_, hit)| !hit.is_hit());
        let sky: Vec<u32> = missed.map(|(ray, _)| code_of(ray.direction)).collect();
        let met = || rays.iter().zip(&hits).filter(|(_, hit)| hit.is_hit());
        let mut links: Vec<u32> =
            met().filter_map(|(ray, hit)| cell_at(geometry, cuts, hit, ray.direction)).collect();
        links.sort_unstable();
        links.dedup();
        progress.advance(RAYS as u64);
        Ok(Surroundings {
            links,
            sightings: met().map(|(ray, hit)| Sightings::by_surface(geometry, hit, ray.direction)).collect(),
            open: (!sky.is_empty()).then(|| part.cell.normal()),
            sky,
        })
    };
    parts.par_iter().enumerate().with_min_len(64).map(explore).collect()
}

fn cell_at(geometry: &Geometry, cuts: &Cuts, hit: &Hit, direction: Vec3) -> Option<u32> {
    cuts.cell_at(geometry, side_of(geometry, hit, direction), Vec2::new(hit.u, hit.v))
}

/// For each cell, whether light can leave it for the camera: it is `seen`, or linked to one that is by any chain.
pub(super) fn reached(
    geometry: &Geometry,
    surroundings: &[Surroundings],
    cuts: &Cuts,
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
        if let Some(cell) =
            Some(hit).filter(|hit| hit.is_hit()).and_then(|hit| cell_at(geometry, cuts, hit, *direction))
        {
            lit[components.root(cell) as usize] = true;
        }
    }
    (0..surroundings.len() as u32).map(|cell| lit[components.root(cell) as usize]).collect()
}

/// The facets of reached cells, each once.
pub(super) fn keep_reached(parts: &[Part], reached: &[bool], facets: Vec<Facet>) -> Vec<Facet> {
    let mut kept = std::collections::HashSet::new();
    for (part, _) in parts.iter().zip(reached).filter(|&(_, &reached)| reached) {
        kept.extend(part.cell.facets().iter().map(Facet::side));
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
