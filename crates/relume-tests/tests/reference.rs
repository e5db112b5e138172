//! The path tracer against closed forms.

use std::sync::atomic::{AtomicU32, Ordering};

use relume::glam::{DVec3, Vec3};
use relume::image::Image;
use relume::reference::{Paths, Progressive, Reference, Settings, render};
use relume::scene::Material;
use relume::shade::surface_at;
use relume::trace::Ray;
use relume::{Error, LightKind, LightRig, Progress};
use relume_tests::scenes::{SceneBuilder, TestScene, emissive, floor, lambertian, omni, rig};

const COLOR: Vec3 = Vec3::new(0.8, 0.5, 0.2);

fn small() -> Settings {
    Settings { width: 16, height: 12, spp: 64, aa: 1, ..Settings::default() }
}

fn trace(built: &TestScene, rig: &LightRig, settings: &Settings) -> Reference {
    render(&built.scene, &built.geometry, &built.accel, rig, settings, &()).expect("valid settings")
}

fn mean(image: &Image) -> DVec3 {
    image.pixels.iter().map(|pixel| pixel.as_dvec3()).sum::<DVec3>() / image.pixels.len() as f64
}

/// Largest relative difference from `expected` over pixels and channels.
fn worst(image: &Image, expected: impl Fn(usize) -> Vec3) -> f32 {
    let differences = image.pixels.iter().enumerate().map(|(i, &pixel)| {
        let expected = expected(i);
        ((pixel - expected).abs() / expected.abs().max(Vec3::splat(1e-6))).max_element()
    });
    differences.fold(0.0, f32::max)
}

fn relative_l2(a: &Image, b: &Image) -> f64 {
    let sum = |f: &dyn Fn(usize) -> Vec3| {
        (0..b.pixels.len()).map(|i| f(i).as_dvec3().length_squared()).sum::<f64>().sqrt()
    };
    sum(&|i| a.pixels[i] - b.pixels[i]) / sum(&|i| b.pixels[i])
}

/// Where the centre of each pixel meets the floor.
fn floor_points(built: &TestScene, settings: &Settings) -> Vec<Vec3> {
    let camera = &built.scene.cameras[0];
    let (width, height) = (settings.width, settings.height);
    (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let direction = camera.direction(x, y, width, height);
            camera.position() - direction * (camera.position().y / direction.y)
        })
        .collect()
}

/// A closed room with a ball in it, lit by a lamp on the ceiling or by the rig.
fn room(wall: Material, ball: Material, lamp: Option<Vec3>) -> TestScene {
    let mut builder = SceneBuilder::new();
    let (wall, ball) = (builder.material(wall), builder.material(ball));
    builder
        .room(Vec3::ZERO, Vec3::new(2.0, 2.0, 3.0), wall)
        .sphere(Vec3::new(0.7, 0.5, 1.0), 0.4, 24, false, ball)
        .camera(Vec3::new(1.0, 1.0, 2.9), Vec3::new(1.0, 0.8, 0.0), 60.0);
    if let Some(emission) = lamp {
        let lamp = builder.material(emissive(Vec3::ZERO, emission));
        builder.disc(Vec3::new(1.0, 1.9, 1.2), Vec3::NEG_Y, 0.3, 24, lamp);
    }
    builder.build()
}

fn grey() -> Material {
    Material { base_color: Vec3::splat(0.6).extend(1.0), ..Material::default() }
}

fn room_lights() -> LightRig {
    rig([
        omni(Vec3::new(1.0, 1.8, 1.5), Vec3::new(2.0, 1.5, 1.0), 0.0),
        omni(Vec3::new(1.6, 0.4, 2.0), Vec3::new(0.2, 0.3, 0.8), 0.1),
        LightKind::Spot {
            position: Vec3::new(0.2, 1.8, 2.5),
            target: Vec3::new(0.7, 0.5, 1.0),
            intensity: Vec3::splat(3.0),
            inner_angle: 15.0,
            outer_angle: 30.0,
            radius: 0.0,
        },
    ])
}

#[test]
fn point_light_on_a_plane() {
    let settings = Settings { spp: 2, ..small() };
    let built = floor(lambertian(COLOR));
    let (position, intensity) = (Vec3::new(0.4, 1.5, 0.2), Vec3::new(10.0, 20.0, 30.0));
    let result = trace(&built, &rig([omni(position, intensity, 0.0)]), &settings);
    let points = floor_points(&built, &settings);
    let expected = |i: usize| {
        let distance2 = position.distance_squared(points[i]);
        COLOR / std::f32::consts::PI * intensity * position.y / distance2.powf(1.5)
    };
    let error = worst(&result.layers.direct, expected);
    assert!(error < 1e-4, "{error}");
    assert!(worst(&result.layers.direct, |i| expected(i) * 1.001) > 5e-4, "a thousandth must be noticed");
    assert_eq!(mean(&result.layers.indirect), DVec3::ZERO, "a plane does not light itself");
}

#[test]
fn sphere_light_on_a_plane() {
    let settings = Settings { spp: 256, ..small() };
    let built = floor(lambertian(COLOR));
    let (position, intensity) = (Vec3::new(0.4, 1.5, 0.2), Vec3::new(10.0, 20.0, 30.0));
    let result = trace(&built, &rig([omni(position, intensity, 0.5)]), &settings);
    let points = floor_points(&built, &settings);
    // the sphere is wholly above the horizon, so that it gives what its centre gives
    let expected = |i: usize| {
        let distance2 = position.distance_squared(points[i]);
        COLOR / std::f32::consts::PI * intensity * position.y / distance2.powf(1.5)
    };
    let error = worst(&result.layers.direct, expected);
    assert!(error < 0.01, "{error}");
}

#[test]
fn glossy_plane_answers_by_its_bsdf() {
    let settings = Settings { spp: 2, ..small() };
    let material =
        Material { roughness: 0.3, metallic: 0.3, base_color: COLOR.extend(1.0), ..Material::default() };
    let built = floor(material);
    let (position, intensity) = (Vec3::new(0.0, 1.5, -2.0), Vec3::splat(10.0));
    let points = floor_points(&built, &settings);
    let camera = &built.scene.cameras[0];
    let expected = |i: usize| {
        let to_light = position - points[i];
        let view = (camera.position() - points[i]).normalize();
        let ray = Ray::new(camera.position(), -view);
        let surface = surface_at(&built.scene, &built.geometry, &built.accel.closest(&ray), -view);
        let light = to_light.normalize();
        let brdf = surface.diffuse(view.y) / std::f32::consts::PI + surface.specular(view, light);
        brdf * intensity * light.y / to_light.length_squared()
    };
    for paths in [Paths::All, Paths::Transfer, Paths::DiffuseTransfer] {
        let result =
            trace(&built, &rig([omni(position, intensity, 0.0)]), &Settings { paths, ..settings.clone() });
        let error = worst(&result.layers.direct, expected);
        assert!(error < 2e-3, "{error} with {paths:?}");
    }
}

/// In a closed room of albedo `p` where every surface emits `E`, bounce `k` brings `E p^(k + 1)` and all together
/// `E / (1 - p)`.
#[test]
fn furnace() {
    let (albedo, emission) = (Vec3::new(0.7, 0.5, 0.2), Vec3::new(1.0, 2.0, 3.0));
    let built = room(emissive(albedo, emission), emissive(albedo, emission), None);
    for paths in [Paths::All, Paths::Transfer, Paths::DiffuseTransfer] {
        let settings = Settings { spp: 512, per_bounce: true, paths, ..small() };
        let result = trace(&built, &LightRig::default(), &settings);
        let full = mean(&result.layers.full());
        let expected = (emission / (Vec3::ONE - albedo)).as_dvec3();
        assert!((full / expected - 1.0).abs().max_element() < 0.004, "{full} is not {expected}");
        let wrong = (emission / (Vec3::ONE - 1.02 * albedo)).as_dvec3();
        assert!((full / wrong - 1.0).abs().max_element() > 0.004, "two percent of albedo must be noticed");
        let direct = mean(&result.layers.direct) / (emission + emission * albedo).as_dvec3();
        assert!((direct - 1.0).abs().max_element() < 0.004);
        for (k, image) in result.indirect_by_bounce.iter().take(4).enumerate() {
            let expected = (emission * albedo.powf(k as f32 + 2.0)).as_dvec3();
            let ratio = mean(image) / expected;
            assert!((ratio - 1.0).abs().max_element() < 0.01, "bounce {}: {ratio}", k + 1);
        }
    }
}

/// With glossy surfaces the transfer's paths have a closed form too: `E + (k_d + k_g) E / (1 - R)`, without `k_g` where reflections are
/// left out.
#[test]
fn furnace_of_the_transfer_is_known_for_glossy_surfaces() {
    let emission = Vec3::new(1.0, 2.0, 3.0);
    let material = Material { emission, specular: 1.0, roughness: 0.4, metallic: 0.2, ..lambertian(COLOR) };
    let built = room(material.clone(), material, None);
    let camera = &built.scene.cameras[0];
    let expected = |i: usize, glossy: bool| {
        let (x, y) = ((i % 16) as f32 + 0.5, (i / 16) as f32 + 0.5);
        let ray = Ray::new(camera.position(), camera.direction(x, y, 16, 12));
        let surface = surface_at(&built.scene, &built.geometry, &built.accel.closest(&ray), ray.direction);
        let cos = -ray.direction.dot(surface.shading_normal);
        let specular = if glossy { surface.specular_albedo(cos) } else { Vec3::ZERO };
        let reflected = surface.diffuse(cos) + specular;
        emission + reflected * emission / (Vec3::ONE - surface.hemispherical_reflectance())
    };
    for (paths, glossy) in [(Paths::Transfer, true), (Paths::DiffuseTransfer, false)] {
        let settings = Settings { spp: 512, paths, ..small() };
        let result = trace(&built, &LightRig::default(), &settings);
        let full = result.layers.full();
        let image =
            |glossy| Image { pixels: (0..192).map(|i| expected(i, glossy)).collect(), ..full.clone() };
        let (right, wrong) = (image(glossy), image(!glossy));
        let error = relative_l2(&full, &right);
        let allowed = 1.5 * result.noise.full;
        assert!(result.noise.full < 0.02 && error < allowed, "{paths:?}: {error} {:?}", result.noise);
        let ratio = mean(&full) / mean(&right);
        assert!((ratio - 1.0).abs().max_element() < 0.004, "{paths:?}: {ratio}");
        assert!(relative_l2(&full, &wrong) > 0.025, "{paths:?} must be told from the other truth");
        let all = trace(&built, &LightRig::default(), &Settings { paths: Paths::All, ..settings });
        println!("{paths:?}: {error}, {ratio}, all paths {}", relative_l2(&all.layers.full(), &right));
    }
}

/// An emissive disc of radius `a` at height `h` over a parallel receiver: at the point below its centre the form
/// factor is `a^2 / (a^2 + h^2)`.
#[test]
fn parallel_discs_have_their_form_factor() {
    let (radius, height, radiance) = (0.5_f32, 1.0, Vec3::new(4.0, 5.0, 6.0));
    let mut builder = SceneBuilder::new();
    let receiver = builder.material(lambertian(COLOR));
    let emitter = builder.material(emissive(Vec3::ZERO, radiance));
    builder
        .disc(Vec3::ZERO, Vec3::Y, 0.5, 64, receiver)
        .disc(Vec3::Y * height, Vec3::NEG_Y, radius, 512, emitter)
        .camera(Vec3::new(3.0, 0.7, 0.0), Vec3::ZERO, 0.05);
    let built = builder.build();
    let factor = |height: f32| radius * radius / (radius * radius + height * height);
    for paths in [Paths::All, Paths::Transfer, Paths::DiffuseTransfer] {
        let settings = Settings { width: 4, height: 4, spp: 1024, paths, ..small() };
        let result = trace(&built, &LightRig::default(), &settings);
        let error = |factor: f32| worst(&result.layers.direct, |_| COLOR * radiance * factor);
        assert!(error(factor(height)) < 0.01, "{}", error(factor(height)));
        assert!(error(factor(1.02 * height)) > 0.01, "two percent of height must be noticed");
        assert_eq!(mean(&result.layers.indirect), DVec3::ZERO, "the emitter reflects nothing");
    }
}

#[test]
fn aa_changes_nothing_without_edges() {
    let built = floor(lambertian(COLOR));
    let sun =
        LightKind::Distant { direction: Vec3::new(1.0, -2.0, 0.5), irradiance: Vec3::splat(5.0), angle: 0.0 };
    let sun = rig([sun]);
    let one = trace(&built, &sun, &Settings { spp: 2, aa: 1, ..small() });
    let two = trace(&built, &sun, &Settings { spp: 8, aa: 2, ..small() });
    assert_eq!(one.layers.direct, two.layers.direct);
    assert!(mean(&one.layers.direct).x > 0.1);
    // with edges it does change
    let built = room(lambertian(COLOR), lambertian(Vec3::ONE), None);
    let one = trace(&built, &room_lights(), &Settings { spp: 2, aa: 1, ..small() });
    let two = trace(&built, &room_lights(), &Settings { spp: 8, aa: 2, ..small() });
    assert_ne!(one.layers.direct, two.layers.direct);
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let built = room(grey(), lambertian(COLOR), Some(Vec3::splat(3.0)));
    let settings = Settings { spp: 8, aa: 2, per_bounce: true, per_light: true, ..small() };
    let in_pool = |threads, settings: &Settings| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        let result = pool.install(|| trace(&built, &room_lights(), settings));
        format!("{result:?}")
    };
    let one = in_pool(1, &settings);
    assert!(one == in_pool(2, &settings) && one == in_pool(5, &settings));
    assert!(one != in_pool(1, &Settings { seed: 1, ..settings }), "another seed, other noise");
}

#[test]
fn noise_falls_with_samples_and_is_honest() {
    let built = room(grey(), lambertian(COLOR), None);
    let at = |spp, seed| trace(&built, &room_lights(), &Settings { spp, seed, ..small() });
    let (few, many, truth) = (at(32, 0), at(128, 1), at(8192, 2));
    let ratio = many.noise.indirect / few.noise.indirect;
    // random sampling halves it; the low-discrepancy sequence may do better
    assert!((0.2..0.65).contains(&ratio), "{ratio}");
    for result in [&few, &many] {
        let error = relative_l2(&result.layers.indirect, &truth.layers.indirect);
        let honesty = error / result.noise.indirect;
        assert!((0.7..1.4).contains(&honesty), "error {error}, estimate {}", result.noise.indirect);
    }
    assert!(truth.noise.full < few.noise.full && few.noise.full < few.noise.indirect);
}

#[test]
fn bounces_and_lights_sum_to_the_layers() {
    let built = room(Material { roughness: 0.3, ..grey() }, lambertian(COLOR), None);
    let settings = Settings { bounces: Some(3), per_bounce: true, per_light: true, aa: 2, ..small() };
    let result = trace(&built, &room_lights(), &settings);
    assert_eq!((result.indirect_by_bounce.len(), result.layers.per_light.len()), (3, 3));
    let sum = |images: Vec<&Image>| {
        let mut sum = Image::new(16, 12);
        for image in images {
            sum.pixels.iter_mut().zip(&image.pixels).for_each(|(sum, pixel)| *sum += *pixel);
        }
        sum
    };
    let layers = &result.layers;
    let bounces = sum(result.indirect_by_bounce.iter().collect());
    assert!(relative_l2(&bounces, &layers.indirect) < 1e-6);
    let direct = sum(layers.per_light.iter().map(|light| &light.direct).collect());
    assert!(relative_l2(&direct, &layers.direct) < 1e-6);
    let indirect = sum(layers.per_light.iter().map(|light| &light.indirect).collect());
    assert!(relative_l2(&indirect, &layers.indirect) < 1e-6);
    let halves = sum(result.halves.iter().map(|half| &half.indirect).collect());
    assert!((relative_l2(&halves, &layers.indirect) - 1.0).abs() < 1e-6, "twice the mean");
    let two = sum(result.indirect_by_bounce.iter().take(2).collect());
    assert!(relative_l2(&two, &layers.indirect) > 0.01, "the third bounce must be noticed");
    // fewer bounces are the same paths, ended earlier
    let fewer = trace(&built, &room_lights(), &Settings { bounces: Some(2), ..settings.clone() });
    assert!(relative_l2(&fewer.layers.indirect, &two) < 1e-6);
    let none = trace(&built, &room_lights(), &Settings { bounces: Some(0), ..settings });
    assert_eq!(none.layers.direct, layers.direct);
    assert_eq!(mean(&none.layers.indirect), DVec3::ZERO);
}

#[test]
fn roulette_keeps_the_mean() {
    let built = room(lambertian(Vec3::splat(0.6)), lambertian(COLOR), None);
    let settings = Settings { spp: 1024, per_bounce: true, ..small() };
    let result = trace(&built, &room_lights(), &settings);
    // the roulette begins at the third vertex: its bounces must go on as geometric as those before it
    let bounces: Vec<f64> = result.indirect_by_bounce.iter().map(|image| mean(image).x).collect();
    let early = bounces[2] / bounces[1];
    let late = bounces[7] / bounces[6];
    assert!((early - late).abs() < 0.02, "{early} {late}");
}

#[test]
fn all_and_transfer_paths_agree_on_diffuse_scenes_only() {
    let settings = Settings { spp: 1024, ..small() };
    for lamp in [None, Some(Vec3::splat(5.0))] {
        let built = room(lambertian(Vec3::new(0.7, 0.6, 0.5)), lambertian(COLOR), lamp);
        let all = trace(&built, &room_lights(), &settings);
        for paths in [Paths::Transfer, Paths::DiffuseTransfer] {
            let transfer = trace(&built, &room_lights(), &Settings { paths, seed: 9, ..settings.clone() });
            let allowed = 1.5 * all.noise.full.hypot(transfer.noise.full);
            // smooth normals on a coarse ball: geometric and shading cosines differ a little
            let difference = relative_l2(&transfer.layers.full(), &all.layers.full());
            assert!(difference < allowed.max(0.01), "{paths:?}: {difference}, noise {allowed}");
        }
    }
    let metal = Material { metallic: 1.0, roughness: 0.3, ..Material::default() };
    let built = room(metal.clone(), metal, None);
    let all = trace(&built, &room_lights(), &settings);
    let transfer =
        trace(&built, &room_lights(), &Settings { paths: Paths::DiffuseTransfer, ..settings.clone() });
    assert_eq!(all.layers.direct, transfer.layers.direct);
    assert!(relative_l2(&transfer.layers.indirect, &all.layers.indirect) > 0.3);
    let glossy = trace(&built, &room_lights(), &Settings { paths: Paths::Transfer, ..settings });
    let nearer = relative_l2(&glossy.layers.indirect, &all.layers.indirect);
    assert!(nearer < relative_l2(&transfer.layers.indirect, &all.layers.indirect));
}

/// Light inside a closed one-sided box whose front is inside does not get out, and the back is black.
#[test]
fn backs_of_one_sided_surfaces_are_black_and_block() {
    let mut builder = SceneBuilder::new();
    let material = builder.material(emissive(Vec3::ONE, Vec3::ONE));
    builder.room(Vec3::splat(-1.0), Vec3::splat(1.0), material).camera(
        Vec3::new(0.0, 1.0, 5.0),
        Vec3::ZERO,
        20.0,
    );
    let built = builder.build();
    let lights = rig([omni(Vec3::new(0.0, 3.0, 4.0), Vec3::ONE, 0.0), omni(Vec3::ZERO, Vec3::ONE, 0.2)]);
    let result = trace(&built, &lights, &small());
    assert_eq!(mean(&result.layers.full()), DVec3::ZERO);
}

#[test]
fn disabled_lights_do_nothing() {
    let built = room(grey(), lambertian(COLOR), None);
    let mut lights = room_lights();
    let settings = Settings { spp: 8, per_light: true, ..small() };
    lights.lights[1].enabled = false;
    let without = trace(&built, &lights, &settings);
    lights.lights.remove(1);
    assert_eq!(without.layers.full(), trace(&built, &lights, &settings).layers.full());
    let names: Vec<_> = without.layers.per_light.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["light 0", "light 2"]);
}

struct StopAfter(AtomicU32);

impl Progress for StopAfter {
    fn cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) > 3
    }
}

#[test]
fn bad_settings_and_cancelling_are_errors() {
    let built = floor(lambertian(COLOR));
    let run = |settings: Settings, progress: &dyn Progress| {
        render(&built.scene, &built.geometry, &built.accel, &LightRig::default(), &settings, progress)
    };
    for settings in [
        Settings { width: 0, ..small() },
        Settings { height: 1 << 20, ..small() },
        Settings { aa: 3, ..small() },
        Settings { spp: 0, ..small() },
        Settings { camera: 1, ..small() },
    ] {
        assert!(matches!(run(settings, &()), Err(Error::Setting(_))));
    }
    assert!(matches!(run(small(), &StopAfter(AtomicU32::new(0))), Err(Error::Cancelled)));
    let mut empty = SceneBuilder::new();
    empty.camera(Vec3::ZERO, Vec3::X, 40.0);
    let empty = empty.build();
    let result = trace(&empty, &room_lights(), &small());
    assert_eq!((mean(&result.layers.full()), result.noise.full), (DVec3::ZERO, 0.0));
}

/// Passes add up to what one long render gives, and tell their own noise.
#[test]
fn a_frame_that_is_refined_comes_to_the_same_as_a_long_one() {
    let built = room(lambertian(COLOR), lambertian(Vec3::splat(0.6)), None);
    let rig = rig([omni(Vec3::new(0.5, 1.6, 0.8), Vec3::splat(3.0), 0.0)]);
    let first = Settings { spp: 8, ..small() };
    let mut progressive = Progressive::new(first.clone());
    let refine = |progressive: &mut Progressive| {
        let refined = progressive.refine(&built.scene, &built.geometry, &built.accel, &rig, &());
        refined.expect("valid settings").clone()
    };
    let pass = refine(&mut progressive);
    assert!(
        pass.layers.full() == trace(&built, &rig, &first).layers.full(),
        "the first pass is the render itself"
    );
    let mut noises = vec![pass.noise.full];
    let mut refined = pass;
    for paths in [16, 32, 64, 128, 256, 512] {
        refined = refine(&mut progressive);
        assert_eq!(progressive.paths(), paths);
        noises.push(refined.noise.full);
    }
    assert!(noises[6] < 0.3 * noises[0], "{noises:?}");
    let long = trace(&built, &rig, &Settings { spp: 4096, seed: 77, ..small() });
    let off = relative_l2(&refined.layers.full(), &long.layers.full());
    assert!(off < 2.0 * noises[6], "off by {off} at a noise of {}", noises[6]);
    let halves = mean(&refined.halves[0].full()) + mean(&refined.halves[1].full());
    assert!((0.5 * halves).distance(mean(&refined.layers.full())) < 1e-5);
    assert!(refined.layers.noise.is_some());
}
