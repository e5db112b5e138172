//! How much memory a stretch of work has needed.

/// Sets the system's high-water mark back, where it lets us; elsewhere [`peak_resident_bytes`] counts from the start of
/// the process.
pub(crate) fn reset_peak() {
    // Linux only; see proc(5). What other systems refuse is no error.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// The most memory that was resident since [`reset_peak`], bytes; `None` where the system does not tell.
pub(crate) fn peak_resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}
