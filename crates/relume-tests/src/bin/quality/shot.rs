//! A scene and its first camera, ready to be traced and to be prepared.

use std::path::{Path, PathBuf};

use relume::glam::Vec3;
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::{Result, Scene};
use relume_io::load_scene;
use xxhash_rust::xxh3::Xxh3;

use crate::progress::say;

/// Endings of scene files, in the order in which they are looked for.
const ENDINGS: [&str; 3] = ["glb", "gltf", "obj"];

/// A scene under measurement. What its surfaces emit can be switched off, so that every light is judged alone.
pub(crate) struct Shot {
    /// Without folder and ending.
    pub(crate) name: String,
    /// As the importer gives it, but for the emission.
    pub(crate) scene: Scene,
    /// Flattened.
    pub(crate) geometry: Geometry,
    /// Over `geometry`.
    pub(crate) accel: Accel,
    /// Hash of all that tracing and preparing read of the scene, emission included.
    pub(crate) hash: String,
    /// Emission of each material as it was read.
    emission: Vec<Vec3>,
}

/// The file of the scene `name` in `folder`; `None` where there is none.
pub(crate) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let files = ENDINGS.iter().map(|ending| folder.join(format!("{name}.{ending}")));
    files.into_iter().find(|path| path.is_file())
}

impl Shot {
    /// Reads the scene at `path`.
    ///
    /// # Errors
    /// As [`load_scene`].
    pub(crate) fn load(name: &str, path: &Path) -> Result<Self> {
        let imported = load_scene(path)?;
        for warning in &imported.warnings {
            say(&format!("warning: {}: {warning}", path.display()));
        }
        Ok(Self::new(name, imported.scene))
    }

    /// Makes a scene ready.
    pub(crate) fn new(name: &str, scene: Scene) -> Self {
        let geometry = Geometry::new(&scene);
        let accel = Accel::new(&scene, &geometry);
        let hash = scene_hash(&scene, &geometry);
        let emission = scene.materials.iter().map(|material| material.emission).collect();
        Self { name: name.to_owned(), scene, geometry, accel, hash, emission }
    }

    /// Whether any surface shines of its own.
    pub(crate) fn emits(&self) -> bool {
        self.geometry.materials.iter().any(|&material| self.emission[material as usize] != Vec3::ZERO)
    }

    /// Switches on or off what surfaces emit.
    pub(crate) fn set_emission(&mut self, on: bool) {
        for (material, emission) in self.scene.materials.iter_mut().zip(&self.emission) {
            material.emission = if on { *emission } else { Vec3::ZERO };
        }
    }
}

fn scene_hash(scene: &Scene, geometry: &Geometry) -> String {
    let mut hash = Xxh3::new();
    hash.update(bytemuck::cast_slice(&geometry.positions));
    hash.update(bytemuck::cast_slice(&geometry.normals));
    hash.update(bytemuck::cast_slice(&geometry.uvs));
    hash.update(bytemuck::cast_slice(&geometry.tangents));
    hash.update(bytemuck::cast_slice(&geometry.triangles));
    hash.update(bytemuck::cast_slice(&geometry.materials));
    hash.update(bytemuck::cast_slice(&geometry.objects));
    hash.update(format!("{:?}", scene.materials).as_bytes());
    for texture in &scene.textures {
        let kind = (texture.width, texture.height, texture.color_space, texture.wrap);
        hash.update(format!("{kind:?}").as_bytes());
        hash.update(bytemuck::cast_slice(&texture.texels));
    }
    hash.update(format!("{:?}", scene.cameras).as_bytes());
    format!("{:016x}", hash.digest())
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_tests::scenes::{box_room, emissive, empty_room};

    #[test]
    fn emission_is_switched_and_belongs_to_the_hash() {
        let mut dark = Shot::new("room", box_room().scene);
        assert!(!dark.emits());
        dark.set_emission(true);
        assert_eq!(dark.scene, box_room().scene);
        let scene = |light| empty_room(emissive(Vec3::splat(0.5), Vec3::splat(light))).scene;
        let mut lit = Shot::new("room", scene(1.0));
        assert!(lit.emits());
        lit.set_emission(false);
        assert_eq!(lit.scene.materials[0].emission, Vec3::ZERO);
        lit.set_emission(true);
        assert_eq!(lit.scene, scene(1.0));
        assert_eq!(lit.hash, Shot::new("other", scene(1.0)).hash);
        assert_ne!(lit.hash, Shot::new("room", scene(2.0)).hash);
    }
}
