//! The frames of a sequence, and the names of their files.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use relume::{Error, Result};

/// Frames are from minus this to this, as in a rig.
const LAST_FRAME: i32 = 1_000_000;
/// Of a frame's number in a file's name: more than the last frame has.
const MOST_DIGITS: usize = 9;

/// `--frames`: `A..B` with both included, or one.
pub(super) fn frames(written: &str) -> Result<RangeInclusive<i32>, String> {
    let frame = |text: &str| text.parse().ok().filter(|frame| (-LAST_FRAME..=LAST_FRAME).contains(frame));
    let (first, last) = written.split_once("..").unwrap_or((written, written));
    match frame(first).zip(frame(last)) {
        Some((first, last)) if first <= last => Ok(first..=last),
        Some((first, last)) => Err(format!("frame {last} is before {first}; write the first one first")),
        None => {
            Err(format!("write A..B or one frame, as 1..48 or 12, each from -{LAST_FRAME} to {LAST_FRAME}"))
        }
    }
}

/// A file's name with one group of `#`, which stands for the number of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pattern {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// # Errors
    /// [`Error::File`] where the file's name has no group of `#`, more than one, or is no Unicode text.
    pub(super) fn new(path: &Path) -> Result<Self> {
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
    pub(super) fn file(&self, frame: i32) -> PathBuf {
        let Self { folder, before, digits, after } = self;
        let sign = if frame < 0 { "-" } else { "" };
        folder.join(format!("{before}{sign}{:0digits$}{after}", frame.unsigned_abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_have_both_ends_or_one() {
        assert_eq!(frames("1..48"), Ok(1..=48));
        assert_eq!(frames("-5..-5"), Ok(-5..=-5));
        assert_eq!(frames("7"), Ok(7..=7));
        for wrong in ["", "..", "1..", "..3", "3..1", "1...3", "1-3", "1.5", "a..b", "0..1000001"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_take_the_place_of_the_group() {
        let file = |pattern: &str, frame| Pattern::new(Path::new(pattern)).unwrap().file(frame);
        assert_eq!(file("a/shot_##.v2.png", 7), Path::new("a/shot_07.v2.png"));
        assert_eq!(file("####.exr", 12_345), Path::new("12345.exr"));
        assert_eq!(file("x.####.exr", -5), Path::new("x.-0005.exr"));
        assert_eq!(file("take #1/#.png", 3), Path::new("take #1/3.png"));
        let long = format!("{}.png", "#".repeat(100_000));
        for wrong in ["out.png", "#a#.png", "##/out.png", "", "..", "##########.png", &long] {
            let error = Pattern::new(Path::new(wrong)).unwrap_err();
            assert!(error.is_bad_input() && error.to_string().contains("out.####.exr"), "{error}");
        }
    }
}
