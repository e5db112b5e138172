use std::sync::Arc;

use glam::Vec3;

use super::{Emitter, EnvironmentMap, MaterialEdit};

/// A light source, and whether it shines.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Unique within its rig.
    pub name: String,
    /// A disabled light adds nothing and costs nothing.
    pub enabled: bool,
    /// What it is and where.
    pub kind: LightKind,
}

/// The closed set of lights. Lights are invisible to the camera.
#[derive(Clone, Debug, PartialEq)]
pub enum LightKind {
    /// Shines the same in every direction and falls off with `1/r^2`.
    Omni {
        /// Metres, world space.
        position: Vec3,
        /// Radiant intensity, W/sr, linear RGB, not negative.
        intensity: Vec3,
        /// Of the emitting sphere, metres; 0 is a point with hard shadows.
        radius: f32,
    },
    /// An omni light within a cone: times `saturate((cos t - cos outer) / (cos inner - cos outer))^2`.
    Spot {
        /// Metres, world space.
        position: Vec3,
        /// A point on the cone's axis, metres, world space; differs from `position`.
        target: Vec3,
        /// Radiant intensity on the axis, W/sr, linear RGB, not negative.
        intensity: Vec3,
        /// Degrees from the axis, `0 <= inner_angle <= outer_angle`.
        inner_angle: f32,
        /// Degrees from the axis, at most 90.
        outer_angle: f32,
        /// Of the emitting sphere, metres; 0 is a point with hard shadows.
        radius: f32,
    },
    /// Light from one direction, as from the sun.
    Distant {
        /// The way the light travels; need not be of unit length.
        direction: Vec3,
        /// At normal incidence, W/m^2, linear RGB, not negative.
        irradiance: Vec3,
        /// Diameter of the disc it comes from, degrees; 0 gives hard shadows.
        angle: f32,
    },
    /// Light from all around, as from the sky.
    Dome {
        /// What shines where; `None` is the same radiance everywhere.
        map: Option<Arc<EnvironmentMap>>,
        /// What the map is multiplied by, or the radiance, W/(sr m^2); linear RGB, not negative.
        intensity: Vec3,
        /// Degrees by which the map is turned about +Y, from +Z towards +X.
        rotation: f32,
    },
}

/// Lights and how the picture is shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightRig {
    /// Stops; display images only.
    pub exposure: f32,
    /// Lights with unique names.
    pub lights: Vec<Light>,
    /// Emissive materials that shine otherwise than in the scene, each at most once.
    pub emitters: Vec<Emitter>,
    /// Materials of another base colour than in the scene, each at most once.
    pub materials: Vec<MaterialEdit>,
}

impl Light {
    /// The linear factor of everything this light does: its intensity or irradiance.
    pub fn color(&self) -> Vec3 {
        match self.kind {
            LightKind::Omni { intensity, .. }
            | LightKind::Spot { intensity, .. }
            | LightKind::Dome { intensity, .. } => intensity,
            LightKind::Distant { irradiance, .. } => irradiance,
        }
    }

    /// The same light with another [`Self::color`].
    #[must_use]
    pub fn with_color(&self, color: Vec3) -> Self {
        let mut light = self.clone();
        match &mut light.kind {
            LightKind::Omni { intensity, .. }
            | LightKind::Spot { intensity, .. }
            | LightKind::Dome { intensity, .. } => *intensity = color,
            LightKind::Distant { irradiance, .. } => *irradiance = color,
        }
        light
    }

    /// True where the two differ in nothing but colour, name and whether they are enabled, so that what
    /// one does is the other's scaled channel by channel.
    pub fn same_but_for_color(&self, other: &Self) -> bool {
        self.with_color(Vec3::ONE).kind == other.with_color(Vec3::ONE).kind
    }
}
