//! The window, without a display: what can be done in it, and what comes of it.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod edits;
mod files;
mod motion;
mod pictures;
mod snapshots;
mod support;
