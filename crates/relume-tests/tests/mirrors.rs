//! What the camera sees in mirrors and through glass: the relighter and the path tracer, each against closed forms, and against each other.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

use relume::glam::{Vec3, Vec4};
use relume::image::Image;
use relume::relight::{Only, RelightSettings};
use relume::sample::Receivers;
use relume::scene::{EnvironmentMap, Geometry, Interior, Material};
use relume::trace::Accel;
use relume::transfer::{Quality, Settings};
use relume::{LightKind, LightRig, Transfer};
use relume_tests::prepared::{prepare, relight_afresh, tiny};
use relume_tests::scenes::{SceneBuilder, TestScene, emissive, lambertian, omni, rig};
use relume_tests::truth::{Truths, trace, trace_bounces, unbiased_relative_l2};

const SIZE: (usize, usize) = (32, 24);
const TINT: Vec3 = Vec3::new(0.9, 0.7, 0.5);

/// A polished metal.
fn mirror() -> Material {
    Material { base_color: TINT.extend(1.0), metallic: 1.0, roughness: 0.0, ..Material::default() }
}

fn glass(interior: Interior, tint: Vec3) -> Material {
    Material {
        base_color: tint.extend(1.0),
        roughness: 0.0,
        transmission: 1.0,
        interior,
        double_sided: interior == Interior::Thin,
        ..Material::default()
    }
}

fn schlick(f0: Vec3, cos: f32) -> Vec3 {
    f0 + (Vec3::ONE - f0) * (1.0 - cos).powi(5)
}

/// The direct layer, one sample a pixel: relit, and path-traced.
fn direct(built: &TestScene, lights: &LightRig) -> (Arc<Transfer>, [Image; 2]) {
    let transfer = Arc::new(prepare(built, Settings { size: SIZE, ..tiny() }));
    let settings = RelightSettings { aa: 1, bounces: Some(0), ..RelightSettings::default() };
    let relit = relight_afresh(&transfer, lights, &settings).direct;
    (transfer, [relit, trace(built, lights, SIZE, 1, 64).direct.mean()])
}

/// Pixels where both images differ from what is expected by more than this part of it, with what they show.
fn off(images: &[Image; 2], expected: impl Fn(usize) -> Vec3, part: f32) -> Vec<(usize, [Vec3; 2], Vec3)> {
    let wrong = |pixel: &usize| {
        let expected = expected(*pixel);
        images.iter().any(|image| (image.pixels[*pixel] - expected).length() > part * expected.length())
    };
    let pixels = (0..images[0].pixels.len()).filter(wrong);
    pixels.map(|pixel| (pixel, images.each_ref().map(|image| image.pixels[pixel]), expected(pixel))).collect()
}

/// The unit direction of the ray through a pixel's centre.
fn ray(built: &TestScene, pixel: usize) -> Vec3 {
    let (x, y) = ((pixel % SIZE.0) as f32 + 0.5, (pixel / SIZE.0) as f32 + 0.5);
    built.scene.cameras[0].direction(x, y, SIZE.0, SIZE.1)
}

/// A white ceiling at a height of 4, which alone can be seen in whatever lies below it, from a camera at a height of 1 that looks down.
fn under_a_ceiling() -> SceneBuilder {
    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    builder.quad(Vec3::new(-50.0, 4.0, -50.0), Vec3::X * 100.0, Vec3::Z * 100.0, white).camera(
        Vec3::new(0.0, 1.0, 0.0),
        Vec3::new(0.3, 0.0, -1.2),
        50.0,
    );
    builder
}

/// Radiance of the ceiling at a point, under a lamp.
fn ceiling(point: Vec3, lamp: Vec3, intensity: f32) -> Vec3 {
    let away = point - lamp;
    Vec3::splat(0.8 / PI * intensity * away.y / away.length().powi(3))
}

#[test]
fn a_mirror_shows_the_light_of_what_it_mirrors() {
    let mut builder = under_a_ceiling();
    let material = builder.material(mirror());
    builder.quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material);
    let built = builder.build();
    let lamp = Vec3::new(0.0, 2.0, 6.0);
    let (transfer, images) = direct(&built, &rig([omni(lamp, Vec3::splat(30.0), 0.0)]));
    let expected = |pixel| {
        let view = ray(&built, pixel);
        let met = Vec3::Y + view * (-1.0 / view.y);
        let mirrored = view * Vec3::new(1.0, -1.0, 1.0);
        schlick(TINT, -view.y) * ceiling(met + mirrored * (4.0 / mirrored.y), lamp, 30.0)
    };
    let wrong = off(&images, expected, 2e-3);
    assert!(wrong.is_empty(), "{} pixels, as {:?}", wrong.len(), wrong[0]);
    // the mirror itself gathers nothing, and its view samples are on the ceiling, as far away as they look
    assert!(transfer.receivers_of_centers.iter().all(|&row| row == Receivers::NONE));
    for branch in &transfer.view.center_chains.branches {
        let view = ray(&built, branch.owner as usize);
        assert!((branch.sample.position.y - 4.0).abs() < 1e-4);
        assert!((branch.sample.depth + 5.0 / view.y).abs() < 1e-3);
        assert!((branch.view() - -view * Vec3::new(1.0, -1.0, 1.0)).length() < 1e-4);
    }
}

#[test]
fn a_pane_dims_what_is_behind_it_and_casts_no_shadow() {
    let tint = Vec3::new(0.9, 0.8, 0.6);
    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    let pane = builder.material(glass(Interior::Thin, tint));
    builder
        .quad(Vec3::new(-20.0, -20.0, -3.0), Vec3::X * 40.0, Vec3::Y * 40.0, white)
        .quad(Vec3::new(-9.0, -9.0, -1.0), Vec3::X * 18.0, Vec3::Y * 18.0, pane)
        .camera(Vec3::ZERO, Vec3::new(0.4, 0.1, -1.0), 60.0);
    let built = builder.build();
    assert_eq!((built.geometry.clear, built.geometry.triangles.len()), (2, 4));
    let lamp = Vec3::new(0.5, 2.0, 1.0);
    let (transfer, images) = direct(&built, &rig([omni(lamp, Vec3::splat(10.0), 0.0)]));
    let expected = |pixel| {
        let view = ray(&built, pixel);
        let to_lamp = lamp - view * (-3.0 / view.z);
        let radiance = 0.8 / PI * 10.0 * to_lamp.z / to_lamp.length().powi(3);
        tint * (1.0 - schlick(Vec3::splat(0.04), -view.z).x) * radiance
    };
    // the lamp, behind the camera, is mirrored in a few pixels
    let wrong = off(&images, expected, 2e-3);
    assert!(wrong.len() < 6, "{} pixels, as {:?}", wrong.len(), wrong[0]);
    assert_eq!(transfer.occluders.triangles.len(), 2, "glass is no occluder");
}

/// A slab shifts what is behind it by Snell's law, and darkens it by its thickness.
#[test]
fn a_slab_of_glass_bends_and_absorbs() {
    let extinction = Vec3::new(0.1, 0.4, 1.0);
    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    let slab = builder.material(glass(Interior::Solid { extinction }, Vec3::ONE));
    let wide = |z: f32| Vec3::new(-30.0, -30.0, z);
    builder
        .quad(wide(-3.0), Vec3::X * 60.0, Vec3::Y * 60.0, white)
        .quad(wide(-1.0), Vec3::X * 60.0, Vec3::Y * 60.0, slab)
        .quad(wide(-1.5), Vec3::Y * 60.0, Vec3::X * 60.0, slab)
        .camera(Vec3::ZERO, Vec3::new(0.4, 0.1, -1.0), 50.0);
    let built = builder.build();
    let lamp = Vec3::new(3.0, 2.0, 4.0);
    let (transfer, images) = direct(&built, &rig([omni(lamp, Vec3::splat(50.0), 0.0)]));
    // where the view meets the wall, and what is left of its light
    let behind = |pixel| {
        let view = ray(&built, pixel);
        let (cos, sin) = (-view.z, (1.0 - view.z * view.z).sqrt());
        let cos_within = (1.0 - (sin / 1.5).powi(2)).sqrt();
        let aside = (view.truncate() / sin).extend(0.0);
        let across = 2.5 * sin / cos + 0.5 * (sin / 1.5) / cos_within;
        let passes = 1.0 - schlick(Vec3::splat(0.04), cos).x;
        let left = passes * passes * (extinction * (-0.5 / cos_within)).exp();
        (aside * across - Vec3::Z * 3.0, left)
    };
    let expected = |pixel| {
        let (point, left) = behind(pixel);
        let to_lamp = lamp - point;
        left * (0.8 / PI * 50.0 * to_lamp.z / to_lamp.length().powi(3))
    };
    // reflections within the slab, of which the relighter leaves out the faintest, and the mirrored lamp in a few pixels
    let wrong = off(&images, expected, 0.012);
    assert!(wrong.len() < 8, "{} pixels, as {:?}", wrong.len(), wrong[0]);
    let mut found = 0;
    for branch in transfer.view.center_chains.branches.iter().filter(|b| b.sample.position.z < -2.9) {
        let (point, left) = behind(branch.owner as usize);
        if (branch.throughput.get() - left).length() < 1e-3 {
            assert!((branch.sample.position - point).length() < 2e-3, "{}", branch.sample.position);
            found += 1;
        }
    }
    assert_eq!(found, SIZE.0 * SIZE.1);
}

/// Domes show in mirrors as sharp as they are; so do lights with extent, as bright as they are.
#[test]
fn mirrors_show_the_sky_and_lights_themselves() {
    let mut builder = SceneBuilder::new();
    let material = builder.material(mirror());
    let white = builder.material(lambertian(Vec3::splat(0.5)));
    builder
        .quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material)
        .block(Vec3::new(0.2, 0.0, 3.0), Vec3::new(1.0, 0.1, 4.0), white)
        .camera(Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, -1.2), 50.0);
    let built = builder.build();
    let mirrored = |pixel| ray(&built, pixel) * Vec3::new(1.0, -1.0, 1.0);
    let texels: Vec<Vec3> = (0..512).map(|i| Vec3::new(1.0, (i % 7) as f32, (i / 32) as f32 * 0.1)).collect();
    let map = Arc::new(EnvironmentMap::new("test", 32, 16, texels).unwrap());
    for map in [None, Some(map)] {
        let dome = LightKind::Dome { map: map.clone(), intensity: Vec3::new(1.0, 2.0, 3.0), rotation: 40.0 };
        let (_, images) = direct(&built, &rig([dome]));
        let dome = relume::shade::Dome::new(map, Vec3::new(1.0, 2.0, 3.0), 40.0);
        let expected = |pixel| schlick(TINT, mirrored(pixel).y) * dome.radiance(mirrored(pixel));
        let wrong = off(&images, expected, 2e-3);
        assert!(wrong.is_empty(), "{} pixels, as {:?}", wrong.len(), wrong[0]);
    }
    // a ball of light over the mirror, 1.6 degrees across where it is seen, in the middle of the picture
    let middle = ray(&built, 12 * SIZE.0 + 16) * Vec3::new(1.0, -1.0, 1.0);
    let (at, radius) = (middle * 5.0 - Vec3::Y, 0.35);
    let (_, images) = direct(&built, &rig([omni(at, Vec3::splat(2.0), radius)]));
    for image in &images {
        let shown = image.pixels[12 * SIZE.0 + 16];
        let expected = schlick(TINT, middle.y) * (2.0 / (PI * radius * radius));
        assert!((shown - expected).length() < 2e-3 * expected.length(), "{shown} instead of {expected}");
    }
    // a point, 5 metres away by way of the mirror, is spread over some pixels and loses nothing
    let (_, images) = direct(&built, &rig([omni(at, Vec3::splat(2.0), 0.0)]));
    let pixel = built.scene.cameras[0].pixel_angle(SIZE.0, SIZE.1);
    for image in &images {
        let sum: Vec3 = image.pixels.iter().copied().sum::<Vec3>() * (pixel * pixel);
        let expected = schlick(TINT, middle.y) * (2.0 / 25.0);
        assert!((sum / expected - 1.0).abs().max_element() < 0.1, "{sum} instead of {expected}");
    }
}

/// A ball of 20 cm that mirrors all it meets, four metres from the camera, and something to gather light from.
fn chrome_ball() -> TestScene {
    let mut builder = SceneBuilder::new();
    let chrome = builder.material(Material { base_color: Vec4::ONE, ..mirror() });
    let white = builder.material(lambertian(Vec3::splat(0.5)));
    builder
        .sphere(Vec3::new(0.0, 1.0, 0.0), 0.2, 48, false, chrome)
        .quad(Vec3::new(3.0, -0.5, -8.0), Vec3::Z, Vec3::X, white)
        .camera(Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 1.0, 0.0), 12.0);
    builder.build()
}

/// A ball that mirrors all it meets sends what falls on it evenly to all sides, and so does its picture, wherever the lamp stands: no sparkle
/// gets lost between two pixels.
#[test]
fn a_lamp_in_a_chrome_ball_keeps_its_light() {
    let built = chrome_ball();
    let transfer = Arc::new(prepare(&built, Settings { size: (48, 36), ..tiny() }));
    let settings = RelightSettings { bounces: Some(0), ..RelightSettings::default() };
    let pixel = built.scene.cameras[0].pixel_angle(48, 36);
    // intensity R^2 / 4 of the irradiance, 4 m away
    let expected = 0.2 * 0.2 / 4.0 / 16.0;
    let shown = |direction: Vec3| {
        let sun = LightKind::Distant { direction, irradiance: Vec3::ONE, angle: 0.0 };
        let image = relight_afresh(&transfer, &rig([sun]), &settings).direct;
        image.pixels.iter().map(|pixel| pixel.x).sum::<f32>() * pixel * pixel / expected
    };
    let brightness: Vec<f32> =
        (0..24).map(|step| shown(Vec3::new(0.4 + 0.013 * step as f32, -0.5, -0.7).normalize())).collect();
    println!("{brightness:.2?}");
    for pair in brightness.windows(2) {
        assert!((pair[0] - 1.0).abs() < 0.3, "{} of the light", pair[0]);
        assert!((pair[1] - pair[0]).abs() < 0.2, "a step of less than a degree: {pair:?}");
    }
}

/// A lamp that sinks into a wall goes down bit by bit in the mirror too.
#[test]
fn a_sinking_lamp_does_not_vanish_at_once() {
    let mut builder = under_a_ceiling();
    let material = builder.material(mirror());
    builder.quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material);
    let transfer = Arc::new(prepare(&builder.build(), Settings { size: SIZE, ..tiny() }));
    let settings = RelightSettings { bounces: Some(0), ..RelightSettings::default() };
    let shown = |height: f32| {
        let lamp = omni(Vec3::new(0.3, height, -2.4), Vec3::ONE, 0.4);
        let image = relight_afresh(&transfer, &rig([lamp]), &settings).direct;
        image.pixels.iter().map(|pixel| pixel.x).sum::<f32>()
    };
    let steps: Vec<f32> = (0..=20).map(|step| shown(3.5 + 0.05 * step as f32)).collect();
    println!("{steps:.1?}");
    assert!(steps[0] > 10.0 && steps[20] < 1e-3);
    for pair in steps.windows(2) {
        assert!((pair[1] - pair[0]).abs() < 0.2 * steps[0], "{pair:?} of {}", steps[0]);
    }
}

/// A ball of glass turns what is behind it upside down: a ray that passes its middle at a distance `b` is turned by
/// `2 (asin(b / r) - asin(b / (n r)))`, and passes it at that distance still.
#[test]
fn a_ball_lens_turns_views_as_it_should() {
    let (radius, ior) = (0.5, 1.5);
    let mut builder = SceneBuilder::new();
    let glass = builder.material(glass(Interior::Solid { extinction: Vec3::ZERO }, Vec3::ONE));
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    builder
        .sphere(Vec3::ZERO, radius, 96, false, glass)
        .quad(Vec3::new(-30.0, -30.0, -6.0), Vec3::X * 60.0, Vec3::Y * 60.0, white)
        .camera(Vec3::new(0.0, 0.0, 40.0), Vec3::ZERO, 0.5);
    let transfer = prepare(&builder.build(), Settings { size: SIZE, ..tiny() });
    // how far from the axis a view meets the wall, after it started at this angle from it
    let met_at = |angle: f32| {
        let apart = 40.0 * angle.sin();
        let left = angle - 2.0 * ((apart / radius).asin() - (apart / (ior * radius)).asin());
        let (sin, cos) = left.sin_cos();
        apart * cos + (6.0 + apart * sin) / cos * sin
    };
    let mut found = 0;
    for branch in &transfer.view.center_chains.branches {
        // straight through, twice a surface of normal incidence
        if branch.sample.position.z > -5.9 || (branch.throughput.get().x - 0.96 * 0.96).abs() > 0.01 {
            continue;
        }
        let aside = transfer.view.centers[branch.owner as usize].position - Vec3::Z * 40.0;
        let angle = aside.truncate().length().atan2(-aside.z);
        let expected = aside.truncate().normalize() * met_at(angle);
        let met = branch.sample.position.truncate();
        // its faces are flat
        assert!((met - expected).length() < 0.02 * expected.length() + 0.01, "{met} instead of {expected}");
        found += 1;
    }
    assert!(found > 500, "{found}");
}

/// Half a pane scatters half of the light that does not pass; a frosted one passes it all the same.
#[test]
fn panes_may_transmit_in_part() {
    let scene = |material: Material| {
        let mut builder = SceneBuilder::new();
        let shines = builder.material(emissive(Vec3::ZERO, Vec3::ONE));
        let pane = builder.material(material);
        builder
            .quad(Vec3::new(-20.0, -20.0, -3.0), Vec3::X * 40.0, Vec3::Y * 40.0, shines)
            .quad(Vec3::new(-9.0, -9.0, -1.0), Vec3::X * 18.0, Vec3::Y * 18.0, pane)
            .camera(Vec3::ZERO, Vec3::new(0.1, 0.1, -1.0), 40.0);
        builder.build()
    };
    let fresnel = |built: &TestScene, pixel| schlick(Vec3::splat(0.04), -ray(built, pixel).z).x;
    for (transmission, roughness) in [(0.3, 0.0), (1.0, 0.4)] {
        let pane = Material { transmission, roughness, ..glass(Interior::Thin, Vec3::splat(0.8)) };
        let built = scene(pane);
        assert_eq!(built.geometry.clear, if transmission < 0.5 { 0 } else { 2 });
        let (_, images) = direct(&built, &LightRig::default());
        let expected = |pixel| Vec3::splat(0.8 * transmission * (1.0 - fresnel(&built, pixel)));
        // what the shining wall brings the pane's other side does not reach the camera's
        let wrong = off(&images, expected, 5e-3);
        assert!(wrong.is_empty(), "{} pixels, as {:?}", wrong.len(), wrong[0]);
    }
}

/// What shines is seen shining in a mirror, and dims with its emitter.
#[test]
fn emitters_shine_in_mirrors() {
    let mut builder = SceneBuilder::new();
    let material = builder.material(mirror());
    let shines =
        builder.material(Material { name: "lamp".into(), ..emissive(Vec3::ZERO, Vec3::new(3.0, 2.0, 1.0)) });
    builder
        .quad(Vec3::new(-50.0, 4.0, -50.0), Vec3::X * 100.0, Vec3::Z * 100.0, shines)
        .quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material)
        .camera(Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.3, 0.0, -1.2), 50.0);
    let built = builder.build();
    for scale in [1.0, 0.25] {
        let mut lights = LightRig::default();
        lights.emitters.push(relume::scene::Emitter { material: "lamp".into(), scale: Vec3::splat(scale) });
        let (_, images) = direct(&built, &lights);
        let expected = |pixel| schlick(TINT, -ray(&built, pixel).y) * Vec3::new(3.0, 2.0, 1.0) * scale;
        let wrong = off(&images, expected, 2e-3);
        assert!(wrong.is_empty(), "{} pixels, as {:?}", wrong.len(), wrong[0]);
    }
}

/// Views end: after so many mirrors, and behind glass that parts them again and again.
#[test]
fn views_are_followed_so_far_and_no_farther() {
    let mut builder = SceneBuilder::new();
    let silver = builder.material(Material { base_color: Vec4::ONE, ..mirror() });
    let white = builder.material(lambertian(Vec3::splat(0.5)));
    // two mirrors that face each other
    builder
        .quad(Vec3::new(-9.0, -9.0, -2.0), Vec3::X * 18.0, Vec3::Y * 18.0, silver)
        .quad(Vec3::new(-9.0, -9.0, 2.0), Vec3::Y * 18.0, Vec3::X * 18.0, silver)
        .block(Vec3::new(5.0, -9.0, -1.0), Vec3::new(6.0, 9.0, 1.0), white)
        .camera(Vec3::ZERO, Vec3::new(0.01, 0.01, -1.0), 20.0);
    let transfer = prepare(&builder.build(), Settings { size: SIZE, ..tiny() });
    let most = |transfer: &Transfer| {
        let chains = &transfer.view.center_chains;
        (0..transfer.view.pixels()).map(|pixel| chains.of_owner(pixel).len()).max().unwrap()
    };
    assert_eq!(most(&transfer), 8, "events");
    let longest =
        transfer.view.center_chains.branches.iter().map(|branch| branch.sample.depth).fold(0.0, f32::max);
    // 2 metres to the first, then 4 each; at the corners 1.04 times as far
    assert!((34.0..35.6).contains(&longest), "{longest} metres");

    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    let dense = Material { ior: 4.0, ..glass(Interior::Thin, Vec3::ONE) };
    let dense = builder.material(dense);
    for pane in 0..6 {
        let corner = Vec3::new(-9.0, -9.0, -1.0 - 0.1 * pane as f32);
        builder.quad(corner, Vec3::X * 18.0, Vec3::Y * 18.0, dense);
    }
    builder.quad(Vec3::new(-20.0, -20.0, -3.0), Vec3::X * 40.0, Vec3::Y * 40.0, white).camera(
        Vec3::ZERO,
        Vec3::new(0.3, 0.1, -1.0),
        40.0,
    );
    let transfer = prepare(&builder.build(), Settings { size: SIZE, ..tiny() });
    let views = most(&transfer);
    assert!((20..=32).contains(&views), "{views} views");
}

/// A lamp within tinted glass does not show itself there, in either engine; within clear glass it does.
#[test]
fn lamps_in_tinted_glass_are_not_shown() {
    let shown = |extinction: f32| {
        let mut builder = SceneBuilder::new();
        let interior = Interior::Solid { extinction: Vec3::splat(extinction) };
        let ball = builder.material(glass(interior, Vec3::ONE));
        let black = builder.material(lambertian(Vec3::splat(0.01)));
        builder
            .sphere(Vec3::ZERO, 0.5, 48, false, ball)
            .quad(Vec3::new(-20.0, -20.0, -6.0), Vec3::X * 40.0, Vec3::Y * 40.0, black)
            .camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 20.0);
        let built = builder.build();
        let (_, images) = direct(&built, &rig([omni(Vec3::new(0.1, 0.05, 0.0), Vec3::ONE, 0.1)]));
        images.map(|image| image.pixels.iter().map(|pixel| pixel.x).sum::<f32>())
    };
    let ([clear, traced_clear], [tinted, traced_tinted]) = (shown(0.0), shown(1.0));
    println!("clear {clear} {traced_clear}, tinted {tinted} {traced_tinted}");
    assert!((clear / traced_clear - 1.0).abs() < 0.02 && clear > 20.0 * tinted);
    assert!((tinted / traced_tinted - 1.0).abs() < 0.05, "{tinted} {traced_tinted}");
}

/// A map's sun in a chrome ball: the light that falls on the ball leaves it evenly to all sides, in both engines.
#[test]
fn the_sun_of_a_map_shows_in_a_chrome_ball() {
    let built = chrome_ball();
    let texels = (0..256 * 128).map(|i| Vec3::splat(if i == 40 * 256 + 70 { 1e4 } else { 0.0 })).collect();
    let map = EnvironmentMap::new("sun", 256, 128, texels).unwrap();
    let irradiance = map.texel(70, 40).x * map.solid_angle(40) as f32;
    assert_eq!(map.suns().len(), 1);
    let dome = rig([LightKind::Dome { map: Some(Arc::new(map)), intensity: Vec3::ONE, rotation: 0.0 }]);
    let (_, images) = direct(&built, &dome);
    let pixel = built.scene.cameras[0].pixel_angle(SIZE.0, SIZE.1);
    let expected = irradiance * 0.2 * 0.2 / 4.0 / 16.0;
    for image in images {
        let shown = image.pixels.iter().map(|pixel| pixel.x).sum::<f32>() * pixel * pixel;
        println!("{} of the light", shown / expected);
        assert!((shown / expected - 1.0).abs() < 0.35, "{shown} instead of {expected}");
    }
}

/// Without rows along lobes mirrors are followed all the same, and the parts of several lights add up.
#[test]
fn mirrors_need_no_glossy_rows_and_lights_add_up() {
    let built = parlour();
    let settings = Settings { size: (48, 27), glossy: false, ..tiny() };
    let transfer = Arc::new(prepare(&built, settings));
    assert!(transfer.glossy.is_none() && !transfer.view.quad_chains.branches.is_empty());
    let lights = rig([
        omni(Vec3::new(-0.3, 2.2, 1.0), Vec3::new(2.6, 2.3, 1.9), 0.1),
        omni(Vec3::new(0.8, 1.8, 0.5), Vec3::ONE, 0.0),
    ]);
    let relight = RelightSettings { per_light: true, ..RelightSettings::default() };
    let layers = relight_afresh(&transfer, &lights, &relight);
    for pixel in 0..layers.direct.pixels.len() {
        let sum: Vec3 = layers.per_light.iter().map(|light| light.direct.pixels[pixel]).sum();
        assert!((sum - layers.direct.pixels[pixel]).length() <= 1e-5 * sum.length());
    }
    let traced = relume::reference::Settings {
        width: 48,
        height: 27,
        spp: 256,
        paths: relume::reference::Paths::DiffuseTransfer,
        ..Default::default()
    };
    let counts = [Some(2)];
    let truth =
        trace_bounces(&built.scene, &built.geometry, &built.accel, &lights, &traced, &counts, &()).unwrap();
    let relight = RelightSettings { bounces: Some(2), ..relight };
    let layers = relight_afresh(&transfer, &lights, &relight);
    let [direct, indirect] = [(&layers.direct, &truth.direct), (&layers.indirect, &truth.indirect[0])]
        .map(|(image, truth)| unbiased_relative_l2(image, truth));
    println!("direct {direct:.4}, indirect {indirect:.4}");
    assert!(direct < 0.02 && indirect < 0.1, "{direct} {indirect}");
}

fn parlour() -> TestScene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/parlour.glb");
    let scene = relume_io::load_scene(&path).expect("the parlour").scene;
    let geometry = Geometry::new(&scene);
    let accel = Accel::new(&scene, &geometry);
    TestScene { scene, geometry, accel }
}

fn parlour_settings() -> Settings {
    Settings { size: (96, 54), gather: 4096, quality: Quality::Standard, ..Settings::default() }
}

/// Relative L2 of direct and indirect light.
fn errors(transfer: &Arc<Transfer>, lights: &LightRig, truth: &Truths) -> [f64; 2] {
    let settings = RelightSettings { bounces: Some(3), aa: 1, ..RelightSettings::default() };
    let layers = relight_afresh(transfer, lights, &settings);
    [(&layers.direct, &truth.direct), (&layers.indirect, &truth.indirect[2])]
        .map(|(image, truth)| unbiased_relative_l2(image, truth))
}

#[test]
fn a_room_of_mirrors_and_glass_agrees_with_the_path_tracer() {
    let built = parlour();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/rigs/parlour.toml");
    let lights = relume_io::load_rig(&path).expect("the parlour's rig");
    let truth = trace(&built, &lights, (96, 54), 3, 256);
    let transfer = Arc::new(prepare(&built, parlour_settings()));
    let [direct, indirect] = errors(&transfer, &lights, &truth);
    let mut blind = Transfer::clone(&transfer);
    blind.view.center_chains = relume::sample::Chains::default();
    blind.receivers_of_center_branches = Vec::new().into();
    let [blind_direct, blind_indirect] = errors(&Arc::new(blind), &lights, &truth);
    println!(
        "direct {direct:.4}, indirect {indirect:.4}; noise {:.4}, {:.4}; without mirrors and glass {blind_direct:.4}, {blind_indirect:.4}",
        truth.direct.noise(),
        truth.indirect[2].noise()
    );
    assert!(direct < 0.05 && indirect < 0.08, "{direct} {indirect}");
    assert!(blind_direct > 0.2 && blind_indirect > 0.2, "{blind_direct} {blind_indirect}");
}

/// Base colours may be edited of what is seen in mirrors too.
#[test]
fn repainted_walls_are_repainted_in_the_mirror() {
    let mut builder = under_a_ceiling();
    let material = builder.material(mirror());
    builder.quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0, material);
    let mut built = builder.build();
    built.scene.materials[0].name = "ceiling".into();
    let mut lights = rig([omni(Vec3::new(0.0, 2.0, 6.0), Vec3::splat(30.0), 0.0)]);
    let transfer = Arc::new(prepare(&built, Settings { size: SIZE, ..tiny() }));
    let settings = RelightSettings { only: Only::Direct, ..RelightSettings::default() };
    let white = relight_afresh(&transfer, &lights, &settings).direct;
    let base_color = Vec3::new(0.8, 0.4, 0.1);
    lights.materials.push(relume::scene::MaterialEdit { name: "ceiling".into(), base_color });
    let painted = relight_afresh(&transfer, &lights, &settings).direct;
    for (painted, white) in painted.pixels.iter().zip(&white.pixels) {
        let expected = *white * base_color / 0.8;
        assert!((*painted - expected).length() < 1e-3 * expected.length(), "{painted} {expected}");
    }
}

#[test]
fn caches_keep_mirrors_and_refuse_damaged_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("parlour.relume");
    let transfer = prepare(&parlour(), Settings { size: (32, 18), ..tiny() });
    assert!(!transfer.view.quad_chains.branches.is_empty());
    transfer.save(&path).unwrap();
    let loaded = Transfer::load(&path).unwrap();
    assert_eq!(loaded.view, transfer.view);
    assert_eq!(loaded.receivers_of_quad_branches[..], transfer.receivers_of_quad_branches[..]);
    // in the open, views of the sky
    let mut builder = under_a_ceiling();
    let ball = builder.material(mirror());
    builder.sphere(Vec3::new(0.2, 0.3, -0.8), 0.3, 24, false, ball);
    let open = prepare(&builder.build(), Settings { size: SIZE, ..tiny() });
    assert!(!open.view.quad_chains.sky.is_empty());
    open.save(&path).unwrap();
    assert_eq!(Transfer::load(&path).unwrap().view, open.view);
    let refused = |transfer: &Transfer| {
        transfer.save(&path).unwrap();
        Transfer::load(&path).unwrap_err().to_string()
    };
    let mut strayed = transfer.clone();
    strayed.view.quad_chains.branches.last_mut().unwrap().owner = strayed.view.quads.len() as u32;
    assert!(refused(&strayed).contains("view"), "{}", refused(&strayed));
    let mut bent = transfer.clone();
    bent.view.center_chains.branches[0].last = f32::NAN;
    assert!(refused(&bent).contains("view"));
    let mut short = transfer;
    short.receivers_of_quad_branches = Vec::new().into();
    assert!(refused(&short).contains("receivers_of_quad_branches"));
}

/// A pane must not change what the transfer knows of the rest.
#[test]
fn glass_is_not_there_for_bounced_light() {
    let room = |pane: bool| {
        let mut builder = SceneBuilder::new();
        let wall =
            builder.material(Material { base_color: Vec4::new(0.6, 0.5, 0.4, 1.0), ..lambertian(Vec3::ONE) });
        let glass = builder.material(glass(Interior::Thin, Vec3::ONE));
        builder.room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), wall);
        if pane {
            builder.quad(Vec3::new(0.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::Y * 3.0, glass);
        }
        builder.camera(Vec3::new(2.3, 1.6, 1.8), Vec3::new(2.0, 1.2, 0.0), 55.0);
        Arc::new(prepare(&builder.build(), tiny()))
    };
    let lights = rig([omni(Vec3::new(3.0, 2.0, 4.0), Vec3::splat(5.0), 0.0)]);
    let [open, glazed] = [false, true].map(|pane| {
        relight_afresh(&room(pane), &lights, &RelightSettings { aa: 1, ..RelightSettings::default() })
    });
    assert_eq!(open.indirect, glazed.indirect);
    assert_eq!(open.direct, glazed.direct);
}
