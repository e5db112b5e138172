//! One file a command.

pub(crate) mod bench;
pub(crate) mod compare;
pub(crate) mod demo;
pub(crate) mod info;
pub(crate) mod merge;
pub(crate) mod prepare;
pub(crate) mod reference;
pub(crate) mod relight;
pub(crate) mod view;
