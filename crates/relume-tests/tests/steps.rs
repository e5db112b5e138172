//! A preparation that shows coarse transfers before the one that was asked for.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use relume::glam::Vec3;
use relume::image::compare;
use relume::relight::{Only, RelightSettings};
use relume::transfer::{Multibounce, Preparing, Quality, Settings};
use relume::{Error, LightRig, Preparation, Relighter, Scene, Transfer};
use relume_tests::prepared::{prepare, relight_afresh, tiny};
use relume_tests::scenes::{box_room, court};

fn assets(name: &str) -> std::path::PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets")).join(name)
}

fn arcade() -> Scene {
    relume_io::load_scene(&assets("arcade.glb")).unwrap().scene
}

fn saved(transfer: &Transfer) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    transfer.save(folder.path().join("saved.relume")).unwrap();
    std::fs::read(folder.path().join("saved.relume")).unwrap()
}

/// The demo's scene under its rig: each step is closer to the last transfer than the one before, for less, and the last is what one gets without steps.
#[test]
fn each_step_is_closer_and_the_last_is_what_was_asked_for() {
    let scene = arcade();
    let settings =
        Settings { size: (128, 96), gather: 4096, quality: Quality::Standard, ..Settings::default() };
    let preparation = || Preparation::new(&scene).settings(settings.clone());
    let mut steps = Vec::new();
    let last = preparation().run_in_steps(&(), |transfer| {
        steps.push(transfer);
        Ok(())
    });
    steps.push(last.unwrap());
    assert!(saved(&steps[2]) == saved(&preparation().run(&()).unwrap()), "not what one gets without steps");
    let rig = relume_io::load_rig(assets("rigs/arcade.toml")).unwrap();
    let images: Vec<_> = steps
        .iter()
        .map(|step| relight_afresh(&Arc::new(step.clone()), &rig, &RelightSettings::default()))
        .collect();
    let errors = |image: usize| {
        let (image, last) = (&images[image], &images[2]);
        let off = |image, last| compare(image, last, None).unwrap().relative_l2;
        (off(&image.indirect, &last.indirect), off(&image.full(), &last.full()))
    };
    for (number, step) in steps.iter().enumerate() {
        println!(
            "{} rows, {:.0} bytes a pixel, {:?}",
            step.gather.records(),
            step.bytes_per_pixel(),
            errors(number)
        );
    }
    let (first, second) = (errors(0), errors(1));
    // measured 0.105 and 0.031, 0.022 and 0.007
    assert!(first.0 < 0.2 && first.1 < 0.06, "{first:?}");
    assert!(second.0 < 0.04 && second.1 < 0.012, "{second:?}");
    assert!(3 * steps[0].gather.records() < 2 * steps[2].gather.records(), "few have rows");
    assert!(images[0].direct == images[2].direct, "direct light needs no step");
}

/// What is shown before anything is prepared: the same direct light as in the end, what shines by itself, suns of a dome's map, and no more.
#[test]
fn direct_light_comes_first_and_cannot_be_taken_for_more() {
    let scene = arcade();
    let settings = Settings { size: (96, 72), gather: 1024, quality: Quality::Draft, ..Settings::default() };
    let preparation = || Preparation::new(&scene).settings(settings.clone());
    let mut steps = Vec::new();
    let last = preparation().direct_first().run_in_steps(&(), |transfer| {
        steps.push(transfer);
        Ok(())
    });
    let last = last.unwrap();
    assert!(saved(&last) == saved(&preparation().run(&()).unwrap()), "the first step has changed the last");
    let first = Arc::new(steps.remove(0));
    assert!(first.is_direct_only() && !last.is_direct_only());
    assert!(!steps.iter().any(Transfer::is_direct_only), "only the first step is of direct light alone");
    let rig = relume_io::load_rig(assets("rigs/arcade.toml")).unwrap();
    let all = RelightSettings::default();
    let (looked, lit) =
        (relight_afresh(&first, &rig, &all), relight_afresh(&Arc::new(last.clone()), &rig, &all));
    assert!(looked.direct == lit.direct, "direct light is not what it will be");
    assert!(looked.indirect.pixels.iter().all(|pixel| *pixel == Vec3::ZERO));
    // a sky: its suns are there, light from all around is not
    let sky = relume_io::load_rig(assets("rigs/arcade_sky.toml")).unwrap();
    let (looked, lit) =
        (relight_afresh(&first, &sky, &all), relight_afresh(&Arc::new(last.clone()), &sky, &all));
    let sum =
        |image: &relume::image::Image| image.pixels.iter().map(|pixel| pixel.element_sum()).sum::<f32>();
    assert!(sum(&looked.direct) > 0.0 && sum(&looked.direct) < sum(&lit.direct));
    let repainted = relume_io::load_rig(assets("rigs/arcade_repainted.toml")).unwrap();
    let of = |transfer: &Arc<Transfer>| relight_afresh(transfer, &repainted, &all).direct;
    assert!(of(&first) == of(&Arc::new(last.clone())), "base colours are not edited alike");

    let indirect = RelightSettings { only: Only::Indirect, ..all };
    let refused = Relighter::new(Arc::clone(&first)).relight(&rig, &indirect).unwrap_err();
    assert!(refused.is_bad_input() && refused.to_string().contains("no indirect light"), "{refused}");
    let folder = tempfile::tempdir().unwrap();
    assert!(first.save(folder.path().join("first.relume")).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A transfer is known again as what a preparation would make, and no other is.
#[test]
fn a_preparation_knows_its_transfer() {
    let built = box_room();
    let preparation = |settings: &Settings| Preparation::new(&built.scene).settings(settings.clone());
    let transfer = preparation(&tiny()).run(&()).unwrap();
    assert!(preparation(&tiny()).would_make(&transfer).unwrap());
    let other = Settings { seed: 1, ..tiny() };
    assert!(!preparation(&other).would_make(&transfer).unwrap());
    let mut moved = built.scene.clone();
    moved.cameras[0].vertical_fov *= 1.01;
    assert!(!Preparation::new(&moved).settings(tiny()).would_make(&transfer).unwrap());
}

/// What is coarse already has no step before it, and what shows them may refuse.
#[test]
fn small_preparations_have_no_steps_and_a_refusal_ends_them() {
    let mut shown = 0;
    let built = box_room();
    let settings = Settings { quality: Quality::Glance, ..tiny() };
    let last = Preparation::new(&built.scene).settings(settings).run_in_steps(&(), |_| {
        shown += 1;
        Ok(())
    });
    assert!(last.is_ok() && shown == 0, "{shown} steps");
    let settings = Settings { size: (48, 36), gather: 1024, ..Settings::default() };
    let refused = Preparation::new(&built.scene)
        .settings(settings)
        .run_in_steps(&(), |_| Err(Error::Setting("the disk is full".to_owned())));
    assert_eq!(refused.unwrap_err().to_string(), "the disk is full");
}

fn until(what: &str, mut there: impl FnMut() -> bool) {
    let began = Instant::now();
    while !there() {
        assert!(began.elapsed() < Duration::from_secs(300), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_preparation_beside_its_caller_tells_how_far_it_is_and_ends_where_it_is_asked_to() {
    let scene = Arc::new(court().scene);
    let settings = Settings { size: (64, 48), gather: 1024, ..Settings::default() };
    let start = |settings: &Settings| {
        let settings = settings.clone();
        Preparing::start(Arc::clone(&scene), 1, |scene| Preparation::new(scene).settings(settings)).unwrap()
    };
    let preparing = start(&settings);
    assert!(preparing.current().is_none());
    until("a coarse transfer", || preparing.current().is_some());
    let coarse = preparing.current().unwrap();
    assert_eq!(coarse.report.settings.quality, Quality::Glance);
    assert!(
        relight_afresh(&coarse, &LightRig::default(), &RelightSettings::default()).direct.pixels.len()
            == 64 * 48
    );
    // at rest nothing goes on
    preparing.pause(true);
    until("rest", || {
        let before = preparing.status();
        std::thread::sleep(Duration::from_millis(300));
        preparing.status() == before
    });
    let status = preparing.status();
    assert!(status.paused && !preparing.is_finished() && !status.stage.is_empty(), "{status:?}");
    // whoever relights needs nothing of what rests
    let (frame, done) = std::sync::mpsc::channel();
    let at_rest = Arc::clone(&coarse);
    std::thread::spawn(move || {
        let layers = relight_afresh(&at_rest, &LightRig::default(), &RelightSettings::default());
        frame.send(layers.direct.pixels.len())
    });
    assert_eq!(
        done.recv_timeout(Duration::from_secs(60)),
        Ok(64 * 48),
        "no frame while the preparation rests"
    );
    preparing.pause(false);
    let last = preparing.wait().unwrap();
    let built = court();
    assert!(saved(&last) == saved(&prepare(&built, settings.clone())), "paused or not, the same bytes");
    // asked to end while it rests
    let preparing = start(&settings);
    preparing.pause(true);
    preparing.cancel();
    until("the end", || preparing.is_finished());
    assert!(matches!(preparing.wait(), Err(Error::Cancelled)));
    let preparing = start(&Settings { spacing: 1.5, ..settings });
    assert!(preparing.wait().unwrap_err().to_string().contains("must be 0 to 1"));
}

/// Every encoding, and photons, can be shown in steps.
#[test]
fn all_kinds_of_transfers_have_steps() {
    use relume::transfer::Encoding;
    let built = court();
    for (encoding, multibounce) in [
        (Encoding::HaarRows, Multibounce::Iterated),
        (Encoding::HaarBlocks, Multibounce::Iterated),
        (Encoding::LowRank, Multibounce::Photon),
    ] {
        let settings =
            Settings { size: (48, 36), gather: 1024, encoding, multibounce, ..Settings::default() };
        let mut steps = 0;
        let last = Preparation::new(&built.scene).settings(settings.clone()).run_in_steps(&(), |transfer| {
            assert_eq!(transfer.report.settings.encoding, encoding);
            assert_eq!(transfer.multibounce(), multibounce);
            steps += 1;
            Ok(())
        });
        assert!(last.is_ok() && steps > 0);
    }
}
