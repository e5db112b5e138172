//! Records: few receivers have rows, and the others take their light from these.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::sync::Arc;

use relume::image::compare;
use relume::relight::RelightSettings;
use relume::transfer::{Encoding, Quality, Settings};
use relume::{Preparation, Transfer};
use relume_tests::prepared::relight_afresh;

fn arcade(settings: Settings) -> Arc<Transfer> {
    let assets = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets"));
    let scene = relume_io::load_scene(&assets.join("arcade.glb")).unwrap().scene;
    Arc::new(Preparation::new(&scene).settings(settings).run(&()).unwrap())
}

/// The demo's scene under its rig: with records there are far fewer rows, and the image is that of a row for every receiver but for the noise
/// that each of them has.
#[test]
fn few_rows_say_what_a_row_for_each_receiver_says() {
    let rig = relume_io::load_rig(
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets")).join("rigs/arcade.toml"),
    )
    .unwrap();
    let settings = |spacing| Settings {
        size: (256, 192),
        gather: 4096,
        quality: Quality::Draft,
        spacing,
        ..Settings::default()
    };
    let whole = arcade(settings(0.0));
    assert!(whole.gather.interpolation.is_none() && whole.gather.records() == whole.gather.rows);
    assert_eq!(whole.interpolation_bytes(), 0);
    let image =
        |transfer: &Arc<Transfer>| relight_afresh(transfer, &rig, &RelightSettings::default()).indirect;
    let truth = image(&whole);
    let mut before = (usize::MAX, 0.0);
    // measured 0.042 and 0.085
    for (spacing, most) in [(0.05, 0.07), (0.4, 0.13)] {
        let few = arcade(settings(spacing));
        let error = compare(&image(&few), &truth, None).unwrap().relative_l2;
        println!(
            "{spacing}: {} records of {} receivers, {} of {} gather samples, {:.0} bytes a pixel for {:.0}, off by {error:.4}",
            few.gather.records(),
            few.gather.rows,
            few.bounce.records(),
            few.bounce.rows,
            few.bytes_per_pixel(),
            whole.bytes_per_pixel()
        );
        assert_eq!(few.gather.rows, whole.gather.rows, "as many receivers");
        assert!(few.gather.records() < before.0 && error > before.1, "farther apart is coarser");
        assert!(error < most, "{error}");
        before = (few.gather.records(), error);
    }
}

/// Every encoding holds rows of records.
#[test]
fn all_encodings_have_records() {
    let rig = relume_io::load_rig(
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets")).join("rigs/arcade.toml"),
    )
    .unwrap();
    let images: Vec<_> = [Encoding::LowRank, Encoding::HaarRows, Encoding::HaarBlocks]
        .into_iter()
        .map(|encoding| {
            let settings = Settings {
                size: (96, 72),
                gather: 1024,
                quality: Quality::Draft,
                encoding,
                spacing: 0.1,
                coefficients: 1024,
                ..Settings::default()
            };
            let transfer = arcade(settings);
            assert!(transfer.gather.records() < transfer.gather.rows);
            relight_afresh(&transfer, &rig, &RelightSettings { cull: Some(0.0), ..Default::default() })
                .indirect
        })
        .collect();
    for image in &images[..2] {
        let error = compare(image, &images[2], None).unwrap().relative_l2;
        println!("off by {error:.4}");
        assert!(error < 0.1, "{error}");
    }
}
