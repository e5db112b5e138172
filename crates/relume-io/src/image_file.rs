use std::path::Path;

use relume::image::Image;
use relume::{Error, Result};

use crate::{read_exr, read_png};

/// Reads the colours of an image by its ending: `.exr` ([`read_exr`], `R G B`) or `.png` ([`read_png`], sRGB
/// made linear).
///
/// # Errors
/// [`Error::File`] for any other ending, and as the two.
pub fn read_image(path: impl AsRef<Path>) -> Result<Image> {
    let path = path.as_ref();
    match path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase).as_deref() {
        Some("exr") => Ok(read_exr(path)?.image),
        Some("png") => read_png(path),
        _ => Err(Error::file(path, "is of a kind Relume does not read; use an .exr or a .png")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExrMeta, write_exr_image, write_png};

    #[test]
    fn the_ending_decides() {
        let folder = tempfile::tempdir().unwrap();
        let (exr, png) = (folder.path().join("a.EXR"), folder.path().join("a.png"));
        write_exr_image(&exr, &Image::new(2, 1), &ExrMeta::default()).unwrap();
        write_png(&png, 2, 1, &[[0; 3]; 2]).unwrap();
        assert_eq!(read_image(&exr).unwrap(), read_image(&png).unwrap());
        let error = read_image(folder.path().join("a.jpg")).unwrap_err().to_string();
        assert!(
            error.ends_with("a.jpg: is of a kind Relume does not read; use an .exr or a .png"),
            "{error}"
        );
    }
}
