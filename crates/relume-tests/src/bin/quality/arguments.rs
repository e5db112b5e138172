//! The command line.

use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};
use relume::reference::{MAX_BOUNCE_IMAGES, Paths};
use relume::transfer::{Encoding, Multibounce, PhotonSettings, Quality, RowMethod, Selection, Settings};
use relume::{Error, Result};
pub(crate) use relume_tests::command_line::name_of;
use relume_tests::command_line::{gather_count, image_size, named};
use serde::{Deserialize, Serialize};

/// Measure how far relit images are from converged path tracing, and write the table, plots and pictures.
///
/// Each scene is path traced once under every light, in two halves with independent noise, which is thereby taken out
/// of every error; it is prepared once in every encoding and relit under all lights. References and prepared transfers
/// are kept in --cache for the next run. Paths on the command line are taken from the root of the workspace.
#[derive(Parser, Clone, Debug)]
#[command(name = "cargo xtask quality", bin_name = "cargo xtask quality", after_help = EXAMPLE, max_term_width = 100)]
pub(crate) struct Arguments {
    /// Scenes by name, without their endings .glb, .gltf or .obj; those that --scenes lacks are skipped.
    #[arg(value_name = "SCENE", default_values = ["sponza", "still_life", "hairball", "temple", "cornell"])]
    pub(crate) names: Vec<String>,
    /// The folder that holds the scenes [default: the environment variable RELUME_SCENES].
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Width and height of the image in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = image_size)]
    pub(crate) size: (usize, usize),
    /// Gather samples, a power of four.
    #[arg(long, value_name = "N", default_value = "65536", value_parser = gather_count)]
    pub(crate) gather: usize,
    /// How much time and space to spend on a preparation: glance, draft, standard or final.
    #[arg(long, value_name = "QUALITY", default_value = "standard", value_parser = named::<Quality>)]
    pub(crate) quality: Quality,
    /// How far apart records lie, a share of how far away what they see is, 0 to 1; 0 gives every receiver a row.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    spacing: f32,
    /// How the transfer is stored; each one is a line of the table.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = "low-rank,haar-rows",
          value_parser = named::<Encoding>)]
    pub(crate) encodings: Vec<Encoding>,
    /// By what each encoding chooses coefficients, a line each: area, plain, prior [default: each encoding's own way].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = named::<Selection>)]
    selections: Vec<Selection>,
    /// Coefficients a row of haar-rows and haar-blocks; each one is a line of the table.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "100",
          value_parser = clap::value_parser!(u16).range(1..=4096))]
    coefficients: Vec<u16>,
    /// How rows are estimated: balanced, or paper.
    #[arg(long, value_name = "METHOD", default_value = "balanced", value_parser = named::<RowMethod>)]
    rows: RowMethod,
    /// How light goes on from surface to surface: iterated, or photon, which needs `--bounces all`; each one is a line of the table.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = "iterated",
          value_parser = named::<Multibounce>)]
    pub(crate) multibounce: Vec<Multibounce>,
    /// Photons to shoot for `photon`.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    photons: u32,
    /// Photons that a row is made of.
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    photons_per_row: u32,
    /// Surfaces that a photon hits at most [default: as many as their albedo lets it].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    photon_path: Option<u32>,
    /// What the encoding of diffuse light may lose, in percent, of `low-rank`; each one is a line of the table, and 0 is what --quality
    /// pays for [default: 0].
    #[arg(long, value_name = "PERCENT,...", value_delimiter = ',')]
    error: Vec<f32>,
    /// Prepare without the sky's gather samples, and make no dome.
    #[arg(long)]
    pub(crate) no_sky: bool,
    /// Lights to make for each scene, beside a dome where the sky is to be seen.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) lights: u32,
    /// Take each rig (.toml) of this folder as one case, or this one, instead of making lights.
    #[arg(long, value_name = "DIR|RIG.toml")]
    pub(crate) rigs: Option<PathBuf>,
    /// Seed of the lights and of the preparation.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u32,
    /// Paths a pixel of a reference; its noise falls with the square root, and is stated.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) spp: u32,
    /// Indirect bounces, a column each: numbers from 1 to 16, or `all`.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "all", value_parser = bounces)]
    pub(crate) bounces: Vec<Bounces>,
    /// Which paths the truth has.
    #[arg(long, value_enum, default_value_t = Truth::Transfer)]
    paths: Truth,
    /// Where to write quality.md, quality.json, pictures and plots.
    #[arg(long, value_name = "DIR", default_value = "out/quality")]
    pub(crate) out: PathBuf,
    /// Where references and prepared transfers are kept.
    #[arg(long, value_name = "DIR", default_value = ".cache/quality")]
    pub(crate) cache: PathBuf,
    /// Use nothing that an earlier run has kept.
    #[arg(long)]
    pub(crate) fresh: bool,
    /// Threads to work on [default: one a processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print quality.json on stdout instead of the first table.
    #[arg(long)]
    pub(crate) json: bool,
}

const EXAMPLE: &str = "\
A minute's try on the scene that comes with Relume:
  cargo xtask quality arcade --scenes assets --size 160x120 --gather 4096 --quality draft --lights 4 --spp 32
The six rigs of the benchmarks, after 1, 2 and 4 bounces:
  cargo xtask quality sponza --rigs assets/rigs/sponza --bounces 1,2,4";

/// `--paths`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Truth {
    /// Those that the transfer models.
    Transfer,
    /// Those that a transfer without reflections models; it is prepared without them.
    Diffuse,
    /// All that a renderer would show.
    All,
    /// `transfer` and `all`.
    Both,
}

/// How many indirect bounces a column counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct Bounces(
    /// `None` is unlimited.
    pub(crate) Option<u32>,
);

impl std::fmt::Display for Bounces {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(count) => write!(f, "{count}"),
            None => f.write_str("all"),
        }
    }
}

impl Arguments {
    /// The folder of scenes.
    ///
    /// # Errors
    /// [`Error::Setting`] where neither the argument nor the environment names a folder, or none that exists.
    pub(crate) fn scene_folder(&self) -> Result<PathBuf> {
        let named = self.scenes.clone().or_else(|| std::env::var_os("RELUME_SCENES").map(PathBuf::from));
        let Some(folder) = named else {
            return Err(Error::Setting(
                "no folder of scenes is named; give one with --scenes DIR, or set RELUME_SCENES".to_owned(),
            ));
        };
        if folder.is_dir() { Ok(folder) } else { Err(no_folder(&folder, "--scenes")) }
    }

    /// What is measured: every encoding with every selection (`None` is its own) and every form of bounces.
    pub(crate) fn preparations(&self) -> Vec<Settings> {
        let own = [None];
        let chosen: Vec<_> = self.selections.iter().copied().map(Some).collect();
        let selections = if chosen.is_empty() { &own[..] } else { &chosen };
        let mut all = Vec::new();
        for &encoding in &self.encodings {
            for &selection in selections {
                for &multibounce in &self.multibounce {
                    let sized = self.of_all_sizes(self.preparation(encoding, selection, multibounce));
                    all.extend(sized);
                }
            }
        }
        all
    }

    /// The preparation at each size that is asked for.
    fn of_all_sizes(&self, settings: Settings) -> Vec<Settings> {
        let settings = &settings;
        if settings.encoding != Encoding::LowRank {
            let sizes = self.coefficients.iter().map(|&count| usize::from(count));
            return sizes.map(|coefficients| Settings { coefficients, ..settings.clone() }).collect();
        }
        let errors = if self.error.is_empty() { &[0.0][..] } else { &self.error };
        let budgets = errors.iter().map(|&percent| Some(percent / 100.0).filter(|&error| error != 0.0));
        budgets.map(|error| Settings { error, ..settings.clone() }).collect()
    }

    /// Whether what is asked for goes together.
    ///
    /// # Errors
    /// [`Error::Setting`] where photons are to tell bounces apart.
    pub(crate) fn check(&self) -> Result<()> {
        let some = self.bounces.iter().find(|bounces| bounces.0.is_some());
        match some {
            Some(some) if self.multibounce.contains(&Multibounce::Photon) => Err(Error::Setting(format!(
                "--bounces {some}: photons cannot tell bounces apart; ask for --bounces all, or leave photon out of --multibounce"
            ))),
            _ => Ok(()),
        }
    }

    fn preparation(
        &self,
        encoding: Encoding,
        selection: Option<Selection>,
        multibounce: Multibounce,
    ) -> Settings {
        let photons = PhotonSettings {
            count: self.photons as usize,
            nearest: self.photons_per_row as usize,
            path_length: self.photon_path,
        };
        Settings {
            size: self.size,
            gather: self.gather,
            quality: self.quality,
            spacing: self.spacing,
            encoding,
            selection,
            rows: self.rows,
            multibounce,
            // where they are not used, they would make another transfer of the same
            photons: if multibounce == Multibounce::Photon { photons } else { PhotonSettings::default() },
            glossy: self.paths != Truth::Diffuse,
            sky: !self.no_sky,
            seed: self.seed,
            ..Settings::default()
        }
    }

    /// The truths to measure against.
    pub(crate) fn truths(&self) -> &'static [Paths] {
        match self.paths {
            Truth::Transfer => &[Paths::Transfer],
            Truth::Diffuse => &[Paths::DiffuseTransfer],
            Truth::All => &[Paths::All],
            Truth::Both => &[Paths::Transfer, Paths::All],
        }
    }
}

/// That a folder is missing, and which argument names it.
pub(crate) fn no_folder(folder: &Path, argument: &str) -> Error {
    Error::file(folder, format!("there is no such folder; name another one with {argument}"))
}

/// What the tables call a preparation: its way, and its size where that is given.
pub(crate) fn label(settings: &Settings) -> String {
    let mut label = way(settings);
    if let Some(error) = settings.error {
        // as it was written, less what a share of one adds in its last digits
        label += &format!(", {}% lost", (100_000.0 * error).round() / 1000.0);
    }
    if settings.encoding != Encoding::LowRank && settings.coefficients != Settings::default().coefficients {
        label += &format!(", N = {}", settings.coefficients);
    }
    label
}

/// Its encoding, its selection where that is not the encoding's own, and how light bounces where that is not the usual way.
pub(crate) fn way(settings: &Settings) -> String {
    let mut label = name_of(&settings.encoding);
    if let Some(selection) = settings.selection {
        label += &format!(" by {}", name_of(&selection));
    }
    if settings.multibounce != Multibounce::Iterated {
        label += &format!(", {}", name_of(&settings.multibounce));
    }
    label
}

/// What the tables call a truth.
pub(crate) fn paths_name(paths: Paths) -> &'static str {
    match paths {
        Paths::All => "all",
        Paths::Transfer => "transfer",
        Paths::DiffuseTransfer => "diffuse",
    }
}

fn bounces(text: &str) -> Result<Bounces, String> {
    if text == "all" {
        return Ok(Bounces(None));
    }
    let count = text.parse().ok().filter(|count| (1..=MAX_BOUNCE_IMAGES).contains(count));
    count.map(|count| Bounces(Some(count))).ok_or_else(|| format!("write 1 to {MAX_BOUNCE_IMAGES}, or `all`"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn every_example_is_a_command_line() {
        Arguments::command().debug_assert();
        let examples: Vec<_> =
            EXAMPLE.lines().filter_map(|line| line.trim().strip_prefix("cargo xtask ")).collect();
        assert_eq!(examples.len(), 2);
        for example in examples {
            Arguments::try_parse_from(example.split_whitespace()).unwrap();
        }
        let wrong = |argument: &str| Arguments::try_parse_from(["quality", argument]).is_err();
        for argument in [
            "--multibounce=both",
            "--photons=0",
            "--photon-path=65",
            "--size=640",
            "--gather=512",
            "--bounces=0",
            "--bounces=17",
            "--encodings=best",
            "--lights=0",
        ] {
            assert!(wrong(argument), "{argument}");
        }
    }

    #[test]
    fn settings_go_by_their_names() {
        let line = ["quality", "--bounces", "1,all", "--encodings", "haar-rows", "--paths", "both"];
        let arguments = Arguments::try_parse_from(line).unwrap();
        assert_eq!(arguments.bounces, [Bounces(Some(1)), Bounces(None)]);
        assert_eq!(arguments.encodings, [Encoding::HaarRows]);
        assert_eq!(name_of(&Encoding::HaarRows), "haar-rows");
        let labels =
            |arguments: &Arguments| -> Vec<String> { arguments.preparations().iter().map(label).collect() };
        assert_eq!(labels(&arguments), ["haar-rows"]);
        let line = ["quality", "--encodings", "haar-blocks,low-rank", "--selections", "plain,prior"];
        let ways = Arguments::try_parse_from(line).unwrap();
        assert_eq!(
            labels(&ways),
            ["haar-blocks by plain", "haar-blocks by prior", "low-rank by plain", "low-rank by prior"]
        );
        let line = "quality --encodings low-rank,haar-rows --error 0,2.5,20 --coefficients 25,100";
        let sizes = Arguments::try_parse_from(line.split(' ')).unwrap();
        let expected =
            ["low-rank", "low-rank, 2.5% lost", "low-rank, 20% lost", "haar-rows, N = 25", "haar-rows"];
        assert_eq!(labels(&sizes), expected);
        assert_eq!(arguments.truths().len(), 2);
        assert_eq!(arguments.names.len(), 5);
    }

    #[test]
    fn photons_are_told_in_labels_and_have_no_bounces_of_their_own() {
        let arguments = |line: &str| Arguments::try_parse_from(line.split(' ')).unwrap();
        let photon = arguments("quality --multibounce iterated,photon --photons 5000");
        assert!(photon.check().is_ok());
        let all = photon.preparations();
        let labels: Vec<_> = all.iter().map(|settings| (label(settings), settings.photons.count)).collect();
        let expected = [
            ("low-rank", 1_000_000),
            ("low-rank, photon", 5000),
            ("haar-rows", 1_000_000),
            ("haar-rows, photon", 5000),
        ];
        assert_eq!(labels, expected.map(|(label, count)| (label.to_owned(), count)));
        assert!(arguments("quality --multibounce iterated,photon --bounces all,2").check().is_err());
        assert!(arguments("quality --multibounce iterated --bounces all,2").check().is_ok());
    }
}
