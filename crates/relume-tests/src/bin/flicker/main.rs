//! `cargo xtask flicker`: how much indirect light flickers while a spot moves in small steps.
//!
//! The scene is prepared once and relit after every step, with all sub-samples of the gather cloud and with fewer; the same images are
//! made by an exact transfer, a quadrature that stays the same over all steps. Both know one indirect bounce and diffuse surfaces. The
//! table goes to `flicker.md`, everything to `flicker.json`, the second difference by step to `flicker.svg`.

mod arguments;
mod exact;
mod figures;
mod plot;
mod report;

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;
use relume::glam::Vec3;
use relume::image::Image;
use relume::relight::{Only, RelightSettings};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::trace::sampling::hash;
use relume::{Error, Light, LightRig, Preparation, Progress, Relighter, Result, Scene, Transfer};
use relume_io::{load_scene, rig_to_toml};
use relume_tests::command_line::{command, ended};
use relume_tests::progress::{Job, say};
use relume_tests::reports::write_text;

use arguments::Arguments;
use exact::Quadrature;
use report::{Exact, Report};

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<()> {
    arguments.lights()?;
    std::fs::create_dir_all(&arguments.out).map_err(|error| Error::io(&arguments.out, "create", error))?;
    rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build_global()
        .map_err(|error| Error::io("thread pool", "start", std::io::Error::other(error)))?;
    let imported = load_scene(&arguments.scene)?;
    for warning in &imported.warnings {
        say(&format!("warning: {}: {warning}", arguments.scene.display()));
    }
    let report = measure(imported.scene, arguments)?;
    let command = command("flicker", std::env::args().skip(1));
    write_text(&arguments.out.join("flicker.md"), &report.page(&command))?;
    write_text(&arguments.out.join("flicker.json"), &report.json()?)?;
    plot::write(&report, &arguments.out.join("flicker.svg"))?;
    say(&format!("written: {}", arguments.out.join("flicker.md").display()));
    let text = if arguments.json { report.json()? } else { report.table() };
    match writeln!(std::io::stdout().lock(), "{}", text.trim_end()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io("stdout", "write", error))
        }
        _ => Ok(()),
    }
}

/// Everything, of a scene that is in memory.
fn measure(mut scene: Scene, arguments: &Arguments) -> Result<Report> {
    let lights = arguments.lights()?;
    // what surfaces emit does not move
    scene.materials.iter_mut().for_each(|material| material.emission = Vec3::ZERO);
    let name = arguments.name();
    let transfer = Preparation::new(&scene)
        .name(&name)
        .settings(arguments.settings())
        .run(&Job::by_stage(format!("{name}: preparation")))?;
    if !transfer.view.center_chains.branches.is_empty() {
        return Err(Error::Setting(format!(
            "{name} shows mirrors or glass, which the exact transfer does not follow; take another scene or camera"
        )));
    }
    let exact = exact(&scene, arguments, &lights)?;
    let ([own, with_grain], lost_in_grain) = exact.rows();
    let mut rows = vec![own, with_grain];
    for &count in &arguments.sub_samples {
        let job = Job::new(format!("{name}: {count} sub-samples"), 1);
        let (images, shadow_rays) = relight(&transfer, count, &lights, &job)?;
        let label = format!("{count} sub-sample{}", if count == 1 { "" } else { "s" });
        rows.push(exact.judge(&label, &images, shadow_rays));
    }
    Ok(Report {
        version: env!("CARGO_PKG_VERSION"),
        scene: name,
        size: arguments.size,
        gather_samples: arguments.gather,
        quality: arguments.quality,
        rays: arguments.rays,
        seed: arguments.seed,
        rigs: [&lights[0], &lights[lights.len() - 1]].map(|light| rig_to_toml(&rig(light))),
        exact_uncertainty: exact.uncertainty(),
        lost_in_grain,
        rows,
    })
}

/// The images by the exact transfer.
fn exact(scene: &Scene, arguments: &Arguments, lights: &[Light]) -> Result<Exact> {
    let geometry = Geometry::new(scene);
    let geometry = geometry.without_clear().unwrap_or(geometry);
    let accel = Accel::new(scene, &geometry);
    let quadrature = Quadrature {
        scene,
        geometry: &geometry,
        accel: &accel,
        // preparation has found it
        camera: &scene.cameras[arguments.camera],
        size: arguments.size,
        rays: arguments.rays,
    };
    let job = Job::new(format!("{}: exact transfer", arguments.name()), 2);
    let exact = Exact::new([1, 2].map(|set| quadrature.images(lights, hash(set, arguments.seed), &job)));
    match exact.first_black() {
        None => Ok(exact),
        Some(step) => Err(Error::Setting(format!(
            "after step {step} the spot brings no indirect light to what the camera sees; move --position or --target, or take \
             wider --angles"
        ))),
    }
}

/// The images by the engine, with `count` sub-samples for each gather sample, and how many shadow rays each took.
fn relight(
    transfer: &Transfer,
    count: usize,
    lights: &[Light],
    progress: &dyn Progress,
) -> Result<(Vec<Image>, f64)> {
    let cloud = transfer.cloud.with_sub_samples(count)?;
    let mut relighter = Relighter::new(Arc::new(Transfer { cloud, ..transfer.clone() }));
    let settings =
        RelightSettings { bounces: Some(1), aa: 1, only: Only::Indirect, ..RelightSettings::default() };
    progress.stage("relighting", lights.len() as u64);
    let (mut images, mut shadow_rays) = (Vec::new(), 0);
    for light in lights {
        images.push(relighter.relight(&rig(light), &settings)?.indirect);
        shadow_rays += relighter.stats().shadow_rays;
        progress.advance(1);
    }
    Ok((images, shadow_rays as f64 / lights.len() as f64))
}

fn rig(light: &Light) -> LightRig {
    LightRig { lights: vec![light.clone()], ..LightRig::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_tests::scenes::box_room;

    fn measured(line: &str) -> Result<Report> {
        let line = std::iter::once("flicker").chain(line.split_whitespace());
        measure(box_room().scene, &Arguments::try_parse_from(line).unwrap())
    }

    /// A spot that slides off a box in a room.
    #[test]
    fn fewer_sub_samples_flicker_more() {
        let report = measured(
            "--size 24x18 --gather 4096 --quality draft --rays 512 --steps 24 --position 3.2,2.6,3.4 --target 1.3,1.3,1.9 \
             --step 0,0,0 --target-step 0.01,0,0",
        )
        .unwrap();
        println!("{}", report.table());
        let [exact, with_grain, sixteen, four, one] = report.rows.as_slice() else { panic!("five rows") };
        assert!(exact.spread.rms > 0.0 && exact.spread.rms < with_grain.spread.rms);
        let over = [sixteen, four, one].map(|row| row.over_exact.unwrap().rms);
        // measured 2.3, 4.1 and 7.3
        assert!(over[0] < 3.5 && over[0] < over[1] && over[1] < over[2] && over[2] > 4.5, "{over:.4?}");
        let of_error = [sixteen, four, one].map(|row| row.of_error.unwrap().rms);
        assert!(
            of_error[0] > 0.0 && of_error[0] < of_error[1] && of_error[1] < of_error[2],
            "{of_error:.5?}"
        );
        let errors = [sixteen, four, one].map(|row| row.error.unwrap().0);
        assert!(errors.iter().all(|error| (0.0..0.2).contains(error)), "{errors:.4?}");
        let page = report.page("cargo xtask flicker");
        for text in ["| 4 sub-samples |", "| exact |", "24x18, 4096 gather samples, quality draft, 24 steps"]
        {
            assert!(page.contains(text), "{text} in\n{page}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flicker.svg");
        plot::write(&report, &path).unwrap();
        let svg = std::fs::read_to_string(path).unwrap();
        assert!(report.rows.iter().all(|row| svg.contains(&row.label)), "every row has its line");
    }

    #[test]
    fn a_spot_that_lights_nothing_is_refused() {
        let tiny = "--size 8x6 --gather 256 --quality draft --rays 16 --steps 2";
        let refused = measured(&format!("{tiny} --position 9,9,9 --target 9,12,9")).unwrap_err();
        assert!(refused.is_bad_input() && refused.to_string().contains("after step 0"), "{refused}");
        let refused = measured(&format!("{tiny} --camera 7")).unwrap_err();
        assert!(refused.is_bad_input() && refused.to_string().contains("no camera 7"), "{refused}");
    }
}
