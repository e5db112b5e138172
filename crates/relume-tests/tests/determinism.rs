//! The same input and seed give the same bytes, whatever the number of threads.

use std::sync::Arc;

use relume::glam::Vec3;
use relume::relight::RelightSettings;
use relume::scene::EnvironmentMap;
use relume::transfer::{Encoding, Multibounce, RowMethod, Selection, Settings};
use relume::{LightKind, LightRig};
use relume_tests::prepared::{prepare, relight_afresh, tiny};
use relume_tests::scenes::{TestScene, court, hall, metal, omni, rig, spot};

fn lights() -> LightRig {
    rig([
        omni(Vec3::new(2.6, 2.2, 2.6), Vec3::new(10.0, 8.0, 6.0), 0.0),
        omni(Vec3::new(3.3, 0.9, 1.0), Vec3::splat(2.0), 0.2),
        spot(Vec3::new(3.2, 2.6, 3.4), Vec3::new(1.6, 1.3, 1.7), Vec3::splat(50.0), (10.0, 20.0)),
        LightKind::Distant { direction: Vec3::new(0.2, -1.0, 0.1), irradiance: Vec3::ONE, angle: 0.5 },
    ])
}

/// The cache's bytes, and the pixels of a relit frame.
fn outcome(threads: usize, settings: Settings) -> (Vec<u8>, Vec<Vec3>) {
    outcome_of(threads, &hall(metal(0.4)), &lights(), settings)
}

fn outcome_of(
    threads: usize,
    built: &TestScene,
    lights: &LightRig,
    settings: Settings,
) -> (Vec<u8>, Vec<Vec3>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        let transfer = Arc::new(prepare(built, settings));
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let path = folder.path().join("shot.relume");
        transfer.save(&path).expect("a folder that can be written");
        let layers = relight_afresh(&transfer, lights, &RelightSettings::default());
        let pixels = [layers.direct.pixels, layers.indirect.pixels].concat();
        (std::fs::read(&path).expect("the file just written"), pixels)
    })
}

#[test]
fn threads_change_no_byte() {
    let ways = [
        tiny(),
        Settings { encoding: Encoding::HaarRows, ..tiny() },
        Settings { encoding: Encoding::HaarBlocks, selection: Some(Selection::Prior), ..tiny() },
        Settings { rows: RowMethod::Paper, ..tiny() },
        Settings { multibounce: Multibounce::Photon, ..tiny() },
    ];
    for settings in ways {
        let one = outcome(1, settings.clone());
        for threads in [2, 3] {
            let other = outcome(threads, settings.clone());
            assert!(one.0 == other.0, "{threads} threads change the cache of {settings:?}");
            assert!(one.1 == other.1, "{threads} threads change the image of {settings:?}");
        }
    }
}

/// The same under the sky, by a map with a sun in it.
#[test]
fn threads_change_no_byte_of_an_open_scene() {
    let (width, height) = (64, 32);
    let texel = |i: usize| if i == 300 { Vec3::splat(4000.0) } else { Vec3::new(0.1, 0.2, (i % 7) as f32) };
    let map = EnvironmentMap::new("sky", width, height, (0..width * height).map(texel).collect());
    let map = Some(Arc::new(map.expect("radiance")));
    let dome = rig([LightKind::Dome { map, intensity: Vec3::ONE, rotation: 20.0 }]);
    for multibounce in [Multibounce::Iterated, Multibounce::Photon] {
        let settings = Settings { multibounce, error: Some(0.1), ..tiny() };
        let [one, other] = [1, 3].map(|threads| outcome_of(threads, &court(), &dome, settings.clone()));
        assert!(one.0 == other.0, "threads change the cache");
        assert!(
            one.1 == other.1 && one.1.iter().any(|pixel| *pixel != Vec3::ZERO),
            "threads change the image"
        );
    }
}

#[test]
fn another_seed_gives_other_bytes_of_like_length() {
    // what single blocks are worth is swayed by noise: lengths vary by 0.8% from seed to seed, which evens out over three
    let settings = |seed| Settings { seed, size: (96, 72), gather: 4096, ..tiny() };
    let all: Vec<_> = (0..6).map(|seed| outcome(2, settings(seed))).collect();
    for (earlier, a) in all.iter().enumerate() {
        assert!(all[earlier + 1..].iter().all(|b| a.0 != b.0 && a.1 != b.1));
    }
    let length = |seeds: &[(Vec<u8>, Vec<Vec3>)]| seeds.iter().map(|seed| seed.0.len() as f64).sum::<f64>();
    let ratio = length(&all[..3]) / length(&all[3..]);
    println!("the lengths are as {ratio} to 1");
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    let lengths = all.iter().map(|seed| seed.0.len());
    let (shortest, longest) = (lengths.clone().min().unwrap_or(0), lengths.max().unwrap_or(0));
    assert!(longest as f64 / (shortest as f64) < 1.03, "{shortest} to {longest} bytes");
}
