//! How long one waits for the window: from the command to the first picture, to the first indirect light, and from an edit to its picture.
//!
//!     RELUME_SCENES=FOLDER cargo bench -p relume-viewer [-- [--drawn] [--prepared] [SPONZA.relume]]
//!
//! The window is the real one, with its workers, at 60 frames a second. By default nothing draws it; with `--drawn` every frame is drawn by the first adapter that
//! there is, and read back, and the time of an edit ends when the frame with its picture has been. What showing it on a display takes besides,
//! `relume view --times` tells. `--prepared` waits for full quality; a cache is opened in place of the scene.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::vec2;
use eframe::egui_wgpu::RendererOptions;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
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
    let cache = std::env::args().find(|argument| argument.ends_with(".relume"));
    let source = match cache {
        Some(cache) => {
            println!("{cache}");
            Source::new(cache)
        }
        None => {
            let scene = scene.display();
            println!("{scene}, 640x480, 65,536 gather samples, standard, while it is prepared");
            Source { cache: Some(folder.path().join("shot.relume")), ..Source::new(scene.to_string()) }
        }
    };
    let options = Options { source: Some(source), rig: Some(rig), ..Options::default() };
    let began = Instant::now();
    let mut builder = Harness::builder().with_size([1280.0, 800.0]).with_step_dt(1.0 / 60.0);
    let asked = |name: &str| std::env::args().any(|argument| argument == name);
    let drawn = asked("--drawn");
    if drawn {
        let state = create_render_state(default_wgpu_setup(), RendererOptions::default());
        println!("drawn by {}", state.adapter.get_info().name);
        builder = builder.renderer(WgpuTestRenderer::from_render_state(state));
    }
    let harness = builder.build_eframe(move |context| Viewer::new(context, options).expect("a window"));
    let mut screen = Screen { harness, drawn, latencies: Vec::new(), drawing: Vec::new(), work: Vec::new() };
    step_until(&mut screen, |viewer| viewer.picture().is_some());
    println!("first picture: {:.2} s", began.elapsed().as_secs_f64());
    step_until(&mut screen, |viewer| {
        viewer
            .picture()
            .is_some_and(|(layers, _)| layers.indirect.pixels.iter().any(|pixel| pixel.max_element() > 0.0))
    });
    println!("first indirect light: {:.2} s", began.elapsed().as_secs_f64());
    step_until(&mut screen, Viewer::is_settled);
    if asked("--prepared") {
        step_until(&mut screen, Viewer::is_prepared);
        println!("full quality: {:.1} s", began.elapsed().as_secs_f64());
    }

    let light = screen.harness.state().handle().expect("a light that stands somewhere");
    let picture = screen.harness.get_by_label("Picture").rect();
    let zoom = (picture.width() / 640.0).min(picture.height() / 480.0);
    let corner = picture.center() - 0.5 * zoom * vec2(640.0, 480.0);
    let at = corner + zoom * vec2(light.x, light.y);
    screen.harness.hover_at(at);
    screen.pace();
    screen.harness.drag_at(at);
    screen.pace();
    screen.latencies.clear();
    screen.work.clear();
    for step in 0..STEPS {
        let angle = step as f32 * 0.1;
        screen.harness.hover_at(at + vec2(40.0 * angle.sin(), 20.0 * (1.0 - angle.cos())));
        screen.pace();
    }
    screen.harness.drop_at(at);
    step_until(&mut screen, Viewer::is_settled);
    let [median, late, worst] = shares(&screen.latencies);
    println!(
        "{} pictures of {STEPS} edits: {median:.0} ms after the edit (median), {late:.0} ms (95%), {worst:.0} ms (worst)",
        screen.latencies.len(),
    );
    let median = |part: usize| {
        let mut times: Vec<f64> = screen.work.iter().map(|work| work[part]).collect();
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let parts = std::array::from_fn::<String, 7, _>(|part| format!("{} {:.1} ms", PARTS[part], median(part)));
    println!("medians: {}", parts.join(", "));
    if drawn {
        let [median, late, worst] = shares(&screen.drawing);
        println!(
            "drawing and reading back a frame: {median:.1} ms (median), {late:.1} ms (95%), {worst:.1} ms (worst)"
        );
    }
}

/// Median, 95th percentile and worst, milliseconds.
fn shares(times: &[Duration]) -> [f64; 3] {
    let mut times: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
    times.sort_by(f64::total_cmp);
    [0.5, 0.95, 1.0].map(|share| times[((times.len() - 1) as f64 * share).round() as usize])
}

/// What is measured of each picture.
const PARTS: [&str; 7] =
    ["relighting", "of it direct", "bounces", "final gather", "spreading", "sum; then", "developing"];

/// What shows the window.
struct Screen {
    harness: Harness<'static, Viewer>,
    drawn: bool,
    /// From edits to their pictures.
    latencies: Vec<Duration>,
    /// What drawing each frame took.
    drawing: Vec<Duration>,
    /// Of each picture, [`PARTS`] in milliseconds.
    work: Vec<[f64; 7]>,
}

impl Screen {
    /// One frame of the window, no sooner than a display would take it.
    fn pace(&mut self) {
        let began = Instant::now();
        let known = self.harness.state().latencies().len();
        self.harness.step();
        let mut took = Duration::ZERO;
        if self.drawn {
            let began = Instant::now();
            self.harness.render().expect("a drawn frame");
            took = began.elapsed();
            self.drawing.push(took);
        }
        let viewer = self.harness.state();
        if let Some((stats, developing)) = viewer.work().filter(|_| viewer.latencies().len() > known) {
            let parts = [stats.direct_ms, stats.bounces_ms, stats.gather_ms, stats.upsample_ms, stats.sum_ms];
            let [direct, bounces, gather, spreading, sum] = parts;
            let developing = developing.as_secs_f64() * 1e3;
            self.work.push([stats.frame_ms, direct, bounces, gather, spreading, sum, developing]);
        }
        self.latencies.extend(self.harness.state().latencies()[known..].iter().map(|time| *time + took));
        std::thread::sleep(FRAME.saturating_sub(began.elapsed()));
    }
}

fn step_until(screen: &mut Screen, done: impl Fn(&Viewer) -> bool) {
    while !done(screen.harness.state()) {
        screen.pace();
    }
}
