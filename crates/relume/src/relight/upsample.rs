//! From the receivers' irradiance to the pixels' samples and back down (Hasan 2006, section 3.6).

use glam::Vec3;
use rayon::prelude::*;

use crate::sample::{Branch, PackedUnit, Receivers, ViewGrid, ViewSample, ViewSamples};
use crate::transfer::Transfer;

/// `k_g` of each sample of a view: the part of the light along its specular lobe that it reflects towards the camera.
pub(super) struct Tints {
    centers: GridTints,
    quads: GridTints,
}

/// Of one grid.
struct GridTints {
    samples: Vec<PackedUnit>,
    branches: Vec<PackedUnit>,
}

impl Tints {
    /// Of all samples.
    pub(super) fn new(view: &ViewSamples) -> Self {
        let tint = |sample: &ViewSample, eye: Vec3| {
            if !sample.is_lit() {
                return PackedUnit::ZERO;
            }
            let to_camera = (eye - sample.position) / sample.depth;
            let surface = sample.surface();
            PackedUnit::new(surface.specular_albedo(to_camera.dot(surface.shading_normal)))
        };
        let of = |grid: ViewGrid<'_>| GridTints {
            samples: grid.samples.par_iter().map(|sample| tint(sample, view.camera)).collect(),
            branches: grid
                .chains
                .branches
                .par_iter()
                .map(|branch| tint(&branch.sample, branch.eye))
                .collect(),
        };
        Self { centers: of(view.grid(1)), quads: of(view.grid(2)) }
    }

    fn of(&self, aa: u32) -> &GridTints {
        if aa == 1 { &self.centers } else { &self.quads }
    }
}

/// Light that was gathered, one value a row of the final gather.
pub(super) struct Gathered<'a> {
    /// Over the hemisphere.
    pub(super) diffuse: &'a [Vec3],
    /// By material, what the samples' `k_d` is multiplied by.
    pub(super) scales: Option<&'a [Vec3]>,
    /// Along the lobe; none where reflections were left out.
    pub(super) glossy: Option<(&'a [Vec3], &'a Tints)>,
}

impl Gathered<'_> {
    /// What a sample reflects of it: `k_d` times the light over the hemisphere plus `k_g` times that along the lobe.
    fn reflected(&self, sample: &ViewSample, tint: impl Fn(&Tints) -> PackedUnit, row: u32) -> Vec3 {
        if row == Receivers::NONE {
            return Vec3::ZERO;
        }
        let k_d = match self.scales {
            Some(scales) => sample.diffuse.get() * scales[sample.material as usize],
            None => sample.diffuse.get(),
        };
        let diffuse = k_d * self.diffuse[row as usize];
        let glossy = self.glossy.map_or(Vec3::ZERO, |(light, tints)| tint(tints).get() * light[row as usize]);
        diffuse + glossy
    }
}

/// What the samples reflect of light that was gathered, averaged over each pixel.
pub(super) fn upsample(transfer: &Transfer, gathered: &Gathered<'_>, aa: u32) -> Vec<Vec3> {
    let view = &transfer.view;
    let ViewGrid { samples, chains, a_pixel, .. } = view.grid(aa);
    let [rows, branch_rows] = transfer.rows_of(aa);
    let share = 1.0 / a_pixel as f32;
    let reflected =
        |index: usize| gathered.reflected(&samples[index], |all| all.of(aa).samples[index], rows[index]);
    let mut pixels: Vec<Vec3> = (0..view.pixels())
        .into_par_iter()
        .with_min_len(4096)
        .map(|pixel| (pixel * a_pixel..(pixel + 1) * a_pixel).map(reflected).sum::<Vec3>() * share)
        .collect();
    let behind = |(index, Branch { sample, throughput, .. }): (usize, &Branch)| {
        let reflected = gathered.reflected(sample, |all| all.of(aa).branches[index], branch_rows[index]);
        throughput.get() * reflected * share
    };
    let branches = chains.branches.par_iter().enumerate().with_min_len(4096);
    let lit: Vec<Vec3> = branches.map(behind).collect();
    for (branch, light) in chains.branches.iter().zip(lit) {
        pixels[branch.owner as usize / a_pixel] += light;
    }
    pixels
}
