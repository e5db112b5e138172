//! The frames of a sequence.

use std::ops::RangeInclusive;

/// Frames are from minus this to this, as in a rig.
const LAST_FRAME: i32 = 1_000_000;

/// `--frames`: `A..B` with both included, or one.
pub(super) fn frames(written: &str) -> Result<RangeInclusive<i32>, String> {
    let frame = |text: &str| text.parse().ok().filter(|frame| (-LAST_FRAME..=LAST_FRAME).contains(frame));
    let (first, last) = written.split_once("..").unwrap_or((written, written));
    match frame(first).zip(frame(last)) {
        Some((first, last)) if first <= last => Ok(first..=last),
        Some((first, last)) => Err(format!("frame {last} is before {first}; write the first one first")),
        None => {
            Err(format!("write A..B or one frame, as 1..48 or 12, each from -{LAST_FRAME} to {LAST_FRAME}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_have_both_ends_or_one() {
        assert_eq!(frames("1..48"), Ok(1..=48));
        assert_eq!(frames("-5..-5"), Ok(-5..=-5));
        assert_eq!(frames("7"), Ok(7..=7));
        for wrong in ["", "..", "1..", "..3", "3..1", "1...3", "1-3", "1.5", "a..b", "0..1000001"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }
}
