//! `relume prepare`: from a scene to a cache.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use relume::sample::CloudMethod;
use relume::transfer::{
    BlocksOf, Encoding, EncodingError, Multibounce, PhotonSettings, Quality, RowMethod, Selection, Settings,
    Shard,
};
use relume::{Error, Preparation, Result, Transfer};
use serde::Serialize;

use crate::arguments::{Threads, gather_count, image_size, percent_of_light};
use crate::console::Console;
use crate::interrupt;
use crate::memory::{Limit, peak_resident_bytes};
use crate::output::check_output;
use crate::report::{Table, bytes, count, duration, percent, plural};
use crate::scene_file;

/// Prepare a scene for one camera: everything that does not depend on the lights, kept in one file.
///
/// The file holds all that relighting needs and can be moved to another machine without the scene.
#[derive(Args)]
#[command(after_help = EXAMPLE)]
pub(crate) struct Arguments {
    /// The scene: .glb, .gltf or .obj.
    scene: PathBuf,
    /// The cache to write [default: the scene's name with the ending .relume, beside it].
    #[arg(short, long, value_name = "CACHE.relume")]
    output: Option<PathBuf>,
    /// Width and height of the image in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = image_size)]
    size: (usize, usize),
    /// The camera, by its name or number in the scene [default: the first].
    #[arg(long, value_name = "NAME|INDEX")]
    camera: Option<String>,
    /// Points that light is gathered from, a power of four. More resolve light finer and take longer.
    #[arg(long, value_name = "N", default_value = "65536", value_parser = gather_count)]
    gather: usize,
    /// Where those points are dense.
    #[arg(long, value_enum, default_value_t)]
    cloud: CloudName,
    /// How much time and space to spend.
    #[arg(long, value_enum, default_value_t)]
    quality: QualityName,
    /// How far apart the points may lie at which indirect light is gathered, 0 to 1: a share of how far away what they see is. Between them it is
    /// interpolated. More is faster, smaller and coarser; 0 gathers for each pixel.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, allow_negative_numbers = true)]
    spacing: f32,
    /// Write a coarse cache within seconds, to be relit at once, a better one, and in the end the one that was asked for, each in place of the last.
    #[arg(long, conflicts_with = "shard")]
    in_steps: bool,
    /// Do shard I of N of the work, so that several machines share it. Its blocks are left beside the cache, and `relume merge` makes the cache
    /// of those of all shards.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,
    /// With --shard: do the shard's bounces alone, as a first step. Without it, each shard does all bounces that lie beside it in no file.
    #[arg(long, requires = "shard")]
    bounces_only: bool,
    /// Keep no finished blocks while preparing, from which the same command would go on after an interruption.
    #[arg(long, conflicts_with = "shard")]
    no_checkpoint: bool,
    /// How the transfer is stored.
    #[arg(long, value_enum, default_value_t)]
    encoding: EncodingName,
    /// What the encoding of diffuse light may lose, in percent of all light, 0.1 to 100 (low-rank); bounces may lose three times as much. The price of a byte
    /// is looked for from a sixteenth of what --quality pays to 256 times as much [default: what --quality pays for, usually 2 to 8].
    #[arg(long, value_name = "PERCENT", value_parser = percent_of_light)]
    error: Option<f32>,
    /// By what it chooses the coefficients that it keeps [default: prior for low-rank, area for the others].
    #[arg(long, value_enum)]
    selection: Option<SelectionName>,
    /// Coefficients that haar-rows and haar-blocks keep a row, 1 to 4096.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=4096))]
    coefficients: u16,
    /// How the transfer is estimated.
    #[arg(long, value_enum, default_value_t)]
    rows: RowsName,
    /// How light goes on from surface to surface.
    #[arg(long, value_enum, default_value_t)]
    multibounce: MultibounceName,
    #[command(flatten)]
    photons: Photons,
    /// Leave out reflections, but for those of mirrors and glass: indirect light is then diffuse. Faster and smaller.
    #[arg(long)]
    no_glossy: bool,
    /// Leave out the sky: all gather samples are then of surfaces, and dome lights cannot be used.
    #[arg(long)]
    no_sky: bool,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    memory: Limit,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

const EXAMPLE: &str = "\
Example:
  relume prepare assets/arcade.glb -o arcade.relume --size 640x480 --quality standard";

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub(crate) enum QualityName {
    /// For the first seconds.
    Glance,
    /// For a first look.
    Draft,
    /// For lighting.
    #[default]
    Standard,
    /// For the last picture.
    Final,
}

impl From<QualityName> for Quality {
    fn from(name: QualityName) -> Self {
        match name {
            QualityName::Glance => Self::Glance,
            QualityName::Draft => Self::Draft,
            QualityName::Standard => Self::Standard,
            QualityName::Final => Self::Final,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum EncodingName {
    /// Blocks of pixels share a basis; small and fast.
    #[default]
    LowRank,
    /// Every pixel keeps its own Haar coefficients (Hasan 2006), for comparison.
    HaarRows,
    /// The same, packed as images of wavelet lights (Hasan 2006), for comparison.
    HaarBlocks,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SelectionName {
    /// By value times the area that a coefficient covers (Hasan 2006).
    Area,
    /// By value alone.
    Plain,
    /// By value times what the coefficient is worth under random lights in the scene.
    Prior,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum CloudName {
    /// Everywhere alike.
    Uniform,
    /// Where much of the picture gets its light from (Hasan 2006).
    Importance,
    /// Where single pixels get much of their light from, as in corners.
    #[default]
    Adaptive,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum RowsName {
    /// Hemisphere rays and form factors, balanced.
    #[default]
    Balanced,
    /// The paper's cluster cut with clamped entries, for comparison.
    Paper,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum MultibounceName {
    /// One bounce, gathered as pixels gather, and applied again and again.
    #[default]
    Iterated,
    /// All bounces at once, from photons (after Hasan 2006), for comparison. Relights in one step. Bounces cannot be told apart: `relight
    /// --bounces` is 0 or all, or 1 where nothing emits light. Materials keep their colours.
    Photon,
}

/// What photons are shot with.
#[derive(Args, Clone, Copy, Debug)]
struct Photons {
    /// Photons to shoot, with --multibounce photon [default: 1000000].
    #[arg(long = "photons", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    count: Option<u32>,
    /// Photons that a row is made of, 1 to 65536 [default: 2000].
    #[arg(long = "photons-per-row", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    nearest: Option<u32>,
    /// Surfaces that a photon hits at most, 1 to 64; the paper has 3 [default: as many as their albedo lets it].
    #[arg(long = "photon-path", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    path_length: Option<u32>,
}

impl Photons {
    /// # Errors
    /// [`Error::Setting`] where some are set and none are shot.
    fn settings(self, multibounce: MultibounceName) -> Result<PhotonSettings> {
        let set = [
            self.count.map(|_| "--photons"),
            self.nearest.map(|_| "--photons-per-row"),
            self.path_length.map(|_| "--photon-path"),
        ];
        if multibounce != MultibounceName::Photon
            && let Some(name) = set.into_iter().flatten().next()
        {
            return Err(Error::Setting(format!(
                "{name} needs photons; add --multibounce photon, or leave it out"
            )));
        }
        let default = PhotonSettings::default();
        Ok(PhotonSettings {
            count: self.count.map_or(default.count, |count| count as usize),
            nearest: self.nearest.map_or(default.nearest, |nearest| nearest as usize),
            path_length: self.path_length,
        })
    }
}

/// What `--json` prints.
#[derive(Serialize)]
struct Figures<'a> {
    scene: &'a Path,
    cache: &'a Path,
    /// Everything from reading the scene to the cache on disk.
    seconds: f64,
    /// `null` where the system does not tell.
    peak_rss_bytes: Option<u64>,
    /// `null` without --memory.
    memory_limit_bytes: Option<u64>,
    cache_bytes: u64,
    bytes_per_pixel: f64,
    rays_per_pixel: f64,
    rays_per_gather_sample: f64,
    gather_bytes: usize,
    /// 0 without reflections.
    glossy_bytes: usize,
    bounce_bytes: usize,
    gather_encoding_error: EncodingError,
    /// `null` without reflections.
    glossy_encoding_error: Option<EncodingError>,
    bounce_encoding_error: EncodingError,
    triangles: u64,
    gather_samples: usize,
    /// Those of them that are of the sky.
    sky_samples: usize,
    lit_pixels: usize,
    receivers: usize,
    scene_hash: &'a str,
    threads: usize,
    settings: &'a Settings,
    stages: Vec<Stage<'a>>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct Stage<'a> {
    name: &'a str,
    seconds: f64,
}

pub(crate) fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    let began = Instant::now();
    let cache = arguments.output.clone().unwrap_or_else(|| arguments.scene.with_extension("relume"));
    check_output(&cache, "the name of a cache", &["relume"], &[&arguments.scene])?;
    let photons = arguments.photons.settings(arguments.multibounce)?;
    interrupt::listen()?;
    arguments.threads.start()?;
    let imported = scene_file::read(&arguments.scene, console)?;
    let read = began.elapsed().as_secs_f64();
    let camera = scene_file::camera(&imported.scene, arguments.camera.as_deref(), &arguments.scene)?;
    let mut preparation = Preparation::new(&imported.scene)
        .name(scene_file::name(&arguments.scene))
        .settings(arguments.settings(camera, photons));
    preparation = arguments.memory.of(preparation)?;
    if let Some(shard) = arguments.shard {
        return blocks_of_shard(preparation, shard, arguments, (&cache, began), console);
    }
    let kept = cache.with_extension(BLOCKS);
    if !arguments.no_checkpoint {
        preparation = preparation.checkpoint(&kept);
    }
    let prepared = if arguments.in_steps {
        let show = |transfer: Transfer| {
            console.stage("writing a coarser cache", || transfer.save(&cache))?;
            let after = duration(began.elapsed().as_secs_f64());
            console.notice(&format!("{} can be relit after {after}; a finer one follows", cache.display()));
            Ok(())
        };
        preparation.run_in_steps(&console.progress(), show)
    } else {
        preparation.run(&console.progress())
    };
    let (scene, memory) = (&arguments.scene, arguments.memory);
    let saved = Saved { scene, cache: &cache, began, read, memory, warnings: &imported.warnings };
    let saved = prepared.and_then(|transfer| saved.save(&transfer, arguments.json, console));
    if saved.is_err() && !arguments.no_checkpoint {
        tell_of_blocks(&kept, console);
    }
    saved?;
    if !arguments.no_checkpoint && kept.exists() {
        std::fs::remove_file(&kept).map_err(|error| Error::io(&kept, "remove", error))?;
    }
    Ok(())
}

/// Says what an unfinished job has left; nothing of what another version has left there, which is gone with the first block.
fn tell_of_blocks(kept: &Path, console: &Console) {
    if BlocksOf::read(kept).is_ok() {
        console
            .notice(&format!("{} holds what is done: the same command goes on from there", kept.display()));
    }
}

/// What is reported of a transfer beside itself.
pub(crate) struct Saved<'a> {
    pub(crate) scene: &'a Path,
    pub(crate) cache: &'a Path,
    /// The command.
    pub(crate) began: Instant,
    /// Seconds that reading the scene took.
    pub(crate) read: f64,
    pub(crate) memory: Limit,
    pub(crate) warnings: &'a [String],
}

impl Saved<'_> {
    /// Writes the cache and tells what it is.
    ///
    /// # Errors
    /// As of [`Transfer::save`] and [`Console::result`].
    pub(crate) fn save(&self, transfer: &Transfer, json: bool, console: &Console) -> Result<()> {
        let Self { scene, cache, began, read, memory, warnings } = *self;
        let writing = Instant::now();
        console.stage("writing the cache", || transfer.save(cache))?;
        let mut stages = vec![Stage { name: "reading the scene", seconds: read }];
        let between = transfer.timings.stages.iter();
        stages.extend(between.map(|(name, seconds)| Stage { name, seconds: *seconds }));
        stages.push(Stage { name: "writing the cache", seconds: writing.elapsed().as_secs_f64() });
        let figures = Figures {
            scene,
            cache,
            seconds: began.elapsed().as_secs_f64(),
            peak_rss_bytes: peak_resident_bytes(),
            memory_limit_bytes: memory.bytes,
            cache_bytes: cache.metadata().map_err(|error| Error::io(cache, "read", error))?.len(),
            stages,
            warnings,
            ..Figures::of(transfer)
        };
        if json { console.json(&figures) } else { console.result(&figures.to_string()) }
    }
}

/// Ending of files of finished blocks.
pub(crate) const BLOCKS: &str = "relume-blocks";

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    let shard = parts.map(|(number, of)| Shard { number, of });
    let known =
        shard.filter(|shard| (1..=4096).contains(&shard.of) && (1..=shard.of).contains(&shard.number));
    known.ok_or_else(|| "must be I/N, as 2/8: the second of eight; at most 4096".to_owned())
}

/// What `--json` prints of a shard.
#[derive(Serialize)]
struct ShardFigures<'a> {
    scene: &'a Path,
    blocks_file: &'a Path,
    shard: Shard,
    bounces_only: bool,
    /// Blocks of this part of the work.
    blocks: usize,
    seconds: f64,
    peak_rss_bytes: Option<u64>,
    memory_limit_bytes: Option<u64>,
    file_bytes: u64,
}

/// Does one part of the work.
fn blocks_of_shard(
    preparation: Preparation<'_>,
    shard: Shard,
    arguments: &Arguments,
    (cache, began): (&Path, Instant),
    console: &Console,
) -> Result<()> {
    let of_shard = |number: u32| cache.with_extension(format!("{number}-of-{}.{BLOCKS}", shard.of));
    let own = of_shard(shard.number);
    let others = (1..=shard.of).filter(|&number| number != shard.number).map(of_shard);
    let others = others.filter(|path| path.exists());
    let preparation = preparation.checkpoint(&own).finished_blocks(others);
    let blocks = preparation.run_shard(shard, arguments.bounces_only, &console.progress());
    if blocks.is_err() {
        tell_of_blocks(&own, console);
    }
    let blocks = blocks?;
    let figures = ShardFigures {
        scene: &arguments.scene,
        blocks_file: &own,
        shard,
        bounces_only: arguments.bounces_only,
        blocks,
        seconds: began.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_resident_bytes(),
        memory_limit_bytes: arguments.memory.bytes,
        file_bytes: own.metadata().map_or(0, |metadata| metadata.len()),
    };
    if arguments.json {
        return console.json(&figures);
    }
    let mut table = Table::new();
    table.line("shard", format!("{} of {}, {}", shard.number, shard.of, plural(blocks, "block", "blocks")));
    table.line("time", duration(figures.seconds));
    table.line("blocks", format!("{}, {}", own.display(), bytes(figures.file_bytes)));
    table.line("peak memory", arguments.memory.told(figures.peak_rss_bytes));
    console.result(&table.to_string())
}

impl Arguments {
    fn settings(&self, camera: usize, photons: PhotonSettings) -> Settings {
        Settings {
            size: self.size,
            camera,
            gather: self.gather,
            cloud: match self.cloud {
                CloudName::Uniform => CloudMethod::Uniform,
                CloudName::Importance => CloudMethod::Importance,
                CloudName::Adaptive => CloudMethod::Adaptive,
            },
            quality: self.quality.into(),
            spacing: self.spacing,
            encoding: match self.encoding {
                EncodingName::LowRank => Encoding::LowRank,
                EncodingName::HaarRows => Encoding::HaarRows,
                EncodingName::HaarBlocks => Encoding::HaarBlocks,
            },
            error: self.error.map(|percent| percent / 100.0),
            selection: self.selection.map(|selection| match selection {
                SelectionName::Area => Selection::Area,
                SelectionName::Plain => Selection::Plain,
                SelectionName::Prior => Selection::Prior,
            }),
            rows: match self.rows {
                RowsName::Balanced => RowMethod::Balanced,
                RowsName::Paper => RowMethod::Paper,
            },
            multibounce: match self.multibounce {
                MultibounceName::Iterated => Multibounce::Iterated,
                MultibounceName::Photon => Multibounce::Photon,
            },
            photons,
            glossy: !self.no_glossy,
            sky: !self.no_sky,
            coefficients: usize::from(self.coefficients),
            seed: self.seed,
        }
    }
}

/// How many gather samples are of the sky, and why none.
pub(crate) fn of_the_sky(samples: usize, settings: &Settings) -> String {
    match (samples, settings.sky) {
        (0, true) => "none of the sky, which does not show".to_owned(),
        (0, false) => "without the sky".to_owned(),
        (samples, _) => format!("{} of the sky", count(samples as u64)),
    }
}

/// The expected errors of the encodings of the diffuse and the glossy final gather and of the bounces, a line for each kind of lights.
pub(crate) fn add_encoding_errors(
    table: &mut Table,
    gather: EncodingError,
    glossy: Option<EncodingError>,
    bounces: EncodingError,
) {
    let all = [("diffuse", Some(gather)), ("glossy", glossy), ("bounces", Some(bounces))];
    let told = |of: fn(&EncodingError) -> Option<f64>| {
        let errors = all.iter().filter_map(|(name, error)| Some((name, of(error.as_ref()?)?)));
        errors.map(|(name, error)| format!("{} {name}", percent(error))).collect::<Vec<_>>().join(", ")
    };
    let (expected, others) = (told(|error| error.expected), told(|error| error.other_lights));
    let unknown = "unknown: no light that was tried reaches anything".to_owned();
    table
        .line("encoding error", if expected.is_empty() { unknown } else { format!("{expected} (expected)") });
    if !others.is_empty() {
        table.line("  other lights", format!("{others} (of kinds that were not learned from)"));
    }
}

impl<'a> Figures<'a> {
    /// What the transfer itself tells.
    fn of(transfer: &'a Transfer) -> Self {
        let report = &transfer.report;
        Self {
            scene: Path::new(""),
            cache: Path::new(""),
            seconds: 0.0,
            peak_rss_bytes: None,
            memory_limit_bytes: None,
            cache_bytes: 0,
            bytes_per_pixel: transfer.bytes_per_pixel(),
            rays_per_pixel: report.rays_per_pixel,
            rays_per_gather_sample: report.rays_per_gather_sample,
            gather_bytes: transfer.gather.bytes(),
            glossy_bytes: transfer.glossy_bytes(),
            bounce_bytes: transfer.bounce.bytes(),
            gather_encoding_error: report.gather_error,
            glossy_encoding_error: report.glossy_error,
            bounce_encoding_error: report.bounce_error,
            triangles: report.triangles,
            gather_samples: transfer.cloud.len(),
            sky_samples: transfer.cloud.sky.len(),
            lit_pixels: transfer.lit_pixels(),
            receivers: transfer.gather.rows,
            scene_hash: &report.scene_hash,
            threads: rayon::current_num_threads(),
            settings: &report.settings,
            stages: Vec::new(),
            warnings: &[],
        }
    }
}

impl std::fmt::Display for Figures<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (width, height) = self.settings.size;
        let mut table = Table::new();
        table.line(
            "image",
            format!(
                "{width}x{height}, {} pixels lit, {} receivers",
                count(self.lit_pixels as u64),
                count(self.receivers as u64)
            ),
        );
        table.line(
            "scene",
            format!(
                "{} triangles, {} gather samples, {}",
                count(self.triangles),
                count(self.gather_samples as u64),
                of_the_sky(self.sky_samples, self.settings)
            ),
        );
        let threads = plural(self.threads, "thread", "threads");
        table.line("time", format!("{} on {threads}", duration(self.seconds)));
        for stage in &self.stages {
            table.line(&format!("  {}", stage.name), duration(stage.seconds));
        }
        table.line(
            "rays",
            format!(
                "{:.0} a lit pixel, {:.0} a gather sample",
                self.rays_per_pixel, self.rays_per_gather_sample
            ),
        );
        let [gather, glossy, bounces] =
            [self.gather_bytes, self.glossy_bytes, self.bounce_bytes].map(|size| bytes(size as u64));
        table.line(
            "transfer",
            format!(
                "{:.1} bytes a pixel: diffuse {gather}, glossy {glossy}, bounces {bounces}",
                self.bytes_per_pixel
            ),
        );
        add_encoding_errors(
            &mut table,
            self.gather_encoding_error,
            self.glossy_encoding_error,
            self.bounce_encoding_error,
        );
        table.line("cache", format!("{}, {}", self.cache.display(), bytes(self.cache_bytes)));
        let memory = Limit { bytes: self.memory_limit_bytes };
        table.line("peak memory", memory.told(self.peak_rss_bytes));
        write!(f, "{table}")
    }
}
