//! Clouds whose patches fewer sub-samples speak for: what the others are worth can be measured.

use glam::Vec3;
use rayon::prelude::*;

use super::{DiffusePart, GatherCloud, PackedUnit, SUB_SAMPLES, SubSample};
use crate::{Error, Result};

impl GatherCloud {
    /// The cloud with `count` sub-samples a gather sample that weigh anything: 1, 4 (one of each quarter of the patch) or all
    /// [`SUB_SAMPLES`], which changes nothing.
    ///
    /// Of each part of a patch the sub-sample stays that lies and faces most like the middle of the part. It takes over the weight of
    /// the others and has the mean of their albedos, so that light which falls evenly on the patch is reflected as before. The others
    /// stay in their places with weight 0. The samples themselves, and what they emit, do not change.
    ///
    /// Should the result be recoloured, only edits of those sub-samples' materials are followed that stay.
    ///
    /// # Errors
    /// [`Error::Setting`] for any other `count`.
    pub fn with_sub_samples(&self, count: usize) -> Result<Self> {
        if ![1, 4, SUB_SAMPLES].contains(&count) {
            return Err(Error::Setting(format!(
                "{count} sub-samples a gather sample: must be 1, 4 or {SUB_SAMPLES}"
            )));
        }
        let mut cloud = self.clone();
        if count == SUB_SAMPLES {
            return Ok(cloud);
        }
        let size = SUB_SAMPLES / count;
        let area = |part: usize| self.samples[part / count].area / count as f32;
        // from the sub-samples as they were, also for clouds that have no diffuse parts any more
        let typical = |part: usize| typical(&self.sub_samples[part * size..(part + 1) * size], area(part));
        cloud.sub_samples.par_chunks_exact_mut(size).enumerate().for_each(|(part, sub_samples)| {
            if let Some(place) = typical(part) {
                speak_for_all(sub_samples, place);
            }
        });
        cloud.diffuse.par_chunks_exact_mut(size).enumerate().for_each(|(part, diffuse)| {
            if let Some(place) = typical(part) {
                let sub_samples = &self.sub_samples[part * size..(part + 1) * size];
                diffuse[place] = mean_diffuse(sub_samples, diffuse, diffuse[place].material());
            }
        });
        Ok(cloud)
    }
}

/// The place of the sub-sample nearest to the middle of a part of a patch that faces as the part does; `None` where all weigh nothing.
/// `area` is the part's, square metres.
fn typical(sub_samples: &[SubSample], area: f32) -> Option<usize> {
    let total = weight(sub_samples);
    let mean = |of: fn(&SubSample) -> Vec3| weighted(sub_samples, of) / total.max(f32::MIN_POSITIVE);
    let (middle, facing) = (mean(|sub| sub.position), mean(|sub| sub.normal.get()));
    let unlike = |sub: &SubSample| {
        sub.position.distance_squared(middle) + area * sub.normal.get().distance_squared(facing)
    };
    let present = sub_samples.iter().enumerate().filter(|(_, sub)| sub.weight > 0);
    present.min_by(|(_, a), (_, b)| unlike(a).total_cmp(&unlike(b))).map(|(place, _)| place)
}

/// Gives all weight to the one at `place`, and the mean albedo.
fn speak_for_all(sub_samples: &mut [SubSample], place: usize) {
    let albedo = weighted(sub_samples, |sub| sub.albedo.get()) / weight(sub_samples);
    let sum: u32 = sub_samples.iter().map(|sub| u32::from(sub.weight)).sum();
    sub_samples.iter_mut().for_each(|sub| sub.weight = 0);
    sub_samples[place].albedo = PackedUnit::new(albedo);
    // sixteen rounded shares may add up to a little more than all
    sub_samples[place].weight = sum.min(u32::from(u16::MAX)) as u16;
}

/// What `material` adds to the mean albedo of a part.
fn mean_diffuse(sub_samples: &[SubSample], diffuse: &[DiffusePart], material: u32) -> DiffusePart {
    let own = sub_samples.iter().zip(diffuse).filter(|(_, part)| part.material() == material);
    let white: Vec3 = own.map(|(sub, part)| part.white.get() * sub.weight()).sum();
    DiffusePart::new(PackedUnit::new(white / weight(sub_samples)), material)
}

fn weight(sub_samples: &[SubSample]) -> f32 {
    sub_samples.iter().map(SubSample::weight).sum()
}

fn weighted(sub_samples: &[SubSample], of: impl Fn(&SubSample) -> Vec3) -> Vec3 {
    sub_samples.iter().map(|sub| of(sub) * sub.weight()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{GatherSample, PackedNormal};
    use bytemuck::Zeroable;

    /// Two patches along X, the second with five sub-samples only; albedos and weights differ.
    fn cloud() -> GatherCloud {
        let sub = |place: usize, weight: u16| SubSample {
            position: Vec3::new(place as f32, 0.0, 0.0),
            normal: PackedNormal::new(Vec3::Y),
            albedo: PackedUnit::new(Vec3::new(place as f32 / 31.0, 0.5, 0.1)),
            weight,
        };
        let first = (0..16).map(|place| sub(place, 4000 + 12 * place as u16));
        let second = (16..32).map(|place| sub(place, if place < 21 { 13_107 } else { 0 }));
        let part =
            |place: u32| DiffusePart::new(PackedUnit::new(Vec3::splat(place as f32 / 31.0)), place % 2);
        GatherCloud {
            samples: vec![GatherSample { area: 16.0, ..GatherSample::zeroed() }; 2],
            sub_samples: first.chain(second).collect(),
            diffuse: (0..32).map(part).collect(),
            ..GatherCloud::default()
        }
    }

    /// What a patch reflects of even light.
    fn even(cloud: &GatherCloud, patch: usize) -> Vec3 {
        weighted(&cloud.sub_samples[patch * SUB_SAMPLES..][..SUB_SAMPLES], |sub| sub.albedo.get())
    }

    #[test]
    fn those_that_stay_reflect_even_light_as_all_did() {
        let all = cloud();
        for (count, expected) in [(1, [1, 1]), (4, [4, 2]), (16, [16, 5])] {
            let fewer = all.with_sub_samples(count).unwrap();
            for (patch, expected) in expected.into_iter().enumerate() {
                let subs = &fewer.sub_samples[patch * SUB_SAMPLES..][..SUB_SAMPLES];
                assert_eq!(subs.iter().filter(|sub| sub.weight > 0).count(), expected, "{count}");
                let total = weight(&all.sub_samples[patch * SUB_SAMPLES..][..SUB_SAMPLES]);
                assert!((weight(subs) - total).abs() < 1e-6, "{count}, patch {patch}: {}", weight(subs));
                let (before, after) = (even(&all, patch), even(&fewer, patch));
                assert!(after.abs_diff_eq(before, 2e-5), "{count}, patch {patch}: {after}, was {before}");
            }
            assert_eq!(fewer.samples, all.samples);
        }
        // the same without the mean of the albedos would be another patch
        let mut wrong = all.with_sub_samples(1).unwrap();
        let place = wrong.sub_samples.iter().position(|sub| sub.weight > 0).unwrap();
        wrong.sub_samples[place].albedo = PackedUnit::new(Vec3::new(9.0 / 31.0, 0.5, 0.1));
        assert!(!even(&wrong, 0).abs_diff_eq(even(&all, 0), 2e-5));
    }

    #[test]
    fn the_middle_one_stays_and_each_quarter_has_its_own() {
        let stay = |cloud: &GatherCloud| -> Vec<usize> {
            (0..32).filter(|&place| cloud.sub_samples[place].weight > 0).collect()
        };
        let all = cloud();
        // weights rise along the first patch: its middle is a little beyond 7.5
        assert_eq!(stay(&all.with_sub_samples(1).unwrap()), [8, 18]);
        let quarters = stay(&all.with_sub_samples(4).unwrap());
        assert_eq!(quarters.len(), 6);
        assert!(quarters.iter().zip(0..).all(|(place, quarter)| place / 4 == quarter), "{quarters:?}");
        for count in [0, 2, 8, 32] {
            let refused = all.with_sub_samples(count).unwrap_err().to_string();
            assert!(refused.contains("must be 1, 4 or 16"), "{refused}");
        }
    }

    /// Material 1 is a half of each patch, as far as weights go; a change of it shows in the mean.
    #[test]
    fn edits_of_the_material_that_stays_are_followed() {
        let all = cloud();
        let fewer = all.with_sub_samples(1).unwrap();
        let place = fewer.sub_samples.iter().position(|sub| sub.weight > 0).unwrap();
        let material = fewer.diffuse[place].material();
        let expected: f32 = (0..16)
            .filter(|place| place % 2 == material as usize)
            .map(|place| place as f32 / 31.0 * all.sub_samples[place].weight())
            .sum();
        let found = fewer.diffuse[place].white.get().x * fewer.sub_samples[place].weight();
        assert!((found - expected).abs() < 2e-5, "{found} instead of {expected}");
        let recolored = all.recolored(&[Vec3::splat(0.1); 2]).unwrap();
        assert!(recolored.with_sub_samples(4).is_ok_and(|cloud| cloud.diffuse.is_empty()));
    }
}
