use relume::glam::Vec3;
use relume::{Light, LightKind, LightRig};

use super::keys::{LightType, MAP};

/// `rig` as TOML text that [`super::parse_rig`] reads back bit for bit, as long as the rig is usable at all
/// ([`super::save_rig`] checks this). Nothing in it is animated.
pub fn rig_to_toml(rig: &LightRig) -> String {
    let mut text = String::from(
        "# A Relume light rig: metres, degrees, W/sr (intensity), W/m^2 (irradiance), linear RGB.\n\n",
    );
    line(&mut text, "exposure", &number(rig.exposure));
    for light in &rig.lights {
        light_table(&mut text, light);
    }
    for emitter in &rig.emitters {
        text.push_str("\n[[emitter]]\n");
        line(&mut text, "material", &toml::Value::from(emitter.material.as_str()).to_string());
        line(&mut text, "scale", &triple(emitter.scale));
    }
    for edit in &rig.materials {
        text.push_str("\n[[material]]\n");
        line(&mut text, "name", &toml::Value::from(edit.name.as_str()).to_string());
        line(&mut text, "base_color", &triple(edit.base_color));
    }
    text
}

fn light_table(text: &mut String, light: &Light) {
    text.push_str("\n[[light]]\n");
    line(text, "name", &toml::Value::from(light.name.as_str()).to_string());
    line(text, "type", &format!("\"{}\"", LightType::of(&light.kind).name()));
    match &light.kind {
        LightKind::Omni { position, intensity, radius } => {
            line(text, "position", &triple(*position));
            line(text, "intensity", &triple(*intensity));
            line(text, "radius", &number(*radius));
        }
        LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius } => {
            line(text, "position", &triple(*position));
            line(text, "target", &triple(*target));
            line(text, "intensity", &triple(*intensity));
            line(text, "inner_angle", &number(*inner_angle));
            line(text, "outer_angle", &number(*outer_angle));
            line(text, "radius", &number(*radius));
        }
        LightKind::Distant { direction, irradiance, angle } => {
            line(text, "direction", &triple(*direction));
            line(text, "irradiance", &triple(*irradiance));
            line(text, "angle", &number(*angle));
        }
        LightKind::Dome { map, intensity, rotation } => {
            if let Some(map) = map {
                line(text, MAP, &toml::Value::from(map.name()).to_string());
            }
            line(text, "intensity", &triple(*intensity));
            line(text, "rotation", &number(*rotation));
        }
    }
    line(text, "enabled", if light.enabled { "true" } else { "false" });
}

pub(super) fn line(text: &mut String, key: &str, value: &str) {
    text.push_str(key);
    text.push_str(" = ");
    text.push_str(value);
    text.push('\n');
}

/// The shortest decimal that is this f32 and no other; in lower case TOML reads it, even where it is not
/// finite.
pub(super) fn number(value: f32) -> String {
    format!("{value:?}").to_lowercase()
}

fn triple(value: Vec3) -> String {
    format!("[{}, {}, {}]", number(value.x), number(value.y), number(value.z))
}
