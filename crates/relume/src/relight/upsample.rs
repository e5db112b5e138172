//! From one irradiance a pixel to the pixel's samples and back down (Hasan 2006, section 3.6).

use glam::Vec3;
use rayon::prelude::*;

use crate::sample::ViewSamples;

const NONE: u32 = u32::MAX;

/// Which gathered row each sample takes its indirect light from.
pub(super) struct Upsampling {
    /// One a pixel's centre; `NONE` where nothing reflects.
    of_centers: Vec<u32>,
    /// One a sample of the 2x2 grid.
    of_quads: Vec<u32>,
}

impl Upsampling {
    /// `pixels` are the pixels of the gathered rows.
    pub(super) fn new(view: &ViewSamples, pixels: &[u32]) -> Self {
        let mut of_centers = vec![NONE; view.pixels()];
        for (row, &pixel) in pixels.iter().enumerate() {
            of_centers[pixel as usize] = row as u32;
        }
        let row = |&pixel: &u32| if pixel == NONE { NONE } else { of_centers[pixel as usize] };
        let of_quads = view.nearest_centers().iter().map(row).collect();
        Self { of_centers, of_quads }
    }

    /// `k_d` times the gathered light, averaged over each pixel's samples.
    pub(super) fn apply(&self, view: &ViewSamples, gathered: &[Vec3], aa: u32) -> Vec<Vec3> {
        let (samples, rows, a_pixel) =
            if aa == 1 { (&view.centers, &self.of_centers, 1) } else { (&view.quads, &self.of_quads, 4) };
        let share = 1.0 / a_pixel as f32;
        samples
            .par_chunks_exact(a_pixel)
            .zip(rows.par_chunks_exact(a_pixel))
            .with_min_len(4096)
            .map(|(samples, rows)| {
                let lit = samples.iter().zip(rows).filter(|&(_, &row)| row != NONE);
                lit.map(|(sample, &row)| sample.diffuse.get() * gathered[row as usize]).sum::<Vec3>() * share
            })
            .collect()
    }
}
