//! The window, without a display: what can be done in it, and what comes of it.

mod edits;
mod files;
mod pictures;
mod support;
