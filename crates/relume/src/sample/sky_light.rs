//! Dome lights on the sky's cells.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::SkyCells;
use crate::scene::WithoutSuns;
use crate::shade::Dome;

/// Places around the horizon at which a map is read, about; half as many from pole to pole. Several hundred fall into a cell that is nothing
/// special.
const AROUND: usize = 2048;
/// Rows of places that one task reads.
const ROWS: usize = 64;

/// The mean radiance of a dome over each cell of the sky, W/(sr m^2); without the suns of its map, which are [discs](crate::scene::Sun).
pub fn illuminate_sky(sky: &SkyCells, dome: &Dome) -> Vec<Vec3> {
    let Some(map) = dome.map() else { return vec![dome.intensity(); sky.len()] };
    if sky.is_empty() {
        return Vec::new();
    }
    let map = map.without_suns();
    let grid = Grid::new(map, dome);
    // the sums of each part are added in one order, whoever computes them
    let parts: Vec<Vec<(Vec3, f32)>> = (0..grid.heights.len())
        .into_par_iter()
        .step_by(ROWS)
        .map(|first| grid.sums(sky, first..(first + ROWS).min(grid.heights.len())))
        .collect();
    (0..sky.len())
        .map(|cell| {
            let (light, weight) = parts.iter().fold((Vec3::ZERO, 0.0), |(light, weight), part| {
                (light + part[cell].0, weight + part[cell].1)
            });
            // a cell between the places shows what is in its middle
            if weight > 0.0 {
                light / weight * dome.intensity()
            } else {
                dome.radiance(sky.direction(cell, Vec2::splat(0.5)))
            }
        })
        .collect()
}

/// Places at which a map is read: so many a pixel.
struct Grid<'a> {
    map: &'a WithoutSuns,
    /// Of each column, in the world: sine and cosine of the angle from +Z.
    around: Vec<(f32, f32)>,
    /// Of each row: sine and cosine of the angle from +Y, and the solid angle of a place.
    heights: Vec<(f32, f32, f32)>,
}

impl<'a> Grid<'a> {
    fn new(map: &'a WithoutSuns, dome: &Dome) -> Self {
        let columns = map.width * AROUND.div_ceil(map.width);
        let rows = map.height * (AROUND / 2).div_ceil(map.height);
        let around = (0..columns).map(|column| {
            let longitude = (0.5 - (column as f64 + 0.5) / columns as f64) * TAU;
            let turned = dome.turned(Vec3::new(longitude.sin() as f32, 0.0, longitude.cos() as f32));
            (turned.x, turned.z)
        });
        let heights = (0..rows).map(|row| {
            let polar = |row: f64| row / rows as f64 * PI;
            let [upper, lower] = [row as f64, row as f64 + 1.0].map(|row| polar(row).cos());
            let (sin, cos) = polar(row as f64 + 0.5).sin_cos();
            (sin as f32, cos as f32, (TAU / columns as f64 * (upper - lower)) as f32)
        });
        Self { map, around: around.collect(), heights: heights.collect() }
    }

    /// What the places of some rows add to each cell: radiance times solid angle, and solid angle.
    fn sums(&self, sky: &SkyCells, rows: Range<usize>) -> Vec<(Vec3, f32)> {
        let mut sums = vec![(Vec3::ZERO, 0.0); sky.len()];
        let WithoutSuns { width, height, ref texels } = *self.map;
        let across = self.around.len() / width;
        for row in rows {
            let (sin, cos, solid_angle) = self.heights[row];
            let line = &texels[row * height / self.heights.len() * width..][..width];
            for (column, &(x, z)) in self.around.iter().enumerate() {
                let Some(cell) = sky.cell_at(Vec3::new(x * sin, cos, z * sin)) else { continue };
                sums[cell].0 += line[column / across] * solid_angle;
                sums[cell].1 += solid_angle;
            }
        }
        sums
    }
}
