//! `relume demo`: the whole job on a scene inside the command, beside path-traced truth.

mod lantern;
mod sheet;
mod table;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use relume::image::{Layers, Tonemap};
use relume::reference::{self, Reference};
use relume::relight::RelightSettings;
use relume::transfer::Settings;
use relume::{Error, LightRig, Preparation, Relighter, Result, Scene, Transfer, atomic_write};
use relume_io::{ExrMeta, frame_attributes, save_rig, write_exr};

use super::reference::{Tracer, attributes as reference_attributes};
use crate::arguments::{Threads, image_size};
use crate::console::Console;
use crate::interrupt;
use crate::output::write_shown;
use crate::scene_file;
use table::{Figures, Frame};

/// Do the whole job on a small scene inside the command: prepare it, relight it while a lantern is carried through, and
/// path trace the same frames to judge them.
///
/// Writes the scene, its cache, a rig, an EXR and a PNG a frame, and `demo.png`: the relit frames above their
/// path-traced truth. Ends with a table of its own figures.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The folder to write to; made where it does not exist.
    #[arg(long, value_name = "DIR", default_value = "relume-demo")]
    out: PathBuf,
    /// Width and height of a frame in pixels.
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = image_size)]
    size: (usize, usize),
    /// Points that light is gathered from, a power of four.
    #[arg(long, value_name = "N", default_value = "16384", value_parser = crate::arguments::gather_count)]
    gather: usize,
    /// Paths a pixel of the truth.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    spp: u32,
    #[command(flatten)]
    threads: Threads,
}

const EXAMPLE: &str = "\
Example:
  relume demo --out relume-demo";

/// The scene, so that the command works wherever it is installed.
const SCENE: &[u8] = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/arcade.glb"));

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    interrupt::listen()?;
    arguments.threads.start()?;
    let rigs = lantern::rigs()?;
    let folder = Folder::create(&arguments.out)?;
    let scene = folder.scene(console)?;
    let began = Instant::now();
    let transfer = arguments.prepare(&scene, console)?;
    let cache = folder.path("arcade.relume");
    console.stage("writing the cache", || transfer.save(&cache))?;
    let mut figures = Figures::new(&transfer, began.elapsed().as_secs_f64());

    let relit = folder.relight(transfer, &rigs, &mut figures, console)?;
    let truth = folder.trace(&scene, &rigs, arguments, &mut figures, console)?;
    for ((frame, layers), reference) in figures.frames.iter_mut().zip(&relit).zip(&truth) {
        frame.judge(layers, reference);
    }
    let rows =
        [relit.iter().map(Layers::full).collect(), truth.iter().map(|truth| truth.layers.full()).collect()];
    let sheet = sheet::contact_sheet(&rows, rigs[0].exposure);
    sheet.write(&folder.path("demo.png"))?;
    console.result(&format!("{figures}\n\n{}", folder.next_steps()))
}

impl Arguments {
    fn prepare(&self, scene: &Scene, console: &Console) -> Result<Transfer> {
        Preparation::new(scene)
            .name("arcade.glb")
            .settings(Settings { size: self.size, gather: self.gather, ..Settings::default() })
            .run(&console.progress())
    }

    fn reference(&self) -> reference::Settings {
        let (width, height) = self.size;
        let settings = reference::Settings { width, height, ..Default::default() };
        reference::Settings { spp: super::reference::whole_halves(self.spp, settings.aa), ..settings }
    }
}

/// Where everything is written.
struct Folder(PathBuf);

impl Folder {
    fn create(path: &Path) -> Result<Self> {
        match std::fs::create_dir_all(path) {
            Ok(()) => Ok(Self(path.to_owned())),
            Err(_) if path.exists() => {
                Err(Error::file(path, "is there already and is no folder; name another one"))
            }
            Err(error) => Err(Error::io(path, "write", error)),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Unpacks the scene and reads it.
    fn scene(&self, console: &Console) -> Result<Scene> {
        let path = self.path("arcade.glb");
        atomic_write(&path, |file| {
            std::io::Write::write_all(file, SCENE).map_err(|error| Error::io(&path, "write", error))
        })?;
        Ok(scene_file::read(&path, console)?.scene)
    }

    /// Relights every frame; notes what the first took with all lights, and each later one with one light moved.
    fn relight(
        &self,
        transfer: Transfer,
        rigs: &[LightRig],
        figures: &mut Figures,
        console: &Console,
    ) -> Result<Vec<Layers>> {
        let mut relighter = Relighter::new(transfer);
        let settings = RelightSettings::default();
        let mut frames = Vec::with_capacity(rigs.len());
        for (number, rig) in (1..).zip(rigs) {
            let layers = relighter.relight_watched(rig, &settings, &interrupt::Watch)?;
            let milliseconds = relighter.stats().frame_ms;
            console.notice(&format!("frame {number} relit in {milliseconds:.0} ms"));
            figures.frames.push(Frame::relit_in(milliseconds));
            save_rig(rig, self.path(&format!("rig-{number}.toml")))?;
            let attributes = frame_attributes(relighter.transfer(), &settings);
            self.write(&format!("relit-{number}"), &layers, rig, attributes)?;
            frames.push(layers);
        }
        Ok(frames)
    }

    fn trace(
        &self,
        scene: &Scene,
        rigs: &[LightRig],
        arguments: &Arguments,
        figures: &mut Figures,
        console: &Console,
    ) -> Result<Vec<Reference>> {
        let tracer = Tracer::new(scene, console)?;
        let settings = arguments.reference();
        figures.spp = settings.spp;
        let mut frames = Vec::with_capacity(rigs.len());
        for ((number, rig), frame) in (1..).zip(rigs).zip(&mut figures.frames) {
            console.notice(&format!("frame {number} of {}, path traced for comparison", rigs.len()));
            let began = Instant::now();
            let reference = tracer.render(rig, &settings, &console.progress())?;
            frame.traced_seconds = began.elapsed().as_secs_f64();
            let attributes = reference_attributes(&settings, &reference.noise);
            self.write(&format!("truth-{number}"), &reference.layers, rig, attributes)?;
            frames.push(reference);
        }
        Ok(frames)
    }

    fn write(
        &self,
        name: &str,
        layers: &Layers,
        rig: &LightRig,
        attributes: Vec<(String, relume_io::Attribute)>,
    ) -> Result<()> {
        let meta = ExrMeta { attributes, ..ExrMeta::default() };
        write_exr(self.path(&format!("{name}.exr")), layers, &meta)?;
        write_shown(&self.path(&format!("{name}.png")), &layers.full(), (rig.exposure, Tonemap::default()))
    }

    fn next_steps(&self) -> String {
        let at = |name: &str| self.path(name).display().to_string();
        // as it was called: `cargo run` puts no `relume` on the path
        let relume = std::env::args().next().unwrap_or_else(|| "relume".to_owned());
        format!(
            "Look at {sheet}: the relit frames above their path-traced truth.\n\n\
             What to try next:\n  \
             edit {rig} and relight:  {relume} relight {cache} --rig {rig} -o mine.png\n  \
             how fast is this machine:  {relume} bench {cache} --rig {rig}\n  \
             a scene of your own:       {relume} prepare SCENE.glb && {relume} info SCENE.glb --rig lights.toml",
            sheet = at("demo.png"),
            rig = at("rig-1.toml"),
            cache = at("arcade.relume"),
        )
    }
}
