//! What comes back: from the workers, and from the shot that is opened.

use std::sync::Arc;

use eframe::egui;
use relume::image::metrics::relative_l2;
use relume::{Error, Transfer};

use super::Viewer;
use crate::develop::Print;
use crate::document::{Document, NewLight};
use crate::lighting::{Frame, Lit};
use crate::shot::{Event, Shot};

impl Viewer {
    /// Takes in what the workers have done since the last time.
    pub(super) fn listen(&mut self, ctx: &egui::Context) {
        while let Some(event) = self.shot.as_ref().and_then(Shot::next) {
            self.hear(event);
        }
        while let Some(lit) = self.lighting.next() {
            match lit {
                Ok(lit) => self.see(ctx, lit),
                Err(error) => self.messages.error(&error),
            }
        }
        if self.lighting.has_failed() && !std::mem::replace(&mut self.is_dark, true) {
            let text = "relighting has failed and goes no further: save your lights, and open the shot again";
            self.messages.error(&Error::Setting(text.to_owned()));
        }
        if let Some((number, print)) = self.developer.newest().filter(|(number, _)| *number > self.printed) {
            self.printed = number;
            self.show(ctx, print);
        }
        match self.tracing.newest() {
            // of a shot that was closed meanwhile, or not
            Some(Ok(truth)) if self.scene.as_ref().is_some_and(|scene| Arc::ptr_eq(scene, &truth.scene)) => {
                self.truth = Some(truth);
            }
            Some(Ok(_)) => {}
            Some(Err(error)) => self.messages.error(&error),
            None => {}
        }
        if let Some((of, image)) = self.looking.newest()
            && self.transfer.as_ref().is_some_and(|transfer| Arc::ptr_eq(transfer, &of))
        {
            self.picture.inset.take(ctx, image);
        }
        self.compare();
        while let Ok(read) = self.read.1.try_recv() {
            self.take_read(read);
        }
        self.listen_to_exports();
        if let Some(again) = self.messages.age() {
            ctx.request_repaint_after(again);
        }
    }

    /// How far the picture that is shown is from the reference of its lights.
    fn compare(&mut self) {
        let (Some(truth), Some(lit)) = (&self.truth, &self.lit) else { return self.off = None };
        if truth.rig != lit.rig {
            return self.off = None;
        }
        let is_known =
            |(frame, paths, _): &(Arc<Frame>, u32, f64)| Arc::ptr_eq(frame, lit) && *paths == truth.paths;
        if !self.off.as_ref().is_some_and(is_known) {
            let error = relative_l2(&lit.layers.full(), &truth.image).unwrap_or(f64::NAN);
            self.off = Some((Arc::clone(lit), truth.paths, error));
        }
    }

    /// Takes up a picture that was lit.
    fn see(&mut self, ctx: &egui::Context, lit: Lit) {
        let Lit { frame, recipe, print } = lit;
        let hash = |transfer: &Transfer| transfer.report.scene_hash.clone();
        if self.transfer.as_ref().is_none_or(|now| hash(now) != hash(&frame.transfer)) {
            return; // of a shot that was closed meanwhile
        }
        let asked = frame.asked;
        self.lit = Some(frame);
        // where something else is to be shown of it by now, it is developed once more
        if self.recipe() == recipe {
            self.developed = self.lit.clone().map(|lit| (lit, recipe));
            self.negatives += 1;
            self.printed = self.negatives;
            self.show(ctx, print);
        }
        // of an edit that was shown; what follows it is the same edit in full
        self.latencies.extend(asked.map(|asked| asked.elapsed()));
    }

    fn show(&mut self, ctx: &egui::Context, print: Print) {
        self.developing = print.took;
        self.histogram = Some(print.histogram.clone());
        self.print = Some((Arc::clone(&print.left), print.right.clone()));
        self.picture.take(ctx, print);
        self.tell_moments();
    }

    fn hear(&mut self, event: Event) {
        match event {
            Event::Scene(scene, warnings) => {
                warnings.into_iter().for_each(|warning| self.messages.warn(warning));
                if self.wants_lights && self.document.is_untouched() && !scene.lights.lights.is_empty() {
                    match Document::new(&scene.lights) {
                        Ok(document) => self.document = document,
                        Err(error) => self.messages.error(&error),
                    }
                    self.base_is_known();
                }
                self.scene = Some(scene);
                self.make_light();
            }
            Event::Transfer(transfer) => {
                self.emissive = transfer.emissive_materials();
                self.shown_materials = transfer.shown_materials();
                self.transfer = Some(transfer);
                self.make_light();
            }
            Event::Ready(kept) => {
                if let Some(kept) = kept {
                    self.messages.notice(format!("Prepared, and kept in {}", kept.display()));
                }
                self.tell("prepared");
            }
            Event::Notice(text) => self.messages.notice(text),
            Event::Failed(error) => self.messages.error(&error),
        }
    }

    /// A first light, where neither rig nor scene have any.
    fn make_light(&mut self) {
        let scene_is_read =
            self.scene.is_some() || self.shot.as_ref().is_some_and(|shot| !shot.source().is_scene());
        if !self.wants_lights || !scene_is_read || self.transfer.is_none() {
            return;
        }
        // of direct light alone it is not known yet who else shines
        let shines = self.report().is_some_and(|report| report.named_materials().any(|(_, shines)| shines));
        if self.document.is_untouched() && self.document.rig.lights.is_empty() && !shines {
            let stage = self.stage();
            self.document.add(NewLight::Omni, stage);
            // it is there from the beginning, and no edit
            match Document::new(&self.document.rig) {
                Ok(document) => self.document = document,
                Err(error) => self.messages.error(&error),
            }
        }
        self.base_is_known();
    }

    /// Takes up what was recovered, once it is known of what it is an edit.
    pub(super) fn base_is_known(&mut self) {
        self.wants_lights = false;
        if !self.document.is_untouched() {
            self.give_up_recovered();
        } else if let Some(rig) = self.recovered.take().filter(|rig| rig != self.document.animated()) {
            self.document.recover(&rig);
            self.messages.warn("Edits that were never saved are here again; Edit, Undo drops them");
        }
    }

    /// Puts edits of an earlier time out of the way of those of today.
    pub(super) fn give_up_recovered(&mut self) {
        if self.recovered.take().is_some() {
            self.set_aside();
        }
    }

    /// Puts what is kept for the rig out of the way, and tells where it is.
    pub(super) fn set_aside(&mut self) {
        if let Some(autosave) = &self.autosave {
            let aside = autosave.set_aside().display().to_string();
            self.messages.warn(format!("Unsaved edits of an earlier time are in {aside}"));
        }
    }
}
