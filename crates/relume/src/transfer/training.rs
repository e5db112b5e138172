//! Lights to learn from, and others to be judged by.
//!
//! What is learned from: random lights in the scene's free space (narrow and wide spots, omnis and suns) and, where there is a sky, skies; and what
//! shines in the scene, which is no guess. Nothing is learned from some of the random lights, which tell how much an encoding loses; and from
//! *others*, of kinds that are never learned from: needles of light, lamps at a wall, strings of lamps, low suns, even skies. Those tell how far
//! what was learned holds.

use std::f32::consts::PI;

use glam::Vec3;
use rayon::prelude::*;

use crate::progress::Progress;
use crate::sample::{CellMap, Detail, GatherCloud, GatherSample, TARGETS, cloud_groups, illuminate_with};
use crate::scene::{Light, LightKind};
use crate::shade::PointGroup;
use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, uniform_sphere, unit};
use crate::trace::{Accel, Ray, offset_origin};
use crate::{Error, Result};

/// Of a scene that is open, this share of the lights are skies.
const SKIES: f32 = 0.125;

/// Kinds of lights that are never learned from.
const OTHERS: u32 = 5;

/// Most materials that shine which are learned from each by itself, those of the most power.
const MOST_SHINING: usize = 8;

/// Steps of what a place radiates beside the brightest of its material.
const SHARES: f32 = 1024.0;

/// A light on the cloud.
enum Source {
    Lamps(Vec<Light>),
    Sky(Sky),
}

/// Radiance on the cloud under lights, the mean of the channels.
#[derive(Default)]
pub(super) struct Training {
    /// Of the kinds that are learned from, in no order.
    pub(super) alike: Vec<Vec<f32>>,
    /// Of other kinds.
    pub(super) others: Vec<Vec<f32>>,
    /// What surfaces emit, one a material, of its brightest place.
    pub(super) shining: Vec<Vec<f32>>,
    /// What a lamp that may be anywhere makes of each sample, up to a common factor; of the sky, nothing.
    pub(super) anywhere: Vec<f32>,
}

/// A sky to learn from: some glow all around, and two places that are brighter.
struct Sky {
    glow: f32,
    lobes: [Lobe; 2],
}

/// `weight exp(sharpness (cos - 1))`, scaled so that `weight` is what comes from all directions together.
struct Lobe {
    direction: Vec3,
    sharpness: f32,
    weight: f32,
}

impl Sky {
    fn random(seed: u32) -> Self {
        let random = |dimension: u32| unit(hash(dimension, seed));
        let lobe = |number: u32| Lobe {
            direction: cosine_hemisphere(Vec3::Y, sobol_2d(3 + number, 0, seed)),
            // from a glow over a quarter of the sky to a sun of two degrees
            sharpness: 3000.0_f32.powf(random(20 + number)),
            weight: random(30 + number),
        };
        Self { glow: 0.1 * random(40), lobes: [0, 1].map(lobe) }
    }

    /// The glow alone.
    fn even() -> Self {
        let none = || Lobe { direction: Vec3::Y, sharpness: 1.0, weight: 0.0 };
        Self { glow: 1.0, lobes: [none(), none()] }
    }

    fn radiance(&self, direction: Vec3) -> f32 {
        let lobe = |Lobe { direction: middle, sharpness, weight }: &Lobe| {
            let norm = sharpness / (2.0 * PI * (1.0 - (-2.0 * sharpness).exp()));
            weight * norm * (sharpness * (middle.dot(direction) - 1.0)).exp()
        };
        self.glow + self.lobes.iter().map(lobe).sum::<f32>()
    }
}

impl Training {
    /// `alike` random lights of unit flux in the free space around the cloud, and `others` of other kinds. Under a white light the colour is
    /// the albedo's, but for cells of several colours that are lit in part.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn new(
        (cloud, map): (&GatherCloud, &CellMap),
        accel: &Accel,
        (alike, others): (usize, usize),
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<Self> {
        progress.stage("training lights", (alike + others) as u64);
        let space = Space::new(cloud, accel);
        let groups = cloud_groups(cloud);
        let lit = |source: Source| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            let radiance = radiance_of(&source, (cloud, &groups), accel);
            progress.advance(1);
            Ok(radiance)
        };
        let all = |count: usize, seed: u32, source: &(dyn Fn(u32, u32) -> Source + Sync)| {
            let numbers = (0..count as u32).into_par_iter();
            numbers.map(|number| lit(source(number, hash(number, seed)))).collect::<Result<Vec<_>>>()
        };
        Ok(Self {
            alike: all(alike, seed, &|_, seed| space.usual(seed))?,
            others: all(others, hash(seed, 0x07_4e85), &|number, seed| space.unusual(number % OTHERS, seed))?,
            shining: shining(cloud),
            anywhere: anywhere(&space, map),
        })
    }
}

/// Where lights may be.
struct Space<'a> {
    cloud: &'a GatherCloud,
    accel: &'a Accel,
    /// Of the box around all surfaces, metres.
    diagonal: f32,
}

impl<'a> Space<'a> {
    fn new(cloud: &'a GatherCloud, accel: &'a Accel) -> Self {
        let positions = || cloud.surfaces().iter().map(|sample| sample.position);
        let low = positions().fold(Vec3::INFINITY, Vec3::min);
        let high = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
        Self { cloud, accel, diagonal: low.distance(high).max(1e-3) }
    }

    /// A random surface sample.
    fn surface(&self, seed: u32) -> &GatherSample {
        let surfaces = self.cloud.surfaces();
        &surfaces[((unit(hash(0, seed)) * surfaces.len() as f32) as usize).min(surfaces.len() - 1)]
    }

    /// A place in the open: a share of the way from a random surface to what lies in front of it.
    fn place(&self, seed: u32, share: impl Fn(f32) -> f32) -> Vec3 {
        let sample = self.surface(seed);
        let away = cosine_hemisphere(sample.normal, sobol_2d(0, 0, seed));
        let origin = offset_origin(sample.position, sample.normal);
        let free = self.accel.closest(&Ray::new(origin, away)).t.min(0.5 * self.diagonal);
        origin + away * share(free)
    }

    /// A light to learn from.
    fn usual(&self, seed: u32) -> Source {
        let random = |dimension: u32| unit(hash(dimension, seed));
        if !self.cloud.sky.is_empty() && random(50) < SKIES {
            return Source::Sky(Sky::random(seed));
        }
        let position = self.place(seed, |free| free * (0.03 + 0.94 * random(1)));
        Source::Lamps(vec![match random(2) {
            pick if pick < 0.5 => {
                let outer_angle = 6.0 * 8.0_f32.powf(random(3)); // 6 to 48 degrees
                spot(position, (outer_angle * (0.3 + 0.6 * random(4)), outer_angle), seed)
            }
            pick if pick < 0.85 => omni(position),
            _ => self.sun(cosine_hemisphere(Vec3::Y, sobol_2d(2, 0, seed))),
        }])
    }

    /// A light of one of the kinds that are not learned from. Where there is no sky, its light is none.
    fn unusual(&self, kind: u32, seed: u32) -> Source {
        let random = |dimension: u32| unit(hash(dimension, seed));
        let anywhere = |seed: u32| self.place(seed, |free| free * (0.1 + 0.8 * random(1)));
        match kind {
            // a needle of light
            0 => {
                let outer_angle = 2.0 + 2.0 * random(3);
                Source::Lamps(vec![spot(anywhere(seed), (0.8 * outer_angle, outer_angle), seed)])
            }
            // a lamp at a wall
            1 => Source::Lamps(vec![omni(self.place(seed, |free| free.min(AT_A_WALL * self.diagonal)))]),
            // a string of lamps
            2 => {
                let [from, to] = [0, 1].map(|end| anywhere(hash(end, seed)));
                Source::Lamps(
                    (0..STRING).map(|lamp| omni(from.lerp(to, lamp as f32 / (STRING - 1) as f32))).collect(),
                )
            }
            // a low sun
            3 => {
                let (height, turn) = ((3.0 + 9.0 * random(3)).to_radians(), 2.0 * PI * random(4));
                let (sin, cos) = height.sin_cos();
                Source::Lamps(vec![self.sun(Vec3::new(cos * turn.cos(), sin, cos * turn.sin()))])
            }
            // an even sky
            _ => Source::Sky(Sky::even()),
        }
    }

    fn sun(&self, towards: Vec3) -> Light {
        let irradiance = Vec3::splat(16.0 / (self.diagonal * self.diagonal));
        light(LightKind::Distant { direction: -towards, irradiance, angle: 0.0 })
    }
}

/// Distance of a lamp at a wall, in diagonals of the scene: some centimetres in a room.
const AT_A_WALL: f32 = 0.005;
/// Lamps of a string.
const STRING: usize = 5;
/// Rays by which it is found how much free space a sample faces.
const FREE_PATHS: usize = 64;
/// Of the lengths of these rays: 0 tells nothing of where free space is, 1 expects lamps everywhere alike.
const EVENNESS: f32 = 0.6;

fn light(kind: LightKind) -> Light {
    Light { name: String::new(), enabled: true, kind }
}

fn omni(position: Vec3) -> Light {
    light(LightKind::Omni { position, intensity: Vec3::splat(0.25 / PI), radius: 0.0 })
}

/// In any direction; the angles are the inner and the outer one, degrees.
fn spot(position: Vec3, (inner_angle, outer_angle): (f32, f32), seed: u32) -> Light {
    let middle = (0.5 * (outer_angle + inner_angle)).to_radians();
    let flux = 2.0 * PI * (1.0 - middle.cos());
    light(LightKind::Spot {
        position,
        target: position + uniform_sphere(sobol_2d(1, 0, seed)),
        intensity: Vec3::splat(1.0 / flux),
        inner_angle,
        outer_angle,
        radius: 0.0,
    })
}

/// Radiance of each surface sample under a lamp that may be anywhere.
///
/// Of a lamp of intensity 1 at a place in the free space of volume `V`, each as likely, a surface receives the integral of
/// `cos / r^2` over what it faces of that space, over `V`, in the mean: `pi / V` times the mean length of cosine-distributed rays from it.
/// Lamps are not strewn evenly, and errors count whether a place is bright or not, so lengths are taken to the power [`EVENNESS`].
fn anywhere(space: &Space<'_>, map: &CellMap) -> Vec<f32> {
    let surfaces = space.cloud.surfaces().par_iter().enumerate();
    let radiance = surfaces.map(|(index, sample)| {
        let length = free_path(map, space.accel, index, space.diagonal) / space.diagonal;
        sample.albedo.element_sum() / 3.0 * length.powf(EVENNESS)
    });
    let mut radiance: Vec<f32> = radiance.collect();
    radiance.resize(space.cloud.len(), 0.0);
    radiance
}

/// Mean length of cosine-distributed rays from a surface sample, each no longer than `limit`; metres.
fn free_path(map: &CellMap, accel: &Accel, sample: usize, limit: f32) -> f32 {
    let length = |ray: usize| {
        let random = sobol_2d(ray as u32, 0, sample as u32);
        accel.closest(&map.emitted(sample, ray % TARGETS, random)).t.min(limit)
    };
    (0..FREE_PATHS).map(length).sum::<f32>() / FREE_PATHS as f32
}

/// What each material emits, of those that bring the most light to the cloud.
fn shining(cloud: &GatherCloud) -> Vec<Vec<f32>> {
    let mut materials: Vec<u32> = cloud.emitted.iter().map(|part| part.material).collect();
    materials.sort_unstable();
    materials.dedup();
    let of = |material: u32| cloud.emitted.iter().filter(move |part| part.material == material);
    let power = |&material: &u32| -> f32 {
        of(material).map(|part| part.radiance.element_sum() * cloud.samples[part.sample as usize].area).sum()
    };
    if materials.len() > MOST_SHINING {
        materials.sort_by(|a, b| power(b).total_cmp(&power(a)));
        materials.truncate(MOST_SHINING);
    }
    // of the brightest place, and in steps: dimmed or coloured, as by a rig, the same lamp teaches the same, to the last bit
    let radiance = |material: u32| {
        let mut radiance = vec![0.0; cloud.len()];
        let brightest =
            of(material).map(|part| part.radiance.element_sum()).fold(f32::MIN_POSITIVE, f32::max);
        of(material).for_each(|part| {
            let share = part.radiance.element_sum() / brightest;
            radiance[part.sample as usize] += (share * SHARES).round() / SHARES;
        });
        radiance
    };
    materials.into_iter().map(radiance).collect()
}

/// Radiance of each sample, the mean of the channels. `groups` are those of the cloud.
fn radiance_of(source: &Source, (cloud, groups): (&GatherCloud, &[PointGroup]), accel: &Accel) -> Vec<f32> {
    let mean = |rgb: Vec3| rgb.element_sum() / 3.0;
    match source {
        Source::Lamps(lamps) => {
            let mut sum = vec![0.0; cloud.len()];
            for lamp in lamps {
                let radiance = illuminate_with(cloud, Some(groups), accel, lamp, Detail::Full).radiance;
                sum.iter_mut().zip(radiance).for_each(|(sum, rgb)| *sum += mean(rgb));
            }
            sum
        }
        Source::Sky(sky) => on_the_sky(cloud, sky),
    }
}

/// Radiance of each sample under a sky, before any of it has met a surface.
fn on_the_sky(cloud: &GatherCloud, sky: &Sky) -> Vec<f32> {
    let mut radiance = vec![0.0; cloud.surfaces().len()];
    let mean = |cell: usize| {
        let directions = cloud.sky.targets(cell, 0);
        directions.iter().map(|direction| sky.radiance(*direction)).sum::<f32>() / directions.len() as f32
    };
    radiance.extend((0..cloud.sky.len()).map(mean));
    radiance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{CloudMethod, CloudSettings};
    use crate::scene::{Geometry, Instance, Material, Mesh, Scene};
    use crate::trace::Hit;
    use glam::{Affine3A, Vec2};

    /// A closed box from the origin, its sides facing inwards.
    fn closed_box(size: Vec3) -> Scene {
        let mut mesh = Mesh::default();
        for axis in 0..3 {
            let [across, up] = [1, 2].map(|next| Vec3::AXES[(axis + next) % 3] * size);
            for (corner, normal) in
                [(Vec3::ZERO, Vec3::AXES[axis]), (Vec3::AXES[axis] * size, -Vec3::AXES[axis])]
            {
                let first = mesh.positions.len() as u32;
                mesh.positions.extend([corner, corner + across, corner + across + up, corner + up]);
                mesh.normals.extend([normal; 4]);
                mesh.uvs.extend([Vec2::ZERO; 4]);
                let sides = [[first, first + 1, first + 2], [first, first + 2, first + 3]];
                let facing = |[a, b, c]: [u32; 3]| if corner == Vec3::ZERO { [a, b, c] } else { [a, c, b] };
                mesh.triangles.extend(sides.map(facing));
            }
        }
        let instance =
            Instance { name: String::new(), mesh: 0, world_from_object: Affine3A::IDENTITY, object: 0 };
        let materials = vec![Material::default()];
        Scene { meshes: vec![mesh], instances: vec![instance], materials, ..Scene::default() }
    }

    /// Cauchy's theorem: in a convex room the mean free path over all walls is four volumes over their area.
    #[test]
    fn lamps_anywhere_light_the_walls_of_a_room_as_its_mean_chord_says() {
        let size = Vec3::new(4.0, 2.5, 7.0);
        let scene = closed_box(size);
        let geometry = Geometry::new(&scene);
        let accel = Accel::new(&scene, &geometry);
        let look = |index: u32| {
            let direction = uniform_sphere(sobol_2d(index, 0, 0));
            (accel.closest(&Ray::new(0.5 * size, direction)), direction)
        };
        let seen: Vec<(Hit, Vec3)> = (0..4096).map(look).collect();
        let settings =
            CloudSettings { count: 1024, method: CloudMethod::Uniform, sky: false, rays: 0, seed: 0 };
        let (cloud, map) = GatherCloud::new(&scene, &geometry, &accel, &seen, &settings, &()).unwrap();
        let (mut lengths, mut areas) = (0.0, 0.0);
        for (index, sample) in cloud.surfaces().iter().enumerate() {
            lengths += f64::from(sample.area * free_path(&map, &accel, index, f32::MAX));
            areas += f64::from(sample.area);
        }
        let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        let expected = f64::from(4.0 * size.element_product() / walls);
        assert!((areas / f64::from(walls) - 1.0).abs() < 1e-3, "cells of {areas} square metres");
        let mean = lengths / areas;
        assert!((mean / expected - 1.0).abs() < 5e-3, "a mean free path of {mean} m for {expected} m");

        let space = Space::new(&cloud, &accel);
        let radiance = anywhere(&space, &map);
        assert_eq!(radiance.len(), cloud.len());
        // the middle of a long wall faces more of the room than a corner does
        let near = |place: Vec3| {
            let distance = |index: &usize| cloud.samples[*index].position.distance(place);
            let nearest = (0..cloud.surfaces().len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            radiance[nearest.unwrap()] / cloud.samples[nearest.unwrap()].albedo.x
        };
        let (end, corner) = (near(Vec3::new(2.0, 1.25, 0.0)), near(Vec3::new(0.1, 0.0, 0.1)));
        assert!(end > 1.2 * corner, "{end} and {corner}");
    }
}
