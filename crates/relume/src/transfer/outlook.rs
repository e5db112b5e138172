//! What is known of each gather sample before any light is: how bright it may be, beside the others.

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::progress::Progress;
use crate::sample::{CellMap, Emitted, GatherCloud, TARGETS};
use crate::trace::Accel;
use crate::trace::sampling::{hash, sobol_2d};
use crate::{Error, Result};

/// Rays by which it is found how much free space a sample faces.
const FREE_PATHS: usize = 64;
/// Samples of which they are traced in one go.
const FREE_PATHS_AT_ONCE: usize = 256;
/// Of the lengths of these rays: 0 tells nothing of where free space is, 1 expects lamps everywhere alike.
const EVENNESS: f32 = 0.6;

/// Steps of what a place radiates beside the brightest of its material.
const SHARES: f32 = 1024.0;

/// What is known of each sample before any light is.
#[derive(Default)]
pub(super) struct Outlook {
    /// What a lamp that may be anywhere makes of it on white paint, up to a common factor; of the sky, nothing.
    pub(super) anywhere: Vec<f32>,
    /// What it emits, as a share of the brightest place of its material, of all materials.
    pub(super) shining: Vec<f32>,
}

impl Outlook {
    /// `cloud` has white base colour factors.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn new(
        (cloud, map): (&GatherCloud, &CellMap),
        accel: &Accel,
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let diagonal = diagonal(cloud);
        let surfaces = cloud.surfaces();
        progress.stage("free space", surfaces.len() as u64);
        let mut anywhere = vec![0.0; cloud.len()];
        let chunks = anywhere.par_chunks_mut(FREE_PATHS_AT_ONCE).zip(surfaces.par_chunks(FREE_PATHS_AT_ONCE));
        chunks.enumerate().try_for_each(|(chunk, (radiance, surfaces))| {
            if progress.cancelled() {
                return Err(Error::Cancelled);
            }
            for (index, (radiance, sample)) in
                (chunk * FREE_PATHS_AT_ONCE..).zip(radiance.iter_mut().zip(surfaces))
            {
                let light = under_lamps_anywhere(map, accel, (index, seed), diagonal);
                *radiance = sample.albedo.element_sum() / 3.0 * light;
            }
            progress.advance(surfaces.len() as u64);
            Ok(())
        })?;
        Ok(Self { anywhere, shining: shares(cloud) })
    }
}

/// The most that each material emits anywhere, all channels.
pub(super) fn brightest(cloud: &GatherCloud) -> HashMap<u32, f32> {
    let mut brightest = HashMap::new();
    for part in &cloud.emitted {
        let most: &mut f32 = brightest.entry(part.material).or_insert(f32::MIN_POSITIVE);
        *most = most.max(part.radiance.element_sum());
    }
    brightest
}

/// What is emitted as a share of the brightest place of its material, in steps: dimmed or coloured, as by a rig, the same lamp teaches the same, to the last bit.
pub(super) fn share(part: &Emitted, brightest: &HashMap<u32, f32>) -> f32 {
    (part.radiance.element_sum() / brightest[&part.material] * SHARES).round() / SHARES
}

/// The largest share of each sample.
fn shares(cloud: &GatherCloud) -> Vec<f32> {
    let brightest = brightest(cloud);
    let mut shares = vec![0.0_f32; cloud.len()];
    for part in &cloud.emitted {
        let most = &mut shares[part.sample as usize];
        *most = most.max(share(part, &brightest));
    }
    shares
}

/// Radiance of a white surface sample under a lamp that may be anywhere, up to a common factor.
///
/// Of a lamp of intensity 1 at a place in the free space of volume `V`, each as likely, a surface receives the integral of
/// `cos / r^2` over what it faces of that space, over `V`, in the mean: `pi / V` times the mean length of cosine-distributed rays from it.
/// Lamps are not strewn evenly, and errors count whether a place is bright or not, so lengths are taken to the power [`EVENNESS`].
/// In the open they end at the scene's diagonal.
fn under_lamps_anywhere(map: &CellMap, accel: &Accel, sample: (usize, u32), diagonal: f32) -> f32 {
    (free_path(map, accel, sample, diagonal) / diagonal).powf(EVENNESS)
}

/// Mean length of cosine-distributed rays from a surface sample, each no longer than `limit`; metres.
fn free_path(map: &CellMap, accel: &Accel, (sample, seed): (usize, u32), limit: f32) -> f32 {
    let seed = hash(sample as u32, seed);
    let length = |ray: usize| {
        let random = sobol_2d(ray as u32, 0, seed);
        accel.closest(&map.emitted(sample, ray % TARGETS, random)).t.min(limit)
    };
    (0..FREE_PATHS).map(length).sum::<f32>() / FREE_PATHS as f32
}

/// Of the box around all surfaces, metres.
pub(super) fn diagonal(cloud: &GatherCloud) -> f32 {
    let positions = || cloud.surfaces().iter().map(|sample| sample.position);
    let low = positions().fold(Vec3::INFINITY, Vec3::min);
    let high = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    low.distance(high).max(1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{CloudMethod, CloudSettings, GatherSample};
    use crate::scene::{Geometry, Instance, Material, Mesh, Scene};
    use crate::trace::sampling::uniform_sphere;
    use crate::trace::{Hit, Ray};
    use bytemuck::Zeroable;
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

    #[test]
    fn what_shines_is_known_of_any_number_of_materials() {
        // each material brighter than the one before, and half as bright elsewhere
        let part = |sample, material, light| Emitted { sample, material, radiance: Vec3::splat(light) };
        let of = |material: u32| {
            let light = (material + 1) as f32;
            [part(2 * material, material, light), part(2 * material + 1, material, 0.5 * light)]
        };
        let samples = vec![GatherSample::zeroed(); 64];
        let cloud =
            GatherCloud { samples, emitted: (0..20).flat_map(of).collect(), ..GatherCloud::default() };
        let (lamps, walls) = (shares(&cloud)[..40].to_vec(), shares(&cloud)[40..].to_vec());
        assert!(lamps.chunks(2).all(|shares| shares == [1.0, 0.5]), "{lamps:?}");
        assert!(walls.iter().all(|&share| share == 0.0));
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
            lengths += f64::from(sample.area * free_path(&map, &accel, (index, 0), f32::MAX));
            areas += f64::from(sample.area);
        }
        let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        let expected = f64::from(4.0 * size.element_product() / walls);
        assert!((areas / f64::from(walls) - 1.0).abs() < 1e-3, "cells of {areas} square metres");
        let mean = lengths / areas;
        assert!((mean / expected - 1.0).abs() < 5e-3, "a mean free path of {mean} m for {expected} m");

        let radiance = Outlook::new((&cloud, &map), &accel, 0, &()).unwrap().anywhere;
        assert_eq!(radiance.len(), cloud.len());
        // the middle of the wall at an end faces more of the room than a corner does
        let near = |place: Vec3| {
            let distance = |index: &usize| cloud.samples[*index].position.distance(place);
            let all = 0..cloud.surfaces().len();
            let nearest =
                all.min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("a cloud has samples");
            radiance[nearest] / cloud.samples[nearest].albedo.x
        };
        let (end, corner) = (near(Vec3::new(2.0, 1.25, 0.0)), near(Vec3::new(0.1, 0.0, 0.1)));
        assert!(end > 1.2 * corner, "{end} and {corner}");
    }
}
