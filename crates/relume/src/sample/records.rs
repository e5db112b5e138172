//! Which receivers have a row of their own, and from which of these the others take their light.
//!
//! Indirect light changes over a surface no faster than what surrounds it is close: irradiance caching (Ward, Rubinstein and Clear 1988) computes it
//! at *records*, which lie apart by a share of the harmonic mean distance of what they see, and interpolates. Here records have whole rows of
//! the transfer, and the weights of the interpolation, which do not depend on light, are found once.
//!
//! - *Where.* Receivers are visited in random order; one that no record near it speaks for becomes a record. In the open there is one for many
//!   pixels; in corners, in foliage and under bumps of a normal map one for each.
//! - *Weights.* A smooth kernel over the nearest records, bent so that a light that changes evenly with place and normal is met by the mean, as in a
//!   moving least squares fit, but with no negative weights. The mean over several records also has less noise than a row by itself.
//!
//! Where lobes are sharp, reflections change faster than irradiance does: there records lie closer together, as much as the lobe is narrow and reflects.

use std::collections::BTreeMap;
use std::num::NonZero;

use glam::{Mat4, Vec3, Vec4};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{Gloss, Receiver};
use crate::shade::SpecularLobe;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, tangents};
use crate::trace::{Accel, Hit, Ray, offset_origin};
use crate::{Error, Progress, Result};

/// Receivers that are visited in one order, by one thread.
const RUN: usize = 4096;
/// Most records that a receiver takes its light from.
pub(crate) const MOST: usize = 8;
/// Records near a receiver that are looked at, of each level.
const NEAREST: NonZero<usize> = NonZero::new(32).unwrap();
/// Rays from each receiver that measure how far away its surroundings are: few, for neighbours put theirs together.
const CLEARANCE_RAYS: u32 = 4;
/// How many put theirs together.
const NEIGHBOURS: usize = 16;
/// Least cosine between geometric normals of receivers and the records that speak for them.
const SAME_FACE: f32 = 0.7;
/// How much more than others a distance off the plane counts.
const OFF_PLANE: f32 = 4.0;
/// A lobe along which light is gathered may turn by so many times its width, before it is divided by what the lobe reflects.
const LOBE_TURN: f32 = 0.5;
/// Added to the width of a lobe, so that what is nearly a mirror has an end to its records.
const LEAST_WIDTH: f32 = 0.05;
/// Where the kernel ends, in units of the distance within which a record speaks for a receiver.
const KERNEL: f32 = 1.6;
/// Added to the variance of records about their mean, in these units squared: how far weights are bent.
const RIDGE: f32 = 0.02;
/// What bending leaves of a weight at least.
const LEAST: f32 = 0.05;

/// Shortest and longest reach, metres: where nothing is around, nothing limits it.
const REACHES: (f32, f32) = (1e-6, 1e6);

/// How far apart records lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spacing {
    /// A share of the harmonic mean distance of what they see,
    pub(crate) share: f32,
    /// but at least so many pixels.
    pub(crate) least: f32,
    /// Distance between unit normals that counts as much as a distance of the whole reach.
    pub(crate) tilt: f32,
}

/// Which receivers have rows, and what the others take of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Records {
    /// Numbers of the receivers that are records, ascending.
    pub(crate) receivers: Vec<u32>,
    /// For each receiver the records it takes its light from, by their numbers in `receivers`, and their weights, which add up to one.
    pub(crate) shares: Vec<(u32, f32)>,
    /// Where the shares of each receiver end.
    pub(crate) ends: Vec<u32>,
}

/// A receiver, as far as its likeness to others goes.
#[derive(Clone, Copy)]
struct Place {
    position: Vec3,
    normal: Vec3,
    geometric: Vec3,
    /// Where light along its lobe comes from, mostly.
    mirrored: Vec3,
    /// Within what distance a record may speak for it, metres.
    reach: f32,
    /// How far its normal may tilt, as a distance of unit vectors.
    tilt: f32,
    /// How far its lobe may turn.
    turn: f32,
}

/// Receivers that were visited together.
struct Run {
    places: Vec<Place>,
    /// Those that are records, ascending.
    chosen: Vec<u32>,
    /// For each place the number in `chosen` of the record that speaks for it.
    spoken_for_by: Vec<u32>,
}

/// Records whose reaches are the same but for a factor of two. Each level is searched by itself: where records lie close together, in foliage beside a
/// floor, the nearest of all would be none of the floor's.
struct Level {
    /// No reach is larger, metres.
    reach: f32,
    /// Of the records.
    numbers: Vec<u32>,
    tree: ImmutableKdTree<f32, 3>,
}

impl Level {
    /// # Errors
    /// [`Error::Setting`] where records cannot be put in order.
    fn all(records: &[(usize, Place)]) -> Result<Vec<Self>> {
        let mut levels: BTreeMap<i32, Vec<u32>> = BTreeMap::new();
        for (number, (_, place)) in (0..).zip(records) {
            let level = place.reach.log2().floor() as i32;
            levels.entry(level).or_default().push(number);
        }
        let level = |(level, numbers): (i32, Vec<u32>)| {
            let position = |&number: &u32| records[number as usize].1.position.to_array();
            let positions: Vec<[f32; 3]> = numbers.iter().map(position).collect();
            let tree = ImmutableKdTree::new_from_slice(&positions)
                .map_err(|error| Error::Setting(format!("the records cannot be put in order ({error})")))?;
            Ok(Self { reach: f32::exp2((level + 1) as f32), numbers, tree })
        };
        levels.into_iter().map(level).collect()
    }

    /// The nearest records whose kernels may reach `place`.
    fn near(&self, place: &Place) -> impl Iterator<Item = u32> {
        let far = KERNEL * self.reach.min(place.reach);
        let position = place.position.to_array();
        let found = self
            .tree
            .query(&position)
            .nearest_n::<SquaredEuclidean<f32>>(NEAREST)
            .within::<SquaredEuclidean<f32>>(far * far)
            .execute();
        found.into_iter().map(|found| self.numbers[found.item as usize])
    }
}

impl Place {
    fn new(receiver: &Receiver, clearance: f32, spacing: Spacing) -> Self {
        let Receiver { position, shading_normal: normal, geometric_normal: geometric, gloss, .. } = *receiver;
        let Gloss { view, roughness, f0, f90 } = gloss;
        let (mirrored, turn) = match SpecularLobe::new(normal, view, roughness, f0, f90) {
            Some(lobe) => {
                (lobe.mirrored(), (roughness * roughness + LEAST_WIDTH) / lobe.reflectance().clamp(0.02, 1.0))
            }
            None => (Vec3::ZERO, f32::INFINITY),
        };
        let reach = (spacing.share * clearance * turn.min(1.0)).max(spacing.least * receiver.pixel);
        let reach = reach.clamp(REACHES.0, REACHES.1);
        Self { position, normal, geometric, mirrored, reach, tilt: spacing.tilt, turn: LOBE_TURN * turn }
    }

    /// The square of how unlike a record is: up to 1 it may speak for this place.
    fn unlike(&self, record: &Self) -> f32 {
        if self.geometric.dot(record.geometric) < SAME_FACE {
            return f32::INFINITY;
        }
        let apart = record.position - self.position;
        let off = apart.dot(self.geometric).abs().max(apart.dot(record.geometric).abs());
        let reach = self.reach.min(record.reach);
        let far = (apart.length_squared() + (OFF_PLANE * off).powi(2)) / (reach * reach);
        let turned = self.normal.distance_squared(record.normal) / (self.tilt * self.tilt);
        let turn = self.turn.min(record.turn);
        let lobe = if turn < f32::INFINITY {
            self.mirrored.distance_squared(record.mirrored) / (turn * turn)
        } else {
            0.0
        };
        far + turned + lobe
    }

    /// Where a record lies, seen from here: along the surface in units of the reach, and how its normal is tilted.
    fn offset(&self, record: &Self, (x, y): (Vec3, Vec3)) -> Vec4 {
        let apart = (record.position - self.position) / self.reach.min(record.reach);
        let tilt = (record.normal - self.normal) / self.tilt;
        Vec4::new(apart.dot(x), apart.dot(y), tilt.dot(x), tilt.dot(y))
    }
}

impl Records {
    /// Of `receivers`, of which those that lie together come after each other: records lie apart by `spacing`. Every receiver is two steps.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; [`Error::Setting`] where they cannot be put in order.
    pub(crate) fn new(
        receivers: &[Receiver],
        accel: &Accel,
        spacing: Spacing,
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let of_run = |(run, receivers): (usize, &[Receiver])| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let seed = hash(run as u32, hash(11, seed));
            let near = receivers.chunks(NEIGHBOURS).enumerate();
            let near = near.flat_map(|(group, points)| clearances(points, accel, hash(group as u32, seed)));
            let places: Vec<Place> = receivers
                .iter()
                .zip(near)
                .map(|(receiver, clearance)| Place::new(receiver, clearance, spacing))
                .collect();
            let (chosen, spoken_for_by) = chosen(&places, seed);
            progress.advance(receivers.len() as u64);
            Ok(Run { places, chosen, spoken_for_by })
        };
        let runs: Vec<Run> = receivers.par_chunks(RUN).enumerate().map(of_run).collect::<Result<_>>()?;
        let (mut records, mut starts) = (Vec::new(), Vec::new());
        for (run, Run { places, chosen, .. }) in runs.iter().enumerate() {
            starts.push(records.len() as u32);
            records
                .extend(chosen.iter().map(|&within| (run * RUN + within as usize, places[within as usize])));
        }
        let levels = Level::all(&records)?;
        let weigh = |place: &Place, home: u32| {
            let near = levels.iter().flat_map(|level| level.near(place));
            let unlike = |number: u32| (number, place.unlike(&records[number as usize].1));
            let mut near: Vec<(u32, f32)> = near.filter(|&number| number != home).map(unlike).collect();
            near.retain(|&(_, unlike)| unlike < KERNEL * KERNEL);
            near.push(unlike(home));
            near.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            weights(place, &near, |number| records[number as usize].1)
        };
        let of_run = |(Run { places, spoken_for_by, .. }, &start): (&Run, &u32)| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let shares = places.iter().zip(spoken_for_by).map(|(place, &home)| weigh(place, start + home));
            let shares: Vec<Vec<(u32, f32)>> = shares.collect();
            progress.advance(places.len() as u64);
            Ok(shares)
        };
        let shares: Vec<Vec<Vec<(u32, f32)>>> =
            runs.par_iter().zip(&starts).map(of_run).collect::<Result<_>>()?;
        let mut end = 0;
        let ends = shares.iter().flatten().map(|shares| {
            end += shares.len() as u32;
            end
        });
        Ok(Self {
            ends: ends.collect(),
            receivers: records.iter().map(|&(place, _)| place as u32).collect(),
            shares: shares.into_iter().flatten().flatten().collect(),
        })
    }

    /// The sum over receivers of each record's weights, and of their squares.
    pub(crate) fn served(&self) -> Vec<(f32, f32)> {
        let mut served = vec![(0.0, 0.0); self.receivers.len()];
        for &(record, weight) in &self.shares {
            let (light, errors) = &mut served[record as usize];
            *light += weight;
            *errors += weight * weight;
        }
        served
    }
}

/// The harmonic mean distance of what a few neighbours see, metres; of each, together with those that face as it does.
fn clearances(points: &[Receiver], accel: &Accel, seed: u32) -> Vec<f32> {
    let rays: Vec<Ray> = (0..)
        .zip(points)
        .flat_map(|(number, point)| {
            let origin = offset_origin(point.position, point.geometric_normal);
            let seed = hash(number, seed);
            (0..CLEARANCE_RAYS).map(move |index| {
                Ray::new(origin, cosine_hemisphere(point.geometric_normal, sobol_2d(index, 0, seed)))
            })
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    accel.closest_batch(&rays, &mut hits);
    // a ray that meets nothing is infinitely long
    let nearness = hits.chunks_exact(CLEARANCE_RAYS as usize);
    let nearness: Vec<f32> =
        nearness.map(|hits| hits.iter().map(|hit| 1.0 / hit.t.max(1e-6)).sum::<f32>()).collect();
    let together = |point: &Receiver| {
        let like =
            |other: &&(&Receiver, &f32)| point.geometric_normal.dot(other.0.geometric_normal) > SAME_FACE;
        let all: Vec<(&Receiver, &f32)> = points.iter().zip(&nearness).collect();
        let (count, sum) =
            all.iter().filter(like).fold((0, 0.0), |(count, sum), (_, near)| (count + 1, sum + *near));
        (count * CLEARANCE_RAYS) as f32 / f32::max(sum, f32::MIN_POSITIVE)
    };
    points.iter().map(together).collect()
}

/// The records of a run, and for each place the number of one that speaks for it: the most alike.
fn chosen(places: &[Place], seed: u32) -> (Vec<u32>, Vec<u32>) {
    let mut visits: Vec<u32> = (0..places.len() as u32).collect();
    visits.sort_by_key(|&number| (hash(number, seed), number));
    let mut records: Vec<(u32, Place)> = Vec::new();
    for number in visits {
        let place = places[number as usize];
        if !records.iter().any(|(_, record)| place.unlike(record) < 1.0) {
            records.push((number, place));
        }
    }
    records.sort_by_key(|&(number, _)| number);
    let most_alike = |place: &Place| {
        let unlike = records.iter().map(|(_, record)| place.unlike(record));
        (0..).zip(unlike).min_by(|a: &(u32, f32), b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number)
    };
    (records.iter().map(|&(number, _)| number).collect(), places.iter().map(most_alike).collect())
}

/// What `place` takes of the records near it, which come with the squares of how unlike they are, the most alike first.
fn weights(place: &Place, near: &[(u32, f32)], record: impl Fn(u32) -> Place) -> Vec<(u32, f32)> {
    // the kernel ends where the first record lies that is left out, so that none comes or goes at once
    let end = near.get(MOST).map_or(KERNEL * KERNEL, |&(_, unlike)| unlike.min(KERNEL * KERNEL));
    let near = &near[..near.len().min(MOST)];
    let kernel = |unlike: f32| (1.0 - unlike / end.max(f32::MIN_POSITIVE)).max(0.0).powi(2).max(1e-6);
    let frame = tangents(place.normal);
    let mut weighed: Vec<(u32, f32, Vec4)> = near
        .iter()
        .map(|&(number, unlike)| (number, kernel(unlike), place.offset(&record(number), frame)))
        .collect();
    let add_up_to_one = |weighed: &mut [(u32, f32, Vec4)]| {
        let total: f32 = weighed.iter().map(|(_, weight, _)| weight).sum();
        weighed.iter_mut().for_each(|(_, weight, _)| *weight /= total);
    };
    add_up_to_one(&mut weighed);
    let mean: Vec4 = weighed.iter().map(|&(_, weight, offset)| weight * offset).sum();
    let mut covariance = Mat4::from_diagonal(Vec4::splat(RIDGE));
    for &(_, weight, offset) in &weighed {
        let d = offset - mean;
        covariance += Mat4::from_cols(d * d.x, d * d.y, d * d.z, d * d.w) * weight;
    }
    // towards the place, which lies at zero
    let tilt = covariance.inverse() * -mean;
    weighed.iter_mut().for_each(|(_, weight, offset)| *weight *= (1.0 + tilt.dot(*offset - mean)).max(LEAST));
    add_up_to_one(&mut weighed);
    weighed.into_iter().map(|(number, weight, _)| (number, weight)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH: f32 = 0.05;

    fn place(position: Vec3, normal: Vec3) -> Place {
        let turn = f32::INFINITY;
        Place { position, normal, geometric: normal, mirrored: Vec3::ZERO, reach: REACH, tilt: 0.3, turn }
    }

    /// A point each centimetre of 64 cm of floor, and of the wall behind it.
    fn corner() -> Vec<Place> {
        let at = |i: usize| ((i % 64) as f32 * 0.01, (i / 64) as f32 * 0.01);
        let floor = (0..4096).map(at).map(|(x, y)| place(Vec3::new(x, 0.0, y), Vec3::Y));
        let wall = (0..4096).map(at).map(|(x, y)| place(Vec3::new(x, y + 0.01, 0.0), Vec3::Z));
        floor.chain(wall).collect()
    }

    #[test]
    fn every_place_has_a_record_that_speaks_for_it_and_no_two_speak_for_each_other() {
        let places = corner();
        let (records, spoken_for_by) = chosen(&places, 0);
        // discs of that radius that cover 2 x 0.41 square metres, and touch none of the others' middles
        let least = 2.0 * 0.64 * 0.64 / (std::f32::consts::PI * REACH * REACH);
        println!("{} records for {} places", records.len(), places.len());
        assert!((least as usize..4 * least as usize).contains(&records.len()));
        for (place, &record) in places.iter().zip(&spoken_for_by) {
            let record = &places[records[record as usize] as usize];
            assert!(place.unlike(record) < 1.0 && place.normal == record.normal);
        }
        for (a, b) in
            records.iter().flat_map(|&a| records.iter().map(move |&b| (a, b))).filter(|(a, b)| a != b)
        {
            assert!(places[a as usize].unlike(&places[b as usize]) >= 1.0);
        }
    }

    #[test]
    fn light_that_changes_evenly_is_met_and_more_closely_than_by_the_nearest() {
        let places = corner();
        let (records, spoken_for_by) = chosen(&places, 0);
        let record = |number: u32| places[records[number as usize] as usize];
        let light = |place: &Place| place.position.dot(Vec3::new(3.0, 1.0, 2.0));
        let (mut squares, mut of_nearest) = (0.0, 0.0);
        for (place, &home) in places.iter().zip(&spoken_for_by) {
            let numbers = 0..records.len() as u32;
            let mut near: Vec<(u32, f32)> = numbers.map(|n| (n, place.unlike(&record(n)))).collect();
            near.retain(|&(number, unlike)| unlike < KERNEL * KERNEL || number == home);
            near.sort_by(|a, b| a.1.total_cmp(&b.1));
            let shares = weights(place, &near, record);
            assert!((shares.iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-5);
            assert!(
                shares.iter().all(|&(number, weight)| weight > 0.0 && record(number).normal == place.normal)
            );
            let told: f32 = shares.iter().map(|&(number, weight)| weight * light(&record(number))).sum();
            squares += (told - light(place)).powi(2);
            of_nearest += (light(&record(home)) - light(place)).powi(2);
        }
        let (rms, of_nearest) = ((squares / 8192.0).sqrt(), (of_nearest / 8192.0).sqrt());
        println!("off by {rms:.4}, the nearest record by {of_nearest:.4}");
        assert!(rms < 0.25 * of_nearest, "{rms} {of_nearest}");
    }

    #[test]
    fn a_floor_beside_foliage_is_interpolated_between_its_own_records() {
        let floor = |x: f32, z: f32| Place { reach: 1.0, ..place(Vec3::new(x, 0.0, z), Vec3::Y) };
        let leaf = |i: usize| {
            let (x, z) = ((i % 40) as f32 * 0.005, (i / 40) as f32 * 0.005);
            Place { reach: 0.004, ..place(Vec3::new(0.1 + x, 0.05, 0.1 + z), Vec3::Y) }
        };
        // four records of a floor, a metre apart, and a thousand of a plant, which are nearer
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let all = corners.map(|(x, z)| floor(x, z)).into_iter().chain((0..1000).map(leaf));
        let records: Vec<(usize, Place)> = all.enumerate().collect();
        let levels = Level::all(&records).unwrap();
        assert_eq!(levels.len(), 2);
        let middle = floor(0.5, 0.5);
        let mut near: Vec<u32> = levels.iter().flat_map(|level| level.near(&middle)).collect();
        near.sort_unstable();
        assert_eq!(near, [0, 1, 2, 3]);
    }

    #[test]
    fn nothing_appears_at_once_where_more_records_are_near_than_count() {
        // a row of records closer together than their reach; what a place takes of each, as it moves along
        let all: Vec<Place> = (0..40).map(|i| place(Vec3::X * (i as f32 * 0.008), Vec3::Y)).collect();
        let shares = |x: f32| {
            let here = place(Vec3::X * x, Vec3::Y);
            let mut near: Vec<(u32, f32)> =
                (0..).zip(&all).map(|(n, other)| (n, here.unlike(other))).collect();
            near.retain(|&(_, unlike)| unlike < KERNEL * KERNEL);
            near.sort_by(|a, b| a.1.total_cmp(&b.1));
            assert!(near.len() > MOST);
            let mut of_all = [0.0; 40];
            for (number, weight) in weights(&here, &near, |n| all[n as usize]) {
                of_all[number as usize] = weight;
            }
            of_all
        };
        let steps: Vec<[f32; 40]> = (0..400).map(|i| shares(0.12 + i as f32 * 1e-4)).collect();
        let change =
            |pair: &[[f32; 40]]| pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let largest = steps.windows(2).map(change).fold(0.0, f32::max);
        println!("a step of 0.1 mm changes a weight by {largest:.4} at most");
        assert!(largest < 0.02, "{largest}");
    }

    #[test]
    fn reaches_are_finite_where_nothing_is_around() {
        let receiver = Receiver {
            position: Vec3::ZERO,
            shading_normal: Vec3::Y,
            geometric_normal: Vec3::Y,
            pixel: 0.0,
            gloss: Gloss::default(),
        };
        let spacing = Spacing { share: 0.5, least: 1.0, tilt: 0.15 };
        for clearance in [0.0, f32::MAX, f32::INFINITY] {
            let places = [Place::new(&receiver, clearance, spacing); 3];
            assert!((REACHES.0..=REACHES.1).contains(&places[0].reach));
            let (records, _) = chosen(&places, 0);
            let records: Vec<(usize, Place)> =
                records.iter().map(|&n| (n as usize, places[n as usize])).collect();
            let levels = Level::all(&records).unwrap();
            let near: Vec<u32> = levels.iter().flat_map(|level| level.near(&places[1])).collect();
            assert_eq!(near, [0]);
            assert_eq!(weights(&places[1], &[(0, 0.0)], |_| places[0]), [(0, 1.0)]);
        }
    }

    #[test]
    fn sharp_lobes_and_bent_normals_have_records_of_their_own() {
        let gloss = |roughness, f0| Gloss { view: Vec3::ONE.normalize(), roughness, f0, f90: 1.0 };
        let at = |x: f32, normal: Vec3, gloss| {
            let position = Vec3::new(x, 0.0, 0.0);
            let receiver =
                Receiver { position, shading_normal: normal, geometric_normal: Vec3::Y, pixel: 0.0, gloss };
            Place::new(&receiver, 1.0, Spacing { share: 0.05, least: 1.0, tilt: 0.15 })
        };
        let unlike = |gloss, tilt: f32| {
            at(0.0, Vec3::Y, gloss).unlike(&at(0.02, Vec3::new(tilt, 1.0, 0.0).normalize(), gloss))
        };
        assert!(unlike(gloss(0.6, 0.04), 0.0) < 1.0);
        assert!(unlike(gloss(0.6, 0.04), 0.8) > 1.0, "normals");
        assert!(unlike(gloss(0.1, 0.9), 0.0) > 1.0, "a metal's lobe");
    }
}
