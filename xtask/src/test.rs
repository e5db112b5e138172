//! `cargo xtask test`: says what the tests find on this machine, then runs them all.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};

use crate::workspace;

/// The folder of larger scenes that some tests read, where there is one: `RELUME_SCENES`, or
/// `../shared/scenes` beside the workspace.
fn shared_scenes() -> Option<PathBuf> {
    let named = std::env::var_os("RELUME_SCENES").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| workspace::root().join("../shared/scenes"));
    folder.canonicalize().ok().filter(|folder| folder.is_dir())
}

/// Runs the tests of the whole workspace, or of the packages that `arguments` name; they go on to `cargo test`.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    let mut tests = workspace::cargo();
    tests.arg("test");
    // cargo takes --workspace over any package named beside it.
    if !arguments.iter().any(|argument| argument.starts_with("-p") || argument.starts_with("--package")) {
        tests.arg("--workspace");
    }
    tests.args(arguments);
    match shared_scenes() {
        Some(folder) => {
            println!("found: shared scenes in {}", folder.display());
            tests.env("RELUME_SCENES", folder);
        }
        None => println!(
            "skipped: tests on the shared scenes; set RELUME_SCENES to the folder that holds sponza.glb"
        ),
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
