//! Suns in environment maps: compact places so bright that their shadows show.
//!
//! The cells of the sky are some degrees wide, and so are the shadows of what they hold. What is smaller and brings a good part of the light is
//! taken out of the map and becomes a disc that casts shadows by rays; what is left, is smooth enough for the cells.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::EnvironmentMap;

/// Suns that are taken out of one map at most.
const MOST: usize = 4;
/// Pixels belong to a sun that are at least this bright, beside its brightest.
const RIM: f32 = 0.05;
/// Largest solid angle of a sun, steradians: a disc of 4 degrees.
const LARGEST: f64 = 0.004;
/// Least share of the map's light that makes a sun worth its shadow rays.
const LEAST: f64 = 0.02;

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

/// A map without its suns, and these.
#[derive(Clone, Debug)]
pub(super) struct Split {
    /// `None` where there are no suns: then it is the map itself.
    pub(super) rest: Option<Box<EnvironmentMap>>,
    pub(super) suns: Vec<Sun>,
}

impl Split {
    pub(super) fn of(map: &EnvironmentMap) -> Self {
        let (width, height) = map.size();
        let mut texels: Vec<Vec3> =
            (0..width * height).map(|texel| map.texel(texel % width, texel / width)).collect();
        let pixels = Pixels { map, width, height };
        let total: f64 = texels.iter().enumerate().map(|(texel, light)| pixels.power(texel, *light)).sum();
        let mut suns = Vec::new();
        while suns.len() < MOST {
            let Some(sun) = pixels.take_sun(&mut texels, LEAST * total) else { break };
            suns.push(sun);
        }
        let rest =
            if suns.is_empty() { None } else { EnvironmentMap::new(map.name(), width, height, texels).ok() };
        Self { rest: rest.map(Box::new), suns }
    }
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

    /// Takes the brightest place out of the map, if it is compact and brings more than `least` (in sums of channels, W/m^2).
    fn take_sun(&self, texels: &mut [Vec3], least: f64) -> Option<Sun> {
        let brightness = |light: Vec3| light.element_sum();
        let brightest =
            (0..texels.len()).max_by(|&a, &b| brightness(texels[a]).total_cmp(&brightness(texels[b])))?;
        let rim = RIM * brightness(texels[brightest]);
        let (mut region, mut border) = (vec![brightest], Vec::new());
        let mut known = std::collections::HashSet::from([brightest]);
        let (mut next, mut solid_angle) = (0, self.solid_angle(brightest));
        while next < region.len() {
            for texel in self.neighbours(region[next]) {
                if !known.insert(texel) {
                    continue;
                }
                if brightness(texels[texel]) >= rim {
                    solid_angle += self.solid_angle(texel);
                    region.push(texel);
                } else {
                    border.push(texel);
                }
            }
            if solid_angle > LARGEST {
                return None;
            }
            next += 1;
        }
        if border.is_empty() {
            return None;
        }
        let around = border.iter().map(|&texel| texels[texel]).sum::<Vec3>() / border.len() as f32;
        let (mut irradiance, mut middle, mut squares) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for &texel in &region {
            let more = (texels[texel] - around).max(Vec3::ZERO);
            let power = self.power(texel, more);
            irradiance += more.as_dvec3() * self.solid_angle(texel);
            let place = ((texel % self.width) as f64 + 0.5, (texel / self.width) as f64 + 0.5);
            middle += self.map.direction(place.0, place.1).as_dvec3() * power;
            squares += power * power / self.solid_angle(texel);
        }
        let power = irradiance.element_sum();
        if power <= least {
            return None;
        }
        region.iter().for_each(|&texel| texels[texel] = texels[texel].min(around));
        // the disc of even radiance that is as concentrated
        let solid_angle = power * power / squares;
        let angle = 2.0 * (1.0 - solid_angle / (2.0 * PI)).acos().to_degrees();
        Some(Sun {
            direction: middle.normalize().as_vec3(),
            irradiance: irradiance.as_vec3(),
            angle: angle as f32,
        })
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

    #[test]
    fn a_sun_and_the_rest_are_the_map() {
        let map = map(4000.0);
        let [sun] = map.suns() else { panic!("{:?}", map.suns()) };
        let rest = map.without_suns();
        assert!((power(rest) + sun.irradiance - power(&map)).abs().max_element() < 1e-3 * power(&map).x);
        assert_eq!(rest.radiance(sun.direction), Vec3::ONE);
        assert!(sun.direction.distance(map.direction(0.5, 31.5)) < 1e-3);
        // three pixels of 1.4 degrees squared: as a disc, and less wide away from the horizon
        assert!((3.5..4.8).contains(&sun.angle), "{}", sun.angle);
    }

    #[test]
    fn what_is_faint_or_wide_stays_in_the_map() {
        assert!(map(20.0).suns().is_empty(), "a hundredth of the light");
        let half = (0..256 * 128).map(|i| Vec3::splat(if i < 256 * 64 { 9.0 } else { 0.1 })).collect();
        let half = EnvironmentMap::new("test", 256, 128, half).unwrap();
        assert!(half.suns().is_empty() && *half.without_suns() == half);
        let black = EnvironmentMap::new("test", 4, 2, vec![Vec3::ZERO; 8]).unwrap();
        assert!(black.suns().is_empty());
    }
}
