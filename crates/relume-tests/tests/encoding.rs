//! What the encoding of a real scene loses: as much as it may, under lights of other kinds too, and without seams between blocks.

use std::sync::Arc;

use relume::glam::Vec3;
use relume::sample::{Receivers, illuminate};
use relume::transfer::{Encoding, Matrix, Quality, Settings};
use relume::{Error, LightKind, Preparation, Transfer};
use relume_tests::prepared::{prepare, tiny};
use relume_tests::scenes::{SceneBuilder, arcade, box_room, emissive, lambertian, omni, rig, spot};

fn settings() -> Settings {
    Settings { size: (160, 120), gather: 4096, quality: Quality::Draft, glossy: false, ..Settings::default() }
}

#[test]
fn a_budget_is_spent_and_kept() {
    let built = arcade();
    let with = |error| prepare(&built, Settings { error: Some(error), ..settings() });
    let budgets = [0.04, 0.08, 0.16];
    let transfers = budgets.map(with);
    let told = transfers.each_ref().map(|transfer| transfer.report.gather_error);
    let bounced = transfers.each_ref().map(|transfer| transfer.report.bounce_error.expected);
    let bytes = transfers.each_ref().map(|transfer| [transfer.gather.bytes(), transfer.bounce.bytes()]);
    println!("told {told:.4?}, of bounces {bounced:.4?}, bytes {bytes:?}");
    for (budget, bounced) in budgets.into_iter().zip(bounced) {
        let share = bounced.expect("lights reach the arcade") / f64::from(3.0 * budget);
        // at the highest price so small a cloud loses less than 48%
        assert!(share < 1.2 && (share > 0.8 || budget == 0.16), "bounces lose {share} of 3 times {budget}");
    }
    for (budget, told) in budgets.into_iter().zip(told) {
        let expected = told.expected.expect("lights reach the arcade");
        assert!((expected / f64::from(budget) - 1.0).abs() < 0.2, "{expected} instead of {budget}");
        // what was learned holds for what was not learned from, but for some
        let others = told.other_lights.expect("other lights do too");
        assert!(others > 0.5 * expected && others < 3.0 * expected, "{others} beside {expected}");
    }
    for part in 0..2 {
        assert!(bytes[0][part] > bytes[1][part] && bytes[1][part] > bytes[2][part]);
    }
}

#[test]
fn budgets_that_cannot_be_are_refused() {
    let built = box_room();
    let told = |settings| match Preparation::new(&built.scene).settings(settings).run(&()) {
        Err(Error::Setting(told)) => told,
        other => panic!("{:?}", other.map(|_| ())),
    };
    let with = |error| Settings { error: Some(error), ..tiny() };
    assert!(told(with(0.0)).contains("must be 0.001 to 1"));
    assert!(told(with(f32::NAN)).contains("must be 0.001 to 1"));
    assert!(told(Settings { encoding: Encoding::HaarRows, ..with(0.1) }).contains("is for low-rank"));
}

/// What shines in the scene is known before any lamp is, and its light is kept better than a lamp's.
#[test]
fn light_of_the_scene_is_learned() {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::new(0.7, 0.6, 0.5)));
    let lamp = builder.material(emissive(Vec3::ZERO, Vec3::splat(5.0)));
    builder
        .room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall)
        .block(Vec3::new(1.1, 0.0, 1.2), Vec3::new(2.1, 1.3, 2.2), wall)
        .quad(Vec3::new(3.0, 2.99, 2.0), Vec3::X * 0.2, Vec3::Z * 0.2, lamp)
        .camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 1.2, 0.0), 55.0);
    let built = builder.build();
    let low_rank = prepare(&built, settings());
    let exact = prepare(&built, Settings { encoding: Encoding::HaarRows, coefficients: 4096, ..settings() });
    let emitted: Vec<Vec3> = low_rank.cloud.samples.iter().map(|sample| sample.emission).collect();
    assert!(emitted.iter().any(|light| *light != Vec3::ZERO));
    let lost = |[told, truth]: [Vec<Vec3>; 2]| {
        let norm = |light: &[Vec3]| light.iter().map(|v| f64::from(v.x).powi(2)).sum::<f64>().sqrt();
        let off: Vec<Vec3> = told.iter().zip(&truth).map(|(told, truth)| *told - *truth).collect();
        norm(&off) / norm(&truth)
    };
    let bounce = lost([&low_rank, &exact].map(|transfer| transfer.bounce.apply(&emitted)));
    let gather = lost([&low_rank, &exact].map(|transfer| transfer.gather_from(&emitted, 0.0).0));
    println!("lost of the lamp's light: on the cloud {bounce:.4}, on the receivers {gather:.4}");
    // measured 0.12 and 0.07; where it is not learned from, 0.38 and 0.25
    assert!(bounce < 0.18 && gather < 0.11, "{bounce} {gather}");
}

/// The block of each row.
fn blocks(transfer: &Transfer) -> Vec<usize> {
    let Matrix::LowRank(matrix) = &transfer.gather.matrix else { panic!("low-rank") };
    let shapes = matrix.shapes.iter().enumerate();
    shapes.flat_map(|(block, shape)| std::iter::repeat_n(block, shape.rows as usize)).collect()
}

/// Mean square of the steps in `error` from each pixel to the next on the same surface: within blocks, and from one to another.
fn steps(transfer: &Transfer, error: &[f32]) -> [f64; 2] {
    let (view, blocks) = (&transfer.view, blocks(transfer));
    let mut sums = [(0.0, 0.0); 2];
    for pixel in 0..view.pixels() {
        let right = (pixel + 1) % view.width != 0;
        let next =
            [right.then_some(pixel + 1), (pixel + view.width < view.pixels()).then_some(pixel + view.width)];
        for other in next.into_iter().flatten() {
            let rows = [pixel, other].map(|pixel| transfer.receivers_of_centers[pixel]);
            let [a, b] = [pixel, other].map(|pixel| &view.centers[pixel]);
            let flat = a.geometric_normal.get().dot(b.position - a.position).abs()
                < 0.05 * a.position.distance(b.position);
            let alike = a.shading_normal.get().dot(b.shading_normal.get()) > 0.98;
            if rows.contains(&Receivers::NONE) || !flat || !alike {
                continue;
            }
            let [a, b] = rows.map(|row| row as usize);
            let sum = &mut sums[usize::from(blocks[a] != blocks[b])];
            sum.0 += f64::from(error[a] - error[b]).powi(2);
            sum.1 += 1.0;
        }
    }
    sums.map(|(squares, count)| squares / f64::max(count, 1.0))
}

#[test]
fn the_error_takes_no_larger_steps_between_blocks_than_within() {
    let built = arcade();
    let low_rank = Arc::new(prepare(&built, settings()));
    let exact = prepare(&built, Settings { encoding: Encoding::HaarRows, coefficients: 4096, ..settings() });
    assert_eq!(low_rank.receivers_of_centers[..], exact.receivers_of_centers[..]);
    let accel = low_rank.occluders.accel();
    let lights: [LightKind; 3] = [
        omni(Vec3::new(-1.2, 4.4, 0.3), Vec3::splat(13.0), 0.0),
        spot(Vec3::new(-1.6, 4.3, 1.3), Vec3::new(1.0, 1.9, 0.0), Vec3::splat(60.0), (12.0, 22.0)),
        LightKind::Distant { direction: Vec3::new(0.42, -1.3, -0.58), irradiance: Vec3::ONE, angle: 0.0 },
    ];
    for (number, kind) in lights.into_iter().enumerate() {
        let light = illuminate(&low_rank.cloud, &accel, &rig([kind]).lights[0]).radiance;
        let [found, truth] = [&low_rank.gather, &exact.gather].map(|operator| operator.apply(&light));
        let error: Vec<f32> = found.iter().zip(&truth).map(|(a, b)| a.y - b.y).collect();
        let rms = |values: &mut dyn Iterator<Item = f32>, count: usize| {
            (values.map(|v| f64::from(v).powi(2)).sum::<f64>() / count as f64).sqrt()
        };
        let light = rms(&mut truth.iter().map(|rgb| rgb.y), truth.len());
        let [within, between] = steps(&low_rank, &error).map(|square| square.sqrt() / light);
        println!("light {number}: steps of {within:.4} of the light within blocks, {between:.4} between");
        // measured 1.13, 1.27 and 1.07 times
        assert!(within > 0.0 && between < 1.5 * within, "{between} between, {within} within");
    }
}
