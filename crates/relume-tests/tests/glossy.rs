//! Reflections of indirect light along specular lobes.

use std::sync::Arc;

use relume::LightRig;
use relume::glam::{Vec3, Vec4};
use relume::relight::RelightSettings;
use relume::sample::Receivers;
use relume::scene::Material;
use relume::trace::sampling::{hash, unit};
use relume::transfer::{Encoding, Quality, RowMethod, Settings};
use relume_tests::prepared::{lit_centers, prepare, relight_afresh, spread, tiny, uncompressed};
use relume_tests::scenes::{SceneBuilder, emissive, empty_room, hall, lambertian, metal, omni, rig};
use relume_tests::truth::{trace, unbiased_relative_l2};

/// A dielectric with a dark colour of its own.
fn varnish(roughness: f32) -> Material {
    Material { base_color: Vec4::new(0.1, 0.08, 0.05, 1.0), metallic: 0.0, roughness, ..Material::default() }
}

/// Under light from everywhere a lobe returns what it can return, whatever its shape.
#[test]
fn glossy_rows_sum_to_one_in_a_closed_room() {
    for (roughness, off) in [(0.1, 0.18), (0.3, 0.16), (0.6, 0.07), (1.0, 0.04)] {
        let built = empty_room(metal(roughness));
        let transfer = prepare(&built, uncompressed((48, 36)));
        let glossy = transfer.glossy.as_ref().expect("metal reflects");
        let ones = vec![Vec3::ONE; transfer.cloud.len()];
        let sums = glossy.apply(&ones);
        let sums: Vec<f32> = lit_centers(&transfer).map(|(_, row)| sums[row].x).collect();
        let [low, median, high] = spread(&sums);
        println!("roughness {roughness}: {low:.3}, median {median:.3}, {high:.3}");
        // measured 0.993 to 1.002; single rows 0.89 to 1.11, 0.89 to 1.11, 0.96 to 1.06, 0.98 to 1.02
        assert!((median - 1.0).abs() < 0.015, "{median}");
        assert!(low > 1.0 - off && high < 1.0 + off, "{low} {high}");
    }
}

/// Relative L2 of the indirect light after two bounces: of the relit image with reflections, and without.
fn errors(floor: Material, settings: &Settings) -> [f64; 2] {
    let built = hall(floor);
    let lights = rig([omni(Vec3::new(3.2, 2.4, 2.2), Vec3::new(10.0, 9.0, 8.0), 0.0)]);
    let truth = trace(&built, &lights, settings.size, 2, 256);
    let relight = RelightSettings { bounces: Some(2), aa: 1, ..RelightSettings::default() };
    [true, false].map(|glossy| {
        let transfer = Arc::new(prepare(&built, Settings { glossy, ..settings.clone() }));
        assert_eq!(transfer.glossy.is_some(), glossy);
        let layers = relight_afresh(&transfer, &lights, &relight);
        unbiased_relative_l2(&layers.indirect, &truth.indirect[1])
    })
}

#[test]
fn reflections_agree_with_the_path_tracer() {
    let settings =
        Settings { size: (96, 72), gather: 4096, quality: Quality::Standard, ..Settings::default() };
    // measured 0.021, 0.008 and less than the truth's noise; without reflections 0.39, 0.40 and 0.043
    let floors =
        [("metal", metal(0.1), 0.035), ("metal", metal(0.3), 0.02), ("varnish", varnish(0.1), 0.015)];
    for (name, floor, bound) in floors {
        let roughness = floor.roughness;
        let [with, without] = errors(floor, &settings);
        println!("{name}, roughness {roughness}: {with:.4}, without reflections {without:.4}");
        assert!(with < bound, "{name}, roughness {roughness}: {with}");
        assert!(without > 1.5 * bound, "{name}, roughness {roughness}: {without}");
    }
}

#[test]
fn all_ways_reflect_alike() {
    let settings = Settings { size: (48, 36), gather: 4096, quality: Quality::Draft, ..Settings::default() };
    let rows = Settings { encoding: Encoding::HaarRows, coefficients: 1024, ..settings.clone() };
    let paper = Settings { rows: RowMethod::Paper, ..rows.clone() };
    // measured 0.028 and 0.040; without reflections 0.41
    for (name, settings, bound) in [("haar-rows", rows, 0.05), ("the paper's rows", paper, 0.06)] {
        let [with, without] = errors(metal(0.4), &settings);
        println!("{name}: {with:.4}, without reflections {without:.4}");
        assert!(with < bound, "{name}: {with}");
        assert!(without > 1.5 * bound, "{name}: {without}");
    }
}

/// What lamps send to a surface straight is reflected along its lobe too, and counts as direct; so do the highlights of lights with extent.
#[test]
fn direct_light_is_reflected_from_lamps_and_lights_alike() {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::splat(0.5)));
    let floor = builder.material(metal(0.25));
    let lamp = builder.material(emissive(Vec3::ZERO, Vec3::new(8.0, 7.0, 5.0)));
    builder
        .room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall)
        .quad(0.002 * Vec3::Y, 5.0 * Vec3::Z, 4.0 * Vec3::X, floor)
        .quad(Vec3::new(1.6, 1.2, 0.01), 0.8 * Vec3::X, 0.6 * Vec3::Y, lamp)
        .camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 0.7, 0.0), 55.0);
    let built = builder.build();
    let settings =
        Settings { size: (96, 72), gather: 4096, quality: Quality::Standard, ..Settings::default() };
    let sphere = rig([omni(Vec3::new(2.8, 1.4, 1.5), Vec3::splat(3.0), 0.15)]);
    let relight = RelightSettings { bounces: Some(0), aa: 1, ..RelightSettings::default() };
    let truths = [LightRig::default(), sphere.clone()].map(|lights| trace(&built, &lights, (96, 72), 1, 256));
    let [with, without] = [true, false].map(|glossy| {
        let transfer = Arc::new(prepare(&built, Settings { glossy, ..settings.clone() }));
        let images =
            [LightRig::default(), sphere.clone()].map(|lights| relight_afresh(&transfer, &lights, &relight));
        [0, 1].map(|which| unbiased_relative_l2(&images[which].direct, &truths[which].direct))
    });
    println!(
        "of the lamp {:.4}, with a light {:.4}; without reflections {:.4}, {:.4}",
        with[0], with[1], without[0], without[1]
    );
    assert!(with[0] < 0.02 && with[1] < 0.02, "{with:?}");
    assert!(without[0] > 0.1, "{without:?}");
}

/// Beside each other in one plane, what is polished and what is rough must not share a lobe.
#[test]
fn no_receiver_serves_polished_and_rough_samples_alike() {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::splat(0.5)));
    let [polished, rough] = [0.1, 0.5].map(|roughness| builder.material(metal(roughness)));
    builder.room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall);
    for strip in 0..20 {
        let corner = Vec3::new(0.2 * strip as f32, 0.002, 0.0);
        let material = if strip % 2 == 0 { polished } else { rough };
        builder.quad(corner, 5.0 * Vec3::Z, 0.2 * Vec3::X, material);
    }
    builder.camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 0.7, 0.0), 55.0);
    let transfer = prepare(&builder.build(), tiny());
    let mut seen = vec![(f32::INFINITY, 0.0_f32); transfer.gather.rows];
    let mut counts = [0, 0];
    for (sample, &row) in transfer.view.quads.iter().zip(transfer.receivers_of_quads.iter()) {
        if row != Receivers::NONE && (sample.material == polished as u32 || sample.material == rough as u32) {
            let (low, high) = &mut seen[row as usize];
            (*low, *high) = (low.min(sample.roughness()), high.max(sample.roughness()));
            counts[usize::from(sample.material == rough as u32)] += 1;
        }
    }
    assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
    assert!(seen.iter().all(|&(low, high)| high - low < 0.2 || low > high), "one lobe for both");
}

#[test]
fn reflections_add_up() {
    let transfer = Arc::new(prepare(&hall(metal(0.3)), tiny()));
    let light = |seed: u32| -> Vec<Vec3> {
        (0..transfer.cloud.len() as u32).map(|i| Vec3::splat(unit(hash(i, seed)))).collect()
    };
    let (a, b) = (light(1), light(2));
    let both: Vec<Vec3> = a.iter().zip(&b).map(|(a, b)| 2.0 * *a - *b).collect();
    let [a, b, both] = [a, b, both].map(|light| transfer.gather_from(&light, 0.0));
    let glossy = transfer.glossy.as_ref().expect("metal reflects");
    assert_eq!(a.0, transfer.gather.apply(&light(1)));
    let [a, b, both] = [a, b, both].map(|light| light.1.expect("metal reflects"));
    assert_eq!(a, glossy.apply(&light(1)));
    let norm: f32 = both.iter().map(|v| v.length_squared()).sum();
    let off: f32 = both
        .iter()
        .zip(a.iter().zip(&b))
        .map(|(both, (a, b))| (*both - (2.0 * *a - *b)).length_squared())
        .sum();
    assert!(norm > 0.0 && (off / norm).sqrt() < 1e-5, "{}", (off / norm).sqrt());
}

#[test]
fn where_nothing_reflects_nothing_is_kept() {
    let transfer = prepare(&empty_room(lambertian(Vec3::splat(0.5))), tiny());
    assert!(transfer.glossy.is_none() && transfer.report.glossy_error.is_none());
}
