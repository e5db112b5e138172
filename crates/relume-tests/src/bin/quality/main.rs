//! `cargo xtask quality`: how far relit images are from converged path tracing.
//!
//! For each scene: lights are made, or read from rigs; each is path traced once; the scene is prepared once in each
//! encoding and relit under all of them. Tables go to `quality.md`, everything to `quality.json`, and each scene has a
//! plot and a picture. One scene at a time is in memory, and of the references one at a time.

mod arguments;
mod figures;
mod lights;
mod memory;
mod pictures;
mod plot;
mod preparations;
mod references;
mod report;
mod shot;
mod space;
mod summary;
mod table;

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use relume::reference::Paths;
use relume::transfer::Settings;
use relume::{Error, Progress, Relighter, Result};
use relume_io::rig_to_toml;
use relume_tests::command_line::{command, ended};
use relume_tests::progress::{self, Job, say};
use relume_tests::reports::write_text;

use arguments::{Arguments, Bounces, label, paths_name};
use figures::{Column, Errors, LightErrors, Summary, relight};
use lights::Case;
use pictures::Sheet;
use references::{ReferenceSettings, References};
use report::{EncodingReport, LightReport, Report, SceneReport};
use shot::Shot;

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<()> {
    arguments.check()?;
    let folder = arguments.scene_folder()?;
    for folder in [&arguments.out, &arguments.cache] {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, "create", error))?;
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build_global()
        .map_err(|error| Error::io("thread pool", "start", std::io::Error::other(error)))?;
    let mut report = Report {
        version: env!("CARGO_PKG_VERSION"),
        size: arguments.size,
        gather_samples: arguments.gather,
        quality: arguments.quality,
        spp: arguments.spp,
        scenes: Vec::new(),
        skipped: Vec::new(),
    };
    for name in &arguments.names {
        let Some(path) = shot::find(&folder, name) else {
            say(&format!("skipped: {name}, which is not in {}", folder.display()));
            report.skipped.push(name.clone());
            continue;
        };
        let scene = measure_scene(Shot::load(name, &path)?, arguments)?;
        report.scenes.push(scene);
        // after every scene, so that a long run that ends early has not been for nothing
        write_report(&report, &arguments.out)?;
    }
    if report.scenes.is_empty() {
        let names = arguments.names.join(", ");
        return Err(Error::file(
            &folder,
            format!("holds none of {names}; name another folder with --scenes"),
        ));
    }
    say(&format!("written: {}", arguments.out.join("quality.md").display()));
    let text = if arguments.json { json(&report)? } else { table::overview(&report) };
    match writeln!(std::io::stdout().lock(), "{}", text.trim_end()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io("stdout", "write", error))
        }
        _ => Ok(()),
    }
}

fn write_report(report: &Report, folder: &Path) -> Result<()> {
    let page = table::page(report, &command("quality", std::env::args().skip(1)));
    for (name, text) in [("quality.md", page), ("quality.json", json(report)?)] {
        write_text(&folder.join(name), &text)?;
    }
    Ok(())
}

fn json(report: &Report) -> Result<String> {
    serde_json::to_string_pretty(report)
        .map_err(|error| Error::io("quality.json", "write", std::io::Error::other(error)))
}

/// A scene under measurement.
struct Measurement<'a> {
    arguments: &'a Arguments,
    shot: Shot,
    cases: Vec<Case>,
    references: References,
    sheet: Sheet,
}

fn measure_scene(mut shot: Shot, arguments: &Arguments) -> Result<SceneReport> {
    let cases = match &arguments.rigs {
        Some(folder) => lights::from_rigs(&shot, folder)?,
        None => {
            lights::made(&mut shot, (arguments.lights, arguments.seed), arguments.size, !arguments.no_sky)?
        }
    };
    let (size, spp, bounces) = (arguments.size, arguments.spp, arguments.bounces.clone());
    let settings = ReferenceSettings { size, spp, bounces };
    let references = References { folder: arguments.cache.clone(), settings };
    let mut measurement = Measurement { arguments, shot, cases, references, sheet: Sheet::new(size) };
    measurement.trace_references()?;
    let encodings = arguments.preparations().into_iter().map(|settings| measurement.measure(settings));
    let encodings = encodings.collect::<Result<Vec<_>>>()?;
    let Measurement { shot, cases, sheet, .. } = measurement;
    let light = |case: &Case| LightReport { name: case.name.clone(), rig: rig_to_toml(&case.rig) };
    let scene = SceneReport {
        name: shot.name,
        scene_hash: shot.hash,
        triangles: shot.geometry.triangles.len(),
        lights: cases.iter().map(light).collect(),
        encodings,
    };
    sheet.write(&arguments.out.join(format!("{}.png", scene.name)))?;
    plot::write(&scene, &arguments.out.join(format!("{}.svg", scene.name)))?;
    Ok(scene)
}

impl Measurement<'_> {
    /// Traces all references that are not kept.
    fn trace_references(&mut self) -> Result<()> {
        let Self { arguments, shot, cases, references, .. } = self;
        let all = arguments.truths().iter().flat_map(|&paths| cases.iter().map(move |case| (case, paths)));
        let is_missing =
            |(case, paths): &(&Case, Paths)| arguments.fresh || !references.is_kept(shot, case, *paths);
        let missing: Vec<_> = all.filter(is_missing).collect();
        let job = Job::new(format!("{}: references", shot.name), 2 * missing.len() as u64);
        missing
            .into_iter()
            .try_for_each(|(case, paths)| references.trace(shot, case, paths, &job).map(|_| ()))
    }

    /// Prepares the scene in one way and relights it under all lights.
    fn measure(&mut self, settings: Settings) -> Result<EncodingReport> {
        let arguments = self.arguments;
        let (transfer, record) =
            preparations::prepare(&self.shot, &settings, &arguments.cache, arguments.fresh)?;
        let mut report = EncodingReport {
            encoding: label(&settings),
            settings,
            bytes_per_pixel: transfer.bytes_per_pixel(),
            bounce_bytes: transfer.bounce.bytes(),
            prepare_seconds: record.seconds,
            threads: record.threads,
            rays_per_pixel: transfer.report.rays_per_pixel,
            rays_per_gather_sample: transfer.report.rays_per_gather_sample,
            peak_rss_bytes: record.peak_rss_bytes,
            columns: Vec::new(),
            pictured: Vec::new(),
        };
        let mut relighter = Relighter::new(transfer);
        for &paths in arguments.truths() {
            report.columns.extend(self.columns(&mut relighter, paths)?);
        }
        report.pictured = self.picture(&mut relighter, &report)?;
        Ok(report)
    }

    /// The errors against one truth, for each number of bounces.
    fn columns(&mut self, relighter: &mut Relighter, paths: Paths) -> Result<Vec<Column>> {
        let counts = &self.arguments.bounces;
        let name = label(&relighter.transfer().report.settings);
        let job = Job::new(format!("{}, {name}: relighting", self.shot.name), self.cases.len() as u64);
        let mut lights: Vec<Vec<LightErrors>> = vec![Vec::new(); counts.len()];
        for case in &self.cases {
            job.stage(&case.name, 1);
            let truths = self.references.get(&mut self.shot, case, paths, &())?;
            for ((lights, &bounces), indirect) in lights.iter_mut().zip(counts).zip(&truths.indirect) {
                let relit = relight(relighter, case, bounces)?;
                let errors = Errors::of(&relit, &truths.direct, indirect);
                lights.push(LightErrors { light: case.name.clone(), errors });
            }
            job.advance(1);
        }
        let column = |(lights, &bounces): (Vec<LightErrors>, &Bounces)| Column {
            paths: paths_name(paths),
            bounces,
            summary: Summary::of(&lights),
            lights,
        };
        Ok(lights.into_iter().zip(counts).map(column).collect())
    }

    /// Adds the median and the worst light to the picture, after the last number of bounces against the first truth;
    /// says what each row shows.
    fn picture(&mut self, relighter: &mut Relighter, report: &EncodingReport) -> Result<Vec<String>> {
        let paths = self.arguments.truths()[0];
        let column = report.columns.iter().rfind(|column| column.paths == paths_name(paths));
        let Some((column, spread)) =
            column.and_then(|column| Some((column, column.summary.indirect.as_ref()?)))
        else {
            return Ok(Vec::new());
        };
        let mut pictured = Vec::new();
        for (rank, name) in [("median", &spread.median_light), ("worst", &spread.worst_light)] {
            let Some(case) = self.cases.iter().find(|case| case.name == *name) else { continue };
            let truths = self.references.get(&mut self.shot, case, paths, &())?;
            let relit = relight(relighter, case, column.bounces)?;
            if let Some(indirect) = truths.indirect.last() {
                self.sheet.add(&relit, &truths.direct, indirect);
                pictured.push(format!("{}, {rank} light `{name}`", report.encoding));
            }
        }
        Ok(pictured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_tests::scenes::box_room;

    /// The whole way on a room made in code: the second time from what the first has kept, with the same figures.
    #[test]
    fn a_room_is_measured_twice_alike() {
        let folder = tempfile::tempdir().unwrap();
        let [out, cache] = ["out", "cache"].map(|name| folder.path().join(name));
        [&out, &cache].iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
        let measure = |gather: &str| {
            let line = "quality --size 32x24 --quality draft --lights 3 --spp 16 --bounces 1,all --gather";
            let folders = ["--out", out.to_str().unwrap(), "--cache", cache.to_str().unwrap()];
            let line = line.split(' ').chain([gather]).chain(folders);
            let arguments = Arguments::try_parse_from(line).unwrap();
            measure_scene(Shot::new("room", box_room().scene), &arguments).unwrap()
        };
        let first = measure("1024");
        let kept = std::fs::read_dir(&cache).unwrap().count();
        assert_eq!(kept, 3 + 2 * 2, "three references, two transfers with what they took");
        let second = measure("1024");
        let figures = |scene: &SceneReport| serde_json::to_string(&scene.encodings).unwrap();
        assert_eq!(figures(&first), figures(&second), "preparation seconds included, for they were kept");
        assert_eq!(std::fs::read_dir(&cache).unwrap().count(), kept);
        let [low_rank, haar_rows] = first.encodings.as_slice() else { panic!("two encodings") };
        assert!(low_rank.bytes_per_pixel != haar_rows.bytes_per_pixel);
        assert_eq!((low_rank.columns.len(), low_rank.pictured.len()), (2, 2));
        for name in ["room.png", "room.svg"] {
            assert!(out.join(name).is_file(), "{name}");
        }
        // another preparation is not taken for the kept one
        assert_ne!(figures(&measure("256")), figures(&first));
        assert!(std::fs::read_dir(&cache).unwrap().count() == kept + 4, "the references still hold");
    }
}
