//! Path-traced references, kept between runs.
//!
//! A file is one case of one scene against one truth: a line that names the kind of file, a JSON header with its length
//! before it, and all images as little-endian `f32`, the two halves of direct light first, then those of the indirect
//! light for each number of bounces. A hash over the images ends it. The header holds the key: everything that the
//! images depend on. A file with another key is never used.

use std::io::Write;
use std::path::{Path, PathBuf};

use relume::glam::Vec3;
use relume::image::Image;
use relume::reference::{Paths, Settings};
use relume::{Error, LightKind, LightRig, Progress, Result, atomic_write};
use relume_io::rig_to_toml;
use relume_tests::truth::{Truth, Truths, trace_bounces};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::arguments::{Bounces, paths_name};
use crate::lights::Case;
use crate::progress::say;
use crate::shot::Shot;

const KIND: &[u8] = b"relume quality reference 1\n";

/// What all references of a run have in common.
#[derive(Clone, Debug)]
pub(crate) struct ReferenceSettings {
    /// Pixels: width and height.
    pub(crate) size: (usize, usize),
    /// Paths a pixel, both halves together.
    pub(crate) spp: u32,
    /// Numbers of indirect bounces.
    pub(crate) bounces: Vec<Bounces>,
}

/// Everything that a reference depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Key {
    /// Of the crate.
    version: String,
    /// Of the path tracer's sources.
    sources: String,
    scene_hash: String,
    /// As a rig file.
    rig: String,
    emission: bool,
    size: (usize, usize),
    spp: u32,
    bounces: Vec<Bounces>,
    paths: String,
}

#[derive(Serialize, Deserialize)]
struct Header {
    key: Key,
    /// xxh3 of the images' bytes.
    images_hash: String,
}

/// What the maps of a rig's domes hold, which its text only names.
fn maps(rig: &LightRig) -> String {
    let maps = rig.lights.iter().filter_map(|light| match &light.kind {
        LightKind::Dome { map: Some(map), .. } => Some(map.content_hash()),
        _ => None,
    });
    maps.map(|hash| format!("# map {hash:016x}\n")).collect()
}

/// A folder of references.
pub(crate) struct References {
    /// Where they are kept.
    pub(crate) folder: PathBuf,
    /// What they are traced with.
    pub(crate) settings: ReferenceSettings,
}

impl References {
    fn key(&self, shot: &Shot, case: &Case, paths: Paths) -> Key {
        Key {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            sources: env!("RELUME_REFERENCE_SOURCES").to_owned(),
            scene_hash: shot.hash.clone(),
            rig: format!("{}{}", rig_to_toml(&case.rig), maps(&case.rig)),
            emission: case.emission,
            size: self.settings.size,
            spp: self.settings.spp,
            bounces: self.settings.bounces.clone(),
            paths: paths_name(paths).to_owned(),
        }
    }

    fn path(&self, shot: &Shot, key: &Key) -> PathBuf {
        let hash = xxh3_64(format!("{key:?}").as_bytes());
        self.folder.join(format!("{}-{hash:016x}.reference", shot.name))
    }

    /// Whether there is a file for this reference, whatever state it is in.
    pub(crate) fn is_kept(&self, shot: &Shot, case: &Case, paths: Paths) -> bool {
        self.path(shot, &self.key(shot, case, paths)).is_file()
    }

    /// The kept reference; `None` where there is none, or one that is damaged or stale.
    ///
    /// # Errors
    /// Where the system refuses to read it.
    pub(crate) fn load(&self, shot: &Shot, case: &Case, paths: Paths) -> Result<Option<Truths>> {
        let key = self.key(shot, case, paths);
        let path = self.path(shot, &key);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::io(path, "read", error)),
        };
        let truths = decode(&bytes, &key);
        if truths.is_none() {
            say(&format!("{}: stale or damaged, traced again", path.display()));
        }
        Ok(truths)
    }

    /// The kept reference, or one traced now and kept. Its two renders are stages of `progress`.
    ///
    /// # Errors
    /// Where it cannot be traced, read or written.
    pub(crate) fn get(
        &self,
        shot: &mut Shot,
        case: &Case,
        paths: Paths,
        progress: &dyn Progress,
    ) -> Result<Truths> {
        if let Some(truths) = self.load(shot, case, paths)? {
            return Ok(truths);
        }
        self.trace(shot, case, paths, progress)
    }

    /// Traces the reference and keeps it in place of what was kept.
    ///
    /// # Errors
    /// Where it cannot be traced or written.
    pub(crate) fn trace(
        &self,
        shot: &mut Shot,
        case: &Case,
        paths: Paths,
        progress: &dyn Progress,
    ) -> Result<Truths> {
        shot.set_emission(case.emission);
        let settings = Settings {
            width: self.settings.size.0,
            height: self.settings.size.1,
            spp: self.settings.spp,
            paths,
            ..Settings::default()
        };
        let counts: Vec<_> = self.settings.bounces.iter().map(|bounces| bounces.0).collect();
        let Shot { scene, geometry, accel, .. } = &*shot;
        let truths = trace_bounces(scene, geometry, accel, &case.rig, &settings, &counts, progress);
        shot.set_emission(true);
        let truths = truths?;
        let key = self.key(shot, case, paths);
        write(&self.path(shot, &key), &key, &truths)?;
        Ok(truths)
    }
}

fn write(path: &Path, key: &Key, truths: &Truths) -> Result<()> {
    let images = std::iter::once(&truths.direct).chain(&truths.indirect).flat_map(|truth| &truth.halves);
    let channels = images.flat_map(|image| image.pixels.iter().flat_map(|pixel| pixel.to_array()));
    let bytes: Vec<u8> = channels.flat_map(f32::to_le_bytes).collect();
    let header = Header { key: key.clone(), images_hash: format!("{:016x}", xxh3_64(&bytes)) };
    let header = serde_json::to_vec(&header)
        .map_err(|error| Error::io(path, "write", std::io::Error::other(error)))?;
    let length = (header.len() as u64).to_le_bytes();
    atomic_write(path, |file| {
        [KIND, &length, &header, &bytes]
            .iter()
            .try_for_each(|part| file.write_all(part))
            .map_err(|error| Error::io(path, "write", error))
    })
}

/// The images of a file; `None` unless it is whole and of this key.
fn decode(bytes: &[u8], key: &Key) -> Option<Truths> {
    let (length, rest) = bytes.strip_prefix(KIND)?.split_first_chunk::<8>()?;
    let (header, images) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let header: Header = serde_json::from_slice(header).ok()?;
    let (width, height) = key.size;
    let image_bytes = width.checked_mul(height)?.checked_mul(12)?;
    let whole = images.len() == image_bytes.checked_mul(2 * (1 + key.bounces.len()))?
        && header.images_hash == format!("{:016x}", xxh3_64(images));
    if header.key != *key || !whole {
        return None;
    }
    let image = |bytes: &[u8]| {
        let (channels, _) = bytes.as_chunks::<4>();
        let (pixels, _) = channels.as_chunks::<3>();
        let pixels = pixels.iter().map(|pixel| Vec3::from_array(pixel.map(f32::from_le_bytes))).collect();
        Image { width, height, pixels }
    };
    let mut truths = images
        .chunks_exact(2 * image_bytes)
        .map(|pair| pair.split_at(image_bytes))
        .map(|(a, b)| Truth { halves: [image(a), image(b)] });
    Some(Truths { direct: truths.next()?, indirect: truths.collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lights::EMISSION;
    use relume::LightRig;
    use relume_tests::scenes::{box_room, omni, rig};

    fn references(folder: &Path) -> References {
        let bounces = vec![Bounces(Some(1)), Bounces(None)];
        let settings = ReferenceSettings { size: (16, 12), spp: 4, bounces };
        References { folder: folder.to_owned(), settings }
    }

    fn same(a: &Truths, b: &Truths) -> bool {
        let images = |truths: &Truths| {
            let all = std::iter::once(&truths.direct).chain(&truths.indirect);
            all.flat_map(|truth| truth.halves.clone()).collect::<Vec<_>>()
        };
        images(a) == images(b)
    }

    #[test]
    fn what_is_kept_comes_back_and_what_is_stale_does_not() {
        let folder = tempfile::tempdir().unwrap();
        let references = references(folder.path());
        let mut shot = Shot::new("room", box_room().scene);
        let case = |x| Case {
            name: "lamp".into(),
            rig: rig([omni(Vec3::new(x, 2.0, 2.0), Vec3::splat(10.0), 0.0)]),
            emission: false,
        };
        let lamp = case(2.0);
        assert!(references.load(&shot, &lamp, Paths::Transfer).unwrap().is_none());
        let traced = references.get(&mut shot, &lamp, Paths::Transfer, &()).unwrap();
        let kept = references.load(&shot, &lamp, Paths::Transfer).unwrap().unwrap();
        assert!(same(&kept, &traced) && kept.indirect.len() == 2);
        let [a, b] = &kept.indirect[1].halves;
        assert!(a != b && a.pixels.iter().any(|pixel| pixel.min_element() > 0.0), "two halves with light");
        // another light, truth, number of paths or scene is another key
        assert!(references.load(&shot, &case(2.1), Paths::Transfer).unwrap().is_none());
        assert!(references.load(&shot, &lamp, Paths::All).unwrap().is_none());
        let mut finer = self::references(folder.path());
        finer.settings.spp = 8;
        assert!(finer.load(&shot, &lamp, Paths::Transfer).unwrap().is_none());
        // even where its file has the right name, size and hash
        let path = references.path(&shot, &references.key(&shot, &lamp, Paths::Transfer));
        let stale = finer.path(&shot, &finer.key(&shot, &lamp, Paths::Transfer));
        std::fs::copy(&path, &stale).unwrap();
        assert!(finer.load(&shot, &lamp, Paths::Transfer).unwrap().is_none());
        let mut changed = box_room().scene;
        changed.materials[0].base_color.x += 0.01;
        assert!(references.load(&Shot::new("room", changed), &lamp, Paths::Transfer).unwrap().is_none());
    }

    #[test]
    fn damaged_files_are_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let references = references(folder.path());
        let mut shot = Shot::new("room", box_room().scene);
        let case = Case { name: EMISSION.into(), rig: LightRig::default(), emission: true };
        let traced = references.get(&mut shot, &case, Paths::All, &()).unwrap();
        let key = references.key(&shot, &case, Paths::All);
        let bytes = std::fs::read(references.path(&shot, &key)).unwrap();
        assert!(same(&decode(&bytes, &key).unwrap(), &traced));
        for length in (0..bytes.len()).step_by(37) {
            assert!(decode(&bytes[..length], &key).is_none(), "{length}");
        }
        for place in [0, 30, 40, bytes.len() - 1] {
            let mut altered = bytes.clone();
            altered[place] ^= 1;
            assert!(decode(&altered, &key).is_none(), "{place}");
        }
    }
}
