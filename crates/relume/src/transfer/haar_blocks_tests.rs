//! Rows that are made up, regrouped and applied.

use std::collections::HashMap;

use glam::Vec3;

use super::*;
use crate::trace::sampling::{hash, unit};
use crate::transfer::EncodingError;
use crate::transfer::{Coefficients, Matrix, Operator, Work};

const COUNT: usize = 256;
const ROWS: usize = 100 * 70;

fn random(index: usize, seed: u32) -> f32 {
    unit(hash(index as u32, seed)) - 0.5
}

/// Rows of smooth strength over an image of 100x70 places, each with twenty of 256 coefficients, in two blocks.
fn rows() -> Vec<KeptRows> {
    let block = |rows: std::ops::Range<usize>| {
        let mut kept = KeptRows { per_row: 20, weight: 1.0, ..KeptRows::default() };
        for row in rows {
            let (x, y) = ((row % 100) as f32, (row / 100) as f32);
            // light from around a place that moves with the pixel
            let first = ((x + 2.0 * y) as usize).min(COUNT - 20);
            kept.indices.extend((0..20).map(|i| (first + i) as u32));
            let values = (0..20).map(|i| (0.1 * x + i as f32).sin() + 0.1 * random(20 * row + i, 1));
            kept.values.extend(values);
            kept.energies.push(kept.values[kept.values.len() - 20..].iter().map(|&v| f64::from(v * v)).sum());
        }
        kept
    };
    vec![block(0..3000), block(3000..ROWS)]
}

/// Rows in another order than places, with holes between.
fn layout() -> ImageLayout {
    let places = (0..ROWS as u32).map(|row| row / 100 * 104 + (99 - row % 100));
    ImageLayout { width: 104, height: 70, places: places.collect::<Vec<_>>().into() }
}

fn light(seed: u32) -> Coefficients {
    let light: Vec<Vec3> = (0..COUNT)
        .map(|i| Vec3::new(random(3 * i, seed), random(3 * i + 1, seed), random(3 * i + 2, seed)))
        .collect();
    Coefficients::new(&light, &[], &[])
}

fn product(rows: &[KeptRows], light: &Coefficients) -> Vec<Vec3> {
    let dot = |(indices, values, _): (&[u32], &[f32], f64)| {
        indices.iter().zip(values).map(|(&i, &value)| Vec3::from(light.at(i as usize)) * value).sum::<Vec3>()
    };
    rows.iter().flat_map(KeptRows::rows).map(dot).collect()
}

fn norm(values: impl Iterator<Item = Vec3>) -> f64 {
    values.map(|value| f64::from(value.length_squared())).sum::<f64>().sqrt()
}

fn difference(a: &[Vec3], b: &[Vec3]) -> f64 {
    norm(a.iter().zip(b).map(|(a, b)| *a - *b)) / norm(b.iter().copied())
}

fn operator() -> Operator {
    let (matrix, _) = HaarBlocks::encode(&rows(), layout());
    assert!(matrix.is_sound(ROWS, COUNT));
    Operator::new(ROWS, Matrix::HaarBlocks(matrix), Default::default(), EncodingError::default())
}

fn apply(operator: &Operator, light: &Coefficients, epsilon: f32) -> (Vec<Vec3>, Work) {
    let mut out = vec![Vec3::ZERO; ROWS];
    let work = operator.apply_coefficients(light, epsilon, &mut out);
    (out, work)
}

#[test]
fn blocks_do_what_rows_do() {
    let (rows, light) = (rows(), light(3));
    let (matrix, lost) = HaarBlocks::encode(&rows, layout());
    let energy: f64 = rows.iter().flat_map(|rows| &rows.energies).sum();
    let expected = (lost / energy).sqrt();
    let operator =
        Operator::new(ROWS, Matrix::HaarBlocks(matrix), Default::default(), EncodingError::default());
    let (out, work) = apply(&operator, &light, 0.0);
    let error = difference(&out, &product(&rows, &light));
    println!("off by {error:.5}, expected {expected:.5}, {work:?}");
    // 8 bits of a range of 2.2 have a step of 0.009
    assert!(error < 0.006 && expected < 0.006 && expected > 1e-4, "{error} {expected}");
    let other = ImageLayout { places: (0..ROWS as u32).collect::<Vec<_>>().into(), ..layout() };
    let (elsewhere, _) = HaarBlocks::encode(&rows, other);
    let shifted = HaarBlocks { layout: layout(), ..elsewhere };
    let shifted =
        Operator::new(ROWS, Matrix::HaarBlocks(shifted), Default::default(), EncodingError::default());
    assert!(difference(&apply(&shifted, &light, 0.0).0, &out) > 0.1, "another layout must be noticed");
}

/// By the stored records alone: every non-zero is in one block, and no two blocks of a wavelet light overlap.
#[test]
fn every_coefficient_is_stored_once() {
    let (rows, layout) = (rows(), layout());
    let (matrix, _) = HaarBlocks::encode(&rows, layout.clone());
    let across = layout.width.div_ceil(TILE);
    let mut stored = HashMap::new();
    let mut blocks = matrix.blocks.iter();
    for (tile, &count) in matrix.tiles.iter().enumerate() {
        for block in blocks.by_ref().take(count as usize) {
            for (line, column) in (0..block.height).flat_map(|line| (0..block.width).map(move |c| (line, c)))
            {
                let y = tile / across * TILE + usize::from(block.y + line);
                let x = tile % across * TILE + usize::from(block.x + column);
                let twice = stored.insert((block.coefficient, y * layout.width + x), ());
                assert!(twice.is_none(), "{block:?} overlaps");
            }
        }
    }
    let all = rows.iter().flat_map(KeptRows::rows).zip(layout.places.iter());
    for ((indices, values, _), &place) in all {
        for (&coefficient, _) in indices.iter().zip(values).filter(|(_, value)| **value != 0.0) {
            assert!(stored.contains_key(&(coefficient, place as usize)), "{coefficient} at {place}");
        }
    }
    let full = 20.0 * ROWS as f64 / matrix.used_texels() as f64;
    println!("{} blocks, {full:.2} of them non-zero", matrix.blocks.len());
    assert_eq!(stored.len(), matrix.used_texels());
    assert!(full > 0.5 && matrix.zeros() + 20 * ROWS >= matrix.used_texels());
}

#[test]
fn zero_is_a_level_and_both_ends_are_reached() {
    for (low, high) in [(-1.0, 2.0), (0.5, 0.7), (-3.0, -2.0), (-1e-6, 1.0), (0.0, 0.0), (0.3, 0.3)] {
        for with_zero in [true, false] {
            let levels = Levels::new(low, high, with_zero);
            let off = |value: f32| (levels.value(levels.nearest(value)) - value).abs();
            let step = levels.scale.max(1e-7);
            assert!(off(low) < 0.51 * step && off(high) < 0.51 * step, "{low} to {high}: {levels:?}");
            assert!(!with_zero || off(0.0) == 0.0, "{low} to {high}: {levels:?}");
        }
    }
}

#[test]
fn culling_adds_no_more_than_it_may() {
    let operator = operator();
    // a light that fades from coarse to fine
    let light: Vec<Vec3> =
        (0..COUNT).map(|i| Vec3::new((-(i as f32) / 20.0).exp(), 0.2, 1.0 / (1 + i) as f32)).collect();
    let light = Coefficients::new(&light, &[], &[]);
    let (all, work) = apply(&operator, &light, 0.0);
    assert_eq!(work.culled, 0);
    let mut before = 0;
    for epsilon in [0.01, 0.1, 0.5] {
        let (culled, work) = apply(&operator, &light, epsilon);
        let error = difference(&culled, &all);
        println!("epsilon {epsilon}: {:.3} culled, off by {error:.5}", work.culled as f64 / work.all as f64);
        assert!(error <= f64::from(epsilon) && work.culled >= before, "{epsilon}: {error} {work:?}");
        before = work.culled;
    }
    assert!(before > 0, "something is faint");
    assert!(difference(&apply(&operator, &light, 1.0).0, &all) > 1e-3, "what is left out is noticed");
    let dark = Coefficients::new(&[Vec3::ZERO; COUNT], &[], &[]);
    let (out, work) = apply(&operator, &dark, 0.01);
    assert!(work.culled == work.all && out.iter().all(|v| *v == Vec3::ZERO), "nothing is drawn in the dark");
}

#[test]
fn the_order_of_blocks_leaves_no_trace() {
    let (one, _) = HaarBlocks::encode(&rows(), layout());
    let mut whole = KeptRows { per_row: 20, weight: 1.0, ..KeptRows::default() };
    for rows in rows() {
        whole.indices.extend(rows.indices);
        whole.values.extend(rows.values);
        whole.energies.extend(rows.energies);
    }
    let (other, _) = HaarBlocks::encode(&[whole], layout());
    assert!(*one.blocks == *other.blocks && *one.texels == *other.texels);
}

#[test]
fn what_does_not_fit_is_refused() {
    let (matrix, _) = HaarBlocks::encode(&rows(), layout());
    assert!(matrix.is_sound(ROWS, COUNT));
    assert!(!matrix.is_sound(ROWS - 1, COUNT) && !matrix.is_sound(ROWS, 200));
    let block = |change: &dyn Fn(&mut ImageBlock)| {
        let mut blocks = matrix.blocks.to_vec();
        change(&mut blocks[7]);
        HaarBlocks { blocks: blocks.into(), ..matrix.clone() }
    };
    let wrong: [&dyn Fn(&mut ImageBlock); 11] = [
        &|block| block.coefficient = COUNT as u32,
        &|block| block.x = TILE as u8 - block.width + 1,
        &|block| block.y = TILE as u8 - block.height + 1,
        &|block| block.width = 0,
        &|block| block.height = 0,
        &|block| block.atlas = 1,
        &|block| block.atlas = u32::MAX,
        &|block| block.column = ATLAS as u16,
        &|block| block.line = ATLAS as u16 - 1,
        &|block| block.scale = f32::NAN,
        &|block| block.offset = f32::INFINITY,
    ];
    for (number, change) in wrong.iter().enumerate() {
        assert!(!block(change).is_sound(ROWS, COUNT), "change {number}");
    }
    assert!(block(&|_| {}).is_sound(ROWS, COUNT));
    let mut tiles = matrix.tiles.to_vec();
    tiles[0] += 1;
    assert!(!HaarBlocks { tiles: tiles.into(), ..matrix.clone() }.is_sound(ROWS, COUNT));
    let shorter = matrix.texels[..matrix.texels.len() - ATLAS].to_vec();
    assert!(!HaarBlocks { texels: shorter.into(), ..matrix.clone() }.is_sound(ROWS, COUNT));
    let narrow = ImageLayout { width: 40, ..layout() };
    assert!(!HaarBlocks { layout: narrow, ..matrix.clone() }.is_sound(ROWS, COUNT));
}
