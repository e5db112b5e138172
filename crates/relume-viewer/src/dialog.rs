//! Asking for files.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use eframe::egui::{self, Key, Modal, TextEdit};

/// What a file is wanted for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    OpenShot,
    OpenRig,
    SaveRig,
    ExportImage,
    ExportSequence,
    Map,
}

impl Purpose {
    fn title(self) -> &'static str {
        match self {
            Self::OpenShot => "Open a scene or a cache",
            Self::OpenRig => "Open a rig",
            Self::SaveRig => "Save the rig",
            Self::ExportImage => "Export the image",
            Self::ExportSequence => "Export every frame, numbered where the name has #",
            Self::Map => "Choose an environment map",
        }
    }

    /// What files of this kind are called, and their endings.
    fn endings(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::OpenShot => ("Scenes and caches", &["glb", "gltf", "obj", "relume"]),
            Self::OpenRig | Self::SaveRig => ("Light rigs", &["toml"]),
            Self::ExportImage | Self::ExportSequence => ("Images", &["exr", "png"]),
            Self::Map => ("Environment maps", &["hdr", "exr"]),
        }
    }

    fn writes(self) -> bool {
        matches!(self, Self::SaveRig | Self::ExportImage | Self::ExportSequence)
    }
}

/// How files are asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialogs {
    /// By the desktop's own dialogs where there is a desktop, else as [`Self::Typed`].
    #[default]
    Native,
    /// By a line to type a path into.
    Typed,
}

impl Dialogs {
    /// Whether native dialogs can appear: on Linux they come from the desktop portal, by way of the session bus.
    fn are_native(self) -> bool {
        let bus = || {
            let named = std::env::var_os("DBUS_SESSION_BUS_ADDRESS").is_some();
            let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
            named || runtime.is_some_and(|folder| folder.join("bus").exists())
        };
        self == Self::Native && (!cfg!(target_os = "linux") || bus())
    }
}

/// The question at hand, if there is one.
#[derive(Default)]
pub(crate) struct Question(State);

#[derive(Default)]
enum State {
    #[default]
    None,
    Native(Purpose, Receiver<Option<PathBuf>>),
    Typed(Purpose, String),
}

impl Question {
    /// Asks for a file; `suggested` is shown first. A question that is still open is dropped.
    pub(crate) fn ask(&mut self, ctx: &egui::Context, dialogs: Dialogs, purpose: Purpose, suggested: &Path) {
        if !dialogs.are_native() {
            self.0 = State::Typed(purpose, suggested.display().to_string());
            return;
        }
        let (kind, endings) = purpose.endings();
        let mut dialog = rfd::AsyncFileDialog::new().set_title(purpose.title()).add_filter(kind, endings);
        if let Some(folder) = suggested.parent().filter(|folder| folder.is_dir()) {
            dialog = dialog.set_directory(folder);
        }
        if let Some(name) = suggested.file_name().filter(|_| purpose.writes()) {
            dialog = dialog.set_file_name(name.to_string_lossy());
        }
        let (sender, answer) = channel();
        let ctx = ctx.clone();
        let wait = move |chosen: Option<rfd::FileHandle>| {
            // whoever asked may have gone on to another question
            let _ = sender.send(chosen.map(|file| file.path().to_owned()));
            ctx.request_repaint();
        };
        // made here, on the main thread, as some systems want it; waited for on another
        let asked = if purpose.writes() {
            let chosen = dialog.save_file();
            std::thread::Builder::new()
                .name("file dialog".to_owned())
                .spawn(move || wait(pollster::block_on(chosen)))
        } else {
            let chosen = dialog.pick_file();
            std::thread::Builder::new()
                .name("file dialog".to_owned())
                .spawn(move || wait(pollster::block_on(chosen)))
        };
        self.0 = match asked {
            Ok(_) => State::Native(purpose, answer),
            Err(_) => State::Typed(purpose, suggested.display().to_string()),
        };
    }

    /// Shows the question, and returns its answer once it is there.
    pub(crate) fn answer(&mut self, ui: &egui::Ui) -> Option<(Purpose, PathBuf)> {
        match &mut self.0 {
            State::None => None,
            State::Native(purpose, answer) => {
                let purpose = *purpose;
                let chosen = match answer.try_recv() {
                    Err(TryRecvError::Empty) => return None,
                    Err(TryRecvError::Disconnected) => None,
                    Ok(chosen) => chosen,
                };
                self.0 = State::None;
                Some((purpose, chosen?))
            }
            State::Typed(purpose, text) => {
                let purpose = *purpose;
                let (mut done, mut dropped) = (false, false);
                Modal::new(egui::Id::unique("typed path")).show(ui.ctx(), |ui| {
                    ui.set_width(460.0);
                    ui.heading(purpose.title());
                    let (kind, endings) = purpose.endings();
                    let name = ui.label(format!("{kind}: .{}", endings.join(", .")));
                    let line =
                        ui.add(TextEdit::singleline(text).desired_width(f32::INFINITY)).labelled_by(name.id);
                    if !line.has_focus() && !line.lost_focus() {
                        line.request_focus();
                    }
                    ui.horizontal(|ui| {
                        let entered = line.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                        done = ui.button("OK").clicked() || entered;
                        dropped =
                            ui.button("Cancel").clicked() || ui.input(|input| input.key_pressed(Key::Escape));
                    });
                });
                let path = PathBuf::from(text.trim());
                if done || dropped {
                    self.0 = State::None;
                }
                (done && !path.as_os_str().is_empty()).then_some((purpose, path))
            }
        }
    }

    /// Whether a question is open.
    pub(crate) fn is_open(&self) -> bool {
        !matches!(self.0, State::None)
    }
}
