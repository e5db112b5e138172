use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::LightSample;
use crate::scene::{EnvironmentMap, Light, LightKind};
use crate::trace::sampling::uniform_sphere;

/// A dome light with its turn worked out.
#[derive(Clone, Debug)]
pub struct Dome {
    map: Option<Arc<EnvironmentMap>>,
    intensity: Vec3,
    /// Of the rotation about +Y.
    sin: f32,
    cos: f32,
}

impl Dome {
    /// Of a map that is turned by `rotation` degrees, from +Z towards +X, and multiplied by `intensity`.
    pub fn new(map: Option<Arc<EnvironmentMap>>, intensity: Vec3, rotation: f32) -> Self {
        let (sin, cos) = f64::from(rotation).to_radians().sin_cos();
        Self { map, intensity, sin: sin as f32, cos: cos as f32 }
    }

    /// What shines where, before it is turned; `None` is the same everywhere.
    pub fn map(&self) -> Option<&EnvironmentMap> {
        self.map.as_deref()
    }

    /// What the map is multiplied by, W/(sr m^2).
    pub fn intensity(&self) -> Vec3 {
        self.intensity
    }

    /// The suns of its map, which [`Self::radiance_without_suns`] leaves out, as lights.
    pub fn suns(&self) -> impl Iterator<Item = Light> + '_ {
        let suns = self.map.as_deref().map_or(&[][..], EnvironmentMap::suns);
        suns.iter().map(|sun| {
            let (direction, irradiance) = (-self.turned(sun.direction), sun.irradiance * self.intensity);
            let kind = LightKind::Distant { direction, irradiance, angle: sun.angle };
            Light { name: String::new(), enabled: true, kind }
        })
    }

    /// A direction of the map in the world.
    pub fn turned(&self, direction: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = direction;
        Vec3::new(x * self.cos + z * self.sin, y, z * self.cos - x * self.sin)
    }

    /// A direction of the world in the map.
    pub fn unturned(&self, direction: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = direction;
        Vec3::new(x * self.cos - z * self.sin, y, z * self.cos + x * self.sin)
    }

    /// What comes from a unit direction, W/(sr m^2).
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match &self.map {
            Some(map) => map.radiance(self.unturned(direction)) * self.intensity,
            None => self.intensity,
        }
    }

    /// The same without the suns of its map.
    pub fn radiance_without_suns(&self, direction: Vec3) -> Vec3 {
        match &self.map {
            Some(map) => map.radiance_without_suns(self.unturned(direction)) * self.intensity,
            None => self.intensity,
        }
    }

    /// With which density, 1/sr, [`Self::sample`] draws a unit direction.
    pub fn density(&self, direction: Vec3) -> f32 {
        self.map.as_ref().map_or(0.25 / PI, |map| map.density(self.unturned(direction)))
    }

    /// Light from a direction drawn by brightness; `sample` is in `[0, 1)^2`. Also returns its density, 1/sr. `None` where nothing shines.
    pub fn sample(&self, sample: Vec2) -> Option<(LightSample, f32)> {
        let (direction, radiance, density) = match &self.map {
            Some(map) => {
                let drawn = map.sample(sample)?;
                (self.turned(drawn.direction), drawn.radiance * self.intensity, drawn.density)
            }
            None => (uniform_sphere(sample), self.intensity, 0.25 / PI),
        };
        let irradiance = radiance / density;
        Some((LightSample { direction, distance: f32::INFINITY, irradiance }, density))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dome(rotation: f32) -> Dome {
        let texels = (0..128).map(|i| Vec3::splat(1.0 + (i % 16) as f32)).collect();
        let map = EnvironmentMap::new("test", 16, 8, texels).unwrap();
        Dome::new(Some(Arc::new(map)), Vec3::splat(2.0), rotation)
    }

    #[test]
    fn a_turn_of_ninety_degrees_brings_what_was_ahead_to_the_left() {
        let (straight, turned) = (dome(0.0), dome(90.0));
        for angle in [0.1_f32, 1.1, 2.3, 4.0, 5.9] {
            let direction = Vec3::new(angle.sin(), 0.2, angle.cos()).normalize();
            let before = straight.radiance(direction);
            // from +Z towards +X
            let after = turned.turned(straight.unturned(direction));
            assert!((after - Vec3::new(direction.z, direction.y, -direction.x)).length() < 1e-6);
            assert_eq!(turned.radiance(after), before);
        }
    }

    #[test]
    fn what_is_drawn_is_what_is_seen() {
        for dome in [dome(33.0), Dome::new(None, Vec3::new(1.0, 2.0, 3.0), 0.0)] {
            for index in 0..100 {
                let (light, density) = dome.sample(crate::trace::sampling::sobol_2d(index, 0, 3)).unwrap();
                assert!((dome.density(light.direction) / density - 1.0).abs() < 1e-3);
                let seen = dome.radiance(light.direction);
                assert!((light.irradiance * density - seen).length() < 1e-3 * seen.length());
            }
        }
    }
}
