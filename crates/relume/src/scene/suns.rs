//! Suns in environment maps: compact places so bright that their shadows show.
//!
//! The cells of the sky are some degrees wide, and so are the shadows of what they hold. What is smaller and brings a good part of the light is
//! taken out of the map and becomes a disc that casts shadows by rays; what is left, is smooth enough for the cells.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::EnvironmentMap;

/// Suns that are taken out of one map at most.
const MOST: usize = 4;
/// Bright places that are looked at: the first ones may be too wide or too faint.
const TRIES: usize = 16;
/// Pixels belong to a bright place that are at least this bright, beside its brightest.
const RIM: f32 = 0.05;
/// Largest solid angle of a sun, steradians: a disc of 4 degrees.
const LARGEST: f64 = 0.004;
/// Least share of the map's light that makes a sun worth its shadow rays.
const LEAST: f64 = 0.02;
/// Pixels of what is left, at most: the cells of the sky are coarser by far.
const SIZE: (usize, usize) = (2048, 1024);

/// A compact part of a map, as a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit, from the scene towards it, in the map.
    pub direction: Vec3,
    /// On a surface that faces it, W/m^2.
    pub irradiance: Vec3,
    /// Diameter, degrees.
    pub angle: f32,
}

/// What is left of a map without its suns, at most 2048 by 1024 pixels: each the mean of the map over its part of the sphere.
#[derive(Clone, Debug)]
pub struct WithoutSuns {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// W/(sr m^2), row by row.
    pub texels: Vec<Vec3>,
}

/// A map as what is left of it, and its suns.
#[derive(Clone, Debug)]
pub(super) struct Split {
    pub(super) rest: WithoutSuns,
    pub(super) suns: Vec<Sun>,
}

impl Split {
    pub(super) fn of(map: &EnvironmentMap) -> Self {
        let (width, height) = map.size();
        let mut texels: Vec<Vec3> =
            (0..width * height).map(|texel| map.texel(texel % width, texel / width)).collect();
        let pixels = Pixels { map, width, height };
        let total: f64 = texels.iter().enumerate().map(|(texel, light)| pixels.power(texel, *light)).sum();
        let (mut suns, mut passed) = (Vec::new(), vec![false; texels.len()]);
        for _ in 0..TRIES {
            let Some(place) = pixels.brightest(&texels, &mut passed) else { break };
            suns.extend(pixels.take_sun(&place, &mut texels, LEAST * total));
            if suns.len() == MOST {
                break;
            }
        }
        Self { rest: pixels.reduced(&texels), suns }
    }
}

/// Pixels that belong together, and those around; both cut short where they are too many for a sun.
struct Place {
    region: Vec<usize>,
    border: Vec<usize>,
    /// Steradians.
    solid_angle: f64,
}

struct Pixels<'a> {
    map: &'a EnvironmentMap,
    width: usize,
    height: usize,
}

impl Pixels<'_> {
    fn solid_angle(&self, texel: usize) -> f64 {
        self.map.solid_angle(texel / self.width)
    }

    fn power(&self, texel: usize, light: Vec3) -> f64 {
        f64::from(light.element_sum()) * self.solid_angle(texel)
    }

    /// The pixels around one.
    fn neighbours(&self, texel: usize) -> impl Iterator<Item = usize> + '_ {
        let (column, row) = (texel % self.width, texel / self.width);
        let rows = row.saturating_sub(1)..(row + 2).min(self.height);
        rows.flat_map(move |row| {
            (0..3).map(move |step| row * self.width + (column + self.width + step - 1) % self.width)
        })
    }

    /// The brightest pixel that was not `passed` by and what is about as bright around it, which is passed by from now on; `None` where all is
    /// black.
    fn brightest(&self, texels: &[Vec3], passed: &mut [bool]) -> Option<Place> {
        let brightness = |texel: usize| texels[texel].element_sum();
        let left = (0..texels.len()).filter(|&texel| !passed[texel]);
        let brightest = left.max_by(|&a, &b| brightness(a).total_cmp(&brightness(b)))?;
        let rim = RIM * brightness(brightest);
        if rim <= 0.0 {
            return None;
        }
        let mut place = Place { region: Vec::new(), border: Vec::new(), solid_angle: 0.0 };
        passed[brightest] = true;
        let mut waiting = vec![brightest];
        while let Some(texel) = waiting.pop() {
            place.solid_angle += self.solid_angle(texel);
            let small = place.solid_angle <= LARGEST;
            if small {
                place.region.push(texel);
            }
            for near in self.neighbours(texel).filter(|&near| near != texel) {
                if brightness(near) < rim {
                    if small {
                        place.border.push(near);
                    }
                } else if !std::mem::replace(&mut passed[near], true) {
                    waiting.push(near);
                }
            }
        }
        // a pixel may lie beside several
        place.border.sort_unstable();
        place.border.dedup();
        Some(place)
    }

    /// Takes a place out of the map, down to what is around it, if it is compact and brings more than `least` (in sums of channels, W/m^2).
    fn take_sun(&self, place: &Place, texels: &mut [Vec3], least: f64) -> Option<Sun> {
        if place.solid_angle > LARGEST || place.border.is_empty() {
            return None;
        }
        let around =
            place.border.iter().map(|&texel| texels[texel]).sum::<Vec3>() / place.border.len() as f32;
        let (mut irradiance, mut middle, mut squares) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for &texel in &place.region {
            let more = (texels[texel] - around).max(Vec3::ZERO);
            let power = self.power(texel, more);
            irradiance += more.as_dvec3() * self.solid_angle(texel);
            let (x, y) = ((texel % self.width) as f64 + 0.5, (texel / self.width) as f64 + 0.5);
            middle += self.map.direction(x, y).as_dvec3() * power;
            squares += power * power / self.solid_angle(texel);
        }
        let power = irradiance.element_sum();
        if power <= least {
            return None;
        }
        place.region.iter().for_each(|&texel| texels[texel] = texels[texel].min(around));
        // the disc of even radiance that is as concentrated
        let solid_angle = power * power / squares;
        let angle = 2.0 * (1.0 - solid_angle / (2.0 * PI)).acos().to_degrees();
        Some(Sun {
            direction: middle.normalize().as_vec3(),
            irradiance: irradiance.as_vec3(),
            angle: angle as f32,
        })
    }

    /// Means of `texels` over the pixels of a map of at most [`SIZE`].
    fn reduced(&self, texels: &[Vec3]) -> WithoutSuns {
        let (width, height) = (self.width.min(SIZE.0), self.height.min(SIZE.1));
        let part = |place: usize, places: usize, pixels: usize| {
            place * pixels / places..(place + 1) * pixels / places
        };
        let mean = |place: usize| {
            let (mut light, mut total) = (DVec3::ZERO, 0.0);
            for line in part(place / width, height, self.height) {
                let row = &texels[line * self.width..][part(place % width, width, self.width)];
                light += row.iter().map(|texel| texel.as_dvec3()).sum::<DVec3>() * self.map.solid_angle(line);
                total += row.len() as f64 * self.map.solid_angle(line);
            }
            (light / total).as_vec3()
        };
        WithoutSuns { width, height, texels: (0..width * height).map(mean).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sky of radiance 1 with a sun of some pixels across the seam of the map.
    fn map(sun: f32) -> EnvironmentMap {
        let texel = |i: usize| {
            let (x, y) = (i % 256, i / 256);
            if (x < 2 || x == 255) && (30..33).contains(&y) {
                Vec3::new(sun, 0.5 * sun, 0.25 * sun)
            } else {
                Vec3::ONE
            }
        };
        EnvironmentMap::new("test", 256, 128, (0..256 * 128).map(texel).collect()).unwrap()
    }

    fn power(map: &EnvironmentMap) -> Vec3 {
        (0..256 * 128).map(|i| map.texel(i % 256, i / 256) * map.solid_angle(i / 256) as f32).sum()
    }

    fn power_left(map: &EnvironmentMap) -> Vec3 {
        let rest = map.without_suns();
        assert_eq!((rest.width, rest.height), map.size());
        rest.texels.iter().enumerate().map(|(i, light)| *light * map.solid_angle(i / 256) as f32).sum()
    }

    #[test]
    fn a_sun_and_the_rest_are_the_map() {
        let map = map(4000.0);
        let [sun] = map.suns() else { panic!("{:?}", map.suns()) };
        let sum = power_left(&map) + sun.irradiance;
        assert!((sum - power(&map)).abs().max_element() < 1e-3 * power(&map).x);
        assert!(map.without_suns().texels.iter().all(|texel| *texel == Vec3::ONE));
        assert!(sun.direction.distance(map.direction(0.5, 31.5)) < 1e-3);
        // three pixels of 1.4 degrees squared: as a disc, and less wide away from the horizon
        assert!((3.5..4.8).contains(&sun.angle), "{}", sun.angle);
    }

    /// Discs of radiance, by their direction and the cosine of their radius, on a sky of radiance 1.
    fn discs(discs: &[(Vec3, f32, f32)]) -> EnvironmentMap {
        let plan = map(1.0);
        let texel = |i: usize| {
            let direction = plan.direction((i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5);
            let light = discs.iter().filter(|(middle, cos, _)| middle.dot(direction) > *cos);
            Vec3::splat(1.0 + light.map(|(_, _, radiance)| radiance).sum::<f32>())
        };
        EnvironmentMap::new("test", 256, 128, (0..256 * 128).map(texel).collect()).unwrap()
    }

    #[test]
    fn suns_are_found_beside_each_other_at_the_pole_and_behind_brighter_windows() {
        let (side, pole, window) = (Vec3::new(0.6, 0.8, 0.0), Vec3::Y, Vec3::new(0.0, 0.0, 1.0));
        let map = discs(&[(side, 0.9997, 2500.0), (pole, 0.9997, 2400.0), (window, 0.99, 2600.0)]);
        let suns = map.suns();
        assert_eq!(suns.len(), 2, "{suns:?}");
        assert!(suns[0].direction.distance(side) < 0.01 && suns[1].direction.distance(pole) < 0.01);
        let sum = power_left(&map) + suns[0].irradiance + suns[1].irradiance;
        assert!((sum / power(&map) - 1.0).abs().max_element() < 1e-3);
    }

    #[test]
    fn large_maps_are_reduced_to_their_means() {
        let texel = |i: usize| Vec3::splat((i % 7) as f32);
        let map = EnvironmentMap::new("test", 3000, 1500, (0..3000 * 1500).map(texel).collect()).unwrap();
        let rest = map.without_suns();
        assert_eq!((rest.width, rest.height), SIZE);
        let whole: f64 = (0..3000 * 1500).map(|i| f64::from(texel(i).x) * map.solid_angle(i / 3000)).sum();
        let mean = whole / (4.0 * PI);
        let middle = 1024 * 512..1024 * 512 + 2048 * 8;
        let found = rest.texels[middle.clone()].iter().map(|texel| f64::from(texel.x)).sum::<f64>()
            / middle.len() as f64;
        assert!((found / mean - 1.0).abs() < 0.02, "{found} instead of {mean}");
    }

    #[test]
    fn what_is_faint_or_wide_stays_in_the_map() {
        assert!(map(20.0).suns().is_empty(), "a hundredth of the light");
        let half = (0..256 * 128).map(|i| Vec3::splat(if i < 256 * 64 { 9.0 } else { 0.1 })).collect();
        let half = EnvironmentMap::new("test", 256, 128, half).unwrap();
        assert!(half.suns().is_empty() && half.without_suns().texels[0] == Vec3::splat(9.0));
        let black = EnvironmentMap::new("test", 4, 2, vec![Vec3::ZERO; 8]).unwrap();
        assert!(black.suns().is_empty() && black.without_suns().texels[3] == Vec3::ZERO);
    }
}
