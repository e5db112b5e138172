//! What a run was measured on.

use serde::Serialize;

/// The machine, as far as it tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Machine {
    /// Empty where the system does not tell.
    pub(crate) processor: String,
    /// Of the processor.
    pub(crate) architecture: &'static str,
    pub(crate) system: &'static str,
    /// The day on which the run began, UTC, as 2026-01-31.
    pub(crate) date: String,
    /// As many threads as are worth having.
    pub(crate) cores: usize,
    /// `null` where the system does not tell.
    pub(crate) memory_bytes: Option<u64>,
    /// Threads that wanted a core in the minute before the run, in the mean; what else runs disturbs times. `null` where the system does not tell.
    pub(crate) load: Option<f64>,
}

impl Machine {
    /// This one.
    pub(crate) fn here() -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        Self {
            processor: field(&read("/proc/cpuinfo"), "model name").unwrap_or_default().to_owned(),
            architecture: std::env::consts::ARCH,
            system: std::env::consts::OS,
            date: jiff::Timestamp::now().strftime("%Y-%m-%d").to_string(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: field(&read("/proc/meminfo"), "MemTotal").and_then(kibibytes),
            load: read("/proc/loadavg").split(' ').next().and_then(|load| load.parse().ok()),
        }
    }

    /// In words.
    pub(crate) fn sentence(&self) -> String {
        let processor = if self.processor.is_empty() { "an unknown processor" } else { &self.processor };
        let memory = self
            .memory_bytes
            .map_or_else(String::new, |bytes| format!(", {:.0} GiB", bytes as f64 / f64::from(1 << 30)));
        let cores = if self.cores == 1 { "one core".to_owned() } else { format!("{} cores", self.cores) };
        let load =
            self.load.map_or_else(String::new, |load| format!(", under a load of {load:.1} when it began"));
        format!("{processor}, {cores}{memory}, {} {}, {}{load}", self.system, self.architecture, self.date)
    }
}

/// The first value called `name` in lines of `name : value`.
fn field<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let mut fields = text.lines().filter_map(|line| line.split_once(':'));
    fields.find(|(key, _)| key.trim() == name).map(|(_, value)| value.trim())
}

fn kibibytes(text: &str) -> Option<u64> {
    let count: u64 = text.strip_suffix("kB")?.trim().parse().ok()?;
    count.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_s_tables_are_read() {
        let table = "processor\t: 0\nmodel name\t: Some CPU @ 2 GHz\nMemTotal:       2048 kB\n";
        assert_eq!(field(table, "model name"), Some("Some CPU @ 2 GHz"));
        assert_eq!(field(table, "MemTotal").and_then(kibibytes), Some(2 << 20));
        assert_eq!(field(table, "model"), None);
        assert_eq!(kibibytes("many kB"), None);
    }

    #[test]
    fn a_machine_is_told_in_words() {
        let machine = Machine {
            processor: "Some CPU".into(),
            architecture: "x86_64",
            system: "linux",
            date: "2026-01-31".into(),
            cores: 2,
            memory_bytes: Some(24 << 30),
            load: Some(0.25),
        };
        assert_eq!(
            machine.sentence(),
            "Some CPU, 2 cores, 24 GiB, linux x86_64, 2026-01-31, under a load of 0.2 when it began"
        );
        let unknown =
            Machine { processor: String::new(), memory_bytes: None, cores: 1, load: None, ..machine };
        assert_eq!(unknown.sentence(), "an unknown processor, one core, linux x86_64, 2026-01-31");
    }
}
