//! `relume relight`: one frame from a cache and a rig.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use relume::relight::{FrameStats, RelightSettings};
use relume::{Error, LightKind, Relighter, Result, Transfer};
use relume_io::{Attribute, check_materials, load_rig};
use serde::Serialize;

use crate::arguments::{Culling, Curve, Part, Threads, antialiasing};
use crate::console::Console;
use crate::interrupt;
use crate::output::{self, ImageKind, ImageOutput, number, text};
use crate::report::{Table, count, culled, duration};

/// Relight a prepared shot: soft shadows and all bounces of indirect light, from the cache alone.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The cache that `relume prepare` wrote.
    cache: PathBuf,
    /// The lights, how emissive materials shine, and base colours in place of the scene's (for diffuse reflection).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// The image to write: .exr is scene-linear with layers, .png is as a display shows it.
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    output: PathBuf,
    /// Indirect bounces [default: all].
    #[arg(long, value_name = "N")]
    bounces: Option<u32>,
    /// Show one kind of light alone.
    #[arg(long, value_enum)]
    only: Option<Part>,
    /// Also write the layers of each light (EXR).
    #[arg(long)]
    per_light: bool,
    /// Direct samples along each side of a pixel: 1 or 2.
    #[arg(long, value_name = "1|2", default_value = "2", value_parser = antialiasing)]
    aa: u32,
    /// Light everything coarsely, as a light is while it is dragged: a quarter of the shadow rays, later bounces guessed.
    #[arg(long)]
    preview: bool,
    #[command(flatten)]
    cull: Culling,
    /// The curve from light to display (PNG) [default: neutral].
    #[arg(long, value_enum)]
    tonemap: Option<Curve>,
    #[command(flatten)]
    threads: Threads,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example:
  relume prepare assets/arcade.glb -o arcade.relume
  relume relight arcade.relume --rig assets/rigs/arcade.toml -o arcade.exr --per-light
With base colours of its own, from the same cache:
  relume relight arcade.relume --rig assets/rigs/arcade_repainted.toml -o repainted.png";

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    cache: &'a Path,
    rig: &'a Path,
    output: &'a Path,
    width: usize,
    height: usize,
    lights: usize,
    /// Reading the cache and building the acceleration structure.
    load_seconds: f64,
    #[serde(flatten)]
    frame: &'a FrameStats,
}

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let output = arguments.check(console)?;
    let rig = load_rig(&arguments.rig)?;
    interrupt::listen()?;
    arguments.threads.start()?;
    let began = Instant::now();
    let mut relighter = console.stage("reading the cache", || {
        let transfer = Transfer::load(&arguments.cache)?;
        check_materials(&rig, &arguments.rig, transfer.report.named_materials())?;
        Ok(Relighter::new(transfer))
    })?;
    let load_seconds = began.elapsed().as_secs_f64();
    let settings = RelightSettings {
        bounces: arguments.bounces,
        aa: arguments.aa,
        only: Part::only(arguments.only),
        per_light: arguments.per_light,
        cull: arguments.cull.epsilon,
        preview: arguments.preview,
    };
    let lights = rig.lights.iter().filter(|light| light.enabled).count();
    if lights == 0 {
        console.warning(&format!("{}: no light is enabled", arguments.rig.display()));
    }
    for light in rig.lights.iter().filter(|light| light.enabled) {
        let is_dome = matches!(light.kind, LightKind::Dome { .. });
        if is_dome && relighter.transfer().report.settings.sky && relighter.transfer().cloud.sky.is_empty() {
            console.warning(&format!(
                "{}: dome light `{}` adds nothing: the scene is closed, no sky lights what the camera sees",
                arguments.rig.display(),
                light.name
            ));
        }
    }
    let layers = relighter.relight_watched(&rig, &settings, &console.progress())?;
    let tonemap = arguments.tonemap.unwrap_or_default().into();
    console.stage("writing the image", || {
        output.write(&layers, (rig.exposure, tonemap), attributes(relighter.transfer(), &settings))
    })?;
    let figures = Figures {
        cache: &arguments.cache,
        rig: &arguments.rig,
        output: output.path(),
        width: layers.direct.width,
        height: layers.direct.height,
        lights,
        load_seconds,
        frame: relighter.stats(),
    };
    if arguments.json { console.json(&figures) } else { console.result(&figures.to_string()) }
}

impl Arguments {
    fn check(&self, console: &Console) -> Result<ImageOutput> {
        let output = ImageOutput::new(&self.output, &[&self.cache, &self.rig])?;
        if self.per_light && output.kind == ImageKind::Png {
            return Err(Error::Setting(
                "--per-light needs layers, which a PNG has not; write an .exr".into(),
            ));
        }
        if self.tonemap.is_some() && output.kind == ImageKind::Exr {
            console.warning("--tonemap changes nothing in an EXR, which stays scene-linear");
        }
        Ok(output)
    }
}

/// How the frame was made, for its EXR header. No times, so that the same frame gives the same bytes.
pub(super) fn attributes(transfer: &Transfer, settings: &RelightSettings) -> Vec<(String, Attribute)> {
    let report = &transfer.report;
    vec![
        text("scene", &report.scene),
        text("scene_hash", &report.scene_hash),
        text("bounces", output::bounces(settings.bounces)),
        number("aa", settings.aa),
        text("quality", if settings.preview { "preview" } else { "full" }),
        number("cull", settings.cull.unwrap_or_else(|| transfer.gather.encoding().cull())),
        number("gather_samples", transfer.cloud.len() as f64),
    ]
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let milliseconds = |name: &str, value: f64| [format!("  {name}"), format!("{value:.1} ms")];
        let mut table = Table::new();
        table.line("image", format!("{}, {}x{}", self.output.display(), self.width, self.height));
        table.line("cache read in", duration(self.load_seconds));
        table.line("frame", format!("{:.1} ms", self.frame.frame_ms));
        if self.frame.edits_ms > 0.0 {
            table.row(milliseconds("edited materials", self.frame.edits_ms));
        }
        table.row(milliseconds("direct", self.frame.direct_ms));
        table.row(milliseconds("cloud", self.frame.cloud_ms));
        table.row(milliseconds("bounces", self.frame.bounces_ms));
        table.row(milliseconds("final gather", self.frame.gather_ms));
        table.row(milliseconds("upsampling", self.frame.upsample_ms));
        table.row(milliseconds("sum", self.frame.sum_ms));
        table.line("lights", self.lights.to_string());
        table.line("shadow rays", count(self.frame.shadow_rays));
        table.line("transfer", culled(self.frame.multiply_adds, self.frame.culled));
        write!(f, "{table}")
    }
}
