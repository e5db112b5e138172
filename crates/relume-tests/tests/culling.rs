//! Culling on the fly, on the demo scene: what is left out, and what that costs.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use relume::image::Image;
use relume::image::metrics::relative_l2;
use relume::relight::{Only, RelightSettings};
use relume::transfer::{Encoding, Quality, Settings};
use relume::{Error, LightRig, Preparation, Relighter, Transfer};
use relume_tests::prepared::relight_afresh;

const ENCODINGS: [Encoding; 3] = [Encoding::LowRank, Encoding::HaarRows, Encoding::HaarBlocks];

fn asset(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets").join(name)
}

/// The arcade in every encoding.
fn shots() -> &'static [Arc<Transfer>] {
    static SHOTS: OnceLock<Vec<Arc<Transfer>>> = OnceLock::new();
    SHOTS.get_or_init(|| {
        let scene = relume_io::load_scene(&asset("arcade.glb")).expect("the demo scene").scene;
        let prepared = |encoding| {
            let settings = Settings {
                size: (96, 72),
                gather: 4096,
                quality: Quality::Draft,
                encoding,
                ..Settings::default()
            };
            Arc::new(Preparation::new(&scene).settings(settings).run(&()).expect("the demo scene"))
        };
        ENCODINGS.map(prepared).into()
    })
}

/// Each light of the demo's rig alone.
fn rigs() -> Vec<LightRig> {
    let rig = relume_io::load_rig(asset("rigs/arcade.toml")).expect("the demo's rig");
    let alone = |light: &relume::Light| LightRig { lights: vec![light.clone()], ..rig.clone() };
    rig.lights.iter().map(alone).collect()
}

/// Indirect light, and the share of multiply-adds that was culled.
fn indirect(transfer: &Arc<Transfer>, rig: &LightRig, cull: Option<f32>) -> (Image, f64) {
    let settings = RelightSettings { only: Only::Indirect, aa: 1, cull, ..RelightSettings::default() };
    let mut relighter = Relighter::new(Arc::clone(transfer));
    let layers = relighter.relight(rig, &settings).expect("valid settings");
    let stats = relighter.stats();
    (layers.indirect, stats.culled as f64 / stats.multiply_adds as f64)
}

#[test]
fn more_is_culled_for_more_error_and_never_more_than_asked_for() {
    for transfer in shots() {
        let encoding = transfer.gather.encoding();
        for rig in rigs() {
            let name = &rig.lights[0].name;
            let (all, none) = indirect(transfer, &rig, Some(0.0));
            assert_eq!(none, 0.0);
            let mut before = 0.0;
            for epsilon in [0.01, 0.1, 0.5] {
                let (image, culled) = indirect(transfer, &rig, Some(epsilon));
                let error = relative_l2(&image, &all).expect("images of one size");
                println!(
                    "{encoding:?}, {name}, epsilon {epsilon}: {:.1}% culled, {error:.5} off",
                    100.0 * culled
                );
                assert!(error <= f64::from(epsilon), "{encoding:?}, {name}: {error} for {epsilon}");
                assert!(culled >= before && culled < 1.0, "{encoding:?}, {name}: {culled} after {before}");
                before = culled;
            }
            assert!(before > 0.05, "{encoding:?}, {name}: only {before} is ever left out");
            let (coarse, _) = indirect(transfer, &rig, Some(1.0));
            assert_ne!(coarse, all, "{encoding:?}, {name}: what is left out must be noticed");
        }
    }
}

/// The defaults add less than half a percent.
#[test]
fn what_is_culled_by_default_is_not_seen() {
    for transfer in shots() {
        for rig in rigs() {
            let (all, _) = indirect(transfer, &rig, Some(0.0));
            let (image, culled) = indirect(transfer, &rig, None);
            let error = relative_l2(&image, &all).expect("images of one size");
            let (encoding, name) = (transfer.gather.encoding(), &rig.lights[0].name);
            println!("{encoding:?}, {name}: {:.1}% culled, {error:.5} off", 100.0 * culled);
            assert!(error < 0.005, "{encoding:?}, {name}: {error}");
            assert_eq!(culled > 0.0, encoding.cull() > 0.0, "{encoding:?}, {name}: {culled}");
        }
    }
}

#[test]
fn threads_change_no_culled_pixel() {
    let rig = relume_io::load_rig(asset("rigs/arcade.toml")).expect("the demo's rig");
    let settings = RelightSettings { cull: Some(0.2), ..RelightSettings::default() };
    for transfer in shots() {
        let relit = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            pool.install(|| relight_afresh(transfer, &rig, &settings).indirect)
        };
        let one = relit(1);
        assert!(relit(3) == one, "{:?}", transfer.gather.encoding());
        let other = RelightSettings { cull: Some(0.1), ..settings };
        assert_ne!(relight_afresh(transfer, &rig, &other).indirect, one);
    }
}

#[test]
fn an_epsilon_out_of_range_is_refused() {
    let (transfer, rig) = (&shots()[0], &rigs()[0]);
    for cull in [-0.1, 1.5, f32::NAN] {
        let settings = RelightSettings { cull: Some(cull), ..RelightSettings::default() };
        let refused = Relighter::new(Arc::clone(transfer)).relight(rig, &settings);
        assert!(matches!(refused, Err(Error::Setting(_))), "{cull}");
    }
    let settings = RelightSettings { cull: Some(1.0), ..RelightSettings::default() };
    assert!(Relighter::new(Arc::clone(transfer)).relight(rig, &settings).is_ok());
}
