use std::f64::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

use glam::{Vec2, Vec3};
use xxhash_rust::xxh3::xxh3_64;

use super::suns::{Split, Sun, WithoutSuns};
use crate::{Error, Result};

/// Pixels along the longer side at most.
const LONGEST: usize = 8192;
/// Largest radiance: sums over all pixels stay finite.
const BRIGHTEST: f32 = 1e30;

/// Light from all directions: an equirectangular image of radiance, as it is painted on the inside of a sphere.
///
/// The top row is around +Y. The middle of the image lies in the direction +Z, its left and right border in -Z, and its right half in -X: the
/// latitude-longitude layout of OpenEXR, which USD's dome lights have too. Each pixel is one radiance all over: nothing is interpolated, so that
/// what is drawn by brightness and what a direction shows agree exactly.
///
/// Clones share the pixels.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    name: String,
    width: usize,
    height: usize,
    texels: Arc<Vec<Vec3>>,
    /// Sums of the brightness of the rows up to and including each, the last one 1.
    rows: Arc<Vec<f64>>,
    /// The same within each row.
    columns: Arc<Vec<f32>>,
    hash: u64,
    split: Arc<OnceLock<Split>>,
}

/// The same pixels by the same name.
impl PartialEq for EnvironmentMap {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, self.hash) == (other.width, other.height, other.hash)
            && self.name == other.name
    }
}

/// A direction drawn from a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentSample {
    /// Unit.
    pub direction: Vec3,
    /// W/(sr m^2).
    pub radiance: Vec3,
    /// 1/sr.
    pub density: f32,
}

impl EnvironmentMap {
    /// Pixels a side at most.
    pub const LONGEST: usize = LONGEST;

    /// From rows of radiance (W/(sr m^2), linear RGB), the top one first. `name` is kept as the file's.
    ///
    /// # Errors
    /// [`Error::Setting`] unless there are `width * height` pixels, 1 to 8192 a side, each from 0 to 1e30.
    pub fn new(name: impl Into<String>, width: usize, height: usize, texels: Vec<Vec3>) -> Result<Self> {
        let (name, range) = (name.into(), 1..=LONGEST);
        if !range.contains(&width) || !range.contains(&height) || texels.len() != width * height {
            return Err(Error::Setting(format!(
                "an environment map of {width}x{height} pixels: each side must be 1 to {LONGEST}; scale it down"
            )));
        }
        let is_light =
            |texel: &Vec3| texel.to_array().iter().all(|channel| (0.0..=BRIGHTEST).contains(channel));
        if let Some(bad) = texels.iter().position(|texel| !is_light(texel)) {
            return Err(Error::Setting(format!(
                "the environment map's pixel at column {}, row {} is {}: radiance must be 0 to 1e30",
                bad % width,
                bad / width,
                texels[bad]
            )));
        }
        let hash = xxh3_64(bytemuck::cast_slice(&texels));
        let (mut rows, mut columns) = (Vec::with_capacity(height), Vec::with_capacity(width * height));
        let mut total = 0.0;
        for (row, texels) in texels.chunks_exact(width).enumerate() {
            let mut sum = 0.0;
            let sums: Vec<f64> = texels
                .iter()
                .map(|texel| {
                    sum += f64::from(texel.element_sum());
                    sum
                })
                .collect();
            columns.extend(sums.iter().map(|part| if sum > 0.0 { (part / sum) as f32 } else { 0.0 }));
            total += sum * solid_angle(width, height, row);
            rows.push(total);
        }
        if total > 0.0 {
            rows.iter_mut().for_each(|sum| *sum /= total);
        }
        Ok(Self {
            name,
            width,
            height,
            texels: texels.into(),
            rows: rows.into(),
            columns: columns.into(),
            hash,
            split: Arc::default(),
        })
    }

    /// As it was given, for a rig to name it by.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The same map by another name.
    #[must_use]
    pub fn renamed(&self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self.clone() }
    }

    /// Of its pixels.
    pub fn content_hash(&self) -> u64 {
        self.hash
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Its compact bright places, the brightest first: found when they are first asked for.
    pub fn suns(&self) -> &[Sun] {
        &self.split().suns
    }

    /// The map without them, where what was around is in their place.
    pub fn without_suns(&self) -> &WithoutSuns {
        &self.split().rest
    }

    fn split(&self) -> &Split {
        self.split.get_or_init(|| Split::of(self))
    }

    /// The pixel at a column and row, W/(sr m^2).
    ///
    /// # Panics
    /// If it lies outside.
    pub fn texel(&self, column: usize, row: usize) -> Vec3 {
        self.texels[row * self.width + column]
    }

    /// Solid angle of each pixel of a row, steradians.
    pub fn solid_angle(&self, row: usize) -> f64 {
        solid_angle(self.width, self.height, row)
    }

    /// The column and row of the pixel that a unit direction shows.
    fn place(&self, direction: Vec3) -> (usize, usize) {
        place(direction, self.width, self.height)
    }

    /// The unit direction of a place, in pixels from the upper left corner.
    pub fn direction(&self, x: f64, y: f64) -> Vec3 {
        let (longitude, polar) = ((0.5 - x / self.width as f64) * TAU, y / self.height as f64 * PI);
        towards(longitude, polar.cos())
    }

    /// What a unit direction shows, W/(sr m^2).
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let (column, row) = self.place(direction);
        self.texel(column, row)
    }

    /// The same of [`Self::without_suns`].
    pub fn radiance_without_suns(&self, direction: Vec3) -> Vec3 {
        let WithoutSuns { width, height, texels } = self.without_suns();
        let (column, row) = place(direction, *width, *height);
        texels[row * width + column]
    }

    /// With which density, 1/sr, [`Self::sample`] draws a unit direction.
    pub fn density(&self, direction: Vec3) -> f32 {
        let (column, row) = self.place(direction);
        self.density_at(column, row)
    }

    fn density_at(&self, column: usize, row: usize) -> f32 {
        let of_row = self.rows[row] - row.checked_sub(1).map_or(0.0, |before| self.rows[before]);
        let columns = &self.columns[row * self.width..(row + 1) * self.width];
        let of_column = columns[column] - column.checked_sub(1).map_or(0.0, |before| columns[before]);
        (of_row * f64::from(of_column) / self.solid_angle(row)) as f32
    }

    /// Draws a direction with a density in proportion to the sum of the channels; `sample` is in `[0, 1)^2`. `None` where the map is black.
    pub fn sample(&self, sample: Vec2) -> Option<EnvironmentSample> {
        if self.rows.last().is_none_or(|&total| total <= 0.0) {
            return None;
        }
        let (row, down) = drawn(self.height, f64::from(sample.y), |row| self.rows[row]);
        let columns = &self.columns[row * self.width..(row + 1) * self.width];
        let (column, along) = drawn(self.width, f64::from(sample.x), |column| f64::from(columns[column]));
        // evenly over the pixel's solid angle
        let [upper, lower] = [row, row + 1].map(|row| (row as f64 / self.height as f64 * PI).cos());
        let longitude = (0.5 - (column as f64 + along) / self.width as f64) * TAU;
        let density = self.density_at(column, row);
        (density > 0.0).then(|| EnvironmentSample {
            direction: towards(longitude, upper + (lower - upper) * down),
            radiance: self.texel(column, row),
            density,
        })
    }
}

/// The column and row of the pixel of a map that a unit direction shows.
fn place(direction: Vec3, width: usize, height: usize) -> (usize, usize) {
    let longitude = f64::from(direction.x).atan2(f64::from(direction.z));
    let column = (0.5 - longitude / TAU) * width as f64;
    let row = f64::from(direction.y.clamp(-1.0, 1.0)).acos() / PI * height as f64;
    ((column as usize).min(width - 1), (row as usize).min(height - 1))
}

fn towards(longitude: f64, height: f64) -> Vec3 {
    let out = (1.0 - height * height).max(0.0).sqrt();
    Vec3::new((longitude.sin() * out) as f32, height as f32, (longitude.cos() * out) as f32)
}

fn solid_angle(width: usize, height: usize, row: usize) -> f64 {
    let [upper, lower] = [row, row + 1].map(|row| (row as f64 / height as f64 * PI).cos());
    TAU / width as f64 * (upper - lower)
}

/// The interval of a cumulative sum in which `random` falls, and where within it, `[0, 1)`.
fn drawn(count: usize, random: f64, sum: impl Fn(usize) -> f64) -> (usize, f64) {
    let (mut first, mut end) = (0, count);
    while first < end {
        let middle = (first + end) / 2;
        if sum(middle) <= random { first = middle + 1 } else { end = middle }
    }
    let index = first.min(count - 1);
    let before = index.checked_sub(1).map_or(0.0, &sum);
    (index, ((random - before) / (sum(index) - before).max(1e-300)).clamp(0.0, 1.0 - f64::EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{sobol_2d, uniform_sphere};

    fn map() -> EnvironmentMap {
        let texel = |i: usize| Vec3::new(0.2, 0.1 * (i % 5) as f32, if i == 37 { 900.0 } else { 0.3 });
        EnvironmentMap::new("test", 16, 8, (0..128).map(texel).collect()).unwrap()
    }

    #[test]
    fn the_layout_is_that_of_openexr() {
        let column = |x: usize| (0..8).map(move |y| if x == 4 * y { Vec3::ONE } else { Vec3::ZERO });
        let texels: Vec<Vec3> =
            (0..8).flat_map(|y| (0..16).map(move |x| column(x).nth(y).unwrap())).collect();
        let map = EnvironmentMap::new("test", 16, 8, texels).unwrap();
        assert_eq!(map.place(Vec3::Y).1, 0);
        assert_eq!(map.place(Vec3::NEG_Y).1, 7);
        assert_eq!(map.place(Vec3::new(-0.01, 0.01, 1.0).normalize()), (8, 3));
        assert_eq!(map.place(Vec3::new(-1.0, 0.01, 0.1).normalize()).0, 11);
        assert_eq!(map.place(Vec3::new(1.0, 0.01, 0.1).normalize()).0, 4);
        for (x, y) in [(0.5, 0.5), (3.2, 6.9), (15.9, 4.0)] {
            assert_eq!(map.place(map.direction(x, y)), (x as usize, y as usize));
        }
    }

    #[test]
    fn directions_are_drawn_by_brightness_and_give_the_sphere_its_light() {
        let map = map();
        let (mut drawn, mut even) = (Vec3::ZERO, Vec3::ZERO);
        let count = 1 << 16;
        for index in 0..count {
            let random = sobol_2d(index, 0, 1);
            let sample = map.sample(random).unwrap();
            assert!((map.density(sample.direction) / sample.density - 1.0).abs() < 1e-3);
            assert_eq!(map.radiance(sample.direction), sample.radiance);
            drawn += sample.radiance / sample.density;
            even += map.radiance(uniform_sphere(random)) * (4.0 * PI as f32);
        }
        let exact: Vec3 = (0..128).map(|i| map.texel(i % 16, i / 16) * map.solid_angle(i / 16) as f32).sum();
        let off = |sum: Vec3| (sum / count as f32 / exact - 1.0).abs().max_element();
        println!("by brightness {:.4}, evenly {:.4}", off(drawn), off(even));
        assert!(off(drawn) < 0.02 && off(even) < 0.02);
        let sphere: f64 = (0..8).map(|row| 16.0 * map.solid_angle(row)).sum();
        assert!((sphere - 4.0 * PI).abs() < 1e-9);
    }

    #[test]
    fn black_maps_draw_nothing_and_bad_ones_are_refused() {
        let black = EnvironmentMap::new("black", 4, 2, vec![Vec3::ZERO; 8]).unwrap();
        assert_eq!(black.sample(Vec2::splat(0.3)), None);
        assert_eq!(black.density(Vec3::Y), 0.0);
        let refused = |width, texels| EnvironmentMap::new("bad", width, 2, texels).unwrap_err().to_string();
        let mut texels = vec![Vec3::ONE; 8];
        texels[6].y = f32::NAN;
        assert!(refused(4, texels).contains("column 2, row 1"));
        assert!(refused(0, Vec::new()).contains("0x2"));
        assert!(refused(8193, vec![Vec3::ONE; 16_386]).contains("scale it down"));
        assert!(map() == map() && map() != black);
    }
}
