//! What is said to people: results on stdout, the rest on stderr.

use std::io::{ErrorKind, IsTerminal, Write};

use relume::{Error, Progress, Result};

use crate::interrupt;
use crate::progress::StageProgress;

/// The two output streams. A reader that has gone away, as `| head` does, is no error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    quiet: bool,
    terminal: bool,
}

impl Console {
    /// With `quiet`, only warnings, errors and results are said.
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet, terminal: std::io::stderr().is_terminal() }
    }

    /// A listener that shows how far long work is.
    pub(crate) fn progress(&self) -> StageProgress {
        StageProgress::new(self.quiet, self.terminal)
    }

    /// Does `work` as a stage of its own.
    ///
    /// # Errors
    /// What `work` returns; [`Error::Cancelled`], without any work, where the command was interrupted before.
    pub(crate) fn stage<T>(&self, name: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        if interrupt::requested() {
            return Err(Error::Cancelled);
        }
        let progress = self.progress();
        progress.stage(name, 1);
        work()
    }

    /// Something that may surprise and does not end the job.
    pub(crate) fn warning(&self, text: &str) {
        to_stderr(&format!("warning: {text}"));
    }

    /// Why the job ends.
    pub(crate) fn error(&self, error: &Error) {
        to_stderr(&format!("error: {error}"));
    }

    /// That the command was interrupted, and what that leaves.
    pub(crate) fn interrupted(&self) {
        to_stderr("error: interrupted; no file is left half written");
    }

    /// Something good to know.
    pub(crate) fn notice(&self, text: &str) {
        if !self.quiet {
            to_stderr(text);
        }
    }

    /// A result, followed by a line break.
    ///
    /// # Errors
    /// [`Error::Io`] where stdout cannot be written and its reader has not just gone away.
    pub(crate) fn result(&self, text: &str) -> Result<()> {
        let mut stdout = std::io::stdout().lock();
        match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
            Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::io("stdout", "write", error)),
            _ => Ok(()),
        }
    }

    /// One JSON object. Numbers that are not finite become `null`.
    ///
    /// # Errors
    /// As [`Self::result`].
    pub(crate) fn json(&self, value: &impl serde::Serialize) -> Result<()> {
        let text = serde_json::to_string_pretty(value)
            .map_err(|error| Error::io("stdout", "write", std::io::Error::other(error)))?;
        self.result(&text)
    }
}

/// A line on stderr; when nobody listens there, there is nobody to tell.
pub(crate) fn to_stderr(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
