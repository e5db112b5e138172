//! What the command lines of the measuring programs have in common.

use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::progress::say;

/// The command line to repeat a run of the developer task `task` by, with the last parts of absolute paths alone: folders of one machine mean nothing
/// on another.
pub fn command(task: &str, arguments: impl Iterator<Item = String>) -> String {
    let last_part = |text: &str| {
        let path = Path::new(text);
        let name = path.file_name().filter(|_| path.is_absolute());
        name.map_or_else(|| text.to_owned(), |name| name.to_string_lossy().into_owned())
    };
    let shown = arguments.map(|argument| match argument.split_once('=') {
        Some((name, value)) => format!("{name}={}", last_part(value)),
        None => last_part(&argument),
    });
    std::iter::once(format!("cargo xtask {task}")).chain(shown).collect::<Vec<_>>().join(" ")
}

/// Says what went wrong, if anything did, and how the program is to end: 2 where it was asked for what cannot be, 1 where it failed.
pub fn ended(result: relume::Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error: {error}"));
            ExitCode::from(if error.is_bad_input() { 2 } else { 1 })
        }
    }
}

/// A setting by the name it has in files.
///
/// # Errors
/// Which names there are.
pub fn named<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(text.into()).map_err(|error| error.to_string())
}

/// The name a setting has in files.
pub fn name_of(setting: &impl Serialize) -> String {
    let value = serde_json::to_value(setting).unwrap_or_default();
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Width and height in pixels, 1 to 16,384 each, written as `640x480`.
///
/// # Errors
/// How to write it.
pub fn image_size(text: &str) -> Result<(usize, usize), String> {
    let side = |side: &str| side.parse().ok().filter(|side| (1..=16_384).contains(side));
    text.split_once(['x', 'X'])
        .and_then(|(width, height)| Some((side(width)?, side(height)?)))
        .ok_or_else(|| "write WIDTHxHEIGHT in pixels, each 1 to 16384, as 640x480".to_owned())
}

/// A number of gather samples: a power of four from 256 to 4^10.
///
/// # Errors
/// What it must be.
pub fn gather_count(text: &str) -> Result<usize, String> {
    let is_count = |count: &usize| (256..=1 << 20).contains(count) && count.is_power_of_two();
    let count = text.parse().ok().filter(is_count).filter(|count| count.trailing_zeros() % 2 == 0);
    count.ok_or_else(|| "must be a power of four from 256 to 1048576".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_name_no_folder_of_this_machine() {
        let line = ["sponza", "--scenes", "/a/b/scenes", "--out=/tmp/x", "--rigs", "assets/rigs"];
        let shown = command("quality", line.iter().map(|&argument| argument.to_owned()));
        assert_eq!(shown, "cargo xtask quality sponza --scenes scenes --out=x --rigs assets/rigs");
    }

    #[test]
    fn sizes_and_counts_are_checked() {
        assert_eq!(image_size("640x480"), Ok((640, 480)));
        assert_eq!(gather_count("1024"), Ok(1024));
        for wrong in ["640", "0x480", "640x16385", "640x480x3", "-1x2"] {
            assert!(image_size(wrong).is_err(), "{wrong}");
        }
        for wrong in ["64", "512", "4194304", "many"] {
            assert!(gather_count(wrong).is_err(), "{wrong}");
        }
    }
}
