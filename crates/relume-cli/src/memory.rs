//! How much memory the process may take, and how much it has needed.

use clap::Args;
use relume::{Error, Preparation, Result};

use crate::report::bytes;

/// The least that can be asked for: no scene is prepared in less.
const LEAST: f64 = (64_u64 << 20) as f64;
/// And the most: a pebibyte.
const MOST: f64 = (1_u64 << 50) as f64;

/// `--memory`.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// Memory to get by with, as 4GiB or 1500MB: where it is short, fewer threads work at once, which takes longer and changes no byte of the result; where it is far too
    /// short, the job is refused before it begins [default: no limit; at default settings about 0.4 GB a thread beside 0.8 GB].
    #[arg(long = "memory", value_name = "SIZE", allow_negative_numbers = true, value_parser = memory_size)]
    pub(crate) bytes: Option<u64>,
}

impl Limit {
    /// The preparation within the limit.
    ///
    /// # Errors
    /// [`Error::Setting`] where reading the scene has taken more already.
    pub(crate) fn of(self, preparation: Preparation<'_>) -> Result<Preparation<'_>> {
        let Some(limit) = self.bytes else { return Ok(preparation) };
        match peak_resident_bytes() {
            Some(peak) if peak > limit => Err(Error::Setting(format!(
                "reading the scene has taken {} of memory, and --memory allows {}; allow more, or use a smaller scene",
                bytes(peak),
                bytes(limit)
            ))),
            _ => Ok(preparation.memory_limit(limit)),
        }
    }

    /// What was needed at most, and of how much.
    pub(crate) fn told(self, peak: Option<u64>) -> String {
        let peak = peak.map_or("not known".to_owned(), bytes);
        match self.bytes {
            Some(limit) => format!("{peak}, of {} that were allowed", bytes(limit)),
            None => peak,
        }
    }
}

/// A number of bytes with its unit: `4GiB`, `1500 MB`, `1.5G`. `K`, `M`, `G` and `T` alone are of 1024, as those with `iB`.
fn memory_size(text: &str) -> Result<u64, String> {
    const MEND: &str = "write a number and its unit, as 4GiB or 1500MB";
    let unit_at = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(unit_at);
    let power = |base: f64, letter: &str| {
        ["", "K", "M", "G", "T"]
            .iter()
            .position(|&known| known == letter)
            .map(|power| base.powi(power as i32))
    };
    let unit = unit.to_ascii_uppercase();
    let scale = match unit.strip_suffix("IB") {
        Some("") => None,
        Some(letter) => power(1024.0, letter),
        None => match unit.strip_suffix('B') {
            Some(letter) => power(1000.0, letter),
            None if unit.is_empty() => None,
            None => power(1024.0, &unit),
        },
    };
    let number = number.trim_end().parse().ok().filter(|number: &f64| number.is_finite());
    let bytes = number.zip(scale).map(|(number, scale)| number * scale).ok_or(MEND)?;
    if !(LEAST..=MOST).contains(&bytes) {
        return Err("must be from 64MiB to 1024TiB".to_owned());
    }
    Ok(bytes as u64)
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_a_number_and_a_unit() {
        for (text, bytes) in [
            ("4GiB", 4 << 30),
            ("4 GiB", 4 << 30),
            ("4gib", 4 << 30),
            ("4G", 4 << 30),
            ("1.5GiB", 3 << 29),
            ("1500MB", 1_500_000_000),
            ("1500M", 1500 << 20),
            ("2GB", 2_000_000_000),
            ("70000KiB", 70_000 << 10),
            ("80000kB", 80_000_000),
            ("100000000B", 100_000_000),
            ("1TiB", 1 << 40),
            ("64MiB", 64 << 20),
        ] {
            assert_eq!(memory_size(text), Ok(bytes), "{text}");
        }
        for wrong in
            ["", "4", "GiB", "4iB", "4GiBs", "4 G B", "four GiB", "nanGiB", "infGiB", "4PiB", "4,5GiB"]
        {
            let told = memory_size(wrong).unwrap_err();
            assert!(told.contains("a number and its unit"), "{wrong}: {told}");
        }
        for wrong in ["0GiB", "-4GiB", "63MiB", "64MB", "1025TiB", "9999999TiB"] {
            let told = memory_size(wrong).unwrap_err();
            assert!(told.contains("from 64MiB"), "{wrong}: {told}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn reads_the_high_water_mark() {
        assert_eq!(
            peak_of_status("VmPeak:\t 900 kB\nVmHWM:\t    1234 kB\nVmRSS:\t 7 kB\n"),
            Some(1234 << 10)
        );
        assert_eq!(peak_of_status("VmRSS:\t 7 kB\n"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn rises_with_memory_in_use() {
        let before = peak_resident_bytes().unwrap();
        let block = vec![1_u8; 64 << 20];
        let after = peak_resident_bytes().unwrap();
        assert!(block.iter().map(|&byte| u64::from(byte)).sum::<u64>() == 64 << 20);
        assert!(after >= 64 << 20 && after >= before, "{before} {after}");
    }
}
