//! Files: shots, rigs, maps, images.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use relume::glam::Vec3;
use relume::image::display;
use relume::{Error, LightKind};
use relume_io::{ExrMeta, read_environment, write_exr, write_png};

use super::{Pending, Viewer};
use crate::autosave::Autosave;
use crate::dialog::Purpose;
use crate::document::{Document, NewLight};
use crate::shot::{Shot, Source};
use crate::view::View;

impl Viewer {
    /// Opens a shot in place of the one that is open. The lights stay.
    pub(super) fn open_shot(&mut self, ctx: &egui::Context, source: Source) {
        self.document.note();
        let wake = ctx.clone();
        (self.scene, self.transfer, self.lit, self.ordered) = (None, None, None, None);
        (self.truth, self.traced, self.developed, self.print) = (None, None, None, None);
        self.tracing.order(None);
        self.looked = None;
        // prints that are still to come are of the shot before
        self.negatives += 1;
        self.printed = self.negatives;
        self.picture.clear();
        self.snapshots.clear();
        self.views = [View::Full, View::Direct];
        self.unknown.clear();
        self.preferences.remember(&source.path);
        let path = source.path.clone();
        match Shot::open(source, move || wake.request_repaint()) {
            Ok(shot) => self.shot = Some(shot),
            Err(error) => self.messages.error(&Error::io(path, "open", error)),
        }
        self.recover();
    }

    /// Finds where unsaved edits are kept from now on, and takes up those that were never saved.
    pub(super) fn recover(&mut self) {
        let shot = self.shot.as_ref().map(|shot| shot.source().path.clone());
        let of = self.document.path().map(Path::to_owned).or(shot);
        let autosave =
            self.options.state.as_ref().zip(of).map(|(state, of)| Autosave::new(&state.join("unsaved"), &of));
        if autosave == self.autosave {
            return;
        }
        let before = std::mem::replace(&mut self.autosave, autosave);
        // what waits there for lights of another shot waits on, in its file
        let waited = self.recovered.take().is_some();
        let Some(autosave) = self.autosave.clone() else { return };
        if !self.document.is_untouched() {
            // edits of today go before those of another day
            if autosave.is_there() {
                self.set_aside();
            }
            match autosave.keep(&self.document.rig) {
                Ok(()) if !waited => before.iter().for_each(Autosave::forget),
                Ok(()) => {}
                Err(error) => self.messages.error(&error),
            }
            return;
        }
        match autosave.recovered() {
            Ok(Some(rig)) => {
                self.recovered = Some(rig);
                if !self.wants_lights {
                    self.base_is_known();
                }
            }
            Ok(None) => {}
            Err(error) => {
                let aside = autosave.set_aside();
                self.messages.error(&error);
                self.messages
                    .warn(format!("Unsaved edits could not be read; they are in {}", aside.display()));
            }
        }
    }

    pub(super) fn open_rig(&mut self, path: &Path) {
        match Document::open(path) {
            Ok(document) => {
                // whoever had edits there was asked; those of an earlier time wait on in their file
                let waits = self.recovered.take().is_some();
                self.autosave.take().iter().filter(|_| !waits).for_each(Autosave::forget);
                self.document = document;
                self.wants_lights = false;
                self.unknown.clear();
                self.preferences.remember(path);
                self.recover();
            }
            Err(error) => self.messages.error(&error),
        }
    }

    /// Saves the rig. Returns to what waited for it.
    pub(super) fn save(&mut self, path: &Path) {
        let path = if path.extension().is_none() { path.with_extension("toml") } else { path.to_owned() };
        match self.document.save(&path) {
            Ok(()) => {
                self.give_up_recovered();
                self.autosave.take().iter().for_each(Autosave::forget);
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
            Purpose::ExportImage => self.export(ctx, &path),
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
            _ if !path.is_file() => {
                let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
                self.messages.error(&Error::io(&path, "read", missing));
            }
            _ => {
                let settings = self.options.settings.clone();
                self.open_shot(ctx, Source { settings, threads: self.options.threads, ..Source::new(path) });
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
    pub(super) fn export(&mut self, ctx: &egui::Context, path: &Path) {
        let Some(lit) = self.lit.clone() else {
            return self.messages.warn("There is no picture to export yet");
        };
        if lit.preview {
            self.messages.warn("What was exported is a coarse frame: the full one is not there yet");
        }
        let (exposure, curve) = (self.document.rig.exposure, self.preferences.curve.into());
        let (path, done, wake) = (path.to_owned(), self.written.0.clone(), ctx.clone());
        let write = move || {
            let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
            let written = match ending.as_deref() {
                Some("exr") => write_exr(&path, &lit.layers, &ExrMeta::default()),
                Some("png") => {
                    let image = lit.layers.full();
                    write_png(&path, image.width, image.height, &display(&image, exposure, curve))
                }
                _ => Err(Error::file(&path, "an image must end in .exr or .png; name it so")),
            };
            // a window that has closed need not be told
            let _ = done.send(written.map(|()| path));
            wake.request_repaint();
        };
        match std::thread::Builder::new().name("export".to_owned()).spawn(write) {
            Ok(_) => self.writing += 1,
            Err(error) => self.messages.error(&Error::io("threads for the window", "start", error)),
        }
    }
}
