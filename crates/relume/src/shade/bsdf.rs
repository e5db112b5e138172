use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::ggx::{distribution, reflection_density, schlick, visibility};
use super::lobe::reflected;
use super::{Surface, energy};
use crate::trace::sampling::cosine_hemisphere;

/// Shading by glTF's metallic-roughness model: a diffuse lobe `k_d / pi` and a GGX lobe with height-correlated
/// Smith masking and Schlick's Fresnel.
///
/// The diffuse lobe gets what a dielectric's specular lobe leaves over *along the view*: `k_d` depends on the
/// view but not on the light, so that with a fixed camera it is one number a pixel. The diffuse lobe is
/// therefore not reciprocal; the specular one is. No surface reflects more than it receives, to the energy
/// table's half percent.
impl Surface {
    /// `k_d`: the part of the irradiance that the diffuse lobe reflects, seen at the cosine `cos_view` from the
    /// shading normal. Its radiance is `k_d / pi` times the irradiance.
    pub fn diffuse(&self, cos_view: f32) -> Vec3 {
        if self.dielectric_specular == 0.0 {
            return self.diffuse_albedo;
        }
        let pair = energy::table().pair(cos_view, self.roughness);
        self.diffuse_albedo * (1.0 - self.dielectric_specular * (self.dielectric_f0 * pair.x + pair.y))
    }

    /// The specular lobe's BRDF, 1/sr, without any cosine, for unit vectors from the point to the viewer and to
    /// the light. Zero unless both are above the shading normal's horizon.
    pub fn specular(&self, view: Vec3, light: Vec3) -> Vec3 {
        let normal = self.shading_normal;
        let (cos_view, cos_light) = (normal.dot(view), normal.dot(light));
        if cos_view <= 0.0 || cos_light <= 0.0 || self.specular_f90 == 0.0 {
            return Vec3::ZERO;
        }
        let half = (view + light).normalize_or(normal);
        let alpha = self.roughness * self.roughness;
        let facets = distribution(normal.dot(half), normal.cross(half).length_squared(), alpha);
        self.fresnel(view.dot(half)) * (facets * visibility(cos_view, cos_light, alpha))
    }

    /// The part of the light along the view's direction that the specular lobe reflects: its directional albedo.
    pub fn specular_albedo(&self, cos_view: f32) -> Vec3 {
        let pair = energy::table().pair(cos_view, self.roughness);
        self.specular_f0 * pair.x + self.specular_f90 * pair.y
    }

    /// The albedo of the diffuse reflector that returns as much light as this surface: the reflectance of both
    /// lobes averaged over view directions, cosine-weighted.
    pub fn hemispherical_reflectance(&self) -> Vec3 {
        let pair = energy::table().average_pair(self.roughness);
        self.hemispherical_diffuse() + self.specular_f0 * pair.x + self.specular_f90 * pair.y
    }

    /// The diffuse lobe's part of [`Self::hemispherical_reflectance`]: what is linear in the base colour factor.
    pub fn hemispherical_diffuse(&self) -> Vec3 {
        let pair = energy::table().average_pair(self.roughness);
        let taken = self.dielectric_specular * (self.dielectric_f0 * pair.x + pair.y);
        self.diffuse_albedo * (1.0 - taken)
    }

    fn fresnel(&self, cos: f32) -> Vec3 {
        self.specular_f0.lerp(Vec3::splat(self.specular_f90), schlick(cos))
    }
}

/// A surface seen from one direction.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    surface: Surface,
    view: Vec3,
    cos_view: f32,
    diffuse: Vec3,
    specular_share: f32,
}

/// A direction drawn from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit, from the point to where the light comes from.
    pub direction: Vec3,
    /// BRDF times the light's cosine over [`Self::density`]: multiplies the radiance along `direction`.
    pub weight: Vec3,
    /// Per solid angle, 1/sr.
    pub density: f32,
}

impl Bsdf {
    /// `surface` seen along the unit `view` from the point to the viewer.
    pub fn new(surface: &Surface, view: Vec3) -> Self {
        let cos_view = surface.shading_normal.dot(view);
        let diffuse = surface.diffuse(cos_view);
        let specular = surface.specular_albedo(cos_view).element_sum();
        let total = diffuse.element_sum() + specular;
        let specular_share = if total > 0.0 { specular / total } else { 0.0 };
        Self { surface: *surface, view, cos_view, diffuse, specular_share }
    }

    /// `k_d`, see [`Surface::diffuse`].
    pub fn diffuse(&self) -> Vec3 {
        self.diffuse
    }

    /// BRDF of both lobes **times the cosine** between the shading normal and the unit `light`, 1/sr. Zero unless
    /// the light is above both the geometric and the shading normal's horizon.
    pub fn evaluate(&self, light: Vec3) -> Vec3 {
        let cos = self.surface.shading_normal.dot(light);
        if cos <= 0.0 || self.surface.geometric_normal.dot(light) <= 0.0 {
            return Vec3::ZERO;
        }
        (self.diffuse * (1.0 / PI) + self.surface.specular(self.view, light)) * cos
    }

    /// The density per solid angle with which [`Self::sample`] draws the unit `light`.
    pub fn density(&self, light: Vec3) -> f32 {
        let normal = self.surface.shading_normal;
        let cos = normal.dot(light);
        if cos <= 0.0 {
            return 0.0;
        }
        let diffuse = (1.0 - self.specular_share) * cos * (1.0 / PI);
        if self.specular_share == 0.0 || self.cos_view <= 0.0 {
            return diffuse;
        }
        let half = (self.view + light).normalize_or(normal);
        let alpha = self.surface.roughness * self.surface.roughness;
        let facets = distribution(normal.dot(half), normal.cross(half).length_squared(), alpha);
        diffuse + self.specular_share * reflection_density(self.cos_view, facets, alpha)
    }

    /// Draws a direction: the lobe by `choice`, the direction by `sample`, all in `[0, 1)`. `None` where the draw
    /// falls below a horizon, which happens with the rest of [`Self::density`]'s probability.
    pub fn sample(&self, choice: f32, sample: Vec2) -> Option<BsdfSample> {
        let direction = if choice < self.specular_share {
            let alpha = self.surface.roughness * self.surface.roughness;
            reflected(self.surface.shading_normal, self.view, self.cos_view, alpha, sample)
        } else {
            cosine_hemisphere(self.surface.shading_normal, sample)
        };
        let value = self.evaluate(direction);
        let density = self.density(direction);
        (value != Vec3::ZERO && density > 0.0).then(|| BsdfSample {
            direction,
            weight: value / density,
            density,
        })
    }
}

#[cfg(test)]
#[path = "bsdf_tests.rs"]
mod tests;
