use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::Paths;
use crate::shade::{Bsdf, BsdfSample, Surface};
use crate::trace::sampling::{cosine_hemisphere, cosine_hemisphere_density};

/// How a path's vertex answers to light.
#[derive(Clone, Copy, Debug)]
pub(super) enum Response {
    /// By the surface's own BSDF.
    Full(Bsdf),
    /// As a diffuse reflector.
    Diffuse {
        /// Reflected part of the irradiance.
        albedo: Vec3,
        /// Unit; its cosine weighs light.
        normal: Vec3,
        /// Unit; light below its horizon does not count.
        geometric_normal: Vec3,
    },
}

impl Response {
    /// The response to light from other surfaces of the camera's first surface (`first`) or a later one, seen
    /// along the unit `view`. This is where the kinds of [`Paths`] differ; the first surface's response to lights
    /// that shine from a place or a direction is its full BSDF in all of them.
    pub(super) fn new(paths: Paths, first: bool, surface: &Surface, view: Vec3) -> Self {
        match (paths, first) {
            (Paths::All, _) | (Paths::Transfer, true) => Self::Full(Bsdf::new(surface, view)),
            (Paths::DiffuseTransfer, true) => Self::Diffuse {
                albedo: surface.diffuse(surface.shading_normal.dot(view)),
                normal: surface.shading_normal,
                geometric_normal: surface.geometric_normal,
            },
            (Paths::Transfer | Paths::DiffuseTransfer, false) => Self::Diffuse {
                albedo: surface.hemispherical_reflectance(),
                normal: surface.geometric_normal,
                geometric_normal: surface.geometric_normal,
            },
        }
    }

    /// BRDF times the light's cosine, 1/sr, for the unit `light`.
    pub(super) fn evaluate(&self, light: Vec3) -> Vec3 {
        match self {
            Self::Full(bsdf) => bsdf.evaluate(light),
            Self::Diffuse { albedo, normal, geometric_normal } => {
                let cos = normal.dot(light);
                if cos > 0.0 && geometric_normal.dot(light) > 0.0 {
                    *albedo * (cos * (1.0 / PI))
                } else {
                    Vec3::ZERO
                }
            }
        }
    }

    /// Density per solid angle with which [`Self::sample`] draws the unit `light`.
    pub(super) fn density(&self, light: Vec3) -> f32 {
        match self {
            Self::Full(bsdf) => bsdf.density(light),
            Self::Diffuse { normal, .. } => cosine_hemisphere_density(normal.dot(light)),
        }
    }

    /// Draws a direction; `None` where it leads nowhere.
    pub(super) fn sample(&self, choice: f32, sample: Vec2) -> Option<BsdfSample> {
        match self {
            Self::Full(bsdf) => bsdf.sample(choice, sample),
            Self::Diffuse { albedo, normal, geometric_normal } => {
                let direction = cosine_hemisphere(*normal, sample);
                let density = cosine_hemisphere_density(normal.dot(direction));
                let leads = density > 0.0 && geometric_normal.dot(direction) > 0.0 && *albedo != Vec3::ZERO;
                leads.then_some(BsdfSample { direction, weight: *albedo, density })
            }
        }
    }
}
