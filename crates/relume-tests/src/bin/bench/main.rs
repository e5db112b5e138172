//! `cargo xtask bench`: how time, memory and bytes grow with pixels, gather samples and triangles.
//!
//! Each point is a run of `relume prepare` and one of `relume bench`. The figures go to `bench.json`, a plot for each scene and axis beside
//! it, and tables into a section of a page, of which nothing else changes.

mod arguments;
mod glb;
mod growth;
mod machine;
mod plot;
mod points;
mod program;
mod report;
mod section;
mod subdivide;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use relume::glam::Vec3;
use relume::{Error, Light, LightKind, LightRig, Progress, Result};
use relume_io::{load_scene, rig_to_toml};
use relume_tests::command_line::{command, ended};
use relume_tests::progress::{Job, say};
use relume_tests::reports::write_text;

use arguments::{Arguments, SceneFile};
use glb::Glb;
use machine::Machine;
use points::{Plan, Point};
use program::Program;
use report::{Measured, Report, SceneReport, Series};

/// Where scenes and caches lie while they are measured.
const WORK: &str = ".cache/bench";
/// The file of all figures.
const FIGURES: &str = "bench.json";

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<()> {
    let scenes = arguments.scenes()?;
    let (plan, out, page) = (arguments.plan(), arguments.out(), arguments.page());
    // before hours of work
    if let Some(page) = &page {
        rewritten(page, "")?;
    }
    let program = Program {
        path: arguments.program()?,
        quality: arguments.quality(),
        frames: arguments.frames(),
        threads: arguments.threads,
    };
    for folder in [&out, Path::new(WORK)] {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, "create", error))?;
    }
    let mut report = Report {
        version: env!("CARGO_PKG_VERSION"),
        command: command("bench", std::env::args().skip(1)),
        machine: Machine::here(),
        quality: program.quality.clone(),
        frames: program.frames,
        scenes: Vec::new(),
    };
    let job = Job::new("bench", 1);
    let work: u64 = plan.points().iter().map(Point::work).sum();
    job.stage("points", work * scenes.len() as u64);
    for scene in &scenes {
        let measured = measure(scene, &plan, &program, &job)?;
        for series in &measured.series {
            let name = section::plot_stem(&measured, series.axis) + ".svg";
            plot::write(&measured.name, series, &out.join(name))?;
        }
        report.scenes.push(measured);
        // after every scene, so that a long run that ends early has not been for nothing
        write_text(&out.join(FIGURES), &report.json()?)?;
    }
    drop(job);
    let figures = out.join(FIGURES);
    let text = section::section(&report, &figures, &section::link_to(&out, page.as_deref()));
    match &page {
        Some(page) => write_text(page, &rewritten(page, &text)?)?,
        None => write_text(&out.join("bench.md"), &text)?,
    }
    say(&format!("written: {}", page.unwrap_or_else(|| out.join("bench.md")).display()));
    let text = if arguments.json { report.json()? } else { text };
    match writeln!(std::io::stdout().lock(), "{}", text.trim_end()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io("stdout", "write", error))
        }
        _ => Ok(()),
    }
}

/// The page with the section in it.
fn rewritten(page: &Path, section: &str) -> Result<String> {
    let text = std::fs::read_to_string(page).map_err(|error| Error::io(page, "read", error))?;
    section::replaced(&text, section).map_err(|fault| Error::file(page, fault))
}

/// All points of a scene.
fn measure(scene: &SceneFile, plan: &Plan, program: &Program, job: &Job) -> Result<SceneReport> {
    let rig = rig(scene)?;
    let fine = Path::new(WORK).join(format!("{}-fine.glb", scene.name));
    let cache = Path::new(WORK).join(format!("{}.relume", scene.name));
    let mut subdivisions = 0;
    let mut measured: Vec<Measured> = Vec::new();
    for point in plan.points() {
        if point.subdivisions != subdivisions {
            subdivisions = point.subdivisions;
            let subdivided = subdivide::subdivided(Glb::read(&scene.path)?, subdivisions);
            subdivided.map_err(|fault| Error::file(&scene.path, fault))?.write(&fine)?;
        }
        let path = if subdivisions == 0 { &scene.path } else { &fine };
        let prepare = program.prepare(path, &cache, &point)?;
        let relight = program.relight(&cache, &rig)?;
        measured.push(Measured { point, prepare, relight });
        job.advance(point.work());
    }
    for left in [&fine, &cache] {
        // what cannot be removed is written over the next time
        let _ = std::fs::remove_file(left);
    }
    let of = |point: &Point| measured.iter().find(|measured| measured.point == *point).cloned();
    let series = plan.axes.iter().map(|&axis| {
        let points = plan.along(axis);
        Series::new(axis, points.iter().filter_map(of).collect())
    });
    let rig = rig.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(SceneReport { name: scene.name.clone(), rig, series: series.collect() })
}

/// The rig that comes with a scene, `assets/rigs/NAME.toml` or `assets/rigs/NAME/key.toml`, or else a lamp above the camera.
fn rig(scene: &SceneFile) -> Result<PathBuf> {
    let rigs = Path::new("assets/rigs");
    let named = [rigs.join(format!("{}.toml", scene.name)), rigs.join(&scene.name).join("key.toml")];
    if let Some(rig) = named.into_iter().find(|rig| rig.is_file()) {
        return Ok(rig);
    }
    let imported = load_scene(&scene.path)?.scene;
    let camera = imported.cameras.first().ok_or_else(|| Error::file(&scene.path, "has no camera"))?;
    let lamp = LightKind::Omni {
        position: camera.position() + 0.3 * Vec3::Y,
        intensity: Vec3::splat(10.0),
        radius: 0.02,
    };
    let lamp = Light { name: "lamp above the camera".into(), enabled: true, kind: lamp };
    let path = Path::new(WORK).join(format!("{}-lamp.toml", scene.name));
    write_text(&path, &rig_to_toml(&LightRig { lights: vec![lamp], ..LightRig::default() }))?;
    Ok(path)
}
