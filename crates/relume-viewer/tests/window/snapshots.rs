//! The main states of the window, as pictures that were looked at once and kept.
//!
//! `UPDATE_SNAPSHOTS=1 cargo test -p relume-viewer --test window snapshots` makes them anew. Skipped, by name, where nothing can draw.

use eframe::egui::{Key, Modifiers, Rect, pos2};
use eframe::wgpu;
use egui_kittest::kittest::Queryable;
use egui_kittest::{Harness, SnapshotOptions};

use crate::support::{Window, folder};

/// Whether there is a device to draw with.
///
/// # Panics
/// If there is none and `RELUME_REQUIRE_GPU=1`.
fn can_draw() -> bool {
    let instance = wgpu::Instance::default();
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
    let required = std::env::var_os("RELUME_REQUIRE_GPU").is_some_and(|value| value == "1");
    assert!(
        adapter.is_ok() || !required,
        "no adapter, and RELUME_REQUIRE_GPU=1: install mesa-vulkan-drivers"
    );
    if adapter.is_err() {
        println!("skipped: no adapter");
    }
    adapter.is_ok()
}

/// What may differ: another processor rounds light and text otherwise, by a step or two of 255 and at a few edges. A change that anyone would see is a thousand
/// times that (`a_picture_that_was_changed_is_noticed`).
fn within() -> SnapshotOptions {
    SnapshotOptions::new().threshold(8.0).max_failed_pixels(300)
}

fn options() -> SnapshotOptions {
    within().output_path(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/snapshots"))
}

/// Opens the window where it can be drawn.
fn open(folder: &std::path::Path) -> Window {
    Window::open_as(folder, Some("arcade.toml"), Harness::builder().wgpu())
}

/// Covers what depends on the time of day, the lines at the bottom, in the next picture that is taken.
fn mask(window: &mut Window) {
    window.harness.mask(Rect::from_min_max(pos2(0.0, 758.0), pos2(1280.0, 800.0)));
}

#[test]
fn the_window_looks_as_it_did() {
    if !can_draw() {
        return;
    }
    let folder = folder();
    let mut window = open(folder.path());
    mask(&mut window);
    window.harness.snapshot_options("opened", &options());
    window.choose("Add", "Spot");
    window.key(Modifiers::NONE, Key::W);
    window.settle();
    mask(&mut window);
    window.harness.snapshot_options("spot_and_wipe", &options());
    window.key(Modifiers::NONE, Key::W);
    window.key(Modifiers::NONE, Key::F1);
    window.settle();
    mask(&mut window);
    window.harness.snapshot_options("help", &options());
}

#[test]
fn the_line_of_frames_looks_as_it_did() {
    if !can_draw() {
        return;
    }
    let folder = folder();
    let rig = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/rigs/arcade_animated.toml");
    std::fs::copy(rig, folder.path().join("arcade.toml")).unwrap();
    let mut window = open(folder.path());
    window.click("Key after");
    window.settle();
    mask(&mut window);
    window.harness.snapshot_options("frames", &options());
}

/// The same comparison fails where the picture is another one, however little of the window that is.
#[test]
fn a_picture_that_was_changed_is_noticed() {
    if !can_draw() {
        return;
    }
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        return println!("skipped: snapshots are being made anew, and none is compared");
    }
    let folder = folder();
    let mut window = open(folder.path());
    let own = tempfile::tempdir().unwrap();
    let options = || within().output_path(own.path());
    // the first time there is nothing to compare with: it is kept
    mask(&mut window);
    let first = window.harness.render().unwrap();
    first.save(own.path().join("state.png")).unwrap();
    mask(&mut window);
    assert!(window.harness.try_snapshot_options("state", &options()).is_ok());
    let exposure =
        window.harness.get_by_role_and_label(eframe::egui::accesskit::Role::SpinButton, "Exposure");
    exposure.set_value_accesskit(0.3);
    window.settle();
    mask(&mut window);
    assert!(
        window.harness.try_snapshot_options("state", &options()).is_err(),
        "a third of a stop was not noticed"
    );
}
