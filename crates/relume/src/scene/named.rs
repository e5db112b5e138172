//! What a rig says of the scene's materials, which it knows by name.

use std::collections::{BTreeSet, HashMap};

use glam::Vec3;

use super::LightRig;
use crate::Error;

/// How an emissive material shines.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// The material's name in the scene; all materials of that name are meant.
    pub material: String,
    /// What its emission is multiplied by, linear RGB, not negative.
    pub scale: Vec3,
}

/// A material's base colour in place of the scene's, in diffuse reflection alone. What is specular stays as in the scene: a metal, all
/// of whose reflection is, looks the same.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialEdit {
    /// The material's name in the scene; all materials of that name are meant.
    pub name: String,
    /// Linear RGB factor, `0..=1` each, which takes the place of [`super::Material::base_color`]; textures stay and are multiplied by it.
    pub base_color: Vec3,
}

/// The lists of a rig that name materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamedList {
    /// [`LightRig::emitters`].
    Emitters,
    /// [`LightRig::materials`].
    Materials,
}

/// What is wrong with an entry of a rig that names a material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFault {
    /// In which list it stands.
    pub list: NamedList,
    /// Which of the list.
    pub index: usize,
    /// One sentence.
    pub message: String,
}

impl From<NamedFault> for Error {
    fn from(fault: NamedFault) -> Self {
        Self::Setting(fault.message)
    }
}

impl LightRig {
    /// Which of [`Self::emitters`] each of `materials` follows: their names, and whether they emit anything in the scene.
    ///
    /// # Errors
    /// [`NamedFault`] for the first emitter that names no material, or none that emits, repeats an earlier one, or has a scale that is
    /// negative or no number.
    pub fn emitters_of<'m>(
        &self,
        materials: impl Iterator<Item = (&'m str, bool)>,
    ) -> Result<Vec<Option<usize>>, NamedFault> {
        let fault = |index, message| NamedFault { list: NamedList::Emitters, index, message };
        for (index, Emitter { material, scale }) in self.emitters.iter().enumerate() {
            if !scale.is_finite() || scale.min_element() < 0.0 {
                let message =
                    format!("emitter `{material}`: `scale` must be three finite numbers, none negative");
                return Err(fault(index, message));
            }
        }
        let names = self.emitters.iter().map(|emitter| emitter.material.as_str());
        followed(names, materials).map_err(|(index, mistake)| {
            let what = match mistake {
                Mistake::Repeated => "an earlier one names this material too".to_owned(),
                Mistake::Unknown(scene) => format!("no material has this name; {}", scene.shining()),
                Mistake::Dark(scene) => format!("this material emits nothing; {}", scene.shining()),
            };
            fault(index, format!("emitter `{}`: {what}", self.emitters[index].material))
        })
    }

    /// Which of [`Self::materials`] each of `materials` follows, by their names.
    ///
    /// # Errors
    /// [`NamedFault`] for the first edit that names no material, repeats an earlier one, or has a colour that is not within `0..=1`.
    pub fn edits_of<'m>(
        &self,
        materials: impl Iterator<Item = &'m str>,
    ) -> Result<Vec<Option<usize>>, NamedFault> {
        let fault = |index, message| NamedFault { list: NamedList::Materials, index, message };
        for (index, MaterialEdit { name, base_color }) in self.materials.iter().enumerate() {
            if !base_color.to_array().iter().all(|channel| (0.0..=1.0).contains(channel)) {
                let message = format!("material `{name}`: `base_color` must be three numbers from 0 to 1");
                return Err(fault(index, message));
            }
        }
        let names = self.materials.iter().map(|edit| edit.name.as_str());
        // an edit wants no more of a material than to be there
        followed(names, materials.map(|name| (name, true))).map_err(|(index, mistake)| {
            let what = match mistake {
                Mistake::Repeated => "an earlier one names this material too".to_owned(),
                Mistake::Unknown(scene) | Mistake::Dark(scene) => {
                    format!("no material of the scene has this name; {}", scene.listed())
                }
            };
            fault(index, format!("material `{}`: {what}", self.materials[index].name))
        })
    }
}

/// Most names of materials that a message lists.
const LISTED: usize = 12;

/// Names of the materials that could have been meant, in order.
struct Meant<'m>(BTreeSet<&'m str>);

impl Meant<'_> {
    fn shining(&self) -> String {
        self.told("the scene has no named material that shines", "those that shine are")
    }

    fn listed(&self) -> String {
        self.told("none has a name", "there are")
    }

    fn told(&self, none: &str, these: &str) -> String {
        if self.0.is_empty() {
            return none.to_owned();
        }
        let first: Vec<String> = self.0.iter().take(LISTED).map(|name| format!("`{name}`")).collect();
        let count = self.0.len();
        let more = if count > LISTED { format!(" and {} more", count - LISTED) } else { String::new() };
        format!("{these} {}{more}", first.join(", "))
    }
}

enum Mistake<'m> {
    Repeated,
    /// No material has the name.
    Unknown(Meant<'m>),
    /// None that has it can be meant.
    Dark(Meant<'m>),
}

/// Which of `names` each of `materials` has: their names, and whether they can be meant. Or the first of `names` that is at fault.
fn followed<'n, 'm>(
    names: impl Iterator<Item = &'n str>,
    materials: impl Iterator<Item = (&'m str, bool)>,
) -> Result<Vec<Option<usize>>, (usize, Mistake<'m>)> {
    let mut by_name: HashMap<&str, usize> = HashMap::new();
    for (index, name) in names.enumerate() {
        if by_name.insert(name, index).is_some() {
            return Err((index, Mistake::Repeated));
        }
    }
    let (mut known, mut met) = (vec![false; by_name.len()], vec![false; by_name.len()]);
    let (mut meant, mut of_materials) = (BTreeSet::new(), Vec::new());
    for (name, can_be) in materials {
        let index = by_name.get(name).copied();
        if let Some(index) = index {
            known[index] = true;
            met[index] |= can_be;
        }
        if can_be && !name.is_empty() {
            meant.insert(name);
        }
        of_materials.push(index);
    }
    match met.iter().position(|met| !met) {
        Some(index) if known[index] => Err((index, Mistake::Dark(Meant(meant)))),
        Some(index) => Err((index, Mistake::Unknown(Meant(meant)))),
        None => Ok(of_materials),
    }
}
