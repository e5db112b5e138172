//! Edits of rigs that move: a field with a curve gets keys, any other one changes at all frames.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use relume::{Error, Light, LightKind, LightRig, Result, atomic_write};

use super::AnimatedRig;
use super::curve::Interpolation;
use super::track::{Place, Track, fields_of, name_key};
use crate::rig::keys::{EMITTER, LightType, MAP, MATERIAL};
use crate::rig::parse::Maps;
use crate::rig::toml_text::{line, number, rig_to_toml};
use crate::rig::value::{Item, Table, Value, read};

/// What a field belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The rig itself: its exposure.
    Rig,
    /// The light of that name.
    Light(String),
    /// What the material of that name emits.
    Emitter(String),
    /// The base colour of the material of that name.
    Material(String),
}

/// A field of a rig, which may change from frame to frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Whose it is.
    pub of: Subject,
    /// Its key in the file, such as `intensity`.
    pub key: String,
}

/// How a field changes from frame to frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Curve<'a> {
    /// What changes.
    pub field: Field,
    /// What lies between two keys.
    pub interpolation: Interpolation,
    /// Whether it can be interpolated: numbers can, text, true and false only step.
    pub blends: bool,
    /// The keyed frames, ascending, at least one.
    pub frames: &'a [i32],
}

impl AnimatedRig {
    /// A rig in which nothing moves, as that of the file at `path`.
    ///
    /// # Errors
    /// [`Error::Setting`] for a rig that no file could have.
    pub fn still(rig: &LightRig, path: impl AsRef<Path>) -> Result<Self> {
        written(rig, &[], &Maps::new(), path.as_ref())
    }

    /// All fields that change.
    pub fn curves(&self) -> impl Iterator<Item = Curve<'_>> {
        self.tracks.iter().filter_map(|track| {
            let field = Field { of: self.subject(track.place)?, key: track.field.clone() };
            Some(Curve {
                field,
                interpolation: track.interpolation,
                blends: track.blends(),
                frames: &track.frames,
            })
        })
    }

    /// The fields of `subjects` that rest, and could move: those that they have at `frame`.
    pub fn resting(&self, subjects: &[Subject], frame: i32) -> Vec<Field> {
        let document = self.rig(frame.into()).ok().and_then(|rig| table(&rig));
        let fields = |of: &Subject| {
            let document = document.as_ref()?;
            let place = place(document, of)?;
            let table = place.table(document)?;
            let (_, known) = fields_of(place, table)?;
            let there = known.into_iter().filter(|key| table.find(key).is_some());
            Some(there.map(|key| Field { of: of.clone(), key: key.to_owned() }).collect::<Vec<_>>())
        };
        let all = subjects.iter().filter_map(fields).flatten();
        all.filter(|field| !self.tracks.iter().any(|track| self.is(track, field))).collect()
    }

    /// The same rig after an edit that makes it `rig` at `frame`: where a field has a curve, it gets a key there; everything else is so at all
    /// frames. Lights keep their curves when they are renamed, one at a time, or reordered.
    ///
    /// # Errors
    /// [`Error::Setting`] where this cannot be at some keyed frame, such as an outer angle below an inner one.
    pub fn edited(&self, frame: i32, rig: &LightRig) -> Result<Self> {
        let before = self.rig(frame.into())?;
        let (Some(old), Some(new)) = (table(&before), table(rig)) else { return Ok(self.clone()) };
        let follow = |track: &Track| {
            let subject = self.subject(track.place)?;
            let place_now = place(&new, &follow(&subject, &before, rig)?)?;
            let then = value_of(&old, place(&old, &subject)?, &track.field);
            // a map that was taken away has no values any more
            let now = value_of(&new, place_now, &track.field)?;
            let mut track = Track { place: place_now, ..track.clone() };
            if then != Some(now) {
                track.set(frame, now.clone());
            }
            Some(track)
        };
        let tracks: Vec<Track> = self.tracks.iter().filter_map(follow).collect();
        written(rig, &tracks, &self.maps, &self.path)
    }

    /// With a key of `field` at `frame`, of the value that it has there; a field that rests begins to move with it.
    ///
    /// # Errors
    /// [`Error::Setting`] for a field that the rig has not at that frame.
    pub fn keyed(&self, field: &Field, frame: i32) -> Result<Self> {
        let rig = self.rig(frame.into())?;
        let found = table(&rig).and_then(|document| {
            let place = place(&document, &field.of)?;
            let (_, known) = fields_of(place, place.table(&document)?)?;
            let value = value_of(&document, place, &field.key)?.clone();
            known.contains(&&*field.key).then_some((place, value))
        });
        let (place, value) =
            found.ok_or_else(|| Error::Setting(format!("the rig has no such field as `{}`", field.key)))?;
        let mut tracks = self.tracks.clone();
        match tracks.iter_mut().find(|track| track.is_of(place, &field.key)) {
            Some(track) => track.set(frame, value),
            None => tracks.push(Track::new(place, &field.key, frame, value)),
        }
        written(&rig, &tracks, &self.maps, &self.path)
    }

    /// Without the key of `field` at `frame`; where it is the last one, the field rests at its value.
    ///
    /// # Errors
    /// [`Error::Setting`] where the fields that are left cannot be together at some keyed frame.
    pub fn unkeyed(&self, field: &Field, frame: i32) -> Result<Self> {
        let mut tracks = self.tracks.clone();
        tracks.iter_mut().filter(|track| self.is(track, field)).for_each(|track| track.unset(frame));
        tracks.retain(|track| !track.frames.is_empty());
        written(&self.rig(frame.into())?, &tracks, &self.maps, &self.path)
    }

    /// With `field` at rest, at the value that it has at `frame`.
    ///
    /// # Errors
    /// [`Error::Setting`] where that cannot be at some keyed frame of another field.
    pub fn held(&self, field: &Field, frame: i32) -> Result<Self> {
        let mut tracks = self.tracks.clone();
        tracks.retain(|track| !self.is(track, field));
        written(&self.rig(frame.into())?, &tracks, &self.maps, &self.path)
    }

    /// With another way from key to key of `field`.
    ///
    /// # Errors
    /// [`Error::Setting`] for text, true and false, which can only step.
    pub fn interpolated(&self, field: &Field, interpolation: Interpolation) -> Result<Self> {
        let mut tracks = self.tracks.clone();
        let of = tracks.iter_mut().filter(|track| self.is(track, field));
        of.for_each(|track| track.interpolation = interpolation);
        written(&self.rig(self.first_frame().into())?, &tracks, &self.maps, &self.path)
    }

    /// With a copy of the light `name` behind it, called `copy`, which moves as it does.
    ///
    /// # Errors
    /// [`Error::Setting`] where there is no such light, or another one has that name.
    pub fn duplicated(&self, name: &str, copy: &str) -> Result<Self> {
        let mut rig = self.rig(self.first_frame().into())?;
        let Some(index) = rig.lights.iter().position(|light| light.name == name) else {
            return Err(Error::Setting(format!("the rig has no light `{name}`")));
        };
        rig.lights.insert(index + 1, Light { name: copy.to_owned(), ..rig.lights[index].clone() });
        let mut tracks = Vec::new();
        for track in &self.tracks {
            let Place::List(list @ "light", at) = track.place else {
                tracks.push(track.clone());
                continue;
            };
            let moved = Place::List(list, at + usize::from(at > index));
            tracks.push(Track { place: moved, ..track.clone() });
            if at == index {
                tracks.push(Track { place: Place::List(list, index + 1), ..track.clone() });
            }
        }
        written(&rig, &tracks, &self.maps, &self.path)
    }

    /// As the rig of the file at `path`: maps of domes are named from its folder.
    ///
    /// # Errors
    /// As [`Self::still`].
    pub fn moved_to(&self, path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let name = |name: &str| name_from(name, &self.path, path);
        if self.maps.keys().all(|map| name(map) == *map) {
            return Ok(Self { path: path.to_owned(), ..self.clone() });
        }
        let mut rig = self.rig(self.first_frame().into())?;
        for light in &mut rig.lights {
            if let LightKind::Dome { map: Some(map), .. } = &mut light.kind
                && name(map.name()) != map.name()
            {
                *map = Arc::new(map.renamed(name(map.name())));
            }
        }
        let mut tracks = self.tracks.clone();
        let mut maps = self.maps.clone();
        for item in tracks.iter_mut().filter(|track| track.field == MAP).flat_map(|track| &mut track.values) {
            let Value::Text(text) = &mut item.value else { continue };
            let new = name(text);
            if let Some(map) = maps.get(text).filter(|_| new != *text) {
                let map = Arc::new(map.renamed(new.clone()));
                maps.insert(new.clone(), map);
            }
            *text = new;
        }
        written(&rig, &tracks, &maps, path)
    }

    /// Writes it to its file, which appears whole or not at all. Comments that were read are not in it.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Io`] as [`atomic_write`].
    pub fn save(&self) -> Result<()> {
        let path = &self.path;
        let write = |file: &mut dyn Write| {
            file.write_all(self.to_toml().as_bytes()).map_err(|error| Error::io(path, "write", error))
        };
        atomic_write(path, |file| write(file))
    }

    /// The text of its file, without comments that were read.
    pub fn to_toml(&self) -> &str {
        &self.canonical
    }

    fn is(&self, track: &Track, field: &Field) -> bool {
        track.field == field.key && self.subject(track.place).is_some_and(|subject| subject == field.of)
    }

    fn subject(&self, place: Place) -> Option<Subject> {
        let Place::List(list, _) = place else { return Some(Subject::Rig) };
        let name = place.table(&self.document)?.find(name_key(list))?.value.text()?.to_owned();
        Some(if list == EMITTER.table {
            Subject::Emitter(name)
        } else if list == MATERIAL.table {
            Subject::Material(name)
        } else {
            Subject::Light(name)
        })
    }
}

/// Rigs that are the same at every frame, whatever else their files say and wherever they lie.
impl PartialEq for AnimatedRig {
    fn eq(&self, other: &Self) -> bool {
        self.canonical == other.canonical && self.maps == other.maps
    }
}

impl Track {
    /// A field with one key.
    fn new(place: Place, field: &str, frame: i32, value: Value) -> Self {
        let interpolation = Interpolation::default_of(&value);
        let values = vec![Item { offset: 0, value }];
        Self { place, field: field.to_owned(), offset: 0, interpolation, frames: vec![frame], values }
    }

    fn is_of(&self, place: Place, field: &str) -> bool {
        self.place == place && self.field == field
    }

    /// Puts a key, in place of one that is there.
    fn set(&mut self, frame: i32, value: Value) {
        let item = Item { offset: 0, value };
        match self.frames.binary_search(&frame) {
            Ok(key) => self.values[key] = item,
            Err(key) => {
                self.frames.insert(key, frame);
                self.values.insert(key, item);
            }
        }
    }

    /// Takes a key away, if it is there.
    fn unset(&mut self, frame: i32) {
        if let Ok(key) = self.frames.binary_search(&frame) {
            self.frames.remove(key);
            self.values.remove(key);
        }
    }
}

/// The rig as its file would have it, every field written.
fn table(rig: &LightRig) -> Option<Table> {
    read(&rig_to_toml(rig)).ok()
}

fn value_of<'t>(document: &'t Table, place: Place, field: &str) -> Option<&'t Value> {
    place.table(document)?.find(field).map(|entry| &entry.value)
}

/// Where `subject` is.
fn place(document: &Table, subject: &Subject) -> Option<Place> {
    let (list, name) = match subject {
        Subject::Rig => return Some(Place::Rig),
        Subject::Light(name) => ("light", name),
        Subject::Emitter(name) => (EMITTER.table, name),
        Subject::Material(name) => (MATERIAL.table, name),
    };
    let key = name_key(list);
    let is_named = |item: &Item| {
        item.value.table().and_then(|table| table.find(key)?.value.text()).is_some_and(|text| text == name)
    };
    Some(Place::List(list, document.find(list)?.value.list()?.iter().position(is_named)?))
}

/// What has become of `subject`; `None` where it is gone.
fn follow(subject: &Subject, before: &LightRig, after: &LightRig) -> Option<Subject> {
    let Subject::Light(name) = subject else { return Some(subject.clone()) };
    let named = |rig: &LightRig, name: &str| rig.lights.iter().any(|light| light.name == name);
    let index = before.lights.iter().position(|light| light.name == *name)?;
    let same_type = |light: &&Light| LightType::of(&light.kind) == LightType::of(&before.lights[index].kind);
    let light = match after.lights.iter().find(|light| light.name == *name) {
        Some(light) => light,
        None if before.lights.len() == after.lights.len() => {
            after.lights.get(index).filter(|light| !named(before, &light.name))?
        }
        None => return None,
    };
    Some(light).filter(same_type).map(|light| Subject::Light(light.name.clone()))
}

/// A rig that is `rig` wherever `tracks` are not, with the maps of both.
///
/// # Errors
/// [`Error::Setting`] where it cannot be.
fn written(rig: &LightRig, tracks: &[Track], known: &Maps, path: &Path) -> Result<AnimatedRig> {
    let maps = used(rig, tracks, known);
    let text = text_of(rig, tracks);
    let mut written = AnimatedRig { maps, ..AnimatedRig::unread(text, path) };
    match written.read() {
        Ok(_) => Ok(written),
        // of lines that nobody has seen
        Err(problem) => Err(Error::Setting(problem.message)),
    }
}

/// The maps that are shown at some frame.
pub(super) fn used(rig: &LightRig, tracks: &[Track], known: &Maps) -> Maps {
    let mut maps = Maps::new();
    for light in &rig.lights {
        if let LightKind::Dome { map: Some(map), .. } = &light.kind {
            maps.insert(map.name().to_owned(), Arc::clone(map));
        }
    }
    for item in tracks.iter().filter(|track| track.field == MAP).flat_map(|track| &track.values) {
        if let Some((name, map)) = item.value.text().and_then(|name| known.get_key_value(name)) {
            maps.entry(name.clone()).or_insert_with(|| Arc::clone(map));
        }
    }
    maps
}

/// The text of a file.
pub(super) fn text_of(rig: &LightRig, tracks: &[Track]) -> String {
    let mut text = rig_to_toml(rig);
    let document = table(rig).unwrap_or_default();
    for track in tracks {
        text.push_str("\n[[animate]]\n");
        if let Place::List(list, _) = track.place {
            let name = track.place.table(&document).and_then(|table| table.find(name_key(list)));
            line(&mut text, list, &name.map(|name| value_text(&name.value)).unwrap_or_default());
        }
        line(&mut text, "field", &format!("\"{}\"", track.field));
        line(&mut text, "interpolation", &format!("\"{}\"", track.interpolation.name()));
        line(&mut text, "frames", &list(track.frames.iter().map(i32::to_string)));
        line(&mut text, "values", &list(track.values.iter().map(|item| value_text(&item.value))));
    }
    text
}

fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

fn value_text(value: &Value) -> String {
    match value {
        Value::Text(text) => toml::Value::from(text.as_str()).to_string(),
        Value::Number(value) => number(*value),
        Value::Switch(switch) => switch.to_string(),
        Value::List(items) => list(items.iter().map(|item| value_text(&item.value))),
        // what no field is
        Value::Date | Value::Table(_) => String::new(),
    }
}

/// A map that is named from the folder of one file, from that of another: as short as it can be.
fn name_from(name: &str, from: &Path, to: &Path) -> String {
    let folder = |path: &Path| {
        let parent = path.parent().unwrap_or(Path::new(""));
        std::path::absolute(parent).unwrap_or_else(|_| parent.to_owned())
    };
    let file = folder(from).join(name);
    file.strip_prefix(folder(to)).unwrap_or(&file).to_string_lossy().into_owned()
}
