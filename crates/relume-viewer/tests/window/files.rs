//! Files: rigs saved and read again, unsaved edits after a crash, what cannot be read.

use std::time::{Duration, Instant};

use eframe::egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume_io::{load_rig, read_exr};
use relume_viewer::{Dialogs, Options, Viewer};

use crate::support::{Window, folder, fresh_folder};

#[test]
fn a_rig_is_saved_and_read_again() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Distant");
    window.settle();
    window.choose("File", "Save rig as");
    let path = folder.path().join("evening.toml");
    window.answer(&path);
    assert_eq!(load_rig(&path).unwrap(), *window.rig());
    assert!(window.is_said("Saved"));
    let rig = window.rig().clone();
    window.key(Modifiers::NONE, Key::Delete);
    window.settle();
    window.key(Modifiers::COMMAND, Key::S);
    assert_eq!(load_rig(&path).unwrap().lights.len(), rig.lights.len() - 1, "saved to the same file");
    let again = Window::open_with(folder.path(), Some("evening.toml"));
    assert_eq!(again.rig().lights.len(), rig.lights.len() - 1);
}

#[test]
fn the_second_opening_takes_what_the_first_has_prepared() {
    let folder = fresh_folder();
    let window = Window::open(folder.path());
    let picture = window.layers();
    drop(window);
    let cache = folder.path().join("arcade.relume");
    let written = cache.metadata().unwrap().modified().unwrap();
    let window = Window::open(folder.path());
    assert_eq!(cache.metadata().unwrap().modified().unwrap(), written, "it was prepared again");
    assert_eq!(window.layers().full(), picture.full());
    assert!(!folder.path().join("arcade.relume-blocks").exists());
}

#[test]
fn a_changed_scene_is_prepared_again() {
    let folder = fresh_folder();
    drop(Window::open(folder.path()));
    let cache = folder.path().join("arcade.relume");
    let before = std::fs::read(&cache).unwrap();
    let parlour = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/parlour.glb");
    std::fs::copy(parlour, folder.path().join("arcade.glb")).unwrap();
    let window = Window::open_with(folder.path(), None);
    assert_ne!(std::fs::read(&cache).unwrap(), before);
    drop(window);
}

#[test]
fn unsaved_edits_outlive_a_crash() {
    let folder = folder();
    let saved = load_rig(folder.path().join("arcade.toml")).unwrap();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    let edited = window.rig().clone();
    let kept = folder.path().join("state/unsaved");
    let end = Instant::now() + Duration::from_secs(60);
    while std::fs::read_dir(&kept).map_or(0, Iterator::count) == 0 {
        window.harness.step();
        assert!(Instant::now() < end, "nothing was kept");
        std::thread::sleep(Duration::from_millis(10));
    }
    drop(window); // nobody has asked, nothing was saved
    let mut window = Window::open(folder.path());
    assert_eq!(*window.rig(), edited);
    assert!(window.is_said("never saved"));
    assert_eq!(load_rig(folder.path().join("arcade.toml")).unwrap(), saved, "the file is as it was");
    window.key(Modifiers::COMMAND, Key::Z);
    assert_eq!(*window.rig(), saved);
    window.key(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.settle();
    window.key(Modifiers::COMMAND, Key::S);
    drop(window);
    let window = Window::open(folder.path());
    assert_eq!(*window.rig(), edited);
    assert!(!window.is_said("never saved"), "it was saved");
}

#[test]
fn what_cannot_be_read_is_told_until_it_is_dismissed() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let rig = window.rig().clone();
    std::fs::write(folder.path().join("bad.toml"), "[[light]]\nname = \"key\"\ntype = \"lamp\"\n").unwrap();
    window.choose("File", "Open rig");
    window.answer(&folder.path().join("bad.toml"));
    assert!(window.is_said("bad.toml: line 3"));
    assert_eq!(*window.rig(), rig, "edits are kept");
    window.choose("File", "Save rig as");
    window.answer(&folder.path().join("no/such/folder/rig.toml"));
    assert!(window.is_said("no/such/folder"));
    window.harness.run_steps(20);
    assert!(window.is_said("bad.toml: line 3"), "it stays");
    while window.is_said("bad.toml") || window.is_said("no/such") {
        let first = window.harness.get_all_by_label("Dismiss").next().expect("one to dismiss");
        first.click();
        window.harness.run_steps(3);
    }
}

#[test]
fn closing_asks_for_unsaved_edits() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    window.choose("Add", "Omni");
    window.settle();
    close(&mut window);
    assert!(window.is_said("Save the changes to arcade.toml?"));
    window.click("Cancel");
    assert!(!window.is_said("Save the changes"));
    close(&mut window);
    window.click("Save");
    window.harness.run_steps(3);
    assert_eq!(load_rig(folder.path().join("arcade.toml")).unwrap(), *window.rig());
}

pub(crate) fn close(window: &mut Window) {
    use eframe::egui::{ViewportEvent, ViewportId};
    let root = window.harness.input_mut().viewports.entry(ViewportId::ROOT).or_default();
    root.events.push(ViewportEvent::Close);
    window.harness.step();
    let root = window.harness.input_mut().viewports.entry(ViewportId::ROOT).or_default();
    root.events.clear();
    window.harness.run_steps(3);
}

#[test]
fn pictures_are_exported() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    for name in ["shot.exr", "shot.png"] {
        window.choose("File", "Export image");
        window.answer(&folder.path().join(name));
        window.until_said(&format!("Wrote {}", folder.path().join(name).display()));
        assert!(folder.path().join(name).is_file(), "{name}");
    }
    let exr = read_exr(folder.path().join("shot.exr")).unwrap();
    // half floats
    let (written, shown) = (exr.indirect.unwrap(), window.layers().indirect);
    assert!(relume::image::metrics::relative_l2(&written, &shown).unwrap() < 1e-3);
    window.choose("File", "Export image");
    window.answer(&folder.path().join("shot.tiff"));
    window.until_said("must end in .exr or .png");
}

#[test]
fn a_window_without_a_shot_waits_for_one() {
    let options = Options { dialogs: Dialogs::Typed, ..Options::default() };
    let builder = Harness::builder().with_size([900.0, 600.0]).with_max_steps(16);
    let mut harness = builder.build_eframe(move |context| Viewer::new(context, options).unwrap());
    harness.run();
    assert!(harness.state().picture().is_none());
}

/// What others have prepared is not this window's to replace.
#[test]
fn caches_of_others_are_left_alone() {
    let folder = fresh_folder();
    let (cache, own) = (folder.path().join("arcade.relume"), folder.path().join("arcade.view.relume"));
    let scene = relume_io::load_scene(&folder.path().join("arcade.glb")).unwrap().scene;
    let settings = relume::transfer::Settings { seed: 5, ..crate::support::settings() };
    let others = relume::Preparation::new(&scene).settings(settings).run(&()).unwrap();
    others.save(&cache).unwrap();
    for theirs in [std::fs::read(&cache).unwrap(), b"no cache at all".to_vec()] {
        std::fs::write(&cache, &theirs).unwrap();
        drop(Window::open(folder.path()));
        assert!(std::fs::read(&cache).unwrap() == theirs, "it was replaced");
        assert!(relume::Transfer::load(&own).is_ok());
    }
    let written = own.metadata().unwrap().modified().unwrap();
    drop(Window::open(folder.path()));
    assert_eq!(own.metadata().unwrap().modified().unwrap(), written, "its own was not taken");
}

/// A scene without lights gets one that shows, each time it is opened.
#[test]
fn there_is_light_where_none_was_given() {
    let folder = fresh_folder();
    for _ in 0..2 {
        let window = Window::open_with(folder.path(), None);
        assert!(!window.rig().lights.is_empty());
        assert!(window.layers().full().pixels.iter().any(|pixel| pixel.max_element() > 0.05));
    }
}

/// A rig of another scene is lit as far as it goes, and stays what it is.
#[test]
fn what_the_shot_has_not_is_told_and_kept() {
    let folder = folder();
    let mut text = std::fs::read_to_string(folder.path().join("arcade.toml")).unwrap();
    text += "\n[[material]]\nname = \"velvet of another scene\"\nbase_color = [0.1, 0.2, 0.3]\n";
    std::fs::write(folder.path().join("arcade.toml"), text).unwrap();
    let window = Window::open(folder.path());
    assert!(window.is_said("velvet of another scene"));
    assert_eq!(window.rig().materials.len(), 1);
    assert!(window.layers().full().pixels.iter().any(|pixel| pixel.max_element() > 0.05));
}

/// Another shot under the same lights: nothing of the first is shown as the second.
#[test]
fn another_shot_takes_the_place_of_the_first() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let (rig, first) = (window.rig().clone(), window.layers().full());
    window.key(Modifiers::NONE, Key::P);
    let parlour = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/parlour.glb");
    std::fs::copy(parlour, folder.path().join("parlour.glb")).unwrap();
    window.choose("File", "Open scene");
    window.answer(&folder.path().join("parlour.glb"));
    window.settle();
    assert_eq!(*window.rig(), rig);
    assert_ne!(window.layers().full(), first);
    assert!(!window.is_said("Snapshot 1"));
    assert!(folder.path().join("parlour.relume").is_file());
}

/// Edits that wait for the scene they are edits of are not lost where the window closes before that is read.
#[test]
fn edits_that_wait_outlive_a_short_look() {
    let folder = folder();
    let mut window = Window::open_with(folder.path(), None);
    window.choose("Add", "Spot");
    window.settle();
    let edited = window.rig().clone();
    let kept = folder.path().join("state/unsaved");
    while std::fs::read_dir(&kept).map_or(0, Iterator::count) == 0 {
        window.harness.step();
        std::thread::sleep(Duration::from_millis(10));
    }
    drop(window);
    let mut window = Window::begin(folder.path(), None, Harness::builder());
    eframe::App::on_exit(window.harness.state_mut());
    drop(window);
    let window = Window::open_with(folder.path(), None);
    assert_eq!(*window.rig(), edited);
    assert!(window.is_said("never saved"));
}

/// A file as a desktop drops it.
#[derive(Debug)]
struct Dropped(std::path::PathBuf);

impl eframe::egui::DroppedFile for Dropped {
    fn path(&self) -> &std::path::Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// Drops a file on the window, and waits until it is read.
fn drop_file(window: &mut Window, path: std::path::PathBuf) {
    drop_late(window, path);
    window.until("the file", |viewer| !viewer.is_reading());
    window.harness.run_steps(2);
}

/// Drops a file that comes later.
fn drop_late(window: &mut Window, path: std::path::PathBuf) {
    window.harness.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path)));
    window.harness.step();
    window.harness.input_mut().dropped_files.clear();
    window.harness.run_steps(3);
}

#[test]
fn maps_rigs_and_caches_are_dropped_on_the_window() {
    let folder = folder();
    let mut window = Window::open_with(folder.path(), None);
    drop_file(&mut window, folder.path().join("arcade_sky.hdr"));
    let dome = window.rig().lights.iter().find_map(|light| match &light.kind {
        relume::LightKind::Dome { map, .. } => map.as_ref(),
        _ => None,
    });
    assert!(dome.is_some(), "the map of a new dome");
    window.settle();
    window.key(Modifiers::COMMAND, Key::Z);
    drop_file(&mut window, folder.path().join("arcade.toml"));
    assert_eq!(*window.rig(), load_rig(folder.path().join("arcade.toml")).unwrap());
    window.settle();
    let before = window.layers().full();
    std::fs::rename(folder.path().join("arcade.relume"), folder.path().join("elsewhere.relume")).unwrap();
    drop_file(&mut window, folder.path().join("elsewhere.relume"));
    window.settle();
    assert_eq!(window.layers().full(), before);
    // and what is no such thing is told
    std::fs::write(
        folder.path().join("cut.relume"),
        &std::fs::read(folder.path().join("elsewhere.relume")).unwrap()[..5000],
    )
    .unwrap();
    drop_file(&mut window, folder.path().join("cut.relume"));
    window.until_said("cut.relume");
    std::fs::write(folder.path().join("nan.toml"), "exposure = nan\n").unwrap();
    drop_file(&mut window, folder.path().join("nan.toml"));
    window.until_said("nan.toml: line 1");
}

#[test]
fn a_preparation_is_paused_and_ended_and_goes_on_the_next_time() {
    let folder = fresh_folder();
    // long enough to be paused, also beside other tests
    let settings = relume::transfer::Settings { gather: 1024, ..crate::support::settings() };
    let begin =
        || Window::begin_with(folder.path(), Some("arcade.toml"), Harness::builder(), settings.clone());
    let mut window = begin();
    while window.harness.query_by_label("Pause").is_none() {
        window.harness.step();
        assert!(!window.harness.state().is_prepared(), "too fast to be paused");
    }
    window.click("Pause");
    assert!(window.is_said("Go on"));
    std::thread::sleep(Duration::from_secs(2));
    window.harness.run_steps(3);
    assert!(!window.harness.state().is_prepared(), "it went on");
    window.click("End");
    window.until_said("The preparation was ended");
    assert!(!folder.path().join("arcade.relume").exists());
    drop(window);
    let mut window = begin();
    window.settle();
    assert!(window.harness.state().is_prepared() && folder.path().join("arcade.relume").exists());
}

#[test]
fn what_was_open_lately_is_opened_again() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let other = folder.path().join("other.toml");
    std::fs::copy(folder.path().join("arcade.toml"), &other).unwrap();
    window.choose("File", "Save rig as");
    window.answer(&folder.path().join("mine.toml"));
    drop_file(&mut window, other.clone());
    window.click("sun");
    window.key(Modifiers::NONE, Key::Delete);
    window.key(Modifiers::COMMAND, Key::S);
    let fewer = window.rig().lights.len();
    window.click("File");
    window.click("Open recent");
    window.harness.get_by_label(&folder.path().join("mine.toml").display().to_string()).click();
    window.until("my rig", |viewer| !viewer.is_reading() && viewer.rig().lights.len() > fewer);
    assert_eq!(load_rig(folder.path().join("mine.toml")).unwrap(), *window.rig());
    assert_eq!(load_rig(other).unwrap().lights.len(), fewer);
}

/// A rig is read beside the window: what is edited meanwhile is not lost to it. The pipe stands for a slow disk.
#[cfg(unix)]
#[test]
fn a_rig_that_comes_late_asks_before_it_takes_the_place_of_edits() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let late = folder.path().join("late.toml");
    assert!(std::process::Command::new("mkfifo").arg(&late).status().unwrap().success());
    let text = std::fs::read_to_string(folder.path().join("arcade.toml")).unwrap();
    drop_late(&mut window, late.clone());
    assert!(window.harness.state().is_reading() && window.is_said("reading a file"));
    window.click("Enable sun");
    window.settle();
    let edited = window.rig().clone();
    std::fs::write(&late, &text).unwrap();
    window.until_said("Save the changes to arcade.toml?");
    assert_eq!(*window.rig(), edited);
    window.click("Discard");
    std::fs::write(&late, text.replace("exposure = 0.0", "exposure = 1.0")).unwrap();
    window.until("the rig", |viewer| viewer.rig().exposure == 1.0);
    assert!(window.light("sun").enabled);
}

/// Of two rigs the one that was asked for last is shown, whichever is read first; and a map is for the rig that it was chosen for.
#[cfg(unix)]
#[test]
fn what_comes_late_is_not_taken_for_something_else() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let pipe = |name: &str| {
        let path = folder.path().join(name);
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    };
    let (late, map) = (pipe("late.toml"), pipe("late.hdr"));
    let text = std::fs::read_to_string(folder.path().join("arcade.toml")).unwrap();
    let newer = folder.path().join("newer.toml");
    std::fs::write(&newer, text.replace("exposure = 0.0", "exposure = 1.0")).unwrap();
    drop_late(&mut window, map.clone());
    drop_late(&mut window, late.clone());
    drop_late(&mut window, newer);
    window.until("the newer rig", |viewer| viewer.rig().exposure == 1.0);
    let rig = window.rig().clone();
    std::fs::write(&late, &text).unwrap();
    std::fs::write(&map, std::fs::read(folder.path().join("arcade_sky.hdr")).unwrap()).unwrap();
    window.until_said("choose it once more");
    window.until("both", |viewer| !viewer.is_reading());
    assert_eq!(*window.rig(), rig);
}

/// Two maps, dropped at once, are for one dome, and the second one is what it has.
#[test]
fn the_second_of_two_maps_takes_the_place_of_the_first() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let lights = window.rig().lights.len();
    let second = folder.path().join("second.hdr");
    std::fs::copy(folder.path().join("arcade_sky.hdr"), &second).unwrap();
    drop_late(&mut window, folder.path().join("arcade_sky.hdr"));
    drop_file(&mut window, second);
    window.settle();
    assert_eq!(window.rig().lights.len(), lights + 1);
    let map = window.rig().lights.iter().find_map(|light| match &light.kind {
        relume::LightKind::Dome { map: Some(map), .. } => Some(map.name().to_owned()),
        _ => None,
    });
    assert_eq!(map.as_deref(), Some("second.hdr"));
}

#[test]
fn a_map_of_the_rig_is_not_written_over() {
    let folder = folder();
    let mut window = Window::open(folder.path());
    let sky = folder.path().join("sky.exr");
    let mut image = relume::image::Image::new(8, 4);
    image.pixels.fill(relume::glam::Vec3::ONE);
    relume_io::write_exr_image(&sky, &image, &relume_io::ExrMeta::default()).unwrap();
    let before = std::fs::read(&sky).unwrap();
    drop_file(&mut window, sky.clone());
    window.settle();
    window.choose("File", "Export image");
    window.answer(&sky);
    window.until_said("is a map of this rig and would be overwritten");
    assert_eq!(std::fs::read(&sky).unwrap(), before);
}
