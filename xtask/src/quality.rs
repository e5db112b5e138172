//! `cargo xtask quality`: builds and runs the program in `crates/relume-tests` that measures quality.

use anyhow::{Context, Result, bail};

use crate::workspace;

/// Runs it with `arguments`, in the root of the workspace.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    let mut command = workspace::cargo();
    command.args(["run", "--release", "--quiet", "-p", "relume-tests", "--bin", "quality", "--"]);
    let status = command.args(arguments).status().context("cannot run cargo run")?;
    if !status.success() {
        bail!("the measurement failed ({status})");
    }
    Ok(())
}
