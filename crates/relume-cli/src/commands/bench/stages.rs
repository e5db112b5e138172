//! The stages of a frame beside what the machine could do.

use relume::Transfer;
use relume::relight::FrameStats;
use serde::Serialize;

use super::ceiling::Ceiling;
use super::median;
use crate::report::{bytes, count};

/// What a stage is bound by at best, and how much of it there is in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Load {
    /// Shadow rays.
    Rays(u64),
    /// Bytes read, and written; of operators all that is stored, also where some is culled.
    Bytes(u64),
}

/// One stage of a frame; medians.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Stage {
    name: &'static str,
    ms: f64,
    #[serde(flatten)]
    load: Load,
    /// Its rate as a share of the machine's ceiling; 0 where it took no time.
    share_of_ceiling: f64,
}

impl Stage {
    fn new(name: &'static str, ms: f64, load: Load, ceiling: &Ceiling) -> Self {
        let most = match load {
            Load::Rays(_) => ceiling.mrays_per_s * 1e6,
            Load::Bytes(_) => ceiling.read_gb_per_s * 1e9,
        };
        let rate = load.rate(ms);
        Self { name, ms, load, share_of_ceiling: if most > 0.0 { rate / most } else { 0.0 } }
    }

    /// For a table: name, time, load, rate, share.
    pub(super) fn cells(&self) -> [String; 5] {
        let rate = self.load.rate(self.ms);
        let (load, rate) = match self.load {
            Load::Rays(rays) => (format!("{} rays", count(rays)), format!("{:.2} M/s", rate / 1e6)),
            Load::Bytes(moved) => (bytes(moved), format!("{:.2} GB/s", rate / 1e9)),
        };
        let share = format!("{:.0}%", 100.0 * self.share_of_ceiling);
        [self.name.to_owned(), format!("{:.2}", self.ms), load, rate, share]
    }
}

impl Load {
    /// A second; 0 where no time was taken.
    fn rate(self, ms: f64) -> f64 {
        let (Self::Rays(amount) | Self::Bytes(amount)) = self;
        if ms > 0.0 { amount as f64 / (ms * 1e-3) } else { 0.0 }
    }
}

/// The stages of frames in which a light moved.
pub(super) fn of(transfer: &Transfer, moved: &[FrameStats], ceiling: &Ceiling) -> Vec<Stage> {
    let amount = |of: &dyn Fn(&FrameStats) -> f64| median(moved, of) as u64;
    let bounce = transfer.bounce.bytes() as u64;
    let gathered = (transfer.gather.bytes() + transfer.glossy_bytes()) as u64;
    let stage = |name, ms: fn(&FrameStats) -> f64, load| Stage::new(name, median(moved, ms), load, ceiling);
    vec![
        stage(
            "direct",
            |frame| frame.direct_ms,
            Load::Rays(amount(&|frame| (frame.shadow_rays - frame.cloud_rays) as f64)),
        ),
        stage(
            "light on the cloud",
            |frame| frame.cloud_ms,
            Load::Rays(amount(&|frame| frame.cloud_rays as f64)),
        ),
        stage(
            "bounces",
            |frame| frame.bounces_ms,
            Load::Bytes(bounce * amount(&|frame| f64::from(frame.bounce_steps))),
        ),
        stage(
            "final gather",
            |frame| frame.gather_ms,
            Load::Bytes(gathered * amount(&|frame| f64::from(frame.gathers))),
        ),
        stage(
            "upsampling",
            |frame| frame.upsample_ms,
            Load::Bytes(amount(&|frame| frame.upsample_bytes as f64)),
        ),
        stage("sum over lights", |frame| frame.sum_ms, Load::Bytes(amount(&|frame| frame.sum_bytes as f64))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const CEILING: Ceiling = Ceiling { read_gb_per_s: 10.0, mrays_per_s: 20.0 };

    #[test]
    fn a_stage_is_a_share_of_what_bounds_it() {
        let traced = Stage::new("direct", 100.0, Load::Rays(1_000_000), &CEILING);
        assert!((traced.share_of_ceiling - 0.5).abs() < 1e-12);
        assert_eq!(traced.cells(), ["direct", "100.00", "1,000,000 rays", "10.00 M/s", "50%"]);
        let moved = Stage::new("sum", 10.0, Load::Bytes(25_000_000), &CEILING);
        assert_eq!(moved.cells()[3..], ["2.50 GB/s", "25%"]);
        let nothing = Stage::new("sum", 0.0, Load::Bytes(25), &CEILING);
        assert_eq!(nothing.share_of_ceiling, 0.0);
    }
}
