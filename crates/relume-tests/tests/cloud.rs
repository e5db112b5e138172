//! The gather cloud: areas, sides, holes, order, and the light on it.

use relume::glam::{Vec2, Vec3};
use relume::sample::{CellMap, GatherCloud, SUB_SAMPLES, ViewSamples, illuminate};
use relume::scene::{AlphaMode, ColorSpace, Material, Texture, TextureRef, Wrap};
use relume::trace::sampling::{hash, unit};
use relume::trace::{Hit, Ray};
use relume::{Error, Light};
use relume_tests::scenes::{
    SceneBuilder, TestScene, box_room, empty_room, integrating_sphere, lambertian, omni,
};

/// What a camera of 40x30 pixels makes of the scene.
fn gather(built: &TestScene, count: usize, seed: u32) -> relume::Result<(GatherCloud, CellMap)> {
    let camera = &built.scene.cameras[0];
    let (width, height) = (40, 30);
    let (_, hits) =
        ViewSamples::new(&built.scene, &built.geometry, &built.accel, camera, (width, height), &())?;
    let direction = |pixel: usize| {
        camera.direction((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5, width, height)
    };
    let seen: Vec<(Hit, Vec3)> =
        hits.into_iter().enumerate().map(|(pixel, hit)| (hit, direction(pixel))).collect();
    GatherCloud::new(&built.scene, &built.geometry, &built.accel, &seen, count, seed, &())
}

fn cloud(built: &TestScene) -> GatherCloud {
    gather(built, 1024, 0).expect("a scene that can be gathered").0
}

fn area(cloud: &GatherCloud, of: impl Fn(Vec3, Vec3) -> bool) -> f64 {
    let counted = cloud.samples.iter().filter(|sample| of(sample.position, sample.normal));
    counted.map(|sample| f64::from(sample.area)).sum()
}

const ROOM: (Vec3, Vec3) = (Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0));

/// A room of `ROOM` with more in it, seen from its back.
fn room_with(add: impl FnOnce(&mut SceneBuilder)) -> TestScene {
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::splat(0.6)));
    builder.room(ROOM.0, ROOM.1, wall).camera(Vec3::new(2.3, 1.6, 4.8), Vec3::new(2.0, 1.2, 0.0), 55.0);
    add(&mut builder);
    builder.build()
}

fn on_room(position: Vec3) -> bool {
    (position - ROOM.0).abs().min_element() < 1e-4 || (position - ROOM.1).abs().min_element() < 1e-4
}

#[test]
fn areas_add_up_and_normals_face_inwards() {
    let cloud = cloud(&room_with(|_| ()));
    let expected = 2.0 * (4.0 * 3.0 + 3.0 * 5.0 + 5.0 * 4.0);
    let total = area(&cloud, |_, _| true);
    assert!((total / expected - 1.0).abs() < 1e-4, "{total}");
    let center = 0.5 * (ROOM.0 + ROOM.1);
    assert!(cloud.samples.iter().all(|s| on_room(s.position) && s.normal.dot(center - s.position) > 0.0));
    // uniform: no sample stands for much more than another
    let mean = expected / cloud.len() as f64;
    let largest = cloud.samples.iter().fold(0.0_f32, |largest, sample| largest.max(sample.area));
    let smallest = cloud.samples.iter().fold(f32::INFINITY, |smallest, sample| smallest.min(sample.area));
    println!("areas {smallest} to {largest}, mean {mean}");
    assert!(f64::from(largest) < 2.0 * mean && f64::from(smallest) > 0.4 * mean);
    assert!(cloud.samples.iter().all(|sample| sample.albedo.abs_diff_eq(Vec3::splat(0.6), 1e-4)));
}

#[test]
fn sub_samples_share_their_patch() {
    let cloud = cloud(&box_room());
    assert_eq!(cloud.sub_samples.len(), SUB_SAMPLES * cloud.len());
    for (sample, parts) in cloud.samples.iter().zip(cloud.sub_samples.chunks_exact(SUB_SAMPLES)) {
        let weight: f32 = parts.iter().map(|part| part.weight()).sum();
        // each is rounded to 16 bits
        assert!((weight - 1.0).abs() < SUB_SAMPLES as f32 * 0.5 / 65535.0 + 1e-5, "{weight}");
        let middle: Vec3 = parts.iter().map(|part| part.position * part.weight()).sum();
        assert!(middle.distance(sample.position) < 2.0 * sample.area.sqrt(), "{middle} {}", sample.position);
    }
}

#[test]
fn a_two_sided_sheet_has_both_sides_and_a_one_sided_one_its_front() {
    for (double_sided, expected) in [(true, [1.0, 1.0]), (false, [1.0, 0.0])] {
        let built = room_with(|builder| {
            let cloth = builder.material(Material { double_sided, ..lambertian(Vec3::splat(0.5)) });
            builder.quad(Vec3::new(1.5, 1.0, 2.0), Vec3::X, Vec3::Y, cloth);
        });
        let cloud = cloud(&built);
        let sheet = |position: Vec3| !on_room(position);
        let sides = [1.0, -1.0].map(|side| area(&cloud, |p, n| sheet(p) && n.z * side > 0.9));
        // a sample at the border of two surfaces may stand for a part of both: a cell is a tenth of a square metre
        assert!((sides[0] - expected[0]).abs() < 0.15, "{sides:?}");
        assert!((sides[1] - expected[1]).abs() < 0.15, "{sides:?}");
    }
}

#[test]
fn the_inside_of_a_closed_box_gets_no_samples() {
    let (low, high) = (Vec3::new(1.0, 0.5, 1.0), Vec3::new(2.0, 1.5, 2.0));
    let built = room_with(|builder| {
        let shell = builder.material(Material { double_sided: true, ..lambertian(Vec3::splat(0.5)) });
        builder.room(low, high, shell);
    });
    let cloud = cloud(&built);
    let middle = 0.5 * (low + high);
    let outside = area(&cloud, |p, n| !on_room(p) && n.dot(p - middle) > 0.0);
    let inside = area(&cloud, |p, n| !on_room(p) && n.dot(p - middle) < 0.0);
    assert!((outside - 6.0).abs() < 0.3, "{outside}");
    assert_eq!(inside, 0.0);
}

/// Alpha 255 in the left half of the image, 0 in the right one.
fn half_mask(builder: &mut SceneBuilder) -> usize {
    let texels = (0..64).map(|i| [255, 255, 255, if i % 8 < 4 { 255 } else { 0 }]).collect();
    let texture = builder.texture(Texture {
        name: "mask".into(),
        width: 8,
        height: 8,
        texels,
        color_space: ColorSpace::Srgb,
        wrap: [Wrap::Clamp; 2],
    });
    builder.material(Material {
        base_color_texture: Some(TextureRef::new(texture)),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..lambertian(Vec3::splat(0.5))
    })
}

#[test]
fn holes_of_alpha_masks_are_left_out() {
    let built = room_with(|builder| {
        let leaf = half_mask(builder);
        builder.quad(Vec3::new(1.0, 0.5, 2.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, leaf);
    });
    let (cloud, map) = gather(&built, 1024, 0).unwrap();
    let sheet = area(&cloud, |p, _| !on_room(p));
    // two sides of 2 x 2 metres, half of it holes; patches of 0.6 dm2 are solid or not as a whole
    assert!((sheet / 4.0 - 1.0).abs() < 0.05, "{sheet}");
    assert!(cloud.samples.iter().all(|s| on_room(s.position) || s.position.x < 2.0 + 1e-3));
    // what a ray meets behind the hole is the wall
    let ray = Ray::new(Vec3::new(2.5, 1.5, 4.0), Vec3::NEG_Z);
    let behind = map.sample_at(&built.geometry, &built.accel.closest(&ray), ray.direction).unwrap();
    assert!(cloud.samples[behind].position.z < 1e-3);
}

#[test]
fn a_ray_finds_the_sample_of_the_patch_it_hits() {
    let built = box_room();
    let (cloud, map) = gather(&built, 1024, 0).unwrap();
    let (mut missed, mut apart) = (0, Vec::new());
    for index in 0..5000 {
        let random = |dimension| unit(hash(index, dimension));
        let direction = relume::trace::sampling::uniform_sphere(Vec2::new(random(0), random(1)));
        let ray = Ray::new(Vec3::new(2.9, 1.7, 3.1), direction);
        let hit = built.accel.closest(&ray);
        let Some(sample) = map.sample_at(&built.geometry, &hit, direction) else {
            missed += 1;
            continue;
        };
        let (sample, point) = (&cloud.samples[sample], ray.origin + direction * hit.t);
        apart.push(sample.position.distance(point) / sample.area.sqrt());
    }
    // patches are compact; the few that are left over when surfaces are parted evenly may be in two pieces
    apart.sort_by(f32::total_cmp);
    let [half, most] = [apart[apart.len() / 2], apart[apart.len() * 98 / 100]];
    println!(
        "from the sample, in widths of its patch: median {half}, 98 of 100 {most}, all {}",
        apart[apart.len() - 1]
    );
    assert!(half < 0.6 && most < 1.3, "{half} {most}");
    assert_eq!(missed, 0, "every surface that is seen has a sample");
    assert!(map.sample_at(&built.geometry, &Hit::MISS, Vec3::X).is_none());
}

#[test]
fn neighbours_in_the_order_lie_close_together() {
    let cloud = cloud(&box_room());
    let spread = |place: &dyn Fn(usize) -> usize, size: usize| {
        let clusters = cloud.len() / size;
        let of_cluster = |cluster: usize| {
            let members = || (cluster * size..(cluster + 1) * size).map(|i| cloud.samples[place(i)].position);
            let middle = members().sum::<Vec3>() / size as f32;
            members().map(|p| f64::from(p.distance_squared(middle))).sum::<f64>() / size as f64
        };
        (0..clusters).map(of_cluster).sum::<f64>() / clusters as f64
    };
    for size in [4, 16, 64] {
        let ordered = spread(&|i| i, size);
        // 613 is prime to the count: a walk all over the cloud
        let scattered = spread(&|i| i * 613 % 1024, size);
        // a compact cluster holds size / 1024 of the surface: its squared extent shrinks as its area
        println!("clusters of {size}: {ordered} for {scattered} by chance");
        assert!(ordered < 3.0 * scattered * size as f64 / 1024.0, "{size}: {ordered} {scattered}");
    }
}

#[test]
fn the_number_of_samples_is_a_power_of_four() {
    let built = box_room();
    for count in [0, 64, 512, 1000, 2048, 1 << 22] {
        let error = gather(&built, count, 0).unwrap_err();
        assert!(matches!(error, Error::Setting(_)), "{error}");
        assert!(error.to_string().contains("power of four"), "{error}");
    }
    for count in [256, 1024] {
        assert_eq!(gather(&built, count, 0).unwrap().0.len(), count);
    }
    // nothing in view
    let mut builder = SceneBuilder::new();
    let wall = builder.material(lambertian(Vec3::splat(0.6)));
    builder.room(Vec3::ZERO, Vec3::ONE, wall).camera(Vec3::new(5.0, 0.5, 0.5), Vec3::X * 9.0, 40.0);
    assert!(gather(&builder.build(), 256, 0).unwrap_err().to_string().contains("nothing to relight"));
}

#[test]
fn another_seed_gives_another_cloud_of_the_same_surface() {
    let built = box_room();
    let (a, b) = (gather(&built, 256, 0).unwrap().0, gather(&built, 256, 1).unwrap().0);
    assert_ne!(a, b);
    assert_eq!(a, gather(&built, 256, 0).unwrap().0);
    let [a, b] = [a, b].map(|cloud| area(&cloud, |_, _| true));
    assert!((a / b - 1.0).abs() < 2e-3, "{a} {b}");
}

/// Walls of albedo `p` around a light of intensity `I` send out `p 4 pi I`, wherever it stands.
#[test]
fn all_light_of_a_lamp_arrives_on_the_walls_around_it() {
    let albedo = Vec3::new(0.8, 0.5, 0.25);
    let sphere = integrating_sphere(lambertian(albedo));
    let room = empty_room(lambertian(albedo));
    let cases = [
        (&sphere, Vec3::ZERO, 0.0),
        (&sphere, Vec3::new(0.2, -0.6, 0.3), 0.0),
        (&room, Vec3::new(1.0, 1.0, 1.5), 0.0),
        (&room, Vec3::new(0.5, 0.5, 2.5), 0.1),
    ];
    for (built, position, radius) in cases {
        let (cloud, _) = gather(built, 4096, 0).unwrap();
        let light = Light { name: "lamp".into(), enabled: true, kind: omni(position, Vec3::ONE, radius) };
        let lit = illuminate(&cloud, &built.accel, &light);
        let power: Vec3 = cloud.samples.iter().zip(&lit.radiance).map(|(s, g)| s.area * *g).sum();
        // radiosity is pi times radiance
        let ratio = power * std::f32::consts::PI / (4.0 * std::f32::consts::PI * albedo);
        println!("{position}, radius {radius}: {ratio}");
        // measured 0.0005; 0.027 for the soft lamp where each cell looks at one point of it
        assert!((ratio - 1.0).abs().max_element() < 0.002, "{position}: {ratio}");
    }
}

/// A blocker takes away what lies in its shadow and nothing else.
#[test]
fn shadows_fall_on_the_cloud_where_they_should() {
    let built = room_with(|builder| {
        let shade = builder.material(Material { double_sided: true, ..lambertian(Vec3::ZERO) });
        builder.quad(Vec3::new(1.5, 1.5, 2.0), Vec3::X, Vec3::Z, shade);
    });
    let cloud = cloud(&built);
    let light =
        Light { name: "lamp".into(), enabled: true, kind: omni(Vec3::new(2.0, 2.9, 2.5), Vec3::ONE, 0.0) };
    let lit = illuminate(&cloud, &built.accel, &light);
    // the square's shadow on the floor, from 2.9 metres past 1.5: 2.9 / 1.4 as large
    let (middle, half) = (Vec3::new(2.0, 0.0, 2.5), 0.5 * 2.9 / 1.4);
    let (mut dark, mut bright) = (0, 0);
    for (sample, radiance) in cloud.samples.iter().zip(&lit.radiance).filter(|(s, _)| s.position.y < 1e-4) {
        let apart = (sample.position - middle).abs();
        let margin = 1.2 * sample.area.sqrt();
        let outermost = apart.x.max(apart.z);
        if outermost < half - margin {
            assert_eq!(*radiance, Vec3::ZERO, "{}", sample.position);
            dark += 1;
        } else if outermost > half + margin {
            let to_light = Vec3::new(2.0, 2.9, 2.5) - sample.position;
            let expected = 0.6 / std::f32::consts::PI * to_light.y / to_light.length().powi(3);
            assert!((radiance.x / expected - 1.0).abs() < 0.15, "{} {expected}", radiance.x);
            bright += 1;
        }
    }
    assert!(dark > 10 && bright > 50, "{dark} dark, {bright} bright");
}
