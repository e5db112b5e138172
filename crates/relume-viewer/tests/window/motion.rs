//! Rigs that move: frames, keys, playing, sequences of images.

use std::path::Path;

use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Modifiers, vec2};
use egui_kittest::kittest::Queryable;
use relume::image::LightLayers;
use relume::relight::RelightSettings;
use relume::{Relighter, Transfer};
use relume_io::{AnimatedRig, Field, Subject, read_exr, read_png};

use crate::files::close;
use crate::support::{Window, folder};

fn with_rig(name: &str) -> tempfile::TempDir {
    let folder = folder();
    let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/rigs");
    std::fs::copy(rigs.join(name), folder.path().join("arcade.toml")).unwrap();
    folder
}

fn animated() -> tempfile::TempDir {
    with_rig("arcade_animated.toml")
}

fn saved(folder: &Path) -> AnimatedRig {
    AnimatedRig::load(folder.join("arcade.toml")).unwrap()
}

fn keys(rig: &AnimatedRig, light: &str, key: &str) -> Option<Vec<i32>> {
    let field = Field { of: Subject::Light(light.to_owned()), key: key.to_owned() };
    rig.curves().find(|curve| curve.field == field).map(|curve| curve.frames.to_vec())
}

#[test]
fn a_light_is_keyed_and_moves() {
    let folder = with_rig("arcade_move.toml");
    let mut window = Window::open(folder.path());
    window.click("lantern");
    window.key(Modifiers::NONE, Key::K);
    window.settle();
    let from = window.light("lantern").position().unwrap();
    let before = window.layers();
    for _ in 0..10 {
        window.key(Modifiers::NONE, Key::Period);
    }
    let (corner, zoom) = window.picture();
    let at = window.harness.state().handle().unwrap();
    let at = corner + zoom * vec2(at.x, at.y);
    window.drag(at, at + vec2(60.0, 0.0));
    window.settle();
    let to = window.light("lantern").position().unwrap();
    assert!(to.distance(from) > 0.1 && window.layers().full() != before.full(), "{from} {to}");
    window.key(Modifiers::COMMAND, Key::S);
    let rig = saved(folder.path());
    assert_eq!(keys(&rig, "lantern", "position"), Some(vec![1, 11]));
    assert_eq!(rig.rig(11.0).unwrap(), *window.rig());
    window.click("First frame");
    window.settle();
    assert_eq!(window.light("lantern").position(), Some(from));
    assert_eq!(window.layers().full(), before.full(), "the first frame is as it was");
    window.key(Modifiers::COMMAND, Key::Z);
    window.click("Last frame");
    assert_eq!(window.light("lantern").position(), Some(from), "the drag is undone at every frame");
}

#[test]
fn what_moves_is_kept_when_it_is_saved() {
    let folder = animated();
    let before = saved(folder.path());
    let mut window = Window::open(folder.path());
    window.click("Key after");
    window.settle();
    assert_eq!(*window.rig(), before.rig(12.0).unwrap(), "of exposure");
    window.key(Modifiers::NONE, Key::Comma);
    assert_eq!(*window.rig(), before.rig(11.0).unwrap());
    // what rests changes at all frames
    window.click("Enable sky");
    window.settle();
    window.key(Modifiers::COMMAND, Key::S);
    let after = saved(folder.path());
    assert_eq!(after.frames(), before.frames());
    for frame in [1.0, 11.0, 48.0] {
        let (was, is) = (before.rig(frame).unwrap(), after.rig(frame).unwrap());
        assert!(was.lights[1].enabled && !is.lights[1].enabled);
        assert_eq!((&was.lights[0], &was.lights[2]), (&is.lights[0], &is.lights[2]));
    }
    assert_eq!(keys(&after, "sky", "intensity"), Some(vec![1, 40]), "it was not touched");
}

#[test]
fn keys_of_the_selected_light_are_shown_and_changed() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    window.click("sky");
    window.click("Take the key of intensity of sky away");
    window.key(Modifiers::COMMAND, Key::S);
    assert_eq!(keys(&saved(folder.path()), "sky", "intensity"), Some(vec![40]));
    window.key(Modifiers::COMMAND, Key::Z);
    window.click("Hold intensity of sky as it is");
    window.key(Modifiers::COMMAND, Key::S);
    let rig = saved(folder.path());
    assert_eq!(keys(&rig, "sky", "intensity"), None);
    assert_eq!(rig.rig(48.0).unwrap().lights[1], rig.rig(1.0).unwrap().lights[1]);
    window.key(Modifiers::COMMAND, Key::Z);
    window.key(Modifiers::COMMAND, Key::S);
    assert_eq!(keys(&saved(folder.path()), "sky", "intensity"), Some(vec![1, 40]));
}

#[test]
fn it_plays_over_and_over() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    let rig = saved(folder.path());
    window.key(Modifiers::NONE, Key::Space);
    let first = rig.rig(1.0).unwrap();
    window.until("another frame", |viewer| *viewer.rig() != first);
    window.until("the last frames", |viewer| viewer.rig().exposure == 0.4);
    window.until("the first frames", |viewer| viewer.rig().exposure == 0.0);
    window.key(Modifiers::NONE, Key::Space);
    window.settle();
    let still = window.rig().clone();
    assert!((1..=48).any(|frame| rig.rig(f64::from(frame)).unwrap() == still), "a whole frame");
    std::thread::sleep(std::time::Duration::from_millis(100));
    window.harness.run_steps(3);
    assert_eq!(*window.rig(), still);
    assert!(!window.is_said("*arcade"), "playing is no edit");
}

#[test]
fn every_frame_is_written() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    window.click("File");
    window.click("Layers of each light in EXR");
    window.key(Modifiers::NONE, Key::Escape);
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    window.answer(&folder.path().join("film.####.exr"));
    window.until_said("Wrote 48 frames");
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    window.answer(&folder.path().join("film.##.png"));
    window.until("the last one", |_| folder.path().join("film.48.png").exists());
    let mut relighter = Relighter::new(Transfer::load(folder.path().join("arcade.relume")).unwrap());
    let rig = saved(folder.path());
    for frame in [1, 17, 48] {
        let rig = rig.rig(f64::from(frame)).unwrap();
        let settings = RelightSettings { per_light: true, ..RelightSettings::default() };
        let expected = relighter.relight(&rig, &settings).unwrap();
        let exr = read_exr(folder.path().join(format!("film.{frame:04}.exr"))).unwrap();
        let error = relume::image::metrics::relative_l2(&exr.image, &expected.full()).unwrap();
        assert!(error < 1e-3, "{frame}: {error} off, which is more than half floats are");
        let names = |lights: &[LightLayers]| {
            lights.iter().map(|light| light.name.clone()).collect::<std::collections::BTreeSet<_>>()
        };
        assert_eq!(names(&exr.per_light), names(&expected.per_light));
        assert!(!exr.attributes.is_empty(), "it says how it was made");
    }
    assert_eq!(read_png(folder.path().join("film.01.png")).unwrap().width, 96);
    assert!(!folder.path().join("film.0049.exr").exists() && !folder.path().join("film.0000.exr").exists());
}

#[test]
fn names_of_frames_are_told_before_any_is_written() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    for (name, fault) in
        [("film.exr", "has no # for the number"), ("film.####.jpg", "must end in .exr or .png")]
    {
        window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
        window.answer(&folder.path().join(name));
        window.until_said(fault);
    }
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    window.answer(&folder.path().join("gone/film.####.exr"));
    window.until_said("gone/film.0001.exr");
}

/// By a key far away.
fn make_long(window: &mut Window) {
    window.harness.get_by_role_and_label(Role::SpinButton, "Frame").set_value_accesskit(20_000.0);
    window.harness.run_steps(3);
    window.key(Modifiers::NONE, Key::K);
    window.settle();
    window.key(Modifiers::COMMAND, Key::S);
}

#[test]
fn an_export_can_be_stopped_and_closing_asks_for_it() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    make_long(&mut window);
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    window.answer(&folder.path().join("film.####.png"));
    window.until("a frame", |_| folder.path().join("film.0001.png").exists());
    close(&mut window);
    assert!(window.is_said("Frames are still being written"));
    window.click("Keep it open");
    assert!(!window.is_said("Frames are still being written") && window.is_said("of 20000"));
    window.click("Stop");
    window.until_said("The export has ended");
    let written = std::fs::read_dir(folder.path()).unwrap().filter_map(Result::ok);
    let written = written.filter(|file| file.file_name().to_string_lossy().starts_with("film.")).count();
    assert!((1..20_000).contains(&written), "{written}");
    assert!(window.is_said(&format!("{written} of 20000 frames are written")));
}

#[test]
fn keys_that_were_never_saved_outlive_a_crash() {
    let folder = with_rig("arcade_move.toml");
    let mut window = Window::open(folder.path());
    window.key(Modifiers::NONE, Key::K);
    let kept = folder.path().join("state/unsaved");
    window.until("what is kept", |_| std::fs::read_dir(&kept).map_or(0, Iterator::count) > 0);
    drop(window);
    let mut window = Window::open(folder.path());
    assert!(window.is_said("never saved") && window.is_said("Play"));
    window.key(Modifiers::COMMAND, Key::S);
    assert_eq!(keys(&saved(folder.path()), "lantern", "position"), Some(vec![1]));
}

/// A spot whose inner angle grows, and whose outer one is made smaller than that will be.
#[test]
fn an_edit_that_cannot_be_is_taken_back_and_told() {
    let folder = folder();
    let text = "[[light]]\nname = \"spot\"\ntype = \"spot\"\nposition = [0, 3, 0]\ntarget = [0, 0, 0]\nintensity = [9, 9, 9]\n\
                inner_angle = 5\nouter_angle = 9\n[[animate]]\nlight = \"spot\"\nfield = \"inner_angle\"\nframes = [1, 9]\nvalues = [5, 8]\n";
    std::fs::write(folder.path().join("arcade.toml"), text).unwrap();
    let mut window = Window::open(folder.path());
    let before = window.rig().clone();
    window.harness.get_by_role_and_label(Role::SpinButton, "Outer angle").set_value_accesskit(6.0);
    window.settle();
    window.until_said("at frame 9: `inner_angle` (8) must not be above `outer_angle` (6)");
    assert_eq!(*window.rig(), before);
}

#[test]
fn what_is_done_to_keys_outlives_a_crash_too() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    window.click("Hold position of lantern as it is");
    let kept = folder.path().join("state/unsaved");
    window.until("what is kept", |_| std::fs::read_dir(&kept).map_or(0, Iterator::count) > 0);
    drop(window);
    let mut window = Window::open(folder.path());
    assert!(window.is_said("never saved"));
    window.key(Modifiers::COMMAND, Key::S);
    let rig = saved(folder.path());
    assert_eq!((keys(&rig, "lantern", "position"), rig.frames()), (None, Some(1..=40)));
}

#[test]
fn a_copy_moves_as_its_light_does() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    window.key(Modifiers::COMMAND, Key::D);
    window.key(Modifiers::COMMAND, Key::S);
    let rig = saved(folder.path());
    assert_eq!(keys(&rig, "lantern 2", "position"), keys(&rig, "lantern", "position"));
    window.key(Modifiers::COMMAND, Key::Z);
    assert_eq!(window.rig().lights.len(), 3);
}

#[test]
fn playing_goes_on_from_where_one_has_gone() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    let rig = saved(folder.path());
    window.harness.get_by_role_and_label(Role::SpinButton, "Frames a second").set_value_accesskit(1.0);
    window.harness.run_steps(3);
    window.key(Modifiers::NONE, Key::Space);
    window.harness.get_by_role_and_label(Role::SpinButton, "Frame").set_value_accesskit(30.0);
    window.harness.run_steps(8);
    assert_eq!(*window.rig(), rig.rig(30.0).unwrap());
    window.until("the next frame", |viewer| *viewer.rig() == rig.rig(31.0).unwrap());
}

#[test]
fn what_is_too_late_keeps_the_window_open() {
    let folder = animated();
    let mut window = Window::open(folder.path());
    make_long(&mut window);
    let film = folder.path().join("film");
    std::fs::create_dir(&film).unwrap();
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::E);
    window.answer(&film.join("frame.####.png"));
    window.until("a frame", |_| film.join("frame.0001.png").exists());
    close(&mut window);
    assert!(window.is_said("Frames are still being written"));
    std::fs::rename(&film, folder.path().join("elsewhere")).unwrap();
    window.until_said("Error:");
    assert!(!window.is_said("Frames are still being written"));
}
