//! Finished blocks in a file, so that an interrupted preparation goes on from there, and several machines share one.
//!
//! The file grows by a record whenever a block is done. What a kill leaves of a last record is cut off when work goes on. Blocks belong to one
//! *preparation*: the program's version, the kind of processor, the settings and the scene, which the file begins with. They are the same
//! bytes whoever computes them.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `relumebl` |
//! | 8 | length of the header, little-endian, as all numbers |
//! | 8 | xxh3 of the header |
//! | | the header: JSON, a [`Header`] |
//! | | records: operator (1 byte: 0 bounces, 1 final gather), number of the block (4), length (8), xxh3 of these and of the content (8), content |

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::{FORMAT_VERSION, Settings};
use crate::atomic::builder as temporary_file;
use crate::{Error, Result};

/// To be raised whenever the same settings give other blocks, so that none are mixed.
const MADE: u32 = 4;
const MAGIC: &[u8; 8] = b"relumebl";
const PLACE: usize = 13;
const RECORD: usize = PLACE + 8;
/// Longest header that is believed.
const LONGEST_HEADER: u64 = 1 << 20;
/// Longest block that is believed: four times the rows of the largest one as they are.
const LONGEST_BLOCK: u64 = 1 << 30;

/// One of several machines, or runs, that share a preparation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// Which one, from 1 on.
    pub number: u32,
    /// Of how many.
    pub of: u32,
}

impl Shard {
    /// Whether the block is one of its blocks: neighbours, which are about as hard, go to different shards.
    pub(super) fn has(self, block: u32) -> bool {
        block % self.of == self.number - 1
    }
}

/// What a file of blocks belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlocksOf {
    program: String,
    format: u32,
    /// How blocks are made: [`MADE`].
    made: u32,
    /// What kernels were chosen by: others round differently.
    processor: String,
    /// What is prepared.
    pub settings: Settings,
    /// Of which scene, as in [`super::Report::scene_hash`].
    pub scene_hash: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    of: BlocksOf,
    shard: Option<Shard>,
}

/// The operator that a block is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Part {
    Bounces,
    FinalGather,
}

impl Part {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Bounces => "bounces",
            Self::FinalGather => "final gather",
        }
    }
}

impl BlocksOf {
    pub(super) fn new(settings: Settings, scene_hash: String) -> Self {
        Self {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            format: FORMAT_VERSION,
            made: MADE,
            processor: processor(),
            settings,
            scene_hash,
        }
    }

    /// What the blocks of a file belong to, and whose share they are, if the work was shared.
    ///
    /// # Errors
    /// [`Error::File`] for other and for damaged files; [`Error::Io`].
    pub fn read(path: &Path) -> Result<(Self, Option<Shard>)> {
        check_is_file(path)?;
        let mut file = File::open(path).map_err(|error| Error::io(path, "read", error))?;
        let (header, _) = header(&mut file)
            .map_err(|error| Error::io(path, "read", error))?
            .ok_or_else(|| no_blocks(path))?;
        Ok((header.of, header.shard))
    }
}

/// The instructions that kernels of this program and of its libraries ask for.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    let found = [
        ("sse4.1", std::arch::is_x86_feature_detected!("sse4.1")),
        ("avx", std::arch::is_x86_feature_detected!("avx")),
        ("avx2", std::arch::is_x86_feature_detected!("avx2")),
        ("fma", std::arch::is_x86_feature_detected!("fma")),
        ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let found: [(&str, bool); 0] = [];
    let names = found.into_iter().filter(|&(_, there)| there).map(|(name, _)| name);
    [std::env::consts::ARCH].into_iter().chain(names).collect::<Vec<_>>().join(" ")
}

fn no_blocks(path: &Path) -> Error {
    Error::file(
        path,
        "holds no blocks of a preparation by this version; name a file that `relume prepare --shard` has left",
    )
}

fn checksum(parts: &[&[u8]]) -> u64 {
    let mut hash = Xxh3::new();
    parts.iter().for_each(|part| hash.update(part));
    hash.digest()
}

fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

/// The header and its length in the file; `None` where the file is something else.
fn header(file: &mut File) -> std::io::Result<Option<(Header, u64)>> {
    let mut begin = [0; 24];
    if !fills(file, &mut begin)? || &begin[..8] != MAGIC {
        return Ok(None);
    }
    let (length, seal) = (number(&begin[8..16]), number(&begin[16..]));
    if length > LONGEST_HEADER {
        return Ok(None);
    }
    let mut text = vec![0; length as usize];
    if !fills(file, &mut text)? || checksum(&[&text]) != seal {
        return Ok(None);
    }
    Ok(serde_json::from_slice(&text).ok().map(|header| (header, 24 + length)))
}

/// Whether there was as much to read.
fn fills(file: &mut File, bytes: &mut [u8]) -> std::io::Result<bool> {
    match file.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

fn place_of(part: Part, block: u32, length: u64) -> [u8; PLACE] {
    let mut place = [0; PLACE];
    place[0] = u8::from(part == Part::FinalGather);
    place[1..5].copy_from_slice(&block.to_le_bytes());
    place[5..].copy_from_slice(&length.to_le_bytes());
    place
}

/// Where records begin, and how long their contents are.
type Places = HashMap<(Part, u32), (u64, u64)>;

/// A file of blocks.
pub(super) struct BlockFile {
    path: PathBuf,
    open: Mutex<Open>,
    places: Places,
    /// Whether bytes followed that are no whole record.
    cut: bool,
    /// Whether blocks of other work are to be replaced.
    replaces: bool,
}

struct Open {
    /// None before there is anything to keep.
    file: Option<File>,
    /// Where the next record goes.
    end: u64,
    /// What a new file begins with.
    begin: Vec<u8>,
}

impl Open {
    /// The file, made anew before there is anything to keep: with all that it begins with, so that nobody who reads it meanwhile finds half of that.
    fn file(&mut self, path: &Path) -> std::io::Result<&mut File> {
        if self.file.is_none() {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let mut made = temporary_file().tempfile_in(folder.unwrap_or_else(|| Path::new(".")))?;
            made.write_all(&self.begin)?;
            lock(made.as_file())?;
            let file = made.persist(path).map_err(|failure| failure.error)?;
            self.end = self.begin.len() as u64;
            self.file = Some(file);
        }
        self.file.as_mut().ok_or_else(|| std::io::Error::other("no file"))
    }
}

/// Refuses a file that another run writes to.
fn lock(file: &File) -> std::io::Result<()> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(std::fs::TryLockError::WouldBlock) => Err(std::io::ErrorKind::ResourceBusy.into()),
        // where the file system knows no locks, there are none
        Err(std::fs::TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => Ok(()),
        Err(std::fs::TryLockError::Error(error)) => Err(error),
    }
}

/// Refuses what is no file, such as a pipe, whose end never comes.
fn check_is_file(path: &Path) -> Result<()> {
    match path.metadata() {
        Ok(metadata) if !metadata.is_file() => Err(Error::file(path, "is no regular file; name another one")),
        _ => Ok(()),
    }
}

impl BlockFile {
    /// A file that goes on from what it holds of the same work, and is made with the first block; blocks of other work are then replaced.
    ///
    /// # Errors
    /// [`Error::File`] where another kind of file is, or another run writes to it; [`Error::Io`].
    pub(super) fn resume(path: &Path, of: &BlocksOf, shard: Option<Shard>) -> Result<Self> {
        check_is_file(path)?;
        let refused = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::ResourceBusy => {
                Error::file(path, "is being written by another run; wait for that one, or name another cache")
            }
            _ => Error::io(path, "write", error),
        };
        let replaces = path.exists();
        if replaces {
            let mut file = File::options().read(true).write(true).open(path).map_err(refused)?;
            let mut begin = [0; 8];
            if !fills(&mut file, &mut begin).map_err(refused)? || begin != *MAGIC {
                return Err(Error::file(
                    path,
                    "is there already and no file of blocks; take it away, or name another cache",
                ));
            }
            lock(&file).map_err(refused)?;
            file.rewind().map_err(refused)?;
            let found = header(&mut file).map_err(refused)?.filter(|(header, _)| header.of == *of);
            if let Some((_, end)) = found {
                let opened = Self::of_records(path, file, end).map_err(refused)?;
                if let Open { file: Some(file), end, .. } = &*opened.open_file() {
                    file.set_len(*end).map_err(refused)?;
                }
                return Ok(opened);
            }
        }
        let text = serde_json::to_vec(&Header { of: of.clone(), shard })
            .map_err(|error| refused(std::io::Error::other(error)))?;
        let mut begin = MAGIC.to_vec();
        begin.extend((text.len() as u64).to_le_bytes());
        begin.extend(checksum(&[&text]).to_le_bytes());
        begin.extend(text);
        let open = Mutex::new(Open { file: None, end: 0, begin });
        Ok(Self { path: path.to_owned(), open, places: Places::new(), cut: false, replaces })
    }

    /// Blocks that another run has left, to be read.
    ///
    /// # Errors
    /// [`Error::File`] for files of other preparations; [`Error::Io`].
    pub(super) fn open(path: &Path, of: &BlocksOf) -> Result<Self> {
        check_is_file(path)?;
        let refused = |error| Error::io(path, "read", error);
        let mut file = File::open(path).map_err(refused)?;
        let (found, end) = header(&mut file).map_err(refused)?.ok_or_else(|| no_blocks(path))?;
        if found.of.scene_hash != of.scene_hash {
            return Err(Error::file(path, "holds blocks of another scene or camera; name those of this one"));
        }
        if found.of != *of {
            return Err(Error::file(
                path,
                "holds blocks of other settings, by another version, or by another kind of processor; name files of one preparation",
            ));
        }
        Self::of_records(path, file, end).map_err(refused)
    }

    /// Looks through the records that begin at `end`.
    fn of_records(path: &Path, mut file: File, mut end: u64) -> std::io::Result<Self> {
        let size = file.metadata()?.len();
        let mut places = Places::new();
        let mut record = [0; RECORD];
        file.seek(SeekFrom::Start(end))?;
        let mut content = Vec::new();
        while fills(&mut file, &mut record)? {
            let length = number(&record[5..PLACE]);
            if length > LONGEST_BLOCK || length > size - end.min(size) {
                break;
            }
            content.resize(length as usize, 0);
            let whole = fills(&mut file, &mut content)?;
            let seal = number(&record[PLACE..]);
            if !whole || record[0] > 1 || checksum(&[&record[..PLACE], &content]) != seal {
                break;
            }
            let part = if record[0] == 1 { Part::FinalGather } else { Part::Bounces };
            places.insert((part, number(&record[1..5]) as u32), (end, length));
            end += RECORD as u64 + length;
        }
        let open = Mutex::new(Open { file: Some(file), end, begin: Vec::new() });
        Ok(Self { path: path.to_owned(), open, places, cut: end < size, replaces: false })
    }

    fn open_file(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether bytes follow that are no whole record.
    pub(super) fn is_cut(&self) -> bool {
        self.cut
    }

    /// Whether blocks of other work are to be replaced.
    pub(super) fn replaces(&self) -> bool {
        self.replaces
    }

    /// Makes the file, with or without blocks.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn begin(&self) -> Result<()> {
        let made = self.open_file().file(&self.path).map(drop);
        made.map_err(|error| Error::io(&self.path, "write", error))
    }

    /// How many blocks were there when it was opened.
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// The content of a block that was there when the file was opened.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn get(&self, part: Part, block: u32) -> Result<Option<Vec<u8>>> {
        let Some(&(begin, length)) = self.places.get(&(part, block)) else { return Ok(None) };
        let mut record = vec![0; RECORD + length as usize];
        let read = match &mut self.open_file().file {
            Some(file) => file.seek(SeekFrom::Start(begin)).and_then(|_| file.read_exact(&mut record)),
            None => Err(std::io::ErrorKind::NotFound.into()),
        };
        read.map_err(|error| Error::io(&self.path, "read", error))?;
        let content = record.split_off(RECORD);
        if number(&record[PLACE..]) != checksum(&[&record[..PLACE], &content]) {
            return Err(Error::file(&self.path, "was altered while it was read; run the same command again"));
        }
        Ok(Some(content))
    }

    /// Adds a block. What a failed write leaves is taken away, and a file without blocks with it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn put(&self, part: Part, block: u32, content: &[u8]) -> Result<()> {
        let place = place_of(part, block, content.len() as u64);
        let mut record = place.to_vec();
        record.extend(checksum(&[&place, content]).to_le_bytes());
        record.extend(content);
        let mut open = self.open_file();
        // opened first: only then it is known where the next record goes
        let written = open.file(&self.path).map(drop).and_then(|()| {
            let end = open.end;
            let file = open.file(&self.path)?;
            file.seek(SeekFrom::Start(end))?;
            file.write_all(&record)
        });
        if let Err(error) = written {
            self.take_back(&mut open);
            return Err(Error::io(&self.path, "write", error));
        }
        open.end += record.len() as u64;
        Ok(())
    }

    fn take_back(&self, open: &mut Open) {
        // the job fails already: where this fails too, the next run cuts the rest off
        let _ = match &open.file {
            Some(file) if open.end > open.begin.len() as u64 => file.set_len(open.end),
            Some(_) => std::fs::remove_file(&self.path),
            None => Ok(()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(seed: u32) -> BlocksOf {
        BlocksOf::new(Settings { seed, ..Settings::default() }, "the scene".to_owned())
    }

    #[test]
    fn what_was_put_is_there_again_and_what_was_cut_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("blocks");
        let file = BlockFile::resume(&path, &of(0), None).unwrap();
        file.put(Part::Bounces, 3, b"three").unwrap();
        let first = path.metadata().unwrap().len();
        file.put(Part::FinalGather, 3, b"another three").unwrap();
        drop(file);
        let whole = std::fs::read(&path).unwrap();
        // cut anywhere within the last record, the first one is there, and work goes on after it
        for length in first..whole.len() as u64 {
            std::fs::write(&path, &whole[..length as usize]).unwrap();
            let file = BlockFile::resume(&path, &of(0), None).unwrap();
            assert_eq!((file.len(), file.is_cut()), (1, length > first));
            assert_eq!(file.get(Part::Bounces, 3).unwrap().unwrap(), b"three");
            file.put(Part::FinalGather, 4, b"four").unwrap();
            drop(file);
            let again = BlockFile::open(&path, &of(0)).unwrap();
            assert_eq!((again.len(), again.is_cut()), (2, false));
            assert_eq!(again.get(Part::FinalGather, 4).unwrap().unwrap(), b"four");
            assert!(again.get(Part::FinalGather, 3).unwrap().is_none());
        }
        // altered anywhere, nothing wrong is read
        for place in 0..whole.len() {
            let mut altered = whole.clone();
            altered[place] ^= 4;
            std::fs::write(&path, &altered).unwrap();
            let Ok(file) = BlockFile::open(&path, &of(0)) else { continue };
            assert!(file.is_cut(), "byte {place}");
            let there = file.get(Part::Bounces, 3).unwrap();
            assert!(there.is_none_or(|content| content == b"three"));
        }
    }

    #[test]
    fn blocks_of_other_work_are_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("blocks");
        let file = BlockFile::resume(&path, &of(0), None).unwrap();
        assert!(!path.exists(), "no file before there is a block");
        file.put(Part::Bounces, 0, b"zero").unwrap();
        let busy = BlockFile::resume(&path, &of(0), None).err().unwrap().to_string();
        assert!(busy.contains("is being written by another run"), "{busy}");
        drop(file);
        let refused = |of: &BlocksOf| BlockFile::open(&path, of).err().unwrap().to_string();
        assert!(refused(&of(1)).contains("of other settings"));
        assert!(refused(&BlocksOf { scene_hash: "another".to_owned(), ..of(0) }).contains("another scene"));
        assert_eq!(BlockFile::resume(&path, &of(0), None).unwrap().len(), 1);
        let anew = BlockFile::resume(&path, &of(1), None).unwrap();
        assert!(anew.len() == 0 && anew.replaces(), "work of other settings begins anew");
        assert_eq!(BlockFile::open(&path, &of(0)).unwrap().len(), 1, "not before there is a block");
        anew.put(Part::Bounces, 0, b"zero").unwrap();
        assert!(refused(&of(0)).contains("of other settings"));
        std::fs::write(&path, b"something else").unwrap();
        let in_the_way = BlockFile::resume(&path, &of(0), None).err().unwrap();
        assert!(in_the_way.to_string().contains("no file of blocks"));
        assert_eq!(std::fs::read(&path).unwrap(), b"something else");
        assert!(refused(&of(0)).contains("holds no blocks"));
        assert!(BlocksOf::read(&path).is_err());
    }

    #[test]
    fn shards_have_each_block_once() {
        for block in 0..20 {
            let having = (1..=3).filter(|&number| Shard { number, of: 3 }.has(block)).count();
            assert_eq!(having, 1);
        }
    }
}
