//! The command as people run it: every subcommand end to end on a small room, and every refusal.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod determinism;
mod examples;
mod farm;
mod jobs;
mod memory;
mod refusals;
mod sequence;
mod support;
#[cfg(unix)]
mod unfinished;
