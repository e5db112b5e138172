//! Operators with few eigenvalues, whose sums are known in closed form.

use super::*;
use crate::transfer::EncodingError;
use crate::transfer::haar_rows::HaarRows;
use crate::transfer::{Matrix, haar};

const COUNT: usize = 256;

/// Which half of the cloud a sample lies in: 1 or -1, one of the coarsest Haar functions.
fn sides() -> Vec<f32> {
    let mut function = vec![0.0; COUNT];
    function[1] = 1.0;
    haar::inverse(&mut function, &mut vec![0.0; COUNT]);
    function.iter().map(|value| value.signum()).collect()
}

/// Gathers `share` of the mean over the cloud, and adds `own` times `share` of what one's own half has above the other.
/// `own` is 0 in a hollow ball, 1 in two rooms kept apart, and -1 between two walls that see nothing but each other.
fn operator(share: f32, own: i8) -> Operator {
    let values = sides().iter().flat_map(|side| [127, 127 * own * *side as i8]).collect::<Vec<_>>();
    let matrix = HaarRows {
        per_row: 2,
        indices: [0, 1].repeat(COUNT).into(),
        high: Vec::new().into(),
        values: values.into(),
        scales: vec![share / (127.0 * (COUNT as f32).sqrt()); COUNT].into(),
    };
    Operator::new(COUNT, Matrix::HaarRows(matrix), Default::default(), EncodingError::default())
}

fn summed(bounce: &Operator, albedo: &[Vec3], direct: &[Vec3], times: Option<u32>) -> Vec<Vec3> {
    BounceSeries::new(bounce, albedo).sum(bounce, direct, times, 0.0).0
}

/// The largest difference, as a share of what is expected.
fn off(light: &[Vec3], expected: impl Fn(usize) -> DVec3) -> f64 {
    let one = |(index, light): (usize, &Vec3)| {
        ((light.as_dvec3() - expected(index)) / expected(index)).abs().max_element()
    };
    light.iter().enumerate().map(one).fold(0.0, f64::max)
}

const ALBEDO: Vec3 = Vec3::new(0.8, 0.5, 0.2);

/// Rounding of a sum of 24 terms.
const CLOSE: f64 = 1e-5;

#[test]
fn in_a_ball_the_sum_is_geometric_in_each_channel() {
    let bounce = operator(1.0, 0);
    let emission = Vec3::new(1.0, 2.0, 3.0);
    let series = BounceSeries::new(&bounce, &[ALBEDO; COUNT]);
    assert!((series.ratio() - ALBEDO.as_dvec3()).abs().max_element() < 1e-5, "{}", series.ratio());
    let (light, steps, _) = series.sum(&bounce, &[emission; COUNT], None, 0.0);
    let expected = |albedo: Vec3| emission.as_dvec3() / (1.0 - albedo.as_dvec3());
    assert!(off(&light, |_| expected(ALBEDO)) < CLOSE, "{}", off(&light, |_| expected(ALBEDO)));
    // a thousandth more of albedo is noticed, and so is the sum without its tail
    assert!(off(&light, |_| expected(1.001 * ALBEDO)) > CLOSE);
    let cut = gather_bounces(&bounce, &[ALBEDO; COUNT], &[emission; COUNT], Some(steps)).0;
    assert!(off(&cut, |_| expected(ALBEDO)) > 1e-3, "{}", off(&cut, |_| expected(ALBEDO)));
    assert!(steps <= 24, "{steps} bounces");
}

#[test]
fn light_of_one_spot_is_spread_and_then_fades() {
    let bounce = operator(1.0, 0);
    let mut direct = vec![Vec3::ZERO; COUNT];
    direct[3] = Vec3::splat(COUNT as f32);
    let light = summed(&bounce, &[ALBEDO; COUNT], &direct, None);
    let expected = |albedo: DVec3, index: usize| direct[index].as_dvec3() + albedo / (1.0 - albedo);
    assert!(off(&light, |index| expected(ALBEDO.as_dvec3(), index)) < CLOSE);
    assert!(off(&light, |index| expected(1.001 * ALBEDO.as_dvec3(), index)) > CLOSE);
}

/// The tail is that of the brighter room; the darker one has nothing left by then.
#[test]
fn each_of_two_rooms_has_a_sum_of_its_own() {
    let (bounce, sides) = (operator(1.0, 1), sides());
    let of = |index: usize| if sides[index] > 0.0 { 0.8 } else { 0.3 };
    let albedo: Vec<Vec3> = (0..COUNT).map(|index| Vec3::splat(of(index) as f32)).collect();
    let light = summed(&bounce, &albedo, &[Vec3::ONE; COUNT], None);
    assert!(off(&light, |index| DVec3::splat(1.0 / (1.0 - of(index)))) < CLOSE);
    assert!(off(&light, |_| DVec3::splat(1.0 / (1.0 - 0.8))) > 0.1, "one room's light in both");
}

/// Light on one of two walls that see nothing but each other: half of it never settles.
#[test]
fn light_thrown_to_and_fro_adds_up() {
    let (bounce, sides) = (operator(1.0, -1), sides());
    let direct: Vec<Vec3> =
        sides.iter().map(|&side| if side > 0.0 { Vec3::ONE } else { Vec3::ZERO }).collect();
    let p = ALBEDO.as_dvec3();
    let expected =
        |index: usize, p: DVec3| if sides[index] > 0.0 { 1.0 / (1.0 - p * p) } else { p / (1.0 - p * p) };
    let series = BounceSeries::new(&bounce, &[ALBEDO; COUNT]);
    assert!((series.ratio() - p).abs().max_element() < 1e-5, "{}", series.ratio());
    let (light, steps, _) = series.sum(&bounce, &direct, None, 0.0);
    let error = off(&light, |index| expected(index, p));
    println!("to and fro: {error}");
    assert!(error < 1e-3, "{error}");
    assert!(off(&light, |index| expected(index, 1.001 * p)) > 2.0 * error);
    let cut = gather_bounces(&bounce, &[ALBEDO; COUNT], &direct, Some(steps)).0;
    assert!(off(&cut, |index| expected(index, p)) > 4.0 * error, "the tail helps");
}

#[test]
fn bounces_are_counted_however_many() {
    let bounce = operator(1.0, 0);
    for times in [0, 1, 2, 5, 20, 30, 100] {
        let light = summed(&bounce, &[ALBEDO; COUNT], &[Vec3::ONE; COUNT], Some(times));
        let sum = |times| (0..=times).map(|k| ALBEDO.as_dvec3().powf(f64::from(k))).sum::<DVec3>();
        assert!(off(&light, |_| sum(times)) < CLOSE, "{times}: {}", off(&light, |_| sum(times)));
        assert!(off(&light, |_| sum(times + 1)) > CLOSE || times == 100, "{times}: one more is noticed");
    }
}

/// Rows that sum to more than one make light out of nothing; their noise does so where albedo is high.
#[test]
fn an_operator_that_makes_light_is_held_to_the_highest_albedo() {
    let albedo = Vec3::new(0.9, 0.8, 0.5);
    let bounce = operator(1.3, 0);
    let light = summed(&bounce, &[albedo; COUNT], &[Vec3::ONE; COUNT], None);
    let expected = 1.0 / (1.0 - albedo.as_dvec3());
    assert!(off(&light, |_| expected) < CLOSE, "{}", light[0]);
    // left alone, the first two channels have no sum at all
    let loose = gather_bounces(&bounce, &[albedo; COUNT], &[Vec3::ONE; COUNT], None).0;
    assert!(loose[0].x > 1e3 && off(&loose, |_| expected) > CLOSE, "{}", loose[0]);
    // nothing is taken from rows that lose light
    let leaky = summed(&operator(0.7, 0), &[albedo; COUNT], &[Vec3::ONE; COUNT], None);
    assert!(off(&leaky, |_| 1.0 / (1.0 - 0.7 * albedo.as_dvec3())) < CLOSE, "{}", leaky[0]);
}

#[test]
fn a_white_room_has_a_sum_and_a_black_one_is_dark() {
    let bounce = operator(1.0, 0);
    let white = summed(&bounce, &[Vec3::ONE; COUNT], &[Vec3::ONE; COUNT], None);
    assert!(off(&white, |_| DVec3::splat(1.0 / (1.0 - LARGEST_RATIO))) < 1e-3, "{}", white[0]);
    let (light, ..) =
        BounceSeries::new(&bounce, &[Vec3::ZERO; COUNT]).sum(&bounce, &[Vec3::ONE; COUNT], None, 0.0);
    assert!(light.iter().all(|&light| light == Vec3::ONE));
    let (dark, steps, _) =
        BounceSeries::new(&bounce, &[ALBEDO; COUNT]).sum(&bounce, &[Vec3::ZERO; COUNT], None, 0.0);
    assert!(
        dark.iter().all(|&light| light == Vec3::ZERO) && steps <= ASKED_EVERY,
        "{steps} bounces of no light"
    );
}

/// Two lights that fade at different speeds, so that they end after different terms where they end early.
#[test]
fn the_sum_is_linear_in_the_light() {
    let (bounce, sides) = (operator(1.0, 1), sides());
    let albedo: Vec<Vec3> =
        sides.iter().map(|&side| Vec3::splat(if side > 0.0 { 0.9 } else { 0.05 })).collect();
    let series = BounceSeries::new(&bounce, &albedo);
    let random = |index, seed| crate::trace::sampling::unit(crate::trace::sampling::hash(index as u32, seed));
    let light = |side: f32, seed| -> Vec<Vec3> {
        (0..COUNT).map(|i| Vec3::splat(random(i, seed) * if sides[i] == side { 1.0 } else { 0.0 })).collect()
    };
    let (x, y) = (light(1.0, 1), light(-1.0, 2));
    let mixed: Vec<Vec3> = x.iter().zip(&y).map(|(&x, &y)| 0.5 * x + 2.0 * y).collect();
    let [(of_mixed, ..), (of_x, steps_x, _), (of_y, steps_y, _)] =
        [&mixed, &x, &y].map(|light| series.sum(&bounce, light, None, 0.0));
    assert!(steps_y < steps_x, "{steps_y} and {steps_x}");
    let difference = |a: f32, b: f32| {
        let squares =
            (0..COUNT).map(|i| (of_mixed[i] - (a * of_x[i] + b * of_y[i])).as_dvec3().length_squared());
        squares.sum::<f64>().sqrt() / norm(&of_mixed).length()
    };
    assert!(difference(0.5, 2.0) < 3e-7, "{}", difference(0.5, 2.0));
    assert!(difference(2.0, 0.5) > 0.1, "weights exchanged are noticed");
}
