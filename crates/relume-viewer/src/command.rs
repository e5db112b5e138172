//! What menus and keys do.

use eframe::egui::{Key, KeyboardShortcut, Modifiers};

use crate::picture::Tool;

/// Something to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Command {
    OpenShot,
    OpenRig,
    Save,
    SaveAs,
    ExportImage,
    ExportSequence,
    Close,
    Undo,
    Redo,
    Duplicate,
    Delete,
    Key,
    Play,
    FrameBefore,
    FrameAfter,
    Tool(Tool),
    Fit,
    Actual,
    Wipe,
    ShowLights,
    LookThrough,
    Snapshot,
    Help,
}

const CTRL: Modifiers = Modifiers::COMMAND;
const CTRL_SHIFT: Modifiers = CTRL.plus(Modifiers::SHIFT);

/// Every key, the longer combinations first: a shorter one would be taken for them.
const KEYS: [(Command, Modifiers, Key); 25] = [
    (Command::SaveAs, CTRL_SHIFT, Key::S),
    (Command::Redo, CTRL_SHIFT, Key::Z),
    (Command::OpenRig, CTRL_SHIFT, Key::O),
    (Command::ExportSequence, CTRL_SHIFT, Key::E),
    (Command::OpenShot, CTRL, Key::O),
    (Command::Save, CTRL, Key::S),
    (Command::ExportImage, CTRL, Key::E),
    (Command::Close, CTRL, Key::Q),
    (Command::Undo, CTRL, Key::Z),
    (Command::Duplicate, CTRL, Key::D),
    (Command::Delete, Modifiers::NONE, Key::Delete),
    (Command::Key, Modifiers::NONE, Key::K),
    (Command::Play, Modifiers::NONE, Key::Space),
    (Command::FrameBefore, Modifiers::NONE, Key::Comma),
    (Command::FrameAfter, Modifiers::NONE, Key::Period),
    (Command::Tool(Tool::Aim), Modifiers::NONE, Key::A),
    (Command::Tool(Tool::Highlight), Modifiers::NONE, Key::H),
    (Command::Tool(Tool::SHADOW), Modifiers::NONE, Key::J),
    (Command::Fit, Modifiers::NONE, Key::F),
    (Command::Actual, Modifiers::NONE, Key::Num1),
    (Command::Wipe, Modifiers::NONE, Key::W),
    (Command::ShowLights, Modifiers::NONE, Key::L),
    (Command::LookThrough, Modifiers::NONE, Key::T),
    (Command::Snapshot, Modifiers::NONE, Key::P),
    (Command::Help, Modifiers::NONE, Key::F1),
];

impl Command {
    /// All keys, in the order in which they are to be asked.
    pub(crate) fn keys() -> impl Iterator<Item = (Self, KeyboardShortcut)> {
        KEYS.into_iter().map(|(command, modifiers, key)| (command, KeyboardShortcut::new(modifiers, key)))
    }

    /// Its key.
    pub(crate) fn key(self) -> Option<KeyboardShortcut> {
        Self::keys().find(|(command, _)| *command == self).map(|(_, key)| key)
    }

    /// Whether it goes to another frame, or makes keys at this one.
    pub(crate) fn is_of_time(self) -> bool {
        matches!(
            self,
            Self::Key | Self::Play | Self::FrameBefore | Self::FrameAfter | Self::Undo | Self::Redo
        )
    }

    /// Its name in menus.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::OpenShot => "Open scene or cache ...",
            Self::OpenRig => "Open rig ...",
            Self::Save => "Save rig",
            Self::SaveAs => "Save rig as ...",
            Self::ExportImage => "Export image ...",
            Self::ExportSequence => "Export sequence ...",
            Self::Close => "Close",
            Self::Undo => "Undo",
            Self::Redo => "Redo",
            Self::Duplicate => "Duplicate light",
            Self::Delete => "Delete light",
            Self::Key => "Key light",
            Self::Play => "Play or pause",
            Self::FrameBefore => "Frame before",
            Self::FrameAfter => "Frame after",
            Self::Tool(Tool::Select) => "Select",
            Self::Tool(Tool::Aim) => "Aim spot here",
            Self::Tool(Tool::Highlight) => "Place by highlight",
            Self::Tool(Tool::Shadow { .. }) => "Place by shadow",
            Self::Fit => "Fit picture",
            Self::Actual => "Actual size",
            Self::Wipe => "Wipe",
            Self::ShowLights => "Show lights",
            Self::LookThrough => "Look through the light",
            Self::Snapshot => "Store snapshot",
            Self::Help => "Keys and pointer",
        }
    }

    /// What it does, for its tooltip.
    pub(crate) fn explanation(self) -> &'static str {
        match self {
            Self::OpenShot => {
                "A scene (.glb, .gltf, .obj) is prepared while you light it; a cache (.relume) is there at once"
            }
            Self::OpenRig => "Lights from a TOML file, in place of those here",
            Self::Save => "Write the lights to their TOML file",
            Self::SaveAs => "Write the lights to another file",
            Self::ExportImage => {
                "Write what the camera sees: .exr with direct and indirect light in layers, or .png as it is shown"
            }
            Self::ExportSequence => {
                "Write every frame, from the first key to the last: name the files as in lights.####.exr"
            }
            Self::Close => "Close the window",
            Self::Undo => "Take back the last edit",
            Self::Redo => "Do again what was taken back",
            Self::Duplicate => "Add a copy of the selected light",
            Self::Delete => "Delete the selected light",
            Self::Key => {
                "Key what moves of the selected light at this frame; where nothing does, its place begins to"
            }
            Self::Play => "Play from the first keyed frame to the last, over and over",
            Self::FrameBefore => "Go to the frame before",
            Self::FrameAfter => "Go to the frame after",
            Self::Tool(Tool::Select) => "Select lights and drag their handles",
            Self::Tool(Tool::Aim) => "Click or drag where the selected spot shall point",
            Self::Tool(Tool::Highlight) => {
                "Click or drag where the selected light's reflection shall be seen"
            }
            Self::Tool(Tool::Shadow { .. }) => {
                "Click the edge that throws a shadow, then where that shadow shall fall"
            }
            Self::Fit => "Show the whole picture",
            Self::Actual => "Show a pixel of the picture as a pixel of the screen",
            Self::Wipe => "Compare two views side by side; drag the line between them",
            Self::LookThrough => {
                "Show what the selected light sees, warm where the camera sees it too; drag in it to turn the light"
            }
            Self::ShowLights => "Draw lights and their handles in the picture",
            Self::Snapshot => "Keep all light as it is now, to compare with later",
            Self::Help => "Every key, and what the pointer does",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_does_one_thing() {
        for (index, (command, key)) in Command::keys().enumerate() {
            assert_eq!(Command::keys().position(|(_, other)| other == key), Some(index), "{command:?}");
            assert_eq!(command.key(), Some(key));
        }
    }

    #[test]
    fn longer_combinations_are_asked_first() {
        let keys: Vec<_> = Command::keys().map(|(_, key)| key).collect();
        for (index, key) in keys.iter().enumerate() {
            let covered = keys[..index].iter().any(|earlier| {
                earlier.logical_key == key.logical_key && key.modifiers.contains(earlier.modifiers)
            });
            assert!(!covered, "{key:?}");
        }
    }
}
