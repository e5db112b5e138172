//! How many rays a second one thread traces: `cargo bench -p relume --bench rays`.
//!
//! On `sponza.glb` in the folder that `RELUME_SCENES` names, else on the demo scene. Criterion's `thrpt` is in rays; run
//! again, it says how far the rates have moved since.

mod ray_sets;

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relume::scene::Geometry;
use relume::trace::{Accel, Hit};

use ray_sets::{Rays, scene_file};

fn rays(criterion: &mut Criterion) {
    let path = scene_file();
    let scene = relume_io::load_scene(&path).expect("a scene that can be read").scene;
    let geometry = Geometry::new(&scene);
    let accel = Accel::new(&scene, &geometry);
    let rays = Rays::new(&scene, &geometry, &accel);
    let scene_name = path.file_stem().unwrap_or_default().to_string_lossy();
    println!("{scene_name}: {} triangles", accel.stats().triangles);
    let mut group = criterion.benchmark_group(format!("rays in {scene_name}"));
    group.sample_size(30);
    let closest =
        [("primary, closest hit", &rays.primary), ("cosine hemisphere, closest hit", &rays.hemisphere)];
    for (name, rays) in closest {
        let mut hits = vec![Hit::MISS; rays.len()];
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(name, |bencher| {
            bencher.iter(|| accel.closest_batch(black_box(rays), black_box(&mut hits)));
        });
    }
    let any =
        [("between visible points, any hit", &rays.between), ("towards one light, any hit", &rays.to_light)];
    for (name, rays) in any {
        let mut blocked = vec![false; rays.len()];
        group.throughput(Throughput::Elements(rays.len() as u64));
        group.bench_function(name, |bencher| {
            bencher.iter(|| accel.occluded_batch(black_box(rays), black_box(&mut blocked)));
        });
    }
    group.finish();
}

criterion_group!(benches, rays);
criterion_main!(benches);
