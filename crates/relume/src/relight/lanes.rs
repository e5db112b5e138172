//! View samples shaded side by side: first how light arrives at them, then, for those that it reaches, what they reflect.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use multiversion::multiversion;

use crate::sample::unpacked;
pub(super) use crate::shade::LANES;
use crate::shade::{CenterLanes, Lane, PreparedLight};

/// Where samples are and how they lie, as structure of arrays by axis.
#[derive(Clone, Debug)]
pub(super) struct Places {
    pub(super) position: [Lane; 3],
    /// The sides of their packed geometric normals.
    pub(super) geometric: [Lane; 2],
    /// The same of those that they are shaded by.
    pub(super) shading: [Lane; 2],
}

/// How a light without extent arrives at samples, were nothing in between.
pub(super) struct Arrivals {
    /// Unit normals, unpacked.
    pub(super) geometric: [Lane; 3],
    pub(super) shading: [Lane; 3],
    pub(super) light: CenterLanes,
    /// Between the light and the shading normal; 0 where light comes from behind either normal, or none comes.
    pub(super) cos: Lane,
}

impl Places {
    /// Nowhere.
    pub(super) const ZERO: Self =
        Self { position: [[0.0; LANES]; 3], geometric: [[0.0; LANES]; 2], shading: [[0.0; LANES]; 2] };

    /// How `light` arrives at the places.
    pub(super) fn arrivals(&self, light: &PreparedLight) -> Arrivals {
        arrivals(self, light)
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn arrivals(places: &Places, light: &PreparedLight) -> Arrivals {
    let light = light.centers(&places.position);
    let none = [[0.0; LANES]; 3];
    let (mut geometric, mut shading, mut cos) = (none, none, [0.0; LANES]);
    for i in 0..LANES {
        let direction = [light.direction[0][i], light.direction[1][i], light.direction[2][i]];
        let lies = unpacked([places.geometric[0][i], places.geometric[1][i]]);
        let shades = unpacked([places.shading[0][i], places.shading[1][i]]);
        let faces = (dot(lies, direction) > 0.0) & (light.factor[i] > 0.0);
        cos[i] = if faces { dot(shades, direction).max(0.0) } else { 0.0 };
        [geometric[0][i], geometric[1][i], geometric[2][i]] = lies;
        [shading[0][i], shading[1][i], shading[2][i]] = shades;
    }
    Arrivals { geometric, shading, light, cos }
}

/// A view sample and the light that arrives there.
#[derive(Clone, Copy, Debug)]
pub(super) struct LitSample {
    /// Unit, that is shaded by.
    pub(super) normal: Vec3,
    /// Unit, to where light goes.
    pub(super) view: Vec3,
    /// Unit, to where it comes from, above the normal's horizon.
    pub(super) light: Vec3,
    /// Diffuse albedo without the share of the specular lobe.
    pub(super) k_d: Vec3,
    /// Specular reflectance at normal incidence.
    pub(super) f0: Vec3,
    /// Specular reflectance at grazing angles.
    pub(super) f90: f32,
    /// Perceptual roughness.
    pub(super) roughness: f32,
    /// Irradiance, cosine included, times what of the reflected light reaches the camera, W/m^2.
    pub(super) arriving: Vec3,
}

/// Some of them, as structure of arrays by axis or colour.
#[derive(Clone, Debug, Default)]
pub(super) struct Lanes {
    normal: [Lane; 3],
    view: [Lane; 3],
    light: [Lane; 3],
    k_d: [Lane; 3],
    f0: [Lane; 3],
    f90: Lane,
    roughness: Lane,
    arriving: [Lane; 3],
}

impl Lanes {
    pub(super) fn set(&mut self, lane: usize, sample: &LitSample) {
        let vectors = [
            (&mut self.normal, sample.normal),
            (&mut self.view, sample.view),
            (&mut self.light, sample.light),
            (&mut self.k_d, sample.k_d),
            (&mut self.f0, sample.f0),
            (&mut self.arriving, sample.arriving),
        ];
        for (lanes, vector) in vectors {
            [lanes[0][lane], lanes[1][lane], lanes[2][lane]] = vector.to_array();
        }
        (self.f90[lane], self.roughness[lane]) = (sample.f90, sample.roughness);
    }

    /// Radiance that reaches the camera, W/(sr m^2), RGB: [`Surface::specular`](crate::shade::Surface::specular) and the diffuse lobe, term by term.
    pub(super) fn shade(&self) -> [Lane; 3] {
        let mut radiance = [[0.0; LANES]; 3];
        shade(self, &mut radiance);
        radiance
    }
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn shade(lanes: &Lanes, radiance: &mut [Lane; 3]) {
    let Lanes { normal: [nx, ny, nz], view: [vx, vy, vz], light: [lx, ly, lz], f0, k_d, arriving, .. } =
        lanes;
    let (mut facets, mut schlick) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let n = [nx[i], ny[i], nz[i]];
        let (v, l) = ([vx[i], vy[i], vz[i]], [lx[i], ly[i], lz[i]]);
        let (cos_view, cos_light) = (dot(n, v), dot(n, l));
        let between = [v[0] + l[0], v[1] + l[1], v[2] + l[2]];
        let length2 = dot(between, between);
        let recip = 1.0 / length2.sqrt();
        let apart = length2 > 1e-30;
        let [hx, hy, hz]: [f32; 3] =
            [0, 1, 2].map(|axis| if apart { between[axis] * recip } else { n[axis] });
        let cos_half = dot(n, [hx, hy, hz]);
        let cross = [n[1] * hz - n[2] * hy, n[2] * hx - n[0] * hz, n[0] * hy - n[1] * hx];
        let alpha = lanes.roughness[i] * lanes.roughness[i];
        let alpha2 = alpha * alpha;
        let slope = dot(cross, cross) / alpha2 + cos_half * cos_half;
        let distribution = 1.0 / (PI * alpha2 * slope * slope);
        let root = |cos: f32| (alpha2 + (1.0 - alpha2) * cos * cos).sqrt();
        let visibility = 0.5 / (cos_light * root(cos_view) + cos_view * root(cos_light));
        let seen = (cos_view > 0.0) & (lanes.f90[i] != 0.0);
        facets[i] = if seen { distribution * visibility } else { 0.0 };
        let x = (1.0 - dot(v, [hx, hy, hz])).clamp(0.0, 1.0);
        schlick[i] = x * x * (x * x) * x;
    }
    for channel in 0..3 {
        let (f0, k_d, arriving) = (&f0[channel], &k_d[channel], &arriving[channel]);
        for i in 0..LANES {
            let fresnel = f0[i] + (lanes.f90[i] - f0[i]) * schlick[i];
            radiance[channel][i] = (k_d[i] * FRAC_1_PI + fresnel * facets[i]) * arriving[i];
        }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::PackedNormal;
    use crate::scene::{Light, LightKind};
    use crate::shade::{MIN_ROUGHNESS, Surface};
    use crate::trace::sampling::{cosine_hemisphere, hash, sobol_2d, uniform_sphere, unit};

    #[test]
    fn lanes_shade_as_surfaces_do() {
        let mut lanes = Lanes::default();
        let mut expected = Vec::new();
        for number in 0..2000_u32 {
            let random = |dimension: u32| unit(hash(dimension, number));
            let normal = uniform_sphere(sobol_2d(number, 0, 1));
            let polished = number % 3 == 0;
            let surface = Surface {
                shading_normal: normal,
                specular_f0: Vec3::new(random(1), random(2), random(3)),
                // some reflect without a lobe, some views come from behind
                specular_f90: if number % 11 == 0 { 0.0 } else { 1.0 },
                roughness: if polished { MIN_ROUGHNESS } else { random(4).max(MIN_ROUGHNESS) },
                ..Surface::BLACK
            };
            let light = cosine_hemisphere(normal, sobol_2d(number, 1, 2));
            let view = match number % 5 {
                0 => uniform_sphere(sobol_2d(number, 1, 3)),
                // towards the peak of the lobe, as far as f32 can tell
                1 => (2.0 * normal.dot(light) * normal - light).normalize(),
                _ => cosine_hemisphere(normal, sobol_2d(number, 1, 4)),
            };
            let (k_d, arriving) = (Vec3::new(random(5), random(6), 0.0), Vec3::new(1.0, 2.0, random(7)));
            let sample = LitSample {
                normal,
                view,
                light,
                k_d,
                f0: surface.specular_f0,
                f90: surface.specular_f90,
                roughness: surface.roughness,
                arriving,
            };
            lanes.set(number as usize % LANES, &sample);
            expected.push((k_d * FRAC_1_PI + surface.specular(view, light)) * arriving);
            if expected.len() == LANES {
                let shaded = lanes.shade();
                for (lane, expected) in expected.drain(..).enumerate() {
                    let found = Vec3::from(shaded.map(|channel| channel[lane]));
                    let off = (found - expected).abs().max_element();
                    assert!(off <= 1e-5 * expected.max_element(), "{number}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn light_arrives_side_by_side_as_it_does_alone() {
        let (mut arrived, mut hidden) = (0, 0);
        for seed in 0..500_u32 {
            let random = |dimension: u32| unit(hash(dimension, seed));
            let vector = |dimension: u32| {
                Vec3::from_array(std::array::from_fn(|axis| 2.0 * random(dimension + axis as u32) - 1.0))
            };
            let intensity = Vec3::new(1.0, 2.0, 3.0);
            let kind = match seed % 3 {
                0 => LightKind::Omni { position: vector(0), intensity, radius: 0.0 },
                1 => LightKind::Spot {
                    position: vector(0),
                    target: vector(3),
                    intensity,
                    inner_angle: 30.0,
                    outer_angle: 60.0,
                    radius: 0.0,
                },
                _ => LightKind::Distant { direction: vector(0), irradiance: intensity, angle: 0.0 },
            };
            let light = PreparedLight::new(&Light { name: String::new(), enabled: true, kind });
            let mut places = Places::ZERO;
            // that is shaded by leans away from the other, as on bumps: either may look away from the light alone
            let samples: [(Vec3, PackedNormal, PackedNormal); LANES] = std::array::from_fn(|i| {
                let normal = uniform_sphere(sobol_2d(i as u32, 0, seed));
                let leaning = (normal + 0.8 * vector(10 + 9 * i as u32)).normalize();
                (vector(13 + 9 * i as u32), PackedNormal::new(normal), PackedNormal::new(leaning))
            });
            for (lane, (position, geometric, shading)) in samples.iter().enumerate() {
                for axis in 0..3 {
                    places.position[axis][lane] = position[axis];
                }
                for side in 0..2 {
                    places.geometric[side][lane] = geometric.sides()[side];
                    places.shading[side][lane] = shading.sides()[side];
                }
            }
            let arrivals = places.arrivals(&light);
            for (lane, (position, geometric, shading)) in samples.into_iter().enumerate() {
                let at = |lanes: &[Lane; 3]| Vec3::from(lanes.each_ref().map(|axis| axis[lane]));
                let (geometric, shading) = (geometric.get(), shading.get());
                assert!((at(&arrivals.geometric) - geometric).length() < 1e-6);
                assert!((at(&arrivals.shading) - shading).length() < 1e-6);
                let Some(alone) = light.center(position) else {
                    assert_eq!(arrivals.cos[lane], 0.0);
                    continue;
                };
                let [lies, shades] = [geometric, shading].map(|normal| normal.dot(alone.direction));
                if lies < 1e-5 || shades < 1e-5 {
                    hidden += u32::from(lies.max(shades) > 0.1);
                    assert!(arrivals.cos[lane] < 2e-5, "{lies} {shades}");
                    continue;
                }
                arrived += 1;
                assert!((arrivals.cos[lane] - shades).abs() < 1e-5);
                assert!((at(&arrivals.light.direction) - alone.direction).length() < 1e-5);
                let distance = arrivals.light.distance[lane];
                assert!(distance == alone.distance || (distance / alone.distance - 1.0).abs() < 1e-5);
                let irradiance = arrivals.light.irradiance * arrivals.light.factor[lane];
                let off = (irradiance - alone.irradiance).abs().max_element();
                // of a spot's rim, only what it would be without tells rounding from error
                let most = 3.0 / if alone.distance.is_finite() { alone.distance.powi(2) } else { 1.0 };
                assert!(off <= 1e-5 * most, "{irradiance} {}", alone.irradiance);
            }
        }
        assert!(arrived > 1000 && hidden > 200, "{arrived} {hidden}");
    }
}
