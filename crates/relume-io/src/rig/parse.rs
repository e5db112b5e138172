use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use relume::glam::Vec3;
use relume::scene::{EnvironmentMap, NamedList};
use relume::{Emitter, Light, LightKind, LightRig, MaterialEdit};

use super::check::{Fault, edit_faults, emitter_faults, exposure_fault, light_faults, repeated_names};
use super::keys::{EMITTER, LightType, MAP, MATERIAL, NamedTable, near_miss, synonym};
use super::value::{Entry, Problem, Table, Value, read};
use crate::read_environment;

/// The byte at which an entry of a list, counted from 0, names its material.
pub(super) fn name_offset(text: &str, list: NamedList, index: usize) -> Option<usize> {
    let NamedTable { table, name: (name, _), .. } = match list {
        NamedList::Emitters => EMITTER,
        NamedList::Materials => MATERIAL,
    };
    let document = read(text).ok()?;
    let item = document.find(table)?.value.list()?.get(index)?;
    Some(item.value.table()?.offset_of(name))
}

/// Maps that were read, by the names that the rig has for them.
pub(super) type Maps = HashMap<String, Arc<EnvironmentMap>>;

/// Reads a rig and notes every problem in it.
pub(super) struct Reader<'a> {
    pub(super) problems: Vec<Problem>,
    /// That maps are looked for in.
    folder: &'a Path,
    pub(super) maps: Maps,
}

impl<'a> Reader<'a> {
    /// A reader that looks for maps in `folder`, but for those in `maps`.
    pub(super) fn new(folder: &'a Path, maps: Maps) -> Self {
        Self { problems: Vec::new(), folder, maps }
    }

    pub(super) fn problem(&mut self, offset: usize, message: String) {
        self.problems.push(Problem { offset, message });
    }

    pub(super) fn rig(&mut self, document: &Table) -> LightRig {
        let mut rig = LightRig::default();
        for Entry { key, offset, value } in &document.entries {
            let offset = *offset;
            match key.as_str() {
                "exposure" => rig.exposure = self.exposure(offset, value).unwrap_or_default(),
                "light" => rig.lights = self.lights(offset, value),
                "emitter" => rig.emitters = self.emitters(offset, value),
                "material" => rig.materials = self.materials(offset, value),
                unknown => {
                    let mend = match near_miss(unknown, ["exposure", "light", "emitter", "material", "animate"]) {
                        Some(near) => format!("did you mean `{near}`?"),
                        None => {
                            "a rig has `exposure`, [[light]], [[emitter]], [[material]] and [[animate]] tables"
                                .to_owned()
                        }
                    };
                    self.problem(offset, format!("unknown key `{unknown}`; {mend}"));
                }
            }
        }
        rig
    }

    fn exposure(&mut self, offset: usize, value: &Value) -> Option<f32> {
        let Some(exposure) = value.number() else {
            return self.wrong_type(offset, "exposure", "a number, such as 0.0 (stops)", value);
        };
        if let Some(fault) = exposure_fault(exposure) {
            self.problem(offset, fault);
        }
        Some(exposure)
    }

    /// The tables of a list, each begun with `[[name]]`.
    pub(super) fn tables<'t>(&mut self, name: &str, offset: usize, value: &'t Value) -> Vec<&'t Table> {
        let Value::List(items) = value else {
            let written = value.described();
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
            if let Value::Table(table) = &item.value {
                tables.push(table);
            } else {
                let written = item.value.described();
                let article = if ["emitter", "animate"].contains(&name) { "an" } else { "a" };
                self.problem(
                    item.offset,
                    format!(
                        "{article} {name} must be a table, not {written}; begin each {name} with [[{name}]]"
                    ),
                );
            }
        }
        tables
    }

    fn lights(&mut self, offset: usize, value: &Value) -> Vec<Light> {
        let mut lights: Vec<(usize, Light)> = Vec::new();
        for table in self.tables("light", offset, value) {
            if let Some(light) = self.light(table) {
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

    fn emitters(&mut self, offset: usize, value: &Value) -> Vec<Emitter> {
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

    fn materials(&mut self, offset: usize, value: &Value) -> Vec<MaterialEdit> {
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
        value: &Value,
        kind: &NamedTable,
        make: impl Fn(String, Vec3) -> T,
        faults: impl Fn(&T) -> Vec<Fault>,
    ) -> Vec<(usize, T)> {
        let mut read = Vec::new();
        for table in self.tables(kind.table, offset, value) {
            let before = self.problems.len();
            let Some((name, color)) = self.named(table, kind) else { continue };
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
    fn named(&mut self, table: &Table, kind: &NamedTable) -> Option<(String, Vec3)> {
        let keys = [kind.name, kind.color];
        let known = || keys.into_iter().map(|(key, _)| key);
        for Entry { key: written, offset, .. } in
            table.entries.iter().filter(|entry| known().all(|name| name != entry.key))
        {
            let mend = match near_miss(written, known()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => {
                    let all = known().collect::<Vec<_>>().join(", ");
                    format!("{} {} has {all}", kind.article, kind.table)
                }
            };
            self.problem(*offset, format!("unknown key `{written}`; {mend}"));
        }
        for (key, example) in keys {
            // a misspelt key is told as such, at its own line
            let misspelt = table.keys().any(|written| near_miss(written, known()) == Some(key));
            if table.find(key).is_none() && !misspelt {
                let name = table.find(kind.name.0).and_then(|entry| entry.value.text());
                let this =
                    name.map_or(format!("this {}", kind.table), |name| format!("{} `{name}`", kind.table));
                self.problem(table.offset, format!("{this} has no `{key}`; add {key} = {example}"));
            }
        }
        let (key, _) = kind.name;
        let name = table.find(key).and_then(|Entry { offset, value, .. }| match value {
            Value::Text(name) => Some(name.clone()),
            _ => self.wrong_type(*offset, key, "text in quotes", value),
        });
        let (key, example) = kind.color;
        let color = table.find(key).and_then(|Entry { offset, value, .. }| {
            let wanted = format!("three numbers, such as {example}");
            value.three_numbers().or_else(|| self.wrong_type(*offset, key, &wanted, value))
        });
        Some((name?, color?))
    }

    /// `None` where the light has a problem, which is noted.
    fn light(&mut self, table: &Table) -> Option<Light> {
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

    fn kind(&mut self, table: &Table, light_type: LightType) -> Option<LightKind> {
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
                    Some(entry) => self.map(entry).map(Some),
                    None => Some(None),
                };
                Some(LightKind::Dome { map: map?, intensity: intensity?, rotation: rotation? })
            }
        }
    }

    /// The map of a dome; `None` where it cannot be read, which is noted.
    fn map(&mut self, Entry { offset, value, .. }: &Entry) -> Option<Arc<EnvironmentMap>> {
        let Value::Text(name) = value else {
            return self.wrong_type(*offset, MAP, "the name of an .hdr or .exr file in quotes", value);
        };
        if let Some(map) = self.maps.get(name) {
            return Some(Arc::clone(map));
        }
        match read_environment(self.folder.join(name), name) {
            Ok(map) => {
                let map = Arc::new(map);
                self.maps.insert(name.clone(), Arc::clone(&map));
                Some(map)
            }
            Err(error) => {
                self.problem(*offset, format!("`map`: {error}"));
                None
            }
        }
    }

    fn light_type(&mut self, table: &Table) -> Option<LightType> {
        let Some(Entry { offset, value, .. }) = table.find("type") else {
            let near = table.entries.iter().find(|entry| near_miss(&entry.key, ["type"]).is_some());
            match near {
                Some(entry) => {
                    let message = format!("unknown key `{}`; did you mean `type`?", entry.key);
                    self.problem(entry.offset, message);
                }
                None => {
                    let message = format!("this light has no `type`; add type = {}", LightType::CHOICE);
                    self.problem(table.offset, message);
                }
            }
            return None;
        };
        let Value::Text(written) = value else {
            return self.wrong_type(*offset, "type", LightType::CHOICE, value);
        };
        let found = LightType::ALL.into_iter().find(|light_type| light_type.name() == written);
        if found.is_none() {
            let near = near_miss(written, LightType::ALL.map(LightType::name));
            let mend = match near.or_else(|| synonym(written).map(LightType::name)) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => format!("use {}", LightType::CHOICE),
            };
            self.problem(*offset, format!("unknown type \"{written}\"; {mend}"));
        }
        found
    }

    fn refuse_unknown_keys(&mut self, table: &Table, light_type: LightType) {
        let type_name = light_type.name();
        let known = || light_type.keys().iter().map(|key| key.name);
        for Entry { key: written, offset, .. } in
            table.entries.iter().filter(|entry| light_type.key(&entry.key).is_none())
        {
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
            self.problem(*offset, message);
        }
    }

    fn text(&mut self, table: &Table, light_type: LightType, key: &'static str) -> Option<String> {
        match table.find(key) {
            Some(Entry { value: Value::Text(text), .. }) => Some(text.clone()),
            Some(Entry { offset, value, .. }) => self.wrong_type(*offset, key, "text in quotes", value),
            None => self.missing(table, light_type, key),
        }
    }

    fn switch(&mut self, table: &Table, key: &'static str) -> Option<bool> {
        match table.find(key) {
            Some(Entry { value: Value::Switch(switch), .. }) => Some(*switch),
            Some(Entry { offset, value, .. }) => self.wrong_type(*offset, key, "true or false", value),
            None => Some(true),
        }
    }

    fn number(&mut self, table: &Table, light_type: LightType, key: &'static str) -> Option<f32> {
        match table.find(key) {
            Some(Entry { offset, value, .. }) => value.number().or_else(|| {
                let example = light_type.key(key).map_or("1.0", |key| key.example);
                self.wrong_type(*offset, key, &format!("a number, such as {example}"), value)
            }),
            None => light_type
                .key(key)
                .and_then(|key| key.default)
                .or_else(|| self.missing(table, light_type, key)),
        }
    }

    fn triple(&mut self, table: &Table, light_type: LightType, key: &'static str) -> Option<Vec3> {
        let Some(Entry { offset, value, .. }) = table.find(key) else {
            let default = light_type.key(key).and_then(|key| key.default);
            return default.map(Vec3::splat).or_else(|| self.missing(table, light_type, key));
        };
        value.three_numbers().or_else(|| {
            let example = light_type.key(key).map_or("[1.0, 1.0, 1.0]", |key| key.example);
            self.wrong_type(*offset, key, &format!("three numbers, such as {example}"), value)
        })
    }

    /// Notes that `key` is of the wrong type; `None` for the caller to hand on.
    pub(super) fn wrong_type<T>(
        &mut self,
        offset: usize,
        key: &str,
        wanted: &str,
        written: &Value,
    ) -> Option<T> {
        self.problem(offset, format!("`{key}` must be {wanted}, not {}", written.described()));
        None
    }

    fn missing<T>(&mut self, table: &Table, light_type: LightType, key: &'static str) -> Option<T> {
        // A misspelt key is told as such, at its own line.
        let misspelt = table.keys().any(|written| {
            light_type.key(written).is_none()
                && near_miss(written, light_type.keys().iter().map(|key| key.name)) == Some(key)
        });
        if !misspelt {
            let type_name = light_type.name();
            let light = match table.find("name").and_then(|entry| entry.value.text()) {
                Some(name) => format!("{type_name} light `{name}`"),
                None => format!("{type_name} light"),
            };
            let example = light_type.key(key).map_or("", |key| key.example);
            self.problem(table.offset, format!("this {light} has no `{key}`; add {key} = {example}"));
        }
        None
    }
}
