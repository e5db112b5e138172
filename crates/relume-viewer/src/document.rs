//! The rig that is edited: its file, what is selected, what can be undone.

mod motion;

use std::path::{Path, PathBuf};

use relume::glam::Vec3;
use relume::{Error, Light, LightKind, LightRig, Result};
use relume_io::AnimatedRig;

use crate::history::History;
use crate::wording::change;

pub(crate) use motion::named;

/// What a rig without a file is called.
const UNTITLED: &str = "untitled.toml";

/// The rig at work. Its fields may be edited at will: [`Self::note`] finds out what has changed.
#[derive(Debug)]
pub(crate) struct Document {
    /// As it is at the present frame.
    pub(crate) rig: LightRig,
    /// The light whose fields are shown, by its place in the list.
    pub(crate) selected: Option<usize>,
    /// The light that shines alone, by name: no part of the rig.
    pub(crate) solo: Option<String>,
    path: Option<PathBuf>,
    saved: AnimatedRig,
    history: History,
    /// The present frame, and the rig there as it was noted last.
    frame: i32,
    noted: LightRig,
    /// Why the last edit could not be.
    fault: Option<Error>,
}

/// Kinds of lights to add.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NewLight {
    Omni,
    Spot,
    Distant,
    Dome,
}

impl NewLight {
    pub(crate) const ALL: [Self; 4] = [Self::Omni, Self::Spot, Self::Distant, Self::Dome];

    /// The kind of a light.
    pub(crate) fn of(light: &Light) -> Self {
        match light.kind {
            LightKind::Omni { .. } => Self::Omni,
            LightKind::Spot { .. } => Self::Spot,
            LightKind::Distant { .. } => Self::Distant,
            LightKind::Dome { .. } => Self::Dome,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Omni => "Omni",
            Self::Spot => "Spot",
            Self::Distant => "Distant",
            Self::Dome => "Dome",
        }
    }

    pub(crate) fn explanation(self) -> &'static str {
        match self {
            Self::Omni => "A lamp that shines the same in every direction",
            Self::Spot => "A lamp that shines within a cone",
            Self::Distant => "Light from one direction, as from the sun",
            Self::Dome => "Light from all around: the sky, or a map of one",
        }
    }
}

/// Where new lights go, and how strong they are, so that they are seen at once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Where the camera stands, metres.
    pub(crate) eye: Vec3,
    /// What it looks at, metres.
    pub(crate) center: Vec3,
}

impl Document {
    /// A rig in which nothing moves.
    ///
    /// # Errors
    /// As [`AnimatedRig::still`].
    pub(crate) fn new(rig: &LightRig) -> Result<Self> {
        Self::of(AnimatedRig::still(rig, UNTITLED)?, None)
    }

    /// Reads a rig.
    ///
    /// # Errors
    /// As [`AnimatedRig::load`].
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Self::of(AnimatedRig::load(path)?, Some(path.to_owned()))
    }

    /// A rig as it was read, at its first keyed frame.
    pub(crate) fn of(animated: AnimatedRig, path: Option<PathBuf>) -> Result<Self> {
        let frame = animated.frames().map_or(motion::FIRST, |frames| *frames.start());
        let rig = animated.rig(frame.into())?;
        Ok(Self {
            selected: (!rig.lights.is_empty()).then_some(0),
            solo: None,
            path,
            saved: animated.clone(),
            history: History::new(animated),
            frame,
            noted: rig.clone(),
            rig,
            fault: None,
        })
    }

    /// Where it is saved.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Its name, for the title of the window.
    pub(crate) fn name(&self) -> String {
        let name = self.path.as_ref().and_then(|path| path.file_name());
        name.map_or("untitled rig".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// Whether nobody has done anything to it.
    pub(crate) fn is_untouched(&self) -> bool {
        !self.is_changed() && self.history.undoes().is_none()
    }

    /// Whether there is anything that its file has not.
    pub(crate) fn is_changed(&self) -> bool {
        self.rig != self.noted || *self.history.now() != self.saved
    }

    /// Takes up a rig that was kept from an earlier time as one more edit.
    pub(crate) fn recover(&mut self, rig: &AnimatedRig) {
        match rig.moved_to(self.history.now().path()) {
            Ok(rig) => self.step(rig, "recover edits".to_owned()),
            Err(error) => self.fault = Some(error),
        }
    }

    /// All of it as it is now, with what has not been noted yet where that can be.
    pub(crate) fn whole(&self) -> AnimatedRig {
        let now = self.history.now();
        let edited = (self.rig != self.noted).then(|| now.edited(self.frame, &self.rig).ok()).flatten();
        edited.unwrap_or_else(|| now.clone())
    }

    /// Saves the rig, to another file where one is given, which is then its own.
    ///
    /// # Errors
    /// As [`AnimatedRig::save`]; all stays as it was.
    pub(crate) fn save(&mut self, path: &Path) -> Result<()> {
        self.note();
        if let Some(fault) = self.fault.take() {
            return Err(fault);
        }
        let moved = self.history.now().moved_to(path)?;
        moved.save()?;
        if self.path.as_deref() != Some(path) {
            // of every step, so that what is undone finds its maps as well
            self.history.each(|rig| rig.moved_to(path).unwrap_or_else(|_| rig.clone()));
            self.path = Some(path.to_owned());
            self.show();
        }
        self.saved = self.history.now().clone();
        Ok(())
    }

    /// Keeps what has changed since the last call as one step to undo. What cannot be, at some frame, is taken back, and told by [`Self::fault`].
    pub(crate) fn note(&mut self) -> bool {
        if self.rig == self.noted {
            return false;
        }
        match self.history.now().edited(self.frame, &self.rig) {
            Ok(edited) => {
                self.history.note(edited, change(&self.noted, &self.rig));
                self.noted = self.rig.clone();
                true
            }
            Err(error) => {
                self.rig = self.noted.clone();
                self.keep_selection();
                self.fault = Some(error);
                false
            }
        }
    }

    /// A number that is another one whenever something was noted, undone or done again.
    pub(crate) fn revision(&self) -> u64 {
        self.history.revision()
    }

    /// Why an edit was taken back, once.
    pub(crate) fn fault(&mut self) -> Option<Error> {
        self.fault.take()
    }

    /// Takes another rig as one step to undo.
    fn step(&mut self, rig: AnimatedRig, name: String) {
        self.note();
        self.history.note(rig, name);
        self.show();
    }

    /// Takes up the rig as the history has it.
    fn show(&mut self) {
        let now = self.history.now();
        let (frame, rig) = match now.rig(self.frame.into()) {
            Ok(rig) => (self.frame, rig),
            // between its keys a rig may be impossible, at the first one it never is
            Err(_) => (now.first_frame(), now.rig(now.first_frame().into()).unwrap_or_default()),
        };
        (self.frame, self.noted) = (frame, rig.clone());
        self.rig = rig;
        self.keep_selection();
    }

    pub(crate) fn undoes(&self) -> Option<&str> {
        self.history.undoes()
    }

    pub(crate) fn redoes(&self) -> Option<&str> {
        self.history.redoes()
    }

    /// Goes back a step; what has not been noted yet is one.
    pub(crate) fn undo(&mut self) {
        self.note();
        if self.history.undo() {
            self.show();
        }
    }

    pub(crate) fn redo(&mut self) {
        if !self.note() && self.history.redo() {
            self.show();
        }
    }

    fn keep_selection(&mut self) {
        let last = self.rig.lights.len().checked_sub(1);
        self.selected = self.selected.and_then(|selected| Some(selected.min(last?)));
        let named = |name: &String| self.rig.lights.iter().any(|light| light.name == *name);
        self.solo = self.solo.take().filter(named);
    }

    pub(crate) fn selected_light(&mut self) -> Option<&mut Light> {
        self.rig.lights.get_mut(self.selected?)
    }

    /// A name that no light has yet: `base`, or with a number behind it.
    fn free_name(&self, base: &str) -> String {
        let stem = base.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end();
        let stem = if stem.is_empty() { "light" } else { stem };
        let taken = |name: &str| self.rig.lights.iter().any(|light| light.name == name);
        let numbered = (2..).map(|number| format!("{stem} {number}"));
        std::iter::once(base.to_owned()).chain(numbered).find(|name| !taken(name)).unwrap_or_default()
    }

    /// Adds a light that shows, and selects it.
    pub(crate) fn add(&mut self, kind: NewLight, stage: Stage) {
        let Stage { eye, center } = stage;
        let (distance, up) = ((center - eye).length(), Vec3::Y);
        let beside = (center - eye).cross(up).normalize_or(Vec3::X) * 0.12 * distance;
        // half the way to what is looked at, above it and to its right: in sight of most cameras
        let position = eye + 0.5 * (center - eye) + beside + 0.12 * distance * up;
        // a wall of albedo 0.5 at its target comes out somewhat above middle grey
        let intensity = Vec3::splat(two_digits(1.5 * position.distance_squared(center)));
        let (position, center) = (centimetres(position), centimetres(center));
        let kind_of = match kind {
            NewLight::Omni => LightKind::Omni { position, intensity, radius: 0.0 },
            NewLight::Spot => LightKind::Spot {
                position,
                target: center,
                intensity,
                inner_angle: 18.0,
                outer_angle: 26.0,
                radius: 0.0,
            },
            NewLight::Distant => LightKind::Distant {
                direction: Vec3::new(-0.4, -1.0, -0.3),
                irradiance: Vec3::splat(2.0),
                angle: 0.53,
            },
            NewLight::Dome => LightKind::Dome { map: None, intensity: Vec3::splat(0.5), rotation: 0.0 },
        };
        let name = self.free_name(&kind.name().to_lowercase());
        self.rig.lights.push(Light { name, enabled: true, kind: kind_of });
        self.selected = Some(self.rig.lights.len() - 1);
    }

    /// Adds a copy of the selected light behind it, which moves as it does, and selects that.
    pub(crate) fn duplicate(&mut self) {
        self.note();
        let Some(index) = self.selected else { return };
        let Some(light) = self.rig.lights.get(index) else { return };
        let (name, copy) = (light.name.clone(), self.free_name(&light.name));
        match self.history.now().duplicated(&name, &copy) {
            Ok(rig) => {
                self.step(rig, format!("add {copy}"));
                self.selected = Some(index + 1);
            }
            Err(error) => self.fault = Some(error),
        }
    }

    /// Deletes the selected light, and selects the next one.
    pub(crate) fn delete(&mut self) {
        let Some(index) = self.selected.filter(|&index| index < self.rig.lights.len()) else { return };
        self.rig.lights.remove(index);
        self.keep_selection();
    }

    /// Moves a light to another place in the list, and the selection with it.
    pub(crate) fn reorder(&mut self, from: usize, to: usize) {
        let count = self.rig.lights.len();
        if from < count && to < count && from != to {
            let light = self.rig.lights.remove(from);
            self.rig.lights.insert(to, light);
            self.selected = Some(to);
        }
    }

    /// Where the light of that name is.
    pub(crate) fn place(&self, name: &str) -> Option<usize> {
        self.rig.lights.iter().position(|light| light.name == name)
    }

    /// Gives the light at `index` another name.
    ///
    /// # Errors
    /// Why not, where it is empty or another's.
    pub(crate) fn rename(&mut self, index: usize, name: &str) -> std::result::Result<(), String> {
        let name = name.trim();
        if name.is_empty() {
            return Err("a light needs a name".to_owned());
        }
        if self.rig.lights.iter().enumerate().any(|(other, light)| other != index && light.name == name) {
            return Err(format!("another light is called {name}"));
        }
        if let Some(light) = self.rig.lights.get_mut(index) {
            if self.solo.as_deref() == Some(&light.name) {
                self.solo = Some(name.to_owned());
            }
            name.clone_into(&mut light.name);
        }
        Ok(())
    }
}

/// A rig as it is to be shown: where a light shines alone, without the others and without what emits.
pub(crate) fn alone(
    mut rig: LightRig,
    solo: Option<&str>,
    emissive: impl Iterator<Item = String>,
) -> LightRig {
    if let Some(solo) = solo {
        rig.lights.iter_mut().for_each(|light| light.enabled &= light.name == solo);
        let dark = |material| relume::Emitter { material, scale: Vec3::ZERO };
        rig.emitters = emissive.map(dark).collect();
    }
    rig
}

/// A number with two digits that count: what a person would have typed.
fn two_digits(value: f32) -> f32 {
    let step = 10_f32.powi(value.max(f32::MIN_POSITIVE).log10().floor() as i32 - 1);
    (value / step).round() * step
}

fn centimetres(position: Vec3) -> Vec3 {
    (position * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGE: Stage = Stage { eye: Vec3::new(0.0, 1.6, 5.0), center: Vec3::new(0.0, 1.0, 0.0) };

    fn document() -> Document {
        let mut document = Document::new(&LightRig::default()).unwrap();
        document.add(NewLight::Omni, STAGE);
        document.add(NewLight::Spot, STAGE);
        document.note();
        document
    }

    fn names(document: &Document) -> Vec<&str> {
        document.rig.lights.iter().map(|light| light.name.as_str()).collect()
    }

    #[test]
    fn lights_are_added_copied_and_deleted() {
        let mut document = document();
        for kind in NewLight::ALL {
            document.add(kind, STAGE);
        }
        assert_eq!(names(&document), ["omni", "spot", "omni 2", "spot 2", "distant", "dome"]);
        assert_eq!(document.selected, Some(5));
        document.selected = Some(0);
        document.duplicate();
        assert_eq!(names(&document)[..3], ["omni", "omni 3", "spot"]);
        document.delete();
        assert_eq!((names(&document)[1], document.selected), ("spot", Some(1)));
        document.selected = Some(5);
        document.delete();
        assert_eq!(document.selected, Some(4), "the last one is gone");
    }

    #[test]
    fn every_new_light_can_be_saved() {
        let folder = tempfile::tempdir().unwrap();
        let mut document = document();
        for kind in NewLight::ALL {
            document.add(kind, STAGE);
        }
        let path = folder.path().join("all.toml");
        assert!(document.is_changed());
        document.save(&path).unwrap();
        assert!(!document.is_changed());
        assert_eq!(Document::open(&path).unwrap().rig, document.rig);
    }

    #[test]
    fn names_stay_unique() {
        let mut document = document();
        document.solo = Some("omni".to_owned());
        assert!(document.rename(0, "spot").is_err() && document.rename(0, "  ").is_err());
        document.rename(0, " key ").unwrap();
        assert_eq!((names(&document)[0], document.solo.as_deref()), ("key", Some("key")));
        document.rename(0, "key").unwrap();
    }

    #[test]
    fn one_light_shines_alone() {
        let mut document = document();
        document.solo = Some("spot".to_owned());
        let shown = alone(document.rig.clone(), Some("spot"), ["lamp".to_owned()].into_iter());
        assert_eq!(shown.lights.iter().map(|light| light.enabled).collect::<Vec<_>>(), [false, true]);
        assert_eq!(shown.emitters[0].scale, Vec3::ZERO);
        assert!(document.rig.lights.iter().all(|light| light.enabled), "the rig stays as it is");
        document.selected = Some(1);
        document.delete();
        assert_eq!(document.solo, None);
    }

    #[test]
    fn edits_are_undone_in_order() {
        let mut document = document();
        document.reorder(1, 0);
        document.note();
        assert_eq!(document.undoes(), Some("reorder lights"));
        document.rig.exposure = 1.0; // not noted yet
        document.undo();
        assert_eq!((document.rig.exposure, names(&document)[0]), (0.0, "spot"));
        document.undo();
        assert_eq!(names(&document), ["omni", "spot"]);
        document.redo();
        document.redo();
        assert_eq!((document.rig.exposure, names(&document)[0]), (1.0, "spot"));
        while document.undoes().is_some() {
            document.undo();
        }
        assert_eq!((names(&document).len(), document.selected), (0, None));
    }

    #[test]
    fn maps_are_named_from_where_the_rig_is_saved() {
        let folder = tempfile::tempdir().unwrap();
        let (old, new) = (folder.path().join("old"), folder.path().join("new"));
        std::fs::create_dir_all(&old).unwrap();
        std::fs::create_dir_all(&new).unwrap();
        let sky = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/rigs/arcade_sky.hdr");
        std::fs::copy(sky, old.join("sky.hdr")).unwrap();
        let text = "[[light]]\nname = \"sky\"\ntype = \"dome\"\nmap = \"sky.hdr\"\n";
        std::fs::write(old.join("rig.toml"), text).unwrap();
        let mut document = Document::open(&old.join("rig.toml")).unwrap();
        document.save(&old.join("copy.toml")).unwrap();
        assert!(std::fs::read_to_string(old.join("copy.toml")).unwrap().contains("\"sky.hdr\""));
        document.rig.exposure = 1.0;
        document.note();
        document.save(&new.join("moved.toml")).unwrap();
        document.undo();
        document.save(&new.join("undone.toml")).unwrap();
        assert!(Document::open(&new.join("undone.toml")).is_ok(), "what was undone has its map as well");
        assert!(Document::open(&new.join("moved.toml")).is_ok(), "the map is found from there");
        document.save(&old.join("back.toml")).unwrap();
        assert!(std::fs::read_to_string(old.join("back.toml")).unwrap().contains("\"sky.hdr\""));
    }
}
