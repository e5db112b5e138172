use std::collections::{BTreeMap, HashSet};

use super::curve::{Interpolation, key_before, value_at};
use crate::rig::keys::{EMITTER, LightType, MATERIAL, near_miss};
use crate::rig::parse::Reader;
use crate::rig::value::{Entry, Item, Table, Value};

/// Frames are whole numbers from minus this to this.
const LAST_FRAME: i32 = 1_000_000;
const KEYS: [&str; 7] = ["light", "emitter", "material", "field", "interpolation", "frames", "values"];
/// Lists whose tables may be animated, each with the key that names its tables.
const LISTS: [(&str, &str); 3] =
    [("light", "name"), (EMITTER.table, EMITTER.name.0), (MATERIAL.table, MATERIAL.name.0)];

/// The key by which tables of a list are named.
pub(super) fn name_key(list: &str) -> &'static str {
    LISTS.into_iter().find(|(known, _)| *known == list).map_or("name", |(_, key)| key)
}

/// A table of the rig that is animated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Place {
    /// The rig's own.
    Rig,
    /// The table at an index of a list.
    List(&'static str, usize),
}

impl Place {
    pub(super) fn table(self, document: &Table) -> Option<&Table> {
        match self {
            Self::Rig => Some(document),
            Self::List(list, index) => document.find(list)?.value.list()?.get(index)?.value.table(),
        }
    }

    pub(super) fn table_mut(self, document: &mut Table) -> Option<&mut Table> {
        let Self::List(list, index) = self else { return Some(document) };
        let entry = document.entries.iter_mut().find(|entry| entry.key == list)?;
        let Value::List(items) = &mut entry.value else { return None };
        match &mut items.get_mut(index)?.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }
}

/// One field over time.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) place: Place,
    pub(super) field: String,
    /// Where it says which field it is.
    pub(super) offset: usize,
    pub(super) interpolation: Interpolation,
    /// Ascending, at least one.
    pub(super) frames: Vec<i32>,
    /// One a frame, all of one shape.
    pub(super) values: Vec<Item>,
}

impl Track {
    /// The field as it is at `frame`, and where the key before is written.
    pub(super) fn entry(&self, frame: f64) -> Entry {
        let key = &self.values[key_before(&self.frames, frame)];
        let blended = |component: &dyn Fn(&Value) -> f32| {
            let keys = |key: usize| f64::from(component(&self.values[key].value));
            value_at(self.interpolation, &self.frames, &keys, frame) as f32
        };
        let value = match &key.value {
            Value::Number(_) => Value::Number(blended(&|value| value.number().unwrap_or(f32::NAN))),
            Value::List(items) => {
                let item = |(place, item): (usize, &Item)| {
                    let component = |value: &Value| value.list()?.get(place)?.value.number();
                    let number = blended(&|value| component(value).unwrap_or(f32::NAN));
                    Item { offset: item.offset, value: Value::Number(number) }
                };
                Value::List(items.iter().enumerate().map(item).collect())
            }
            other => other.clone(),
        };
        Entry { key: self.field.clone(), offset: key.offset, value }
    }

    /// Whether its values can be interpolated.
    pub(super) fn blends(&self) -> bool {
        self.values.first().and_then(|item| Shape::of(&item.value)).is_none_or(Shape::blends)
    }

    /// Whether the value at `offset` is that of a key at `frame`.
    pub(super) fn is_written(&self, frame: f64, offset: usize) -> bool {
        let key = key_before(&self.frames, frame);
        f64::from(self.frames[key]) == frame && self.values[key].offset == offset
    }
}

/// What all values of a track have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Number,
    Numbers(usize),
    Text,
    Switch,
}

impl Shape {
    fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Number(_) => Some(Self::Number),
            Value::List(_) => value.numbers().map(|numbers| Self::Numbers(numbers.len())),
            Value::Text(_) => Some(Self::Text),
            Value::Switch(_) => Some(Self::Switch),
            Value::Date | Value::Table(_) => None,
        }
    }

    fn blends(self) -> bool {
        matches!(self, Self::Number | Self::Numbers(_))
    }
}

impl Interpolation {
    /// How a field of such values goes from key to key where nothing else is said.
    pub(super) fn default_of(value: &Value) -> Self {
        if Shape::of(value).is_none_or(Shape::blends) { Self::Smooth } else { Self::Step }
    }
}

/// The tables of a list by their names.
struct Named<'t> {
    places: BTreeMap<&'t str, usize>,
    /// Whether all have a name; else the list has a problem of its own, which is told where that is read.
    all: bool,
}

/// Those of each of [`LISTS`].
fn named(document: &Table) -> [Named<'_>; LISTS.len()] {
    LISTS.map(|(list, name_key)| {
        let value = document.find(list).map(|entry| &entry.value);
        let items = value.and_then(Value::list).unwrap_or_default();
        let mut named =
            Named { places: BTreeMap::new(), all: value.is_none_or(|value| value.list().is_some()) };
        for (place, item) in items.iter().enumerate() {
            match item.value.table().and_then(|table| table.find(name_key)?.value.text()) {
                // of two of one name, which is refused, any will do
                Some(name) => drop(named.places.insert(name, place)),
                None => named.all = false,
            }
        }
        named
    })
}

/// The keys of a table that cannot be animated, and those that can; `None` where its type is unknown, which is told where that is written.
pub(super) fn fields_of(place: Place, table: &Table) -> Option<(&'static [&'static str], Vec<&'static str>)> {
    match place {
        Place::Rig => Some((&[], vec!["exposure"])),
        Place::List(list, _) if list == EMITTER.table => Some((&[EMITTER.name.0], vec![EMITTER.color.0])),
        Place::List(list, _) if list == MATERIAL.table => Some((&[MATERIAL.name.0], vec![MATERIAL.color.0])),
        Place::List(..) => {
            let written = table.find("type")?.value.text()?;
            let light_type = LightType::ALL.into_iter().find(|known| known.name() == written)?;
            let known = light_type.keys().iter().map(|key| key.name);
            Some((&["name", "type"], known.filter(|key| !["name", "type"].contains(key)).collect()))
        }
    }
}

impl Reader<'_> {
    /// The tracks of the rig, where all are right; problems are noted, but for those of the lists of `document` themselves.
    pub(super) fn tracks(&mut self, animate: &Entry, document: &Table) -> Vec<Track> {
        let named = named(document);
        let mut tracks: Vec<Track> = Vec::new();
        let mut animated = HashSet::new();
        for table in self.tables("animate", animate.offset, &animate.value) {
            let Some(track) = self.track(table, document, &named) else { continue };
            if !animated.insert((track.place, track.field.clone())) {
                let message =
                    format!("an earlier [[animate]] has this `{}` too; keep one of them", track.field);
                self.problem(track.offset, message);
            }
            tracks.push(track);
        }
        tracks
    }

    /// `None` where the table has a problem, which is noted.
    fn track(&mut self, table: &Table, document: &Table, named: &[Named<'_>]) -> Option<Track> {
        if self.refuse_unknown_keys_of_track(table) {
            return None;
        }
        let place = self.place(table, named);
        let field = self.field(table, place.and_then(|place| Some((place, place.table(document)?))));
        let frames = self.frames(table);
        let values = self.values(table);
        let interpolation = values.and_then(|values| self.interpolation(table, values));
        let (place, (field, offset), frames, values) = (place?, field?, frames?, values?);
        if frames.len() != values.len() {
            let message = format!(
                "`frames` has {} and `values` {}; give one value for each frame",
                frames.len(),
                values.len()
            );
            self.problem(table.offset_of("values"), message);
            return None;
        }
        Some(Track { place, field, offset, interpolation: interpolation?, frames, values: values.to_vec() })
    }

    /// Whether there were any.
    fn refuse_unknown_keys_of_track(&mut self, table: &Table) -> bool {
        let before = self.problems.len();
        for entry in table.entries.iter().filter(|entry| !KEYS.contains(&entry.key.as_str())) {
            let mend = match near_miss(&entry.key, KEYS) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "an animate has light, emitter or material, field, interpolation, frames, values"
                    .to_owned(),
            };
            self.problem(entry.offset, format!("unknown key `{}`; {mend}", entry.key));
        }
        self.problems.len() > before
    }

    /// The table that is animated. `None` where it is not there, which is noted, or where its list has a problem of its own.
    fn place(&mut self, table: &Table, named: &[Named<'_>]) -> Option<Place> {
        let mut lists =
            LISTS.into_iter().zip(named).filter_map(|(list, named)| Some((list, named, table.find(list.0)?)));
        let Some(((list, name_key), named, entry)) = lists.next() else { return Some(Place::Rig) };
        if let Some(((second, _), _, other)) = lists.next() {
            let message =
                format!("an animate has `{list}` or `{second}`, not both; write another [[animate]]");
            self.problem(entry.offset.max(other.offset), message);
            return None;
        }
        let Some(name) = entry.value.text() else {
            return self.wrong_type(entry.offset, list, "a name in quotes", &entry.value);
        };
        let found = named.places.get(name);
        if found.is_none() && named.all {
            let names = || named.places.keys().copied();
            let mend = match near_miss(name, names()) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None if named.places.is_empty() => format!("add one, begun with [[{list}]]"),
                None => format!("there is \"{}\"", names().collect::<Vec<_>>().join("\", \"")),
            };
            self.problem(entry.offset, format!("no [[{list}]] has {name_key} = \"{name}\"; {mend}"));
        }
        found.map(|index| Place::List(list, *index))
    }

    /// The field of the table at `place`, and where it is named.
    fn field(&mut self, table: &Table, place: Option<(Place, &Table)>) -> Option<(String, usize)> {
        let Entry { offset, value, .. } = self.asked_for(table, "field", "\"intensity\"")?;
        let Some(field) = value.text() else {
            return self.wrong_type(*offset, "field", "the name of a field in quotes", value);
        };
        let (place, animated) = place?;
        let (fixed, known) = fields_of(place, animated)?;
        if known.contains(&field) {
            return Some((field.to_owned(), *offset));
        }
        let may_be = match place {
            Place::Rig => {
                "the rig itself has exposure; for a field of a light add light = \"key\"".to_owned()
            }
            Place::List(list, _) => format!("this {list} has {}", known.join(", ")),
        };
        let message = match near_miss(field, known) {
            _ if fixed.contains(&field) => format!("`{field}` cannot be animated; {may_be}"),
            Some(near) => format!("unknown field \"{field}\"; did you mean \"{near}\"?"),
            None => format!("unknown field \"{field}\"; {may_be}"),
        };
        self.problem(*offset, message);
        None
    }

    fn frames(&mut self, table: &Table) -> Option<Vec<i32>> {
        const WANTED: &str = "a list of whole numbers, such as [1, 24, 48]";
        let entry = self.asked_for(table, "frames", "[1, 24, 48]")?;
        let Some(numbers) = entry.value.numbers() else {
            return self.wrong_type(entry.offset, "frames", WANTED, &entry.value);
        };
        if numbers.is_empty() {
            self.problem(entry.offset, format!("`frames` is empty; write {WANTED}"));
            return None;
        }
        let offsets: Vec<usize> =
            entry.value.list().unwrap_or_default().iter().map(|item| item.offset).collect();
        let limit = LAST_FRAME as f32;
        let odd = |number: &f32| !(number.fract() == 0.0 && (-limit..=limit).contains(number));
        if let Some(place) = numbers.iter().position(odd) {
            let message = format!(
                "`frames` must be whole numbers from -{LAST_FRAME} to {LAST_FRAME}, but has {}",
                numbers[place]
            );
            self.problem(offsets[place], message);
            return None;
        }
        if let Some(place) = numbers.windows(2).position(|pair| pair[1] <= pair[0]) {
            let message =
                format!("`frames` must ascend, but {} comes after {}", numbers[place + 1], numbers[place]);
            self.problem(offsets[place + 1], message);
            return None;
        }
        Some(numbers.into_iter().map(|number| number as i32).collect())
    }

    fn values<'t>(&mut self, table: &'t Table) -> Option<&'t [Item]> {
        let entry = self.asked_for(table, "values", "[0.0, 1.0, 0.5], one for each frame")?;
        let Some(items) = entry.value.list() else {
            return self.wrong_type(
                entry.offset,
                "values",
                "a list with one value for each frame",
                &entry.value,
            );
        };
        for item in items {
            let (first, value) = (&items[0].value, &item.value);
            let message = match Shape::of(value) {
                None => format!(
                    "a value must be a number, a list of numbers, text, true or false, not {}",
                    value.described()
                ),
                same if same == Shape::of(first) => continue,
                Some(_) => {
                    format!(
                        "values must be alike, but {} comes after {}",
                        value.described(),
                        first.described()
                    )
                }
            };
            self.problem(item.offset, message);
            return None;
        }
        Some(items)
    }

    fn interpolation(&mut self, table: &Table, values: &[Item]) -> Option<Interpolation> {
        let blends = values.first().and_then(|item| Shape::of(&item.value)).is_none_or(Shape::blends);
        let Some(entry) = table.find("interpolation") else {
            return Some(
                values.first().map_or(Interpolation::Smooth, |item| Interpolation::default_of(&item.value)),
            );
        };
        let choice = "\"smooth\", \"linear\" or \"step\"";
        let Some(written) = entry.value.text() else {
            return self.wrong_type(entry.offset, "interpolation", choice, &entry.value);
        };
        let message = match Interpolation::ALL.into_iter().find(|known| known.name() == written) {
            Some(found) if blends || found == Interpolation::Step => return Some(found),
            Some(_) => "text, true and false can only step; write interpolation = \"step\" or leave it out"
                .to_owned(),
            None => match near_miss(written, Interpolation::ALL.map(Interpolation::name)) {
                Some(near) => format!("unknown interpolation \"{written}\"; did you mean \"{near}\"?"),
                None => format!("unknown interpolation \"{written}\"; use {choice}"),
            },
        };
        self.problem(entry.offset, message);
        None
    }

    /// The entry of a key that may not be left out; a problem where it is.
    fn asked_for<'t>(&mut self, table: &'t Table, key: &str, example: &str) -> Option<&'t Entry> {
        let entry = table.find(key);
        if entry.is_none() {
            self.problem(table.offset, format!("this animate has no `{key}`; add {key} = {example}"));
        }
        entry
    }
}
