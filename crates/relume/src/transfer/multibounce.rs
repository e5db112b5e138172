//! What the bounce operator holds, and how light goes round by it.

use glam::Vec3;

use super::bounces::reflected;
use super::{BounceSeries, Operator, Transfer, Work};
use crate::sample::GatherCloud;
use crate::{Error, Result};

/// What the bounce operator holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Multibounce {
    /// One bounce, gathered as the final gather is; applied again and again. The default.
    #[default]
    Iterated,
    /// All bounces at once, from photons (Hasan 2006, section 4.3); applied once. Where light meets more than one surface of the
    /// cloud, all but the last reflect the mean of their channels.
    Photon,
}

impl Multibounce {
    /// How often the operator is applied to the light that a prior learns from: four bounces, or all.
    pub(super) fn times_to_learn(self) -> u32 {
        match self {
            Self::Iterated => 4,
            Self::Photon => 1,
        }
    }

    /// Whether indirect light can be stopped after `bounces`; `None` is all. All bounces at once cannot be told apart: lights
    /// can do with none or one, which the operator has no part in, and what surfaces and domes emit (`emits`: whether any does)
    /// with none.
    ///
    /// # Errors
    /// [`Error::Setting`] where it cannot.
    pub fn check_bounces(self, bounces: Option<u32>, emits: bool) -> Result<()> {
        let told_apart = if emits { 0 } else { 1 };
        match bounces {
            Some(bounces) if self == Self::Photon && bounces > told_apart => Err(Error::Setting(format!(
                "{bounces} bounces{}: the shot was prepared with photons, whose bounces cannot be told apart; ask for {} or for \
                 all, or prepare it with --multibounce iterated",
                if emits { " of what surfaces or domes emit" } else { "" },
                if emits { "0" } else { "0, 1" },
            ))),
            _ => Ok(()),
        }
    }
}

/// How light goes round within the cloud of one transfer.
#[derive(Clone, Debug)]
pub enum CloudBounces {
    /// Bounce by bounce.
    Iterated(BounceSeries),
    /// All at once; the albedo of each gather sample.
    Photon(Vec<Vec3>),
}

impl CloudBounces {
    /// For the bounce operator of `transfer`, within its cloud or one of the same samples.
    pub fn new(transfer: &Transfer, cloud: &GatherCloud) -> Self {
        let albedo: Vec<Vec3> = cloud.samples.iter().map(|sample| sample.albedo).collect();
        match transfer.multibounce() {
            Multibounce::Iterated => Self::Iterated(BounceSeries::new(&transfer.bounce, &albedo)),
            Multibounce::Photon => Self::Photon(albedo),
        }
    }

    /// The same bounces from fewer applications of the operator ([`BounceSeries::coarse`]); photons take one in any case.
    #[must_use]
    pub fn coarse(&self) -> Self {
        match self {
            Self::Iterated(series) => Self::Iterated(series.coarse()),
            Self::Photon(_) => self.clone(),
        }
    }

    /// `light` and what comes of it after up to `times` bounces within the cloud; `None` is all. Also returns how often the
    /// operator was applied, and how much there was to do for it. Photons know no number but 0: any other is all. `epsilon` is that of
    /// culling ([`Operator::apply_coefficients`]).
    pub fn sum(
        &self,
        bounce: &Operator,
        light: &[Vec3],
        times: Option<u32>,
        epsilon: f32,
    ) -> (Vec<Vec3>, u32, Work) {
        match self {
            Self::Iterated(series) => series.sum(bounce, light, times, epsilon),
            Self::Photon(_) if times == Some(0) => (light.to_vec(), 0, Work::default()),
            Self::Photon(albedo) => {
                let (mut sum, work) = reflected(bounce, albedo, light, epsilon);
                sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += *light);
                (sum, 1, work)
            }
        }
    }

    /// The same without `light` itself: what comes of it after one bounce and up to `times` more; of photons, after all, whatever `times`
    /// ([`Multibounce::check_bounces`] refuses what they cannot do).
    pub fn sum_reflected(
        &self,
        bounce: &Operator,
        light: &[Vec3],
        times: Option<u32>,
        epsilon: f32,
    ) -> (Vec<Vec3>, u32, Work) {
        match self {
            Self::Iterated(series) => {
                let (reflected, first) = series.reflect(bounce, light, epsilon);
                let (sum, steps, mut work) = series.sum(bounce, &reflected, times, epsilon);
                work += first;
                (sum, steps + 1, work)
            }
            Self::Photon(albedo) => {
                let (reflected, work) = reflected(bounce, albedo, light, epsilon);
                (reflected, 1, work)
            }
        }
    }
}
