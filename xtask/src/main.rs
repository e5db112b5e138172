//! Developer tasks. `cargo xtask --help` lists them.

mod ci;
mod deny;
mod measurement;
mod scenes;
mod structure;
mod test;
mod workspace;

use clap::{Parser, Subcommand};

/// Developer tasks of Relume.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Run all tests, saying what they find on this machine and what they skip.
    Test {
        /// Passed on to `cargo test`; `-p NAME` tests one crate instead of all.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Measure how far relit images are from converged path tracing; `cargo xtask quality --help` says how.
    #[command(disable_help_flag = true)]
    Quality {
        /// Passed on to the measuring program.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Measure how much indirect light flickers while a spot moves; `cargo xtask flicker --help` says how.
    #[command(disable_help_flag = true)]
    Flicker {
        /// Passed on to the measuring program.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Measure how time, memory and bytes grow with pixels, gather samples and triangles; `cargo xtask bench --help` says how.
    #[command(disable_help_flag = true)]
    Bench {
        /// Passed on to the measuring program.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Make the demo scene in assets/.
    Scenes {
        /// Write nothing; fail where the committed file differs.
        #[arg(long)]
        check: bool,
    },
    /// Check what no compiler does: direction of dependencies, paths in docs, lengths, words.
    Structure,
    /// Check licences, sources and known vulnerabilities of dependencies.
    Deny,
    /// Run every check in order, then the tests.
    Ci {
        /// Leave out the tests.
        #[arg(long)]
        checks_only: bool,
    },
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().task {
        Task::Test { arguments } => test::run(&arguments),
        Task::Quality { arguments } => measurement::run("quality", &arguments),
        Task::Flicker { arguments } => measurement::run("flicker", &arguments),
        Task::Bench { arguments } => measurement::run_beside_relume("bench", &arguments),
        Task::Scenes { check } => scenes::run(check),
        Task::Structure => structure::run(),
        Task::Deny => deny::run(),
        Task::Ci { checks_only } => ci::run(checks_only),
    }
}
