//! Light on the cloud, in the wavelet basis.

use glam::{Mat4, Vec3, Vec4};

use super::haar;

/// The Haar coefficients of light on the gather cloud, weighted as an operator wants them: `D^-1 W E^-1 g`, RGB.
#[derive(Clone, Debug, Default)]
pub struct Coefficients {
    /// One a coefficient, and one more, so that each can be read by its four floats.
    values: Vec<[f32; 3]>,
}

impl Coefficients {
    /// The coefficients of `light`, one RGB a gather sample, in tree order: each sample times its entry in `sample_weights` (`E^-1`), and each coefficient of
    /// that times its entry in `weights` (`D^-1`). Empty slices stand for ones.
    ///
    /// # Panics
    /// If `light` is no power of four long, or `sample_weights` of another length.
    pub fn new(light: &[Vec3], sample_weights: &[f32], weights: &[f32]) -> Self {
        let mut values = vec![[0.0; 3]; light.len() + 1];
        haar::forward_rgb(light, sample_weights, &mut values[..light.len()]);
        for (value, weight) in values.iter_mut().zip(weights) {
            *value = value.map(|channel| channel * weight);
        }
        Self { values }
    }

    /// One coefficient.
    #[inline]
    pub(super) fn at(&self, index: usize) -> [f32; 3] {
        self.as_slice()[index]
    }

    /// All of them, coarse to fine.
    pub fn as_slice(&self) -> &[[f32; 3]] {
        self.values.split_last().map_or(&[], |(_, values)| values)
    }

    /// Those of these numbers, colour by colour; `indices` are below their count.
    pub(super) fn fetch(
        &self,
        indices: impl ExactSizeIterator<Item = usize>,
        [red, green, blue]: [&mut [f32]; 3],
    ) {
        let floats = self.values.as_flattened();
        let at = |index: usize| Vec4::from_slice(&floats[3 * index..]);
        let mut indices = indices;
        let (red, last_red) = red[..indices.len()].as_chunks_mut::<4>();
        let (green, last_green) = green[..indices.len()].as_chunks_mut::<4>();
        let (blue, last_blue) = blue[..indices.len()].as_chunks_mut::<4>();
        let mut next = || at(indices.next().expect("as many as was said"));
        for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
            let colors = Mat4::from_cols(next(), next(), next(), next()).transpose();
            (*red, *green, *blue) = (colors.x_axis.into(), colors.y_axis.into(), colors.z_axis.into());
        }
        for ((red, green), blue) in last_red.iter_mut().zip(last_green).zip(last_blue) {
            [*red, *green, *blue, _] = next().to_array();
        }
    }
}
