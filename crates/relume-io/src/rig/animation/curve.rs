//! What lies between two keys.

/// How a field goes from one key to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// A monotone cubic, at rest at the first and the last key.
    Smooth,
    /// A straight line.
    Linear,
    /// The value of the key before, up to the next one.
    Step,
}

impl Interpolation {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Smooth, Self::Linear, Self::Step];

    /// Its name in rig files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Linear => "linear",
            Self::Step => "step",
        }
    }
}

/// The value of a curve at `frame`: `keys` gives the value at each of `frames`, which ascend and are not empty. Before the first and after the
/// last of them the value holds.
pub(super) fn value_at(
    interpolation: Interpolation,
    frames: &[i32],
    keys: &dyn Fn(usize) -> f64,
    frame: f64,
) -> f64 {
    let before = key_before(frames, frame);
    let from = keys(before);
    let Some(&next) = frames.get(before + 1) else { return from };
    let width = f64::from(next) - f64::from(frames[before]);
    let t = ((frame - f64::from(frames[before])) / width).clamp(0.0, 1.0);
    if t == 0.0 {
        return from; // whatever the next key has, which may be no finite number
    }
    let rise = keys(before + 1) - from;
    let value = match interpolation {
        Interpolation::Step => return from,
        Interpolation::Linear => from + t * rise,
        // the cubic Hermite form
        Interpolation::Smooth => {
            let slope = |key| width * slope_at(frames, keys, key);
            let bend = (1.0 - t) * slope(before) - t * slope(before + 1);
            from + t * t * (3.0 - 2.0 * t) * rise + t * (1.0 - t) * bend
        }
    };
    // rounding must not lead out either: 0 is the least of many fields
    value.max(from.min(from + rise)).min(from.max(from + rise))
}

/// The last key at or before `frame`, or the first one.
pub(super) fn key_before(frames: &[i32], frame: f64) -> usize {
    frames.partition_point(|&key| f64::from(key) <= frame).saturating_sub(1)
}

/// The slope of a monotone cubic at a key (F. N. Fritsch and R. E. Carlson, "Monotone Piecewise Cubic Interpolation", SIAM J. Numer. Anal.
/// 17(2), 1980): the mean of the secants on both sides, 0 where they turn, and at most three times the flatter one. This is the square `[0, 3]²` of
/// their region of monotonicity; their circle lets a slope depend on keys further away. At the first and the last key, where they leave it open, 0.
fn slope_at(frames: &[i32], keys: &dyn Fn(usize) -> f64, key: usize) -> f64 {
    if key == 0 || key + 1 == frames.len() {
        return 0.0;
    }
    let secant =
        |key: usize| (keys(key + 1) - keys(key)) / (f64::from(frames[key + 1]) - f64::from(frames[key]));
    let (left, right) = (secant(key - 1), secant(key));
    if left * right <= 0.0 {
        return 0.0;
    }
    let steepest = 3.0 * left.abs().min(right.abs());
    // unlike a clamp, these take a steepest slope that is no number, as of keys that are none
    (0.5 * (left + right)).max(-steepest).min(steepest)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: [i32; 6] = [-3, 1, 2, 10, 11, 40];
    /// Rises and falls, stands still, and goes far within one frame.
    const VALUES: [f64; 6] = [0.0, 1.0, 1.0, 0.25, 9000.0, 0.0];

    fn at(interpolation: Interpolation, frame: f64) -> f64 {
        value_at(interpolation, &FRAMES, &|key| VALUES[key], frame)
    }

    #[test]
    fn keys_are_hit_and_held_outside() {
        for interpolation in Interpolation::ALL {
            for (frame, value) in FRAMES.into_iter().zip(VALUES) {
                assert_eq!(at(interpolation, f64::from(frame)), value, "{interpolation:?} at {frame}");
            }
            assert_eq!([-1e9, -4.0].map(|frame| at(interpolation, frame)), [0.0; 2]);
            assert_eq!([41.0, 1e9].map(|frame| at(interpolation, frame)), [0.0; 2]);
            assert_eq!(value_at(interpolation, &[7], &|_| 5.0, 3.0), 5.0);
        }
    }

    #[test]
    fn lines_are_straight_and_steps_are_flat() {
        assert_eq!([-2.0, -1.0, 0.5].map(|frame| at(Interpolation::Linear, frame)), [0.25, 0.5, 0.875]);
        assert_eq!([-2.0, 0.99, 9.99].map(|frame| at(Interpolation::Step, frame)), [0.0, 0.0, 1.0]);
    }

    /// Files may have them, and are refused for them only once they are read.
    #[test]
    fn keys_that_are_no_finite_numbers_are_hit_and_leave_the_others() {
        for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for place in 0..4 {
                let mut keys = [1.0, 2.0, 4.0, 3.0];
                keys[place] = odd;
                for interpolation in Interpolation::ALL {
                    let at = |frame: f64| value_at(interpolation, &[0, 2, 4, 6], &|key| keys[key], frame);
                    for (key, value) in keys.into_iter().enumerate() {
                        let hit = at(2.0 * key as f64);
                        assert!(hit == value || (hit.is_nan() && value.is_nan()), "{interpolation:?}: {hit}");
                    }
                    // between keys there is no right value, but there is an answer
                    for frame in [1.0, 3.0, 5.0, 9.0] {
                        at(frame);
                    }
                }
            }
        }
    }

    /// Between two keys a smooth curve goes one way and stays between their values.
    #[test]
    fn smooth_curves_never_overshoot() {
        let monotone = |curve: &dyn Fn(f64) -> f64| {
            FRAMES.windows(2).zip(VALUES.windows(2)).all(|(frames, values)| {
                let steps: Vec<f64> = (0..=200)
                    .map(|step| {
                        f64::from(frames[0]) + f64::from(frames[1] - frames[0]) * f64::from(step) / 200.0
                    })
                    .map(curve)
                    .collect();
                let (low, high) = (values[0].min(values[1]), values[0].max(values[1]));
                let rises = values[1] >= values[0];
                steps.iter().all(|value| (low..=high).contains(value))
                    && steps.windows(2).all(|pair| pair[0] == pair[1] || (pair[1] > pair[0]) == rises)
            })
        };
        assert!(monotone(&|frame| at(Interpolation::Smooth, frame)));
        // the same cubic with slopes that are not held back is told apart
        let unlimited = |frame: f64| {
            let before = key_before(&FRAMES, frame).min(FRAMES.len() - 2);
            let secant =
                |key: usize| (VALUES[key + 1] - VALUES[key]) / f64::from(FRAMES[key + 1] - FRAMES[key]);
            let slope = |key: usize| {
                if key == 0 || key + 1 == FRAMES.len() { 0.0 } else { 0.5 * (secant(key - 1) + secant(key)) }
            };
            let width = f64::from(FRAMES[before + 1] - FRAMES[before]);
            let t = (frame - f64::from(FRAMES[before])) / width;
            let rise = VALUES[before + 1] - VALUES[before];
            let bend = width * ((1.0 - t) * slope(before) - t * slope(before + 1));
            VALUES[before] + t * t * (3.0 - 2.0 * t) * rise + t * (1.0 - t) * bend
        };
        assert!(!monotone(&unlimited));
    }

    /// At rest at both ends, and without a kink at the key between.
    #[test]
    fn smooth_curves_start_and_end_at_rest() {
        let curve =
            |frame: f64| value_at(Interpolation::Smooth, &[0, 10, 30], &|key| [0.0, 4.0, 6.0][key], frame);
        let speed = |frame: f64| (curve(frame + 1e-4) - curve(frame - 1e-4)) / 2e-4;
        assert!(curve(0.001) < 1e-6 && 6.0 - curve(29.999) < 1e-6);
        assert!((speed(10.0 - 2e-4) - speed(10.0 + 2e-4)).abs() < 1e-3 && speed(10.0) > 0.2);
        let line = |frame: f64| value_at(Interpolation::Linear, &[0, 10], &|key| [0.0, 4.0][key], frame);
        assert!(line(0.001) > 1e-4, "a line does not start at rest");
    }
}
