//! Which points speak for a cell's light.
//!
//! What view samples see of a cell is what its light must tell of: its sub-samples are chosen among the sightings of
//! it, evenly over them. A wall behind its panelling is part of the cell's area, and nothing of its light.

use glam::{Vec2, Vec3};

use super::cells::at;
use super::sightings::Sighting;
use super::{DiffusePart, PackedNormal, PackedUnit, SUB_SAMPLES, SubSample};
use crate::scene::{Geometry, Scene};
use crate::shade::{self, Surface};
use crate::trace::sampling::{hash, unit};

/// Weight of a sighting by a surface, which is how bounces see the cell, against one by a view sample.
const BOUNCE_WEIGHT: f32 = 0.25;
/// What points spread evenly over the cell weigh together.
const PRIOR_WEIGHT: f32 = 0.5;
/// Sightings of a cell that are looked at.
const MOST: usize = 512;

/// A point of a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Speaker {
    pub(super) side: usize,
    pub(super) uv: Vec2,
    pub(super) position: Vec3,
    /// Of the triangle, on the side that is meant.
    pub(super) normal: Vec3,
    /// Of those chosen, they add up to 1.
    pub(super) weight: f32,
}

impl Speaker {
    pub(super) fn new(geometry: &Geometry, side: usize, uv: Vec2, weight: f32) -> Self {
        let area = geometry.area_vector(side / 2).normalize_or_zero();
        Self {
            side,
            uv,
            position: at(geometry.corners(side / 2), uv),
            normal: if side % 2 == 1 { -area } else { area },
            weight,
        }
    }

    /// Sightings of a cell as points, each with its side; some of them, where there are many.
    pub(super) fn of_sightings(geometry: &Geometry, seen: &[(usize, Sighting)]) -> Vec<Self> {
        let point = |&(side, sighting): &(usize, Sighting)| {
            let weight = if sighting.observer == Sighting::SURFACE { BOUNCE_WEIGHT } else { 1.0 };
            Self::new(geometry, side, sighting.uv(), weight)
        };
        seen.iter().step_by(seen.len().div_ceil(MOST).max(1)).map(point).collect()
    }

    /// As many as a gather sample has sub-samples, neighbours together. `spread` are points spread evenly over the
    /// cell, `seen` its sightings. Without either, all weigh nothing.
    pub(super) fn chosen(spread: &[Self], seen: &[Self], seed: u32) -> [Self; SUB_SAMPLES] {
        let mut points: Vec<Self> = spread
            .iter()
            .map(|point| Self { weight: PRIOR_WEIGHT / spread.len() as f32, ..*point })
            .collect();
        points.extend_from_slice(seen);
        let mut chosen =
            [Self { side: 0, uv: Vec2::ZERO, position: Vec3::ZERO, normal: Vec3::Y, weight: 0.0 };
                SUB_SAMPLES];
        if points.is_empty() {
            return chosen;
        }
        let total: f32 = points.iter().map(|point| point.weight).sum();
        choose(&mut points, &mut chosen, seed);
        chosen.iter_mut().for_each(|point| point.weight /= total);
        chosen
    }

    /// The one nearest to their middle that faces as they do. `area` is the cell's.
    ///
    /// # Panics
    /// If there are none.
    pub(super) fn typical(speakers: &[Self], area: f32) -> Self {
        let mean = |of: fn(&Self) -> Vec3| speakers.iter().map(|s| of(s) * s.weight).sum::<Vec3>();
        let (middle, facing) = (mean(|s| s.position), mean(|s| s.normal));
        let unlike = |speaker: &Self| {
            speaker.position.distance_squared(middle) + area * speaker.normal.distance_squared(facing)
        };
        let mut best = speakers[0];
        for speaker in speakers.iter().filter(|speaker| speaker.weight > 0.0) {
            if best.weight == 0.0 || unlike(speaker) < unlike(&best) {
                best = *speaker;
            }
        }
        best
    }

    pub(super) fn surface(&self, scene: &Scene, geometry: &Geometry) -> Surface {
        shade::surface_on_triangle(
            scene,
            geometry,
            (self.side / 2) as u32,
            self.uv.x,
            self.uv.y,
            self.side.is_multiple_of(2),
        )
    }

    pub(super) fn sub_sample(&self, scene: &Scene, geometry: &Geometry) -> SubSample {
        let surface = self.surface(scene, geometry);
        SubSample {
            position: self.position,
            normal: PackedNormal::new(self.normal),
            albedo: PackedUnit::new(surface.hemispherical_reflectance()),
            weight: (self.weight * 65535.0).round() as u16,
        }
    }

    pub(super) fn diffuse_part(&self, scene: &Scene, geometry: &Geometry) -> DiffusePart {
        let surface = self.surface(scene, geometry);
        let white = surface.with_base_color(Vec3::ONE).hemispherical_diffuse();
        DiffusePart::new(PackedUnit::new(white), surface.material)
    }
}

/// Halves `points` by weight, along the axis on which they spread most, until there is one part for each of `chosen`; picks
/// one of each part at random by weight, which then stands for all of it.
fn choose(points: &mut [Speaker], chosen: &mut [Speaker], seed: u32) {
    let total: f32 = points.iter().map(|point| point.weight).sum();
    if points.is_empty() {
        return;
    }
    if let [one] = chosen {
        let mut left = total * unit(seed);
        let picked = points.iter().find(|point| {
            left -= point.weight;
            left < 0.0
        });
        *one = Speaker { weight: total, ..*picked.unwrap_or(&points[0]) };
        return;
    }
    let (mut low, mut high) = (points[0].position, points[0].position);
    for point in points.iter() {
        (low, high) = (low.min(point.position), high.max(point.position));
    }
    let axis = (high - low).max_position();
    points.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
    let (mut sum, mut middle) = (0.0, 0);
    while middle < points.len() - 1 && (middle == 0 || sum + 0.5 * points[middle].weight < 0.5 * total) {
        sum += points[middle].weight;
        middle += 1;
    }
    let (near, far) = points.split_at_mut(middle.max(usize::from(points.len() == 1)));
    let (first, second) = chosen.split_at_mut(chosen.len() / 2);
    choose(near, first, hash(0, seed));
    choose(far, second, hash(1, seed));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f32, weight: f32) -> Speaker {
        Speaker { side: 0, uv: Vec2::ZERO, position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y, weight }
    }

    fn chosen(points: &mut [Speaker], seed: u32) -> [Speaker; SUB_SAMPLES] {
        let mut chosen = [point(0.0, 0.0); SUB_SAMPLES];
        choose(points, &mut chosen, seed);
        chosen
    }

    #[test]
    fn the_chosen_speak_for_all_in_proportion() {
        let mut points: Vec<Speaker> =
            (0..400).map(|i| point(i as f32, if i < 100 { 3.0 } else { 1.0 })).collect();
        let chosen = chosen(&mut points, 7);
        let total: f32 = chosen.iter().map(|s| s.weight).sum();
        assert!((total - 600.0).abs() < 1e-3, "{total}");
        let of_heavy: f32 = chosen.iter().filter(|s| s.position.x < 100.0).map(|s| s.weight).sum();
        assert!((of_heavy - 300.0).abs() < 5.0, "{of_heavy}");
        // neighbours stay together
        assert!(chosen.windows(2).all(|pair| pair[0].position.x < pair[1].position.x));
    }

    #[test]
    fn fewer_points_than_places_leave_places_without_weight() {
        let chosen = chosen(&mut [point(1.0, 2.0), point(2.0, 1.0), point(3.0, 1.0)], 1);
        assert_eq!(chosen.iter().filter(|s| s.weight > 0.0).count(), 3);
        assert_eq!(chosen.iter().map(|s| s.weight).sum::<f32>(), 4.0);
    }
}
