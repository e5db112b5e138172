//! Emissive materials dimmed and coloured in the rig.

use std::sync::Arc;

use relume::glam::Vec3;
use relume::image::Layers;
use relume::image::metrics::relative_l2;
use relume::reference::{Settings as ReferenceSettings, render};
use relume::relight::{EMISSION, RelightSettings};
use relume::scene::Material;
use relume::transfer::{Quality, Settings};
use relume::{Emitter, Error, LightRig, Relighter};
use relume_tests::prepared::{prepare, relight_afresh, tiny};
use relume_tests::scenes::{SceneBuilder, TestScene, emissive, lambertian, omni, rig};
use relume_tests::truth::{trace, unbiased_relative_l2};

const LEFT: Vec3 = Vec3::new(9.0, 8.0, 7.0);
const RIGHT: Vec3 = Vec3::new(3.0, 5.0, 9.0);

/// A room with two lamps of a material each, which shine so, and a third that is never named.
fn lamps(left: Vec3, right: Vec3) -> TestScene {
    let mut builder = SceneBuilder::new();
    let named = |name: &str, material: Material| Material { name: name.to_owned(), ..material };
    let wall = builder.material(named("wall", lambertian(Vec3::splat(0.6))));
    let left = builder.material(named("left", emissive(Vec3::splat(0.2), left)));
    let right = builder.material(named("right", emissive(Vec3::ZERO, right)));
    let other = builder.material(named("other", emissive(Vec3::ZERO, Vec3::ONE)));
    builder
        .room(Vec3::ZERO, Vec3::new(3.0, 2.0, 3.0), wall)
        .quad(Vec3::new(0.02, 0.6, 0.6), 0.8 * Vec3::Y, 0.8 * Vec3::Z, left)
        .quad(Vec3::new(2.98, 0.6, 0.6), 0.8 * Vec3::Z, 0.8 * Vec3::Y, right)
        .disc(Vec3::new(1.5, 1.98, 1.2), Vec3::NEG_Y, 0.3, 24, other)
        .camera(Vec3::new(1.5, 1.0, 2.9), Vec3::new(1.5, 0.8, 0.0), 65.0);
    builder.build()
}

fn with_emitters(emitters: &[(&str, Vec3)]) -> LightRig {
    let emitter = |&(material, scale): &(&str, Vec3)| Emitter { material: material.to_owned(), scale };
    LightRig {
        emitters: emitters.iter().map(emitter).collect(),
        ..rig([omni(Vec3::new(1.5, 0.4, 1.5), Vec3::splat(0.5), 0.0)])
    }
}

fn difference(a: &Layers, b: &Layers) -> f64 {
    let of = |a, b| relative_l2(a, b).expect("images of one size");
    of(&a.direct, &b.direct).max(of(&a.indirect, &b.indirect))
}

#[test]
fn a_scaled_emitter_is_a_scene_with_another_emission() {
    let transfer = Arc::new(prepare(&lamps(LEFT, RIGHT), tiny()));
    let (dimmed, tinted) = (Vec3::splat(0.25), Vec3::new(2.0, 0.0, 0.5));
    let scaled = with_emitters(&[("left", dimmed), ("right", tinted)]);
    let settings = RelightSettings { per_light: true, ..RelightSettings::default() };
    let relit = relight_afresh(&transfer, &scaled, &settings);
    let other = Arc::new(prepare(&lamps(LEFT * dimmed, RIGHT * tinted), tiny()));
    let expected = relight_afresh(&other, &with_emitters(&[]), &settings);
    assert!(difference(&relit, &expected) < 1e-5, "{}", difference(&relit, &expected));
    let plain = relight_afresh(&transfer, &with_emitters(&[]), &settings);
    assert!(difference(&plain, &expected) > 0.2, "what the rig scales must be noticed");
    // one layer for all that shine
    let names: Vec<&str> = relit.per_light.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["light 0", EMISSION]);
    let [ours, theirs] = [&relit, &expected].map(|layers| &layers.per_light[1]);
    assert!(relative_l2(&ours.indirect, &theirs.indirect).unwrap() < 1e-5);
}

#[test]
fn scales_agree_with_the_path_tracer() {
    let built = lamps(LEFT, RIGHT);
    let size = (48, 36);
    let settings = Settings { size, gather: 4096, quality: Quality::Standard, ..Settings::default() };
    let transfer = Arc::new(prepare(&built, settings));
    let rigs =
        [[("left", Vec3::ZERO), ("right", Vec3::ONE)], [("left", Vec3::splat(0.5)), ("right", Vec3::X)]];
    let rigs = rigs.map(|emitters| with_emitters(&emitters));
    let relight = RelightSettings { bounces: Some(2), aa: 1, ..RelightSettings::default() };
    let images = rigs.each_ref().map(|rig| relight_afresh(&transfer, rig, &relight));
    // measured 0.007 and 0.008 direct, 0.040 and 0.029 indirect
    for (which, rig) in rigs.iter().enumerate() {
        let truth = trace(&built, rig, size, 2, 256);
        let [right, wrong] = [which, 1 - which].map(|image| {
            let direct = unbiased_relative_l2(&images[image].direct, &truth.direct);
            [direct, unbiased_relative_l2(&images[image].indirect, &truth.indirect[1])]
        });
        println!("direct and indirect {right:.4?}, of the other rig {wrong:.4?}");
        assert!(right[0] < 0.02 && right[1] < 0.06, "{right:?}");
        assert!(wrong.iter().all(|&error| error > 0.1), "{wrong:?}");
    }
}

#[test]
fn another_scale_costs_a_sum_and_other_names_are_lit_once() {
    let transfer = Arc::new(prepare(&lamps(LEFT, RIGHT), tiny()));
    let settings = RelightSettings::default();
    let mut relighter = Relighter::new(Arc::clone(&transfer));
    let left = |scale: f32| with_emitters(&[("left", Vec3::splat(scale))]);
    let both = |scale: f32| with_emitters(&[("left", Vec3::splat(scale)), ("right", Vec3::X)]);
    // the rig, and whether something is lit that was not before
    let steps = [
        (left(1.0), true),
        (left(0.1), false),
        (left(0.0), false),
        (with_emitters(&[]), true),
        (left(0.5), false),
        (both(2.0), true),
        (with_emitters(&[]), false),
        (both(0.3), false),
    ];
    for (step, (rig, lit)) in steps.into_iter().enumerate() {
        let layers = relighter.relight(&rig, &settings).unwrap();
        let omni_alone = usize::from(step == 0);
        assert_eq!(relighter.stats().relit, omni_alone, "step {step}");
        assert_eq!(relighter.stats().bounce_steps > 0, lit, "step {step}");
        assert!(difference(&layers, &relight_afresh(&transfer, &rig, &settings)) < 1e-6, "step {step}");
    }
}

#[test]
fn what_is_off_from_the_start_costs_nothing_and_has_no_layer() {
    let transfer = Arc::new(prepare(&lamps(LEFT, RIGHT), tiny()));
    let settings = RelightSettings { per_light: true, ..RelightSettings::default() };
    let names = ["left", "right", "other"].map(|name| (name, Vec3::ZERO));
    let mut relighter = Relighter::new(Arc::clone(&transfer));
    let off = LightRig { lights: Vec::new(), ..with_emitters(&names) };
    let layers = relighter.relight(&off, &settings).unwrap();
    assert_eq!(relighter.stats().bounce_steps, 0);
    assert!(layers.per_light.is_empty());
    assert!(layers.direct.pixels.iter().chain(&layers.indirect.pixels).all(|pixel| *pixel == Vec3::ZERO));
}

#[test]
fn materials_of_one_name_follow_one_emitter() {
    let mut built = lamps(LEFT, RIGHT);
    let right = built.scene.materials.iter().position(|material| material.name == "right").unwrap();
    built.scene.materials[right].name = "left".to_owned();
    let scale = Vec3::new(0.5, 0.0, 2.0);
    let transfer = Arc::new(prepare(&built, tiny()));
    let settings = RelightSettings::default();
    let relit = relight_afresh(&transfer, &with_emitters(&[("left", scale)]), &settings);
    let other = Arc::new(prepare(&lamps(LEFT * scale, RIGHT * scale), tiny()));
    let expected = relight_afresh(&other, &with_emitters(&[]), &settings);
    assert!(difference(&relit, &expected) < 1e-5, "{}", difference(&relit, &expected));
}

#[test]
fn an_emitter_that_cannot_be_is_refused() {
    let built = lamps(LEFT, RIGHT);
    let transfer = Arc::new(prepare(&built, tiny()));
    let shine = "those that shine are `left`, `other`, `right`";
    let cases = [
        (
            with_emitters(&[("lamp", Vec3::ONE)]),
            format!("emitter `lamp`: no material has this name; {shine}"),
        ),
        (
            with_emitters(&[("wall", Vec3::ONE)]),
            format!("emitter `wall`: this material emits nothing; {shine}"),
        ),
        (
            with_emitters(&[("left", Vec3::ONE), ("left", Vec3::X)]),
            "emitter `left`: an earlier one names this material too".to_owned(),
        ),
        (
            with_emitters(&[("left", Vec3::NEG_X)]),
            "emitter `left`: `scale` must be three finite numbers, none negative".to_owned(),
        ),
    ];
    let settings = ReferenceSettings { width: 4, height: 4, spp: 2, ..ReferenceSettings::default() };
    for (rig, expected) in cases {
        let refused = Relighter::new(Arc::clone(&transfer)).relight(&rig, &RelightSettings::default());
        let traced = render(&built.scene, &built.geometry, &built.accel, &rig, &settings, &());
        for error in [refused.err(), traced.err()] {
            let Some(Error::Setting(message)) = error else { panic!("{error:?}") };
            assert_eq!(message, expected);
        }
    }
}
