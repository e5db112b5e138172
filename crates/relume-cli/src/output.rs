//! Files that commands write: checked before the work begins, written whole or not at all.

use std::path::{Path, PathBuf};

use relume::image::{Image, Layers, Tonemap, display};
use relume::{Error, Result};
use relume_io::{Attribute, ImageKind, write_frame, write_png};

/// Refuses an output that could not be written, or should not be, before any work is done for it.
///
/// # Errors
/// [`Error::File`] where `path` does not end in one of `endings`, is one of `inputs`, lies in a folder that does not
/// exist, or is no regular file; [`Error::Io`] where its folder cannot be written.
pub(crate) fn check_output(path: &Path, what: &str, endings: &[&str], inputs: &[&Path]) -> Result<()> {
    if !ending(path).is_some_and(|ending| endings.contains(&ending.as_str())) {
        let known = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" or ");
        return Err(Error::file(path, format!("{what} must end in {known}; name it so")));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Error::file(
            path,
            format!("the folder {} does not exist; create it or name another one", folder.display()),
        ));
    }
    check_replaced(path, inputs)?;
    tempfile::Builder::new()
        .prefix(".relume-")
        .suffix(".tmp")
        .tempfile_in(folder)
        .map(drop)
        .map_err(|error| Error::io(path, "write", error))
}

/// Refuses an output in the place of what must not be replaced.
///
/// # Errors
/// [`Error::File`] where `path` is one of `inputs`, or is there and no regular file.
pub(crate) fn check_replaced(path: &Path, inputs: &[&Path]) -> Result<()> {
    if path.exists() && !path.is_file() {
        return Err(Error::file(path, "is there already and is no regular file; name another file"));
    }
    if inputs.iter().any(|input| same_file(path, input)) {
        return Err(Error::file(
            path,
            "is an input of this command and would be overwritten; name another file",
        ));
    }
    Ok(())
}

/// The folder `path` lies in.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// The ending of a path, in lower case.
pub(crate) fn ending(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_lowercase())
}

fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// An image that will be written, and can be as far as one can tell.
#[derive(Clone, Debug)]
pub(crate) struct ImageOutput {
    path: PathBuf,
    pub(crate) kind: ImageKind,
}

impl ImageOutput {
    /// # Errors
    /// As [`check_output`].
    pub(crate) fn new(path: &Path, inputs: &[&Path]) -> Result<Self> {
        check_output(path, "the name of an image", &["exr", "png"], inputs)?;
        Ok(Self { path: path.to_owned(), kind: ImageKind::of(path)? })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The same under another name in its folder.
    pub(crate) fn renamed(&self, path: PathBuf) -> Self {
        Self { path, kind: self.kind }
    }

    /// Writes a frame: all its layers and `attributes` as EXR, or the full image as it is shown.
    ///
    /// # Errors
    /// As [`write_frame`].
    pub(crate) fn write(
        &self,
        layers: &Layers,
        shown: (f32, Tonemap),
        attributes: Vec<(String, Attribute)>,
    ) -> Result<()> {
        write_frame(&self.path, self.kind, layers, shown, attributes)
    }
}

/// Writes `image` as PNG at an exposure in stops and through a curve.
pub(crate) fn write_shown(path: &Path, image: &Image, (exposure, tonemap): (f32, Tonemap)) -> Result<()> {
    write_png(path, image.width, image.height, &display(image, exposure, tonemap))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(path: &Path, inputs: &[&Path]) -> String {
        let error = ImageOutput::new(path, inputs).unwrap_err();
        assert!(error.is_bad_input(), "{error}");
        error.to_string()
    }

    #[test]
    fn outputs_are_refused_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(refusal(&at("a.jpg"), &[]).ends_with("must end in .exr or .png; name it so"));
        assert!(refusal(&at("exr"), &[]).ends_with("must end in .exr or .png; name it so"));
        assert!(refusal(&at("no/a.exr"), &[]).contains("does not exist; create it"));
        std::fs::create_dir(at("b.exr")).unwrap();
        assert!(refusal(&at("b.exr"), &[]).contains("no regular file"));
        std::fs::write(at("c.exr"), "").unwrap();
        assert!(
            refusal(&at("../").join(folder.path().file_name().unwrap()).join("c.exr"), &[&at("c.exr")])
                .contains("is an input of this command")
        );
        assert_eq!(ImageOutput::new(&at("c.exr"), &[&at("b.exr")]).unwrap().kind, ImageKind::Exr);
        assert_eq!(ImageOutput::new(&at("d.PNG"), &[]).unwrap().kind, ImageKind::Png);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "checking leaves nothing behind");
    }
}
