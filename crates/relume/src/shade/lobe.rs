//! The specular lobe by itself: what a point reflects towards the camera of the light that arrives from each direction.

use glam::{Vec2, Vec3};

use super::ggx::{distribution, reflection_density, sample_visible_normal, schlick, smith_root, visibility};
use super::{MIN_ROUGHNESS, energy};
use crate::trace::sampling::tangents;

/// Least cosine between the normal and the view, as of every surface that is seen.
const MIN_COS_VIEW: f32 = 0.01;
/// A lobe that reflects less of the light than this is none.
const LEAST_REFLECTANCE: f32 = 1e-4;

/// A GGX lobe seen from one direction, without colour: it reflects the mean of the channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularLobe {
    normal: Vec3,
    view: Vec3,
    cos_view: f32,
    alpha: f32,
    /// Reflectances along the normal and at grazing angles, over `reflectance`.
    f0: f32,
    f90: f32,
    reflectance: f32,
}

impl SpecularLobe {
    /// The lobe around `normal`, seen along the unit `view` from the point to the viewer. `f0` and `f90` are the specular
    /// reflectances along the normal and at grazing angles. `None` where next to nothing is reflected.
    pub fn new(normal: Vec3, view: Vec3, roughness: f32, f0: f32, f90: f32) -> Option<Self> {
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let cos_view = normal.dot(view).max(MIN_COS_VIEW);
        let pair = energy::table().pair(cos_view, roughness);
        let reflectance = f0 * pair.x + f90 * pair.y;
        (reflectance > LEAST_REFLECTANCE).then(|| Self {
            normal,
            view,
            cos_view,
            alpha: roughness * roughness,
            f0: f0 / reflectance,
            f90: f90 / reflectance,
            reflectance,
        })
    }

    /// The part of the light that is reflected along the view: the directional albedo, `0..=1`.
    pub fn reflectance(&self) -> f32 {
        self.reflectance
    }

    /// What the radiance that arrives along the unit `light` weighs: BRDF times the light's cosine over [`Self::reflectance`], 1/sr.
    /// Over all directions it adds up to one.
    pub fn response(&self, light: Vec3) -> f32 {
        let cos_light = self.normal.dot(light);
        if cos_light <= 0.0 {
            return 0.0;
        }
        let grazing = schlick(self.view.dot(self.half(light)));
        let fresnel = self.f0 + (self.f90 - self.f0) * grazing;
        fresnel * self.facets(light) * visibility(self.cos_view, cos_light, self.alpha) * cos_light
    }

    /// The density per solid angle with which [`Self::sample`] draws the unit `light`; 0 below the normal's horizon, where nothing is
    /// to be found.
    pub fn density(&self, light: Vec3) -> f32 {
        if self.normal.dot(light) <= 0.0 {
            return 0.0;
        }
        reflection_density(self.cos_view, self.facets(light), self.alpha)
    }

    /// Where a mirror would reflect the view.
    pub(crate) fn mirrored(&self) -> Vec3 {
        (self.normal * (2.0 * self.normal.dot(self.view)) - self.view).normalize_or(self.normal)
    }

    /// Draws a direction; it may lie below the normal's horizon.
    pub fn sample(&self, sample: Vec2) -> Vec3 {
        reflected(self.normal, self.view, self.cos_view, self.alpha, sample)
    }

    fn half(&self, light: Vec3) -> Vec3 {
        (self.view + light).normalize_or(self.normal)
    }

    fn facets(&self, light: Vec3) -> f32 {
        let half = self.half(light);
        distribution(self.normal.dot(half), self.normal.cross(half).length_squared(), self.alpha)
    }

    /// The same numbers as plain floats, for loops over many.
    pub(crate) fn terms(&self) -> LobeTerms {
        let across = self.normal.cross(self.view);
        LobeTerms {
            normal: self.normal.to_array(),
            view: self.view.to_array(),
            across: across.to_array(),
            cos_view: self.cos_view,
            alpha2: self.alpha * self.alpha,
            root_view: smith_root(self.cos_view, self.alpha),
            f0: self.f0,
            rise: self.f90 - self.f0,
        }
    }
}

/// A direction drawn from the lobe of roughness `alpha` around `normal`, seen along `view`.
pub(super) fn reflected(normal: Vec3, view: Vec3, cos_view: f32, alpha: f32, sample: Vec2) -> Vec3 {
    let (tangent, bitangent) = tangents(normal);
    let local = Vec3::new(view.dot(tangent), view.dot(bitangent), cos_view.max(1e-4));
    let half = sample_visible_normal(local.normalize(), alpha, sample);
    let half = tangent * half.x + bitangent * half.y + normal * half.z;
    (half * (2.0 * view.dot(half)) - view).normalize_or(normal)
}

/// A [`SpecularLobe`] as plain floats. All zeros answer to no light.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LobeTerms {
    pub(crate) normal: [f32; 3],
    pub(crate) view: [f32; 3],
    /// The normal crossed with the view.
    pub(crate) across: [f32; 3],
    pub(crate) cos_view: f32,
    pub(crate) alpha2: f32,
    /// The view's Smith root.
    pub(crate) root_view: f32,
    pub(crate) f0: f32,
    /// `f90 - f0`.
    pub(crate) rise: f32,
}

impl LobeTerms {
    /// [`SpecularLobe::response`] and [`SpecularLobe::density`] towards the unit `light`, without a branch.
    #[inline(always)]
    pub(crate) fn towards(&self, [x, y, z]: [f32; 3]) -> (f32, f32) {
        let [nx, ny, nz] = self.normal;
        let [vx, vy, vz] = self.view;
        let cos_light = nx * x + ny * y + nz * z;
        let view_light = vx * x + vy * y + vz * z;
        // the half vector is (view + light) / length, and view . half is half that length
        let length2 = 2.0 + 2.0 * view_light;
        let length2 = if length2 > 1e-9 { length2 } else { 1e-9 };
        let [ax, ay, az] = self.across;
        let (cx, cy, cz) = (ny * z - nz * y + ax, nz * x - nx * z + ay, nx * y - ny * x + az);
        let cos_half = self.cos_view + cos_light;
        let alpha2 = self.alpha2 + 1e-12;
        let slope = ((cx * cx + cy * cy + cz * cz) / alpha2 + cos_half * cos_half) / length2;
        let facets = std::f32::consts::FRAC_1_PI / (alpha2 * slope * slope);
        let below = 1.0 - 0.5 * length2.sqrt();
        let below = if below > 0.0 { below } else { 0.0 };
        let square = below * below;
        let fresnel = self.f0 + self.rise * (square * square * below);
        let above = if cos_light > 0.0 { cos_light } else { 0.0 };
        let root_light = (alpha2 + (1.0 - alpha2) * above * above).sqrt();
        let masking = 0.5 / (above * self.root_view + self.cos_view * root_light + 1e-12);
        let response = fresnel * facets * masking * above;
        let density = 0.5 * facets / (self.cos_view + self.root_view + 1e-12);
        // without a view there is no lobe
        let exists = self.cos_view > 0.0;
        (if exists { response } else { 0.0 }, if exists && cos_light > 0.0 { density } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::Surface;
    use crate::trace::sampling::{cosine_hemisphere, sobol_2d, uniform_sphere};

    const NORMAL: Vec3 = Vec3::Y;

    fn lobes() -> impl Iterator<Item = (SpecularLobe, f32)> {
        let views = [0.05_f32, 0.3, 0.8, 1.0];
        views.into_iter().flat_map(|cos| {
            let view = Vec3::new((1.0 - cos * cos).sqrt(), cos, 0.0);
            [0.1, 0.3, 0.6, 1.0].map(|roughness| {
                (SpecularLobe::new(NORMAL, view, roughness, 0.04, 1.0).expect("it reflects"), roughness)
            })
        })
    }

    #[test]
    fn the_response_adds_up_to_one() {
        for (lobe, roughness) in lobes() {
            let count = 4096;
            let directions = (0..count).map(|i| lobe.sample(sobol_2d(i, 0, 7)));
            let above = directions.filter(|direction| NORMAL.dot(*direction) > 0.0);
            let sum: f32 = above.map(|d| lobe.response(d) / lobe.density(d)).sum::<f32>() / count as f32;
            println!("roughness {roughness}, reflectance {}: {sum}", lobe.reflectance());
            // the energy table is good to half a percent of what arrives
            assert!((sum - 1.0).abs() < 0.004 / lobe.reflectance() + 0.01, "{sum}");
        }
    }

    #[test]
    fn the_response_is_the_brdf_times_the_cosine() {
        let view = Vec3::new(0.6, 0.8, 0.0);
        let surface = Surface {
            geometric_normal: NORMAL,
            shading_normal: NORMAL,
            specular_f0: Vec3::splat(0.3),
            specular_f90: 1.0,
            roughness: 0.4,
            lit: true,
            ..Surface::BLACK
        };
        let lobe = SpecularLobe::new(NORMAL, view, 0.4, 0.3, 1.0).expect("it reflects");
        for i in 0..256 {
            let light = cosine_hemisphere(NORMAL, sobol_2d(i, 0, 3));
            let expected = surface.specular(view, light).x * light.y;
            let told = lobe.response(light) * lobe.reflectance();
            assert!((told - expected).abs() < 1e-5 * expected.max(1e-3), "{told} {expected}");
        }
    }

    #[test]
    fn plain_terms_say_the_same() {
        for (lobe, roughness) in lobes() {
            let terms = lobe.terms();
            for i in 0..512 {
                let light = if i % 2 == 0 {
                    lobe.sample(sobol_2d(i, 0, 1))
                } else {
                    uniform_sphere(sobol_2d(i, 0, 2))
                };
                let (response, density) = terms.towards(light.to_array());
                let expected = (lobe.response(light), lobe.density(light));
                let close = |told: f32, expected: f32| (told - expected).abs() <= 2e-3 * expected + 1e-5;
                assert!(close(response, expected.0), "roughness {roughness}: {response} {expected:?}");
                assert!(close(density, expected.1), "roughness {roughness}: {density} {expected:?}");
            }
        }
        assert_eq!(LobeTerms::default().towards([0.0, 1.0, 0.0]), (0.0, 0.0));
    }

    #[test]
    fn what_reflects_nothing_has_no_lobe() {
        assert!(SpecularLobe::new(NORMAL, NORMAL, 0.5, 0.0, 0.0).is_none());
    }
}
