use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use relume::glam::Vec3;
use relume::scene::{EnvironmentMap, NamedList};
use relume::{Emitter, Light, LightKind, LightRig, MaterialEdit};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::check::{Fault, edit_faults, emitter_faults, exposure_fault, light_faults, repeated_names};
use super::keys::{EMITTER, LightType, MAP, MATERIAL, NamedTable, near_miss, synonym};
use crate::read_environment;

/// What is wrong, and the byte it is wrong at.
pub(super) struct Problem {
    pub(super) offset: usize,
    pub(super) message: String,
}

/// Reads the whole rig and reports the problem that comes first in the text. Maps are looked for in `folder`.
pub(super) fn parse(text: &str, folder: &Path) -> Result<LightRig, Problem> {
    let document = DeTable::parse(text).map_err(|error| Problem {
        offset: error.span().map_or(0, |span| span.start),
        message: format!("not valid TOML: {}", error.message()),
    })?;
    let mut reader = Reader { problems: Vec::new(), folder, maps: HashMap::new() };
    let rig = reader.rig(document.get_ref());
    match reader.problems.into_iter().min_by_key(|problem| problem.offset) {
        Some(first) => Err(first),
        None => Ok(rig),
    }
}

/// The byte at which an entry of a list, counted from 0, names its material.
pub(super) fn name_offset(text: &str, list: NamedList, index: usize) -> Option<usize> {
    let NamedTable { table, name: (name, _), .. } = match list {
        NamedList::Emitters => EMITTER,
        NamedList::Materials => MATERIAL,
    };
    let document = DeTable::parse(text).ok()?;
    let (_, list) = document.get_ref().iter().find(|(key, _)| key.get_ref() == table)?;
    let item = list.get_ref().as_array()?.get(index)?;
    Some(Table { keys: item.get_ref().as_table()?, offset: item.span().start }.offset_of(name))
}

struct Reader<'a> {
    problems: Vec<Problem>,
    folder: &'a Path,
    /// Those that were read, by the names that the rig has for them.
    maps: HashMap<String, Arc<EnvironmentMap>>,
}

/// One table of a list, and where it begins.
struct Table<'t, 'i> {
    keys: &'t DeTable<'i>,
    offset: usize,
}

impl<'t, 'i> Table<'t, 'i> {
    fn find(&self, name: &str) -> Option<(usize, &'t Spanned<DeValue<'i>>)> {
        let mut keys = self.keys.iter();
        keys.find(|(key, _)| key.get_ref() == name).map(|(key, value)| (key.span().start, value))
    }

    /// Where `name` is written, or where the table begins.
    fn offset_of(&self, name: &str) -> usize {
        self.find(name).map_or(self.offset, |(offset, _)| offset)
    }
}

impl Reader<'_> {
    fn problem(&mut self, offset: usize, message: String) {
        self.problems.push(Problem { offset, message });
    }

    fn rig(&mut self, document: &DeTable<'_>) -> LightRig {
        let mut rig = LightRig::default();
        for (key, value) in document {
            let offset = key.span().start;
            match key.get_ref().as_ref() {
                "exposure" => rig.exposure = self.exposure(offset, value.get_ref()).unwrap_or_default(),
                "light" => rig.lights = self.lights(offset, value.get_ref()),
                "emitter" => rig.emitters = self.emitters(offset, value.get_ref()),
                "material" => rig.materials = self.materials(offset, value.get_ref()),
                unknown => {
                    let mend = match near_miss(unknown, ["exposure", "light", "emitter", "material"]) {
                        Some(near) => format!("did you mean `{near}`?"),
                        None => {
                            "a rig has `exposure`, [[light]], [[emitter]] and [[material]] tables".to_owned()
                        }
                    };
                    self.problem(offset, format!("unknown key `{unknown}`; {mend}"));
                }
            }
        }
        rig
    }

    fn exposure(&mut self, offset: usize, value: &DeValue<'_>) -> Option<f32> {
        let Some(exposure) = number(value) else {
            return self.wrong_type(offset, "exposure", "a number, such as 0.0 (stops)", value);
        };
        if let Some(fault) = exposure_fault(exposure) {
            self.problem(offset, fault);
        }
        Some(exposure)
    }

    /// The tables of a list, each begun with `[[name]]`.
    fn tables<'t, 'i>(&mut self, name: &str, offset: usize, value: &'t DeValue<'i>) -> Vec<Table<'t, 'i>> {
        let DeValue::Array(items) = value else {
            let written = described(value);
            self.problem(
                offset,
                format!(
                    "`{name}` must be a list of tables, not {written}; begin each {name} with [[{name}]]"
                ),
            );
            return Vec::new();
        };
        let mut tables = Vec::new();
        for item in items {
            let offset = item.span().start;
            if let DeValue::Table(keys) = item.get_ref() {
                tables.push(Table { keys, offset });
            } else {
                let written = described(item.get_ref());
                let article = if name == "emitter" { "an" } else { "a" };
                self.problem(
                    offset,
                    format!(
                        "{article} {name} must be a table, not {written}; begin each {name} with [[{name}]]"
                    ),
                );
            }
        }
        tables
    }

    fn lights(&mut self, offset: usize, value: &DeValue<'_>) -> Vec<Light> {
        let mut lights: Vec<(usize, Light)> = Vec::new();
        for table in self.tables("light", offset, value) {
            if let Some(light) = self.light(&table) {
                lights.push((table.offset_of("name"), light));
            }
        }
        for (second, _) in repeated_names(lights.iter().map(|(_, light)| light.name.as_str())) {
            let (offset, light) = &lights[second];
            let message =
                format!("an earlier light is named `{}` too; give each light a name of its own", light.name);
            self.problem(*offset, message);
        }
        lights.into_iter().map(|(_, light)| light).collect()
    }

    fn emitters(&mut self, offset: usize, value: &DeValue<'_>) -> Vec<Emitter> {
        let make = |material: String, scale: Vec3| Emitter { material, scale };
        let read = self.all_named(offset, value, &EMITTER, make, emitter_faults);
        for (second, _) in repeated_names(read.iter().map(|(_, emitter)| emitter.material.as_str())) {
            let (offset, emitter) = &read[second];
            let name = &emitter.material;
            let message = format!("an earlier emitter names the material `{name}` too; keep one of them");
            self.problem(*offset, message);
        }
        read.into_iter().map(|(_, emitter)| emitter).collect()
    }

    fn materials(&mut self, offset: usize, value: &DeValue<'_>) -> Vec<MaterialEdit> {
        let make = |name: String, base_color: Vec3| MaterialEdit { name, base_color };
        let read = self.all_named(offset, value, &MATERIAL, make, edit_faults);
        for (second, _) in repeated_names(read.iter().map(|(_, edit)| edit.name.as_str())) {
            let (offset, edit) = &read[second];
            let message = format!("an earlier [[material]] is named `{}` too; keep one of them", edit.name);
            self.problem(*offset, message);
        }
        read.into_iter().map(|(_, edit)| edit).collect()
    }

    /// The tables of a list that give colours to materials, made what they stand for by `make`, each with where it is named. Those with
    /// a problem, also one of `faults`, are left out, and it is noted.
    fn all_named<T>(
        &mut self,
        offset: usize,
        value: &DeValue<'_>,
        kind: &NamedTable,
        make: impl Fn(String, Vec3) -> T,
        faults: impl Fn(&T) -> Vec<Fault>,
    ) -> Vec<(usize, T)> {
        let mut read = Vec::new();
        for table in self.tables(kind.table, offset, value) {
            let before = self.problems.len();
            let Some((name, color)) = self.named(&table, kind) else { continue };
            let made = make(name, color);
            for (key, message) in faults(&made) {
                self.problem(table.offset_of(key), message);
            }
            if self.problems.len() == before {
                read.push((table.offset_of(kind.name.0), made));
            }
        }
        read
    }

    /// `None` where the table has a problem, which is noted.
    fn named(&mut self, table: &Table<'_, '_>, kind: &NamedTable) -> Option<(String, Vec3)> {
        let keys = [kind.name, kind.color];
        let known = || keys.into_iter().map(|(key, _)| key);
        for key in table.keys.keys().filter(|key| known().all(|name| name != key.get_ref())) {
            let written = key.get_ref();
            let mend = match near_miss(written, known()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => {
                    let all = known().collect::<Vec<_>>().join(", ");
                    format!("{} {} has {all}", kind.article, kind.table)
                }
            };
            self.problem(key.span().start, format!("unknown key `{written}`; {mend}"));
        }
        for (key, example) in keys {
            // a misspelt key is told as such, at its own line
            let misspelt =
                table.keys.keys().any(|written| near_miss(written.get_ref(), known()) == Some(key));
            if table.find(key).is_none() && !misspelt {
                let name = table.find(kind.name.0).and_then(|(_, value)| value.get_ref().as_str());
                let this =
                    name.map_or(format!("this {}", kind.table), |name| format!("{} `{name}`", kind.table));
                self.problem(table.offset, format!("{this} has no `{key}`; add {key} = {example}"));
            }
        }
        let (key, _) = kind.name;
        let name = table.find(key).and_then(|(offset, value)| match value.get_ref().as_str() {
            Some(name) => Some(name.to_owned()),
            None => self.wrong_type(offset, key, "text in quotes", value.get_ref()),
        });
        let (key, example) = kind.color;
        let color = table.find(key).and_then(|(offset, value)| {
            let wanted = format!("three numbers, such as {example}");
            three_numbers(value.get_ref()).or_else(|| self.wrong_type(offset, key, &wanted, value.get_ref()))
        });
        Some((name?, color?))
    }

    /// `None` where the light has a problem, which is noted.
    fn light(&mut self, table: &Table<'_, '_>) -> Option<Light> {
        let before = self.problems.len();
        let light_type = self.light_type(table)?;
        self.refuse_unknown_keys(table, light_type);
        let name = self.text(table, light_type, "name");
        let enabled = self.switch(table, "enabled");
        let kind = self.kind(table, light_type);
        let light = Light { name: name?, enabled: enabled?, kind: kind? };
        for (key, message) in light_faults(&light) {
            self.problem(table.offset_of(key), message);
        }
        (self.problems.len() == before).then_some(light)
    }

    fn kind(&mut self, table: &Table<'_, '_>, light_type: LightType) -> Option<LightKind> {
        let mut triple = |key| self.triple(table, light_type, key);
        // Every value is read before any is asked for, so that each problem is noted.
        match light_type {
            LightType::Omni => {
                let (position, intensity) = (triple("position"), triple("intensity"));
                let radius = self.number(table, light_type, "radius");
                Some(LightKind::Omni { position: position?, intensity: intensity?, radius: radius? })
            }
            LightType::Spot => {
                let (position, target) = (triple("position"), triple("target"));
                let intensity = triple("intensity");
                let inner_angle = self.number(table, light_type, "inner_angle");
                let outer_angle = self.number(table, light_type, "outer_angle");
                let radius = self.number(table, light_type, "radius");
                Some(LightKind::Spot {
                    position: position?,
                    target: target?,
                    intensity: intensity?,
                    inner_angle: inner_angle?,
                    outer_angle: outer_angle?,
                    radius: radius?,
                })
            }
            LightType::Distant => {
                let (direction, irradiance) = (triple("direction"), triple("irradiance"));
                let angle = self.number(table, light_type, "angle");
                Some(LightKind::Distant { direction: direction?, irradiance: irradiance?, angle: angle? })
            }
            LightType::Dome => {
                let intensity = triple("intensity");
                let rotation = self.number(table, light_type, "rotation");
                let map = match table.find(MAP) {
                    Some((offset, value)) => self.map(offset, value.get_ref()).map(Some),
                    None => Some(None),
                };
                Some(LightKind::Dome { map: map?, intensity: intensity?, rotation: rotation? })
            }
        }
    }

    /// The map of a dome; `None` where it cannot be read, which is noted.
    fn map(&mut self, offset: usize, value: &DeValue<'_>) -> Option<Arc<EnvironmentMap>> {
        let DeValue::String(name) = value else {
            return self.wrong_type(offset, MAP, "the name of an .hdr or .exr file in quotes", value);
        };
        if let Some(map) = self.maps.get(name.as_ref()) {
            return Some(Arc::clone(map));
        }
        match read_environment(self.folder.join(name.as_ref()), name) {
            Ok(map) => {
                let map = Arc::new(map);
                self.maps.insert(name.clone().into_owned(), Arc::clone(&map));
                Some(map)
            }
            Err(error) => {
                self.problem(offset, format!("`map`: {error}"));
                None
            }
        }
    }

    fn light_type(&mut self, table: &Table<'_, '_>) -> Option<LightType> {
        let Some((offset, value)) = table.find("type") else {
            let near = table.keys.keys().find(|key| near_miss(key.get_ref(), ["type"]).is_some());
            match near {
                Some(key) => {
                    let message = format!("unknown key `{}`; did you mean `type`?", key.get_ref());
                    self.problem(key.span().start, message);
                }
                None => {
                    let message = format!("this light has no `type`; add type = {}", LightType::CHOICE);
                    self.problem(table.offset, message);
                }
            }
            return None;
        };
        let DeValue::String(written) = value.get_ref() else {
            return self.wrong_type(offset, "type", LightType::CHOICE, value.get_ref());
        };
        let found = LightType::ALL.into_iter().find(|light_type| light_type.name() == written);
        if found.is_none() {
            let near = near_miss(written, LightType::ALL.map(LightType::name));
            let mend = match near.or_else(|| synonym(written).map(LightType::name)) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => format!("use {}", LightType::CHOICE),
            };
            self.problem(offset, format!("unknown type \"{written}\"; {mend}"));
        }
        found
    }

    fn refuse_unknown_keys(&mut self, table: &Table<'_, '_>, light_type: LightType) {
        let type_name = light_type.name();
        let known = || light_type.keys().iter().map(|key| key.name);
        for key in table.keys.keys().filter(|key| light_type.key(key.get_ref()).is_none()) {
            let written = key.get_ref().as_ref();
            let owner = LightType::ALL.into_iter().find(|other| other.key(written).is_some());
            let all = || known().collect::<Vec<_>>().join(", ");
            let message = match (owner, near_miss(written, known())) {
                (Some(owner), _) => {
                    let owner = owner.name();
                    format!(
                        "`{written}` is a key of {owner} lights; a light of type \"{type_name}\" has {}",
                        all()
                    )
                }
                (None, Some(near)) => format!("unknown key `{written}`; did you mean `{near}`?"),
                (None, None) => {
                    format!("unknown key `{written}`; a light of type \"{type_name}\" has {}", all())
                }
            };
            self.problem(key.span().start, message);
        }
    }

    fn text(&mut self, table: &Table<'_, '_>, light_type: LightType, key: &'static str) -> Option<String> {
        match table.find(key) {
            Some((_, value)) if value.get_ref().is_str() => value.get_ref().as_str().map(str::to_owned),
            Some((offset, value)) => self.wrong_type(offset, key, "text in quotes", value.get_ref()),
            None => self.missing(table, light_type, key),
        }
    }

    fn switch(&mut self, table: &Table<'_, '_>, key: &'static str) -> Option<bool> {
        match table.find(key) {
            Some((_, value)) if value.get_ref().is_bool() => value.get_ref().as_bool(),
            Some((offset, value)) => self.wrong_type(offset, key, "true or false", value.get_ref()),
            None => Some(true),
        }
    }

    fn number(&mut self, table: &Table<'_, '_>, light_type: LightType, key: &'static str) -> Option<f32> {
        match table.find(key) {
            Some((offset, value)) => number(value.get_ref()).or_else(|| {
                let example = light_type.key(key).map_or("1.0", |key| key.example);
                self.wrong_type(offset, key, &format!("a number, such as {example}"), value.get_ref())
            }),
            None => light_type
                .key(key)
                .and_then(|key| key.default)
                .or_else(|| self.missing(table, light_type, key)),
        }
    }

    fn triple(&mut self, table: &Table<'_, '_>, light_type: LightType, key: &'static str) -> Option<Vec3> {
        let Some((offset, value)) = table.find(key) else {
            let default = light_type.key(key).and_then(|key| key.default);
            return default.map(Vec3::splat).or_else(|| self.missing(table, light_type, key));
        };
        three_numbers(value.get_ref()).or_else(|| {
            let example = light_type.key(key).map_or("[1.0, 1.0, 1.0]", |key| key.example);
            self.wrong_type(offset, key, &format!("three numbers, such as {example}"), value.get_ref())
        })
    }

    /// Notes that `key` is of the wrong type; `None` for the caller to hand on.
    fn wrong_type<T>(&mut self, offset: usize, key: &str, wanted: &str, written: &DeValue<'_>) -> Option<T> {
        self.problem(offset, format!("`{key}` must be {wanted}, not {}", described(written)));
        None
    }

    fn missing<T>(&mut self, table: &Table<'_, '_>, light_type: LightType, key: &'static str) -> Option<T> {
        // A misspelt key is told as such, at its own line.
        let misspelt = table.keys.keys().any(|written| {
            light_type.key(written.get_ref()).is_none()
                && near_miss(written.get_ref(), light_type.keys().iter().map(|key| key.name)) == Some(key)
        });
        if !misspelt {
            let type_name = light_type.name();
            let light = match table.find("name").and_then(|(_, value)| value.get_ref().as_str()) {
                Some(name) => format!("{type_name} light `{name}`"),
                None => format!("{type_name} light"),
            };
            let example = light_type.key(key).map_or("", |key| key.example);
            self.problem(table.offset, format!("this {light} has no `{key}`; add {key} = {example}"));
        }
        None
    }
}

fn three_numbers(value: &DeValue<'_>) -> Option<Vec3> {
    let components: Option<Vec<f32>> =
        value.as_array().and_then(|array| array.iter().map(|item| number(item.get_ref())).collect());
    match components.as_deref() {
        Some(&[x, y, z]) => Some(Vec3::new(x, y, z)),
        _ => None,
    }
}

/// The f32 nearest to what is written, which TOML's f64 would round twice.
fn number(value: &DeValue<'_>) -> Option<f32> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        DeValue::Integer(integer) => {
            i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|integer| integer as f32)
        }
        _ => None,
    }
}

/// A value's type in an artist's words.
fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(_) => "text".to_owned(),
        DeValue::Integer(_) | DeValue::Float(_) => "one number".to_owned(),
        DeValue::Boolean(switch) => switch.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Table(_) => "one table".to_owned(),
        DeValue::Array(array) if array.iter().all(|item| number(item.get_ref()).is_some()) => {
            format!("a list of {}", array.len())
        }
        DeValue::Array(_) => "a list with something other than numbers".to_owned(),
    }
}
