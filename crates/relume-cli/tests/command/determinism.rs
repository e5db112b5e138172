use crate::sequence::moving;
use crate::support::{SMALL, Workplace};

#[test]
fn the_number_of_threads_changes_no_byte() {
    let work = Workplace::new();
    work.write("moving.toml", moving().as_bytes());
    for threads in ["1", "2"] {
        let name = |ending: &str| format!("{threads}{ending}");
        let with_threads = |arguments: &[&str]| {
            work.succeed(&[arguments, &["--threads", threads]].concat());
        };
        let (cache, relit, truth) = (name(".relume"), name(".exr"), name("-truth.exr"));
        with_threads(&[&["prepare", "room.gltf", "-o", &cache][..], &SMALL].concat());
        with_threads(&["relight", &cache, "--rig", "rig.toml", "-o", &relit, "--per-light"]);
        let frame = name("-frame.#.exr");
        with_threads(&["relight", &cache, "--animate", "moving.toml", "--frames", "2..3", "-o", &frame]);
        let reference = ["reference", "room.gltf", "--rig", "rig.toml", "-o", &truth];
        with_threads(&[&reference[..], &["--spp", "8", "--size", "32x24"]].concat());
    }
    for ending in [".relume", ".exr", "-frame.2.exr", "-frame.3.exr", "-truth.exr"] {
        let [one, two] = ["1", "2"].map(|threads| work.read(&format!("{threads}{ending}")));
        assert!(one == two, "*{ending} depends on the number of threads");
    }
}

#[test]
fn another_seed_changes_the_cache() {
    let work = Workplace::new();
    for seed in ["0", "1"] {
        let cache = format!("{seed}.relume");
        work.succeed(&[&["prepare", "room.gltf", "-o", &cache, "--seed", seed][..], &SMALL].concat());
    }
    assert!(work.read("0.relume") != work.read("1.relume"));
}
