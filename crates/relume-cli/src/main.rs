//! The `relume` command: prepares a shot, relights it, and judges it by a path tracer.
//!
//! Thin over the libraries: a command reads its inputs, calls one stage, and writes what came out. Results go to
//! stdout, everything else to stderr. Exit status 0, 1 (the job failed), 2 (bad input or usage) or 130 (interrupted).

mod arguments;
mod commands;
mod console;
mod interrupt;
mod memory;
mod output;
mod progress;
mod report;
mod scene_file;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use relume::Result;

use commands::{bench, compare, demo, info, merge, prepare, reference, relight, view};
use console::Console;

/// Relights a fixed shot with full global illumination while the lights move.
///
/// A scene and a camera are prepared once, which takes minutes; after that, every change of any light gives the image
/// with soft shadows and all bounces of indirect light in a fraction of a second.
#[derive(Parser)]
#[command(name = "relume", version, propagate_version = true, max_term_width = 100, after_help = EXAMPLE)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
    /// Say nothing on stderr but warnings and errors.
    #[arg(long, short, global = true)]
    quiet: bool,
}

const EXAMPLE: &str = "\
The whole job in one go:
  relume demo
Step by step:
  relume prepare assets/arcade.glb -o arcade.relume
  relume relight arcade.relume --rig assets/rigs/arcade.toml -o arcade.png

Exit status: 0, 1 (the job failed), 2 (bad input or usage), 130 (interrupted).";

#[derive(Subcommand)]
enum Command {
    Prepare(prepare::Arguments),
    Merge(merge::Arguments),
    Relight(relight::Arguments),
    View(view::Arguments),
    Reference(reference::Arguments),
    Compare(compare::Arguments),
    Bench(bench::Arguments),
    Info(info::Arguments),
    Demo(demo::Arguments),
}

fn main() -> ExitCode {
    let line = CommandLine::parse();
    let console = Console::new(line.quiet);
    let outcome = run(&line.command, &console);
    // Also where the job was done before it could stop: a script that is interrupted must not go on.
    if interrupt::requested() {
        console.interrupted();
        return ExitCode::from(interrupt::STATUS);
    }
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console.error(&error);
            ExitCode::from(if error.is_bad_input() { 2 } else { 1 })
        }
    }
}

fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Prepare(arguments) => prepare::run(arguments, console),
        Command::Merge(arguments) => merge::run(arguments, console),
        Command::Relight(arguments) => relight::run(arguments, console),
        Command::View(arguments) => view::run(arguments, console),
        Command::Reference(arguments) => reference::run(arguments, console),
        Command::Compare(arguments) => compare::run(arguments, console),
        Command::Bench(arguments) => bench::run(arguments, console),
        Command::Info(arguments) => info::run(arguments, console),
        Command::Demo(arguments) => demo::run(arguments, console),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn every_example_is_a_command_line() {
        let top = CommandLine::command();
        let commands: Vec<_> = top.get_subcommands().chain([&top]).collect();
        assert_eq!(commands.len(), 10);
        for command in commands {
            let help = command.get_after_help().unwrap().to_string();
            let examples: Vec<_> = help.lines().filter(|line| line.starts_with("  relume ")).collect();
            assert!(!examples.is_empty(), "{}", command.get_name());
            for example in examples {
                if let Err(error) = CommandLine::try_parse_from(example.split_whitespace()) {
                    panic!("{example}: {error}");
                }
            }
        }
        assert!(CommandLine::try_parse_from(["relume", "prepare", "a.glb", "--no-such"]).is_err());
    }
}
