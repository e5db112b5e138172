//! Keeping a preparation within a limit of memory.
//!
//! What rows take by far outweighs the rest, and grows with the number of blocks that are made side by side: their number is what gives
//! (`workers.rs`). The other stages take what they take, by the settings: where that is too much, a preparation is refused before it begins,
//! by sizes (`needs.rs`), and again, by what is measured, before each large stage.

use crate::{Error, Result};

/// A refusal asks for more than was found to be needed, by one part in so many.
const TOLD_MORE: u64 = 16;

/// How much memory the process may take, if there is a limit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Memory {
    /// Bytes.
    limit: Option<u64>,
    /// What is in use at the least, by sizes, bytes: for systems that do not tell.
    counted: u64,
}

impl Memory {
    pub(super) fn new(limit: Option<u64>) -> Self {
        Self { limit, counted: 0 }
    }

    /// The same where so many more bytes are in use.
    pub(super) fn with(self, bytes: u64) -> Self {
        Self { counted: self.counted + bytes, ..self }
    }

    /// The limit, and what is in use, bytes; `None` without a limit.
    pub(super) fn limit_and_use(&self) -> Option<(u64, u64)> {
        self.limit.map(|limit| (limit, resident_bytes().unwrap_or(self.counted)))
    }

    /// Whether `more` bytes still fit.
    ///
    /// # Errors
    /// [`Error::Setting`] where they do not.
    pub(super) fn check(&self, more: u64) -> Result<()> {
        match self.limit_and_use() {
            Some((limit, used)) if used + more > limit => Err(too_little(used + more, limit)),
            _ => Ok(()),
        }
    }
}

/// Why nothing can be prepared within `limit` bytes where `needed` are needed.
pub(super) fn too_little(needed: u64, limit: u64) -> Error {
    // what is told must be enough at the next check as well: what is in use differs a little from run to run
    let told = needed + needed / TOLD_MORE + (8 << 20);
    Error::Setting(format!(
        "this preparation needs about {} MB of memory and may take {} MB; give it more (--memory), or lower --size or --gather",
        told.div_ceil(1_000_000),
        limit / 1_000_000
    ))
}

/// What of the process lies in memory now, bytes; `None` where the system does not tell.
#[cfg(target_os = "linux")]
pub fn resident_bytes() -> Option<u64> {
    resident_of_status(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// What of the process lies in memory now, bytes; `None` where the system does not tell.
#[cfg(not(target_os = "linux"))]
pub fn resident_bytes() -> Option<u64> {
    None
}

/// `VmRSS` in the text of `/proc/self/status`.
#[cfg(target_os = "linux")]
fn resident_of_status(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_told_with_both_figures() {
        assert!(Memory::new(None).check(u64::MAX).is_ok(), "without a limit");
        let memory = Memory::new(Some(1 << 44)).with(1 << 20);
        assert!(memory.check(1 << 43).is_ok());
        let told = memory.check(1 << 44).unwrap_err();
        assert!(told.is_bad_input());
        let told = told.to_string();
        assert!(told.contains("may take 17592186 MB; give it more (--memory)"), "{told}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn resident_memory_grows_with_what_is_used() {
        assert_eq!(resident_of_status("VmHWM:\t 9 kB\nVmRSS:\t    1234 kB\n"), Some(1234 << 10));
        let before = resident_bytes().unwrap();
        let block = vec![1_u8; 64 << 20];
        assert!(resident_bytes().unwrap() > before + (32 << 20));
        assert!(block.iter().all(|&byte| byte == 1));
    }
}
