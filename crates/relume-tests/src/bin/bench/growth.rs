//! How one figure grows with another.

/// `e` of the power law `y = c x^e` that fits the points best, in the mean of squares of logarithms; `None` where there are not two.
pub(crate) fn exponent(points: &[(f64, f64)]) -> Option<f64> {
    let usable = points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite());
    let logarithms: Vec<(f64, f64)> = usable.map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logarithms.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logarithms.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let along: f64 = logarithms.iter().map(|point| (point.0 - x).powi(2)).sum();
    let across: f64 = logarithms.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
    (along > 1e-12).then(|| across / along)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_has_its_exponent() {
        let law = |e: f64| [1.0, 4.0, 16.0].map(|x: f64| (x, 3.0 * x.powf(e)));
        for e in [-0.5, 0.0, 1.0, 1.7] {
            assert!((exponent(&law(e)).unwrap() - e).abs() < 1e-12);
        }
        assert!((exponent(&law(1.0)).unwrap() - 1.1).abs() > 1e-3);
        // noise above and below the ends leaves the slope between
        let noisy = [(1.0, 1.0), (10.0, 20.0), (100.0, 100.0)];
        assert!((exponent(&noisy).unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_point_alone_has_none() {
        for points in [&[][..], &[(1.0, 2.0)], &[(2.0, 1.0), (2.0, 3.0)], &[(1.0, 0.0), (2.0, 1.0)]] {
            assert_eq!(exponent(points), None);
        }
    }
}
