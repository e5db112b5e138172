//! From the receivers' irradiance to the pixels' samples and back down (Hasan 2006, section 3.6).

use glam::Vec3;
use rayon::prelude::*;

use crate::sample::{PackedUnit, Receivers, ViewSample, ViewSamples};
use crate::transfer::Transfer;

/// `k_g` of each sample of a view: the part of the light along its specular lobe that it reflects towards the camera.
pub(super) struct Tints {
    centers: Vec<PackedUnit>,
    quads: Vec<PackedUnit>,
}

impl Tints {
    /// Of all samples.
    pub(super) fn new(view: &ViewSamples) -> Self {
        let tint = |sample: &ViewSample| {
            if !sample.is_lit() {
                return PackedUnit::ZERO;
            }
            let surface = sample.surface();
            let to_camera = (view.camera - sample.position) / sample.depth;
            PackedUnit::new(surface.specular_albedo(to_camera.dot(surface.shading_normal)))
        };
        let of = |samples: &[ViewSample]| samples.par_iter().map(tint).collect();
        Self { centers: of(&view.centers), quads: of(&view.quads) }
    }
}

/// `k_d` times the light gathered over the hemisphere plus `k_g` times that along the lobe, averaged over each pixel's samples.
/// Both are one value a row of the final gather; the latter is none where reflections were left out. Beside the former stands, by material,
/// what the samples' `k_d` is multiplied by.
pub(super) fn upsample(
    transfer: &Transfer,
    (gathered, scales): (&[Vec3], Option<&[Vec3]>),
    glossy: Option<(&[Vec3], &Tints)>,
    aa: u32,
) -> Vec<Vec3> {
    let view = &transfer.view;
    let (samples, rows, a_pixel): (_, &[u32], _) = if aa == 1 {
        (&view.centers, &transfer.rows_of_centers, 1)
    } else {
        (&view.quads, &transfer.rows_of_quads, 4)
    };
    let share = 1.0 / a_pixel as f32;
    let glossy = glossy.map(|(light, tints)| (light, if aa == 1 { &tints.centers } else { &tints.quads }));
    let k_d = |sample: &ViewSample| match scales {
        Some(scales) => sample.diffuse.get() * scales[sample.material as usize],
        None => sample.diffuse.get(),
    };
    let diffuse = |index: usize| k_d(&samples[index]) * gathered[rows[index] as usize];
    let reflected = |index: usize| match glossy {
        Some((light, tints)) => tints[index].get() * light[rows[index] as usize],
        None => Vec3::ZERO,
    };
    (0..view.pixels())
        .into_par_iter()
        .with_min_len(4096)
        .map(|pixel| {
            let lit =
                (pixel * a_pixel..(pixel + 1) * a_pixel).filter(|&index| rows[index] != Receivers::NONE);
            lit.map(|index| diffuse(index) + reflected(index)).sum::<Vec3>() * share
        })
        .collect()
}
