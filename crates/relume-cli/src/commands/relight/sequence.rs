//! A sequence of frames.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Instant;

use relume::image::Tonemap;
use relume::{Error, LightRig, Progress, Relighter, Result};
use relume_io::{AnimatedRig, Attribute, frame_attributes, write_behind};
use serde::Serialize;

use super::destination::{Destination, Frame};
use super::{Arguments, enabled};
use crate::console::Console;
use crate::interrupt;
use crate::report::{Table, duration, plural, quantile};

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    cache: &'a Path,
    rig: &'a Path,
    /// As it was given, with its `#`.
    output: &'a Path,
    frames: usize,
    first: i32,
    last: i32,
    width: usize,
    height: usize,
    /// Enabled in some frame.
    lights: usize,
    preview: bool,
    /// Reading the cache and building the acceleration structure.
    load_seconds: f64,
    /// All frames, from the first one's beginning until the last one is written.
    seconds: f64,
    frames_per_minute: f64,
    /// Relighting one, the median.
    frame_ms: f64,
    /// The slowest of 95 frames in 100.
    frame_p95_ms: f64,
    /// Encoding and writing one, while the next is relit: the median.
    write_ms: f64,
    write_p95_ms: f64,
}

/// What each frame took.
#[derive(Default)]
struct Times {
    relighting: Vec<f64>,
    writing: Vec<f64>,
}

pub(super) fn run(arguments: &Arguments, path: &Path, console: &Console) -> Result<()> {
    let inputs = [arguments.cache.as_path(), path];
    let destination = Destination::new(arguments, &inputs, console)?;
    let animated = AnimatedRig::load(path)?;
    let frames = arguments.frames.clone().or_else(|| animated.frames()).ok_or_else(|| {
        Error::file(path, "has no [[animate]] table; add one, or say by --frames how many frames to write")
    })?;
    let maps: Vec<PathBuf> = animated.maps().collect();
    let inputs: Vec<&Path> = inputs.into_iter().chain(maps.iter().map(PathBuf::as_path)).collect();
    let lights = console.stage("checking the frames", || {
        destination.check(frames.clone(), &inputs)?;
        all_lights(&animated, frames.clone())
    })?;
    let (mut relighter, load_seconds) = arguments.load(&lights, path, console)?;
    check_frames(arguments, &animated, &relighter, (frames.clone(), path))?;
    let view = &relighter.transfer().view;
    let (width, height) = (view.width, view.height);
    let began = Instant::now();
    let times = relight(arguments, &animated, &mut relighter, &destination, (frames.clone(), console))?;
    let seconds = began.elapsed().as_secs_f64();
    let number = times.relighting.len();
    let figures = Figures {
        cache: &arguments.cache,
        rig: path,
        output: &arguments.output,
        frames: number,
        first: *frames.start(),
        last: *frames.end(),
        width,
        height,
        lights: enabled(&lights),
        preview: arguments.lighting.preview,
        load_seconds,
        seconds,
        frames_per_minute: 60.0 * number as f64 / seconds,
        frame_ms: quantile(times.relighting.clone(), 0.5),
        frame_p95_ms: quantile(times.relighting, 0.95),
        write_ms: quantile(times.writing.clone(), 0.5),
        write_p95_ms: quantile(times.writing, 0.95),
    };
    match destination {
        Destination::Stdout(_) => console.notice(&figures.to_string()),
        Destination::Files { .. } if arguments.json => console.json(&figures)?,
        Destination::Files { .. } => console.result(&figures.to_string())?,
    }
    Ok(())
}

/// Refuses a frame that this shot cannot show before any is made.
fn check_frames(
    arguments: &Arguments,
    animated: &AnimatedRig,
    relighter: &Relighter,
    (frames, path): (RangeInclusive<i32>, &Path),
) -> Result<()> {
    let settings = arguments.settings();
    for frame in frames {
        let told = |error: Error| Error::file(path, format!("at frame {frame}: {error}"));
        relighter.check(&animated.rig(f64::from(frame))?, &settings).map_err(told)?;
    }
    Ok(())
}

/// The first frame's rig, with those lights enabled that are so in any of `frames`. The rig can be read at each of these, then.
fn all_lights(animated: &AnimatedRig, frames: RangeInclusive<i32>) -> Result<LightRig> {
    let mut all = animated.rig(f64::from(*frames.start()))?;
    for frame in frames {
        let rig = animated.rig(f64::from(frame))?;
        for (light, now) in all.lights.iter_mut().zip(&rig.lights) {
            light.enabled |= now.enabled;
        }
    }
    Ok(all)
}

/// Relights and writes all frames.
fn relight(
    arguments: &Arguments,
    animated: &AnimatedRig,
    relighter: &mut Relighter,
    destination: &Destination,
    (frames, console): (RangeInclusive<i32>, &Console),
) -> Result<Times> {
    let settings = arguments.settings();
    let attributes: Vec<(String, Attribute)> = frame_attributes(relighter.transfer(), &settings);
    let tonemap: Tonemap = arguments.tonemap.unwrap_or_default().into();
    let progress = console.progress();
    progress.stage("relighting frames", frames.clone().count() as u64);
    let mut times = Times::default();
    let frames = frames.map(|number| {
        let rig = animated.rig(f64::from(number))?;
        let layers = relighter.relight_watched(&rig, &settings, &interrupt::Watch)?;
        times.relighting.push(relighter.stats().frame_ms);
        Ok(Frame { number, layers, exposure: rig.exposure })
    });
    write_behind(frames, |frame| {
        let began = Instant::now();
        destination.write(&frame, tonemap, &attributes)?;
        times.writing.push(began.elapsed().as_secs_f64() * 1e3);
        progress.advance(1);
        Ok(())
    })?;
    Ok(times)
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut table = Table::new();
        let output =
            if self.output == Path::new("-") { "stdout".into() } else { self.output.display().to_string() };
        table.line("images", format!("{output}, {}x{}", self.width, self.height));
        let frames = plural(self.frames, "frame", "frames");
        table.line("sequence", format!("{frames}, {} to {}", self.first, self.last));
        if self.preview {
            table.line("quality", "preview: lit coarsely".to_owned());
        }
        table.line("cache read in", duration(self.load_seconds));
        let rate = self.frames_per_minute;
        table.line("all frames", format!("{}, {rate:.0} frames a minute", duration(self.seconds)));
        let times = |median, p95| format!("{median:.1} ms, 95 in 100 within {p95:.1} ms");
        table.line("relighting one", times(self.frame_ms, self.frame_p95_ms));
        table.line("writing one", times(self.write_ms, self.write_p95_ms));
        table.line("lights", self.lights.to_string());
        write!(f, "{table}")
    }
}
