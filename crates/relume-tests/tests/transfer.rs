//! What the transfer says against closed forms and against brute force.

use std::f32::consts::PI;
use std::sync::Arc;

use relume::glam::{DVec3, Vec2, Vec3};
use relume::image::metrics::relative_l2;
use relume::relight::{Only, RelightSettings};
use relume::sample::GatherSample;
use relume::scene::{AlphaMode, ColorSpace, Material, Texture, TextureRef, Wrap};
use relume::trace::sampling::{cosine_hemisphere, sobol_2d};
use relume::trace::{Ray, offset_origin};
use relume::transfer::{BounceSeries, Encoding, Quality, RowMethod, Settings};
use relume::{LightKind, LightRig, Transfer, shade};
use relume_tests::prepared::{
    center_sums, flat, lit_centers, mean, prepare, relight_afresh, row_sums, spread,
};
use relume_tests::scenes::{
    SceneBuilder, TestScene, box_room, emissive, empty_room, integrating_sphere, lambertian, omni, rig, spot,
};

fn standard() -> Settings {
    Settings { size: (32, 24), gather: 1024, quality: Quality::Standard, ..Settings::default() }
}

const ENCODINGS: [Encoding; 3] = [Encoding::LowRank, Encoding::HaarRows, Encoding::HaarBlocks];

/// Every encoding with every estimator; the Haar encodings with all their coefficients, so that they are nothing but 8 bits.
fn all_ways(settings: &Settings) -> Vec<Settings> {
    let mut ways = Vec::new();
    for encoding in ENCODINGS {
        for rows in [RowMethod::Balanced, RowMethod::Paper] {
            ways.push(Settings { encoding, rows, coefficients: settings.gather, ..settings.clone() });
        }
    }
    ways
}

fn only_centers(bounces: Option<u32>) -> RelightSettings {
    RelightSettings { bounces, aa: 1, ..RelightSettings::default() }
}

/// In a closed room of albedo `p` where every surface emits `E`, all light together is `E / (1 - p)`.
#[test]
fn furnace() {
    let (albedo, emission) = (Vec3::new(0.7, 0.5, 0.2), Vec3::new(1.0, 2.0, 3.0));
    let built = empty_room(emissive(albedo, emission));
    let transfer = Arc::new(prepare(&built, standard()));
    let expected = emission / (Vec3::ONE - albedo);
    let layers = relight_afresh(&transfer, &LightRig::default(), &only_centers(None));
    let full = layers.full();
    let ratio = mean(&full) / expected.as_dvec3();
    let error = relative_l2(&full, &flat(&full, expected)).unwrap();
    println!("furnace: mean off by {}, pixels by {error}", ratio - 1.0);
    assert!((ratio - 1.0).abs().max_element() < MEAN_FURNACE, "{ratio}");
    assert!(error < PIXEL_FURNACE, "{error}");
    // another albedo is noticed
    let wrong = emission / (Vec3::ONE - 1.05 * albedo);
    assert!(relative_l2(&full, &flat(&full, wrong)).unwrap() > PIXEL_FURNACE);
    // bounce by bounce: `E p^(k + 1)` more with each
    for bounces in 0..4 {
        let layers = relight_afresh(&transfer, &LightRig::default(), &only_centers(Some(bounces)));
        let ratio = |bounces| {
            let powers = (0..=bounces + 1).map(|k| albedo.powf(k as f32)).sum::<Vec3>();
            mean(&layers.full()) / (emission * powers).as_dvec3()
        };
        let off = |bounces| (ratio(bounces) - 1.0).abs().max_element();
        assert!(off(bounces) < MEAN_FURNACE, "{bounces} bounces: {}", ratio(bounces));
        assert!(off(bounces + 1) > MEAN_FURNACE, "a bounce more must be noticed");
        assert!(bounces > 0 || mean(&layers.indirect) == DVec3::ZERO);
    }
}

/// Measured 0.0025 in red, where light goes round longest. Rows are noisy (192 hemisphere rays): their mean is 1.004, of
/// which the final gather's is left; in the bounces it was 0.010, before they were held to the highest albedo.
const MEAN_FURNACE: f64 = 0.008;
/// Measured 0.0028: the same and the 8 bits of single rows.
const PIXEL_FURNACE: f64 = 0.008;

/// Pixels are lit by tiles, samples side by side, and what a light cannot reach is not looked at. Held against each sample alone, also in pictures that are
/// no whole tiles.
#[test]
fn direct_light_is_that_of_each_sample_alone() {
    let built = box_room();
    let (place, bright) = (Vec3::new(2.6, 2.2, 2.6), Vec3::new(10.0, 8.0, 6.0));
    for size in [(37, 29), (1, 7), (6, 1)] {
        let settings = Settings { size, gather: 256, quality: Quality::Glance, ..Settings::default() };
        let transfer = Arc::new(prepare(&built, settings));
        // a narrow spot on what the middle of the picture shows: on its rim the rounding of a cosine is some fifty times as large
        let middle = transfer.view.centers[transfer.view.centers.len() / 2].position;
        let kinds = [
            omni(place, bright, 0.0),
            spot(place, middle, bright, (3.0, 12.0)),
            spot(place, Vec3::new(1.0, 0.0, 1.0), bright, (50.0, 90.0)),
            LightKind::Distant { direction: Vec3::new(0.2, -1.0, -0.4), irradiance: bright, angle: 0.0 },
        ];
        for (aa, kind) in [1, 2].into_iter().flat_map(|aa| kinds.iter().map(move |kind| (aa, kind))) {
            let rig = rig([kind.clone()]);
            let settings = RelightSettings { aa, only: Only::Direct, ..RelightSettings::default() };
            let found = relight_afresh(&transfer, &rig, &settings).direct;
            let grid = transfer.view.grid(aa);
            assert!(grid.chains.branches.is_empty(), "no mirrors here");
            let mut expected = flat(&found, Vec3::ZERO);
            let camera = transfer.view.camera.position();
            for (index, sample) in grid.samples.iter().enumerate().filter(|(_, sample)| sample.reflects()) {
                let Some(light) = shade::sample(&rig.lights[0], sample.position, Vec2::ZERO) else {
                    continue;
                };
                let surface = sample.surface();
                let [lies, cos] = [surface.geometric_normal, surface.shading_normal]
                    .map(|normal| normal.dot(light.direction));
                let ray = shade::shadow_ray(sample.position, surface.geometric_normal, &light);
                if lies <= 0.0 || cos <= 0.0 || built.accel.occluded(&ray) {
                    continue;
                }
                let view = (camera - sample.position) / sample.depth;
                let brdf = surface.diffuse_albedo / PI + surface.specular(view, light.direction);
                expected.pixels[index / grid.a_pixel] += brdf * light.irradiance * cos / grid.a_pixel as f32;
            }
            let off = relative_l2(&found, &expected).unwrap();
            assert!(off < 1e-5, "{size:?}, {aa} samples a side, {kind:?}: {off}");
        }
    }
}

/// In a hollow ball every point gathers the same share of every other: wherever the light stands, the walls receive
/// `I / R^2` on average, and indirect light is `p^2 I / (pi R^2) (1 + p + p^2 + ...)` everywhere.
#[test]
fn integrating_sphere_has_the_same_indirect_light_everywhere() {
    let (albedo, intensity) = (Vec3::new(0.8, 0.5, 0.3), Vec3::new(1.0, 2.0, 4.0));
    let built = integrating_sphere(lambertian(albedo));
    let transfer = Arc::new(prepare(&built, standard()));
    for position in [Vec3::ZERO, Vec3::new(0.3, -0.4, 0.2), Vec3::new(-0.2, 0.75, -0.3)] {
        let lights = rig([omni(position, intensity, 0.0)]);
        for bounces in [Some(1), Some(2), Some(4), None] {
            let layers = relight_afresh(&transfer, &lights, &only_centers(bounces));
            let expected = |albedo: Vec3, bounces: u32| {
                let powers = (0..bounces).map(|k| albedo.powf(k as f32)).sum::<Vec3>();
                albedo * albedo * intensity / PI * powers
            };
            let off = |expected| relative_l2(&layers.indirect, &flat(&layers.indirect, expected)).unwrap();
            let bounced = bounces.unwrap_or(100);
            let ratio = mean(&layers.indirect) / expected(albedo, bounced).as_dvec3();
            let error = off(expected(albedo, bounced));
            println!("light at {position}, {bounces:?} bounces: mean {ratio}, pixels off by {error}");
            // measured 0.0037 and 0.0046: the noise of the rows, once a bounce
            assert!((ratio - 1.0).abs().max_element() < 0.008, "{position}, {bounces:?}: {ratio}");
            assert!(error < 0.008, "{position}, {bounces:?}: {error}");
            assert!(off(expected(1.02 * albedo, bounced)) > 0.008, "another albedo must be noticed");
            assert!(
                bounces.is_none() || off(expected(albedo, bounced + 1)) > 0.008,
                "a bounce more must be noticed"
            );
        }
    }
    // a light outside lights nothing
    let outside = rig([omni(Vec3::new(0.0, 3.0, 0.0), intensity, 0.0)]);
    let dark = relight_afresh(&transfer, &outside, &RelightSettings::default());
    assert_eq!(mean(&dark.full()), DVec3::ZERO);
}

/// The series of a real operator, noise and all, against two hundred terms of it.
#[test]
fn bounces_add_up_to_all_their_terms() {
    let built = empty_room(lambertian(Vec3::new(0.8, 0.6, 0.3)));
    let transfer = prepare(&built, standard());
    let albedo: Vec<Vec3> = transfer.cloud.samples.iter().map(|sample| sample.albedo).collect();
    let series = BounceSeries::new(&transfer.bounce, &albedo);
    // a spot on one wall, and light on all of it
    let place = transfer.cloud.samples[100].position;
    let spot = |reach: f32| -> Vec<Vec3> {
        let lit = |sample: &GatherSample| sample.position.distance(place) < reach;
        transfer.cloud.samples.iter().map(|s| if lit(s) { Vec3::ONE } else { Vec3::ZERO }).collect()
    };
    let l2 = |light: &[Vec3]| light.iter().map(|rgb| rgb.as_dvec3().length_squared()).sum::<f64>().sqrt();
    for reach in [0.2, 1.5] {
        let direct = spot(reach);
        let (sum, steps, _) = series.sum(&transfer.bounce, &direct, None, 0.0);
        let (mut last, mut all, mut cut) = (direct.clone(), direct.clone(), Vec::new());
        for term in 1..=200 {
            last = series.reflect(&transfer.bounce, &last, 0.0).0;
            all.iter_mut().zip(&last).for_each(|(all, last)| *all += *last);
            if term == steps {
                cut = all.clone();
            }
        }
        let off = |sum: &[Vec3]| {
            // what is reflected alone, so that the spot's own light hides nothing
            let reflected: Vec<Vec3> = all.iter().zip(&direct).map(|(all, direct)| *all - *direct).collect();
            let difference: Vec<Vec3> = sum.iter().zip(&all).map(|(sum, all)| *sum - *all).collect();
            l2(&difference) / l2(&reflected)
        };
        println!("{steps} bounces: off by {:.6}, without the tail by {:.6}", off(&sum), off(&cut));
        assert!(off(&sum) < 1e-4, "{}", off(&sum));
        assert!(off(&cut) > 1e-3, "the sum without its tail must be noticed");
    }
}

#[test]
fn rows_sum_to_one_in_a_closed_room() {
    let (closed, open) = (box_room(), yard());
    for settings in all_ways(&standard()) {
        let way = format!("{:?} {:?}", settings.encoding, settings.rows);
        let (lowest, mean_off, highest) = match settings.rows {
            // measured 0.983 to 1.024 in single pixels
            RowMethod::Balanced => (0.95, 0.01, 1.06),
            // the paper's clamp darkens corners, its one representative a cluster is noisy: measured 0.73 to 1.09
            RowMethod::Paper => (0.5, 0.08, 1.2),
        };
        let is_one = |built: &TestScene| {
            let [low, middle, high] = spread(&row_sums(&prepare(built, settings.clone())));
            println!("{way}: row sums {low:.3} to {high:.3}, mean {middle:.4}");
            (middle - 1.0).abs() < mean_off && low > lowest && high < highest
        };
        assert!(is_one(&closed), "{way}");
        assert!(!is_one(&open), "{way}: the sky must be noticed");
    }
}

/// For each row the share of the hemisphere that is not sky, by rays of our own.
fn sky_free(built: &TestScene, transfer: &Transfer) -> Vec<f32> {
    const RAYS: u32 = 1024;
    let share = |(pixel, _): (usize, usize)| {
        let sample = &transfer.view.centers[pixel];
        let (normal, geometric) = (sample.shading_normal.get(), sample.geometric_normal.get());
        let origin = offset_origin(sample.position, geometric);
        let front = |index: &u32| {
            let direction = cosine_hemisphere(normal, sobol_2d(*index, 3, pixel as u32));
            let hit = built.accel.closest(&Ray::new(origin, direction));
            hit.is_hit() && built.geometry.area_vector(hit.triangle as usize).dot(direction) < 0.0
        };
        (0..RAYS).filter(front).count() as f32 / RAYS as f32
    };
    lit_centers(transfer).map(share).collect()
}

/// Two walls, a floor and a block under the open sky.
fn yard() -> TestScene {
    let mut builder = SceneBuilder::new();
    let stone = builder.material(lambertian(Vec3::new(0.6, 0.5, 0.4)));
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 2.0, Vec3::Z * 4.0);
    builder
        .quad(Vec3::ZERO, z, x, stone)
        .quad(Vec3::ZERO, x, y, stone)
        .quad(Vec3::ZERO, y, z, stone)
        .block(Vec3::new(1.5, 0.0, 1.0), Vec3::new(2.5, 0.8, 2.0), stone)
        .camera(Vec3::new(3.9, 1.8, 3.9), Vec3::new(1.2, 0.4, 1.0), 60.0);
    builder.build()
}

#[test]
fn rows_sum_to_what_is_not_sky_in_the_open() {
    let built = yard();
    for settings in all_ways(&standard()) {
        let transfer = prepare(&built, settings.clone());
        let (sums, expected) = (center_sums(&transfer), sky_free(&built, &transfer));
        let [low, middle, high] = spread(&sums);
        let truth = spread(&expected);
        let error = relative(&sums, &expected);
        let way = format!("{:?} {:?}", settings.encoding, settings.rows);
        println!("{way}: sums {low:.3} {middle:.3} {high:.3}, expected {truth:.3?}, relative L2 {error:.4}");
        assert!(high < 1.0 && low > 0.0, "{way}: {low} to {high}");
        let (mean_off, most) = match settings.rows {
            // measured 0.003 and 0.010; on an older cloud 0.047
            RowMethod::Balanced => (0.015, 0.06),
            // measured 0.03 and 0.14
            RowMethod::Paper => (0.06, 0.2),
        };
        assert!((middle / truth[1] - 1.0).abs() < mean_off, "{way}: {middle} instead of {}", truth[1]);
        assert!(error < most, "{way}: {error}");
        // the sums of the rows in another order, and those of a room
        let reversed: Vec<f32> = expected.iter().rev().copied().collect();
        println!("{way}: reversed {:.4}", relative(&sums, &reversed));
        assert!(relative(&sums, &reversed) > most, "{way}: another row's sky must be noticed");
        assert!((middle - 1.0).abs() > mean_off, "{way}: the sky must be noticed");
    }
}

/// Relative L2 of `sums` against `expected`.
fn relative(sums: &[f32], expected: &[f32]) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v * v)).sum::<f64>();
    let off = square(&mut sums.iter().zip(expected).map(|(a, b)| a - b));
    (off / square(&mut expected.iter().copied())).sqrt()
}

/// A sheet of many holes in a room, or before a single wall.
fn grating(closed: bool) -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::splat(0.6)));
    let texels = (0..64 * 64).map(|i| [255, 255, 255, if (i / 128 + i / 2) % 2 == 0 { 255 } else { 0 }]);
    let texture = builder.texture(Texture {
        name: "grating".into(),
        width: 64,
        height: 64,
        texels: texels.collect(),
        color_space: ColorSpace::Linear,
        wrap: [Wrap::Repeat; 2],
    });
    let leaf = builder.material(Material {
        base_color_texture: Some(TextureRef::new(texture)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..lambertian(Vec3::splat(0.6))
    });
    if closed {
        builder.room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall);
    } else {
        builder.quad(Vec3::ZERO, 4.0 * Vec3::X, 3.0 * Vec3::Y, wall);
    }
    builder.quad(Vec3::new(0.0, 0.0, 0.4), 4.0 * Vec3::X, 3.0 * Vec3::Y, leaf).camera(
        Vec3::new(0.2, 1.5, 0.2),
        Vec3::new(4.0, 1.2, 0.1),
        70.0,
    );
    builder.build()
}

/// Leaves cut out of a sheet, each smaller than the patches that stand for them, take no light away.
#[test]
fn rows_sum_to_one_behind_a_grating() {
    let mean_sum = |closed| {
        let settings = Settings { encoding: Encoding::HaarRows, coefficients: 1024, ..standard() };
        let [low, middle, high] = spread(&row_sums(&prepare(&grating(closed), settings)));
        println!("grating: row sums {low:.3} to {high:.3}, mean {middle:.4}");
        middle
    };
    // measured 1.001; 0.970 where rays that meet patches with a hole in their middle find nothing
    assert!((mean_sum(true) - 1.0).abs() < 0.015);
    assert!((mean_sum(false) - 1.0).abs() > 0.015, "the sky must be noticed");
}

/// A wall on a plain of `half` metres each way.
fn plain(half: f32) -> TestScene {
    let mut builder = SceneBuilder::new();
    let stone = builder.material(lambertian(Vec3::new(0.6, 0.5, 0.4)));
    builder
        .quad(Vec3::new(-half, 0.0, -half), Vec3::Z * 2.0 * half, Vec3::X * 2.0 * half, stone)
        .quad(Vec3::new(-2.0, 0.0, 0.0), Vec3::X * 4.0, Vec3::Y * 3.0, stone)
        .camera(Vec3::new(0.0, 1.5, 2.0), Vec3::new(0.0, 1.5, 0.0), 50.0);
    builder.build()
}

/// A wall on a wide plain: most of what lights the wall lies behind the camera, and far rays between the two are few.
#[test]
fn a_wide_plain_is_not_lost() {
    let built = plain(30.0);
    let settings = Settings { encoding: Encoding::HaarRows, coefficients: 1024, ..standard() };
    let transfer = prepare(&built, settings);
    let sums = spread(&center_sums(&transfer));
    let off = |built: &TestScene| {
        let expected = spread(&sky_free(built, &transfer));
        println!("plain: sums {sums:.4?}, expected {expected:.4?}");
        (sums[1] / expected[1] - 1.0).abs()
    };
    // measured 0.002
    assert!(off(&built) < 0.01, "{sums:?}");
    assert!(off(&plain(10.0)) > 0.01, "a smaller plain must be noticed");
}

/// The row of a point below the middle of a parallel disc is that disc's form factor, `a^2 / (a^2 + h^2)`.
#[test]
fn parallel_discs_have_their_form_factor() {
    for (radius, height) in [(0.5_f32, 1.0_f32), (1.0, 0.4), (0.3, 2.0)] {
        let mut builder = SceneBuilder::new();
        let white = builder.material(lambertian(Vec3::splat(0.5)));
        builder
            .disc(Vec3::ZERO, Vec3::Y, 0.8, 64, white)
            .disc(Vec3::Y * height, Vec3::NEG_Y, radius, 128, white)
            .camera(Vec3::new(2.5, 0.5 * height, 0.0), Vec3::ZERO, 30.0);
        let built = builder.build();
        for encoding in ENCODINGS {
            // the sky would be most of a row, and take most of its eight bits
            let settings =
                Settings { size: (33, 33), encoding, coefficients: 1024, sky: false, ..standard() };
            let transfer = prepare(&built, settings);
            // the middle pixel looks at the origin
            let sum = row_sums(&transfer)[transfer.receivers_of_centers[16 * 33 + 16] as usize];
            let factor = |height: f32| radius * radius / (radius * radius + height * height);
            println!("radius {radius}, height {height}, {encoding:?}: {sum} for {}", factor(height));
            assert!((sum / factor(height) - 1.0).abs() < 0.03, "{sum} is not {}", factor(height));
            assert!((sum / factor(1.3 * height) - 1.0).abs() > 0.03, "another height must be noticed");
        }
    }
}

/// All encodings and both estimators stand for the same matrix.
#[test]
fn all_ways_relight_alike() {
    let built = box_room();
    let lights = rig([omni(Vec3::new(3.0, 2.2, 2.5), Vec3::splat(10.0), 0.0)]);
    // what is stored, not what is left out of it
    let settings = RelightSettings { only: Only::Indirect, cull: Some(0.0), ..only_centers(Some(2)) };
    let images: Vec<_> = all_ways(&standard())
        .into_iter()
        .map(|way| relight_afresh(&Arc::new(prepare(&built, way)), &lights, &settings).indirect)
        .collect();
    // against all coefficients of balanced rows; every second is the paper's estimator, which darkens corners, and the
    // first two have sixteen directions for all of a small image
    let errors: Vec<f64> = images.iter().map(|image| relative_l2(image, &images[2]).unwrap()).collect();
    println!("{errors:.4?}");
    let elsewhere = rig([omni(Vec3::new(1.0, 2.2, 2.5), Vec3::splat(10.0), 0.0)]);
    let other = relight_afresh(&Arc::new(prepare(&built, standard())), &elsewhere, &settings).indirect;
    for ((error, most), image) in errors.iter().zip(ALIKE).zip(&images) {
        assert!(*error <= most, "{errors:?}");
        assert!(relative_l2(&other, image).unwrap() > most, "another light must be noticed");
    }
}

/// Measured 0.005, 0.032, 0, 0.032, 0.004, 0.032; on an older light prior 0.12 for the first four.
const ALIKE: [f64; 6] = [0.15, 0.15, 0.0, 0.15, 0.01, 0.15];

/// As many coefficients as gather samples, and more, keep all of them.
#[test]
fn haar_rows_may_keep_more_coefficients_than_there_are() {
    let built = box_room();
    let settings = |coefficients| Settings {
        gather: 256,
        coefficients,
        encoding: Encoding::HaarRows,
        size: (8, 6),
        quality: Quality::Draft,
        ..Settings::default()
    };
    let all = prepare(&built, settings(256));
    let more = prepare(&built, settings(1000));
    // not row sums, which are in the first coefficient alone
    let lit = |transfer: &Transfer| {
        let count = transfer.cloud.len();
        transfer.gather.apply(&(0..count).map(|i| Vec3::splat((i % 7) as f32)).collect::<Vec<_>>())
    };
    assert_eq!(lit(&all), lit(&more));
    let error = |transfer: &Transfer| transfer.report.gather_error.expected.expect("lights reach the room");
    assert!(error(&all) < 0.02, "{}", error(&all));
    let few = prepare(&built, settings(10));
    assert_ne!(lit(&all), lit(&few), "what is left out is noticed");
    assert!(error(&few) > 0.1 && few.gather.bytes() < all.gather.bytes());
}
