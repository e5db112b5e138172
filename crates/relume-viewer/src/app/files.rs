//! Files: shots, rigs, maps, images.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use relume::glam::Vec3;
use relume::scene::EnvironmentMap;
use relume::{Error, LightKind, LightRig, Transfer};
use relume_io::{FrameNames, read_environment};

use super::orders::shown;
use super::{OpenedRig, Pending, Read, Viewer};
use crate::autosave::Autosave;
use crate::dialog::Purpose;
use crate::document::{Document, NewLight};
use crate::export::{Export, Job, Sheets};
use crate::lighting::Frame;
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
            match autosave.keep(&self.document.whole()) {
                Ok(()) if !waited => before.iter().for_each(Autosave::forget),
                Ok(()) => {}
                Err(error) => self.messages.error(&error),
            }
            return;
        }
        match autosave.recovered(self.document.animated()) {
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

    /// Reads a rig, on a thread of its own: its maps may be large. The rig as it is now may be lost for it, but nothing that is edited meanwhile.
    pub(super) fn open_rig(&mut self, ctx: &egui::Context, path: PathBuf) {
        let given_up = self.document.whole();
        self.asked += 1;
        let number = self.asked;
        self.read(ctx, path, move |path| {
            let opened = Document::open(&path);
            Read::Rig(path, opened.map(|document| Box::new(OpenedRig { document, given_up, number })))
        });
    }

    fn read(
        &mut self,
        ctx: &egui::Context,
        path: PathBuf,
        read: impl FnOnce(PathBuf) -> Read + Send + 'static,
    ) {
        let (done, wake) = (self.read.0.clone(), ctx.clone());
        let read = move || {
            let named = path.clone();
            let read = catch_unwind(AssertUnwindSafe(|| read(path))).unwrap_or(Read::Failed(named));
            // a window that has closed need not be told
            let _ = done.send(read);
            wake.request_repaint();
        };
        match std::thread::Builder::new().name("reading".to_owned()).spawn(read) {
            Ok(_) => self.reading += 1,
            Err(error) => self.messages.error(&Error::io("threads for the window", "start", error)),
        }
    }

    /// Takes up what was read.
    pub(super) fn take_read(&mut self, read: Read) {
        self.reading -= 1;
        match read {
            // of two files, the one that was asked for last is wanted, whichever comes first
            Read::Rig(_, Ok(opened)) if opened.number < self.newest_rig => {}
            Read::Rig(path, Ok(opened)) => {
                if !self.document.is_changed() || self.document.whole() == opened.given_up {
                    self.newest_rig = opened.number;
                    self.take_rig(&path, opened.document);
                } else if self.pending.is_none() {
                    self.pending = Some(Pending::Rig(path));
                } else {
                    let name = path.display();
                    self.messages.warn(format!("{name} was not opened: there are unsaved edits"));
                }
            }
            Read::Map { map: Ok(map), dome, document, number } => {
                let gone = dome.as_ref().is_some_and(|dome| self.document.place(dome).is_none());
                if document != self.documents || gone {
                    let name = map.name();
                    self.messages
                        .warn(format!("{name} was for a dome that is not here now: choose it once more"));
                } else if number > self.newest_map {
                    self.newest_map = number;
                    self.take_map(&map, dome.as_deref());
                }
            }
            Read::Rig(_, Err(error)) | Read::Map { map: Err(error), .. } => self.messages.error(&error),
            Read::Failed(path) => {
                self.messages.error(&Error::file(path, "could not be read: its reader has failed"));
            }
        }
    }

    fn take_rig(&mut self, path: &Path, document: Document) {
        // whoever had edits there was asked; those of an earlier time wait on in their file
        let waits = self.recovered.take().is_some();
        self.autosave.take().iter().filter(|_| !waits).for_each(Autosave::forget);
        self.document = document;
        self.revision = self.document.revision();
        self.documents += 1;
        self.playing = None;
        self.wants_lights = false;
        self.unknown.clear();
        self.preferences.remember(path);
        self.recover();
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
            Purpose::ExportImage => self.export_image(ctx, path),
            Purpose::ExportSequence => self.export_sequence(ctx, path),
            Purpose::Map => self.set_map(ctx, path),
        }
    }

    /// Opens a file by its ending: a rig, an environment map, else a shot.
    pub(super) fn open(&mut self, ctx: &egui::Context, path: PathBuf) {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("toml") if self.document.is_changed() => self.pending = Some(Pending::Rig(path)),
            Some("toml") => self.open_rig(ctx, path),
            Some("hdr" | "exr") => self.set_map(ctx, path),
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

    /// Reads a map for the selected dome, or for the first one, on a thread of its own.
    pub(super) fn set_map(&mut self, ctx: &egui::Context, path: PathBuf) {
        self.playing = None; // it is of the frame at which it was asked for
        let is_dome = |light: &&relume::Light| matches!(light.kind, LightKind::Dome { .. });
        let lights = &self.document.rig.lights;
        let selected = self.document.selected.and_then(|selected| lights.get(selected));
        let dome = selected.filter(is_dome).or_else(|| lights.iter().find(is_dome));
        let (dome, document) = (dome.map(|dome| dome.name.clone()), self.documents);
        self.asked += 1;
        let number = self.asked;
        self.read(ctx, path, move |path| {
            let file = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
            Read::Map { map: read_environment(path, &file.to_string_lossy()), dome, document, number }
        });
    }

    /// Gives the dome of that name a map, or any that is there by now, or adds a dome with it.
    fn take_map(&mut self, map: &EnvironmentMap, dome: Option<&str>) {
        let folder =
            self.document.path().and_then(Path::parent).and_then(|folder| std::path::absolute(folder).ok());
        let file = Path::new(map.name());
        let name = folder.and_then(|folder| file.strip_prefix(folder).ok().map(Path::to_owned));
        let read = Arc::new(map.renamed(name.unwrap_or(file.to_owned()).to_string_lossy()));
        let is_dome = |light: &relume::Light| matches!(light.kind, LightKind::Dome { .. });
        let there = dome.and_then(|dome| self.document.place(dome));
        self.document.selected = there.or_else(|| self.document.rig.lights.iter().position(is_dome));
        if self.document.selected.is_none() {
            let stage = self.stage();
            self.document.add(NewLight::Dome, stage);
            if let Some(light) = self.document.selected_light() {
                *light = light.with_color(Vec3::ONE);
            }
        }
        if let Some(LightKind::Dome { map, .. }) = self.document.selected_light().map(|light| &mut light.kind)
        {
            *map = Some(read);
        }
    }

    /// Writes the picture, as it is in full.
    fn export_image(&mut self, ctx: &egui::Context, path: PathBuf) {
        let Some(transfer) = self.transfer.clone() else { return };
        let rig = shown(self.document.rig.clone(), self.document.solo.as_deref(), &transfer);
        let is_it = |lit: &&Arc<Frame>| {
            let same = LightRig { exposure: 0.0, ..rig.clone() } == lit.rig;
            same && !lit.preview && Arc::ptr_eq(&lit.transfer, &transfer)
        };
        let lit = self.lit.as_ref().filter(is_it).cloned();
        let animated = self.document.animated().clone();
        self.export(ctx, path, transfer, Sheets::One { animated, rig, lit });
    }

    /// Writes a picture of every frame.
    fn export_sequence(&mut self, ctx: &egui::Context, path: PathBuf) {
        self.document.note();
        let (Some(transfer), Some(frames)) = (self.transfer.clone(), self.document.frames()) else { return };
        let (solo, of) = (self.document.solo.clone(), Arc::clone(&transfer));
        let shown = move |rig| shown(rig, solo.as_deref(), &of);
        let animated = self.document.animated().clone();
        let first = FrameNames::new(&path).ok().map(|names| names.file(*frames.start()));
        if let Some(first) = first.filter(|first| first.exists()) {
            self.messages
                .warn(format!("{} and what else is there of these frames is written anew", first.display()));
        }
        let sheets = Sheets::Sequence { animated, frames, shown: Box::new(shown) };
        self.export(ctx, path, transfer, sheets);
    }

    fn export(&mut self, ctx: &egui::Context, path: PathBuf, transfer: Arc<Transfer>, sheets: Sheets) {
        let is_last = self.shot.as_ref().is_none_or(|shot| shot.stage() == crate::shot::Stage::Ready);
        if !is_last {
            self.messages.warn(
                "What is exported is of a preparation that goes on: export it again once that is ready",
            );
        }
        if let Some(solo) = &self.document.solo {
            self.messages.warn(format!("{solo} is exported alone, as it is shown"));
        }
        let (per_light, curve) = (self.preferences.per_light, self.preferences.curve.into());
        let wake = ctx.clone();
        let job = Job { transfer, sheets, path, per_light, curve };
        match Export::start(job, move || wake.request_repaint()) {
            Ok(export) => self.exports.push(export),
            Err(error) => self.messages.error(&error),
        }
    }

    /// Tells of images that are written.
    pub(super) fn listen_to_exports(&mut self) {
        let messages = &mut self.messages;
        let mut failed = false;
        self.exports.retain(|export| {
            let Some(end) = export.ended() else { return true };
            let (written, of) = export.progress();
            match end {
                Ok(()) if of == 1 => messages.notice(format!("Wrote {}", export.path().display())),
                Ok(()) => messages.notice(format!("Wrote {of} frames: {}", export.path().display())),
                Err(Error::Cancelled) => {
                    messages.notice(format!("The export has ended: {written} of {of} frames are written"));
                }
                Err(error) => {
                    failed = true;
                    messages.error(&error);
                }
            }
            false
        });
        // it is to be read before the window closes
        if failed && self.pending == Some(Pending::Frames) {
            self.pending = None;
        }
    }
}
