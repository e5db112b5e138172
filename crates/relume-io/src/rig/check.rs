use std::collections::HashMap;

use relume::glam::Vec3;
use relume::{Emitter, Error, Light, LightKind, LightRig, MaterialEdit, Result};

use super::keys::LightType;

/// A key of a light and what is wrong with its value.
pub(super) type Fault = (&'static str, String);

/// Everything that makes the values of `light` unusable, key by key.
pub(super) fn light_faults(light: &Light) -> Vec<Fault> {
    let mut faults = Faults(Vec::new());
    if light.name.is_empty() {
        faults.add("name", "`name` must not be empty; give the light a name of its own".to_owned());
    }
    match light.kind {
        LightKind::Omni { position, intensity, radius } => {
            faults.finite("position", position);
            faults.color("intensity", intensity);
            faults.not_negative("radius", radius, f32::MAX);
        }
        LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius } => {
            faults.finite("position", position);
            faults.finite("target", target);
            faults.color("intensity", intensity);
            faults.cone(inner_angle, outer_angle);
            faults.not_negative("radius", radius, f32::MAX);
            if position.is_finite() && target.is_finite() && (target - position).try_normalize().is_none() {
                let message = "`target` must differ from `position`: between them is the way the spot shines";
                faults.add("target", message.to_owned());
            }
        }
        LightKind::Distant { direction, irradiance, angle } => {
            faults.finite("direction", direction);
            faults.color("irradiance", irradiance);
            faults.not_negative("angle", angle, 180.0);
            if direction.is_finite() && direction.try_normalize().is_none() {
                let message =
                    "`direction` has no length; write the way the light travels, such as [0.0, -1.0, 0.0]";
                faults.add("direction", message.to_owned());
            }
        }
        LightKind::Dome { map: _, intensity, rotation } => {
            faults.color("intensity", intensity);
            if !rotation.is_finite() {
                faults.add(
                    "rotation",
                    format!("`rotation` must be a finite number of degrees, not {rotation}"),
                );
            }
        }
    }
    faults.0
}

/// Everything that makes the values of `emitter` unusable, key by key.
pub(super) fn emitter_faults(emitter: &Emitter) -> Vec<Fault> {
    let mut faults = Faults(Vec::new());
    if emitter.material.is_empty() {
        faults.add(
            "material",
            "`material` must not be empty; name an emissive material of the scene".to_owned(),
        );
    }
    faults.color("scale", emitter.scale);
    faults.0
}

/// Everything that makes the values of `edit` unusable, key by key.
pub(super) fn edit_faults(edit: &MaterialEdit) -> Vec<Fault> {
    let mut faults = Faults(Vec::new());
    if edit.name.is_empty() {
        faults.add("name", "`name` must not be empty; name a material of the scene".to_owned());
    }
    faults.reflectance("base_color", edit.base_color);
    faults.0
}

/// What is wrong with an exposure, if anything.
pub(super) fn exposure_fault(exposure: f32) -> Option<String> {
    (!exposure.is_finite()).then(|| format!("`exposure` must be a finite number of stops, not {exposure}"))
}

/// For each light whose name an earlier one has: its index and that of the first.
pub(super) fn repeated_names<'n>(names: impl Iterator<Item = &'n str>) -> Vec<(usize, usize)> {
    let mut first = HashMap::new();
    names
        .enumerate()
        .filter_map(|(i, name)| {
            let earliest = *first.entry(name).or_insert(i);
            (earliest != i).then_some((i, earliest))
        })
        .collect()
}

/// Refuses a rig that could not be read back.
pub(super) fn check_rig(rig: &LightRig) -> Result<()> {
    if let Some(fault) = exposure_fault(rig.exposure) {
        return Err(Error::Setting(fault));
    }
    for light in &rig.lights {
        if let Some((_, fault)) = light_faults(light).into_iter().next() {
            let kind = LightType::of(&light.kind).name();
            return Err(Error::Setting(format!("{kind} light `{}`: {fault}", light.name)));
        }
    }
    for emitter in &rig.emitters {
        if let Some((_, fault)) = emitter_faults(emitter).into_iter().next() {
            return Err(Error::Setting(format!("emitter `{}`: {fault}", emitter.material)));
        }
    }
    if let Some(&(second, _)) = repeated_names(rig.emitters.iter().map(|e| e.material.as_str())).first() {
        let name = &rig.emitters[second].material;
        return Err(Error::Setting(format!("two emitters name the material `{name}`; keep one of them")));
    }
    for edit in &rig.materials {
        if let Some((_, fault)) = edit_faults(edit).into_iter().next() {
            return Err(Error::Setting(format!("material `{}`: {fault}", edit.name)));
        }
    }
    if let Some(&(second, _)) = repeated_names(rig.materials.iter().map(|edit| edit.name.as_str())).first() {
        let name = &rig.materials[second].name;
        return Err(Error::Setting(format!("two materials are named `{name}`; keep one of them")));
    }
    match repeated_names(rig.lights.iter().map(|light| light.name.as_str())).first() {
        Some(&(second, _)) => {
            let name = &rig.lights[second].name;
            Err(Error::Setting(format!("two lights are named `{name}`; give each a name of its own")))
        }
        None => Ok(()),
    }
}

struct Faults(Vec<Fault>);

impl Faults {
    fn add(&mut self, key: &'static str, message: String) {
        self.0.push((key, message));
    }

    fn finite(&mut self, key: &'static str, value: Vec3) {
        if let Some(bad) = value.to_array().into_iter().find(|component| !component.is_finite()) {
            self.add(key, format!("`{key}` must be three finite numbers; {bad} is none"));
        }
    }

    fn color(&mut self, key: &'static str, color: Vec3) {
        self.finite(key, color);
        if let Some(negative) =
            color.to_array().into_iter().find(|&channel| channel < 0.0 && channel.is_finite())
        {
            self.add(key, format!("`{key}` must not be negative, but has {negative}; use 0 or more"));
        }
    }

    fn reflectance(&mut self, key: &'static str, color: Vec3) {
        self.finite(key, color);
        let bad = |channel: &f32| channel.is_finite() && !(0.0..=1.0).contains(channel);
        if let Some(bad) = color.to_array().into_iter().find(bad) {
            self.add(key, format!("`{key}` must be within 0 to 1, but has {bad}"));
        }
    }

    /// True where the value is usable.
    fn not_negative(&mut self, key: &'static str, value: f32, largest: f32) -> bool {
        let usable = (0.0..=largest).contains(&value);
        if !usable {
            let range =
                if largest < f32::MAX { format!("from 0 to {largest}") } else { "0 or more".to_owned() };
            self.add(key, format!("`{key}` must be {range}, not {value}"));
        }
        usable
    }

    fn cone(&mut self, inner: f32, outer: f32) {
        let usable =
            [self.not_negative("inner_angle", inner, 90.0), self.not_negative("outer_angle", outer, 90.0)];
        if usable != [true, true] {
            return;
        }
        if outer == 0.0 {
            self.add(
                "outer_angle",
                "`outer_angle` must be above 0: a cone without width lights nothing".to_owned(),
            );
        } else if inner > outer {
            let message = format!(
                "`inner_angle` ({inner}) must not be above `outer_angle` ({outer}); both are degrees from the axis"
            );
            self.add("inner_angle", message);
        }
    }
}
