//! Light on the cloud, in the wavelet basis.

use glam::Vec3;

use super::haar;

/// The Haar coefficients of light on the gather cloud, weighted as an operator wants them: `D^-1 W g`, RGB.
#[derive(Clone, Debug, Default)]
pub struct Coefficients(Vec<[f32; 3]>);

impl Coefficients {
    /// The coefficients of `light` (one RGB a gather sample, tree order), each times `weights`' entry; an empty
    /// `weights` stands for ones.
    pub fn new(light: &[Vec3], weights: &[f32]) -> Self {
        let count = light.len();
        let channel = |channel: usize| {
            let mut plane: Vec<f32> = light.iter().map(|rgb| rgb[channel]).collect();
            haar::forward(&mut plane, &mut vec![0.0; count]);
            for (value, weight) in plane.iter_mut().zip(weights) {
                *value *= weight;
            }
            plane
        };
        let (red, (green, blue)) = rayon::join(|| channel(0), || rayon::join(|| channel(1), || channel(2)));
        Self((0..count).map(|i| [red[i], green[i], blue[i]]).collect())
    }

    /// One coefficient.
    #[inline]
    pub(super) fn at(&self, index: usize) -> [f32; 3] {
        self.0[index]
    }

    /// All of them, coarse to fine.
    pub fn as_slice(&self) -> &[[f32; 3]] {
        &self.0
    }
}
