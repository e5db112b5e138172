use glam::Vec3;

use super::*;
use crate::trace::sampling::{hash, unit};
use crate::transfer::Coefficients;
use crate::transfer::EncodingError;
use crate::transfer::directions::{STARTING_LIGHTS, eigenvectors};
use crate::transfer::haar;
use crate::transfer::low_rank::LowRank;
use crate::transfer::low_rank_run::Run;
use crate::transfer::packed_runs::PackedRuns;
use crate::transfer::{Matrix, Operator};

/// As one block.
fn encode(x: &[f32], rows: usize, settings: &LowRankSettings, prior: &LightPrior) -> Encoded {
    let run = Run::new(x, rows, settings, prior);
    Draft::new(&run.part(0..rows)).judged(x, prior)
}

const COUNT: usize = 256;
const ROWS: usize = 64;
const LIGHTS: usize = 48;

/// A bump on a line of cells: what a lamp lights, or what a point sees.
fn bump(center: f32, width: f32) -> Vec<f32> {
    (0..COUNT).map(|i| (-((i as f32 - center) / width).powi(2)).exp()).collect()
}

fn coefficients(mut values: Vec<f32>) -> Vec<f32> {
    haar::forward(&mut values, &mut vec![0.0; COUNT]);
    values
}

fn lamps(first: u32, count: u32) -> Vec<Vec<f32>> {
    let random = |light: u32, dimension: u32| unit(hash(dimension, hash(light, 7)));
    (first..first + count)
        .map(|light| bump(random(light, 0) * COUNT as f32, 6.0 + 12.0 * random(light, 1)))
        .collect()
}

fn columns_of(lamps: &[Vec<f32>]) -> Vec<f32> {
    let columns: Vec<Vec<f32>> = lamps.iter().map(|lamp| coefficients(lamp.clone())).collect();
    (0..COUNT * lamps.len()).map(|i| columns[i % lamps.len()][i / lamps.len()]).collect()
}

/// Magnitudes of one, so that only the training lights tell coefficients apart.
fn prior(training: &[Vec<f32>]) -> LightPrior {
    LightPrior {
        expected: vec![1.0; COUNT],
        magnitudes: vec![1.0; COUNT],
        training: columns_of(training),
        lights: training.len(),
        held: columns_of(&held()),
        held_lights: held().len(),
        held_alike: held().len(),
    }
}

fn held() -> Vec<Vec<f32>> {
    lamps(1000, 8)
}

/// Rows that see a bump each, and a part of it in fine detail.
fn rows() -> Vec<f32> {
    (0..ROWS)
        .flat_map(|row| {
            let mut seen = bump(row as f32 * 3.0 + 20.0, 12.0);
            seen.iter_mut().enumerate().for_each(|(i, v)| *v *= 0.2 + unit(hash(i as u32, row as u32 / 8)));
            seen
        })
        .collect()
}

fn encoded(prior: &LightPrior, settings: &LowRankSettings) -> (Encoded, f64) {
    let x: Vec<f32> = rows().chunks_exact(COUNT).flat_map(|row| coefficients(row.to_vec())).collect();
    let encoded = encode(&x, ROWS, settings, prior);
    let error = (encoded.lost.iter().sum::<f64>() / encoded.energy.iter().sum::<f64>()).sqrt();
    (encoded, error)
}

const ALL: LowRankSettings = LowRankSettings { rank: ROWS, kept: COUNT, price: 0.0 };

#[test]
fn nothing_but_rounding_is_lost_when_all_is_kept() {
    let (encoded, error) = encoded(&prior(&lamps(0, LIGHTS as u32)), &ALL);
    assert_eq!((encoded.shape.rank, encoded.shape.kept), (ROWS as u32, COUNT as u32));
    assert!(error < 0.01, "{error}");
}

#[test]
fn the_loss_that_is_told_is_that_of_applying_the_block() {
    let settings = LowRankSettings { rank: 12, kept: 40, ..ALL };
    let (encoded, _) = encoded(&prior(&lamps(0, LIGHTS as u32)), &settings);
    let (energy, lost) = (encoded.energy.clone(), encoded.lost.clone());
    let matrix = LowRank::from_blocks(&[encoded], COUNT);
    for (light, lamp) in held().iter().enumerate() {
        let grey: Vec<Vec3> = lamp.iter().map(|&v| Vec3::splat(v)).collect();
        let mut out = vec![Vec3::ZERO; ROWS];
        matrix.apply(&Coefficients::new(&grey, &[], &[]), None, &mut out);
        let truth = rows();
        let truth =
            truth.chunks_exact(COUNT).map(|row| row.iter().zip(lamp).map(|(a, b)| a * b).sum::<f32>());
        let (mut all, mut missed) = (0.0, 0.0);
        for (truth, out) in truth.zip(&out) {
            all += f64::from(truth).powi(2);
            missed += f64::from(truth - out.x).powi(2);
        }
        assert!((all / energy[light] - 1.0).abs() < 1e-3, "{all} {}", energy[light]);
        assert!((missed / lost[light] - 1.0).abs() < 0.01, "{missed} {}", lost[light]);
    }
}

#[test]
fn dropped_light_is_guessed_from_what_the_training_lights_have_in_common() {
    let settings = LowRankSettings { rank: 24, kept: 16, ..ALL };
    let (_, taught) = encoded(&prior(&lamps(0, LIGHTS as u32)), &settings);
    let (_, untaught) = encoded(&prior(&[vec![1.0; COUNT]]), &settings);
    assert!(taught < 0.85 * untaught, "{taught} against {untaught}");
}

/// What is bright is what is seen, cell by cell: of each row a tenth of the light is in details that are too faint to be looked at.
#[test]
fn light_on_coefficients_that_are_not_looked_at_is_not_lost() {
    let grain =
        |i: usize, depth: f32| if hash(i as u32, 5).is_multiple_of(2) { 1.0 + depth } else { 1.0 - depth };
    let grained = |values: Vec<f32>, depth: f32| -> Vec<f32> {
        values.iter().enumerate().map(|(i, value)| value * grain(i, depth)).collect()
    };
    let lit = |first: u32, count: u32| -> Vec<Vec<f32>> {
        lamps(first, count).into_iter().map(|lamp| grained(lamp, 1.0)).collect()
    };
    let rows: Vec<Vec<f32>> =
        (0..ROWS).map(|row| grained(bump(row as f32 * 3.0 + 20.0, 12.0), 0.1)).collect();
    let x: Vec<f32> = rows.iter().flat_map(|row| coefficients(row.clone())).collect();
    let settings = LowRankSettings { rank: 24, kept: 24, ..ALL };
    let prior = prior(&lit(0, LIGHTS as u32));
    let run = Run::new(&x, ROWS, &settings, &prior);
    assert_eq!(run.candidates.len(), 36, "of {COUNT}");
    let matrix = LowRank::from_blocks(&[Draft::new(&run.part(0..ROWS)).judged(&x, &prior)], COUNT);
    let (mut sent, mut seen, mut told) = (0.0, 0.0, 0.0);
    for lamp in lit(2000, 16) {
        let grey: Vec<Vec3> = lamp.iter().map(|&v| Vec3::splat(v)).collect();
        let mut out = vec![Vec3::ZERO; ROWS];
        matrix.apply(&Coefficients::new(&grey, &[], &[]), None, &mut out);
        told += out.iter().map(|rgb| f64::from(rgb.x)).sum::<f64>();
        let lamp = coefficients(lamp);
        for row in x.chunks_exact(COUNT) {
            let part = |c: usize| f64::from(row[c] * lamp[c]);
            sent += (0..COUNT).map(part).sum::<f64>();
            seen += run.candidates.iter().map(|&c| part(c as usize)).sum::<f64>();
        }
    }
    assert!(seen < 0.96 * sent, "the candidates are to lack some of {sent}: {seen}");
    assert!(
        (told / sent - 1.0).abs() < 0.4 * (1.0 - seen / sent),
        "told {told} of {sent}, of which candidates have {seen}"
    );
}

#[test]
fn a_higher_price_buys_less_and_loses_more() {
    let prior = prior(&lamps(0, LIGHTS as u32));
    let at = |price| {
        let (encoded, error) = encoded(&prior, &LowRankSettings { price, ..ALL });
        (LowRank::from_blocks(&[encoded], COUNT).bytes(), error)
    };
    let (dear, fair, free) = (at(1e-1), at(1e-3), at(0.0));
    assert!(dear.0 < fair.0 && fair.0 < free.0, "{dear:?} {fair:?} {free:?}");
    assert!(dear.1 > fair.1 && fair.1 > free.1, "{dear:?} {fair:?} {free:?}");
}

#[test]
fn a_block_that_sees_nothing_costs_nothing() {
    let prior = prior(&lamps(0, LIGHTS as u32));
    let encoded = encode(&vec![0.0; ROWS * COUNT], ROWS, &ALL, &prior);
    assert_eq!((encoded.shape.rank, encoded.shape.kept), (0, 0));
    assert!(encoded.lost.iter().all(|&lost| lost == 0.0));
    let mut out = vec![Vec3::ONE; ROWS];
    LowRank::from_blocks(&[encoded], COUNT).apply(
        &Coefficients::new(&[Vec3::ONE; COUNT], &[], &[]),
        None,
        &mut out,
    );
    assert!(out.iter().all(|&rgb| rgb == Vec3::ZERO));
}

/// A lone row whose light is worth a direction but none of its coefficients their places.
#[test]
fn directions_without_coefficients_are_dropped() {
    let prior = prior(&lamps(0, LIGHTS as u32));
    let mut row = coefficients(vec![0.0; COUNT]);
    row.iter_mut().enumerate().for_each(|(i, v)| *v = if i > 0 { 0.1 } else { 0.0 });
    let energy = 0.01 * (COUNT - 1) as f32;
    for price in (1..60).map(|step| energy / step as f32 * 0.5) {
        let encoded = encode(&row, 1, &LowRankSettings { rank: 4, kept: COUNT, price }, &prior);
        let BlockShape { rank, kept, .. } = encoded.shape;
        assert_eq!(rank == 0, kept == 0, "price {price}: {rank} directions of {kept} coefficients");
        let matrix = LowRank::from_blocks(&[encoded], COUNT);
        assert!(matrix.is_sound(1, COUNT), "price {price}");
        matrix.apply(&Coefficients::new(&[Vec3::ONE; COUNT], &[], &[]), None, &mut [Vec3::ZERO]);
    }
}

/// More lights than the search starts from; its directions bring what the best do.
#[test]
fn a_search_that_starts_from_some_of_many_lights_finds_the_strongest_directions() {
    const MOST: usize = 12;
    let lights = 3 * STARTING_LIGHTS + 5;
    let x: Vec<f32> = rows().chunks_exact(COUNT).flat_map(|row| coefficients(row.to_vec())).collect();
    let run = Run::new(&x, ROWS, &ALL, &prior(&lamps(0, lights as u32)));
    let part = run.part(0..ROWS);
    let (_, gains) = strongest_directions(&part, MOST, 0.0);
    let own = product(part.x, part.x.transposed());
    let together = product(part.responses, part.responses.transposed());
    let expected: Vec<f32> = own
        .iter()
        .zip(&together)
        .map(|(own, together)| (1.0 - LEARNED) as f32 * own + (LEARNED / lights as f64) as f32 * together)
        .collect();
    let expected = DMatrix::from_fn(ROWS, ROWS, |i, j| f64::from(expected[i * ROWS + j]));
    let (_, energies) = eigenvectors(expected);
    let (found, best) = (gains.iter().sum::<f64>(), energies[..MOST].iter().sum::<f64>());
    assert!(found > 0.999 * best && found < 1.001 * best, "{found} of {best}");
    let without_last = energies[..MOST - 1].iter().sum::<f64>();
    assert!(
        without_last < 0.999 * best,
        "a direction that is missing must be noticed: {without_last} of {best}"
    );
}

#[test]
fn what_does_not_fit_is_refused() {
    let (encoded, _) =
        encoded(&prior(&lamps(0, LIGHTS as u32)), &LowRankSettings { rank: 6, kept: 20, ..ALL });
    let whole = LowRank::from_blocks(&[encoded], COUNT);
    assert!(whole.is_sound(ROWS, COUNT));
    assert!(!whole.is_sound(ROWS + 1, COUNT) && !whole.is_sound(ROWS, 16));
    let shape = whole.shapes[0];
    let shapes = |shape: BlockShape| LowRank { shapes: vec![shape].into(), ..whole.clone() };
    let [rows, rank, kept] = [shape.rows, shape.rank, shape.kept].map(|size| [size - 1, size + 1, u32::MAX]);
    let wrong: Vec<LowRank> = (rows.into_iter().map(|rows| shapes(BlockShape { rows, ..shape })))
        .chain(rank.into_iter().map(|rank| shapes(BlockShape { rank, ..shape })))
        .chain(kept.into_iter().map(|kept| shapes(BlockShape { kept, ..shape })))
        .chain([
            LowRank { shapes: vec![shape, shape].into(), ..whole.clone() },
            LowRank { indices: whole.indices[1..].to_vec().into(), ..whole.clone() },
            LowRank { indices: vec![COUNT as u16; shape.kept as usize].into(), ..whole.clone() },
            LowRank { high: vec![1; shape.kept as usize].into(), ..whole.clone() },
            LowRank { high: vec![0].into(), ..whole.clone() },
            LowRank { v_scales: whole.v_scales[1..].to_vec().into(), ..whole.clone() },
            LowRank { u_scales: vec![f32::NAN; shape.rank as usize].into(), ..whole.clone() },
            LowRank { u: PackedRuns::default(), ..whole.clone() },
            LowRank { v: PackedRuns::default(), ..whole.clone() },
        ])
        .collect();
    for (number, wrong) in wrong.iter().enumerate() {
        assert!(!wrong.is_sound(ROWS, COUNT), "{number}");
    }
}

/// The squares that culling asks for, against the light of each coefficient by itself.
#[test]
fn columns_are_as_strong_as_what_they_do() {
    let (encoded, _) = encoded(&prior(&lamps(0, LIGHTS as u32)), &ALL);
    let matrix = LowRank::from_blocks(&[encoded], COUNT);
    let operator = Operator::new(
        ROWS,
        Matrix::LowRank(matrix),
        (vec![1.0; COUNT].into(), vec![1.0; COUNT].into()),
        EncodingError::default(),
    );
    let norms = operator.norms(COUNT);
    let (mut told, mut done) = (0.0, 0.0);
    for column in 0..COUNT {
        let mut wavelet = vec![0.0; COUNT];
        wavelet[column] = 1.0;
        haar::inverse(&mut wavelet, &mut vec![0.0; COUNT]);
        let light: Vec<Vec3> = wavelet.iter().map(|&value| Vec3::splat(value)).collect();
        let square: f64 = operator.apply(&light).iter().map(|rgb| f64::from(rgb.x).powi(2)).sum();
        told += f64::from(norms.column(column));
        done += square;
    }
    // directions are orthogonal but for rounding
    assert!((told / done - 1.0).abs() < 0.02, "{told} {done}");
    assert!((0..COUNT).any(|column| norms.column(column) < 0.5 * norms.column(0)));
}
