use relume::LightKind;

/// The `type` of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightType {
    Omni,
    Spot,
    Distant,
    Dome,
}

/// A table that gives a colour to the scene's materials of one name: its own name, with its article, and its keys with examples.
pub(super) struct NamedTable {
    pub(super) table: &'static str,
    pub(super) article: &'static str,
    pub(super) name: (&'static str, &'static str),
    pub(super) color: (&'static str, &'static str),
}

pub(super) const EMITTER: NamedTable = NamedTable {
    table: "emitter",
    article: "an",
    name: ("material", "\"lamp\""),
    color: ("scale", "[0.5, 0.5, 0.5]"),
};

pub(super) const MATERIAL: NamedTable = NamedTable {
    table: "material",
    article: "a",
    name: ("name", "\"wall\""),
    color: ("base_color", "[0.7, 0.1, 0.1]"),
};

/// A key of a light.
pub(super) struct Key {
    pub(super) name: &'static str,
    /// For the message that asks for it.
    pub(super) example: &'static str,
    /// A number, or three, that may be left out, and what they are then.
    pub(super) default: Option<f32>,
}

const fn key(name: &'static str, example: &'static str) -> Key {
    Key { name, example, default: None }
}

const fn optional(name: &'static str, example: &'static str) -> Key {
    Key { name, example, default: Some(0.0) }
}

/// The key of a dome's map, which may be left out.
pub(super) const MAP: &str = "map";

const NAME: Key = key("name", "\"key\"");
const TYPE: Key = key("type", "\"spot\"");
const ENABLED: Key = key("enabled", "true");
const POSITION: Key = key("position", "[1.0, 4.0, 0.5] (metres)");
const INTENSITY: Key = key("intensity", "[60.0, 55.0, 50.0] (W/sr)");
const RADIUS: Key = optional("radius", "0.1 (metres)");

const OMNI: &[Key] = &[NAME, TYPE, ENABLED, POSITION, INTENSITY, RADIUS];
const SPOT: &[Key] = &[
    NAME,
    TYPE,
    ENABLED,
    POSITION,
    key("target", "[0.0, 0.0, 0.0] (metres)"),
    INTENSITY,
    key("inner_angle", "20.0 (degrees from the axis)"),
    key("outer_angle", "30.0 (degrees from the axis)"),
    RADIUS,
];
const DISTANT: &[Key] = &[
    NAME,
    TYPE,
    ENABLED,
    key("direction", "[0.3, -1.0, 0.2] (the way the light travels)"),
    key("irradiance", "[3.0, 2.8, 2.5] (W/m^2)"),
    optional("angle", "0.53 (degrees)"),
];
const DOME: &[Key] = &[
    NAME,
    TYPE,
    ENABLED,
    key(MAP, "\"sky.hdr\" (.hdr or .exr, beside the rig)"),
    Key { name: "intensity", example: "[1.0, 1.0, 1.0] (times the map, or W/(sr m^2))", default: Some(1.0) },
    optional("rotation", "90.0 (degrees about +Y)"),
];

impl LightType {
    pub(super) const ALL: [Self; 4] = [Self::Omni, Self::Spot, Self::Distant, Self::Dome];
    /// For messages.
    pub(super) const CHOICE: &str = "\"omni\", \"spot\", \"distant\" or \"dome\"";

    pub(super) fn of(kind: &LightKind) -> Self {
        match kind {
            LightKind::Omni { .. } => Self::Omni,
            LightKind::Spot { .. } => Self::Spot,
            LightKind::Distant { .. } => Self::Distant,
            LightKind::Dome { .. } => Self::Dome,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Omni => "omni",
            Self::Spot => "spot",
            Self::Distant => "distant",
            Self::Dome => "dome",
        }
    }

    pub(super) fn keys(self) -> &'static [Key] {
        match self {
            Self::Omni => OMNI,
            Self::Spot => SPOT,
            Self::Distant => DISTANT,
            Self::Dome => DOME,
        }
    }

    pub(super) fn key(self, name: &str) -> Option<&'static Key> {
        self.keys().iter().find(|key| key.name == name)
    }
}

/// The one of `known` that `written` was probably meant to be.
pub(super) fn near_miss<'k>(written: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    let plain = |name: &str| name.to_lowercase().replace(['-', ' '], "_");
    let written = plain(written);
    known
        .into_iter()
        .map(|name| (strsim::damerau_levenshtein(&written, &plain(name)), name))
        .filter(|&(distance, name)| distance <= 1 + name.len() / 5)
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, name)| name)
}

/// The type that other programs call `written`.
pub(super) fn synonym(written: &str) -> Option<LightType> {
    match written.to_lowercase().as_str() {
        "point" | "sphere" | "bulb" => Some(LightType::Omni),
        "cone" | "spotlight" => Some(LightType::Spot),
        "directional" | "sun" | "parallel" => Some(LightType::Distant),
        "sky" | "environment" | "hdri" | "skydome" => Some(LightType::Dome),
        _ => None,
    }
}
