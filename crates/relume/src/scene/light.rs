use std::collections::{BTreeSet, HashMap};

use glam::Vec3;

use crate::Error;

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
}

/// How an emissive material shines.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// The material's name in the scene; all materials of that name are meant.
    pub material: String,
    /// What its emission is multiplied by, linear RGB, not negative.
    pub scale: Vec3,
}

/// What is wrong with one of a rig's emitters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EmitterFault {
    /// Which of [`LightRig::emitters`].
    pub emitter: usize,
    /// One sentence.
    pub message: String,
}

impl From<EmitterFault> for Error {
    fn from(fault: EmitterFault) -> Self {
        Self::Setting(fault.message)
    }
}

impl LightRig {
    /// Which of [`Self::emitters`] each of `materials` follows: their names, and whether they emit anything in the scene.
    ///
    /// # Errors
    /// [`EmitterFault`] for the first emitter that names no material, or none that emits, repeats an earlier one, or has a scale that is
    /// negative or no number.
    pub fn emitters_of<'m>(
        &self,
        materials: impl Iterator<Item = (&'m str, bool)>,
    ) -> Result<Vec<Option<usize>>, EmitterFault> {
        let mut by_name: HashMap<&str, usize> = HashMap::new();
        for (emitter, Emitter { material, scale }) in self.emitters.iter().enumerate() {
            let fault = |message: String| Err(EmitterFault { emitter, message });
            if by_name.insert(material, emitter).is_some() {
                return fault(format!("emitter `{material}`: an earlier one names this material too"));
            }
            if !scale.is_finite() || scale.min_element() < 0.0 {
                return fault(format!(
                    "emitter `{material}`: `scale` must be three finite numbers, none negative"
                ));
            }
        }
        let (mut known, mut shining) = (vec![false; self.emitters.len()], vec![false; self.emitters.len()]);
        let mut names: BTreeSet<&str> = BTreeSet::new();
        let mut of_materials = Vec::new();
        for (name, emits) in materials {
            let emitter = by_name.get(name).copied();
            if let Some(emitter) = emitter {
                known[emitter] = true;
                shining[emitter] |= emits;
            }
            if emits && !name.is_empty() {
                names.insert(name);
            }
            of_materials.push(emitter);
        }
        if let Some(emitter) = shining.iter().position(|shines| !shines) {
            let name = &self.emitters[emitter].material;
            let what =
                if known[emitter] { "this material emits nothing" } else { "no material has this name" };
            return Err(EmitterFault {
                emitter,
                message: format!("emitter `{name}`: {what}; {}", listed(&names)),
            });
        }
        Ok(of_materials)
    }
}

/// Most names of materials that a message lists.
const LISTED: usize = 12;

fn listed(names: &BTreeSet<&str>) -> String {
    if names.is_empty() {
        return "the scene has no named material that shines".to_owned();
    }
    let first: Vec<String> = names.iter().take(LISTED).map(|name| format!("`{name}`")).collect();
    let more =
        if names.len() > LISTED { format!(" and {} more", names.len() - LISTED) } else { String::new() };
    format!("those that shine are {}{more}", first.join(", "))
}

impl Light {
    /// The linear factor of everything this light does: its intensity or irradiance.
    pub fn color(&self) -> Vec3 {
        match self.kind {
            LightKind::Omni { intensity, .. } | LightKind::Spot { intensity, .. } => intensity,
            LightKind::Distant { irradiance, .. } => irradiance,
        }
    }

    /// The same light with another [`Self::color`].
    #[must_use]
    pub fn with_color(&self, color: Vec3) -> Self {
        let mut light = self.clone();
        match &mut light.kind {
            LightKind::Omni { intensity, .. } | LightKind::Spot { intensity, .. } => {
                *intensity = color;
            }
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
