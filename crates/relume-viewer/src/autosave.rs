//! Edits that are not saved yet, kept beside the preferences, so that a crash loses none.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};

use relume::{Error, Result, atomic_write};
use relume_io::AnimatedRig;

/// The file in which edits of one rig are kept while it is open.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Autosave {
    file: PathBuf,
    /// The rig's own file, or that of the shot for a rig that has none: what maps of domes are named from.
    of: PathBuf,
}

impl Autosave {
    /// In `folder`, for the rig at `of`.
    pub(crate) fn new(folder: &Path, of: &Path) -> Self {
        let of = std::path::absolute(of).unwrap_or_else(|_| of.to_owned());
        let mut hash = DefaultHasher::new();
        of.hash(&mut hash);
        let name = of.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self { file: folder.join(format!("{name}-{:016x}.toml", hash.finish())), of }
    }

    /// What was kept and never saved, if it can be read; maps that `known` has are not read again.
    ///
    /// # Errors
    /// As [`AnimatedRig::parse_beside`], for a file that was damaged.
    pub(crate) fn recovered(&self, known: &AnimatedRig) -> Result<Option<AnimatedRig>> {
        match std::fs::read_to_string(&self.file) {
            Ok(text) => AnimatedRig::parse_beside(text, &self.of, known).map(Some),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Error::io(&self.file, "read", error)),
        }
    }

    /// Keeps `rig`, whole or as it was before.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn keep(&self, rig: &AnimatedRig) -> Result<()> {
        let refused = |error| Error::io(&self.file, "write", error);
        std::fs::create_dir_all(self.file.parent().unwrap_or(Path::new("."))).map_err(refused)?;
        let text = format!("# Unsaved edits of {}\n{}", self.of.display(), rig.moved_to(&self.of)?.to_toml());
        atomic_write(&self.file, |file| file.write_all(text.as_bytes()).map_err(refused))
    }

    /// Whether anything is kept.
    pub(crate) fn is_there(&self) -> bool {
        self.file.exists()
    }

    /// Puts what is kept out of the way, and returns where it is.
    pub(crate) fn set_aside(&self) -> PathBuf {
        let aside = (1..).map(|number| self.file.with_extension(format!("aside-{number}.toml")));
        let aside = aside.into_iter().find(|path| !path.exists()).unwrap_or_default();
        // where that fails it stays, and is told again
        let _ = std::fs::rename(&self.file, &aside);
        aside
    }

    /// Forgets what was kept: it is saved, or was thrown away.
    pub(crate) fn forget(&self) {
        // A file that cannot be removed is offered again: a nuisance, but no loss.
        let _ = std::fs::remove_file(&self.file);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume::LightRig;

    #[test]
    fn what_was_kept_is_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let state = folder.path().join("state/of/relume");
        let none = AnimatedRig::still(&LightRig::default(), "night.toml").unwrap();
        let autosave = Autosave::new(&state, &folder.path().join("night.toml"));
        assert_eq!(autosave.recovered(&none).unwrap(), None);
        let rig = LightRig { exposure: 1.25, ..LightRig::default() };
        let rig = AnimatedRig::still(&rig, "night.toml").unwrap();
        autosave.keep(&rig).unwrap();
        assert_eq!(autosave.recovered(&none).unwrap(), Some(rig));
        let other = Autosave::new(&state, &folder.path().join("day/night.toml"));
        assert_eq!(other.recovered(&none).unwrap(), None, "rigs of one name are told apart");
        autosave.forget();
        assert_eq!(autosave.recovered(&none).unwrap(), None);
        autosave.forget();
        std::fs::write(&autosave.file, "exposure = \n").unwrap();
        assert!(autosave.recovered(&none).is_err());
        let aside = autosave.set_aside();
        assert_eq!(std::fs::read_to_string(aside).unwrap(), "exposure = \n");
        assert_eq!(autosave.recovered(&none).unwrap(), None);
    }
}
