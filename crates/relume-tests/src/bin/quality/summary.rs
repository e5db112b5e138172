//! What many lights come down to.

use serde::Serialize;

/// Median and worst of one figure over the lights, with the lights that stand for them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    /// The middle one, or the mean of the two in the middle.
    pub(crate) median: f64,
    /// The light at the median; of two in the middle that with the smaller error.
    pub(crate) median_light: String,
    /// The largest.
    pub(crate) worst: f64,
    /// Whose it is.
    pub(crate) worst_light: String,
}

impl Spread {
    /// Of figures by light; `None` of none. A figure that is no number is the worst.
    pub(crate) fn of<'a>(figures: impl IntoIterator<Item = (&'a str, f64)>) -> Option<Self> {
        let mut sorted: Vec<_> = figures.into_iter().collect();
        sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
        let values: Vec<_> = sorted.iter().map(|(_, value)| *value).collect();
        let (worst_light, worst) = *sorted.last()?;
        let (median_light, _) = sorted[(sorted.len() - 1) / 2];
        Some(Self {
            median: median(&values),
            median_light: median_light.to_owned(),
            worst,
            worst_light: worst_light.to_owned(),
        })
    }
}

/// The middle one, or the mean of the two in the middle; 0 of none.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => 0.0,
        odd if odd % 2 == 1 => sorted[middle],
        _ => 0.5 * (sorted[middle - 1] + sorted[middle]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIGHTS: [(&str, f64); 4] = [("a", 0.3), ("b", 0.1), ("c", 0.9), ("d", 0.2)];

    #[test]
    fn median_and_worst_name_their_lights() {
        let spread = Spread::of(LIGHTS).unwrap();
        assert_eq!((spread.median, spread.worst), (0.25, 0.9));
        assert_eq!((spread.median_light.as_str(), spread.worst_light.as_str()), ("d", "c"));
        let odd = Spread::of(LIGHTS[..3].to_vec()).unwrap();
        assert_eq!((odd.median, odd.median_light.as_str()), (0.3, "a"));
        assert_eq!(Spread::of([]), None);
    }

    /// The deliberately wrong input: one light's figure changed must show, and a figure that is no number must not hide.
    #[test]
    fn a_wrong_figure_shows() {
        let mut wrong = LIGHTS;
        wrong[1].1 = 2.0;
        assert_ne!(Spread::of(wrong), Spread::of(LIGHTS));
        wrong[1].1 = f64::NAN;
        let spread = Spread::of(wrong).unwrap();
        assert!(spread.worst.is_nan() && spread.worst_light == "b");
    }
}
