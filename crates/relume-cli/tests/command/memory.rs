//! A preparation within a limit of memory.

use serde_json::Value;

use crate::support::{Workplace, numbers};

/// Blocks of 256 rows of 16,384 entries: 17 megabytes each, next to which this scene is small.
const BLOCKS: [&str; 7] = ["--size", "32x24", "--gather", "16384", "--quality", "glance", "--no-checkpoint"];

/// The megabytes that a refusal asks for.
fn asked_for(stderr: &str) -> u64 {
    let (_, rest) = stderr.split_once("needs about ").unwrap_or_else(|| panic!("{stderr}"));
    rest.split_once(" MB").unwrap().0.parse().unwrap()
}

/// Prepares without a limit, with one that is too small, and with what that one's refusal asks for. Returns the peaks of the first and the last and
/// the limit of the last, bytes.
fn with_and_without(work: &Workplace, arguments: &[&str], too_small: &str) -> [f64; 3] {
    let keys = ["peak_rss_bytes", "memory_limit_bytes"];
    let prepare = [&["prepare"], arguments].concat();
    let free = work.json(&[&prepare[..], &["-o", "free.relume"]].concat(), &keys);
    assert_eq!(free["memory_limit_bytes"], Value::Null);
    let narrow = [&prepare[..], &["-o", "narrow.relume"]].concat();
    let refused = [&narrow[..], &["--memory", too_small]].concat();
    work.refused(&refused, 2, "give it more (--memory), or lower --size or --gather");
    assert!(!work.path("narrow.relume").exists() && !work.path("narrow.relume-blocks").exists());
    let limit = format!("{}MB", asked_for(&work.run(&refused).stderr));
    let narrow = work.json(&[&narrow[..], &["--memory", &limit]].concat(), &keys);
    assert!(work.read("free.relume") == work.read("narrow.relume"), "other bytes than without a limit");
    let [free, narrow] = [free, narrow].map(|figures| figures["peak_rss_bytes"].as_f64());
    let limit = limit.trim_end_matches("MB").parse::<f64>().unwrap() * 1e6;
    println!("{free:?} without a limit, {narrow:?} of {limit}");
    // a system that does not tell has no peaks
    [free.unwrap_or(f64::INFINITY), narrow.unwrap_or(0.0), limit]
}

#[test]
fn a_limit_changes_the_memory_and_no_byte() {
    let work = Workplace::new();
    let arguments = [&["room.gltf", "--threads", "8"], &BLOCKS[..]].concat();
    let [free, narrow, limit] = with_and_without(&work, &arguments, "64MiB");
    assert!(narrow <= limit && limit < free, "{narrow} of {limit}, {free} without");
}

#[test]
fn shards_and_merging_keep_within_a_limit() {
    let work = Workplace::new();
    let small = ["--size", "32x24", "--gather", "1024", "--quality", "glance"];
    work.succeed(&[&["prepare", "room.gltf", "-o", "alone.relume", "--no-checkpoint"], &small[..]].concat());
    for shard in ["1/2", "2/2"] {
        let figures = work.json(
            &[&["prepare", "room.gltf", "--shard", shard, "--memory", "1GiB"], &small[..]].concat(),
            &[],
        );
        numbers(&figures, &["memory_limit_bytes"]);
    }
    let merge =
        ["merge", "room.gltf", "room.1-of-2.relume-blocks", "room.2-of-2.relume-blocks", "-o", "room.relume"];
    let figures = work.json(&[&merge[..], &["--memory", "1GiB"]].concat(), &[]);
    assert_eq!(numbers(&figures, &["memory_limit_bytes"]), [f64::from(1 << 30)]);
    assert!(work.read("alone.relume") == work.read("room.relume"));
    // more rows than 64 megabytes hold
    let large = ["--size", "640x480", "--gather", "65536", "--memory", "100MB"];
    let shard = [&["prepare", "room.gltf", "-o", "large.relume", "--shard", "1/2"], &large[..]].concat();
    work.refused(&shard, 2, "give it more (--memory)");
    assert!(!work.path("large.1-of-2.relume-blocks").exists());
}

#[test]
fn a_size_that_is_none_is_told() {
    let work = Workplace::new();
    for size in ["4", "much", "4XiB"] {
        work.refused(
            &["prepare", "room.gltf", "--memory", size],
            2,
            "write a number and its unit, as 4GiB or 1500MB",
        );
    }
    work.refused(&["prepare", "room.gltf", "--memory", "1MB"], 2, "must be from 64MiB");
}

/// Blocks of 268 megabytes in a scene of a quarter of a million triangles: the peak stays below a limit that it passes where it may.
#[test]
#[cfg(target_os = "linux")]
fn a_real_scene_keeps_within_a_limit() {
    let scene =
        std::env::var_os("RELUME_SCENES").map(|folder| std::path::Path::new(&folder).join("sponza.glb"));
    let Some(scene) = scene.filter(|scene| scene.is_file()) else {
        println!("skipped: a_real_scene_keeps_within_a_limit, for want of RELUME_SCENES");
        return;
    };
    let work = Workplace::new();
    let settings =
        ["--size", "64x48", "--gather", "65536", "--quality", "glance", "--no-glossy", "--threads", "3"];
    let arguments = [&[scene.to_str().unwrap(), "--no-checkpoint"], &settings[..]].concat();
    let [free, narrow, limit] = with_and_without(&work, &arguments, "600MB");
    assert!(narrow <= limit && limit < 0.8 * free, "{narrow} of {limit}, {free} without");
}
