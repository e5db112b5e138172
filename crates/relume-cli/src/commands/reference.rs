//! `relume reference`: the truth by path tracing.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use relume::image::Image;
use relume::reference::{Noise, Paths, Reference, Settings, render};
use relume::sample::{ViewSamples, edge_pixels};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::{LightRig, Progress, Result, Scene};
use relume_io::{Attribute, ImageKind, bounces, check_materials, load_rig, own_number, own_text};
use serde::Serialize;

use crate::arguments::{Curve, Part, Threads, antialiasing, image_size};
use crate::console::Console;
use crate::interrupt;
use crate::output::ImageOutput;
use crate::report::{Table, duration, percent, plural};
use crate::scene_file;

/// Path trace a scene: the unbiased truth, with its own noise stated.
///
/// The noise is estimated from two independent halves of the paths. It is printed and, in an EXR, stored as layer
/// `noise` and attributes `relume:noise`, `relume:noise_direct` and `relume:noise_indirect` (relative L2).
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The scene: .glb, .gltf or .obj.
    scene: PathBuf,
    /// The lights, how emissive materials shine, and base colours in place of the scene's (for diffuse reflection). Lights stored in the
    /// scene do not shine; `relume info SCENE --rig` writes them out.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// The image to write: .exr is scene-linear with layers, .png is as a display shows it.
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    output: PathBuf,
    /// Paths a pixel, rounded up to whole halves of all its samples.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    spp: u32,
    /// Indirect bounces [default: all].
    #[arg(long, value_name = "N")]
    bounces: Option<u32>,
    /// Width and height of the image in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = image_size)]
    size: (usize, usize),
    /// The camera, by its name or number in the scene [default: the first].
    #[arg(long, value_name = "NAME|INDEX")]
    camera: Option<String>,
    /// Show one kind of light alone.
    #[arg(long, value_enum)]
    only: Option<Part>,
    /// Samples along each side of a pixel: 1 or 2.
    #[arg(long, value_name = "1|2", default_value = "2", value_parser = antialiasing)]
    aa: u32,
    /// Which light paths count.
    #[arg(long, value_enum, default_value_t)]
    paths: PathsName,
    /// Another seed gives independent noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
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
  relume reference assets/arcade.glb --rig assets/rigs/arcade.toml -o truth.exr --spp 64 --size 320x240";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum PathsName {
    /// What a renderer would show.
    #[default]
    All,
    /// Those that the transfer models: diffuse after the first surface.
    Transfer,
    /// Those that a transfer without reflections models (`prepare --no-glossy`).
    Diffuse,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    scene: &'a Path,
    rig: &'a Path,
    output: &'a Path,
    width: usize,
    height: usize,
    /// As rounded up.
    spp: u32,
    seconds: f64,
    /// Relative L2 of the shown light.
    noise: f64,
    noise_direct: f64,
    noise_indirect: f64,
    threads: usize,
    warnings: &'a [String],
}

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let output = ImageOutput::new(&arguments.output, &[&arguments.scene, &arguments.rig])?;
    if arguments.tonemap.is_some() && output.kind == ImageKind::Exr {
        console.warning("--tonemap changes nothing in an EXR, which stays scene-linear");
    }
    let rig = load_rig(&arguments.rig)?;
    interrupt::listen()?;
    arguments.threads.start()?;
    let imported = scene_file::read(&arguments.scene, console)?;
    let camera = scene_file::camera(&imported.scene, arguments.camera.as_deref(), &arguments.scene)?;
    check_materials(&rig, &arguments.rig, imported.scene.named_materials())?;
    let settings = arguments.settings(camera);
    let began = Instant::now();
    let tracer = Tracer::new(&imported.scene, console)?;
    let mut reference = tracer.render(&rig, &settings, &console.progress())?;
    if arguments.only == Some(Part::Indirect) {
        keep_indirect(&mut reference);
    }
    let seconds = began.elapsed().as_secs_f64();
    let tonemap = arguments.tonemap.unwrap_or_default().into();
    console.stage("writing the image", || {
        output.write(&reference.layers, (rig.exposure, tonemap), attributes(&settings, &reference.noise))
    })?;
    let figures = Figures {
        scene: &arguments.scene,
        rig: &arguments.rig,
        output: output.path(),
        width: settings.width,
        height: settings.height,
        spp: settings.spp,
        seconds,
        noise: reference.noise.full,
        noise_direct: reference.noise.direct,
        noise_indirect: reference.noise.indirect,
        threads: rayon::current_num_threads(),
        warnings: &imported.warnings,
    };
    if arguments.json { console.json(&figures) } else { console.result(&figures.to_string()) }
}

impl Arguments {
    fn settings(&self, camera: usize) -> Settings {
        let (width, height) = self.size;
        Settings {
            width,
            height,
            camera,
            spp: whole_halves(self.spp, self.aa),
            // Without bounces there is no indirect light, and no path is followed for it.
            bounces: if self.only == Some(Part::Direct) { Some(0) } else { self.bounces },
            aa: self.aa,
            paths: match self.paths {
                PathsName::All => Paths::All,
                PathsName::Transfer => Paths::Transfer,
                PathsName::Diffuse => Paths::DiffuseTransfer,
            },
            seed: self.seed,
            ..Settings::default()
        }
    }
}

/// Paths a pixel, the same for each of its samples and for both halves.
pub(super) fn whole_halves(spp: u32, aa: u32) -> u32 {
    spp.next_multiple_of(2 * aa * aa)
}

/// A scene ready to be path traced under any rig.
pub(super) struct Tracer<'a> {
    scene: &'a Scene,
    geometry: Geometry,
    accel: Accel,
}

impl<'a> Tracer<'a> {
    /// # Errors
    /// [`relume::Error::Cancelled`] where the command was interrupted before.
    pub(super) fn new(scene: &'a Scene, console: &Console) -> Result<Self> {
        console.stage("acceleration structure", || {
            let geometry = Geometry::new(scene);
            Ok(Self { scene, accel: Accel::new(scene, &geometry), geometry })
        })
    }

    /// A reference whose geometric edges are marked too.
    pub(super) fn render(
        &self,
        rig: &LightRig,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Reference> {
        let (scene, geometry, accel) = (self.scene, &self.geometry, &self.accel);
        let mut reference = render(scene, geometry, accel, rig, settings, progress)?;
        let size = (settings.width, settings.height);
        let camera = &scene.cameras[settings.camera];
        let (view, _) = ViewSamples::new(scene, geometry, accel, camera, size, progress)?;
        reference.layers.edges = edge_pixels(&view);
        Ok(reference)
    }
}

/// Takes the direct light out of the frame and out of its noise.
fn keep_indirect(reference: &mut Reference) {
    let direct = &mut reference.layers.direct;
    *direct = Image::new(direct.width, direct.height);
    let [a, b] = &reference.halves;
    if let Some(noise) = &mut reference.layers.noise {
        let halves = a.indirect.pixels.iter().zip(&b.indirect.pixels);
        noise.pixels = halves.map(|(a, b)| 0.5 * (*a - *b).abs()).collect();
    }
    reference.noise = Noise { full: reference.noise.indirect, direct: 0.0, ..reference.noise };
}

/// How the frame was made and how noisy it is, for its EXR header.
pub(super) fn attributes(settings: &Settings, noise: &Noise) -> Vec<(String, Attribute)> {
    vec![
        own_number("noise", noise.full),
        own_number("noise_direct", noise.direct),
        own_number("noise_indirect", noise.indirect),
        own_number("spp", settings.spp),
        own_number("aa", settings.aa),
        own_number("seed", settings.seed),
        own_text("bounces", bounces(settings.bounces)),
        own_text(
            "paths",
            match settings.paths {
                Paths::All => "all",
                Paths::Transfer => "transfer",
                Paths::DiffuseTransfer => "diffuse",
            },
        ),
    ]
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut table = Table::new();
        table.line("image", format!("{}, {}x{}", self.output.display(), self.width, self.height));
        table.line("paths a pixel", self.spp.to_string());
        let threads = plural(self.threads, "thread", "threads");
        table.line("time", format!("{} on {threads}", duration(self.seconds)));
        table.line(
            "noise",
            format!(
                "{} (direct {}, indirect {}; relative L2)",
                percent(self.noise),
                percent(self.noise_direct),
                percent(self.noise_indirect)
            ),
        );
        write!(f, "{table}")
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use relume::Error;

    /// Asks to stop as soon as the stage `at` has begun.
    struct Stopping {
        at: &'static str,
        begun: Mutex<Vec<String>>,
    }

    impl Progress for Stopping {
        fn stage(&self, name: &str, _: u64) {
            self.begun.lock().unwrap().push(name.to_owned());
        }

        fn cancelled(&self) -> bool {
            self.begun.lock().unwrap().iter().any(|name| name == self.at)
        }
    }

    #[test]
    fn every_pass_of_a_reference_is_told_and_can_be_stopped() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/arcade.glb");
        let scene = relume_io::load_scene(path.as_ref()).unwrap().scene;
        let tracer = Tracer::new(&scene, &Console::new(true)).unwrap();
        let settings = Settings { width: 12, height: 8, spp: 8, ..Settings::default() };
        let render = |at| {
            let listener = Stopping { at, begun: Mutex::default() };
            let outcome = tracer.render(&LightRig::default(), &settings, &listener);
            (outcome, listener.begun.into_inner().unwrap())
        };
        let stages = ["path tracing", "view samples"];
        let (outcome, begun) = render("none of them");
        assert_eq!(outcome.unwrap().layers.edges.len(), 96);
        assert_eq!(begun, stages);
        for (number, at) in (1..).zip(stages) {
            let (outcome, begun) = render(at);
            assert!(matches!(outcome, Err(Error::Cancelled)), "{at}");
            assert_eq!(begun, stages[..number]);
        }
    }
}
