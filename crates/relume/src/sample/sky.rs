//! The sky's part of the cloud: cells of directions, as if on a sphere far around the scene.
//!
//! Hasan 2006 (section 6) proposes environment samples beside those of surfaces, "to handle environment map lighting". Here a sixteenth of the
//! cloud is sky wherever the scene is open to it. Rays that meet nothing then find a cell like all others, and rows of transfer tell of it
//! as they do of a wall. A dome light is a vector on these cells.
//!
//! Directions lie on a square by an area-preserving map (Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD"), cells
//! are squares of a quadtree on it: finer where single view samples depend on them, as cells of surfaces are.

use std::collections::BinaryHeap;
use std::f32::consts::{FRAC_2_PI, FRAC_PI_4, TAU};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::refine::{Candidate, Judge, Scale, UNIFORM_SHARE};
use super::sightings::Sighting;
use super::{CloudMethod, TARGETS};
use crate::trace::Ray;
use crate::trace::sampling::{hash, tangents, unit};
use crate::{Error, Progress, Result};

/// One in so many gather samples is a cell of the sky.
pub(super) const SKY_SHARE: usize = 16;
/// Bits of a place on the square along each side.
const BITS: u32 = 16;
/// The sphere's radius, in diagonals of the scene: from everywhere in it, directions to a cell differ by a thousandth.
const FAR: f32 = 1000.0;
/// A scene of which fewer rays than this share meet nothing is closed, and leaks.
const LEAK: f64 = 1e-4;

/// A part of the directions from which light comes: the sky.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SkyCells {
    /// Where each cell begins in the Z order of the square, of `2^32` places; each ends where the next one begins.
    starts: Vec<u32>,
}

/// The place of a unit direction on the unit square: the upper half of the sphere (+Y) in the middle.
fn to_square(direction: Vec3) -> Vec2 {
    let [x, y, z] = [direction.z, direction.x, direction.y];
    let (across, along) = (x.abs(), y.abs());
    // 1 - |z| without cancellation
    let radius = ((x * x + y * y) / (1.0 + z.abs())).min(1.0).sqrt();
    let (larger, smaller) = (across.max(along), across.min(along));
    let angle = if larger > 0.0 { (smaller / larger).atan() * FRAC_2_PI } else { 0.0 };
    let angle = if across < along { 1.0 - angle } else { angle };
    let v = angle * radius;
    let mut place = Vec2::new(radius - v, v);
    if z < 0.0 {
        place = Vec2::new(1.0 - place.y, 1.0 - place.x);
    }
    0.5 * Vec2::new(place.x.copysign(x), place.y.copysign(y)) + 0.5
}

/// The inverse of [`to_square`].
fn to_direction(place: Vec2) -> Vec3 {
    let place = 2.0 * place - 1.0;
    let (u, v) = (place.x.abs(), place.y.abs());
    let inside = 1.0 - (u + v);
    let radius = 1.0 - inside.abs();
    let angle = if radius > 0.0 { ((v - u) / radius + 1.0) * FRAC_PI_4 } else { 0.0 };
    let z = (1.0 - radius * radius).copysign(inside);
    let out = radius * (2.0 - radius * radius).max(0.0).sqrt();
    let (x, y) = ((angle.cos() * out).copysign(place.x), (angle.sin() * out).copysign(place.y));
    Vec3::new(y, z, x).normalize()
}

/// 16 bits at the even places of 32.
fn spread(bits: u32) -> u32 {
    let bits = (bits | bits << 8) & 0x00ff_00ff;
    let bits = (bits | bits << 4) & 0x0f0f_0f0f;
    let bits = (bits | bits << 2) & 0x3333_3333;
    (bits | bits << 1) & 0x5555_5555
}

/// The bits at even places.
fn gathered(bits: u32) -> u32 {
    (0..BITS).fold(0, |all, bit| all | (bits >> (2 * bit) & 1) << bit)
}

/// The place of a direction in the Z order of the square.
pub(super) fn code_of(direction: Vec3) -> u32 {
    let size = (1 << BITS) as f32;
    let [x, y] = (to_square(direction) * size).to_array().map(|side| (side as u32).min((1 << BITS) - 1));
    spread(x) | spread(y) << 1
}

impl SkyCells {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// Whether there are none: the scene is closed, or it was prepared without the sky.
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// Where each cell begins: for a file.
    pub(crate) fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// Cells that begin there; `None` unless each is a square of the quadtree and they cover all directions.
    pub(crate) fn from_starts(starts: Vec<u32>) -> Option<Self> {
        let cells = Self { starts };
        let is_square = |cell: usize| {
            let size = cells.size(cell)?;
            let fits = size.is_power_of_two() && size.trailing_zeros().is_multiple_of(2);
            (fits && u64::from(cells.starts[cell]).is_multiple_of(size)).then_some(())
        };
        let covers = cells.starts.first().is_none_or(|&first| first == 0);
        (covers && (0..cells.len()).all(|cell| is_square(cell).is_some())).then_some(cells)
    }

    /// Places of a cell, of `2^32`; `None` where the next one begins before.
    fn size(&self, cell: usize) -> Option<u64> {
        let end = self.starts.get(cell + 1).map_or(1 << 32, |&next| u64::from(next));
        end.checked_sub(u64::from(self.starts[cell])).filter(|&size| size > 0)
    }

    /// The cell that a unit direction lies in; `None` where there are none.
    pub fn cell_at(&self, direction: Vec3) -> Option<usize> {
        let code = code_of(direction);
        self.starts.partition_point(|&start| start <= code).checked_sub(1)
    }

    /// Solid angle of a cell, steradians.
    ///
    /// # Panics
    /// If there is no such cell.
    pub fn solid_angle(&self, cell: usize) -> f32 {
        let size = self.size(cell).unwrap_or(0);
        (4.0 * std::f64::consts::PI * size as f64 / (1_u64 << 32) as f64) as f32
    }

    /// A direction within a cell; `within` is its place in the cell, in `[0, 1)^2`.
    ///
    /// # Panics
    /// If there is no such cell.
    pub fn direction(&self, cell: usize, within: Vec2) -> Vec3 {
        let start = self.starts[cell];
        let side = (self.size(cell).unwrap_or(1) as f64).sqrt() as f32;
        let corner = Vec2::new(gathered(start) as f32, gathered(start >> 1) as f32);
        to_direction((corner + within * side) / (1 << BITS) as f32)
    }

    /// Directions evenly over a cell, one in each of [`TARGETS`] parts.
    pub(crate) fn targets(&self, cell: usize, seed: u32) -> [Vec3; TARGETS] {
        const SIDE: usize = TARGETS.isqrt();
        std::array::from_fn(|target| {
            let random = [0, 1].map(|axis| unit(hash(2 * target as u32 + axis, hash(cell as u32, seed))));
            let place = Vec2::new((target % SIDE) as f32, (target / SIDE) as f32);
            self.direction(cell, (place + Vec2::from(random)) / SIDE as f32)
        })
    }

    /// `count` cells, a power of four, or none in a closed scene: where nobody's rays but a few met nothing.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn new(
        mut sightings: SkySightings,
        method: CloudMethod,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        if (sightings.all.len() as f64) < LEAK * sightings.rays.max(1) as f64 || sightings.all.is_empty() {
            return Ok(Self::default());
        }
        sightings.all.par_sort_unstable();
        let scale = Scale {
            total_area: 1.0,
            by_views: sightings.all.iter().filter(|(_, observer)| *observer != Sighting::SURFACE).count(),
            observers: sightings.observers,
        };
        let mut growing =
            Growing { sightings: &sightings.all, scale, squares: vec![Square { start: 0, size: 1 << 32 }] };
        match method {
            CloudMethod::Uniform => growing.grow(Judge::Area, count, progress)?,
            CloudMethod::Importance => growing.grow(Judge::Importance, count, progress)?,
            CloudMethod::Adaptive => {
                growing.grow(Judge::Area, (count as f64 * UNIFORM_SHARE) as usize, progress)?;
                growing.grow(Judge::Pairs, count, progress)?;
            }
        }
        let mut starts: Vec<u32> = growing.squares.iter().map(|square| square.start).collect();
        starts.sort_unstable();
        Ok(Self { starts })
    }
}

/// Rays that met nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct SkySightings {
    /// Where on the square, and by whom: the number of the view sample, or [`Sighting::SURFACE`].
    pub(super) all: Vec<(u32, u32)>,
    /// Observers are below this.
    pub(super) observers: usize,
    /// All rays, also those that met something.
    pub(super) rays: usize,
}

/// A square of the quadtree: its first place in the Z order, and how many it has.
#[derive(Clone, Copy, Debug)]
struct Square {
    start: u32,
    size: u64,
}

struct Growing<'a> {
    /// In the order of the square.
    sightings: &'a [(u32, u32)],
    scale: Scale,
    squares: Vec<Square>,
}

impl Growing<'_> {
    fn weight(&self, judge: Judge, square: Square) -> f64 {
        if square.size < 4 {
            return 0.0;
        }
        let first = self.sightings.partition_point(|&(code, _)| code < square.start);
        let end = u64::from(square.start) + square.size;
        let seen = &self.sightings[first..];
        let seen = &seen[..seen.partition_point(|&(code, _)| u64::from(code) < end)];
        let area = square.size as f64 / (1_u64 << 32) as f64;
        let observers = || seen.iter().map(|&(_, observer)| observer).collect();
        judge.weight((area, seen.len()), observers, &self.scale)
    }

    /// Quarters the heaviest squares until there are `count`, or a few more.
    fn grow(&mut self, judge: Judge, count: usize, progress: &dyn Progress) -> Result<()> {
        let weights: Vec<f64> = self.squares.par_iter().map(|&square| self.weight(judge, square)).collect();
        let mut heap: BinaryHeap<Candidate> =
            weights.into_iter().zip(0..).map(|(weight, number)| Candidate(weight, number)).collect();
        while self.squares.len() < count {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let Some(Candidate(_, number)) = heap.pop() else { break };
            let Square { start, size } = self.squares[number as usize];
            if size < 4 {
                break;
            }
            let quarters: [Square; 4] = std::array::from_fn(|quarter| Square {
                start: start + (size / 4 * quarter as u64) as u32,
                size: size / 4,
            });
            let weights: Vec<f64> = quarters.par_iter().map(|&quarter| self.weight(judge, quarter)).collect();
            for (quarter, (square, weight)) in quarters.into_iter().zip(weights).enumerate() {
                let number = if quarter == 0 { number } else { self.squares.len() as u32 };
                if quarter == 0 {
                    self.squares[number as usize] = square;
                } else {
                    self.squares.push(square);
                }
                heap.push(Candidate(weight, number));
            }
        }
        Ok(())
    }
}

/// The sphere on which the sky's cells are meant to lie.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SkySphere {
    middle: Vec3,
    /// Metres.
    pub(super) radius: f32,
}

impl SkySphere {
    /// Around a scene of these bounds.
    pub(super) fn around(low: Vec3, high: Vec3) -> Self {
        Self { middle: 0.5 * (low + high), radius: FAR * low.distance(high).max(1e-6) }
    }

    /// Where a direction meets it.
    pub(super) fn at(&self, direction: Vec3) -> Vec3 {
        self.middle + direction * self.radius
    }

    /// The area of a solid angle on it, square metres.
    pub(super) fn area(&self, solid_angle: f32) -> f32 {
        solid_angle * self.radius * self.radius
    }

    /// Half the scene's diagonal.
    fn scene_radius(&self) -> f32 {
        0.5 * self.radius / FAR
    }

    /// A ray into the scene from the direction of a point on the sphere; `within`, in `[0, 1)^2`, is its place on the disc that holds the
    /// scene, seen from there.
    pub(super) fn ray_from(&self, point: Vec3, within: Vec2) -> Ray {
        let direction = (self.middle - point).normalize();
        let (tangent, bitangent) = tangents(direction);
        let (radius, angle) = (self.scene_radius() * within.x.sqrt(), TAU * within.y);
        let aside = tangent * (radius * angle.cos()) + bitangent * (radius * angle.sin());
        Ray::new(self.middle - direction * (2.0 * self.scene_radius()) + aside, direction)
    }

    /// What passes through that disc from an `area` of the sphere of radiance 1, over pi; square metres.
    pub(super) fn flux(&self, area: f32) -> f32 {
        let scale = self.scene_radius() / self.radius;
        area * scale * scale
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;
    use crate::trace::sampling::{sobol_2d, uniform_sphere};

    fn directions(count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(|index| uniform_sphere(sobol_2d(index, 0, 5)))
    }

    #[test]
    fn every_direction_has_a_place_from_which_it_comes_back() {
        let poles = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        for direction in directions(4096).chain(poles) {
            let place = to_square(direction);
            assert!(place.min_element() >= 0.0 && place.max_element() <= 1.0, "{place}");
            let back = to_direction(place);
            assert!(back.distance(direction) < 1e-4, "{direction} came back as {back}");
        }
    }

    #[test]
    fn equal_squares_are_equal_solid_angles() {
        let mut counts = [0; 64];
        for direction in directions(64 * 1024) {
            counts[(code_of(direction) >> 26) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (1000..1048).contains(count)), "{counts:?}");
    }

    /// Observer 3 looks at one place again and again, others everywhere in the upper half.
    fn cells(method: CloudMethod) -> SkyCells {
        let upper = directions(20_000).filter(|direction| direction.y > 0.0);
        let mut all: Vec<(u32, u32)> =
            upper.enumerate().map(|(index, direction)| (code_of(direction), 10 + index as u32)).collect();
        let place = code_of(Vec3::new(0.3, 0.8, 0.1).normalize());
        all.extend((0..64).map(|near| (place.wrapping_add(near << 12), 3)));
        let sightings = SkySightings { rays: all.len(), observers: 30_000, all };
        SkyCells::new(sightings, method, 256, &()).unwrap()
    }

    #[test]
    fn cells_cover_the_sphere_and_are_fine_where_someone_depends_on_them() {
        for method in [CloudMethod::Uniform, CloudMethod::Importance, CloudMethod::Adaptive] {
            let cells = cells(method);
            assert_eq!(cells.len(), 256);
            let sphere: f32 = (0..256).map(|cell| cells.solid_angle(cell)).sum();
            assert!((sphere - 4.0 * PI).abs() < 1e-4, "{sphere}");
            for direction in directions(1000) {
                let cell = cells.cell_at(direction).unwrap();
                assert_eq!(cells.cell_at(cells.direction(cell, Vec2::splat(0.5))), Some(cell));
                assert!(cells.targets(cell, 1).iter().all(|target| cells.cell_at(*target) == Some(cell)));
            }
            let at = |direction: Vec3| cells.solid_angle(cells.cell_at(direction).unwrap());
            assert!(at(Vec3::NEG_Y) > 3.0 * at(Vec3::Y), "what nobody sees is coarse");
            let looked_at = at(Vec3::new(0.3, 0.8, 0.1).normalize());
            println!(
                "{method:?}: {looked_at} where one looks, {} above, {} below",
                at(Vec3::Y),
                at(Vec3::NEG_Y)
            );
            assert!(method != CloudMethod::Adaptive || looked_at < 0.3 * at(Vec3::Y));
        }
    }

    #[test]
    fn a_leak_is_no_sky_and_damage_is_found_out() {
        let leak = SkySightings { all: vec![(7, 1)], observers: 9, rays: 1 << 20 };
        assert!(SkyCells::new(leak, CloudMethod::Adaptive, 256, &()).unwrap().is_empty());
        let whole = cells(CloudMethod::Adaptive);
        assert_eq!(SkyCells::from_starts(whole.starts().to_vec()), Some(whole.clone()));
        assert_eq!(SkyCells::from_starts(Vec::new()), Some(SkyCells::default()));
        let changed = |change: fn(&mut Vec<u32>)| {
            let mut starts = whole.starts().to_vec();
            change(&mut starts);
            SkyCells::from_starts(starts)
        };
        assert_eq!(changed(|starts| starts[0] = 1), None);
        assert_eq!(changed(|starts| starts[9] += 1), None);
        assert_eq!(changed(|starts| starts.swap(8, 9)), None);
        assert_eq!(changed(|starts| starts[9] = starts[8]), None);
    }
}
