//! Our rays beside Embree's: `cargo bench -p relume-tests --features embree --bench embree`.
//!
//! Links Embree 3 (Debian: `apt-get install libembree-dev`), which nothing else here does. On `sponza.glb` in the folder that
//! `RELUME_SCENES` names, else on the demo scene: the rays of `crates/relume/benches/rays.rs`, in order of the image, on one thread and on
//! two. Every surface is solid for both. Embree's structure is built at its highest quality; its rays and packets are laid out for it
//! beforehand, and denormal numbers count as zero while it runs. Both take turns, thirty times, and each figure is the
//! median of what the turns say, so that a busy machine disturbs both alike.
//!
//! Fails where the two do not see the same.

mod bindings;
#[path = "../../../relume/benches/ray_sets/mod.rs"]
mod ray_sets;
mod turns;

use std::process::ExitCode;

use rayon::{ThreadPool, ThreadPoolBuilder};
use relume::scene::Geometry;
use relume::trace::{Accel, AlphaMasks, Hit, Ray};

use bindings::{EmbreeScene, Packet, PacketHit, RayHit, SingleRay};
use ray_sets::{Rays, scene_file};
use turns::{Batch, Contest, Traced, closest_answer};

/// Rays that a thread traces at once.
const CHUNK: usize = 1024;
/// Fewer rays than this are traced one by one by ours.
const ALONE: usize = 15;

/// Rays of ours with their answers.
#[derive(Clone)]
struct Ours<T> {
    rays: Vec<Ray>,
    answers: Vec<T>,
}

fn ours<T: Clone>(rays: &[Ray], chunk: usize, none: T) -> Vec<Ours<T>> {
    let of = |rays: &[Ray]| Ours { rays: rays.to_vec(), answers: vec![none.clone(); rays.len()] };
    rays.chunks(chunk).map(of).collect()
}

fn chunks<T>(rays: &[Ray], of: impl Fn(&[Ray]) -> Vec<T>) -> Vec<Vec<T>> {
    rays.chunks(CHUNK).map(of).collect()
}

/// Both sides over the same triangles.
struct Sides<'a> {
    accel: &'a Accel,
    embree: &'a EmbreeScene,
    robust: &'a EmbreeScene,
}

impl<'a> Sides<'a> {
    fn our_closest(&self, rays: &[Ray]) -> Box<dyn Traced + 'a> {
        let accel = self.accel;
        Box::new(Batch::new(
            "ours",
            ours(rays, CHUNK, Hit::MISS),
            |chunk: &mut Ours<Hit>| accel.closest_batch(&chunk.rays, &mut chunk.answers),
            |chunk| chunk.answers.iter().map(|hit| closest_answer(hit.t)).collect(),
        ))
    }

    fn our_occluded(&self, rays: &[Ray], at_once: usize) -> Box<dyn Traced + 'a> {
        let accel = self.accel;
        Box::new(Batch::new(
            if at_once < 16 { "ours, one by one" } else { "ours" },
            ours(rays, CHUNK, false),
            move |chunk: &mut Ours<bool>| {
                for (rays, answers) in chunk.rays.chunks(at_once).zip(chunk.answers.chunks_mut(at_once)) {
                    accel.occluded_batch(rays, answers);
                }
            },
            |chunk| chunk.answers.iter().map(|&blocked| f32::from(blocked)).collect(),
        ))
    }

    /// Of both builds of Embree what `make` makes of them: first the fastest, then the robust one.
    fn both(
        &self,
        make: impl Fn(&'a EmbreeScene) -> Vec<Box<dyn Traced + 'a>>,
    ) -> [Vec<Box<dyn Traced + 'a>>; 2] {
        [make(self.embree), make(self.robust)]
    }

    fn closest(&self, name: &'static str, rays: &[Ray], coherent: bool, aim: Option<f64>) -> Contest<'a> {
        let embree = self.both(|embree| {
            let single = Batch::new(
                "rtcIntersect1",
                chunks(rays, RayHit::all),
                move |chunk: &mut Vec<RayHit>| embree.closest(chunk, coherent),
                |chunk| chunk.iter().map(|ray| closest_answer(ray.distance())).collect(),
            );
            let packets = Batch::new(
                "rtcIntersect16",
                chunks(rays, PacketHit::all),
                |chunk: &mut Vec<PacketHit>| embree.closest_packets(chunk),
                |chunk| chunk.iter().flat_map(PacketHit::distances).map(closest_answer).collect(),
            );
            let mut all: Vec<Box<dyn Traced + 'a>> = vec![Box::new(single)];
            if coherent {
                all.push(Box::new(packets));
            }
            all
        });
        Contest { name, rays: rays.len(), aim, ours: self.our_closest(rays), embree }
    }

    /// Shadow rays one by one.
    fn occluded(&self, name: &'static str, rays: &[Ray], coherent: bool) -> Contest<'a> {
        let embree = self.both(|embree| {
            vec![Box::new(Batch::new(
                "rtcOccluded1",
                chunks(rays, SingleRay::all),
                move |chunk: &mut Vec<SingleRay>| embree.occluded(chunk, coherent),
                |chunk| chunk.iter().map(|ray| f32::from(ray.is_blocked())).collect(),
            ))]
        });
        let at_once = if coherent { ALONE } else { CHUNK };
        Contest { name, rays: rays.len(), aim: None, ours: self.our_occluded(rays, at_once), embree }
    }

    /// Shadow rays side by side.
    fn occluded_together(&self, name: &'static str, rays: &[Ray], aim: f64) -> Contest<'a> {
        let embree = self.both(|embree| {
            let packets = Batch::new(
                "rtcOccluded16",
                chunks(rays, Packet::all),
                |chunk: &mut Vec<Packet>| embree.occluded_packets(chunk),
                |chunk| chunk.iter().flat_map(Packet::are_blocked).map(f32::from).collect(),
            );
            let stream = Batch::new(
                "rtcOccluded1M",
                chunks(rays, SingleRay::all),
                |chunk: &mut Vec<SingleRay>| embree.occluded_stream(chunk),
                |chunk| chunk.iter().map(|ray| f32::from(ray.is_blocked())).collect(),
            );
            vec![Box::new(packets) as Box<dyn Traced + 'a>, Box::new(stream)]
        });
        Contest { name, rays: rays.len(), aim: Some(aim), ours: self.our_occluded(rays, CHUNK), embree }
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let path = scene_file();
    let scene = relume_io::load_scene(&path).map_err(|error| error.to_string())?.scene;
    let geometry = Geometry::new(&scene);
    let accel = Accel::from_triangles(&geometry.positions, &geometry.triangles, AlphaMasks::default());
    let [embree, robust] =
        [false, true].map(|robust| EmbreeScene::new(&geometry.positions, &geometry.triangles, robust));
    let (embree, robust) = (embree?, robust?);
    let rays = Rays::new(&scene, &geometry, &accel);
    let (version, natively) = embree.version();
    println!(
        "{}: {} triangles; Embree {version}, packets of up to {natively} rays natively",
        path.file_stem().unwrap_or_default().to_string_lossy(),
        accel.stats().triangles
    );
    let sides = Sides { accel: &accel, embree: &embree, robust: &robust };
    let contests = [
        sides.closest("primary, closest hit", &rays.primary, true, None),
        sides.occluded_together("towards one light, any hit", &rays.to_light, 0.8),
        sides.occluded("the same, one by one", &rays.to_light, true),
        sides.closest("cosine hemisphere, closest hit", &rays.hemisphere, false, Some(0.8)),
        sides.occluded("between visible points, any hit", &rays.between, false),
    ];
    let pools = [1, 2].map(pool);
    let [one, two] = pools;
    let pools = [one?, two?];
    println!("{}", turns::HEADER);
    for mut contest in contests {
        println!("{}", contest.run(&pools)?);
    }
    Ok(())
}

fn pool(threads: usize) -> Result<ThreadPool, String> {
    ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| error.to_string())
}
