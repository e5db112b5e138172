//! `cargo xtask test`: says what the tests find on this machine, then runs them all.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// The tests that read larger scenes, and which. A test runs for those of its scenes that are there.
const ON_LARGER_SCENES: [(&str, &[&str]); 6] = [
    (
        "shared_scenes_match_their_table",
        &[
            "sponza.glb",
            "cornell.glb",
            "still_life.glb",
            "hairball.glb",
            "temple.glb",
            "bunny_ground.glb",
            "horse_ground.glb",
        ],
    ),
    ("sponza_has_masks_and_tangents", &["sponza.glb"]),
    ("cornell_box_agrees_with_the_path_tracer", &["cornell.glb"]),
    ("sponza_agrees_with_the_path_tracer", &["sponza.glb"]),
    ("sponza_is_known_at_a_glance", &["sponza.glb"]),
    ("sponza_goes_through_every_stage", &["sponza.glb"]),
];

/// The folder of larger scenes that some tests read, where there is one: `RELUME_SCENES`, or
/// `../shared/scenes` beside the workspace.
fn shared_scenes() -> Option<PathBuf> {
    let named = std::env::var_os("RELUME_SCENES").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| workspace::root().join("../shared/scenes"));
    folder.canonicalize().ok().filter(|folder| folder.is_dir())
}

/// What there is of larger scenes in `folder`, and a line for each test that is skipped, in whole or in part, for want of
/// one.
fn told_of_scenes(folder: Option<&Path>) -> String {
    let is_there = |scene: &&str| folder.is_some_and(|folder| folder.join(scene).is_file());
    let mut scenes: Vec<&str> =
        ON_LARGER_SCENES.iter().flat_map(|(_, scenes)| *scenes).copied().filter(is_there).collect();
    scenes.sort_unstable();
    scenes.dedup();
    let mut lines = vec![match folder {
        None => "found: no larger scenes; set RELUME_SCENES to the folder that holds them".to_owned(),
        Some(folder) if scenes.is_empty() => {
            format!("found: none of the scenes that tests read in {}", folder.display())
        }
        Some(folder) => format!("found: {} in {}", scenes.join(", "), folder.display()),
    }];
    for (test, scenes) in ON_LARGER_SCENES {
        let missing: Vec<&str> = scenes.iter().copied().filter(|scene| !is_there(scene)).collect();
        let missed = if missing.len() == scenes.len() { "" } else { "part of " };
        if !missing.is_empty() {
            lines.push(format!("skipped: {missed}{test}, for want of {}", missing.join(", ")));
        }
    }
    lines.join("\n")
}

/// The states of the nodes of a Slurm, where one answers.
fn slurm_nodes() -> Option<String> {
    let nodes = Command::new("sinfo").args(["--noheader", "--format=%T"]).output().ok()?;
    nodes.status.success().then(|| String::from_utf8_lossy(&nodes.stdout).trim().to_owned())
}

/// What there is of a Slurm, or the test that is skipped for want of one.
fn told_of_slurm(nodes: Option<&str>) -> String {
    match nodes {
        Some(nodes) if ["idle", "mix"].iter().any(|up| nodes.contains(up)) => "found: a Slurm".to_owned(),
        _ => "skipped: the_page_of_the_farm_runs_on_slurm, for want of a Slurm with a node".to_owned(),
    }
}

/// Whether there is a desktop to try the window on, or the test that is skipped for want of one.
fn told_of_desktop(has_server: bool) -> &'static str {
    match has_server {
        true => "found: Xvfb, for a desktop without a screen",
        false => "skipped: a_light_is_dragged_on_a_desktop, for want of Xvfb",
    }
}

/// Runs the tests of the whole workspace, or of the packages that `arguments` name; they go on to `cargo test`.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    let mut tests = workspace::cargo();
    tests.arg("test");
    // cargo takes --workspace over any package named beside it.
    if !arguments.iter().any(|argument| argument.starts_with("-p") || argument.starts_with("--package")) {
        tests.args(["--workspace", "--features", "relume-cli/viewer"]);
    }
    tests.args(arguments);
    let folder = shared_scenes();
    println!("{}", told_of_scenes(folder.as_deref()));
    println!("{}", told_of_slurm(slurm_nodes().as_deref()));
    println!("{}", told_of_desktop(Command::new("Xvfb").arg("-help").output().is_ok()));
    if let Some(folder) = folder {
        tests.env("RELUME_SCENES", folder);
    }
    let demo = workspace::root().join("assets/arcade.glb");
    if !demo.is_file() {
        println!("made: assets/arcade.glb, which was missing");
        crate::scenes::run(false)?;
    }
    let status = tests.status().context("cannot run cargo test")?;
    if !status.success() {
        bail!("tests failed ({status})");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slurm_is_found_where_it_has_a_node() {
        assert!(told_of_slurm(Some("idle")).starts_with("found: "));
        for none in [None, Some(""), Some("down*")] {
            assert!(told_of_slurm(none).starts_with("skipped: the_page_of_the_farm"), "{none:?}");
        }
    }

    #[test]
    fn a_desktop_is_missed_by_the_name_of_its_test() {
        let tests =
            std::fs::read_to_string(workspace::root().join("crates/relume-cli/tests/desktop.rs")).unwrap();
        let name = told_of_desktop(false).strip_prefix("skipped: ").unwrap().split(',').next().unwrap();
        assert!(tests.contains(&format!("fn {name}()")), "{name}");
        assert!(told_of_desktop(true).starts_with("found: "));
    }

    #[test]
    fn what_is_there_and_what_is_skipped_for_want_of_what() {
        let folder = std::env::temp_dir().join(format!("relume-scenes-{}", std::process::id()));
        std::fs::create_dir(&folder).unwrap();
        let told = || told_of_scenes(Some(&folder));
        let skipped = |told: &str| -> Vec<String> {
            told.lines().filter(|line| line.starts_with("skipped: ")).map(str::to_owned).collect()
        };
        // a folder with other things in it is none of scenes
        std::fs::write(folder.join("lantern.glb"), "").unwrap();
        std::fs::create_dir(folder.join("sponza.glb")).unwrap();
        let none = told();
        assert!(none.starts_with("found: none of the scenes that tests read in "), "{none}");
        assert_eq!(skipped(&none), skipped(&told_of_scenes(None)));
        assert_eq!(skipped(&none).len(), ON_LARGER_SCENES.len());
        assert!(none.ends_with("skipped: sponza_goes_through_every_stage, for want of sponza.glb"), "{none}");

        std::fs::write(folder.join("temple.glb"), "").unwrap();
        std::fs::write(folder.join("cornell.glb"), "").unwrap();
        let some = told();
        let head = format!("found: cornell.glb, temple.glb in {}\n", folder.display());
        assert!(some.starts_with(&head), "{some}");
        assert_eq!(
            skipped(&some),
            [
                "skipped: part of shared_scenes_match_their_table, for want of sponza.glb, still_life.glb, hairball.glb, bunny_ground.glb, horse_ground.glb",
                "skipped: sponza_has_masks_and_tangents, for want of sponza.glb",
                "skipped: sponza_agrees_with_the_path_tracer, for want of sponza.glb",
                "skipped: sponza_is_known_at_a_glance, for want of sponza.glb",
                "skipped: sponza_goes_through_every_stage, for want of sponza.glb",
            ]
        );

        std::fs::remove_dir(folder.join("sponza.glb")).unwrap();
        for scene in ON_LARGER_SCENES[0].1 {
            std::fs::write(folder.join(scene), "").unwrap();
        }
        assert!(skipped(&told()).is_empty(), "{}", told());
        std::fs::remove_dir_all(folder).unwrap();
        assert!(told_of_scenes(None).starts_with("found: no larger scenes; set RELUME_SCENES"));
    }

    #[test]
    fn the_scenes_are_those_that_the_tests_name() {
        let sources =
            ["crates/relume-tests/tests/real_scenes.rs", "crates/relume-io/tests/import/shared_scenes.rs"]
                .map(|path| std::fs::read_to_string(workspace::root().join(path)).unwrap())
                .concat();
        for (test, scenes) in ON_LARGER_SCENES {
            assert!(sources.contains(&format!("fn {test}()")), "{test}");
            for scene in scenes {
                assert!(sources.contains(&format!("\"{scene}\"")), "{scene}");
            }
        }
        let named = sources.split('"').filter(|text| text.ends_with(".glb") && !text.contains('/'));
        for scene in named {
            assert!(ON_LARGER_SCENES.iter().any(|(_, scenes)| scenes.contains(&scene)), "{scene}");
        }
    }
}
