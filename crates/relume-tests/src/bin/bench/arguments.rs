//! The command line.

use std::path::{Path, PathBuf};

use clap::Parser;
use relume::transfer::Quality;
use relume::{Error, Result};
use relume_tests::command_line::{gather_count, image_size, name_of, named};

use crate::points::{Axis, Plan};

/// Measure how the time, the memory and the bytes of a preparation and of a relit frame grow with pixels, gather samples and triangles.
///
/// For each point a scene is prepared once by `relume prepare` and relit by `relume bench`, each a process of its own. One of pixels, gather
/// samples and triangles grows at a time; the others stay at the middle one of their lists, triangles at their first. Triangles are parted into
/// four, again and again, without changing any surface. Figures go to bench.json and to plots, and into the page's section between its two markers.
/// Paths on the command line are taken from the root of the workspace.
#[derive(Parser, Clone, Debug)]
#[command(name = "cargo xtask bench", bin_name = "cargo xtask bench", after_help = EXAMPLE, max_term_width = 100)]
pub(crate) struct Arguments {
    /// Scenes by name, without their ending .glb [default: arcade; with --scenes, sponza and temple].
    #[arg(value_name = "SCENE")]
    names: Vec<String>,
    /// The folder that holds the scenes; what it lacks is looked for in assets.
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Small pictures and drafts, a try of two minutes: the page stays as it is unless --page names it.
    #[arg(long)]
    pub(crate) quick: bool,
    /// What grows: pixels, gather, triangles.
    #[arg(long, value_name = "AXIS,...", value_delimiter = ',', default_value = "pixels,gather,triangles",
          value_parser = named::<Axis>)]
    axes: Vec<Axis>,
    /// Widths and heights in pixels [default: 160x120,320x240,640x480; quick: 64x48,128x96,256x192].
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', value_parser = image_size)]
    sizes: Vec<(usize, usize)>,
    /// Gather samples, powers of four [default: 4096,16384,65536; quick: 1024,4096,16384].
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = gather_count)]
    gather: Vec<usize>,
    /// How often each triangle is parted into four.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "0,1,2",
          value_parser = clap::value_parser!(u32).range(0..=6))]
    subdivisions: Vec<u32>,
    /// How much time and space to spend on a preparation: glance, draft, standard or final [default: standard; quick: draft].
    #[arg(long, value_name = "QUALITY", value_parser = named::<Quality>)]
    quality: Option<Quality>,
    /// Relit frames, of which the median counts [default: 20; quick: 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Threads to work on [default: one a processor].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Where to write bench.json and the plots [default: docs/benchmarks; quick: out/bench].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The page whose section is rewritten [default: docs/BENCHMARKS.md; quick: none].
    #[arg(long, value_name = "PAGE.md")]
    page: Option<PathBuf>,
    /// The program to measure [default: the one built beside this one].
    #[arg(long, value_name = "RELUME")]
    program: Option<PathBuf>,
    /// Print bench.json on stdout instead of the section.
    #[arg(long)]
    pub(crate) json: bool,
}

const EXAMPLE: &str = "\
A short try on the scene that comes with Relume:
  cargo xtask bench --quick
Other scenes, one of them by its triangles alone:
  cargo xtask bench sponza --scenes FOLDER
  cargo xtask bench temple --scenes FOLDER --axes triangles --subdivisions 0,1";

/// A scene to measure.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SceneFile {
    pub(crate) name: String,
    pub(crate) path: PathBuf,
}

impl Arguments {
    /// The scenes, where they are.
    ///
    /// # Errors
    /// Which is missing.
    pub(crate) fn scenes(&self) -> Result<Vec<SceneFile>> {
        let default: &[&str] = if self.scenes.is_some() { &["sponza", "temple"] } else { &["arcade"] };
        let default = default.iter().map(|&name| name.to_owned());
        let names = if self.names.is_empty() { default.collect() } else { self.names.clone() };
        let assets = Path::new("assets");
        let folders: Vec<&Path> = self.scenes.as_deref().into_iter().chain([assets]).collect();
        let find = |name: String| {
            let file = format!("{name}.glb");
            let path = folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file());
            let path = path.ok_or_else(|| {
                Error::file(folders[0], format!("has no {file}; name the folder that has it with --scenes"))
            })?;
            Ok(SceneFile { name, path })
        };
        names.into_iter().map(find).collect()
    }

    /// The points to measure of each scene.
    pub(crate) fn plan(&self) -> Plan {
        let of = |given: &[usize], full: [usize; 3], quick: [usize; 3]| match (given, self.quick) {
            ([], false) => full.to_vec(),
            ([], true) => quick.to_vec(),
            (given, _) => given.to_vec(),
        };
        let sizes = match (self.sizes.as_slice(), self.quick) {
            ([], false) => vec![(160, 120), (320, 240), (640, 480)],
            ([], true) => vec![(64, 48), (128, 96), (256, 192)],
            (given, _) => given.to_vec(),
        };
        Plan {
            axes: self.axes.clone(),
            sizes,
            gather: of(&self.gather, [4096, 16_384, 65_536], [1024, 4096, 16_384]),
            subdivisions: self.subdivisions.clone(),
        }
    }

    /// Of every preparation.
    pub(crate) fn quality(&self) -> String {
        let default = if self.quick { Quality::Draft } else { Quality::Standard };
        name_of(&self.quality.unwrap_or(default))
    }

    /// Of every relighting.
    pub(crate) fn frames(&self) -> u32 {
        self.frames.unwrap_or(if self.quick { 8 } else { 20 })
    }

    /// The folder of figures and plots.
    pub(crate) fn out(&self) -> PathBuf {
        self.out.clone().unwrap_or_else(|| if self.quick { "out/bench" } else { "docs/benchmarks" }.into())
    }

    /// The page to rewrite, where there is to be one.
    pub(crate) fn page(&self) -> Option<PathBuf> {
        let default = (!self.quick).then(|| PathBuf::from("docs/BENCHMARKS.md"));
        self.page.clone().or(default)
    }

    /// The program to measure.
    ///
    /// # Errors
    /// Where it is not there.
    pub(crate) fn program(&self) -> Result<PathBuf> {
        let beside = || {
            let own = std::env::current_exe().ok()?;
            Some(own.with_file_name(format!("relume{}", std::env::consts::EXE_SUFFIX)))
        };
        let program = self.program.clone().or_else(beside).filter(|path| path.is_file());
        program.ok_or_else(|| {
            Error::Setting(
                "the program is not there; build it with `cargo build --release -p relume-cli`, or name it with --program"
                    .into(),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        Arguments::try_parse_from(std::iter::once("bench").chain(line.split_whitespace()))
    }

    #[test]
    fn every_example_is_a_command_line() {
        Arguments::command().debug_assert();
        let examples = EXAMPLE.lines().filter_map(|line| line.trim().strip_prefix("cargo xtask bench"));
        let examples: Vec<_> = examples.map(parse).collect();
        assert_eq!(examples.len(), 3);
        assert!(examples.iter().all(Result::is_ok));
        for wrong in ["--axes pixels,depth", "--sizes 640", "--gather 1000", "--subdivisions 7", "--frames 0"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_quick_run_leaves_the_page_alone() {
        let of = |line: &str| {
            let arguments = parse(line).unwrap();
            (arguments.page(), arguments.out(), arguments.quality(), arguments.plan().gather[0])
        };
        let path = PathBuf::from;
        assert_eq!(of("--quick"), (None, path("out/bench"), "draft".into(), 1024));
        let full = (Some(path("docs/BENCHMARKS.md")), path("docs/benchmarks"), "standard".into(), 4096);
        assert_eq!(of(""), full);
        assert_eq!(of("--quick --page a.md --out b").0, Some(path("a.md")));
    }

    #[test]
    fn scenes_are_found_or_missed_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let line = format!("room hall --scenes {}", folder.path().display());
        for name in ["room", "hall"] {
            assert!(parse(&line).unwrap().scenes().is_err());
            std::fs::write(folder.path().join(format!("{name}.glb")), "").unwrap();
        }
        let found = parse(&line).unwrap().scenes().unwrap();
        assert_eq!(found[1], SceneFile { name: "hall".into(), path: folder.path().join("hall.glb") });
    }
}
