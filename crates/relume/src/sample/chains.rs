//! What the camera sees in mirrors and through glass.
//!
//! From a view sample on a smooth surface the view goes on, mirrored and passing through (Hasan 2006, section 6, names this as future
//! work). Wherever it meets a surface there is one more view sample, of which the camera sees a part: a *branch*. Where it meets nothing it ends
//! in the sky. On the way it may see lights themselves.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{PackedUnit, ViewSample};
use crate::scene::{Geometry, Scene};
use crate::shade::{self, LEAST_THROUGHPUT, MAX_SPECULAR_EVENTS, Medium, Surface, ViewCone};
use crate::trace::{Accel, Hit, Ray, offset_origin};

/// Views that are followed from one view sample, at most: glass behind glass parts them again and again.
const MAX_VIEWS: usize = 32;

/// A view sample that is seen by way of others. 84 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Branch {
    /// The sample; its depth is the length of the whole way.
    pub sample: ViewSample,
    /// Where a camera would stand that saw it straight, at that depth.
    pub eye: Vec3,
    /// The part of its light that reaches the camera.
    pub throughput: PackedUnit,
    padding: u16,
    /// The view sample that the way starts from, by its number among the centres or quads.
    pub owner: u32,
    /// Length of the last part of the way, metres.
    pub last: f32,
    /// [`ViewCone::width`] where it starts, metres.
    pub width: f32,
    /// [`ViewCone::spread`] of what is seen along it, radians; 0 where lights do not show themselves: where the way is still the camera's own,
    /// through panes, and within tinted solids.
    pub spread: f32,
}

/// A view that leaves the scene after it was turned. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SkyView {
    /// Where it starts, metres.
    pub origin: Vec3,
    /// Unit; where the light comes from.
    pub direction: Vec3,
    /// The part of it that reaches the camera.
    pub throughput: Vec3,
    /// [`ViewCone::width`] there, metres.
    pub width: f32,
    /// [`ViewCone::spread`], radians.
    pub spread: f32,
    /// As [`Branch::owner`].
    pub owner: u32,
}

/// All that is seen by way of smooth surfaces, ordered by owners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chains {
    /// On surfaces.
    pub branches: Vec<Branch>,
    /// Emitted radiance of those branches that emit, by index.
    pub emission: Vec<(u32, Vec3)>,
    /// In the sky.
    pub sky: Vec<SkyView>,
}

/// Chains with what their last rays hit, one for each branch, and the directions of these rays.
#[derive(Clone, Debug, Default)]
pub(super) struct Followed {
    pub(super) chains: Chains,
    pub(super) hits: Vec<(Hit, Vec3)>,
}

/// What views are followed in.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    pub(super) scene: &'a Scene,
    pub(super) geometry: &'a Geometry,
    pub(super) accel: &'a Accel,
}

/// A view on its way.
#[derive(Clone, Copy)]
struct View {
    throughput: Vec3,
    /// So far, metres.
    length: f32,
    cone: ViewCone,
    events: u32,
    medium: Medium,
}

impl Branch {
    /// Unit, from the sample to where its light goes.
    pub fn view(&self) -> Vec3 {
        (self.eye - self.sample.position) / self.sample.depth
    }

    /// The last part of the way.
    pub fn last_ray(&self) -> Ray {
        let view = self.view();
        Ray { t_max: self.last, ..Ray::new(self.sample.position + view * self.last, -view) }
    }

    /// How wide the view is along it, if lights show themselves there.
    pub fn cone(&self) -> Option<ViewCone> {
        (self.spread > 0.0).then(|| ViewCone::of_turned(self.width, self.spread))
    }
}

impl SkyView {
    /// The way of the view.
    pub fn ray(&self) -> Ray {
        Ray::new(self.origin, self.direction)
    }

    /// How wide it is.
    pub fn cone(&self) -> ViewCone {
        ViewCone::of_turned(self.width, self.spread)
    }
}

impl Chains {
    /// Sizes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.branches) + size_of_val(&*self.emission) + size_of_val(&*self.sky)
    }

    /// Appends chains of later owners.
    pub(super) fn append(&mut self, mut later: Self) {
        let first = self.branches.len() as u32;
        self.branches.append(&mut later.branches);
        self.emission.extend(later.emission.into_iter().map(|(index, light)| (first + index, light)));
        self.sky.append(&mut later.sky);
    }

    /// The branches that are seen by way of a view sample.
    pub fn of_owner(&self, owner: usize) -> &[Branch] {
        &self.branches[self.range_of(owner)]
    }

    /// Their numbers.
    pub(super) fn range_of(&self, owner: usize) -> Range<usize> {
        let before = |owner: usize| self.branches.partition_point(|branch| (branch.owner as usize) < owner);
        if self.branches.is_empty() { 0..0 } else { before(owner)..before(owner + 1) }
    }
}

impl Followed {
    /// Follows the views from `surface`, the first that the view sample `owner` sees, along a ray of this direction and length.
    pub(super) fn follow(
        &mut self,
        around: Surroundings<'_>,
        owner: u32,
        surface: &Surface,
        (direction, length, cone): (Vec3, f32, ViewCone),
    ) {
        let first = View { throughput: Vec3::ONE, length, cone, events: 0, medium: Medium::default() };
        let mut waiting = Vec::new();
        first.go_on(surface, (-direction, length), &mut waiting);
        for _ in 0..MAX_VIEWS {
            // the one that shows most, and of those the first
            let brightness = |&(view, _): &(View, Ray)| view.throughput.element_sum();
            let brighter = |best: usize, next: usize| {
                if brightness(&waiting[next]) > brightness(&waiting[best]) { next } else { best }
            };
            let Some(next) = (0..waiting.len()).reduce(brighter) else { break };
            let (mut view, ray) = waiting.remove(next);
            let hit = around.accel.closest(&ray);
            if !hit.is_hit() {
                self.chains.sky.extend(view.sky(&ray, owner));
                continue;
            }
            view.throughput *= view.medium.transmittance(hit.t);
            view.length += hit.t;
            let surface = shade::surface_at(around.scene, around.geometry, &hit, ray.direction);
            if view.throughput.max_element() >= LEAST_THROUGHPUT {
                self.add(around.scene, &view, &surface, (&ray, hit), owner);
                view.go_on(&surface, (-ray.direction, hit.t), &mut waiting);
            }
        }
    }

    fn add(&mut self, scene: &Scene, view: &View, surface: &Surface, (ray, hit): (&Ray, Hit), owner: u32) {
        let chains = &mut self.chains;
        if surface.emission != Vec3::ZERO && surface.lit {
            chains.emission.push((chains.branches.len() as u32, surface.emission));
        }
        let eye = surface.position - ray.direction * view.length;
        let base_color = scene.materials[surface.material as usize].base_color.truncate();
        let sample = ViewSample::new(surface, eye, base_color);
        let throughput = PackedUnit::new(view.throughput);
        let ViewCone { width, spread, turned, .. } = view.cone;
        let spread = if turned && view.medium == Medium::default() { spread } else { 0.0 };
        let last = hit.t;
        chains.branches.push(Branch { sample, eye, throughput, padding: 0, owner, last, width, spread });
        self.hits.push((hit, ray.direction));
    }
}

impl View {
    /// What is seen where the view meets nothing; the sky shows only to views that were turned, and no solid is without end.
    fn sky(&self, ray: &Ray, owner: u32) -> Option<SkyView> {
        let Self { throughput, cone: ViewCone { width, spread, turned, .. }, medium, .. } = *self;
        let (origin, direction) = (ray.origin, ray.direction);
        let free = turned && medium.extinction == Vec3::ZERO;
        free.then_some(SkyView { origin, direction, throughput, width, spread, owner })
    }

    /// The views from `surface` that are worth following. It is seen along the unit `view`, so many metres away.
    fn go_on(self, surface: &Surface, (view, metres): (Vec3, f32), waiting: &mut Vec<(Self, Ray)>) {
        if self.events == MAX_SPECULAR_EVENTS {
            return;
        }
        for event in surface.specular_events(view) {
            let throughput = self.throughput * event.weight;
            if throughput.max_element() < LEAST_THROUGHPUT {
                continue;
            }
            let beyond = event.direction.dot(surface.geometric_normal) < 0.0;
            let side = if beyond { -surface.geometric_normal } else { surface.geometric_normal };
            let ray = Ray::new(offset_origin(surface.position, side), event.direction);
            let medium = event.medium.unwrap_or(self.medium);
            let cone = self.cone.after(metres, surface, view, &event);
            waiting.push((Self { throughput, events: self.events + 1, medium, cone, ..self }, ray));
        }
    }
}
