//! What the samples of a pixel receive where they see different things.

use std::sync::Arc;

use relume::glam::Vec3;
use relume::reference::{Paths, Settings as ReferenceSettings};
use relume::relight::{Only, RelightSettings};
use relume::sample::{Receivers, ViewSamples};
use relume::scene::{ColorSpace, Material, Texture, TextureRef, Wrap};
use relume::trace::sampling::{hash, unit};
use relume::transfer::Settings;
use relume::{LightRig, Transfer};
use relume_tests::prepared::{prepare, relight_afresh, uncompressed};
use relume_tests::scenes::{SceneBuilder, TestScene, lambertian, omni, rig, spot};
use relume_tests::truth::{Truths, trace_bounces, unbiased_relative_l2_where};

const SIZE: (usize, usize) = (48, 36);

/// A room with one bright side, and thin slats that face it: their middles mostly lie between the centres of pixels.
fn slats() -> TestScene {
    let mut builder = SceneBuilder::new();
    let grey = builder.material(lambertian(Vec3::splat(0.3)));
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    let slat = builder.material(Material { double_sided: true, ..lambertian(Vec3::splat(0.8)) });
    builder.room(Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0), grey);
    builder.quad(Vec3::new(0.01, 0.0, 0.0), 5.0 * Vec3::Z, 3.0 * Vec3::Y, white);
    for index in 0..40 {
        let foot = Vec3::new(0.5 + 0.077 * index as f32, 0.3, 2.4);
        builder.quad(foot, Vec3::new(0.01, 0.0, 0.02), 2.4 * Vec3::Y, slat);
    }
    builder.camera(Vec3::new(2.0, 1.5, 4.8), Vec3::new(2.0, 1.5, 0.0), 60.0);
    builder.build()
}

/// Two bounces with four samples a pixel.
fn truths_of(built: &TestScene, lights: &LightRig, (width, height): (usize, usize), spp: u32) -> Truths {
    let settings = ReferenceSettings {
        width,
        height,
        spp,
        aa: 2,
        paths: Paths::Transfer,
        ..ReferenceSettings::default()
    };
    let TestScene { scene, geometry, accel } = built;
    trace_bounces(scene, geometry, accel, lights, &settings, &[Some(2)], &()).expect("valid settings")
}

/// The row of the centre of the 3x3 pixels around that is most similar to a quad: what the paper does.
fn row_of_most_similar_center(transfer: &Transfer, quad: usize) -> u32 {
    let (view, sample) = (&transfer.view, &transfer.view.quads[quad]);
    let (row, column) = (quad / 4 / view.width, quad / 4 % view.width);
    let around = (row.saturating_sub(1)..(row + 2).min(view.height)).flat_map(|y| {
        (column.saturating_sub(1)..(column + 2).min(view.width)).map(move |x| y * view.width + x)
    });
    let unlike = |&pixel: &usize| {
        let center = &view.centers[pixel];
        let turned = center.shading_normal.get().distance(sample.shading_normal.get());
        center.position.distance(sample.position) / sample.depth + 0.1 * turned
    };
    let nearest = around
        .filter(|&pixel| transfer.receivers_of_centers[pixel] != Receivers::NONE)
        .min_by(|a, b| unlike(a).total_cmp(&unlike(b)));
    nearest.map_or(Receivers::NONE, |pixel| transfer.receivers_of_centers[pixel])
}

#[test]
fn what_is_thinner_than_a_pixel_receives_its_own_light() {
    let built = slats();
    let lights = rig([omni(Vec3::new(0.4, 1.5, 2.4), Vec3::splat(4.0), 0.0)]);
    let truths = truths_of(&built, &lights, SIZE, 2048);
    let transfer = prepare(&built, uncompressed(SIZE));
    let apart: Vec<bool> = transfer
        .receivers_of_quads
        .chunks_exact(4)
        .map(|rows| {
            rows.iter().any(|&row| row != Receivers::NONE && !transfer.receivers_of_centers.contains(&row))
        })
        .collect();
    let pixels = apart.iter().filter(|&&apart| apart).count();
    let error = |transfer: Transfer| {
        let settings =
            RelightSettings { bounces: Some(2), only: Only::Indirect, ..RelightSettings::default() };
        let image = relight_afresh(&Arc::new(transfer), &lights, &settings).indirect;
        unbiased_relative_l2_where(&image, &truths.indirect[0], |pixel| apart[pixel])
    };
    // each sample as the most similar centre
    let shared: Vec<u32> =
        (0..transfer.view.quads.len()).map(|quad| row_of_most_similar_center(&transfer, quad)).collect();
    let wrong = error(Transfer { receivers_of_quads: shared.into(), ..transfer.clone() });
    let right = error(transfer);
    println!("{pixels} pixels: error {right:.4}, as the most similar centre {wrong:.4}");
    assert!(pixels > 100, "{pixels}");
    // measured 0.008 and 0.14
    assert!(right < 0.04, "{right}");
    assert!(wrong > 0.12, "the light of another surface must be noticed: {wrong}");
}

/// A wall whose normals and albedo change from texel to texel, two texels a pixel, in a room; or a flat one.
fn bumps(height: f32) -> TestScene {
    let mut builder = SceneBuilder::new();
    let texture = |builder: &mut SceneBuilder, color_space, texel: &dyn Fn(u32) -> [u8; 4]| {
        builder.texture(Texture {
            name: "bumps".into(),
            width: 64,
            height: 64,
            texels: (0..64 * 64).map(texel).collect(),
            color_space,
            wrap: [Wrap::Repeat; 2],
        })
    };
    let normals = texture(&mut builder, ColorSpace::Linear, &|index| {
        let tilt = |axis| ((unit(hash(axis, index)) - 0.5) * height + 127.5) as u8;
        [tilt(0), tilt(1), 240, 255]
    });
    let colors = texture(&mut builder, ColorSpace::Linear, &|index| {
        let grey = 60 + (unit(hash(7, index)) * 180.0) as u8;
        [grey, grey, grey, 255]
    });
    let rough = builder.material(Material {
        normal_texture: Some(TextureRef::new(normals)),
        base_color_texture: Some(TextureRef::new(colors)),
        ..lambertian(Vec3::ONE)
    });
    let grey = builder.material(lambertian(Vec3::splat(0.5)));
    builder
        .room(Vec3::new(-2.0, -2.0, -0.1), Vec3::new(2.0, 2.0, 4.0), grey)
        .quad(Vec3::new(-2.0, -2.0, 0.0), 4.0 * Vec3::X, 4.0 * Vec3::Y, rough)
        .camera(Vec3::new(0.0, 0.0, 2.5), Vec3::ZERO, 60.0);
    builder.build()
}

#[test]
fn samples_of_one_surface_share_a_receiver_that_has_their_mean_normal() {
    let built = bumps(90.0);
    let camera = &built.scene.cameras[0];
    let (view, _) = ViewSamples::new(&built.scene, &built.geometry, &built.accel, camera, SIZE, &()).unwrap();
    let receivers = Receivers::new(&view, camera, true);
    let mut sums = vec![[Vec3::ZERO; 2]; receivers.points.len()];
    for (sample, &receiver) in view.quads.iter().zip(&receivers.of_quads) {
        let normal = sample.shading_normal.get();
        sums[receiver as usize][0] += normal * sample.diffuse.get().x;
        sums[receiver as usize][1] += normal;
    }
    let (mut by_reflectance, mut alike) = (0.0_f32, 0.0_f32);
    for (point, [weighted, plain]) in
        receivers.points.iter().zip(&sums).filter(|(_, sum)| sum[1] != Vec3::ZERO)
    {
        by_reflectance = by_reflectance.max(point.shading_normal.distance(weighted.normalize()));
        alike = alike.max(point.shading_normal.distance(plain.normalize()));
    }
    println!("{} receivers, off by {by_reflectance}, without weights by {alike}", receivers.points.len());
    assert!(by_reflectance < 1e-3, "{by_reflectance}");
    assert!(alike > 0.05, "a mean without weights must be noticed");
    assert!(receivers.points.len() < view.pixels() * 3 / 2, "samples share");
    assert_eq!(receivers.points.len(), view.pixels() + receivers.further.len());
}

/// Under light from one side a bumpy wall is the path tracer's, and not a flat one's.
#[test]
fn a_normal_map_is_seen_in_indirect_light() {
    let built = bumps(90.0);
    let lights =
        rig([spot(Vec3::new(1.0, 0.0, 2.0), Vec3::new(2.0, 0.3, 1.0), Vec3::splat(20.0), (20.0, 30.0))]);
    let truths = truths_of(&built, &lights, SIZE, 512);
    let error = |built: &TestScene| {
        let settings =
            RelightSettings { bounces: Some(2), only: Only::Indirect, ..RelightSettings::default() };
        let image =
            relight_afresh(&Arc::new(prepare(built, uncompressed(SIZE))), &lights, &settings).indirect;
        unbiased_relative_l2_where(&image, &truths.indirect[0], |_| true)
    };
    let (bumpy, flat) = (error(&built), error(&bumps(0.0)));
    println!("bumps: error {bumpy:.4}, as if they were flat {flat:.4}");
    assert!(bumpy < 0.04, "{bumpy}");
    assert!(flat > 0.08, "flat normals must be noticed: {flat}");
}

/// Two walls with a gap between them, at which the camera looks, and a third one behind it.
fn gap() -> TestScene {
    let mut builder = SceneBuilder::new();
    let white = builder.material(lambertian(Vec3::splat(0.8)));
    builder
        .quad(Vec3::new(-2.0, -2.0, 0.0), 1.9 * Vec3::X, 4.0 * Vec3::Y, white)
        .quad(Vec3::new(0.1, -2.0, 0.0), 1.9 * Vec3::X, 4.0 * Vec3::Y, white)
        .quad(Vec3::new(-2.0, -2.0, 4.0), 4.0 * Vec3::Y, 4.0 * Vec3::X, white)
        .camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 60.0);
    builder.build()
}

/// A single pixel whose centre sees the sky is lit by what its samples see.
#[test]
fn a_pixel_whose_centre_is_sky_still_receives() {
    let built = gap();
    let transfer = prepare(&built, Settings { gather: 1024, ..uncompressed((1, 1)) });
    assert_eq!(*transfer.receivers_of_centers, [Receivers::NONE]);
    assert_eq!((transfer.lit_pixels(), transfer.gather.rows), (0, 1), "both walls lie in one plane");
    let lights = rig([omni(Vec3::new(0.0, 0.0, 3.0), Vec3::splat(10.0), 0.0)]);
    let relit = |aa| {
        let settings =
            RelightSettings { bounces: Some(2), aa, only: Only::Indirect, ..RelightSettings::default() };
        relight_afresh(&Arc::new(transfer.clone()), &lights, &settings).indirect.pixels[0]
    };
    let expected = truths_of(&built, &lights, (1, 1), 16_384).indirect[0].mean().pixels[0];
    println!("{} for {expected}", relit(2));
    assert!((relit(2) / expected - 1.0).abs().max_element() < 0.05, "{} is not {expected}", relit(2));
    assert_eq!(relit(1), Vec3::ZERO, "the centre sees nothing");
}
