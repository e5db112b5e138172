//! Frames as image files: their names, what is said of how they were made, and writing them.

use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

use relume::image::{Layers, Tonemap, display};
use relume::relight::RelightSettings;
use relume::{Error, Result, Transfer};

use crate::{Attribute, ExrMeta, write_exr, write_png};

/// Of a frame's number in a file's name: more than the last frame has.
const MOST_DIGITS: usize = 9;

/// What an image file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageKind {
    /// Scene-linear, with layers.
    Exr,
    /// As a display shows it.
    Png,
}

impl ImageKind {
    /// That of a file, by its ending.
    ///
    /// # Errors
    /// [`Error::File`] for an ending other than `.exr` and `.png`.
    pub fn of(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("exr") => Ok(Self::Exr),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::file(path, "the name of an image must end in .exr or .png; name it so")),
        }
    }
}

/// Writes a frame: all its layers and `attributes` as EXR, or the full image as it is shown, at an exposure in stops and through a curve, as PNG.
///
/// # Errors
/// As [`write_exr`] and [`write_png`].
pub fn write_frame(
    path: impl AsRef<Path>,
    kind: ImageKind,
    layers: &Layers,
    (exposure, tonemap): (f32, Tonemap),
    attributes: Vec<(String, Attribute)>,
) -> Result<()> {
    match kind {
        ImageKind::Exr => write_exr(path, layers, &ExrMeta { attributes, ..ExrMeta::default() }),
        ImageKind::Png => {
            let image = layers.full();
            write_png(path, image.width, image.height, &display(&image, exposure, tonemap))
        }
    }
}

/// How the frame was made, for its EXR header. No times, so that the same frame gives the same bytes.
pub fn frame_attributes(transfer: &Transfer, settings: &RelightSettings) -> Vec<(String, Attribute)> {
    let report = &transfer.report;
    vec![
        own_text("scene", &report.scene),
        own_text("scene_hash", &report.scene_hash),
        own_text("bounces", bounces(settings.bounces)),
        own_number("aa", settings.aa),
        own_text("quality", if settings.preview { "preview" } else { "full" }),
        own_number("cull", settings.cull.unwrap_or_else(|| transfer.gather.encoding().cull())),
        own_number("gather_samples", transfer.cloud.len() as f64),
    ]
}

/// The number of bounces in words.
pub fn bounces(bounces: Option<u32>) -> String {
    bounces.map_or("all".to_owned(), |bounces| bounces.to_string())
}

const ATTRIBUTE_PREFIX: &str = "relume:";

/// An EXR attribute of Relume's own that holds a number.
pub fn own_number(name: &str, value: impl Into<f64>) -> (String, Attribute) {
    (format!("{ATTRIBUTE_PREFIX}{name}"), Attribute::Number(value.into()))
}

/// An EXR attribute of Relume's own that holds a text.
pub fn own_text(name: &str, value: impl Into<String>) -> (String, Attribute) {
    (format!("{ATTRIBUTE_PREFIX}{name}"), Attribute::Text(value.into()))
}

/// The value of an EXR attribute of Relume's own, if there is one and it is a number.
pub fn stored_number(attributes: &[(String, Attribute)], name: &str) -> Option<f64> {
    let (_, value) = attributes.iter().find(|(key, _)| key.strip_prefix(ATTRIBUTE_PREFIX) == Some(name))?;
    match value {
        Attribute::Number(number) => Some(*number),
        Attribute::Text(_) => None,
    }
}

/// A file's name with one group of `#`, which stands for the number of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameNames {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl FrameNames {
    /// From a name as `out.####.exr`.
    ///
    /// # Errors
    /// [`Error::File`] where the file's name has no group of `#`, more than one, or is no Unicode text.
    pub fn new(path: &Path) -> Result<Self> {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let refused = |what: &str| {
            Err(Error::file(
                path,
                format!("has {what} for the number of the frame; name it as in out.####.exr"),
            ))
        };
        let Some(start) = name.find('#') else { return refused("no #") };
        let after = name[start..].trim_start_matches('#');
        if after.contains('#') {
            return refused("more than one group of #");
        }
        let digits = name.len() - start - after.len();
        if digits > MOST_DIGITS {
            return refused("too many #");
        }
        Ok(Self {
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
            before: name[..start].to_owned(),
            digits,
            after: after.to_owned(),
        })
    }

    /// The file of a frame, whose number has at least as many digits as there are `#`, after its sign where it has one.
    pub fn file(&self, frame: i32) -> PathBuf {
        let Self { folder, before, digits, after } = self;
        let sign = if frame < 0 { "-" } else { "" };
        folder.join(format!("{before}{sign}{:0digits$}{after}", frame.unsigned_abs()))
    }
}

/// Writes each of `frames` on a thread of its own while the next is made. At most three are held: one that is made, one that waits, and one that is
/// written.
///
/// # Errors
/// The first of either side. What was made before is written.
pub fn write_behind<T: Send>(
    frames: impl Iterator<Item = Result<T>>,
    mut write: impl FnMut(T) -> Result<()> + Send,
) -> Result<()> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(1);
        let writer = std::thread::Builder::new()
            .name("writer".to_owned())
            .spawn_scoped(scope, move || receiver.into_iter().try_for_each(&mut write))
            .map_err(|error| Error::io("writing thread", "start", error))?;
        let mut made = Ok(());
        for frame in frames {
            match frame {
                Ok(frame) => {
                    if sender.send(frame).is_err() {
                        // the writer has ended, and says why
                        break;
                    }
                }
                Err(error) => {
                    made = Err(error);
                    break;
                }
            }
        }
        drop(sender);
        match writer.join() {
            Ok(written) => written.and(made),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_take_the_place_of_the_group() {
        let file = |pattern: &str, frame| FrameNames::new(Path::new(pattern)).unwrap().file(frame);
        assert_eq!(file("a/shot_##.v2.png", 7), Path::new("a/shot_07.v2.png"));
        assert_eq!(file("####.exr", 12_345), Path::new("12345.exr"));
        assert_eq!(file("x.####.exr", -5), Path::new("x.-0005.exr"));
        assert_eq!(file("take #1/#.png", 3), Path::new("take #1/3.png"));
        let long = format!("{}.png", "#".repeat(100_000));
        for wrong in ["out.png", "#a#.png", "##/out.png", "", "..", "##########.png", &long] {
            let error = FrameNames::new(Path::new(wrong)).unwrap_err();
            assert!(error.is_bad_input() && error.to_string().contains("out.####.exr"), "{error}");
        }
    }

    fn failed() -> Error {
        Error::Setting("no".to_owned())
    }

    #[test]
    fn frames_are_written_in_order() {
        let mut written = Vec::new();
        write_behind((0..100).map(Ok), |frame| {
            written.push(frame);
            Ok(())
        })
        .unwrap();
        assert_eq!(written, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn what_was_made_before_an_error_is_written() {
        let mut written = Vec::new();
        let made = (0..9).map(|frame| if frame < 4 { Ok(frame) } else { Err(Error::Cancelled) });
        let outcome = write_behind(made, |frame| {
            written.push(frame);
            Ok(())
        });
        assert!(matches!(outcome, Err(Error::Cancelled)));
        assert_eq!(written, [0, 1, 2, 3]);
    }

    #[test]
    fn an_error_of_writing_ends_the_job() {
        let mut made = 0;
        let frames = (0..1000).map(|frame| {
            made += 1;
            Ok(frame)
        });
        let outcome = write_behind(frames, |frame| if frame == 2 { Err(failed()) } else { Ok(()) });
        assert_eq!(outcome.unwrap_err().to_string(), failed().to_string());
        assert!(made < 10, "{made} frames were made");
    }
}
