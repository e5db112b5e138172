//! Developer tasks. `cargo xtask --help` lists them.

mod scenes;
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
    /// Make the demo scene in assets/.
    Scenes {
        /// Write nothing; fail where the committed file differs.
        #[arg(long)]
        check: bool,
    },
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().task {
        Task::Scenes { check } => scenes::run(check),
    }
}
