//! The one error type of the library.

use std::path::{Path, PathBuf};

/// What can go wrong, told in one sentence that names the file, the place and the mend.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be used as it is. The message names the place in it and how to mend it.
    #[error("{}: {message}", path.display())]
    File {
        /// The file at fault.
        path: PathBuf,
        /// The place in the file, what is wrong there, and the mend.
        message: String,
    },
    /// A setting or argument outside its range.
    #[error("{0}")]
    Setting(String),
    /// The operating system refused to read or write a file.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file at fault.
        path: PathBuf,
        /// "read", "write", ...
        action: &'static str,
        /// The system's own words.
        source: std::io::Error,
    },
    /// The caller asked to stop through [`crate::Progress::cancelled`].
    #[error("cancelled")]
    Cancelled,
}

/// Shorthand for results of this library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// A [`Error::File`] from its parts.
    pub fn file(path: impl AsRef<Path>, message: impl Into<String>) -> Self {
        Self::File { path: path.as_ref().to_owned(), message: message.into() }
    }

    /// A [`Error::Io`] from its parts.
    pub fn io(path: impl AsRef<Path>, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), action, source }
    }

    /// True where the input or the settings are at fault (exit status 2), false where the job failed (1).
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::File { .. } | Self::Setting(_) => true,
            Self::Io { action, source, .. } => {
                *action == "read" && source.kind() != std::io::ErrorKind::Interrupted
            }
            Self::Cancelled => false,
        }
    }
}
