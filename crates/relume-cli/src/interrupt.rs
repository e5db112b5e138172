//! Ctrl-C, and the system's request to end: the job is asked to stop, so that it takes its unfinished files away.

use std::sync::atomic::{AtomicBool, Ordering};

use relume::{Error, Progress, Result};

/// Exit status of a command that was interrupted, as shells expect it.
pub(crate) const STATUS: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on the first interrupt or request to terminate is answered by [`requested`], and a second one ends the process
/// at once, which may leave a hidden temporary file behind. To be called once, by commands that ask.
///
/// # Errors
/// [`Error::Io`] where the system does not take the handler.
pub(crate) fn listen() -> Result<()> {
    ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::Relaxed) {
            #[expect(clippy::exit, reason = "asked twice: what is left undone is what was asked for")]
            std::process::exit(i32::from(STATUS));
        }
    })
    .map_err(|error| Error::io("interrupts", "listen to", std::io::Error::other(error)))
}

/// Whether the job has been asked to stop.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Listens to work only to stop it.
pub(crate) struct Watch;

impl Progress for Watch {
    fn cancelled(&self) -> bool {
        requested()
    }
}
