//! Prepared transfers, kept between runs together with what it took to make them.

use std::io::Write;
use std::path::{Path, PathBuf};

use relume::transfer::{FORMAT_VERSION, Settings};
use relume::{Error, Preparation, Result, Transfer, atomic_write};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::memory::{peak_resident_bytes, reset_peak};
use crate::progress::{Job, say};
use crate::shot::Shot;

/// Everything that a transfer depends on, and what it took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// Of the crate.
    version: String,
    /// Of the library's sources.
    sources: String,
    format: u64,
    scene_hash: String,
    settings: Settings,
    /// Wall-clock seconds.
    pub(crate) seconds: f64,
    /// The most memory resident meanwhile, the scene included; `None` where the system does not tell.
    pub(crate) peak_rss_bytes: Option<u64>,
    /// Threads it was made with.
    pub(crate) threads: usize,
}

impl Record {
    fn new(shot: &Shot, settings: &Settings) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            sources: env!("RELUME_PREPARATION_SOURCES").to_owned(),
            format: u64::from(FORMAT_VERSION),
            scene_hash: shot.hash.clone(),
            settings: settings.clone(),
            seconds: 0.0,
            peak_rss_bytes: None,
            threads: 0,
        }
    }

    /// Whether `other` stands for the same transfer, whatever it took.
    fn is_of(&self, other: &Self) -> bool {
        let Self { seconds, peak_rss_bytes, threads, .. } = *other;
        Self { seconds, peak_rss_bytes, threads, ..self.clone() } == *other
    }

    fn path(&self, folder: &Path, shot: &Shot) -> PathBuf {
        folder.join(format!("{}-{:016x}.relume", shot.name, xxh3_64(format!("{self:?}").as_bytes())))
    }
}

/// The transfer of `shot`: kept from an earlier run, unless `fresh`, or prepared and kept.
///
/// # Errors
/// Where it cannot be prepared or written.
pub(crate) fn prepare(
    shot: &Shot,
    settings: &Settings,
    folder: &Path,
    fresh: bool,
) -> Result<(Transfer, Record)> {
    let wanted = Record::new(shot, settings);
    let path = wanted.path(folder, shot);
    if !fresh && let Some(kept) = kept(&path, &wanted) {
        return Ok(kept);
    }
    reset_peak();
    let job = Job::by_stage(format!("{}, {}", shot.name, crate::arguments::label(settings)));
    let preparation = Preparation::new(&shot.scene).name(&shot.name).settings(settings.clone());
    let transfer = preparation.run(&job)?;
    let record = Record {
        seconds: transfer.timings.seconds,
        peak_rss_bytes: peak_resident_bytes(),
        threads: rayon::current_num_threads(),
        ..wanted
    };
    transfer.save(&path)?;
    let beside = path.with_extension("json");
    let refused = |error| Error::io(&beside, "write", error);
    let text = serde_json::to_vec_pretty(&record).map_err(|error| refused(std::io::Error::other(error)))?;
    atomic_write(&beside, |file| file.write_all(&text).map_err(refused))?;
    Ok((transfer, record))
}

/// What is kept at `path`, if it is whole and what is wanted.
fn kept(path: &Path, wanted: &Record) -> Option<(Transfer, Record)> {
    let record = std::fs::read(path.with_extension("json")).ok()?;
    let record: Record = serde_json::from_slice(&record).ok().filter(|record| wanted.is_of(record))?;
    match Transfer::load(path) {
        Ok(transfer) => (transfer.report.settings == wanted.settings).then_some((transfer, record)),
        Err(error) => {
            say(&format!("{error}; prepared again"));
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_tests::prepared::tiny;
    use relume_tests::scenes::box_room;

    #[test]
    fn a_transfer_is_prepared_once_and_a_stale_one_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let shot = Shot::new("room", box_room().scene);
        let settings = tiny();
        let (made, first) = prepare(&shot, &settings, folder.path(), false).unwrap();
        let (kept, second) = prepare(&shot, &settings, folder.path(), false).unwrap();
        assert_eq!(first, second, "the time is that of the one preparation");
        assert!(made.timings.seconds > 0.0 && kept.timings.seconds == 0.0);
        let (again, third) = prepare(&shot, &settings, folder.path(), true).unwrap();
        assert!(again.timings.seconds > 0.0 && third.is_of(&second));
        // a record of other settings at the right place
        let path = Record::new(&shot, &settings).path(folder.path(), &shot);
        let other = Record::new(&shot, &Settings { seed: 1, ..settings.clone() });
        assert!(super::kept(&path, &Record::new(&shot, &settings)).is_some());
        assert!(super::kept(&path, &other).is_none());
        std::fs::write(&path, b"half").unwrap();
        assert!(super::kept(&path, &Record::new(&shot, &settings)).is_none());
    }
}
