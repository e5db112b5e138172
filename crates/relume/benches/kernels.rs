//! What the stages of a relit frame take by themselves: `cargo bench -p relume --bench kernels`.
//!
//! On a small shot of the demo scene, prepared first with a fixed seed; on one thread, so that spreads are small. Stages that have no function
//! of their own are told by what a frame says it spent on them. Criterion says how far each has moved since the run before.

use std::f32::consts::TAU;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use relume::glam::Vec3;
use relume::relight::{FrameStats, Only, RelightSettings};
use relume::sample::{Detail, cloud_groups, illuminate_with};
use relume::trace::{Ray, offset_origin};
use relume::transfer::{Coefficients, Encoding, Quality, Settings, haar};
use relume::{Light, LightKind, LightRig, Preparation, Relighter, Transfer};

/// Of the shot.
const SIZE: (usize, usize) = (128, 96);
const GATHER: usize = 4096;
/// Rays of the camera's that are traced back to it at once.
const CHUNK: usize = 4096;

fn prepared(encoding: Encoding) -> Transfer {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/arcade.glb");
    let scene = relume_io::load_scene(&path).expect("the demo scene").scene;
    let settings = Settings {
        size: SIZE,
        gather: GATHER,
        quality: Quality::Glance,
        spacing: 0.1,
        encoding,
        ..Settings::default()
    };
    Preparation::new(&scene).settings(settings).run(&()).expect("a scene that can be prepared")
}

/// A lamp in the arcade, after a `turn` round a small circle.
fn lamp(turn: f32) -> Light {
    let (sin, cos) = (turn * TAU).sin_cos();
    let kind = LightKind::Omni {
        position: Vec3::new(-1.2 + 0.1 * cos, 3.4, 0.3 + 0.1 * sin),
        intensity: Vec3::splat(10.0),
        radius: 0.0,
    };
    Light { name: "lamp".into(), enabled: true, kind }
}

/// Radiance on the cloud that is nowhere alike.
fn radiance(count: usize) -> Vec<Vec3> {
    let at = |index: usize| (index as f32 * 0.37).sin().mul_add(0.4, 0.5);
    (0..count).map(|index| Vec3::new(at(index), at(index + 1), at(index + 2))).collect()
}

fn transform(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("haar transform");
    for count in [GATHER, 65_536] {
        let values: Vec<f32> = radiance(count).iter().map(|light| light.x).collect();
        let (mut place, mut scratch) = (values.clone(), vec![0.0; count]);
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::new("forward", count), |bencher| {
            bencher.iter(|| {
                place.copy_from_slice(&values);
                haar::forward(black_box(&mut place), &mut scratch);
            });
        });
        // what a frame does: all colours, on all threads
        let light = radiance(count);
        group.bench_function(BenchmarkId::new("of light", count), |bencher| {
            bencher.iter(|| Coefficients::new(black_box(&light), &[], &[]));
        });
    }
    group.finish();
}

/// The operators' products with light, in each encoding.
fn products(criterion: &mut Criterion, encoding: Encoding, transfer: &Transfer) {
    let mut group = criterion.benchmark_group("products");
    let light = radiance(transfer.cloud.len());
    for (name, operator) in [("final gather", &transfer.gather), ("a bounce", &transfer.bounce)] {
        let coefficients = operator.coefficients(&light);
        let mut out = vec![Vec3::ZERO; operator.rows];
        group.throughput(Throughput::Bytes(operator.bytes() as u64));
        group.bench_function(BenchmarkId::new(name, format!("{encoding:?}")), |bencher| {
            bencher.iter(|| operator.apply_coefficients(black_box(&coefficients), 0.0, black_box(&mut out)));
        });
    }
    group.finish();
}

fn light_on_the_cloud(criterion: &mut Criterion, relighter: &Relighter) {
    let (transfer, accel) = (relighter.transfer(), relighter.accel());
    let mut group = criterion.benchmark_group("light on the cloud");
    let groups = cloud_groups(&transfer.cloud);
    let lit = || illuminate_with(black_box(&transfer.cloud), Some(&groups), accel, &lamp(0.0), Detail::Full);
    let rays = lit().shadow_rays;
    group.throughput(Throughput::Elements(rays));
    group.bench_function("from a point", |bencher| {
        bencher.iter(lit);
    });
    group.finish();
}

/// Shadow rays that run side by side as well as they can: from all view samples back to the camera.
fn packets(criterion: &mut Criterion, relighter: &Relighter) {
    let (view, accel) = (&relighter.transfer().view, relighter.accel());
    let to_camera = |sample: &relume::sample::ViewSample| {
        Ray::between(offset_origin(sample.position, sample.geometric_normal.get()), view.camera.position())
    };
    let rays: Vec<Ray> = view.quads.iter().filter(|sample| !sample.is_sky()).map(to_camera).collect();
    let mut blocked = vec![false; CHUNK];
    let mut group = criterion.benchmark_group("packets of shadow rays");
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("back to the camera", |bencher| {
        bencher.iter(|| {
            for rays in rays.chunks(CHUNK) {
                accel.occluded_batch(black_box(rays), black_box(&mut blocked[..rays.len()]));
            }
        });
    });
    group.finish();
}

/// What frames say that they spend on a stage while the lamp moves.
fn stages(criterion: &mut Criterion, relighter: &mut Relighter) {
    type Stage = (&'static str, Only, fn(&FrameStats) -> f64);
    let stages: [Stage; 4] = [
        ("direct light", Only::Direct, |frame| frame.direct_ms),
        ("all bounces", Only::Indirect, |frame| frame.bounces_ms),
        ("upsampling", Only::Indirect, |frame| frame.upsample_ms),
        ("sum over lights", Only::Both, |frame| frame.sum_ms),
    ];
    let mut group = criterion.benchmark_group("stages of a frame");
    // a frame takes longer than most of its stages: as few as tell
    group.sampling_mode(SamplingMode::Flat);
    for (name, only, spent) in stages {
        let settings = RelightSettings { only, ..RelightSettings::default() };
        let mut frame = 0_u32;
        group.bench_function(name, |bencher| {
            bencher.iter_custom(|frames| {
                let mut milliseconds = 0.0;
                for _ in 0..frames {
                    // a light that has not moved would be taken from the frame before
                    frame += 1;
                    let lights = vec![lamp((frame % 1000) as f32 / 1000.0)];
                    let rig = LightRig { lights, ..LightRig::default() };
                    relighter.relight(&rig, &settings).expect("a rig that fits");
                    milliseconds += spent(relighter.stats());
                }
                Duration::from_secs_f64(milliseconds * 1e-3)
            });
        });
    }
    group.finish();
}

fn kernels(criterion: &mut Criterion) {
    // this thread is all that measuring has
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    one.expect("no pool has been started");
    let all = rayon::ThreadPoolBuilder::new().build().expect("threads");
    transform(criterion);
    let shots = [Encoding::LowRank, Encoding::HaarRows, Encoding::HaarBlocks]
        .map(|encoding| (encoding, Arc::new(all.install(|| prepared(encoding)))));
    for (encoding, transfer) in &shots {
        products(criterion, *encoding, transfer);
    }
    let mut relighter = Relighter::new(Arc::clone(&shots[0].1));
    light_on_the_cloud(criterion, &relighter);
    packets(criterion, &relighter);
    stages(criterion, &mut relighter);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = kernels
}
criterion_main!(benches);
