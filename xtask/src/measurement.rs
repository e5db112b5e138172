//! `cargo xtask quality` and `cargo xtask flicker`: build and run the programs in `crates/relume-tests` that measure.

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
