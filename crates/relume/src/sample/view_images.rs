//! What the camera sees, as images: for people to look at, and for filters that want to know edges.

use glam::Vec3;
use rayon::prelude::*;

use super::ViewSamples;
use crate::image::Image;

impl ViewSamples {
    /// The diffuse albedo, `k_d`, the mean over a pixel's samples; black where no surface is seen. `scales`, by material, is what `k_d` is multiplied by.
    pub(crate) fn albedo(&self, scales: Option<&[Vec3]>) -> Image {
        let pixels = self.quads.par_chunks_exact(4).with_min_len(1024).map(|quad| {
            let seen = quad.iter().filter(|sample| sample.is_lit());
            let albedo = seen.map(|sample| {
                let scale = scales.map_or(Vec3::ONE, |scales| scales[sample.material as usize]);
                sample.diffuse.get() * scale
            });
            0.25 * albedo.sum::<Vec3>()
        });
        Image { width: self.width, height: self.height, pixels: pixels.collect() }
    }

    /// The normal that light is shaded by at each pixel's centre, world space, unit; zero where no surface is seen.
    pub fn normals(&self) -> Image {
        let normal = |sample: &super::ViewSample| {
            if sample.is_sky() { Vec3::ZERO } else { sample.shading_normal.get() }
        };
        Image { width: self.width, height: self.height, pixels: self.centers.iter().map(normal).collect() }
    }

    /// How far away what is seen at each pixel's centre is, metres, in all three channels; infinite where no surface is seen.
    pub fn depths(&self) -> Image {
        let pixels = self.centers.iter().map(|sample| Vec3::splat(sample.depth)).collect();
        Image { width: self.width, height: self.height, pixels }
    }
}
