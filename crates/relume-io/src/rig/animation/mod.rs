//! Rigs whose fields move from frame to frame.

mod curve;
mod edit;
mod track;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use relume::{Error, LightRig, Result};

use super::parse::{Maps, Reader};
use super::value::{Entry, Item, Problem, Table, Value, read};
use super::{line_of, read_text};
pub use curve::Interpolation;
pub use edit::{Curve, Field, Subject};
use track::{Place, Track};

/// A rig file with its `[[animate]]` tables (see [the module above](super)): the rig at any frame. Frames without these tables are all alike.
#[derive(Clone, Debug)]
pub struct AnimatedRig {
    path: PathBuf,
    /// For the lines of problems.
    text: String,
    /// The text as it is written, whatever it was read from.
    canonical: String,
    /// Without what is animated.
    document: Table,
    tracks: Vec<Track>,
    /// All that any frame may ask for.
    maps: Maps,
}

impl AnimatedRig {
    /// Reads a rig and how it moves. The rig is built at each keyed frame, so that a file that is read is right there; between keys, numbers stay
    /// between those of the keys. Maps of domes are read here, each once, and kept.
    ///
    /// # Errors
    /// As [`load_rig`](super::load_rig).
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Self::parse(read_text(path.as_ref())?, path)
    }

    /// The same from the text of the file; `path` is named in errors, and maps of domes are looked for in its folder.
    ///
    /// # Errors
    /// As [`parse_rig`](super::parse_rig).
    pub fn parse(text: impl Into<String>, path: impl AsRef<Path>) -> Result<Self> {
        Self::parse_with_first(text.into(), path.as_ref()).map(|(animated, _)| animated)
    }

    /// The same, where `known` is a rig with maps in the same folder: they are not read again.
    ///
    /// # Errors
    /// As [`parse_rig`](super::parse_rig).
    pub fn parse_beside(text: impl Into<String>, path: impl AsRef<Path>, known: &Self) -> Result<Self> {
        let mut animated = Self::unread(text.into(), path.as_ref());
        let folder = |path: &Path| Some(std::path::absolute(path).ok()?.parent()?.to_owned());
        if folder(&animated.path) == folder(&known.path) {
            animated.maps.clone_from(&known.maps);
        }
        match animated.read() {
            Ok(_) => Ok(animated),
            Err(problem) => Err(animated.told(problem)),
        }
    }

    /// The same with the rig at the first keyed frame.
    pub(super) fn parse_with_first(text: String, path: &Path) -> Result<(Self, LightRig)> {
        let mut animated = Self::unread(text, path);
        match animated.read() {
            Ok(first) => Ok((animated, first)),
            Err(problem) => Err(animated.told(problem)),
        }
    }

    fn unread(text: String, path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            text,
            canonical: String::new(),
            document: Table::default(),
            tracks: Vec::new(),
            maps: Maps::new(),
        }
    }

    /// The file that it is of.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The first keyed frame, or 0 where nothing is animated.
    pub fn first_frame(&self) -> i32 {
        self.frames().map_or(0, |frames| *frames.start())
    }

    /// The first keyed frame and the last, both included; `None` where nothing is animated.
    pub fn frames(&self) -> Option<RangeInclusive<i32>> {
        let first = self.tracks.iter().filter_map(|track| track.frames.first()).min()?;
        let last = self.tracks.iter().filter_map(|track| track.frames.last()).max()?;
        Some(*first..=*last)
    }

    /// The rig at `frame`, which may lie between two: as for all frames, its lights, emitters and materials are those of the file, in this order.
    ///
    /// # Errors
    /// [`Error::File`] with the line and the frame where fields that are right at every key do not go together between keys, such as the target of a
    /// spot that passes through its position; [`Error::Setting`] for a frame that is no finite number.
    pub fn rig(&self, frame: f64) -> Result<LightRig> {
        if !frame.is_finite() {
            return Err(Error::Setting(format!("frame {frame} of a rig: must be a finite number")));
        }
        let mut reader = Reader::new(self.folder(), self.maps.clone());
        let rig = reader.rig(&self.document_at(frame));
        match first(reader.problems) {
            Some(problem) => Err(self.told(at_frame(frame, problem))),
            None => Ok(rig),
        }
    }

    /// The files of all maps.
    pub fn maps(&self) -> impl Iterator<Item = PathBuf> {
        self.maps.keys().map(|name| self.folder().join(name))
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    fn told(&self, problem: Problem) -> Error {
        // A rig may end in an unfinished line, and a missing key is told at its table's header.
        let line = line_of(&self.text, problem.offset);
        Error::file(&self.path, format!("line {line}: {}", problem.message))
    }

    /// Reads the text and checks every keyed frame; the rig at the first of them.
    fn read(&mut self) -> Result<LightRig, Problem> {
        self.document = read(&self.text)?;
        let folder = self.folder().to_owned();
        let mut reader = Reader::new(&folder, std::mem::take(&mut self.maps));
        if let Some(animate) = self.document.take("animate") {
            self.tracks = reader.tracks(&animate, &self.document);
        }
        first(std::mem::take(&mut reader.problems)).map_or(Ok(()), Err)?;
        let frame = f64::from(self.first_frame());
        let rig = reader.rig(&self.document_at(frame));
        if let Some(problem) = first(std::mem::take(&mut reader.problems)) {
            let mut keys = self.tracks.iter().flat_map(|track| &track.values);
            let is_of_a_key = keys.any(|key| key.offset == problem.offset);
            return Err(if is_of_a_key { at_frame(frame, problem) } else { problem });
        }
        self.check_keys(&mut reader)?;
        self.maps = edit::used(&rig, &self.tracks, &reader.maps);
        self.canonical = edit::text_of(&rig, &self.tracks);
        Ok(rig)
    }

    /// Each animated table at each of its keys, for itself: the time this takes grows with the number of keys, whatever else is in the rig.
    fn check_keys(&self, reader: &mut Reader<'_>) -> Result<(), Problem> {
        let mut animated: BTreeMap<Place, Vec<&Track>> = BTreeMap::new();
        for track in &self.tracks {
            animated.entry(track.place).or_default().push(track);
        }
        let mut problems = Vec::new();
        for (place, tracks) in animated {
            let frames: BTreeSet<i32> = tracks.iter().flat_map(|track| &track.frames).copied().collect();
            for frame in frames.into_iter().map(f64::from) {
                reader.rig(&self.alone_at(place, &tracks, frame));
                for problem in reader.problems.drain(..) {
                    // a value that is written is told before those that it leads to at keys of other fields
                    let written = tracks.iter().any(|track| track.is_written(frame, problem.offset));
                    problems.push((!written, at_frame(frame, problem)));
                }
            }
        }
        let first = problems.into_iter().min_by_key(|(between, problem)| (*between, problem.offset));
        first.map_or(Ok(()), |(_, problem)| Err(problem))
    }

    fn document_at(&self, frame: f64) -> Table {
        let mut document = self.document.clone();
        for track in &self.tracks {
            if let Some(table) = track.place.table_mut(&mut document) {
                table.put(track.entry(frame));
            }
        }
        document
    }

    /// A document of one animated table, all of whose `tracks` are given.
    fn alone_at(&self, place: Place, tracks: &[&Track], frame: f64) -> Table {
        let mut table = match place {
            Place::Rig => Table::default(),
            Place::List(..) => place.table(&self.document).cloned().unwrap_or_default(),
        };
        tracks.iter().for_each(|track| table.put(track.entry(frame)));
        let Place::List(list, _) = place else { return table };
        let offset = table.offset;
        let value = Value::List(vec![Item { offset, value: Value::Table(table) }]);
        Table { offset, entries: vec![Entry { key: list.to_owned(), offset, value }] }
    }
}

/// The problem that comes first in the text.
fn first(problems: Vec<Problem>) -> Option<Problem> {
    problems.into_iter().min_by_key(|problem| problem.offset)
}

fn at_frame(frame: f64, problem: Problem) -> Problem {
    Problem { message: format!("at frame {frame}: {}", problem.message), ..problem }
}

#[cfg(test)]
mod edit_tests;
#[cfg(test)]
mod tests;
