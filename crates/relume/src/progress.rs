//! How long work reports on itself and is asked to stop.

/// A listener to long work. `()` listens to nothing.
pub trait Progress: Sync {
    /// A new stage begins that has `steps` steps. The stage before it is over.
    fn stage(&self, name: &str, steps: u64) {
        let _ = (name, steps);
    }

    /// `steps` more steps of the current stage are done. Called from any thread.
    fn advance(&self, steps: u64) {
        let _ = steps;
    }

    /// Something good to know about the work.
    fn notice(&self, text: &str) {
        let _ = text;
    }

    /// Asked often; `true` ends the work with [`crate::Error::Cancelled`].
    fn cancelled(&self) -> bool {
        false
    }
}

impl Progress for () {}
