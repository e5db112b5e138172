//! The command as people run it: every subcommand end to end on a small room, and every refusal.

mod determinism;
mod jobs;
mod refusals;
mod support;
