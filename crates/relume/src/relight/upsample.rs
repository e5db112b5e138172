//! From the receivers' irradiance to the pixels' samples and back down (Hasan 2006, section 3.6).

use glam::Vec3;
use rayon::prelude::*;

use crate::sample::Receivers;
use crate::transfer::Transfer;

/// `k_d` times the gathered light, averaged over each pixel's samples. `gathered` is one value a row of the final gather.
pub(super) fn upsample(transfer: &Transfer, gathered: &[Vec3], aa: u32) -> Vec<Vec3> {
    let view = &transfer.view;
    let (samples, rows, a_pixel): (_, &[u32], _) = if aa == 1 {
        (&view.centers, &transfer.rows_of_centers, 1)
    } else {
        (&view.quads, &transfer.rows_of_quads, 4)
    };
    let share = 1.0 / a_pixel as f32;
    samples
        .par_chunks_exact(a_pixel)
        .zip(rows.par_chunks_exact(a_pixel))
        .with_min_len(4096)
        .map(|(samples, rows)| {
            let lit = samples.iter().zip(rows).filter(|&(_, &row)| row != Receivers::NONE);
            lit.map(|(sample, &row)| sample.diffuse.get() * gathered[row as usize]).sum::<Vec3>() * share
        })
        .collect()
}
