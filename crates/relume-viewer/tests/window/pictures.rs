//! What is shown.

use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Modifiers, Theme, pos2, vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use relume::glam::Vec3;
use relume_viewer::Pane;

use crate::support::{Window, folder};

/// Chooses what one of the two panes shows.
fn show(window: &mut Window, pane: &str, view: &str) {
    window.harness.get_by_role_and_label(Role::ComboBox, pane).click();
    window.harness.run_steps(3);
    window.harness.get_by_role_and_label(Role::Button, view).click();
    window.harness.run_steps(3);
    window.settle();
}

/// The mean display colour of a pane.
fn mean(window: &Window, pane: Pane) -> Vec3 {
    let print = window.harness.state().shown(pane).expect("something is shown");
    let sum: Vec3 =
        print.pixels.iter().map(|c| Vec3::new(f32::from(c.r()), f32::from(c.g()), f32::from(c.b()))).sum();
    sum / print.pixels.len() as f32
}

#[test]
fn every_view_shows_something_of_its_own() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let light = format!("Light {}", window.rig().lights[0].name);
    let mut seen = vec![mean(&window, Pane::Left)];
    for view in ["Direct", "Indirect", "Albedo", "Normals", "Depth", "Luminance", &light] {
        show(&mut window, "Show", view);
        let shown = mean(&window, Pane::Left);
        assert!(shown.max_element() > 1.0, "{view} is black");
        assert!(
            seen.iter().all(|other| other.distance(shown) > 0.5),
            "{view} looks like another view: {seen:?}"
        );
        seen.push(shown);
    }
    show(&mut window, "Show", "Full");
    assert_eq!(mean(&window, Pane::Left), seen[0]);
}

#[test]
fn a_reference_is_traced_and_comes_near() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    show(&mut window, "Show", "Reference");
    window.until("some paths", |viewer| viewer.reference().is_some_and(|(paths, ..)| paths >= 128));
    let (_, noise, error) = window.harness.state().reference().unwrap();
    assert!(noise < 0.2 && error < 0.35, "noise {noise}, error {error}");
    window.harness.run_steps(3);
    assert!(window.is_said("paths, noise"));
    // other lights, another reference
    window.choose("Add", "Omni");
    window.settle();
    window.until("a reference of these lights", |viewer| {
        viewer.reference().is_some() && viewer.reference_is_current()
    });
}

#[test]
fn two_views_are_wiped() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.key(Modifiers::NONE, Key::W);
    show(&mut window, "Beside", "Albedo");
    assert_ne!(mean(&window, Pane::Left), mean(&window, Pane::Right));
    let line = window.harness.get_by_role_and_label(Role::Slider, "Wipe").rect().center();
    window.drag(line, line + vec2(-150.0, 0.0));
    let moved = window.harness.get_by_role_and_label(Role::Slider, "Wipe").rect().center();
    assert!((moved.x - line.x + 150.0).abs() < 3.0, "{line} to {moved}");
    window.key(Modifiers::NONE, Key::W);
    window.settle();
    assert!(window.harness.state().shown(Pane::Right).is_none());
}

#[test]
fn snapshots_are_kept_while_lights_change() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let before = mean(&window, Pane::Left);
    window.key(Modifiers::NONE, Key::P);
    let name = window.rig().lights[0].name.clone();
    window.click(&format!("Enable {name}"));
    window.settle();
    let after = mean(&window, Pane::Left);
    assert_ne!(before, after);
    window.click("Snapshot 1");
    window.settle();
    assert_eq!((mean(&window, Pane::Left), mean(&window, Pane::Right)), (after, before));
    window.click("Forget Snapshot 1");
    window.settle();
    assert_eq!(mean(&window, Pane::Right), after, "what is gone is not shown any more");
}

#[test]
fn exposure_changes_the_picture_and_not_the_light() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (light, before) = (window.layers().full(), mean(&window, Pane::Left));
    let exposure = window.harness.get_by_role_and_label(Role::SpinButton, "Exposure");
    exposure.set_value_accesskit(-2.0);
    window.settle();
    assert_eq!((window.rig().exposure, window.layers().full()), (-2.0, light));
    assert!(mean(&window, Pane::Left).max_element() < 0.8 * before.max_element());
}

#[test]
fn the_pixel_under_the_pointer_is_told() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (corner, zoom) = window.picture();
    window.harness.hover_at(corner + vec2(40.5, 50.5) * zoom);
    window.harness.run_steps(3);
    let layers = window.layers();
    let direct = layers.direct.pixels[50 * 96 + 40];
    assert!(window.is_said("40, 50   full"));
    assert!(window.is_said(&format!("direct {:.4}", direct.x)));
    window.harness.hover_at(pos2(2.0, 2.0));
    window.harness.run_steps(3);
    assert!(!window.is_said("40, 50   full"));
}

#[test]
fn zoom_and_pan_go_back_to_the_whole_picture() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (corner, zoom) = window.picture();
    let probe = |window: &mut Window, at| {
        window.harness.hover_at(at);
        window.harness.run_steps(3);
        window.harness.root().children_recursive().find_map(|node| {
            let text = node.accesskit_node().value().or(node.accesskit_node().label())?;
            text.contains("   full").then(|| text.split("   ").next().unwrap().to_owned())
        })
    };
    let at = corner + vec2(20.5, 20.5) * zoom;
    assert_eq!(probe(&mut window, at).as_deref(), Some("20, 20"));
    window.key(Modifiers::NONE, Key::Num1);
    assert_ne!(probe(&mut window, at).as_deref(), Some("20, 20"));
    window.key(Modifiers::NONE, Key::F);
    window.drag(at, at + vec2(30.0, 12.0));
    assert_eq!(
        probe(&mut window, at + vec2(30.0, 12.0)).as_deref(),
        Some("20, 20"),
        "the picture follows the pointer"
    );
    window.key(Modifiers::NONE, Key::F);
    assert_eq!(probe(&mut window, at).as_deref(), Some("20, 20"));
}

#[test]
fn the_window_is_dark_or_light() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    for (item, theme) in [("Light theme", Theme::Light), ("Dark theme", Theme::Dark)] {
        window.choose("View", item);
        assert_eq!(window.harness.ctx.theme(), theme);
    }
}
