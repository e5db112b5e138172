//! Rows of the multi-bounce operator from photons: Hasan 2006, section 4.3.
//!
//! Lights are not known yet, so that photons start at the gather samples, each a Lambertian emitter as large as its cell. They are
//! deposited wherever they hit a cell and go on by Russian roulette, all with the number of the sample from which they came. The row of a
//! gather sample is then a density estimate over the photons nearest to it: how much of what each sample radiates arrives here,
//! after any number of bounces. One product with the operator gives all light that goes round.
//!
//! The rows are scalars, as the paper's: at surfaces between the sample a photon comes from and the one it is counted at, light loses the mean of
//! the three channels' albedo, whatever its colour. The albedo of the receiving sample stays outside, in colour.
//!
//! The paper divides by the area of the disc that holds the nearest photons. In corners, on edges, on whatever is bent or hidden in part, that is
//! not the area on which they lie. Here rows are scaled so that the photons on their first flight add up to the share of the
//! hemisphere in which the point sees samples at all, which rays tell: what density there is does not matter then.

use std::f32::consts::PI;
use std::num::NonZero;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Vec2, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::rows::Found;
use super::tiles::GatherPoint;
use crate::progress::Progress;
use crate::sample::{CellMap, GatherCloud, PackedNormal, TARGETS};
use crate::scene::Geometry;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use crate::trace::{Accel, Hit, Ray, offset_origin};
use crate::{Error, Result};

/// Photons that are on their way together.
const TOGETHER: usize = 4096;
/// Hits of one photon at most: of light that keeps nine tenths at each, a thousandth is left then.
const LONGEST: u32 = 64;
/// Photons that may lie on surfaces, about 60 bytes each while the tree is built: 4 GB. All that are ever shot, three hits long, are
/// fewer.
const MOST_HITS: usize = 1 << 26;
/// Cosine between normals from which on two points count as facing alike.
const LIKE: f32 = 0.7;
/// Share of the photons near a sample that must be on their first flight, by flux, for these to tell the scale of its row. Where light keeps
/// nine tenths at each hit, a tenth of it is.
const LEAST_FIRST: f32 = 0.05;
/// Rays by which a gather sample looks around for others.
const LOOKS: u32 = 64;

/// How the photons of the multi-bounce operator are shot and gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct PhotonSettings {
    /// Photons to shoot in all, 1 to 16,777,216; every gather sample shoots as many, at least one. More leave less noise, for
    /// proportionally more time and memory (about 60 bytes for each surface that one hits).
    pub count: usize,
    /// Photons that a row is made of, 1 to 65,536. More leave less noise and blur more.
    pub nearest: usize,
    /// Surfaces that a photon hits at most, at least 1; the paper has 3. `None` ends photons by Russian roulette alone, so that no light is
    /// lost, but for what is left after 64 hits.
    pub path_length: Option<u32>,
}

impl Default for PhotonSettings {
    /// The paper's million, 2000 of them a row, of any length.
    fn default() -> Self {
        Self { count: 1_000_000, nearest: 2000, path_length: None }
    }
}

impl PhotonSettings {
    /// # Errors
    /// [`Error::Setting`] where one is out of range.
    pub(super) fn check(&self) -> Result<()> {
        let refused = |what: String| Err(Error::Setting(what));
        if !(1..=1 << 24).contains(&self.count) {
            return refused(format!("{} photons: must be 1 to 16777216", self.count));
        }
        if !(1..=1 << 16).contains(&self.nearest) {
            return refused(format!("{} photons a row: must be 1 to 65536", self.nearest));
        }
        if let Some(length) = self.path_length.filter(|length| !(1..=LONGEST).contains(length)) {
            return refused(format!("photons of {length} hits: must be 1 to {LONGEST}, or without limit"));
        }
        Ok(())
    }
}

/// A photon that lies on a surface.
#[derive(Clone, Copy)]
struct Deposit {
    /// Of the side that was hit.
    normal: PackedNormal,
    /// The gather sample that it comes from, times two; odd on its first flight.
    origin: u32,
}

impl Deposit {
    fn new(normal: Vec3, origin: u32, first: bool) -> Self {
        Self { normal: PackedNormal::new(normal), origin: 2 * origin + u32::from(first) }
    }

    fn origin(self) -> usize {
        self.origin as usize / 2
    }

    fn is_first(self) -> bool {
        self.origin % 2 == 1
    }
}

/// What some samples shot: where photons lie, and the number of rays.
#[derive(Default)]
struct Shot {
    places: Vec<[f32; 3]>,
    deposits: Vec<Deposit>,
    rays: u64,
}

/// A photon on its way.
#[derive(Clone, Copy)]
struct Photon {
    origin: u32,
    /// Among the photons of its sample.
    index: u32,
}

/// What photons are shot through.
pub(super) struct PhotonSource<'a> {
    pub(super) accel: &'a Accel,
    pub(super) geometry: &'a Geometry,
    pub(super) map: &'a CellMap,
    pub(super) cloud: &'a GatherCloud,
    pub(super) settings: PhotonSettings,
    pub(super) seed: u32,
}

/// All photons where they lie.
pub(super) struct PhotonMap<'a> {
    source: &'a PhotonSource<'a>,
    tree: ImmutableKdTree<f32, 3>,
    /// In the order in which the tree numbers them.
    deposits: Vec<Deposit>,
    /// What one photon of each gather sample carries at a radiance of 1, over pi; square metres.
    flux: Vec<f32>,
    nearest: NonZero<usize>,
    /// On which the photons flew.
    rays: u64,
}

impl PhotonSource<'_> {
    /// Shoots them all.
    ///
    /// # Errors
    /// [`Error::Setting`] where they would hit more surfaces than memory is meant for; [`Error::Cancelled`].
    pub(super) fn shoot(&self, progress: &dyn Progress) -> Result<PhotonMap<'_>> {
        let samples = self.cloud.len();
        let each = (self.settings.count as f64 / samples as f64).round().max(1.0) as u32;
        let run = (TOGETHER / each as usize).clamp(1, samples);
        progress.stage("photons", samples as u64);
        let hits = AtomicUsize::new(0);
        let shot = |first: usize| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let last = (first + run).min(samples);
            let shot = self.shoot_from(first as u32..last as u32, each, &hits)?;
            progress.advance((last - first) as u64);
            Ok(shot)
        };
        let shots: Vec<Shot> = (0..samples).into_par_iter().step_by(run).map(shot).collect::<Result<_>>()?;
        let places: Vec<[f32; 3]> = shots.iter().flat_map(|shot| shot.places.iter().copied()).collect();
        let rays = shots.iter().map(|shot| shot.rays).sum();
        let deposits = shots.into_iter().flat_map(|shot| shot.deposits).collect();
        let tree = ImmutableKdTree::new_from_slice(&places).map_err(|error| {
            Error::Setting(format!(
                "the photons cannot be put in order ({error}); ask for another number of them"
            ))
        })?;
        Ok(PhotonMap {
            source: self,
            tree,
            deposits,
            flux: (self.cloud.samples.iter().enumerate())
                .map(|(number, sample)| self.map.flux(number, sample.area) / each as f32)
                .collect(),
            nearest: NonZero::new(self.settings.nearest).unwrap_or(NonZero::<usize>::MIN),
            rays,
        })
    }

    /// The photons of some samples, of which each shoots `each`.
    fn shoot_from(&self, samples: Range<u32>, each: u32, all_hits: &AtomicUsize) -> Result<Shot> {
        let photons = samples.flat_map(|origin| (0..each).map(move |index| Photon { origin, index }));
        let mut flying: Vec<(Photon, Ray)> = photons.map(|photon| (photon, self.emitted(photon))).collect();
        let mut shot = Shot::default();
        let (mut rays, mut hits) = (Vec::new(), Vec::new());
        for length in 1..=self.settings.path_length.unwrap_or(LONGEST).min(LONGEST) {
            rays.clear();
            rays.extend(flying.iter().map(|(_, ray)| *ray));
            hits.clear();
            hits.resize(rays.len(), Hit::MISS);
            self.accel.closest_batch(&rays, &mut hits);
            shot.rays += rays.len() as u64;
            let before = shot.deposits.len();
            let mut went_on = Vec::new();
            for (&(photon, ray), hit) in flying.iter().zip(&hits) {
                if !hit.is_hit() {
                    continue;
                }
                let Some(found) = Found::new(self.map, self.geometry, &ray, hit) else { continue };
                shot.places.push(found.position.to_array());
                shot.deposits.push(Deposit::new(found.normal, photon.origin, length == 1));
                went_on.extend(self.scattered(photon, length, &found).map(|ray| (photon, ray)));
            }
            let found = shot.deposits.len() - before;
            if all_hits.fetch_add(found, Ordering::Relaxed) + found > MOST_HITS {
                return Err(too_many());
            }
            flying = went_on;
            if flying.is_empty() {
                break;
            }
        }
        Ok(shot)
    }

    fn random(&self, photon: Photon, pair: u32) -> Vec2 {
        sobol_2d(photon.index, pair, hash(photon.origin, self.seed ^ 0x7068_6f74))
    }

    /// From a point of the sample's cell, cosine-weighted; from the sky, anywhere into the scene.
    fn emitted(&self, photon: Photon) -> Ray {
        let point = (self.random(photon, 1).x * TARGETS as f32) as usize;
        self.map.emitted(photon.origin as usize, point.min(TARGETS - 1), self.random(photon, 0))
    }

    /// Where a photon goes after its hit number `length`, if it goes on: with the mean of the albedo's channels as probability.
    fn scattered(&self, photon: Photon, length: u32, found: &Found) -> Option<Ray> {
        let albedo = self.cloud.samples[found.cell as usize].albedo.element_sum() / 3.0;
        if self.random(photon, 2 * length + 1).x >= albedo {
            return None;
        }
        let origin = offset_origin(found.position, found.normal);
        Some(Ray::new(origin, cosine_hemisphere(found.normal, self.random(photon, 2 * length))))
    }
}

fn too_many() -> Error {
    Error::Setting(format!(
        "the photons of the bounces hit more than {MOST_HITS} surfaces: ask for fewer, or for a shorter path"
    ))
}

impl PhotonMap<'_> {
    /// Rays on which all photons flew.
    pub(super) fn rays(&self) -> u64 {
        self.rays
    }

    /// Fills the row of a gather sample, all zero on entry: irradiance over pi here by the radiance of each sample. Returns the number
    /// of rays.
    pub(super) fn row(&self, point: &GatherPoint, row: &mut [f32]) -> u64 {
        let place = point.position.to_array();
        let near = self.tree.query(&place).nearest_n::<SquaredEuclidean<f32>>(self.nearest).execute();
        let (mut sum, mut first) = (0.0, 0.0);
        for found in &near {
            let deposit = self.deposits[found.item as usize];
            // what is around a corner is not here
            if point.geometric_normal.dot(deposit.normal.get()) > LIKE {
                let flux = self.flux[deposit.origin()];
                row[deposit.origin()] += flux;
                sum += flux;
                first += if deposit.is_first() { flux } else { 0.0 };
            }
        }
        let disc = PI * near.last().map_or(0.0, |farthest| farthest.distance);
        let scale = match first {
            // few on their first flight say little, and nothing may make a row of them
            _ if first > LEAST_FIRST * sum => self.seen_from(point) / first,
            _ if disc > 0.0 => 1.0 / disc, // light that gets here by detours, nearly alone
            _ => 0.0,
        };
        row.iter_mut().for_each(|entry| *entry *= scale);
        u64::from(LOOKS)
    }

    /// The share of the hemisphere, by cosine, in which a point sees gather samples.
    fn seen_from(&self, point: &GatherPoint) -> f32 {
        let PhotonSource { accel, geometry, map, .. } = *self.source;
        let origin = point.origin();
        let look = |index| cosine_hemisphere(point.geometric_normal, sobol_2d(index, 0, hash(5, point.seed)));
        let rays: Vec<Ray> = (0..LOOKS).map(|index| Ray::new(origin, look(index))).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        accel.closest_batch(&rays, &mut hits);
        let met =
            rays.iter().zip(&hits).filter(|(ray, hit)| map.sample_at(geometry, hit, ray.direction).is_some());
        met.count() as f32 / LOOKS as f32
    }
}

#[cfg(test)]
#[path = "photons_tests.rs"]
mod tests;
