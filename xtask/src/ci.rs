//! `cargo xtask ci`: every check of the project in order, each with its time.

use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};

use crate::{deny, scenes, structure, test, workspace};

fn cargo(arguments: &[&str]) -> Result<()> {
    succeed(workspace::cargo().args(arguments))
}

/// Of everything: the window, and the benchmark beside Embree, which need not be linked to be checked.
fn clippy() -> Result<()> {
    let what =
        ["clippy", "--workspace", "--all-targets", "--features", "relume-tests/embree,relume-cli/viewer"];
    cargo(&[&what[..], &["--quiet", "--", "-D", "warnings"]].concat())
}

fn docs() -> Result<()> {
    let mut command = workspace::cargo();
    succeed(command.args(["doc", "--workspace", "--no-deps", "--quiet"]).env("RUSTDOCFLAGS", "-D warnings"))
}

fn succeed(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot run {command:?}"))?;
    if !status.success() {
        bail!("{command:?} failed ({status})");
    }
    Ok(())
}

/// Runs the checks, the tests last; the first failure ends the run. `checks_only` leaves the tests out.
pub(crate) fn run(checks_only: bool) -> Result<()> {
    type Step = (&'static str, fn() -> Result<()>);
    let steps: [Step; 7] = [
        ("fmt", || cargo(&["fmt", "--all", "--check"])),
        ("structure", structure::run),
        ("clippy", clippy),
        ("doc", docs),
        ("scenes", || scenes::run(true)),
        ("deny", deny::run),
        ("test", || test::run(&[])),
    ];
    let kept = steps.len() - usize::from(checks_only);
    for (name, step) in &steps[..kept] {
        println!("{name}: started");
        let start = Instant::now();
        step().with_context(|| format!("{name} failed"))?;
        println!("{name}: passed in {:.1} s", start.elapsed().as_secs_f64());
    }
    Ok(())
}
