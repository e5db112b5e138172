//! Dome lights: the sky's part of the cloud, and the path tracer, against closed forms and each other.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

use relume::glam::{Vec2, Vec3};
use relume::image::Layers;
use relume::reference::{Paths, Settings as ReferenceSettings, render};
use relume::relight::RelightSettings;
use relume::sample::illuminate_sky;
use relume::scene::{EnvironmentMap, Material};
use relume::shade::Dome;
use relume::transfer::{Encoding, Multibounce, Quality, RowMethod, Settings};
use relume::{Error, LightKind, LightRig, Relighter};
use relume_tests::prepared::{center_sums, lit_centers, mean, prepare, relight_afresh, spread, tiny};
use relume_tests::scenes::{
    SceneBuilder, TestScene, arcade, box_room, court, emissive, floor, lambertian, rig,
};
use relume_tests::truth::{Truths, trace, unbiased_relative_l2};

const COLOR: Vec3 = Vec3::new(0.8, 0.5, 0.2);
const LIGHT: Vec3 = Vec3::new(1.5, 2.0, 3.0);

fn dome(map: Option<EnvironmentMap>, intensity: Vec3, rotation: f32) -> LightKind {
    LightKind::Dome { map: map.map(Arc::new), intensity, rotation }
}

fn even(intensity: Vec3) -> LightRig {
    rig([dome(None, intensity, 0.0)])
}

/// A map of a radiance by direction.
fn map(radiance: impl Fn(Vec3) -> Vec3) -> EnvironmentMap {
    let (width, height) = (128, 64);
    let of = |texels| EnvironmentMap::new("test", width, height, texels).expect("radiance");
    let plan = of(vec![Vec3::ZERO; width * height]);
    let direction = |i: usize| plan.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    of((0..width * height).map(|i| radiance(direction(i))).collect())
}

/// Bluish above, brown below, a bright window towards +X and, where asked for, a small sun above it.
fn painted(sun: bool) -> EnvironmentMap {
    let sun_at = Vec3::new(0.6, 0.75, 0.25).normalize();
    map(|direction| {
        let sky = Vec3::new(0.3, 0.5, 0.9) * (0.2 + direction.y.max(0.0)) + Vec3::new(0.1, 0.05, 0.0);
        let window = if direction.dot(Vec3::new(0.9, 0.45, 0.0).normalize()) > 0.92 { 6.0 } else { 0.0 };
        let sun = if sun && direction.dot(sun_at) > 0.9992 { 900.0 } else { 0.0 };
        sky + Vec3::new(1.0, 0.8, 0.5) * (window + sun)
    })
}

fn path_traced(
    built: &TestScene,
    rig: &LightRig,
    spp: u32,
    bounces: Option<u32>,
) -> relume::reference::Reference {
    let settings = ReferenceSettings {
        width: 24,
        height: 18,
        spp,
        aa: 1,
        bounces,
        paths: Paths::All,
        ..ReferenceSettings::default()
    };
    render(&built.scene, &built.geometry, &built.accel, rig, &settings, &()).expect("valid settings")
}

/// Of direct light and of light of up to two bounces.
fn errors(layers: &Layers, truth: &Truths) -> [f64; 2] {
    let indirect = unbiased_relative_l2(&layers.indirect, &truth.indirect[1]);
    [unbiased_relative_l2(&layers.direct, &truth.direct), indirect]
}

#[test]
fn a_floor_shows_the_cosine_weighted_mean_of_the_upper_half() {
    let built = floor(lambertian(COLOR));
    let exact = |map: &EnvironmentMap| {
        let (width, height) = map.size();
        let texel = |i: usize| {
            let cos = map.direction(0.0, (i / width) as f64 + 0.5).y.max(0.0);
            map.texel(i % width, i / width) * cos * map.solid_angle(i / width) as f32
        };
        COLOR * FRAC_1_PI * LIGHT * (0..width * height).map(texel).sum::<Vec3>()
    };
    let traced = |rig: &LightRig| mean(&path_traced(&built, rig, 256, Some(0)).layers.direct).as_vec3();
    let off = |found: Vec3, expected: Vec3| ((found - expected) / expected).abs().max_element();
    let plain = off(traced(&even(LIGHT)), COLOR * LIGHT);
    let with_map = off(traced(&rig([dome(Some(painted(true)), LIGHT, 77.0)])), exact(&painted(true)));
    println!("even {plain:.5}, of a map {with_map:.5}");
    assert!(plain < 2e-3 && with_map < 0.01);
}

#[test]
fn white_things_in_an_even_dome_cannot_be_told_from_it() {
    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::ONE));
    let x = 2.0 * Vec3::X;
    builder
        .quad(Vec3::ZERO, x, Vec3::Y, white)
        .quad(Vec3::ZERO, Vec3::Y, 2.0 * Vec3::Z, white)
        .quad(Vec3::ZERO, 2.0 * Vec3::Z, x, white)
        .camera(Vec3::new(1.6, 1.6, 1.6), Vec3::splat(0.3), 20.0);
    let built = builder.build();
    let traced = path_traced(&built, &even(LIGHT), 256, None).layers;
    let full = mean(&traced.direct) + mean(&traced.indirect);
    let off = (full.as_vec3() / LIGHT - 1.0).abs().max_element();
    let settings = Settings { size: (24, 18), gather: 4096, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    let relit =
        relight_afresh(&transfer, &even(LIGHT), &RelightSettings { aa: 1, ..RelightSettings::default() });
    let full = mean(&relit.direct) + mean(&relit.indirect);
    let relit_off = (full.as_vec3() / LIGHT - 1.0).abs().max_element();
    println!("traced {off:.4}, relit {relit_off:.4} off");
    assert!(off < 0.01 && relit_off < 0.02);
    assert!(mean(&relit.direct).x < 0.95 * f64::from(LIGHT.x), "corners are lit by bounces");
}

#[test]
fn a_sixteenth_of_the_cloud_is_sky_where_there_is_any() {
    let built = court();
    let settings = Settings { encoding: Encoding::HaarRows, coefficients: 1024, ..tiny() };
    let open = prepare(&built, settings.clone());
    assert_eq!((open.cloud.len(), open.cloud.sky.len()), (1024, 64));
    assert_eq!(open.bounce.rows, 960);
    let sky: f32 = (0..64).map(|cell| open.cloud.sky.solid_angle(cell)).sum();
    assert!((sky - 4.0 * PI).abs() < 1e-3);
    let blind = prepare(&built, Settings { sky: false, ..settings });
    assert!(blind.cloud.sky.is_empty() && blind.bounce.rows == 1024);
    // with the sky, something is met in every direction
    let whole = open.gather.apply(&vec![Vec3::ONE; open.cloud.len()]);
    let [low, middle, high] = spread(&lit_centers(&open).map(|(_, row)| whole[row].x).collect::<Vec<_>>());
    let of_surfaces = [&open, &blind].map(|transfer| spread(&center_sums(transfer))[1]);
    println!(
        "rows add up to {low:.3}, {middle:.3}, {high:.3}; over surfaces, with and without sky {of_surfaces:.3?}"
    );
    assert!((middle - 1.0).abs() < 0.02 && low > 0.85 && high < 1.15);
    assert!((of_surfaces[0] / of_surfaces[1] - 1.0).abs() < 0.03 && of_surfaces[1] < 0.8);
    let closed = Arc::new(prepare(&box_room(), tiny()));
    assert!(closed.cloud.sky.is_empty());
    let dark = relight_afresh(&closed, &even(LIGHT), &RelightSettings::default());
    assert!(mean(&dark.direct).length() + mean(&dark.indirect).length() == 0.0);
}

#[test]
fn cells_hold_the_light_of_the_map() {
    let transfer = prepare(&court(), tiny());
    let sky = &transfer.cloud.sky;
    let dome = |rotation| Dome::new(Some(Arc::new(painted(false))), LIGHT, rotation);
    let exact: Vec3 = {
        let map = painted(false);
        let (width, height) = map.size();
        (0..width * height).map(|i| map.texel(i % width, i / width) * map.solid_angle(i / width) as f32).sum()
    };
    for rotation in [0.0, 123.0] {
        let light = illuminate_sky(sky, &dome(rotation));
        let sum: Vec3 = light.iter().enumerate().map(|(cell, light)| *light * sky.solid_angle(cell)).sum();
        assert!(
            (sum / (exact * LIGHT) - 1.0).abs().max_element() < 0.01,
            "{sum} instead of {}",
            exact * LIGHT
        );
        // light that is turned with the cells' directions is the light that was there
        let fine = (0..sky.len()).filter(|&cell| sky.solid_angle(cell) < 0.2);
        for cell in fine {
            let middle = sky.direction(cell, Vec2::splat(0.5));
            let window = dome(rotation).unturned(middle).dot(Vec3::new(0.9, 0.45, 0.0).normalize());
            let smooth = window < 0.6 && middle.y.abs() > 0.5;
            let seen = dome(rotation).radiance(middle);
            assert!(
                !smooth || (light[cell] - seen).length() < 0.3 * seen.length(),
                "{} and {seen}",
                light[cell]
            );
        }
    }
}

#[test]
fn a_court_under_painted_skies_agrees_with_the_path_tracer() {
    let built = court();
    let size = (64, 48);
    let settings = Settings { size, gather: 16_384, quality: Quality::Standard, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    let relight = RelightSettings { bounces: Some(2), aa: 1, ..RelightSettings::default() };
    let rigs = [(false, 0.0), (false, 140.0), (true, 0.0)]
        .map(|(sun, turn)| rig([dome(Some(painted(sun)), LIGHT, turn)]));
    let images = rigs.each_ref().map(|rig| relight_afresh(&transfer, rig, &relight));
    for (which, rig) in rigs.iter().enumerate() {
        let truth = trace(&built, rig, size, 2, 1024);
        let [right, wrong] = [which, (which + 1) % 3].map(|image| errors(&images[image], &truth));
        println!("direct and indirect {right:.4?}, of another dome {wrong:.4?}");
        // measured 0.027, 0.052 and 0.018 direct; 0.026, 0.030 and 0.023 indirect
        assert!(right[0] < 0.075 && right[1] < 0.05, "{right:?}");
        assert!(wrong.iter().all(|&error| error > 0.15), "{wrong:?}");
    }
}

/// The demo's scene under the sky that comes with it, turned two ways; its sun is a pixel.
#[test]
fn the_arcade_under_its_sky_agrees_with_the_path_tracer() {
    let built = arcade();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/rigs/arcade_sky.toml");
    let sky = relume_io::load_rig(path).expect("the rig of the repository");
    let size = (64, 48);
    let settings = Settings { size, gather: 16_384, quality: Quality::Draft, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    assert_eq!(transfer.cloud.sky.len(), 1024);
    let relight = RelightSettings { bounces: Some(2), aa: 1, ..RelightSettings::default() };
    let turned = |turn: f32| {
        let mut rig = sky.clone();
        for light in &mut rig.lights {
            if let LightKind::Dome { rotation, .. } = &mut light.kind {
                *rotation += turn;
            }
        }
        rig
    };
    let rigs = [0.0, 150.0].map(turned);
    let images = rigs.each_ref().map(|rig| relight_afresh(&transfer, rig, &relight));
    for (which, rig) in rigs.iter().enumerate() {
        let truth = trace(&built, rig, size, 2, 512);
        let [right, wrong] = [which, 1 - which].map(|image| errors(&images[image], &truth));
        println!("direct and indirect {right:.4?}, turned otherwise {wrong:.4?}");
        // measured 0.032 and 0.031, 0.104 and 0.103
        assert!(right[0] < 0.05 && right[1] < 0.13, "{right:?}");
        assert!(wrong.iter().all(|&error| error > 0.3), "{wrong:?}");
    }
}

#[test]
fn every_way_of_estimating_and_storing_knows_the_sky() {
    let built = court();
    let size = (40, 30);
    let light = rig([dome(Some(painted(false)), LIGHT, 30.0)]);
    let truth = trace(&built, &light, size, 8, 512);
    let all = truth.direct.plus(&truth.indirect[7]);
    let settings =
        Settings { size, gather: 4096, quality: Quality::Standard, coefficients: 400, ..Settings::default() };
    let ways = [
        // measured 0.058, 0.058, 0.077 and 0.101
        ("haar-rows", 0.08, Settings { encoding: Encoding::HaarRows, ..settings.clone() }),
        ("haar-blocks", 0.08, Settings { encoding: Encoding::HaarBlocks, ..settings.clone() }),
        ("photons", 0.1, Settings { multibounce: Multibounce::Photon, ..settings.clone() }),
        ("the paper's rows", 0.15, Settings { rows: RowMethod::Paper, ..settings }),
    ];
    for (name, most, settings) in ways {
        let transfer = Arc::new(prepare(&built, settings));
        let relit =
            relight_afresh(&transfer, &light, &RelightSettings { aa: 1, ..RelightSettings::default() });
        let mut full = relit.direct.clone();
        full.pixels.iter_mut().zip(&relit.indirect.pixels).for_each(|(sum, pixel)| *sum += *pixel);
        let error = unbiased_relative_l2(&full, &all);
        println!("{name}: {error:.4}, direct alone {:.4}", unbiased_relative_l2(&relit.direct, &all));
        assert!(error < most, "{name}: {error}");
        assert!(unbiased_relative_l2(&relit.direct, &all) > 0.2, "bounces must be noticed");
    }
}

#[test]
fn another_colour_costs_a_sum_and_what_cannot_be_is_told() {
    let built = court();
    let transfer = Arc::new(prepare(&built, tiny()));
    let mut relighter = Relighter::new(Arc::clone(&transfer));
    let settings = RelightSettings::default();
    let turned = |intensity, rotation| rig([dome(Some(painted(true)), intensity, rotation)]);
    let steps = [(turned(LIGHT, 0.0), 1), (turned(0.5 * LIGHT, 0.0), 0), (turned(LIGHT, 5.0), 1)];
    for (rig, relit) in steps {
        let layers = relighter.relight(&rig, &settings).unwrap();
        assert_eq!(relighter.stats().relit, relit);
        let afresh = relight_afresh(&transfer, &rig, &settings);
        assert_eq!(layers.direct, afresh.direct);
    }
    let refused = |transfer: relume::Transfer, bounces| {
        let settings = RelightSettings { bounces, ..RelightSettings::default() };
        match Relighter::new(transfer).relight(&even(LIGHT), &settings) {
            Err(Error::Setting(told)) => told,
            other => panic!("{other:?}"),
        }
    };
    let blind = prepare(&built, Settings { sky: false, ..tiny() });
    assert!(refused(blind, None).contains("without --no-sky"));
    let photons = prepare(&built, Settings { multibounce: Multibounce::Photon, ..tiny() });
    assert!(refused(photons, Some(1)).contains("surfaces or domes"));
}

#[test]
fn sharp_reflections_of_a_dome_are_found_by_scattered_rays() {
    let exact = LIGHT.x;
    // a lossless mirror, nearly: all of a sharp lobe above the floor
    let mirror = Material { metallic: 1.0, roughness: 0.05, specular: 1.0, ..lambertian(Vec3::ONE) };
    let traced = path_traced(&floor(mirror), &even(LIGHT), 64, Some(0));
    let seen = mean(&traced.layers.direct).x as f32;
    println!("{seen} of {exact}, noise {:.4}", traced.noise.direct);
    assert!((seen / exact - 1.0).abs() < 0.02 && traced.noise.direct < 0.05);
    // emissive things and domes together
    let lit = path_traced(&floor(emissive(Vec3::ONE, Vec3::splat(2.0))), &even(LIGHT), 64, Some(0));
    assert!((mean(&lit.layers.direct).x as f32 - exact - 2.0).abs() < 0.02);
}
