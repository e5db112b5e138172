//! Real scenes, where they are at hand.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use relume::glam::Vec3;
use relume::reference::{Paths, Settings as ReferenceSettings};
use relume::relight::RelightSettings;
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::transfer::{Quality, Settings};
use relume::{LightRig, Scene};
use relume_tests::prepared::{mean, prepare, relight_afresh};
use relume_tests::scenes::{TestScene, omni, rig};
use relume_tests::truth::{Truth, trace, trace_bounces, unbiased_relative_l2};

fn load(name: &str) -> Option<TestScene> {
    let folder = std::env::var_os("RELUME_SCENES")
        .map(PathBuf::from)
        .unwrap_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes")));
    let path = folder.join(name);
    if !path.is_file() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(built(&path))
}

fn built(path: &Path) -> TestScene {
    let scene: Scene = relume_io::load_scene(path).expect("a scene that can be read").scene;
    let geometry = Geometry::new(&scene);
    let accel = Accel::new(&scene, &geometry);
    TestScene { scene, geometry, accel }
}

/// The Cornell box by its own lamp, a square of 13 x 10 centimetres half a millimetre under the ceiling.
#[test]
fn cornell_box_agrees_with_the_path_tracer() {
    let Some(built) = load("cornell.glb") else { return };
    let size = (96, 72);
    let settings = Settings { size, gather: 4096, quality: Quality::Standard, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    let truth = trace(&built, &LightRig::default(), size, 4, 128);
    let settings = |bounces| RelightSettings { bounces: Some(bounces), aa: 1, ..RelightSettings::default() };
    for bounces in [1, 2, 4] {
        let layers = relight_afresh(&transfer, &LightRig::default(), &settings(bounces));
        let direct = unbiased_relative_l2(&layers.direct, &truth.direct);
        let indirect = unbiased_relative_l2(&layers.indirect, &truth.indirect[bounces as usize - 1]);
        println!("{bounces} bounces: direct {direct:.4}, indirect {indirect:.4}");
        assert!(direct < CORNELL_DIRECT, "{direct}");
        assert!(indirect < CORNELL_INDIRECT, "{bounces} bounces: {indirect}");
    }
    println!("expected of the encoding: {:.4?}", transfer.report.gather_error);
    let wrong = relight_afresh(&transfer, &LightRig::default(), &settings(1));
    let wrong = unbiased_relative_l2(&wrong.indirect, &truth.indirect[3]);
    assert!(wrong > CORNELL_INDIRECT, "one bounce is not four: {wrong}");
}

/// Measured 0.016: the lamp's light on what the camera sees.
const CORNELL_DIRECT: f64 = 0.025;
/// Measured 0.087, 0.081 and 0.078 at 1, 2 and 4 bounces; most of it is a draft's rows.
const CORNELL_INDIRECT: f64 = 0.13;

/// Two lights of rigs in `assets/rigs`, and their indirect light after two bounces.
struct TwoLights {
    lights: [LightRig; 2],
    names: [&'static str; 2],
    size: (usize, usize),
    truths: [Truth; 2],
}

impl TwoLights {
    fn trace(
        built: &TestScene,
        (rig_files, names): ([&str; 2], [&'static str; 2]),
        size: (usize, usize),
        paths: Paths,
    ) -> Self {
        let light = |which: usize| {
            let path = format!("{}/../../assets/rigs/{}", env!("CARGO_MANIFEST_DIR"), rig_files[which]);
            let all = relume_io::load_rig(path).expect("a rig that can be read");
            let lights: Vec<_> = all.lights.into_iter().filter(|light| light.name == names[which]).collect();
            assert_eq!(lights.len(), 1, "{}", names[which]);
            LightRig { lights, ..LightRig::default() }
        };
        let lights = [0, 1].map(light);
        let TestScene { scene, geometry, accel } = built;
        let (width, height) = size;
        let traced = ReferenceSettings { width, height, spp: 64, aa: 1, paths, ..Default::default() };
        let truths = lights.each_ref().map(|lights| {
            let truths = trace_bounces(scene, geometry, accel, lights, &traced, &[Some(2)], &());
            truths.expect("valid settings").indirect.remove(0)
        });
        Self { lights, names, size, truths }
    }

    /// Each light, relit, is pixel by pixel within its bound of the path tracer; the other's image must not be.
    fn agree(&self, built: &TestScene, settings: Settings, bounds: [f64; 2]) {
        assert_eq!(settings.size, self.size);
        let transfer = Arc::new(prepare(built, settings));
        let relight = RelightSettings { bounces: Some(2), aa: 1, ..RelightSettings::default() };
        let images =
            self.lights.each_ref().map(|lights| relight_afresh(&transfer, lights, &relight).indirect);
        for (light, truth) in self.truths.iter().enumerate() {
            let [right, wrong] = [light, 1 - light].map(|image| unbiased_relative_l2(&images[image], truth));
            println!("{}: indirect {right:.4}, the other's image {wrong:.4}", self.names[light]);
            assert!(right < bounds[light], "{right}");
            assert!(wrong > bounds[light], "{wrong}");
        }
    }
}

/// Sponza's by its own spot and its omni, without reflections: once for all tests.
fn sponza() -> Option<&'static (TestScene, TwoLights)> {
    static SPONZA: OnceLock<Option<(TestScene, TwoLights)>> = OnceLock::new();
    let make = || {
        let built = load("sponza.glb")?;
        let lights = (["sponza/key.toml", "sponza/omni.toml"], ["key", "omni"]);
        let lights = TwoLights::trace(&built, lights, (160, 120), Paths::DiffuseTransfer);
        Some((built, lights))
    };
    SPONZA.get_or_init(make).as_ref()
}

/// The demo's scene, which is always at hand, in blocks that are several runs of points.
#[test]
fn the_arcade_agrees_with_the_path_tracer() {
    let built = built(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/arcade.glb").as_ref());
    let settings =
        Settings { size: (240, 180), gather: 16_384, quality: Quality::Standard, ..Settings::default() };
    let lights = (["arcade.toml"; 2], ["sun", "statue"]);
    TwoLights::trace(&built, lights, settings.size, Paths::Transfer).agree(&built, settings, ARCADE_INDIRECT);
}

/// Measured 0.102 for the sun and 0.184 for the spot on the statue.
const ARCADE_INDIRECT: [f64; 2] = [0.13, 0.23];

/// Without reflections. With them the spot is off by 0.21 at this size, most of it where surfaces are seen at a grazing angle.
#[test]
fn sponza_agrees_with_the_path_tracer() {
    let Some((built, lights)) = sponza() else { return };
    let settings = Settings { size: (160, 120), gather: 16_384, glossy: false, ..Settings::default() };
    lights.agree(built, settings, SPONZA_INDIRECT);
}

/// Measured 0.088 for the spot and 0.079 for the omni.
const SPONZA_INDIRECT: [f64; 2] = [0.12, 0.11];

/// The first step of a preparation, at a quarter of the size along each side.
#[test]
fn sponza_is_known_at_a_glance() {
    let Some((built, lights)) = sponza() else { return };
    let settings = Settings {
        size: (160, 120),
        gather: 4096,
        quality: Quality::Glance,
        spacing: 1.0 / 16.0,
        glossy: false,
        ..Settings::default()
    };
    lights.agree(built, settings, GLANCE_INDIRECT);
}

/// Measured 0.278 for the spot and 0.203 for the omni.
const GLANCE_INDIRECT: [f64; 2] = [0.36, 0.27];

/// Measured 0.008 too dark, though a draft's 4096 cells are two square metres each.
const SPONZA_MEAN: f64 = 0.05;

#[test]
fn sponza_goes_through_every_stage() {
    let Some(built) = load("sponza.glb") else { return };
    let size = (64, 48);
    let settings = Settings { size, gather: 4096, quality: Quality::Draft, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    assert_eq!(transfer.report.triangles as usize, built.geometry.triangles.len());
    let lights = rig([omni(Vec3::new(-6.0, 2.5, 0.0), Vec3::new(40.0, 30.0, 20.0), 0.0)]);
    let settings = RelightSettings { aa: 1, ..RelightSettings::default() };
    let layers = relight_afresh(&transfer, &lights, &settings);
    let truth = trace(&built, &lights, size, 2, 128);
    let direct = unbiased_relative_l2(&layers.direct, &truth.direct);
    println!("direct {direct}");
    assert!(direct < 1e-3, "{direct}");
    assert!(layers.indirect.pixels.iter().all(|pixel| pixel.is_finite()));
    let (indirect, direct) = (mean(&layers.indirect), mean(&layers.direct));
    println!("mean direct {direct}, indirect {indirect}");
    assert!(indirect.min_element() > 0.01 * direct.min_element(), "{indirect} {direct}");
    // two bounces nearly as bright as the path tracer's, all pixels together; the truth's noise is below a hundredth
    let two = RelightSettings { bounces: Some(2), ..settings };
    let two = mean(&relight_afresh(&transfer, &lights, &two).indirect);
    let [a, b] = truth.indirect[1].halves.each_ref().map(mean);
    println!("two bounces: {}, truth {a} and {b}", two / (0.5 * (a + b)));
    assert!((two / (0.5 * (a + b)) - 1.0).abs().max_element() < SPONZA_MEAN, "{two} {a} {b}");
    // saved and loaded it is the same shot
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sponza.relume");
    transfer.save(&path).unwrap();
    let loaded = Arc::new(relume::Transfer::load(&path).unwrap());
    let again = relight_afresh(&loaded, &lights, &settings);
    assert!(again.direct == layers.direct && again.indirect == layers.indirect);
}
