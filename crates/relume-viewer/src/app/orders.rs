//! What is ordered of the workers, from what is to be shown.

use std::sync::Arc;
use std::time::Instant;

use eframe::egui;
use relume::transfer::Report;
use relume::{LightRig, Transfer};

use super::Viewer;
use crate::develop::{Negative, Recipe};
use crate::document::alone;
use crate::lighting::{Frame, Order};
use crate::through;
use crate::truth;
use crate::view::View;

impl Viewer {
    /// Asks the workers for what is to be shown now.
    pub(super) fn order(&mut self, ctx: &egui::Context) {
        let down = ctx.input(|input| input.pointer.any_down());
        let rests = down && self.ordered.as_ref().is_some_and(|last| last.dragging);
        self.shot.iter().for_each(|shot| shot.rest(rests));
        self.exports.iter().for_each(|export| export.rest(rests));
        let Some(transfer) = &self.transfer else { return };
        let mut rig = shown(self.document.rig.clone(), self.document.solo.as_deref(), transfer);
        rig.exposure = 0.0;
        let unknown = unknown(&self.document.rig, &transfer.report);
        for name in unknown.into_iter().filter(|name| self.unknown.insert(name.clone())) {
            self.messages.warn(format!("the shot has no such material as `{name}`, or it does not shine: what the rig says of it is left out"));
        }
        let per_light = self.looks_at(|view| matches!(view, View::Light(_)));
        let albedo = self.looks_at(|view| *view == View::Albedo);
        // what moves by itself is shown coarsely as well, so that it is not late
        let moving = down || self.playing.is_some();
        let changed = match &self.ordered {
            None => true,
            Some(last) => {
                let same = Arc::ptr_eq(&last.transfer, transfer) && last.rig == rig;
                !same || last.per_light != per_light || last.albedo != albedo || (last.dragging && !moving)
            }
        };
        if changed {
            let moved = self.ordered.as_ref().is_some_and(|last| last.rig != rig);
            // what follows a drag is the full frame of the same edit, which was on the screen before
            let asked = (moved && self.playing.is_none()).then(Instant::now);
            let order = Order {
                transfer: Arc::clone(transfer),
                rig,
                per_light,
                albedo,
                dragging: moving && moved,
                asked,
                recipe: self.recipe(),
            };
            self.lighting.order(order.clone());
            self.ordered = Some(order);
        }
        if let (Some(eye), Some(transfer)) = (self.eye(), self.transfer.clone()) {
            let order = through::Order { transfer, eye };
            if self.looked.as_ref() != Some(&order) {
                self.looking.order(order.clone());
                self.looked = Some(order);
            }
        } else {
            self.looked = None;
        }
        self.order_truth();
        self.develop();
    }

    /// Whether such a view is shown.
    pub(super) fn looks_at(&self, such: impl Fn(&View) -> bool) -> bool {
        let [left, right] = &self.views;
        such(left) || (self.picture.wipe.is_some() && such(right))
    }

    /// Path traces for as long as the reference is looked at, anew for each rig.
    fn order_truth(&mut self) {
        let looked_at = self.looks_at(|view| *view == View::Reference);
        let outdated = self.traced.as_ref().is_some_and(|traced| {
            !looked_at || self.ordered.as_ref().is_some_and(|ordered| ordered.rig != *traced)
        });
        if outdated {
            self.traced = None;
            self.tracing.order(None);
        }
        let full = self.lit.as_ref().filter(|lit| {
            let current = self.ordered.as_ref().is_some_and(|ordered| ordered.rig == lit.rig);
            looked_at && current && !lit.preview
        });
        if let (Some(lit), Some(scene), Some(transfer)) = (full, &self.scene, &self.transfer)
            && self.traced.is_none()
        {
            self.traced = Some(lit.rig.clone());
            self.tracing.order(Some(truth::Order {
                scene: Arc::clone(scene),
                camera: transfer.report.settings.camera,
                lit: Arc::clone(lit),
            }));
        }
    }

    /// How the picture is to be shown now.
    pub(super) fn recipe(&self) -> Recipe {
        let [left, right] = self.views.clone();
        Recipe {
            left,
            right: self.picture.wipe.map(|_| right),
            exposure: self.document.rig.exposure,
            curve: self.preferences.curve.into(),
            truth: self.truth.as_ref().map(|truth| Arc::clone(&truth.image)),
            snapshots: self
                .snapshots
                .iter()
                .map(|snapshot| (snapshot.number, Arc::clone(&snapshot.image)))
                .collect(),
        }
    }

    /// Has shown what there is, where it is not shown so already.
    fn develop(&mut self) {
        let Some(lit) = &self.lit else { return };
        let recipe = self.recipe();
        let is_shown = |(frame, how): &(Arc<Frame>, Recipe)| Arc::ptr_eq(frame, lit) && *how == recipe;
        if !self.developed.as_ref().is_some_and(is_shown) {
            self.negatives += 1;
            let (number, frame) = (self.negatives, Arc::clone(lit));
            self.developer.order(Negative { number, frame, recipe: recipe.clone() });
            self.developed = Some((Arc::clone(lit), recipe));
        }
    }
}

/// A rig as a shot is to be lit by it: where a light shines alone, without the others and without what emits; and without what is of materials that the shot
/// has not, or that do not shine there, as no frame could be lit with it.
pub(super) fn shown(rig: LightRig, solo: Option<&str>, transfer: &Transfer) -> LightRig {
    let report = &transfer.report;
    let emissive = transfer.emissive_materials();
    let emissive = emissive.into_iter().filter_map(|number| report.materials.get(number as usize)).cloned();
    let mut rig = alone(rig, solo, emissive);
    rig.emitters.retain(|emitter| shines(&emitter.material, report));
    rig.materials.retain(|edit| is_known(&edit.name, report));
    rig
}

/// Names of materials that the shot has not, or that do not shine there.
fn unknown(rig: &LightRig, report: &Report) -> Vec<String> {
    let emitters = rig.emitters.iter().map(|emitter| &emitter.material);
    let edits = rig.materials.iter().map(|edit| &edit.name);
    let dark = emitters.filter(|name| !shines(name, report));
    dark.chain(edits.filter(|name| !is_known(name, report))).cloned().collect()
}

fn is_known(name: &str, report: &Report) -> bool {
    report.materials.iter().any(|known| known == name)
}

fn shines(name: &str, report: &Report) -> bool {
    report.named_materials().any(|(known, shines)| shines && known == name)
}
