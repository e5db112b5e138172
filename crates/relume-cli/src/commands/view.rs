//! `relume view`: the window.

use std::path::PathBuf;

use clap::Args;
use relume::Result;

use super::prepare::QualityName;
use crate::arguments::{Threads, gather_count, image_size};
use crate::console::Console;

/// Open a window in which the shot is lit.
///
/// A scene can be lit at once, under direct light alone; indirect light comes within seconds and gets finer while you work. Once it is prepared it is
/// kept beside the scene, so that it is there at once the next time. A cache is there at once.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The scene (.glb, .gltf, .obj) or a cache of `relume prepare` [default: an empty window].
    shot: Option<PathBuf>,
    /// The lights [default: those of the scene].
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Width and height of the image in pixels, of a scene.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = image_size)]
    size: (usize, usize),
    /// The camera, by its name or number in the scene [default: the first].
    #[arg(long, value_name = "NAME|INDEX")]
    camera: Option<String>,
    /// Points that light is gathered from, a power of four, of a scene.
    #[arg(long, value_name = "N", default_value = "65536", value_parser = gather_count)]
    gather: usize,
    /// How well a scene is prepared in the end.
    #[arg(long, value_enum, default_value_t)]
    quality: QualityName,
    /// Where the prepared scene is kept [default: the scene's name with the ending .relume, beside it].
    #[arg(long, value_name = "CACHE.relume")]
    cache: Option<PathBuf>,
    /// The folder for unsaved edits, and for what is remembered of the window [default: where the system keeps such things].
    #[arg(long, value_name = "FOLDER")]
    state: Option<PathBuf>,
    /// Say on stderr after how many seconds the first picture, the first indirect light and the last transfer were there, and in the end how long edits took to be seen.
    #[arg(long)]
    times: bool,
    #[command(flatten)]
    threads: Threads,
}

const EXAMPLE: &str = "\
Example:
  relume view assets/arcade.glb --rig assets/rigs/arcade.toml
  relume view arcade.relume";

#[cfg(not(feature = "viewer"))]
pub(crate) fn run(_: &Arguments, _: &Console) -> Result<()> {
    Err(relume::Error::Setting(
        "this relume was built without its window; build it with `cargo install --path crates/relume-cli --features viewer`"
            .to_owned(),
    ))
}

#[cfg(feature = "viewer")]
pub(crate) fn run(arguments: &Arguments, _: &Console) -> Result<()> {
    use crate::output::check_output;
    use relume::transfer::Settings;
    use relume_viewer::{Dialogs, Options, Source};

    let times = arguments.times.then(std::time::Instant::now);
    if let Some(shot) = &arguments.shot {
        // told here, and not in a window that has nothing to show
        std::fs::File::open(shot).map_err(|error| relume::Error::io(shot, "read", error))?;
    }
    if let Some(cache) = &arguments.cache {
        check_output(cache, "the name of a cache", &["relume"], &[])?;
    }
    arguments.threads.start()?;
    let settings = Settings {
        size: arguments.size,
        gather: arguments.gather,
        quality: arguments.quality.into(),
        ..Settings::default()
    };
    let source = arguments.shot.as_ref().map(|path| Source {
        camera: arguments.camera.clone(),
        cache: arguments.cache.clone(),
        threads: arguments.threads.count(),
        settings: settings.clone(),
        ..Source::new(path)
    });
    let state = arguments.state.clone().or_else(relume_viewer::state_folder);
    let rig = arguments.rig.clone();
    let threads = arguments.threads.count();
    relume_viewer::run(Options { source, rig, state, settings, threads, dialogs: Dialogs::Native, times })
}
