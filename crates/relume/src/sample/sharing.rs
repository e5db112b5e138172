//! Letting receivers that are alike share one, for a first look: one row then serves many pixels.
//!
//! Receivers are ordered as blocks of rows are (`tree.rs`). Those of a short run that face alike, lie in a plane and are about as rough form a
//! group, and take their light from the one in its middle. A run of floor has one row; one of leaves has more: a sixteenth of its points, and two
//! at least.

use glam::Vec3;
use rayon::prelude::*;

use super::{Receiver, cluster_order};
use crate::{Progress, Result};

/// Least cosine between the normals of receivers that share, geometric and shading.
const SAME_FACE: f32 = 0.8;
/// Farthest off the other's plane, a share of how far apart they are.
const SAME_PLANE: f32 = 0.25;
/// Farthest apart of their roughnesses.
const SAME_LOBE: f32 = 0.15;
/// Of a run whose points are all unlike each other about so many share a row.
const UNLIKE: usize = 16;
/// Rows that a run of unlike points may have in any case.
const LEAST_UNLIKE: usize = 2;

/// The receivers that are left, ascending, and for each of all which of these it takes its light from.
pub(super) struct Shared {
    pub(super) heads: Vec<u32>,
    pub(super) served_by: Vec<u32>,
}

fn is_like(point: &Receiver, head: &Receiver) -> bool {
    let apart = point.position - head.position;
    point.geometric_normal.dot(head.geometric_normal) > SAME_FACE
        && point.shading_normal.dot(head.shading_normal) > SAME_FACE
        && apart.dot(head.geometric_normal).abs() <= SAME_PLANE * apart.length() + 1e-4
        && (point.gloss.roughness - head.gloss.roughness).abs() < SAME_LOBE
        // the same place, seen straight and in a mirror, has two lobes
        && point.gloss.view.dot(head.gloss.view) > SAME_FACE * point.gloss.view.length_squared()
}

/// Which of a run's receivers serve which: pairs of a receiver and its head.
fn of_run(points: &[Receiver], run: &[u32]) -> Vec<(u32, u32)> {
    let most = run.len().div_ceil(UNLIKE).max(LEAST_UNLIKE);
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for &number in run {
        let point = &points[number as usize];
        let head = |group: &[u32]| &points[group[0] as usize];
        match groups.iter().position(|group| is_like(point, head(group))) {
            Some(home) => groups[home].push(number),
            None if groups.len() < most => groups.push(vec![number]),
            None => {
                let unlike =
                    |group: &[u32]| head(group).shading_normal.distance_squared(point.shading_normal);
                let nearest =
                    (0..groups.len()).min_by(|&a, &b| unlike(&groups[a]).total_cmp(&unlike(&groups[b])));
                groups[nearest.unwrap_or(0)].push(number);
            }
        }
    }
    let serve = |group: Vec<u32>| {
        let position = |number: u32| points[number as usize].position;
        let mean = group.iter().map(|&number| position(number)).sum::<Vec3>() / group.len() as f32;
        let off = |&number: &u32| position(number).distance_squared(mean);
        let first = group[0];
        let middle =
            group.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b))).unwrap_or(first);
        group.into_iter().map(move |number| (number, middle))
    };
    groups.into_iter().flat_map(serve).collect()
}

impl Shared {
    /// Lets up to `most` receivers share.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub(super) fn new(points: &[Receiver], most: usize, progress: &dyn Progress) -> Result<Self> {
        let places: Vec<(Vec3, Vec3)> =
            points.iter().map(|point| (point.position, point.shading_normal)).collect();
        let low = points.iter().fold(Vec3::INFINITY, |low, point| low.min(point.position));
        let high = points.iter().fold(Vec3::NEG_INFINITY, |high, point| high.max(point.position));
        let order = cluster_order(&places, low.distance(high), [most, 1], progress)?;
        let pairs: Vec<(u32, u32)> =
            order.par_chunks(most).flat_map_iter(|run| of_run(points, run)).collect();
        let mut served_by = vec![0; points.len()];
        for &(number, head) in &pairs {
            served_by[number as usize] = head;
        }
        let heads: Vec<u32> = (0..)
            .zip(&served_by)
            .filter(|&(number, &head)| number == head)
            .map(|(number, _)| number)
            .collect();
        let mut places = vec![0; points.len()];
        for (place, &head) in (0..).zip(&heads) {
            places[head as usize] = place;
        }
        served_by.iter_mut().for_each(|head| *head = places[*head as usize]);
        Ok(Self { heads, served_by })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Gloss;

    fn point(position: Vec3, normal: Vec3) -> Receiver {
        let gloss = Gloss { view: Vec3::ONE.normalize(), ..Gloss::default() };
        Receiver { position, shading_normal: normal, geometric_normal: normal, gloss }
    }

    fn shared(points: &[Receiver], most: usize) -> Shared {
        Shared::new(points, most, &()).unwrap()
    }

    #[test]
    fn a_floor_shares_and_a_wall_beside_it_does_not_share_with_it() {
        let on_floor = |i: usize| point(Vec3::new((i % 16) as f32, 0.0, (i / 16) as f32) * 0.01, Vec3::Y);
        let on_wall = |i: usize| point(Vec3::new((i % 16) as f32, (i / 16) as f32, 0.0) * 0.01, Vec3::Z);
        let points: Vec<Receiver> = (0..256).map(on_floor).chain((0..256).map(on_wall)).collect();
        assert!(shared(&points, 4).heads.len() >= 128);
        let Shared { heads, served_by } = shared(&points, 16);
        assert!((32..48).contains(&heads.len()), "{} rows for 512 points", heads.len());
        for (point, &head) in points.iter().zip(&served_by) {
            let head = &points[heads[head as usize] as usize];
            assert_eq!(point.geometric_normal, head.geometric_normal);
            assert!(point.position.distance(head.position) < 0.1);
        }
        for (place, &head) in heads.iter().enumerate() {
            assert_eq!(served_by[head as usize] as usize, place, "a head serves itself");
        }
    }

    #[test]
    fn points_that_are_all_unlike_keep_some_of_their_rows() {
        let direction = |i: usize| {
            let (height, turn) = (1.0 - (2 * i + 1) as f32 / 64.0, i as f32 * 2.4);
            let across = (1.0 - height * height).sqrt();
            Vec3::new(across * turn.cos(), height, across * turn.sin())
        };
        let points: Vec<Receiver> = (0..64).map(|i| point(direction(i), direction(i))).collect();
        assert_eq!(shared(&points, 64).heads.len(), 4);
        assert_eq!(shared(&points, 8).heads.len(), 16);
        assert_eq!(shared(&points, 1).heads.len(), 64, "nothing is shared");
    }
}
