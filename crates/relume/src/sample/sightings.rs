//! Who sees what: hits of rays from what the camera sees, and from the surfaces themselves.
//!
//! The hits of `N` cosine-distributed rays from a view sample are its row of `F_d`, coarsely: a cell that `c` of them
//! hit has an entry of about `c / N`. Cells are made finer where such entries are large, and a cell's light is taken
//! where the hits fall: what nobody sees of a cell must not speak for it.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::cells::at;
use super::sky::{SkySightings, code_of};
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use crate::trace::{Accel, Hit, Ray, offset_origin};
use crate::{Error, Progress, Result};

/// Rays that a view sample sends at most.
const RAYS: usize = 64;
/// View samples that one task serves.
const CHUNK: usize = 4096;

/// A point of a surface that a ray hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sighting {
    /// Number of the view sample that sees it, or [`Sighting::SURFACE`].
    pub(super) observer: u32,
    uv: [u16; 2],
}

impl Sighting {
    /// Seen by another surface.
    pub(super) const SURFACE: u32 = u32::MAX;

    fn new(observer: u32, hit: &Hit) -> Self {
        Self { observer, uv: [hit.u, hit.v].map(|weight| (weight.clamp(0.0, 1.0) * 65535.0) as u16) }
    }

    /// Barycentric (u, v).
    pub(super) fn uv(&self) -> Vec2 {
        let uv = Vec2::from(self.uv.map(|weight| (f32::from(weight) + 0.5) * (1.0 / 65536.0)));
        // rounding may not put it past the far edge
        uv / uv.element_sum().max(1.0)
    }
}

/// Sightings by side of triangle.
#[derive(Debug, Default)]
pub(super) struct Sightings {
    all: Vec<Sighting>,
    /// By side: the first of its sightings; one entry more than sides.
    first: Vec<u32>,
    /// Observers are below this.
    pub(super) observers: usize,
    /// How many are by view samples.
    by_views: usize,
}

/// What the rays of some view samples found.
#[derive(Default)]
struct Found {
    /// Surfaces, each with its side.
    surfaces: Vec<(u32, Sighting)>,
    /// Sky: where, and by whom.
    sky: Vec<(u32, u32)>,
}

/// The side of the triangle that a ray of this direction hit.
pub(super) fn side_of(geometry: &Geometry, hit: &Hit, direction: Vec3) -> usize {
    let triangle = hit.triangle as usize;
    2 * triangle + usize::from(geometry.area_vector(triangle).dot(direction) > 0.0)
}

impl Sightings {
    /// None at all.
    pub(super) fn none(geometry: &Geometry) -> Self {
        Self { all: Vec::new(), first: vec![0; 2 * geometry.triangles.len() + 1], observers: 0, by_views: 0 }
    }

    /// Rays that are sent from each of so many view samples, up to `most` from all together.
    pub(super) fn rays(seen: usize, most: usize) -> u32 {
        (most / seen.max(1)).clamp(1, RAYS) as u32
    }

    /// Sends so many rays from each of the view samples (`seen`: the camera's first hits and the directions of their rays) and adds
    /// the sightings `others` of surfaces by surfaces, each with its side. Also returns what is seen of the sky; `others_sky` are places
    /// of it that surfaces see. Every ray is a step, also where nothing is seen.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn new(
        geometry: &Geometry,
        accel: &Accel,
        (seen, rays): (&[(Hit, Vec3)], u32),
        (others, others_sky): (&[(u32, Sighting)], &[u32]),
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<(Self, SkySightings)> {
        let look = |(chunk, seen): (usize, &[(Hit, Vec3)])| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let mut found = Found::default();
            let (mut batch, mut hits) = (Vec::new(), Vec::new());
            for (index, (hit, direction)) in seen.iter().enumerate().filter(|(_, (hit, _))| hit.is_hit()) {
                let observer = (chunk * CHUNK + index) as u32;
                let area = geometry.area_vector(hit.triangle as usize).normalize_or_zero();
                let normal = if area.dot(*direction) > 0.0 { -area } else { area };
                let position = at(geometry.corners(hit.triangle as usize), Vec2::new(hit.u, hit.v));
                let origin = offset_origin(position, normal);
                let seed = hash(observer, seed ^ 0x5164_7e11);
                batch.clear();
                batch.extend(
                    (0..rays).map(|ray| Ray::new(origin, cosine_hemisphere(normal, sobol_2d(ray, 0, seed)))),
                );
                hits.resize(batch.len(), Hit::MISS);
                accel.closest_batch(&batch, &mut hits);
                for (ray, hit) in batch.iter().zip(&hits) {
                    if hit.is_hit() {
                        let side = side_of(geometry, hit, ray.direction) as u32;
                        found.surfaces.push((side, Sighting::new(observer, hit)));
                    } else {
                        found.sky.push((code_of(ray.direction), observer));
                    }
                }
            }
            progress.advance(seen.len() as u64 * u64::from(rays));
            Ok(found)
        };
        let mut found: Vec<Found> = seen.par_chunks(CHUNK).enumerate().map(look).collect::<Result<_>>()?;
        let by_views = found.iter().map(|found| found.surfaces.len()).sum();
        let mut sightings = Self { observers: seen.len(), by_views, ..Self::none(geometry) };
        sightings.sort(found.iter().map(|found| found.surfaces.as_slice()).chain([others]));
        let by_surfaces = others_sky.iter().map(|&code| (code, Sighting::SURFACE));
        let all: Vec<(u32, u32)> =
            found.iter_mut().flat_map(|found| std::mem::take(&mut found.sky)).chain(by_surfaces).collect();
        let rays = by_views + others.len() + all.len();
        Ok((sightings, SkySightings { all, observers: seen.len(), rays }))
    }

    /// A sighting of a surface by a surface, with its side.
    pub(super) fn by_surface(geometry: &Geometry, hit: &Hit, direction: Vec3) -> (u32, Sighting) {
        (side_of(geometry, hit, direction) as u32, Sighting::new(Sighting::SURFACE, hit))
    }

    /// Puts them in the order of sides, those of one side in the order given.
    fn sort<'a>(&mut self, parts: impl Iterator<Item = &'a [(u32, Sighting)]> + Clone) {
        for (side, _) in parts.clone().flatten() {
            self.first[*side as usize + 1] += 1;
        }
        for side in 1..self.first.len() {
            self.first[side] += self.first[side - 1];
        }
        let mut next = self.first.clone();
        let total = self.first.last().map_or(0, |&total| total as usize);
        self.all = vec![Sighting { observer: 0, uv: [0; 2] }; total];
        for (side, sighting) in parts.flatten() {
            let place = &mut next[*side as usize];
            self.all[*place as usize] = *sighting;
            *place += 1;
        }
    }

    /// The numbers of all sightings of a side.
    pub(super) fn of_side(&self, side: usize) -> Range<u32> {
        self.first[side]..self.first[side + 1]
    }

    /// How many sightings there are by view samples.
    pub(super) fn by_views(&self) -> usize {
        self.by_views
    }

    /// One of them.
    pub(super) fn get(&self, number: u32) -> Sighting {
        self.all[number as usize]
    }
}

/// Counts by observer.
#[derive(Debug, Default)]
pub(super) struct Tally {
    counts: Vec<u16>,
}

impl Tally {
    /// `sum c (c - 1) / 2` over observers, `c` the sightings that an observer has in the set. Over `N^2 / 2` it is an unbiased
    /// estimate of the sum of the squares of the observers' form factors: pairs of different rays are independent.
    pub(super) fn pairs(&mut self, observers: &[u32], most: usize) -> f64 {
        self.counts.resize(most, 0);
        let mut pairs = 0_u64;
        for &observer in observers.iter().filter(|&&observer| observer != Sighting::SURFACE) {
            let count = &mut self.counts[observer as usize];
            pairs += u64::from(*count);
            *count += 1;
        }
        for &observer in observers.iter().filter(|&&observer| observer != Sighting::SURFACE) {
            self.counts[observer as usize] = 0;
        }
        pairs as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_counted_by_observer_and_surfaces_are_none() {
        let mut tally = Tally::default();
        // three of observer 4, two of observer 1, one of 0: 3 + 1 + 0 pairs
        let observers = [4, 1, 4, 0, Sighting::SURFACE, 1, 4, Sighting::SURFACE];
        assert_eq!(tally.pairs(&observers, 5), 4.0);
        // nothing is carried over
        assert_eq!(tally.pairs(&[4, 1, 0], 5), 0.0);
    }

    #[test]
    fn a_sighting_keeps_its_place_within_the_triangle() {
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.7), (0.5, 0.25)] {
            let uv = Sighting::new(0, &Hit { t: 1.0, u, v, triangle: 0 }).uv();
            assert!(uv.min_element() >= 0.0 && uv.element_sum() <= 1.0 + 1e-6, "{uv}");
            assert!(uv.distance(Vec2::new(u, v)) < 3e-5, "{uv}");
        }
    }
}
