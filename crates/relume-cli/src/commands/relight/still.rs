//! One frame.

use std::path::Path;

use relume::Result;
use relume::relight::FrameStats;
use relume_io::{frame_attributes, load_rig};
use serde::Serialize;

use super::{Arguments, enabled};
use crate::console::Console;
use crate::output::ImageOutput;
use crate::report::{Table, count, culled, duration};

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    cache: &'a Path,
    rig: &'a Path,
    output: &'a Path,
    width: usize,
    height: usize,
    lights: usize,
    preview: bool,
    /// Reading the cache and building the acceleration structure.
    load_seconds: f64,
    #[serde(flatten)]
    frame: &'a FrameStats,
}

pub(super) fn run(arguments: &Arguments, path: &Path, console: &Console) -> Result<()> {
    let output = ImageOutput::new(&arguments.output, &[&arguments.cache, path])?;
    arguments.check_kind(Some(output.kind), console)?;
    let rig = load_rig(path)?;
    let (mut relighter, load_seconds) = arguments.load(&rig, path, console)?;
    let settings = arguments.settings();
    let layers = relighter.relight_watched(&rig, &settings, &console.progress())?;
    let tonemap = arguments.tonemap.unwrap_or_default().into();
    console.stage("writing the image", || {
        output.write(&layers, (rig.exposure, tonemap), frame_attributes(relighter.transfer(), &settings))
    })?;
    let figures = Figures {
        cache: &arguments.cache,
        rig: path,
        output: output.path(),
        width: layers.direct.width,
        height: layers.direct.height,
        lights: enabled(&rig),
        preview: settings.preview,
        load_seconds,
        frame: relighter.stats(),
    };
    if arguments.json { console.json(&figures) } else { console.result(&figures.to_string()) }
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let milliseconds = |name: &str, value: f64| [format!("  {name}"), format!("{value:.1} ms")];
        let mut table = Table::new();
        table.line("image", format!("{}, {}x{}", self.output.display(), self.width, self.height));
        if self.preview {
            table.line("quality", "preview: lit coarsely".to_owned());
        }
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
