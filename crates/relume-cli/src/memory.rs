//! How much memory the process has needed.

/// The most memory that was resident at any time, bytes; `None` where the system does not tell.
#[cfg(target_os = "linux")]
pub(crate) fn peak_resident_bytes() -> Option<u64> {
    peak_of_status(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// The most memory that was resident at any time, bytes; `None` where the system does not tell.
#[cfg(all(unix, not(target_os = "linux")))]
pub(crate) fn peak_resident_bytes() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    let peak = u64::try_from(getrusage(UsageWho::RUSAGE_SELF).ok()?.max_rss()).ok()?;
    // Apple counts in bytes, the others in KiB.
    Some(if cfg!(target_vendor = "apple") { peak } else { peak << 10 })
}

/// The most memory that was resident at any time, bytes; `None` where the system does not tell.
#[cfg(not(unix))]
pub(crate) fn peak_resident_bytes() -> Option<u64> {
    None
}

/// `VmHWM`, the high-water mark of resident memory, in the text of `/proc/self/status`.
#[cfg(target_os = "linux")]
fn peak_of_status(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn reads_the_high_water_mark() {
        assert_eq!(
            peak_of_status("VmPeak:\t 900 kB\nVmHWM:\t    1234 kB\nVmRSS:\t 7 kB\n"),
            Some(1234 << 10)
        );
        assert_eq!(peak_of_status("VmRSS:\t 7 kB\n"), None);
    }

    #[test]
    fn rises_with_memory_in_use() {
        let before = peak_resident_bytes().unwrap();
        let block = vec![1_u8; 64 << 20];
        let after = peak_resident_bytes().unwrap();
        assert!(block.iter().map(|&byte| u64::from(byte)).sum::<u64>() == 64 << 20);
        assert!(after >= 64 << 20 && after >= before, "{before} {after}");
    }
}
