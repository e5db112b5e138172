//! A window without a display, on the arcade, small.

use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use eframe::egui::{Modifiers, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use relume::image::Layers;
use relume::transfer::{Quality, Settings};
use relume::{Light, LightRig};
use relume_viewer::{Dialogs, Options, Source, Viewer};

/// Longest that anything may take: far more than it does.
const PATIENCE: Duration = Duration::from_secs(120);

pub(crate) struct Window {
    pub(crate) harness: Harness<'static, Viewer>,
}

/// The folder of one test, with the arcade, its rig, and what was prepared of it: once for all tests.
pub(crate) fn folder() -> tempfile::TempDir {
    static PREPARED: OnceLock<Vec<u8>> = OnceLock::new();
    let folder = fresh_folder();
    let cache = folder.path().join("arcade.relume");
    let prepared = PREPARED.get_or_init(|| {
        drop(Window::open(folder.path()));
        std::fs::read(&cache).unwrap()
    });
    std::fs::write(&cache, prepared).unwrap();
    folder
}

/// The same without anything prepared.
pub(crate) fn fresh_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    for (from, to) in [
        ("arcade.glb", "arcade.glb"),
        ("rigs/arcade.toml", "arcade.toml"),
        ("rigs/arcade_sky.hdr", "arcade_sky.hdr"),
    ] {
        std::fs::copy(assets.join(from), folder.path().join(to)).unwrap();
    }
    folder
}

pub(crate) fn settings() -> Settings {
    Settings { size: (96, 72), gather: 256, quality: Quality::Draft, ..Settings::default() }
}

impl Window {
    /// Opens the arcade under its rig.
    pub(crate) fn open(folder: &Path) -> Self {
        Self::open_with(folder, Some("arcade.toml"))
    }

    pub(crate) fn open_with(folder: &Path, rig: Option<&str>) -> Self {
        Self::open_as(folder, rig, Harness::builder())
    }

    pub(crate) fn open_as(
        folder: &Path,
        rig: Option<&str>,
        builder: egui_kittest::HarnessBuilder<Viewer>,
    ) -> Self {
        let mut window = Self::begin(folder, rig, builder);
        window.settle();
        window
    }

    /// Opens it, and waits for nothing.
    pub(crate) fn begin(
        folder: &Path,
        rig: Option<&str>,
        builder: egui_kittest::HarnessBuilder<Viewer>,
    ) -> Self {
        Self::begin_with(folder, rig, builder, settings())
    }

    /// The same, prepared with other settings than most.
    pub(crate) fn begin_with(
        folder: &Path,
        rig: Option<&str>,
        builder: egui_kittest::HarnessBuilder<Viewer>,
        settings: Settings,
    ) -> Self {
        let source = Source { settings: settings.clone(), ..Source::new(folder.join("arcade.glb")) };
        let options = Options {
            source: Some(source),
            rig: rig.map(|rig| folder.join(rig)),
            state: Some(folder.join("state")),
            dialogs: Dialogs::Typed,
            settings,
            threads: 0,
            times: None,
        };
        // as fast as a display, so that two clicks are a double one
        let builder = builder.with_size([1280.0, 800.0]).with_max_steps(64).with_step_dt(1.0 / 60.0);
        let harness = builder.build_eframe(move |context| Viewer::new(context, options).unwrap());
        Self { harness }
    }

    /// Steps until `done`.
    pub(crate) fn until(&mut self, what: &str, done: impl Fn(&Viewer) -> bool) {
        let end = Instant::now() + PATIENCE;
        loop {
            self.harness.step();
            if done(self.harness.state()) {
                return;
            }
            assert!(Instant::now() < end, "waited in vain for {what}");
            std::thread::sleep(Duration::from_millis(4));
        }
    }

    /// Waits until the shot is prepared and the newest edit is to be seen in full.
    pub(crate) fn settle(&mut self) {
        self.harness.run_steps(4);
        self.until("a settled picture", |viewer| viewer.is_prepared() && viewer.is_settled());
        // edits at rest are noted
        self.harness.run_steps(2);
    }

    pub(crate) fn rig(&self) -> &LightRig {
        self.harness.state().rig()
    }

    pub(crate) fn light(&self, name: &str) -> &Light {
        self.rig().lights.iter().find(|light| light.name == name).unwrap_or_else(|| panic!("no light {name}"))
    }

    pub(crate) fn layers(&self) -> Layers {
        self.harness.state().picture().expect("a picture").0.clone()
    }

    /// Clicks what is called so.
    pub(crate) fn click(&mut self, label: &str) {
        self.harness.get_by_label(label).click();
        self.harness.run_steps(3);
    }

    /// Clicks something in a menu.
    pub(crate) fn choose(&mut self, menu: &str, item: &str) {
        self.click(menu);
        self.harness.get_by_label_contains(item).click();
        self.harness.run_steps(3);
    }

    pub(crate) fn key(&mut self, modifiers: Modifiers, key: eframe::egui::Key) {
        self.harness.key_press_modifiers(modifiers, key);
        self.harness.run_steps(3);
    }

    /// Types into the question for a file, and answers it.
    pub(crate) fn answer(&mut self, path: &Path) {
        let line = self.harness.get_by_role(eframe::egui::accesskit::Role::TextInput);
        line.set_text_value_accesskit(&path.display().to_string());
        self.harness.run_steps(2);
        self.click("OK");
        self.until("the file", |viewer| !viewer.is_reading());
        self.harness.run_steps(2);
    }

    /// Where the picture of the shot lies on the screen: its corner, and points a pixel.
    pub(crate) fn picture(&self) -> (Pos2, f32) {
        let rect = self.harness.get_by_label("Picture").rect();
        let (width, height) = settings().size;
        let zoom = (rect.width() / width as f32).min(rect.height() / height as f32);
        let size = eframe::egui::vec2(width as f32, height as f32) * zoom;
        (rect.center() - 0.5 * size, zoom)
    }

    /// Drags in steps from one point of the screen to another.
    pub(crate) fn drag(&mut self, from: Pos2, to: Pos2) {
        self.harness.hover_at(from);
        self.harness.run_steps(2);
        self.harness.drag_at(from);
        self.harness.step();
        for step in 1..=8 {
            self.harness.hover_at(from.lerp(to, step as f32 / 8.0));
            self.harness.step();
        }
        self.harness.drop_at(to);
        self.harness.run_steps(3);
    }

    /// Steps until something is to be read.
    pub(crate) fn until_said(&mut self, text: &str) {
        let end = Instant::now() + PATIENCE;
        while !self.is_said(text) {
            assert!(Instant::now() < end, "`{text}` is never said");
            self.harness.step();
            std::thread::sleep(Duration::from_millis(4));
        }
    }

    pub(crate) fn is_said(&self, text: &str) -> bool {
        self.harness.root().children_recursive().any(|node| {
            let node = node.accesskit_node();
            let of = |value: Option<String>| value.is_some_and(|value| value.contains(text));
            of(node.label()) || of(node.value())
        })
    }
}
