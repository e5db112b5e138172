//! Files: shots, rigs, maps, images.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use relume::glam::Vec3;
use relume::image::display;
use relume::{Error, LightKind};
use relume_io::{ExrMeta, check_materials, read_environment, write_exr, write_png};

use super::{Pending, Viewer};
use crate::autosave::Autosave;
use crate::dialog::Purpose;
use crate::document::{Document, NewLight};
use crate::shot::{Shot, Source};

impl Viewer {
    /// Opens a shot in place of the one that is open. The lights stay.
    pub(super) fn open_shot(&mut self, ctx: &egui::Context, source: Source) {
        let wake = ctx.clone();
        (self.scene, self.transfer, self.lit, self.ordered) = (None, None, None, None);
        (self.truth, self.traced, self.developed) = (None, None, None);
        self.snapshots.clear();
        self.preferences.remember(&source.path);
        let path = source.path.clone();
        match Shot::open(source, move || wake.request_repaint()) {
            Ok(shot) => self.shot = Some(shot),
            Err(error) => self.messages.error(&Error::io(path, "open", error)),
        }
        self.recover();
    }

    /// Takes up edits that were never saved.
    pub(super) fn recover(&mut self) {
        let shot = self.shot.as_ref().map(|shot| shot.source().path.clone());
        let of = self.document.path().map(Path::to_owned).or(shot);
        self.autosave = self.options.state.as_ref().zip(of).map(|(state, of)| {
            let folder = state.join("unsaved");
            Autosave::new(&folder, &of)
        });
        let Some(autosave) = &self.autosave else { return };
        match autosave.recovered() {
            Ok(Some(rig)) if rig != self.document.rig => {
                self.document.recover(rig);
                self.wants_lights = false;
                self.messages.warn("Edits that were never saved are here again; Edit, Undo drops them");
            }
            Ok(_) => {}
            Err(error) => {
                autosave.forget();
                self.messages.error(&error);
            }
        }
    }

    pub(super) fn open_rig(&mut self, path: &Path) {
        match Document::open(path) {
            Ok(document) => {
                if let Some(autosave) = &self.autosave {
                    autosave.forget();
                }
                self.document = document;
                self.wants_lights = false;
                self.preferences.remember(path);
                self.check_materials();
                self.recover();
            }
            Err(error) => self.messages.error(&error),
        }
    }

    /// Says which of the rig's materials the shot has not, and leaves them out: no frame could be lit with them.
    pub(super) fn check_materials(&mut self) {
        let Some(transfer) = &self.transfer else { return };
        let report = &transfer.report;
        let path = self.document.path().unwrap_or(Path::new("the rig")).to_owned();
        while let Err(error) = check_materials(&self.document.rig, &path, report.named_materials()) {
            let before = (self.document.rig.emitters.len(), self.document.rig.materials.len());
            let shines = |name: &str| report.named_materials().any(|(known, shines)| known == name && shines);
            self.document.rig.emitters.retain(|emitter| shines(&emitter.material));
            self.document.rig.materials.retain(|edit| report.materials.contains(&edit.name));
            self.messages.warn(format!("{error}; it is left out"));
            if before == (self.document.rig.emitters.len(), self.document.rig.materials.len()) {
                break;
            }
        }
    }

    /// Saves the rig. Returns to what waited for it.
    pub(super) fn save(&mut self, path: &Path) {
        let path = if path.extension().is_none() { path.with_extension("toml") } else { path.to_owned() };
        match self.document.save(&path) {
            Ok(()) => {
                if let Some(autosave) = self.autosave.take() {
                    autosave.forget();
                }
                self.autosave =
                    self.options.state.as_ref().map(|state| Autosave::new(&state.join("unsaved"), &path));
                self.preferences.remember(&path);
                self.messages.notice(format!("Saved {}", path.display()));
            }
            Err(error) => {
                self.pending = None;
                self.messages.error(&error);
            }
        }
    }

    /// What was asked for, with the file for it.
    pub(super) fn answer(&mut self, ctx: &egui::Context, purpose: Purpose, path: PathBuf) {
        match purpose {
            Purpose::OpenShot | Purpose::OpenRig => self.open(ctx, path),
            Purpose::SaveRig => self.save(&path),
            Purpose::ExportImage => self.export(&path),
            Purpose::Map => self.set_map(&path),
        }
    }

    /// Opens a file by its ending: a rig, an environment map, else a shot.
    pub(super) fn open(&mut self, ctx: &egui::Context, path: PathBuf) {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("toml") if self.document.is_changed() => self.pending = Some(Pending::Rig(path)),
            Some("toml") => self.open_rig(&path),
            Some("hdr" | "exr") => self.set_map(&path),
            _ => {
                let settings =
                    self.options.source.as_ref().map(|source| source.settings.clone()).unwrap_or_default();
                let source = Source { settings, ..Source::new(&path) };
                if !path.is_file() {
                    let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
                    self.messages.error(&Error::io(&path, "read", missing));
                } else if self.document.is_changed() && self.document.path().is_none() {
                    self.pending = Some(Pending::Shot(path));
                } else {
                    self.open_shot(ctx, source);
                }
            }
        }
    }

    /// Gives the selected dome a map, or adds a dome with it.
    pub(super) fn set_map(&mut self, path: &Path) {
        let folder =
            self.document.path().and_then(Path::parent).and_then(|folder| std::path::absolute(folder).ok());
        let file = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let name = folder.and_then(|folder| file.strip_prefix(folder).ok()).unwrap_or(&file);
        let read = match read_environment(path, &name.to_string_lossy()) {
            Ok(read) => Arc::new(read),
            Err(error) => return self.messages.error(&error),
        };
        let is_dome = |light: &relume::Light| matches!(light.kind, LightKind::Dome { .. });
        if !self.document.selected_light().is_some_and(|light| is_dome(light)) {
            match self.document.rig.lights.iter().position(is_dome) {
                Some(dome) => self.document.selected = Some(dome),
                None => {
                    let stage = self.stage();
                    self.document.add(NewLight::Dome, stage);
                    if let Some(light) = self.document.selected_light() {
                        *light = light.with_color(Vec3::ONE);
                    }
                }
            }
        }
        if let Some(LightKind::Dome { map, .. }) = self.document.selected_light().map(|light| &mut light.kind)
        {
            *map = Some(read);
        }
    }

    /// Writes the picture on a thread of its own.
    pub(super) fn export(&mut self, path: &Path) {
        let Some(lit) = self.lit.clone() else {
            return self.messages.warn("There is no picture to export yet");
        };
        if lit.preview {
            self.messages.warn("What was exported is a coarse frame: the full one is not there yet");
        }
        let (exposure, curve) = (self.document.rig.exposure, self.preferences.curve.into());
        let written =
            match path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).as_deref() {
                Some("exr") => write_exr(path, &lit.layers, &ExrMeta::default()),
                Some("png") => {
                    let image = lit.layers.full();
                    write_png(path, image.width, image.height, &display(&image, exposure, curve))
                }
                _ => Err(Error::file(path, "an image must end in .exr or .png; name it so")),
            };
        match written {
            Ok(()) => self.messages.notice(format!("Wrote {}", path.display())),
            Err(error) => self.messages.error(&error),
        }
    }
}
