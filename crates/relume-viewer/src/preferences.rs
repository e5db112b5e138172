//! What is remembered from one time to the next.

use std::path::{Path, PathBuf};

use eframe::egui::ThemePreference;
use relume::image::Tonemap;
use serde::{Deserialize, Serialize};

use crate::panels::Measure;

const KEY: &str = "preferences";
/// Files that are remembered.
const RECENT: usize = 10;

/// How whoever lights likes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Preferences {
    pub(crate) theme: ThemePreference,
    pub(crate) curve: Curve,
    pub(crate) measure: Measure,
    /// Whether EXR files have the layers of each light.
    pub(crate) per_light: bool,
    /// Frames a second.
    pub(crate) rate: f32,
    /// Scenes, caches and rigs, the newest first.
    pub(crate) recent: Vec<PathBuf>,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            theme: ThemePreference::Dark,
            curve: Curve::Neutral,
            measure: Measure::Linear,
            per_light: false,
            rate: 24.0,
            recent: Vec::new(),
        }
    }
}

/// The curve from light to display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Curve {
    Neutral,
    AgX,
    Srgb,
}

impl Curve {
    pub(crate) const ALL: [(Self, &str, &str); 3] = [
        (Self::Neutral, "Neutral", "Khronos PBR Neutral: keeps base colours, compresses highlights"),
        (Self::AgX, "AgX", "Flatter; bright colours go to white as on film"),
        (Self::Srgb, "sRGB", "No curve: what is brighter than white is clipped"),
    ];

    pub(crate) fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(curve, ..)| *curve == self).map_or("", |(_, name, _)| name)
    }
}

impl From<Curve> for Tonemap {
    fn from(curve: Curve) -> Self {
        match curve {
            Curve::Neutral => Self::Neutral,
            Curve::AgX => Self::AgX,
            Curve::Srgb => Self::Srgb,
        }
    }
}

impl Preferences {
    /// What was kept, or what suits most where nothing was or it cannot be read.
    pub(crate) fn load(storage: Option<&dyn eframe::Storage>) -> Self {
        storage.and_then(|storage| eframe::get_value(storage, KEY)).unwrap_or_default()
    }

    pub(crate) fn save(&self, storage: &mut dyn eframe::Storage) {
        eframe::set_value(storage, KEY, self);
    }

    /// Puts a file before those that were opened earlier.
    pub(crate) fn remember(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        self.recent.retain(|known| *known != path);
        self.recent.insert(0, path);
        self.recent.truncate(RECENT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_files_come_first_and_once() {
        let mut preferences = Preferences::default();
        for number in 0..20 {
            preferences.remember(Path::new(&format!("/shots/{}.glb", number % 12)));
        }
        assert_eq!(preferences.recent.len(), RECENT);
        assert_eq!(preferences.recent[0], Path::new("/shots/7.glb"));
        let again = preferences.recent[3].clone();
        preferences.remember(&again);
        assert_eq!((preferences.recent.len(), &preferences.recent[0]), (RECENT, &again));
    }
}
