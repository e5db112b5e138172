use glam::{Vec2, Vec3};

use super::World;
use crate::scene::{Geometry, Scene};
use crate::shade::{Surface, surface_on_triangle};
use crate::trace::sampling::uniform_triangle;

/// The triangles that shine, to be drawn with a probability proportional to their power. Emission textures are ignored
/// in the choice but not in the light.
#[derive(Clone, Debug, Default)]
pub(super) struct Emitters {
    /// Ascending.
    triangles: Vec<u32>,
    /// Sums of the powers up to and including each triangle; relative.
    cumulative: Vec<f64>,
    /// Probability density per area, 1/m^2, of each.
    densities: Vec<f32>,
}

/// A point drawn from the emitters, as another point sees it.
pub(super) struct EmitterSample {
    /// On the emitter, world space.
    pub(super) position: Vec3,
    /// Unit, towards it.
    pub(super) direction: Vec3,
    /// Emitted radiance towards the point that asks, W/(sr m^2).
    pub(super) radiance: Vec3,
    /// Per solid angle as the point that asks sees it, 1/sr.
    pub(super) density: f32,
}

impl Emitters {
    /// `scales` are what the materials' emission is multiplied by.
    pub(super) fn new(scene: &Scene, geometry: &Geometry, scales: &[Vec3]) -> Self {
        let mut emitters = Self::default();
        let mut powers = Vec::new();
        let mut total = 0.0;
        for (triangle, &material) in geometry.materials.iter().enumerate() {
            let emission = scene.materials[material as usize].emission * scales[material as usize];
            let material = &scene.materials[material as usize];
            if emission == Vec3::ZERO {
                continue;
            }
            let area = 0.5 * f64::from(geometry.area_vector(triangle).length());
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            let power_per_area = sides * f64::from(emission.element_sum());
            let power = area * power_per_area;
            if power > 0.0 {
                total += power;
                emitters.triangles.push(triangle as u32);
                emitters.cumulative.push(total);
                powers.push(power_per_area);
            }
        }
        emitters.densities = powers.iter().map(|power_per_area| (power_per_area / total) as f32).collect();
        emitters
    }

    pub(super) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Density per area, 1/m^2, with which points of `triangle` are drawn.
    pub(super) fn density(&self, triangle: u32) -> f32 {
        self.triangles.binary_search(&triangle).map_or(0.0, |index| self.densities[index])
    }

    /// Draws a point for one at `position`: the triangle by `choice`, the place by `sample`. `None` where no light
    /// leaves it towards `position`: its dark side, a hole of its mask, a black texel.
    pub(super) fn sample(
        &self,
        world: &World<'_>,
        position: Vec3,
        choice: f32,
        sample: Vec2,
    ) -> Option<EmitterSample> {
        let target = f64::from(choice) * self.cumulative.last()?;
        let index = self.cumulative.partition_point(|&sum| sum <= target).min(self.triangles.len() - 1);
        let triangle = self.triangles[index];
        let (u, v) = uniform_triangle(sample);
        let [a, b, c] = world.geometry.corners(triangle as usize);
        let to_emitter = a + (b - a) * u + (c - a) * v - position;
        let front = world.geometry.area_vector(triangle as usize).dot(to_emitter) < 0.0;
        let emitter = surface_on_triangle(world.scene, world.geometry, triangle, u, v, front);
        let radiance = world.emission(&emitter);
        if radiance == Vec3::ZERO || !world.accel.masks().is_solid(triangle, u, v) {
            return None;
        }
        let distance2 = to_emitter.length_squared();
        let direction = to_emitter / distance2.sqrt();
        let density = solid_angle_density(self.densities[index], distance2, &emitter, direction)?;
        Some(EmitterSample { position: emitter.position, direction, radiance, density })
    }
}

/// A density per area of `emitter` as one per solid angle, seen from `distance2` (m^2) along the unit `direction`.
/// `None` where the emitter is seen edge-on.
pub(super) fn solid_angle_density(
    density: f32,
    distance2: f32,
    emitter: &Surface,
    direction: Vec3,
) -> Option<f32> {
    let cos = -emitter.geometric_normal.dot(direction);
    let density = density * distance2 / cos;
    (cos > 0.0 && density > 0.0 && density.is_finite()).then_some(density)
}

/// The power heuristic (Veach 1997, section 9.2.4): the weight of a sample drawn with `density` where another
/// strategy would have drawn it with `other`.
pub(super) fn power_heuristic(density: f32, other: f32) -> f32 {
    let ratio = other / density;
    1.0 / (1.0 + ratio * ratio)
}
