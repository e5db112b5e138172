//! `cargo xtask quality`, `cargo xtask flicker` and `cargo xtask bench`: build and run the programs in `crates/relume-tests` that measure.

use anyhow::{Context, Result, bail};

use crate::workspace;

/// Runs the program `name` with `arguments`, in the root of the workspace.
pub(crate) fn run(name: &str, arguments: &[String]) -> Result<()> {
    let mut command = workspace::cargo();
    command.args(["run", "--release", "--quiet", "-p", "relume-tests", "--bin", name, "--"]);
    let status = command.args(arguments).status().context("cannot run cargo run")?;
    if !status.success() {
        bail!("the measurement failed ({status})");
    }
    Ok(())
}

/// The same of a program that runs `relume` itself, which is built beside it.
pub(crate) fn run_beside_relume(name: &str, arguments: &[String]) -> Result<()> {
    let mut command = workspace::cargo();
    command.args(["build", "--release", "--quiet", "-p", "relume-cli"]);
    if !command.status().context("cannot run cargo build")?.success() {
        bail!("relume cannot be built");
    }
    run(name, arguments)
}
