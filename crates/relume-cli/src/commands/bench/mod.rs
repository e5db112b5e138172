//! `relume bench`: what a relit frame takes while one light moves, and how far that is above what the machine could do.

mod ceiling;
mod stages;

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

use clap::Args;
use relume::glam::Vec3;
use relume::relight::FrameStats;
use relume::{Error, Light, LightKind, LightRig, Relighter, Result, Transfer};
use relume_io::{check_materials, load_rig};
use serde::Serialize;

use crate::arguments::{Lighting, Threads};
use crate::console::Console;
use crate::memory::peak_resident_bytes;
use crate::report::{Table, bytes, count, culled, plural, quantile};

use ceiling::Ceiling;
use stages::Stage;

/// Measure a relit frame, stage by stage, while one light moves and the others stay.
///
/// The light goes once round a small circle; each frame relights it anew and takes the other lights from before. Then
/// as many frames change nothing but its colour. Figures are medians over the frames.
///
/// Beside each stage stands what it traces or moves, at which rate, and which share that is of this machine's ceiling, measured
/// last: memory read from start to end, and shadow rays that run side by side and meet nothing.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The cache that `relume prepare` wrote.
    cache: PathBuf,
    /// The lights, how emissive materials shine, and base colours in place of the scene's (for diffuse reflection).
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Frames to measure.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// The light that moves [default: the first enabled spot or omni, else the first enabled].
    #[arg(long, value_name = "NAME")]
    light: Option<String>,
    #[command(flatten)]
    lighting: Lighting,
    #[command(flatten)]
    threads: Threads,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example:
  relume prepare assets/arcade.glb -o arcade.relume
  relume bench arcade.relume --rig assets/rigs/arcade.toml --frames 100";

/// Radius of a moving light's circle, as a share of the cloud's diagonal.
const CIRCLE: f32 = 0.01;
/// Tangent of the angle by which a distant light turns.
const TURN: f32 = 0.03;

/// What `--json` prints. Times are medians over the frames.
#[derive(Serialize)]
struct Figures<'a> {
    cache: &'a Path,
    rig: &'a Path,
    light: &'a str,
    lights: usize,
    frames: u32,
    preview: bool,
    threads: usize,
    width: usize,
    height: usize,
    /// The first frame, with every light relit.
    first_frame_ms: f64,
    frame_ms: f64,
    /// The slowest of 95 frames in 100.
    frame_p95_ms: f64,
    direct_ms: f64,
    /// Direct light on the cloud, and its bounces within.
    bounces_ms: f64,
    /// The first of the two alone.
    cloud_ms: f64,
    gather_ms: f64,
    upsample_ms: f64,
    sum_ms: f64,
    /// A frame in which only the light's colour changes.
    color_change_ms: f64,
    shadow_rays: u64,
    bounce_steps: u32,
    /// Of each colour, in bounces and final gather.
    multiply_adds: u64,
    /// Those of them that were culled.
    culled: u64,
    /// Of all operators, as often as each is applied in a frame.
    transfer_bytes_per_frame: u64,
    /// These bytes over the time of bounces within the cloud and of the final gather.
    transfer_gb_per_s: f64,
    /// From reading the cache to the last frame; `null` where the system does not tell.
    peak_rss_bytes: Option<u64>,
    /// What this machine does at best.
    ceiling: Ceiling,
    /// Each stage beside it.
    stages: Vec<Stage>,
}

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let mut rig = load_rig(&arguments.rig)?;
    let moving = moving_light(&rig, arguments.light.as_deref(), &arguments.rig)?;
    arguments.threads.start()?;
    let mut relighter = console.stage("reading the cache", || {
        let transfer = Transfer::load(&arguments.cache)?;
        check_materials(&rig, &arguments.rig, transfer.report.named_materials())?;
        Ok(Relighter::new(transfer))
    })?;
    let settings = arguments.lighting.settings();
    relighter.relight(&rig, &settings)?;
    let first_frame_ms = relighter.stats().frame_ms;
    let still = rig.lights[moving].clone();
    let radius = CIRCLE * diagonal(relighter.transfer());
    let progress = console.progress();
    let mut frames = |name: &str, change: &dyn Fn(f32) -> Light| -> Result<Vec<FrameStats>> {
        relume::Progress::stage(&progress, name, u64::from(arguments.frames));
        (1..=arguments.frames)
            .map(|frame| {
                rig.lights[moving] = change(frame as f32 / arguments.frames as f32);
                relighter.relight(&rig, &settings)?;
                relume::Progress::advance(&progress, 1);
                Ok(*relighter.stats())
            })
            .collect()
    };
    let moved = frames("moving the light", &|turn| moved(&still, turn, radius))?;
    // From where it stands now, so that nothing is relit.
    let last = self::moved(&still, 1.0, radius);
    let recolored =
        frames("changing its colour", &|turn| last.with_color(last.color() * (1.0 + 0.5 * turn)))?;
    drop(progress);
    // before the ceiling, which takes memory of its own
    let peak_rss_bytes = peak_resident_bytes();
    let ceiling = console.stage("this machine's ceiling", || {
        Ok(Ceiling::measured(&relighter.transfer().view, relighter.accel()))
    })?;
    let figures = Figures {
        cache: &arguments.cache,
        rig: &arguments.rig,
        light: &still.name,
        lights: rig.lights.iter().filter(|light| light.enabled).count(),
        frames: arguments.frames,
        preview: settings.preview,
        first_frame_ms,
        peak_rss_bytes,
        ..Figures::of(relighter.transfer(), &moved, &recolored, ceiling)
    };
    if arguments.json { console.json(&figures) } else { console.result(&figures.to_string()) }
}

/// Index of the light to move.
fn moving_light(rig: &LightRig, wanted: Option<&str>, path: &Path) -> Result<usize> {
    let shines = |light: &&Light| light.enabled && light.color() != Vec3::ZERO;
    let place =
        |wanted: &dyn Fn(&Light) -> bool| rig.lights.iter().position(|light| shines(&light) && wanted(light));
    if let Some(wanted) = wanted {
        return place(&|light| light.name == wanted).ok_or_else(|| {
            let names: Vec<_> =
                rig.lights.iter().filter(shines).map(|light| format!("`{}`", light.name)).collect();
            Error::file(path, format!("no enabled light is called `{wanted}`; there is {}", names.join(", ")))
        });
    }
    place(&|light| !matches!(light.kind, LightKind::Distant { .. } | LightKind::Dome { .. }))
        .or_else(|| place(&|_| true))
        .ok_or_else(|| Error::file(path, "has no enabled light that could move; enable one"))
}

/// The light after a `turn` in `0..=1` round a circle of `radius` metres that lies level and touches its place.
fn moved(light: &Light, turn: f32, radius: f32) -> Light {
    let (sin, cos) = (turn * TAU).sin_cos();
    let step = radius * Vec3::new(cos - 1.0, 0.0, sin);
    let mut light = light.clone();
    match &mut light.kind {
        LightKind::Omni { position, .. } => *position += step,
        LightKind::Spot { position, target, .. } => {
            *position += step;
            *target += step;
        }
        LightKind::Distant { direction, .. } => {
            let (a, b) = direction.normalize_or(Vec3::NEG_Y).any_orthonormal_pair();
            *direction += direction.length() * TURN * ((cos - 1.0) * a + sin * b);
        }
        LightKind::Dome { rotation, .. } => *rotation += 360.0 * turn,
    }
    light
}

/// Across the box round the cloud, metres.
fn diagonal(transfer: &Transfer) -> f32 {
    let positions = || transfer.cloud.surfaces().iter().map(|sample| sample.position);
    let low = positions().fold(Vec3::splat(f32::INFINITY), Vec3::min);
    let high = positions().fold(Vec3::splat(f32::NEG_INFINITY), Vec3::max);
    low.distance(high)
}

fn median(frames: &[FrameStats], of: impl Fn(&FrameStats) -> f64) -> f64 {
    quantile(frames.iter().map(of).collect(), 0.5)
}

impl Figures<'_> {
    fn of(transfer: &Transfer, moved: &[FrameStats], recolored: &[FrameStats], ceiling: Ceiling) -> Self {
        let steps = median(moved, |frame| f64::from(frame.bounce_steps));
        let gathers = median(moved, |frame| f64::from(frame.gathers));
        let gathered = gathers * (transfer.gather.bytes() + transfer.glossy_bytes()) as f64;
        let touched = gathered + steps * transfer.bounce.bytes() as f64;
        let applying = median(moved, |frame| frame.bounces_ms + frame.gather_ms);
        Self {
            cache: Path::new(""),
            rig: Path::new(""),
            light: "",
            lights: 0,
            frames: 0,
            preview: false,
            threads: rayon::current_num_threads(),
            width: transfer.view.width,
            height: transfer.view.height,
            first_frame_ms: 0.0,
            frame_ms: median(moved, |frame| frame.frame_ms),
            frame_p95_ms: quantile(moved.iter().map(|frame| frame.frame_ms).collect(), 0.95),
            direct_ms: median(moved, |frame| frame.direct_ms),
            bounces_ms: median(moved, |frame| frame.cloud_ms + frame.bounces_ms),
            cloud_ms: median(moved, |frame| frame.cloud_ms),
            gather_ms: median(moved, |frame| frame.gather_ms),
            upsample_ms: median(moved, |frame| frame.upsample_ms),
            sum_ms: median(moved, |frame| frame.sum_ms),
            color_change_ms: median(recolored, |frame| frame.frame_ms),
            shadow_rays: median(moved, |frame| frame.shadow_rays as f64) as u64,
            bounce_steps: steps as u32,
            multiply_adds: median(moved, |frame| frame.multiply_adds as f64) as u64,
            culled: median(moved, |frame| frame.culled as f64) as u64,
            transfer_bytes_per_frame: touched as u64,
            transfer_gb_per_s: touched / (applying * 1e6),
            peak_rss_bytes: None,
            ceiling,
            stages: stages::of(transfer, moved, &ceiling),
        }
    }
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{}x{}, light `{}` of {} moving, {}, {}{}",
            self.width,
            self.height,
            self.light,
            self.lights,
            plural(self.frames as usize, "frame", "frames"),
            plural(self.threads, "thread", "threads"),
            if self.preview { ", preview" } else { "" },
        )?;
        let mut table = Table::of_numbers(&["median of", "ms", "", "rate", "of the ceiling"]);
        for stage in &self.stages {
            table.row(stage.cells());
        }
        for (name, value) in [
            ("frame", self.frame_ms),
            ("  95 in 100 within", self.frame_p95_ms),
            ("frame, only a colour changed", self.color_change_ms),
            ("first frame, all lights", self.first_frame_ms),
        ] {
            table.row([name.to_owned(), format!("{value:.2}"), String::new(), String::new(), String::new()]);
        }
        writeln!(f, "{table}")?;
        writeln!(
            f,
            "ceiling: {:.1} GB/s read from start to end, {:.1} million rays a second side by side",
            self.ceiling.read_gb_per_s, self.ceiling.mrays_per_s
        )?;
        writeln!(f, "peak memory: {}", self.peak_rss_bytes.map_or("not known".to_owned(), bytes))?;
        writeln!(f, "{}", culled(self.multiply_adds, self.culled))?;
        write!(
            f,
            "{} shadow rays, {} bounce steps, {} of transfer a frame at {:.2} GB/s",
            count(self.shadow_rays),
            self.bounce_steps,
            bytes(self.transfer_bytes_per_frame),
            self.transfer_gb_per_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(name: &str, kind: LightKind) -> Light {
        Light { name: name.to_owned(), enabled: true, kind }
    }

    fn distant() -> LightKind {
        LightKind::Distant { direction: Vec3::NEG_Y, irradiance: Vec3::ONE, angle: 0.0 }
    }

    fn omni() -> LightKind {
        LightKind::Omni { position: Vec3::ONE, intensity: Vec3::ONE, radius: 0.0 }
    }

    #[test]
    fn a_local_light_moves_before_a_distant_one() {
        let path = Path::new("rig.toml");
        let mut rig =
            LightRig { lights: vec![light("sun", distant()), light("key", omni())], ..LightRig::default() };
        assert_eq!(moving_light(&rig, None, path).unwrap(), 1);
        assert_eq!(moving_light(&rig, Some("sun"), path).unwrap(), 0);
        assert!(moving_light(&rig, Some("moon"), path).unwrap_err().to_string().contains("`sun`, `key`"));
        rig.lights[1].enabled = false;
        assert_eq!(moving_light(&rig, None, path).unwrap(), 0);
        rig.lights[0].enabled = false;
        assert!(moving_light(&rig, None, path).unwrap_err().is_bad_input());
    }

    #[test]
    fn moved_lights_come_back_and_are_elsewhere_in_between() {
        for kind in [omni(), distant()] {
            let still = light("a", kind);
            assert!(!moved(&still, 0.3, 0.1).same_but_for_color(&still));
            assert!(moved(&still, 0.0, 0.1).same_but_for_color(&still));
        }
        let LightKind::Omni { position, .. } = moved(&light("a", omni()), 0.5, 0.1).kind else { panic!() };
        assert!((position - Vec3::new(0.8, 1.0, 1.0)).length() < 1e-5);
    }
}
