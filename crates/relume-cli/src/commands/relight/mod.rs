//! `relume relight`: frames from a cache and a rig, one or a sequence.

mod destination;
mod numbering;
mod sequence;
mod still;

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{ArgGroup, Args};
use relume::relight::RelightSettings;
use relume::{Error, LightKind, LightRig, Relighter, Result, Transfer};
use relume_io::{ImageKind, check_materials};

use crate::arguments::{Curve, Lighting, Part, Threads};
use crate::console::Console;
use crate::interrupt;
use destination::Raw;

/// Relight a prepared shot: soft shadows and all bounces of indirect light, from the cache alone.
///
/// With --animate, a sequence of frames: files that are numbered, or raw pixels on stdout for another program to read. Where
/// that program goes away before the last frame, the job fails with status 1.
#[derive(Args)]
#[command(after_help = EXAMPLE, group = ArgGroup::new(LIGHTS).required(true))]
pub(crate) struct Arguments {
    /// The cache that `relume prepare` wrote.
    cache: PathBuf,
    /// The lights, how emissive materials shine, and base colours in place of the scene's (for diffuse reflection). Of an
    /// animated rig, its first keyed frame.
    #[arg(long, value_name = "RIG.toml", group = LIGHTS)]
    rig: Option<PathBuf>,
    /// The same, animated by values at keyed frames: a sequence of frames.
    #[arg(long, value_name = "RIG.toml", group = LIGHTS)]
    animate: Option<PathBuf>,
    /// Frames of the sequence, both included, or one [default: from the first keyed frame to the last].
    #[arg(long, value_name = "A..B", conflicts_with = "rig", allow_hyphen_values = true,
          value_parser = numbering::frames)]
    frames: Option<RangeInclusive<i32>>,
    /// The image to write: .exr is scene-linear with layers, .png is as a display shows it. Of a sequence, with one group of #
    /// for the frame's number, as in out.####.exr, or - for raw pixels on stdout, the top row first.
    #[arg(short, long, value_name = "OUT.exr|OUT.png|-")]
    output: PathBuf,
    /// The pixels on stdout [default: rgb24].
    #[arg(long, value_enum, value_name = "FORMAT", conflicts_with = "rig")]
    raw: Option<Raw>,
    #[command(flatten)]
    lighting: Lighting,
    /// Show one kind of light alone.
    #[arg(long, value_enum)]
    only: Option<Part>,
    /// Also write the layers of each light (EXR).
    #[arg(long)]
    per_light: bool,
    /// The curve from light to display (PNG and rgb24) [default: neutral].
    #[arg(long, value_enum)]
    tonemap: Option<Curve>,
    #[command(flatten)]
    threads: Threads,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// Where the lights come from: a rig, or an animated one.
const LIGHTS: &str = "lights";

const EXAMPLE: &str = "\
Example:
  relume prepare assets/arcade.glb -o arcade.relume
  relume relight arcade.relume --rig assets/rigs/arcade.toml -o arcade.exr --per-light
With base colours of its own, from the same cache:
  relume relight arcade.relume --rig assets/rigs/arcade_repainted.toml -o repainted.png
A sequence, in which a lantern is carried along, and a part of it:
  relume relight arcade.relume --animate assets/rigs/arcade_animated.toml -o lantern.####.png
  relume relight arcade.relume --animate assets/rigs/arcade_animated.toml --frames 12..16 -o part.####.exr
The same as a film, without files of its frames:
    relume relight arcade.relume --animate assets/rigs/arcade_animated.toml -o - |
      ffmpeg -f rawvideo -pix_fmt rgb24 -video_size 640x480 -framerate 24 -i - lantern.mp4";

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    match (&arguments.rig, &arguments.animate) {
        (Some(rig), _) => still::run(arguments, rig, console),
        (None, Some(rig)) => sequence::run(arguments, rig, console),
        (None, None) => Err(Error::Setting("no lights; give them by --rig or --animate".to_owned())),
    }
}

impl Arguments {
    fn settings(&self) -> RelightSettings {
        RelightSettings { only: Part::only(self.only), per_light: self.per_light, ..self.lighting.settings() }
    }

    /// Refuses, or warns of, options that do not go with what is written: `None` for pixels without a file.
    fn check_kind(&self, kind: Option<ImageKind>, console: &Console) -> Result<()> {
        if self.per_light && kind != Some(ImageKind::Exr) {
            let without = if kind.is_some() { "a PNG" } else { "a raw frame" };
            return Err(Error::Setting(format!(
                "--per-light needs layers, which {without} has not; write an .exr"
            )));
        }
        if self.tonemap.is_some() && kind == Some(ImageKind::Exr) {
            console.warning("--tonemap changes nothing in an EXR, which stays scene-linear");
        }
        Ok(())
    }

    /// The shot, ready to be relit by `rig`, which was read from `path`, and the seconds that this took. From here on the command answers
    /// to interrupts.
    fn load(&self, rig: &LightRig, path: &Path, console: &Console) -> Result<(Relighter, f64)> {
        interrupt::listen()?;
        self.threads.start()?;
        let began = Instant::now();
        let relighter = console.stage("reading the cache", || {
            let transfer = Transfer::load(&self.cache)?;
            check_materials(rig, path, transfer.report.named_materials())?;
            Ok(Relighter::new(transfer))
        })?;
        warn_of_darkness(rig, path, &relighter, console);
        Ok((relighter, began.elapsed().as_secs_f64()))
    }
}

/// How many lights of `rig` are enabled.
fn enabled(rig: &LightRig) -> usize {
    rig.lights.iter().filter(|light| light.enabled).count()
}

/// Tells of lights that may be missed.
fn warn_of_darkness(rig: &LightRig, path: &Path, relighter: &Relighter, console: &Console) {
    if enabled(rig) == 0 {
        console.warning(&format!("{}: no light is enabled", path.display()));
    }
    let transfer = relighter.transfer();
    if !transfer.report.settings.sky || !transfer.cloud.sky.is_empty() {
        return;
    }
    for light in rig.lights.iter().filter(|light| light.enabled) {
        if matches!(light.kind, LightKind::Dome { .. }) {
            console.warning(&format!(
                "{}: dome light `{}` adds nothing: the scene is closed, no sky lights what the camera sees",
                path.display(),
                light.name
            ));
        }
    }
}
