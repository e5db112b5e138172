use super::*;
use crate::trace::sampling::{hash, unit};

const ROWS: usize = 300;
const COUNT: usize = 64;
const LIGHTS: usize = 5;

fn numbers(count: usize, seed: u32) -> Vec<f32> {
    (0..count).map(|i| unit(hash(i as u32, seed)) - 0.5).collect()
}

fn prior() -> LightPrior {
    LightPrior {
        expected: vec![1.0; COUNT],
        magnitudes: vec![1.0; COUNT],
        training: numbers(COUNT * LIGHTS, 2),
        lights: LIGHTS,
        held: Vec::new(),
        held_lights: 0,
        held_alike: 0,
    }
}

/// Rows of which every fourth coefficient is much weaker than others.
fn rows() -> Vec<f32> {
    let mut x = numbers(ROWS * COUNT, 1);
    x.iter_mut()
        .enumerate()
        .filter(|(place, _)| place % COUNT % 4 == 3)
        .for_each(|(_, value)| *value *= 1e-3);
    x
}

/// `sum_c a_c b_c` over the coefficients `which`.
fn along(a: &[f32], b: &[f32], which: &[u32]) -> f64 {
    which.iter().map(|&c| f64::from(a[c as usize]) * f64::from(b[c as usize])).sum()
}

#[test]
fn parts_of_a_run_have_their_part_of_how_its_rows_go_together() {
    let (x, prior) = (rows(), prior());
    let settings = LowRankSettings { rank: 8, kept: 32, price: 0.0 };
    let run = Run::new(&x, ROWS, &settings, &prior);
    assert_eq!(run.candidates.len(), 48);
    assert!(run.candidates.iter().all(|candidate| candidate % 4 != 3), "the strongest");
    let row = |row: usize| &x[row * COUNT..(row + 1) * COUNT];
    let light: Vec<Vec<f32>> =
        (0..LIGHTS).map(|light| (0..COUNT).map(|c| prior.training[c * LIGHTS + light]).collect()).collect();
    let all: Vec<u32> = (0..COUNT as u32).collect();
    // across the strips in which it is computed
    let part = run.part(250..290);
    let covariance = part.covariance();
    for (i, j) in [(0, 0), (1, 39), (39, 1), (3, 20)] {
        let (a, b) = (row(250 + i), row(250 + j));
        let together: f64 = light.iter().map(|light| along(a, light, &all) * along(b, light, &all)).sum();
        let expected = (1.0 - LEARNED) * along(a, b, &run.candidates) + LEARNED / LIGHTS as f64 * together;
        assert!((covariance[(i, j)] - expected).abs() < 1e-5, "{i}, {j}");
        assert_eq!(part.x.at(i, 7), a[run.candidates[7] as usize]);
    }
    let energy: f64 = (250..290).flat_map(row).map(|&value| f64::from(value).powi(2)).sum();
    assert!((part.energy / energy - 1.0).abs() < 1e-5, "also what is not among the candidates");
}

#[test]
fn coefficients_that_no_direction_can_pay_for_are_not_looked_at() {
    // of the weak ones all rows together have 300 / 12 * 1e-6
    let settings = LowRankSettings { rank: 8, kept: COUNT, price: 1e-4 };
    let candidates =
        |price| Run::new(&rows(), ROWS, &LowRankSettings { price, ..settings }, &prior()).candidates;
    assert_eq!(candidates(1e-4).len(), 48);
    assert_eq!(candidates(1e-6).len(), COUNT);
    assert!(candidates(1e3).is_empty());
}

#[test]
fn products_add_up_over_more_columns_than_are_summed_at_once() {
    let (rows, columns) = (3, SUMMED + 100);
    let (x, responses) = (numbers(rows * columns, 4), numbers(rows * 2, 5));
    let told = covariance(View::new(&x, rows, columns), View::new(&responses, rows, 2));
    let product = |values: &[f32], width: usize, i: usize, j: usize| -> f64 {
        (0..width).map(|k| f64::from(values[i * width + k]) * f64::from(values[j * width + k])).sum()
    };
    for (i, j) in [(0, 0), (2, 1), (1, 2)] {
        let expected =
            (1.0 - LEARNED) * product(&x, columns, i, j) + LEARNED / 2.0 * product(&responses, 2, i, j);
        assert!((told[(i, j)] - expected).abs() < 1e-5, "{i}, {j}: {} {expected}", told[(i, j)]);
    }
}
