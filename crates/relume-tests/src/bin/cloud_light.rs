//! How far bounced light on the gather cloud is from paths: what the bounce operator says, without the final gather.
//!
//! A line for each light of a rig, for the table in `docs/BENCHMARKS.md`.

use std::error::Error;
use std::path::PathBuf;

use clap::Parser;
use relume::Preparation;
use relume::glam::Vec3;
use relume::sample::{GatherSample, illuminate};
use relume::scene::Geometry;
use relume::trace::Accel;
use relume::transfer::{CloudBounces, Encoding, Multibounce, PhotonSettings, Settings};
use relume_tests::cloud_truth::{bounced_irradiance, unbiased_error};
use relume_tests::scenes::TestScene;
use serde::de::DeserializeOwned;

/// Measures irradiance at gather samples from light that has bounced, after all bounces, against paths whose noise is taken out.
#[derive(Parser)]
struct Arguments {
    /// The scene: .glb, .gltf or .obj.
    scene: PathBuf,
    /// Its lights, each judged alone.
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,
    /// Gather samples, a power of four.
    #[arg(long, default_value_t = 16_384)]
    gather: usize,
    /// How the operator is stored.
    #[arg(long, default_value = "low-rank", value_parser = named::<Encoding>)]
    encoding: Encoding,
    /// What it holds.
    #[arg(long, default_value = "iterated", value_parser = named::<Multibounce>)]
    multibounce: Multibounce,
    /// Photons to shoot.
    #[arg(long, default_value_t = 1_000_000)]
    photons: usize,
    /// Photons a row.
    #[arg(long, default_value_t = 2000)]
    photons_per_row: usize,
    /// Surfaces that a photon hits at most.
    #[arg(long)]
    photon_path: Option<u32>,
    /// Gather samples that are looked at, evenly over the cloud.
    #[arg(long, default_value_t = 512)]
    samples: usize,
    /// Paths for each of them, in either of two halves.
    #[arg(long, default_value_t = 512)]
    paths: u32,
}

fn named<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(text.into()).map_err(|error| error.to_string())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let scene = relume_io::load_scene(&arguments.scene)?.scene;
    let geometry = Geometry::new(&scene);
    let geometry = geometry.without_clear().unwrap_or(geometry);
    let accel = Accel::new(&scene, &geometry);
    let built = TestScene { scene, geometry, accel };
    let rig = relume_io::load_rig(&arguments.rig)?;
    let photons = PhotonSettings {
        count: arguments.photons,
        nearest: arguments.photons_per_row,
        path_length: arguments.photon_path,
    };
    let Arguments { gather, encoding, multibounce, .. } = arguments;
    // a small image: the cloud is denser where it looks, and the final gather is not asked for
    let size = (64, 48);
    let settings =
        Settings { size, gather, encoding, multibounce, photons, glossy: false, ..Settings::default() };
    let transfer = Preparation::new(&built.scene).settings(settings).run(&())?;
    println!(
        "{} bytes, {:.0} rays a gather sample",
        transfer.bounce.bytes(),
        transfer.report.rays_per_gather_sample
    );
    let step = (gather / arguments.samples.max(1)).max(1);
    let chosen: Vec<usize> = (0..gather).step_by(step).collect();
    let samples: Vec<GatherSample> = chosen.iter().map(|&index| transfer.cloud.samples[index]).collect();
    let bounces = CloudBounces::new(&transfer, &transfer.cloud);
    for light in &rig.lights {
        let halves = [1, 2].map(|seed| bounced_irradiance(&built, light, &samples, arguments.paths, seed));
        let direct = illuminate(&transfer.cloud, &built.accel, light).radiance;
        let reflected = bounces.sum_reflected(&transfer.bounce, &direct, None, 0.0).0;
        let albedo = |index: usize| transfer.cloud.samples[index].albedo.max(Vec3::splat(1e-6));
        let found: Vec<Vec3> = chosen.iter().map(|&index| reflected[index] / albedo(index)).collect();
        let sum = |light: &[Vec3]| light.iter().map(|rgb| f64::from(rgb.element_sum())).sum::<f64>();
        let carried = 2.0 * sum(&found) / (sum(&halves[0]) + sum(&halves[1]));
        println!("{}: off by {:.3}, carries {carried:.3}", light.name, unbiased_error(&found, &halves));
    }
    Ok(())
}
