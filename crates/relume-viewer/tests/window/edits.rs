//! Editing lights: by the list, by fields, in the picture.

use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Modifiers, vec2};
use egui_kittest::kittest::Queryable;
use relume::glam::Vec3;
use relume::{LightKind, Relighter, Transfer};

use crate::support::{Window, folder, fresh_folder};

#[test]
fn lights_are_added_edited_and_undone() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let before = window.rig().clone();
    window.choose("Add", "Omni");
    assert_eq!(window.rig().lights.len(), before.lights.len() + 1);
    window.settle();
    let radius = window.harness.get_by_label("Radius");
    radius.set_value_accesskit(0.25);
    window.harness.run_steps(3);
    assert!(matches!(window.light("omni").kind, LightKind::Omni { radius, .. } if radius == 0.25));
    window.settle();
    window.key(Modifiers::COMMAND, Key::Z);
    assert!(matches!(window.light("omni").kind, LightKind::Omni { radius, .. } if radius == 0.0));
    window.key(Modifiers::COMMAND, Key::Z);
    assert_eq!(*window.rig(), before);
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    assert_eq!(window.rig().lights.len(), before.lights.len() + 1);
    // the menu says what it would undo
    window.click("Edit");
    assert!(window.is_said("Undo add omni"));
}

#[test]
fn lights_are_copied_deleted_and_turned_off() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let count = window.rig().lights.len();
    let name = window.rig().lights[0].name.clone();
    window.click(&name);
    window.key(Modifiers::COMMAND, Key::D);
    assert_eq!(window.rig().lights.len(), count + 1);
    assert_eq!(window.rig().lights[0].kind, window.rig().lights[1].kind);
    window.key(Modifiers::NONE, Key::Delete);
    assert_eq!(window.rig().lights.len(), count);
    let lit = window.layers().full();
    window.click(&format!("Enable {name}"));
    assert!(!window.light(&name).enabled);
    window.settle();
    assert_ne!(window.layers().full(), lit);
}

#[test]
fn one_light_is_shown_alone_and_the_rig_stays() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (rig, all) = (window.rig().clone(), window.layers().full());
    let name = rig.lights[0].name.clone();
    window.click(&format!("Solo {name}"));
    window.settle();
    let alone = window.layers();
    assert_eq!(*window.rig(), rig);
    assert_ne!(alone.full(), all);
    let mut only = rig.clone();
    only.lights.retain(|light| light.name == name);
    let transfer = Transfer::load(folder.path().join("arcade.relume")).unwrap();
    let expected = Relighter::new(transfer).relight(&only, &Default::default()).unwrap();
    assert_eq!(alone.indirect, expected.indirect);
    window.click(&format!("Solo {name}"));
    window.settle();
    assert_eq!(window.layers().full(), all);
}

#[test]
fn the_newest_of_many_edits_is_what_is_seen() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    for step in 1..=30 {
        let radius = window.harness.get_by_label("Radius");
        radius.set_value_accesskit(f64::from(step) / 100.0);
        window.harness.step();
    }
    window.settle();
    assert!(matches!(window.light("omni").kind, LightKind::Omni { radius, .. } if radius == 0.3));
    let transfer = Transfer::load(folder.path().join("arcade.relume")).unwrap();
    let expected = Relighter::new(transfer).relight(window.rig(), &Default::default()).unwrap();
    assert_eq!(window.layers().full(), expected.full(), "the picture is not that of the last edit");
}

#[test]
fn a_light_is_dragged_in_the_picture_as_one_step() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let start = window.light("omni").position().unwrap();
    let transfer = Transfer::load(folder.path().join("arcade.relume")).unwrap();
    let view = &transfer.view;
    let (corner, zoom) = window.picture();
    let (at, _) = view.camera.project(start, view.width, view.height).unwrap();
    let from = corner + vec2(at.x, at.y) * zoom;
    window.drag(from, from + vec2(-60.0, 25.0));
    let moved = window.light("omni").position().unwrap();
    let (to, _) = view.camera.project(moved, view.width, view.height).unwrap();
    assert!((to - at - relume::glam::Vec2::new(-60.0, 25.0) / zoom).length() < 0.5, "{at} to {to}");
    window.settle();
    window.key(Modifiers::COMMAND, Key::Z);
    assert_eq!(window.light("omni").position(), Some(start), "a drag is one step");
}

#[test]
fn a_drag_that_is_taken_back_changes_nothing() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let (start, transfer) = (
        window.light("omni").position().unwrap(),
        Transfer::load(folder.path().join("arcade.relume")).unwrap(),
    );
    let (corner, zoom) = window.picture();
    let (at, _) = transfer.view.camera.project(start, transfer.view.width, transfer.view.height).unwrap();
    let from = corner + vec2(at.x, at.y) * zoom;
    window.harness.hover_at(from);
    window.harness.run_steps(2);
    window.harness.drag_at(from);
    window.harness.step();
    for step in 1..6 {
        window.harness.hover_at(from + vec2(10.0 * step as f32, 0.0));
        window.harness.step();
    }
    assert_ne!(window.light("omni").position(), Some(start));
    window.key(Modifiers::NONE, Key::Escape);
    window.harness.drop_at(from + vec2(50.0, 0.0));
    window.harness.run_steps(3);
    assert_eq!(window.light("omni").position(), Some(start));
}

#[test]
fn lights_are_placed_by_what_they_do() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Spot");
    window.settle();
    let transfer = Transfer::load(folder.path().join("arcade.relume")).unwrap();
    let view = &transfer.view;
    let (corner, zoom) = window.picture();
    // a place on the floor
    let (column, row) = (48, 60);
    let seen = view.centers[row * view.width + column];
    let at = corner + vec2(column as f32 + 0.5, row as f32 + 0.5) * zoom;
    let click = |window: &mut Window, at| {
        window.harness.hover_at(at);
        window.harness.step();
        window.harness.drag_at(at);
        window.harness.step();
        window.harness.drop_at(at);
        window.harness.run_steps(3);
    };
    window.key(Modifiers::NONE, Key::A);
    click(&mut window, at);
    assert!(matches!(window.light("spot").kind, LightKind::Spot { target, .. } if target == seen.position));
    window.key(Modifiers::NONE, Key::Escape);
    window.key(Modifiers::NONE, Key::H);
    click(&mut window, at);
    let (light, eye) = (window.light("spot").position().unwrap(), view.camera.position());
    let half = ((light - seen.position).normalize() + (eye - seen.position).normalize()).normalize();
    assert!(half.distance(seen.shading_normal.get()) < 1e-3, "{half}");
    window.key(Modifiers::NONE, Key::J);
    let edge = view.centers[30 * view.width + 20];
    click(&mut window, corner + vec2(20.5, 30.5) * zoom);
    click(&mut window, at);
    let light = window.light("spot").position().unwrap();
    let way = (edge.position - seen.position).normalize();
    assert!(
        (light - edge.position).normalize().distance(way) < 1e-3,
        "the edge is not between light and shadow"
    );
    assert!(light.is_finite() && light != Vec3::ZERO);
}

#[test]
fn lights_are_renamed_and_no_name_is_had_twice() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (first, second) = (window.rig().lights[0].name.clone(), window.rig().lights[1].name.clone());
    let rename = |window: &mut Window, from: &str, to: &str| {
        let label = window.harness.get_by_label(from);
        let at = label.rect().center();
        for _ in 0..2 {
            window.harness.hover_at(at);
            window.harness.drag_at(at);
            window.harness.drop_at(at);
        }
        window.harness.run_steps(3);
        let line = window.harness.get_by_role(Role::TextInput);
        line.set_text_value_accesskit(to);
        window.harness.run_steps(2);
        window.key(Modifiers::NONE, Key::Enter);
    };
    rename(&mut window, &first, "moon");
    assert_eq!(window.rig().lights[0].name, "moon");
    window.harness.run_steps(40); // or its clicks would count with those before
    rename(&mut window, "moon", &second);
    assert_eq!(window.rig().lights[0].name, "moon");
    assert!(window.is_said(&format!("another light is called {second}")));
}

#[test]
fn the_list_selects_and_is_put_in_order() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let names: Vec<String> = window.rig().lights.iter().map(|light| light.name.clone()).collect();
    window.click(&names[2]);
    assert!(window.is_said(&format!("{} (", names[2])), "its fields are not shown");
    let at = |window: &Window, name: &str| window.harness.get_by_label(name).rect().center();
    let (from, to) = (at(&window, &names[2]), at(&window, &names[0]));
    window.drag(from, to);
    let after: Vec<&str> = window.rig().lights.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(after, [&names[2], &names[0], &names[1]]);
    window.settle();
    window.key(Modifiers::COMMAND, Key::Z);
    assert_eq!(window.rig().lights[0].name, names[0]);
}

/// What would change the list while a light is held waits: or the light would be dragged on as another one.
#[test]
fn keys_wait_while_a_light_is_held() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let names = |window: &Window| -> Vec<String> {
        window.rig().lights.iter().map(|light| light.name.clone()).collect()
    };
    let before = names(&window);
    let (corner, zoom) = window.picture();
    let at = window.harness.state().handle().unwrap();
    let from = corner + vec2(at.x, at.y) * zoom;
    window.harness.hover_at(from);
    window.harness.run_steps(2);
    window.harness.drag_at(from);
    window.harness.step();
    window.harness.hover_at(from + vec2(30.0, 0.0));
    window.harness.run_steps(2);
    for (modifiers, key) in
        [(Modifiers::NONE, Key::Delete), (Modifiers::COMMAND, Key::D), (Modifiers::COMMAND, Key::Z)]
    {
        window.key(modifiers, key);
    }
    window.harness.hover_at(from + vec2(40.0, 0.0));
    window.harness.run_steps(2);
    window.harness.drop_at(from + vec2(40.0, 0.0));
    window.harness.run_steps(3);
    assert_eq!(names(&window), before);
}

#[test]
fn a_light_is_looked_through_and_turned_so() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.click("statue");
    let LightKind::Spot { position, target, .. } = window.light("statue").kind else { panic!("a spot") };
    window.key(Modifiers::NONE, Key::T);
    while window.harness.query_by_label("Through the light").is_none() {
        window.harness.step();
    }
    let inset = window.harness.get_by_label("Through the light").rect().center();
    window.drag(inset, inset + vec2(40.0, 0.0));
    let LightKind::Spot { position: stays, target: turned, .. } = window.light("statue").kind else {
        panic!("a spot")
    };
    assert_eq!(stays, position);
    let angle = (target - position).angle_between(turned - position).to_degrees();
    assert!((2.0..15.0).contains(&angle), "turned by {angle} degrees");
    window.settle();
    window.key(Modifiers::COMMAND, Key::Z);
    assert!(matches!(window.light("statue").kind, LightKind::Spot { target: now, .. } if now == target));
    // a dome is everywhere: there is nothing to look through
    window.choose("Add", "Dome");
    window.settle();
    assert!(window.harness.query_by_label("Through the light").is_none());
}

#[test]
fn light_has_a_temperature_and_is_measured_in_stops() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let strength = window.light("omni").color().max_element();
    window.harness.get_by_role_and_label(Role::SpinButton, "Colour temperature").set_value_accesskit(2700.0);
    window.harness.run_steps(3);
    let warm = window.light("omni").color();
    assert!((warm / strength).distance(relume::scene::black_body_color(2700.0)) < 1e-3, "{warm}");
    window.harness.get_by_role_and_label(Role::ComboBox, "Unit of the intensity").click();
    window.harness.run_steps(3);
    window.harness.get_by_role_and_label(Role::Button, "stops").click();
    window.harness.run_steps(3);
    assert_eq!(window.light("omni").color(), warm, "another unit is no edit");
    window.harness.get_by_role_and_label(Role::SpinButton, "Intensity").set_value_accesskit(3.0);
    window.harness.run_steps(3);
    assert!((window.light("omni").color().max_element() - 8.0).abs() < 1e-3);
}

#[test]
fn what_emits_is_dimmed_and_reset() {
    let folder = fresh_folder();
    let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    std::fs::copy(assets.join("parlour.glb"), folder.path().join("arcade.glb")).unwrap();
    let mut window = Window::open_with(folder.path(), None);
    let lit = window.layers().full();
    let name = "lamp: times what it emits in the scene";
    window.harness.get_by_role_and_label(Role::SpinButton, name).set_value_accesskit(0.25);
    window.settle();
    assert_eq!(window.rig().emitters[0].scale, Vec3::splat(0.25));
    assert_ne!(window.layers().full(), lit);
    window.click("lamp as in the scene");
    window.settle();
    assert!(window.rig().emitters.is_empty());
    assert_eq!(window.layers().full(), lit);
}

/// The longer of two combinations is not taken for the shorter one where there is nothing for it to do.
#[test]
fn a_key_without_anything_to_do_does_nothing() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let rig = window.rig().clone();
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    assert_eq!(*window.rig(), rig, "there was nothing to do again, and nothing was undone");
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    assert!(!window.is_said("Export the image"), "nothing moves");
}

/// A number is shown with a few digits, and keeps the others when its field is only looked into.
#[test]
fn a_field_that_is_left_as_it_was_keeps_its_digits() {
    let folder = folder();
    let rig = folder.path().join("arcade.toml");
    let text = std::fs::read_to_string(&rig).unwrap();
    std::fs::write(&rig, text.replace("exposure = 0.0", "exposure = 0.123456")).unwrap();
    let mut window = Window::open(folder.path());
    let field = window.harness.get_by_role_and_label(Role::SpinButton, "Exposure").rect().center();
    for (at, done) in [(field, false), (eframe::egui::pos2(1100.0, 640.0), true)] {
        window.harness.hover_at(at);
        window.harness.drag_at(at);
        window.harness.drop_at(at);
        window.harness.run_steps(4);
        assert!(done || window.harness.ctx.egui_wants_keyboard_input(), "the field is typed into");
    }
    window.settle();
    assert_eq!(window.rig().exposure, 0.123_456);
    assert!(!window.harness.ctx.egui_wants_keyboard_input());
    // what is typed is taken as it is, also where it looks the same
    window.harness.hover_at(field);
    window.harness.drag_at(field);
    window.harness.drop_at(field);
    window.harness.run_steps(4);
    window.key(Modifiers::COMMAND, Key::A);
    window.harness.event(eframe::egui::Event::Text("0.12".to_owned()));
    window.harness.run_steps(2);
    window.key(Modifiers::NONE, Key::Enter);
    window.settle();
    assert_eq!(window.rig().exposure, 0.12);
}
