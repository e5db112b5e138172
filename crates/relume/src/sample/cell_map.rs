//! Which gather sample a ray finds.

use glam::{Vec2, Vec3};

use super::PackedNormal;
use super::refine::Cuts;
use super::sightings::side_of;
use super::sky::{SkyCells, SkySphere};
use crate::scene::Geometry;
use crate::trace::sampling::cosine_hemisphere;
use crate::trace::{Hit, Ray};

/// Points spread over the area of each cell, towards which rays ask whether it is visible.
pub const TARGETS: usize = 16;

/// The cells that gather samples stand for; needed for preparation only.
#[derive(Clone, Debug, Default)]
pub struct CellMap {
    pub(super) cuts: Cuts,
    /// [`TARGETS`] points for each gather sample, uniform over the area of its cell, lifted off the surface.
    pub targets: Vec<Vec3>,
    /// The surface's normal at each of `targets`, on the side that is lifted from.
    pub target_normals: Vec<PackedNormal>,
    /// For each gather sample, the middle of its cell's area and the mean normal, which is shorter than 1 where the cell is
    /// bent: where form factors are taken. The sample itself lies in the middle of what is seen, nearer to who sees it.
    pub middles: Vec<(Vec3, Vec3)>,
    pub(super) sky: SkyCells,
    pub(super) sphere: SkySphere,
}

impl CellMap {
    /// The gather sample that stands for where a ray of direction `direction` hit, seen from where the ray came from;
    /// `None` where no sample stands (the ray missed and there are none of the sky, or this side of the surface is never seen).
    pub fn sample_at(&self, geometry: &Geometry, hit: &Hit, direction: Vec3) -> Option<usize> {
        if !hit.is_hit() {
            let cell = self.sky.cell_at(direction)?;
            return Some(self.middles.len() - self.sky.len() + cell);
        }
        let side = side_of(geometry, hit, direction);
        self.cuts.cell_at(geometry, side, Vec2::new(hit.u, hit.v)).map(|cell| cell as usize)
    }

    /// A ray that light from a gather sample takes, and where on the sample it starts is one of `targets`: at random by cosine, from the sky
    /// towards the scene. `random` is in `[0, 1)^2`.
    pub(crate) fn emitted(&self, sample: usize, target: usize, random: Vec2) -> Ray {
        let place = sample * TARGETS + target;
        if sample < self.middles.len() - self.sky.len() {
            let normal = self.target_normals[place].get();
            Ray::new(self.targets[place], cosine_hemisphere(normal, random))
        } else {
            self.sphere.ray_from(self.targets[place], random)
        }
    }

    /// What a gather sample of an area, square metres, sends along such rays at radiance 1, over pi; square metres.
    pub(crate) fn flux(&self, sample: usize, area: f32) -> f32 {
        if sample < self.middles.len() - self.sky.len() { area } else { self.sphere.flux(area) }
    }

    /// How far away the sky's samples are, metres.
    pub(crate) fn sky_distance(&self) -> f32 {
        self.sphere.radius
    }
}
