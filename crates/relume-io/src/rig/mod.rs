//! Light rigs as TOML files.
//!
//! ```toml
//! exposure = 0.0                      # stops; display images only
//! [[light]]
//! name = "key"
//! type = "spot"                       # omni | spot | distant | dome
//! position = [1.0, 4.0, 0.5]          # metres, world space
//! target = [0.0, 0.0, 0.0]
//! intensity = [60.0, 55.0, 50.0]      # W/sr, linear RGB
//! inner_angle = 20.0                  # degrees from the axis
//! outer_angle = 30.0
//! radius = 0.0                        # optional: metres, of the emitting sphere; 0 is a point
//! enabled = true                      # optional
//! [[light]]
//! name = "fill"
//! type = "omni"
//! position = [-2.0, 1.0, 0.0]
//! intensity = [5.0, 5.0, 6.0]
//! [[light]]
//! name = "sun"
//! type = "distant"
//! direction = [0.3, -1.0, 0.2]        # the way the light travels
//! irradiance = [3.0, 2.8, 2.5]        # W/m^2 at normal incidence, linear RGB
//! angle = 0.53                        # optional: diameter, degrees
//! [[light]]
//! name = "sky"
//! type = "dome"
//! map = "sky.hdr"                     # optional: equirectangular, .hdr or .exr, beside the rig; without it the same radiance everywhere
//! intensity = [1.0, 1.0, 1.0]         # optional: times the map, or W/(sr m^2); linear RGB
//! rotation = 0.0                      # optional: degrees about +Y
//! [[emitter]]                         # emissive materials that shine otherwise than in the scene
//! material = "lamp"                   # its name in the scene
//! scale = [0.5, 0.4, 0.3]             # times what it emits there, linear RGB
//! [[material]]                        # materials of another base colour than in the scene, in diffuse reflection
//! name = "wall"                       # its name in the scene
//! base_color = [0.7, 0.1, 0.1]        # in place of its factor; textures stay; linear RGB, 0 to 1
//! [[animate]]                         # a field that changes from frame to frame
//! light = "key"                       # or emitter = "lamp" (its material), or material = "wall"; none of them for the rig's exposure
//! field = "position"                  # any key of that table but `name` and `type`; it need not be written there
//! interpolation = "smooth"            # optional: smooth | linear | step
//! frames = [1, 24, 48]                # ascending whole numbers
//! values = [[1.0, 4.0, 0.5], [0.0, 4.0, 0.5], [0.0, 3.0, 0.5]] # one for each frame
//! ```
//!
//! Numbers and lists of numbers are interpolated component by component, text, true and false can only step. `smooth`, what they do by default, is a
//! monotone cubic: at rest at the first and the last key, and between two keys never outside their values. Before the first key and after the last one the
//! value holds. [`AnimatedRig`] gives the rig at any frame, [`load_rig`] at the first keyed one.
//!
//! The keys are the field names of [`relume::LightKind`], [`relume::Emitter`] and [`relume::MaterialEdit`]. Whatever is wrong is told with its line.

mod animation;
mod check;
mod keys;
mod parse;
mod toml_text;
mod value;

use std::io::{Read, Write};
use std::path::Path;

use relume::{Error, LightRig, Result, atomic_write};

pub use animation::{AnimatedRig, Curve, Field, Interpolation, Subject};
pub use toml_text::rig_to_toml;

/// No rig of thousands of lights comes near this; a larger file is something else.
const LARGEST_FILE: u64 = 16 << 20;

/// Reads a rig from a TOML file. Where it is animated, this is the rig at the first keyed frame; [`AnimatedRig`] has the others.
///
/// # Errors
/// [`Error::File`] with the line, what is wrong there and the mend; [`Error::Io`] where the file cannot be
/// read.
pub fn load_rig(path: impl AsRef<Path>) -> Result<LightRig> {
    parse_rig(&read_text(path.as_ref())?, path)
}

fn read_text(path: &Path) -> Result<String> {
    let refused = |error| Error::io(path, "read", error);
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(refused)?;
    file.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(refused)?;
    if bytes.len() as u64 > LARGEST_FILE {
        return Err(Error::file(path, "is larger than 16 MiB; a rig is a short TOML file"));
    }
    String::from_utf8(bytes).map_err(|error| {
        let line =
            1 + error.as_bytes()[..error.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::file(path, format!("line {line}: not UTF-8 text; save the rig as UTF-8"))
    })
}

/// Reads a rig from the text of a TOML file, as [`load_rig`]; `path` is named in errors, and maps of domes are looked for in its folder.
///
/// # Errors
/// [`Error::File`] with the first line at fault, what is wrong there and the mend.
pub fn parse_rig(text: &str, path: impl AsRef<Path>) -> Result<LightRig> {
    AnimatedRig::parse_with_first(text.to_owned(), path.as_ref()).map(|(_, first)| first)
}

/// Checks that every emitter of `rig`, which was read from `path`, names a material that shines, and every edit one that is there, of
/// `materials`: their names, and whether they emit anything.
///
/// # Errors
/// [`Error::File`] with the line of the first emitter or, if these are right, the first edit at fault.
pub fn check_materials<'m>(
    rig: &LightRig,
    path: impl AsRef<Path>,
    materials: impl Iterator<Item = (&'m str, bool)> + Clone,
) -> Result<()> {
    let path = path.as_ref();
    let emitters = rig.emitters_of(materials.clone());
    let Err(fault) = emitters.and_then(|_| rig.edits_of(materials.map(|(name, _)| name))) else {
        return Ok(());
    };
    // the file may have changed since; then there is no line to tell
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let line = parse::name_offset(&text, fault.list, fault.index).map(|offset| line_of(&text, offset));
    let place = line.map_or(String::new(), |line| format!("line {line}: "));
    Err(Error::file(path, format!("{place}{}", fault.message)))
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// Writes `rig` as a TOML file that [`load_rig`] reads back bit for bit. It is a rig of one moment: nothing in it is animated. The file appears
/// whole or not at all.
///
/// # Errors
/// [`Error::Setting`] for a rig that [`load_rig`] would refuse; [`Error::File`] and [`Error::Io`] as
/// [`atomic_write`].
pub fn save_rig(rig: &LightRig, path: impl AsRef<Path>) -> Result<()> {
    check::check_rig(rig)?;
    let path = path.as_ref();
    let text = rig_to_toml(rig);
    atomic_write(path, |file| {
        file.write_all(text.as_bytes()).map_err(|error| Error::io(path, "write", error))
    })
}

#[cfg(test)]
mod tests;
