//! The scripts of `docs/FARM.md`, on a Slurm where there is one.

use std::process::Command;

use crate::support::{Workplace, shared};

/// The page's blocks of shell code, in order.
fn scripts() -> Vec<String> {
    let page = std::fs::read_to_string(shared("../docs/FARM.md")).unwrap();
    let blocks = page.split("```bash\n").skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

fn slurm_is_up() -> bool {
    let nodes = Command::new("sinfo").args(["--noheader", "--format=%T"]).output();
    nodes.is_ok_and(|nodes| {
        nodes.status.success()
            && ["idle", "mix"].iter().any(|up| String::from_utf8_lossy(&nodes.stdout).contains(up))
    })
}

#[test]
fn the_page_of_the_farm_runs_on_slurm() {
    let scripts = scripts();
    let [shard, merge, submit] = &scripts[..] else { panic!("{} scripts", scripts.len()) };
    if !slurm_is_up() {
        println!("skipped: the_page_of_the_farm_runs_on_slurm, for want of a Slurm with a node");
        return;
    }
    let work = Workplace::new();
    let smaller = |script: &str, from: &str, to: &str| {
        assert!(script.contains(from), "no `{from}` in {script}");
        script.replace(from, to)
    };
    let one = |script: &str| smaller(script, "--cpus-per-task=16", "--cpus-per-task=1");
    work.write("shard.sh", one(shard).as_bytes());
    work.write("merge.sh", one(merge).as_bytes());
    let submit = smaller(&smaller(submit, "1920x1080", "48x36"), "shot.glb", "room.gltf");
    let submit = smaller(&submit, "SHARDS=8", "SHARDS=2");
    let submit = smaller(&submit, "shard.sh", "shard.sh --gather 1024 --quality draft");
    let folder = std::path::Path::new(env!("CARGO_BIN_EXE_relume")).parent().unwrap();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap());
    let ran =
        Command::new("bash").current_dir(work.path(".")).env("PATH", path).args(["-euc", &submit]).output();
    let ran = ran.unwrap();
    let logs = std::fs::read_dir(work.path(".")).unwrap().filter_map(|entry| {
        let path = entry.unwrap().path();
        let is_log = path.extension().is_some_and(|ending| ending == "out");
        is_log.then(|| std::fs::read_to_string(path).unwrap())
    });
    let logs: Vec<String> = logs.collect();
    assert!(ran.status.success(), "{} {logs:?}", String::from_utf8_lossy(&ran.stderr));
    assert!(
        logs.iter().any(|log| log.contains("1 of 2")) && logs.iter().any(|log| log.contains("2 of 2")),
        "{logs:?}"
    );
    let merged = work.read("shot.relume");
    let small = ["--size", "48x36", "--gather", "1024", "--quality", "draft"];
    work.succeed(&[&["prepare", "room.gltf", "-o", "alone.relume"][..], &small].concat());
    assert!(merged == work.read("alone.relume"), "other bytes than of one run");
}
