//! Unshadowed point-to-patch form factors, eight at a time.

use glam::Vec3;
use multiversion::multiversion;

use crate::sample::{CellMap, GatherCloud, TARGETS};

/// The cloud as structure of arrays, one entry a gather sample.
#[derive(Clone, Debug, Default)]
pub(super) struct Patches {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// Normal times `area / pi`.
    nx: Vec<f32>,
    ny: Vec<f32>,
    nz: Vec<f32>,
    areas: Vec<f32>,
    /// `TARGETS` points a patch where shadow rays to it end.
    targets: Vec<Vec3>,
}

impl Patches {
    pub(super) fn new(cloud: &GatherCloud, map: &CellMap) -> Self {
        let mut patches = Self { targets: map.targets.clone(), ..Self::default() };
        for (sample, (middle, normal)) in cloud.samples.iter().zip(&map.middles) {
            let weighted = *normal * (sample.area * std::f32::consts::FRAC_1_PI);
            patches.x.push(middle.x);
            patches.y.push(middle.y);
            patches.z.push(middle.z);
            patches.nx.push(weighted.x);
            patches.ny.push(weighted.y);
            patches.nz.push(weighted.z);
            patches.areas.push(sample.area);
        }
        patches
    }

    /// Square metres.
    pub(super) fn area(&self, patch: usize) -> f32 {
        self.areas[patch]
    }

    /// Where form factors are taken: the middle of the patch, and its normal times `area / pi`.
    pub(super) fn placed(&self, patch: usize) -> ([f32; 3], [f32; 3]) {
        ([self.x[patch], self.y[patch], self.z[patch]], [self.nx[patch], self.ny[patch], self.nz[patch]])
    }

    /// A point of the patch, chosen at random by `random`: where a shadow ray to it ends.
    pub(super) fn target(&self, patch: usize, random: u32) -> Vec3 {
        self.targets[patch * TARGETS + random as usize % TARGETS]
    }

    pub(super) fn len(&self) -> usize {
        self.x.len()
    }

    /// `cos_v cos_g A / (pi r^2)` from a point with a normal to the patches `first..first + out.len()`; 0 for a
    /// patch below the point's horizon or facing away.
    pub(super) fn form_factors(&self, first: usize, position: Vec3, normal: Vec3, out: &mut [f32]) {
        let range = first..first + out.len();
        form_factors(
            [&self.x[range.clone()], &self.y[range.clone()], &self.z[range.clone()]],
            [&self.nx[range.clone()], &self.ny[range.clone()], &self.nz[range]],
            position,
            normal,
            out,
        );
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn form_factors(place: [&[f32]; 3], weighted: [&[f32]; 3], position: Vec3, normal: Vec3, out: &mut [f32]) {
    let [x, y, z] = place;
    let [nx, ny, nz] = weighted;
    let count = out.len();
    let (x, y, z) = (&x[..count], &y[..count], &z[..count]);
    let (nx, ny, nz) = (&nx[..count], &ny[..count], &nz[..count]);
    for i in 0..count {
        let (dx, dy, dz) = (x[i] - position.x, y[i] - position.y, z[i] - position.z);
        let square = dx * dx + dy * dy + dz * dz + 1e-12;
        let cos_view = dx * normal.x + dy * normal.y + dz * normal.z;
        let cos_patch = -(dx * nx[i] + dy * ny[i] + dz * nz[i]);
        let above = if cos_view > 0.0 { cos_view } else { 0.0 };
        let facing = if cos_patch > 0.0 { cos_patch } else { 0.0 };
        // squares of the squares of far distances would be past the range of f32
        let inverse = 1.0 / square;
        out[i] = (above * inverse) * (facing * inverse);
    }
}
