//! Scenes as commands read them: warnings said, cameras named.

use std::path::Path;

use relume::{Error, Result, Scene};
use relume_io::{Imported, load_scene};

use crate::console::Console;

/// Reads the scene at `path` and says what it asked for in vain.
///
/// # Errors
/// As [`load_scene`].
pub(crate) fn read(path: &Path, console: &Console) -> Result<Imported> {
    let imported = console.stage("reading the scene", || load_scene(path))?;
    for warning in &imported.warnings {
        console.warning(&format!("{}: {warning}", path.display()));
    }
    Ok(imported)
}

/// The scene's camera by name or, where none has that name, by number. The first where none is asked for.
///
/// # Errors
/// [`Error::File`] that lists the cameras there are.
pub(crate) fn camera(scene: &Scene, wanted: Option<&str>, path: &Path) -> Result<usize> {
    scene.find_camera(wanted).map_err(|message| Error::file(path, message))
}

/// The file's name without its folder.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::Camera;

    #[test]
    fn cameras_go_by_name_before_number() {
        let named = |name: &str| Camera {
            name: name.to_owned(),
            world_from_camera: relume::glam::Affine3A::IDENTITY,
            vertical_fov: 1.0,
        };
        let scene = Scene { cameras: vec![named("left"), named("0"), named("right")], ..Scene::default() };
        let find = |wanted| camera(&scene, wanted, Path::new("a.glb"));
        assert_eq!(find(None).unwrap(), 0);
        assert_eq!(find(Some("right")).unwrap(), 2);
        assert_eq!(find(Some("0")).unwrap(), 1);
        assert_eq!(find(Some("2")).unwrap(), 2);
        let error = find(Some("top")).unwrap_err();
        assert!(error.is_bad_input());
        assert_eq!(error.to_string(), "a.glb: has no camera `top`; it has 0 `left`, 1 `0`, 2 `right`");
        assert!(find(Some("3")).is_err());
    }
}
