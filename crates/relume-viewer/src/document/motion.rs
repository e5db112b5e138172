//! The rig over time: the present frame, and keys.

use std::ops::RangeInclusive;

use relume::LightKind;
use relume::{Light, Result};
use relume_io::{AnimatedRig, Curve, Field, Interpolation, Subject};

use super::Document;

/// The present frame of a rig in which nothing moves yet.
pub(super) const FIRST: i32 = 1;

impl Document {
    /// The present frame.
    pub(crate) fn frame(&self) -> i32 {
        self.frame
    }

    /// The first keyed frame and the last; `None` where nothing moves.
    pub(crate) fn frames(&self) -> Option<RangeInclusive<i32>> {
        self.history.now().frames()
    }

    /// All that moves.
    pub(crate) fn curves(&self) -> impl Iterator<Item = Curve<'_>> {
        self.history.now().curves()
    }

    /// The rig as it was noted last.
    pub(crate) fn animated(&self) -> &AnimatedRig {
        self.history.now()
    }

    /// Goes to another frame; where the rig cannot be there, it stays, and [`Self::fault`] tells why.
    pub(crate) fn go_to(&mut self, frame: i32) {
        self.note();
        if frame == self.frame {
            return;
        }
        match self.history.now().rig(frame.into()) {
            Ok(rig) => {
                (self.frame, self.noted) = (frame, rig.clone());
                self.rig = rig;
                self.keep_selection();
            }
            Err(error) => self.fault = Some(error),
        }
    }

    /// The keyed frame nearest to the present one, after it or before it.
    pub(crate) fn next_key(&self, after: bool) -> Option<i32> {
        let frames = || self.curves().flat_map(|curve| curve.frames.to_vec());
        if after {
            frames().filter(|&frame| frame > self.frame).min()
        } else {
            frames().filter(|&frame| frame < self.frame).max()
        }
    }

    /// Fields that rest and could move: of the selected light, of the rig itself, of emitters and materials.
    pub(crate) fn resting(&self) -> Vec<Field> {
        let light = self.selected.and_then(|selected| self.rig.lights.get(selected));
        let light = light.map(|light| Subject::Light(light.name.clone()));
        let emitters = self.rig.emitters.iter().map(|emitter| Subject::Emitter(emitter.material.clone()));
        let materials = self.rig.materials.iter().map(|edit| Subject::Material(edit.name.clone()));
        let subjects: Vec<Subject> =
            light.into_iter().chain([Subject::Rig]).chain(emitters).chain(materials).collect();
        self.history.now().resting(&subjects, self.frame)
    }

    /// Puts a key of `field` at the present frame.
    pub(crate) fn key(&mut self, field: &Field) {
        self.change(format!("key {}", named(field)), |rig, frame| rig.keyed(field, frame));
    }

    /// Takes the key of `field` at the present frame away.
    pub(crate) fn unkey(&mut self, field: &Field) {
        self.change(format!("take a key from {}", named(field)), |rig, frame| rig.unkeyed(field, frame));
    }

    /// Lets `field` rest as it is.
    pub(crate) fn hold(&mut self, field: &Field) {
        self.change(format!("hold {}", named(field)), |rig, frame| rig.held(field, frame));
    }

    /// Chooses how `field` goes from key to key.
    pub(crate) fn interpolate(&mut self, field: &Field, interpolation: Interpolation) {
        let name = format!("make {} {}", named(field), interpolation.name());
        self.change(name, |rig, _| rig.interpolated(field, interpolation));
    }

    /// Puts keys of all that moves of the selected light at the present frame; of a light that rests, of where it is.
    pub(crate) fn key_selected(&mut self) {
        let Some(light) = self.selected.and_then(|selected| self.rig.lights.get(selected)) else { return };
        let of = Subject::Light(light.name.clone());
        let moving = self.curves().map(|curve| curve.field).filter(|field| field.of == of);
        let mut fields: Vec<Field> = moving.collect();
        if fields.is_empty() {
            fields
                .extend(whereabouts(light).iter().map(|&key| Field { of: of.clone(), key: key.to_owned() }));
        }
        self.change(format!("key {}", light.name), |rig, frame| {
            fields.iter().try_fold(rig.clone(), |rig, field| rig.keyed(field, frame))
        });
    }

    fn change(&mut self, name: String, change: impl FnOnce(&AnimatedRig, i32) -> Result<AnimatedRig>) {
        self.note();
        match change(self.history.now(), self.frame) {
            Ok(rig) => self.step(rig, name),
            Err(error) => self.fault = Some(error),
        }
    }
}

/// The fields that say where a light is, or where it points.
fn whereabouts(light: &Light) -> &'static [&'static str] {
    match light.kind {
        LightKind::Omni { .. } => &["position"],
        LightKind::Spot { .. } => &["position", "target"],
        LightKind::Distant { .. } => &["direction"],
        LightKind::Dome { .. } => &["rotation"],
    }
}

/// A field in words: "position of key".
pub(crate) fn named(field: &Field) -> String {
    let key = field.key.replace('_', " ");
    match &field.of {
        Subject::Rig => key,
        Subject::Light(name) | Subject::Emitter(name) | Subject::Material(name) => format!("{key} of {name}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{NewLight, Stage};
    use super::*;
    use relume::LightRig;
    use relume::glam::Vec3;

    fn document() -> Document {
        let mut document = Document::new(&LightRig::default()).unwrap();
        let stage = Stage { eye: Vec3::new(0.0, 1.6, 5.0), center: Vec3::new(0.0, 1.0, 0.0) };
        document.add(NewLight::Omni, stage);
        document.add(NewLight::Spot, stage);
        document.note();
        document
    }

    fn position(document: &Document) -> Vec3 {
        document.rig.lights[1].position().unwrap()
    }

    #[test]
    fn a_light_that_is_keyed_moves() {
        let mut document = document();
        assert_eq!((document.frame(), document.frames()), (1, None));
        document.key_selected();
        assert_eq!((document.undoes(), document.frames()), (Some("key spot"), Some(1..=1)));
        let from = position(&document);
        document.go_to(11);
        document.rig.lights[1].translate(Vec3::X);
        assert!(document.is_changed());
        document.go_to(6);
        assert_eq!(document.frames(), Some(1..=11), "what was edited is noted before");
        assert!((position(&document).x - from.x - 0.5).abs() < 1e-4, "{}", position(&document));
        assert_eq!((document.next_key(true), document.next_key(false)), (Some(11), Some(1)));
        // what is undone is undone, wherever one is by then
        assert_eq!(document.undoes(), Some("move spot"));
        document.undo();
        assert_eq!((position(&document), document.frame()), (from, 6));
        document.redo();
        document.go_to(11);
        assert_eq!(position(&document), from + Vec3::X);
        let path = Field { of: Subject::Light("spot".to_owned()), key: "position".to_owned() };
        document.interpolate(&path, Interpolation::Linear);
        assert_eq!(document.undoes(), Some("make position of spot linear"));
        document.unkey(&path);
        assert_eq!(position(&document), from);
        document.hold(&path);
        assert_eq!(document.curves().count(), 1, "its target still has a key");
    }

    #[test]
    fn what_rests_can_be_made_to_move() {
        let mut document = document();
        let resting = document.resting();
        let names: Vec<String> = resting.iter().map(named).collect();
        assert!(names.contains(&"exposure".to_owned()) && names.contains(&"outer angle of spot".to_owned()));
        assert!(!names.iter().any(|name| name.ends_with("omni")), "of the selected light alone");
        resting.iter().for_each(|field| document.key(field));
        assert_eq!((document.curves().count(), document.resting()), (resting.len(), Vec::new()));
        assert!(document.fault().is_none());
    }

    #[test]
    fn what_cannot_be_at_another_frame_is_taken_back() {
        let mut document = document();
        let path = Field { of: Subject::Light("spot".to_owned()), key: "position".to_owned() };
        document.key(&path);
        document.go_to(5);
        document.rig.lights[1].translate(Vec3::Y);
        document.note();
        let elsewhere = position(&document);
        document.go_to(1);
        let before = document.rig.clone();
        if let LightKind::Spot { target, .. } = &mut document.rig.lights[1].kind {
            *target = elsewhere;
        }
        assert!(!document.note());
        assert_eq!(document.rig, before);
        let fault = document.fault().unwrap().to_string();
        assert!(fault.contains("at frame 5") && document.fault().is_none(), "{fault}");
    }
}
