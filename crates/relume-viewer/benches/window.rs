//! How long one waits for the window: from the command to the first picture, to the first indirect light, and from an edit to its picture.
//!
//!     RELUME_SCENES=FOLDER cargo bench -p relume-viewer
//!
//! The window is the real one, with its workers, at 60 frames a second; only nothing draws it. What a GPU takes for that is not in these figures, and what software
//! drawing takes is a property of the machine without one: `relume view --times` tells it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume_viewer::{Options, Source, Viewer};

const FRAME: Duration = Duration::from_micros(16_667);
/// Edits of a drag.
const STEPS: usize = 240;

fn main() {
    // `cargo test --benches` only asks whether it starts
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let scenes = std::env::var_os("RELUME_SCENES").map(PathBuf::from);
    let sponza = scenes.map(|scenes| scenes.join("sponza.glb")).filter(|scene| scene.is_file());
    let (scene, rig) = match &sponza {
        Some(sponza) => (sponza.clone(), assets.join("rigs/sponza/key.toml")),
        None => (assets.join("arcade.glb"), assets.join("rigs/arcade_move.toml")),
    };
    println!("{}, 640x480, 65,536 gather samples, standard, while it is prepared", scene.display());
    let source = Source { cache: Some(folder.path().join("shot.relume")), ..Source::new(scene) };
    let options = Options { source: Some(source), rig: Some(rig), ..Options::default() };
    let began = Instant::now();
    let builder = Harness::builder().with_size([1280.0, 800.0]).with_step_dt(1.0 / 60.0);
    let mut harness = builder.build_eframe(move |context| Viewer::new(context, options).expect("a window"));

    step_until(&mut harness, |viewer| viewer.picture().is_some());
    println!("first picture: {:.2} s", began.elapsed().as_secs_f64());
    step_until(&mut harness, |viewer| {
        viewer
            .picture()
            .is_some_and(|(layers, _)| layers.indirect.pixels.iter().any(|pixel| pixel.max_element() > 0.0))
    });
    println!("first indirect light: {:.2} s", began.elapsed().as_secs_f64());
    step_until(&mut harness, Viewer::is_settled);

    let light = harness.state().handle().expect("a light that stands somewhere");
    let picture = harness.get_by_label("Picture").rect();
    let zoom = (picture.width() / 640.0).min(picture.height() / 480.0);
    let corner = picture.center() - 0.5 * zoom * vec2(640.0, 480.0);
    let at = corner + zoom * vec2(light.x, light.y);
    let known = harness.state().latencies().len();
    harness.hover_at(at);
    pace(&mut harness);
    harness.drag_at(at);
    pace(&mut harness);
    for step in 0..STEPS {
        let angle = step as f32 * 0.1;
        harness.hover_at(at + vec2(40.0 * angle.sin(), 20.0 * (1.0 - angle.cos())));
        pace(&mut harness);
    }
    harness.drop_at(at);
    step_until(&mut harness, Viewer::is_settled);
    let mut latencies: Vec<f64> =
        harness.state().latencies()[known..].iter().map(|time| time.as_secs_f64() * 1e3).collect();
    latencies.sort_by(f64::total_cmp);
    let share = |share: f64| latencies[((latencies.len() - 1) as f64 * share).round() as usize];
    println!(
        "{} pictures of {STEPS} edits: {:.0} ms after the edit (median), {:.0} ms (95%), {:.0} ms (worst)",
        latencies.len(),
        share(0.5),
        share(0.95),
        share(1.0)
    );
}

/// One frame of the window, no sooner than a display would take it.
fn pace(harness: &mut Harness<'_, Viewer>) {
    let began = Instant::now();
    harness.step();
    std::thread::sleep(FRAME.saturating_sub(began.elapsed()));
}

fn step_until(harness: &mut Harness<'_, Viewer>, done: impl Fn(&Viewer) -> bool) {
    while !done(harness.state()) {
        pace(harness);
    }
}
