//! Direct light on the gather cloud.
//!
//! All sub-samples of a patch are shaded without shadow (cone, cosine, albedo); visibility is asked for twice a patch
//! and, where the answers of neighbours in the cluster tree disagree, or the patch is only partly lit, once for each
//! quarter of the patch; where these disagree, once for each sub-sample: a shadow's edge that moves over a patch then darkens it in sixteen
//! steps, not in four. A light with extent always takes the four rays, each towards its own point of the light.
//!
//! A quarter without sub-samples is not lit, and a patch with such a quarter only partly so: where one sub-sample speaks for a
//! patch ([`GatherCloud::with_sub_samples`]), its own ray decides.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::patch_light::unshadowed;
use super::{GatherCloud, SUB_SAMPLES, SubSample};
use crate::scene::Light;
use crate::shade::{self, PointGroup, PreparedLight};
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Accel, Ray};

/// Sub-samples that share one shadow ray where a patch is asked for by quarters.
const QUARTER: usize = SUB_SAMPLES / 4;
/// Patches whose visibility is compared: siblings in the cluster tree.
const NEIGHBOURS: usize = 16;
/// Sub-samples that are asked for together whether a light could reach them: those of four patches, siblings in the cluster tree.
const CLOUD_GROUP: usize = 4 * SUB_SAMPLES;
/// Patches that one task shades.
const CHUNK: usize = 256;

/// One light's direct light on the cloud.
#[derive(Clone, Debug, Default)]
pub struct CloudLight {
    /// Diffuse outgoing radiance of each gather sample, W/(sr m^2), without emission.
    pub radiance: Vec<Vec3>,
    /// Shadow rays spent.
    pub shadow_rays: u64,
}

/// The direct light of `light` on every gather sample: `albedo / pi * irradiance`, averaged over each patch. None of a dome, whose light comes
/// through the operators ([`super::illuminate_sky`]).
pub fn illuminate(cloud: &GatherCloud, accel: &Accel, light: &Light) -> CloudLight {
    illuminate_with(cloud, None, accel, light, Detail::Full)
}

/// The sub-samples of the cloud in groups of four patches, as [`illuminate_with`] takes them.
pub fn cloud_groups(cloud: &GatherCloud) -> Vec<PointGroup> {
    let group = |subs: &[SubSample]| {
        let counted = subs.iter().filter(|sub| sub.weight != 0);
        PointGroup::new(counted.map(|sub| (sub.position, sub.normal.get())))
    };
    cloud.sub_samples.par_chunks(CLOUD_GROUP).with_min_len(64).map(group).collect()
}

/// How many shadow rays are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// More where the first ones of neighbours disagree.
    Full,
    /// No more than two a patch, whatever they find, and one for each quarter that is lit where not all are, or by a light with extent. Shadows'
    /// edges become as coarse as patches.
    Coarse,
}

/// The same with as many shadow rays as `detail` says. With `groups`, which are [`cloud_groups`]' of this cloud or one of the same places, it is found
/// sooner.
///
/// # Panics
/// If `groups` are not as many as the cloud's.
pub fn illuminate_with(
    cloud: &GatherCloud,
    groups: Option<&[PointGroup]>,
    accel: &Accel,
    light: &Light,
    detail: Detail,
) -> CloudLight {
    let count = cloud.sub_samples.len().div_ceil(CLOUD_GROUP);
    assert!(groups.is_none_or(|groups| groups.len() == count), "groups of another cloud");
    let prepared = PreparedLight::new(light);
    let surfaces = cloud.surfaces().len();
    // lamps do not shine on the sky, whose samples come last
    let mut radiance: Vec<Vec3> = bytemuck::zeroed_vec(cloud.len());
    let shadow_rays = radiance[..surfaces]
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, radiance)| {
            let first = chunk * CHUNK;
            let last = first + radiance.len();
            let reaches = |patch: usize| {
                let group = patch * SUB_SAMPLES / CLOUD_GROUP;
                groups.is_none_or(|groups| prepared.may_reach(&groups[group]))
            };
            Chunk::new(cloud, accel, &prepared, first..last, reaches).run(detail, radiance)
        })
        .sum();
    CloudLight { radiance, shadow_rays }
}

struct Chunk<'a> {
    accel: &'a Accel,
    light: &'a PreparedLight,
    first: usize,
    sub_samples: &'a [SubSample],
    /// Outgoing radiance of each quarter of each patch without shadow.
    quarters: Vec<[Vec3; 4]>,
    /// A bit for each sub-sample of each patch that the light shines on without shadow.
    lit: Vec<u32>,
    rays: u64,
}

/// What the first rays found.
struct FirstRays {
    /// By patch: the light was hidden from it.
    hidden: Vec<bool>,
    /// By patch: the share of its rays that found the light.
    free: Vec<f32>,
    /// By group of neighbours: it was hidden from one of them.
    any_hidden: Vec<bool>,
    /// By group of neighbours: it was visible from one of them.
    any_visible: Vec<bool>,
}

impl FirstRays {
    fn new(patches: usize) -> Self {
        let groups = patches.div_ceil(NEIGHBOURS);
        Self {
            hidden: vec![false; patches],
            free: vec![0.0; patches],
            any_hidden: vec![false; groups],
            any_visible: vec![false; groups],
        }
    }
}

impl<'a> Chunk<'a> {
    fn new(
        cloud: &'a GatherCloud,
        accel: &'a Accel,
        light: &'a PreparedLight,
        patches: Range<usize>,
        reaches: impl Fn(usize) -> bool,
    ) -> Self {
        let sub_samples = &cloud.sub_samples[patches.start * SUB_SAMPLES..patches.end * SUB_SAMPLES];
        let (mut quarters, mut lit) = (vec![[Vec3::ZERO; 4]; patches.len()], vec![0; patches.len()]);
        let group = CLOUD_GROUP / SUB_SAMPLES;
        for start in (0..patches.len()).step_by(group).filter(|start| reaches(patches.start + start)) {
            let subs = sub_samples[start * SUB_SAMPLES..].as_chunks().0;
            for (patch, subs) in (start..patches.len()).zip(subs).take(group) {
                let light = unshadowed(light, subs);
                let (parts, _) = light.as_chunks::<QUARTER>();
                quarters[patch] = std::array::from_fn(|quarter| parts[quarter].iter().sum());
                let bits = (0..).zip(light).map(|(place, light)| u32::from(light != Vec3::ZERO) << place);
                lit[patch] = bits.sum();
            }
        }
        Self { accel, light, first: patches.start, sub_samples, quarters, lit, rays: 0 }
    }

    /// Lights the patches, which are dark before. Returns the rays.
    fn run(mut self, detail: Detail, radiance: &mut [Vec3]) -> u64 {
        let lit: Vec<usize> =
            (0..self.quarters.len()).filter(|&p| self.quarters[p].iter().any(|q| *q != Vec3::ZERO)).collect();
        let refined: Vec<usize> = if self.light.needs_samples() {
            lit
        } else {
            let found = self.first_rays(&lit);
            let mut refined = Vec::new();
            for &patch in &lit {
                let group = patch / NEIGHBOURS;
                let partly = self.quarters[patch].contains(&Vec3::ZERO);
                if detail == Detail::Coarse && !partly {
                    radiance[patch] = self.quarters[patch].iter().sum::<Vec3>() * found.free[patch];
                } else if partly || (found.any_visible[group] && found.any_hidden[group]) {
                    refined.push(patch);
                } else if !found.hidden[patch] {
                    radiance[patch] = self.quarters[patch].iter().sum();
                }
            }
            refined
        };
        self.quarter_rays(&refined, detail, radiance);
        self.rays
    }

    /// Two rays for each patch of `lit`, from its brightest quarter and the one across.
    fn first_rays(&mut self, lit: &[usize]) -> FirstRays {
        let both = |&patch: &usize| {
            let first = brightest(&self.quarters[patch]);
            [(patch, self.ray(patch, first, 0)), (patch, self.ray(patch, (first + 2) % 4, 2))]
        };
        let (patches, rays): (Vec<usize>, Vec<Ray>) = lit.iter().flat_map(both).unzip();
        let mut hidden = vec![false; rays.len()];
        self.accel.occluded_batch(&rays, &mut hidden);
        self.rays += rays.len() as u64;
        let mut found = FirstRays::new(self.quarters.len());
        for (&patch, &hidden) in patches.iter().zip(&hidden) {
            let group = patch / NEIGHBOURS;
            found.hidden[patch] = hidden;
            found.free[patch] += if hidden { 0.0 } else { 0.5 };
            found.any_hidden[group] |= hidden;
            found.any_visible[group] |= !hidden;
        }
        found
    }

    /// A ray for each lit quarter of each of `patches`. Where their answers differ, a shadow's edge lies across the patch, and each lit sub-sample
    /// asks for itself, but for coarse light.
    fn quarter_rays(&mut self, patches: &[usize], detail: Detail, radiance: &mut [Vec3]) {
        let lit: Vec<(usize, usize)> = patches
            .iter()
            .flat_map(|&patch| (0..4).map(move |quarter| (patch, quarter)))
            .filter(|&(patch, quarter)| self.quarters[patch][quarter] != Vec3::ZERO)
            .collect();
        let rays: Vec<Ray> = lit.iter().map(|&(patch, quarter)| self.ray(patch, quarter, 1)).collect();
        let mut hidden = vec![false; rays.len()];
        self.accel.occluded_batch(&rays, &mut hidden);
        self.rays += rays.len() as u64;
        let mut divided = Vec::new();
        let mut answers = lit.iter().zip(&hidden).peekable();
        while let Some(&(&(patch, _), _)) = answers.peek() {
            let (mut light, mut seen, mut asked) = (Vec3::ZERO, 0, 0);
            while let Some((&(_, quarter), &hidden)) = answers.next_if(|((other, _), _)| *other == patch) {
                asked += 1;
                if !hidden {
                    seen += 1;
                    light += self.quarters[patch][quarter];
                }
            }
            let is_told = seen == 0 || seen == asked || self.light.needs_samples();
            if is_told || detail == Detail::Coarse {
                radiance[patch] = light;
            } else {
                divided.push(patch);
            }
        }
        self.single_rays(&divided, radiance);
    }

    /// A ray for each lit sub-sample of each of `patches`.
    fn single_rays(&mut self, patches: &[usize], radiance: &mut [Vec3]) {
        let (mut asked, mut rays) = (Vec::new(), Vec::new());
        for &patch in patches {
            let subs = self.patch(patch);
            for (sub, light) in subs.iter().zip(unshadowed(self.light, subs)) {
                if let Some(sample) =
                    self.light.sample(sub.position, Vec2::ZERO).filter(|_| light != Vec3::ZERO)
                {
                    asked.push((patch, light));
                    rays.push(shade::shadow_ray(sub.position, sub.normal.get(), &sample));
                }
            }
        }
        let mut hidden = vec![false; rays.len()];
        self.accel.occluded_batch(&rays, &mut hidden);
        self.rays += rays.len() as u64;
        for (&(patch, light), _) in asked.iter().zip(&hidden).filter(|&(_, &hidden)| !hidden) {
            radiance[patch] += light;
        }
    }

    /// Its sub-samples.
    fn patch(&self, patch: usize) -> &'a [SubSample; SUB_SAMPLES] {
        &self.sub_samples.as_chunks().0[patch]
    }

    /// A shadow ray from a lit sub-sample of a quarter of a patch.
    fn ray(&self, patch: usize, quarter: usize, which: usize) -> Ray {
        let place = (0..QUARTER)
            .map(|step| quarter * QUARTER + (which + step) % QUARTER)
            .find(|&place| self.lit[patch] >> place & 1 != 0)
            .unwrap_or(quarter * QUARTER);
        let sub = &self.patch(patch)[place];
        let seed = hash((self.first + patch) as u32, 0x11_6847);
        let random = if self.light.needs_samples() { sobol_2d(quarter as u32, 0, seed) } else { Vec2::ZERO };
        match self.light.sample(sub.position, random) {
            Some(sample) => shade::shadow_ray(sub.position, sub.normal.get(), &sample),
            None => Ray { t_max: 0.0, ..Ray::new(sub.position, Vec3::Y) },
        }
    }
}

/// The quarter that matters most.
fn brightest(quarters: &[Vec3; 4]) -> usize {
    (0..4).fold(0, |best, q| if quarters[q].element_sum() > quarters[best].element_sum() { q } else { best })
}
