use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::point_group::{Angle, MARGIN};
use super::{Dome, PointGroup, ViewCone};
use crate::scene::{Light, LightKind};
use crate::trace::sampling::tangents;
use crate::trace::{Ray, offset_origin};

/// Squared distance, m^2, below which a point light does not shine: 10 micrometres.
pub(super) const MIN_DISTANCE2: f32 = 1e-10;

/// Narrowest difference of a spot's cosines: what f32 can tell apart. A narrower rim is a hard edge.
const MIN_RIM: f64 = 1e-7;

/// What arrives at a point from one sample of a light, were nothing in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit, from the point to the light.
    pub direction: Vec3,
    /// Metres to the light's surface; infinite for distant lights.
    pub distance: f32,
    /// On a surface perpendicular to `direction`, W/m^2: intensity over squared distance times the spot factor, or
    /// radiance times solid angle where the light has extent. No cosine, no visibility. The mean over samples of
    /// `irradiance * cos` is the light's irradiance.
    pub irradiance: Vec3,
}

/// A spot's cone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    pub(super) axis: Vec3,
    pub(super) cos_outer: f32,
    sin_outer: f32,
    pub(super) inverse_rim: f32,
}

#[derive(Clone, Debug)]
pub(super) enum Shape {
    Local {
        position: Vec3,
        radius2: f32,
        cone: Option<Cone>,
    },
    /// `one_minus_cos` of the half angle of the disc.
    Distant {
        direction: Vec3,
        one_minus_cos: f32,
    },
    Dome(Dome),
}

/// A light with all that does not depend on the point worked out: its angles cost nothing at a point.
///
/// - Radius 0 is a point: `intensity / r^2`.
/// - A positive radius is a sphere of uniform radiance `intensity / (pi radius^2)`, sampled uniformly in the cone that
///   it subtends; on a surface that faces it wholly the irradiance is exactly the point's. For points inside the
///   sphere the light is as on the sphere's surface: half of all directions shine, at no distance.
/// - A spot's factor is `saturate((cos t - cos outer) / (cos inner - cos outer))^2`, where `t` is the angle between its
///   axis and the direction from its centre to the point, for all samples of a sphere alike.
/// - A distant light with an angle is a disc of uniform radiance; a surface that faces its centre receives the irradiance.
/// - A dome is sampled by the brightness of its map. It has no centre to shine from.
#[derive(Clone, Debug)]
pub struct PreparedLight {
    pub(super) shape: Shape,
    pub(super) color: Vec3,
}

/// What arrives at `position` (metres, world space) from the light; `sample` in `[0, 1)^2` picks a point of a light
/// with extent. `None` where nothing arrives, as outside a spot's cone. Does not ask whether the light is enabled.
/// In loops use a [`PreparedLight`].
pub fn sample(light: &Light, position: Vec3, sample: Vec2) -> Option<LightSample> {
    PreparedLight::new(light).sample(position, sample)
}

/// Whether the light has extent, so that several samples make a soft shadow.
pub fn needs_samples(light: &Light) -> bool {
    PreparedLight::new(light).needs_samples()
}

/// The ray that asks whether `sample` reaches a surface at `position`; `normal` is the unit geometric normal on the
/// light's side, along which the ray's origin is moved off the surface.
pub fn shadow_ray(position: Vec3, normal: Vec3, sample: &LightSample) -> Ray {
    let origin = offset_origin(position, normal);
    if sample.distance == f32::INFINITY {
        Ray::new(origin, sample.direction)
    } else if sample.distance > 0.0 {
        Ray::between(origin, position + sample.direction * sample.distance)
    } else {
        Ray { t_max: 0.0, ..Ray::new(origin, sample.direction) }
    }
}

impl Cone {
    fn new(axis: Vec3, inner_angle: f32, outer_angle: f32) -> Self {
        let cos_outer = f64::from(outer_angle).to_radians().cos();
        let rim = (f64::from(inner_angle).to_radians().cos() - cos_outer).max(MIN_RIM);
        Self {
            axis: axis.normalize_or(Vec3::NEG_Y),
            cos_outer: cos_outer as f32,
            sin_outer: f64::from(outer_angle).to_radians().sin() as f32,
            inverse_rim: (1.0 / rim) as f32,
        }
    }

    /// Whether the cone, from whose tip something spreads by `angle` around the unit `direction`, could hold some of it.
    fn may_hold(&self, direction: Vec3, angle: Angle) -> bool {
        let sin = self.sin_outer * angle.cos + self.cos_outer * angle.sin;
        let cos = self.cos_outer * angle.cos - self.sin_outer * angle.sin;
        sin <= 0.0 || self.axis.dot(direction) > cos - MARGIN
    }

    fn factor(&self, cos: f32) -> f32 {
        let x = ((cos - self.cos_outer) * self.inverse_rim).clamp(0.0, 1.0);
        x * x
    }
}

/// A unit direction around `axis`, uniform in solid angle, and one minus its cosine with the axis; from
/// `1 - cos` of the cone's half angle, which keeps its digits for the smallest lights.
fn within_cone(axis: Vec3, one_minus_cos: f32, sample: Vec2) -> (Vec3, f32) {
    let (tangent, bitangent) = tangents(axis);
    let height = sample.x * one_minus_cos;
    let sin = (height * (2.0 - height)).max(0.0).sqrt();
    let (y, x) = (TAU * sample.y).sin_cos();
    let direction = tangent * (sin * x) + bitangent * (sin * y) + axis * (1.0 - height);
    (direction.normalize(), height)
}

impl PreparedLight {
    /// Prepares `light`; whether it is enabled is the caller's matter.
    pub fn new(light: &Light) -> Self {
        let shape = match light.kind {
            LightKind::Omni { position, radius, .. } => {
                Shape::Local { position, radius2: radius * radius, cone: None }
            }
            LightKind::Spot { position, target, inner_angle, outer_angle, radius, .. } => {
                let cone = Cone::new(target - position, inner_angle, outer_angle);
                Shape::Local { position, radius2: radius * radius, cone: Some(cone) }
            }
            LightKind::Distant { direction, angle, .. } => {
                // 1 - cos(a / 2) = 2 sin^2(a / 4)
                let sin = (f64::from(angle).to_radians() / 4.0).sin();
                Shape::Distant {
                    direction: -direction.normalize_or(Vec3::NEG_Y),
                    one_minus_cos: (2.0 * sin * sin) as f32,
                }
            }
            LightKind::Dome { ref map, intensity, rotation } => {
                Shape::Dome(Dome::new(map.clone(), intensity, rotation))
            }
        };
        Self { shape, color: light.color() }
    }

    /// Whether anything of the light could arrive at one of the points, were nothing in between. Where it says no, [`Self::sample`] and
    /// [`Self::center`] give for every point nothing, or light from behind its surface.
    pub fn may_reach(&self, points: &PointGroup) -> bool {
        if points.radius < 0.0 {
            return false;
        }
        match &self.shape {
            Shape::Local { position, radius2, cone } => {
                let to_light = position - points.center;
                let distance = to_light.length();
                let reach = points.radius + radius2.sqrt();
                // what is so near has some of it in every direction
                if distance <= reach * (1.0 + MARGIN) {
                    return true;
                }
                let direction = to_light / distance;
                points.may_face(direction, Angle::of_sin(reach / distance))
                    && cone
                        .is_none_or(|cone| cone.may_hold(-direction, Angle::of_sin(points.radius / distance)))
            }
            Shape::Distant { direction, one_minus_cos } => {
                let sin = (one_minus_cos * (2.0 - one_minus_cos)).max(0.0).sqrt();
                // a disc of more than half of all directions has some above every horizon
                *one_minus_cos >= 1.0 || points.may_face(*direction, Angle::of_sin(sin))
            }
            Shape::Dome(_) => true,
        }
    }

    /// Whether the light has extent.
    pub fn needs_samples(&self) -> bool {
        match self.shape {
            Shape::Local { radius2, .. } => radius2 > 0.0,
            Shape::Distant { one_minus_cos, .. } => one_minus_cos > 0.0,
            Shape::Dome(_) => true,
        }
    }

    /// The dome that the light is, if it is one.
    pub fn dome(&self) -> Option<&Dome> {
        match &self.shape {
            Shape::Dome(dome) => Some(dome),
            _ => None,
        }
    }

    /// For a local light: the unit direction from `position` to its centre, the distance, and its intensity that way.
    fn towards(&self, position: Vec3) -> Option<(Vec3, f32, Vec3)> {
        let Shape::Local { position: center, radius2, cone } = self.shape else { return None };
        let to_center = center - position;
        let distance2 = to_center.length_squared();
        if distance2.max(radius2) < MIN_DISTANCE2 {
            return None;
        }
        let distance = distance2.sqrt();
        let axis = if distance2 > 1e-30 { to_center / distance } else { Vec3::Y };
        let factor = cone.map_or(1.0, |cone| cone.factor(-axis.dot(cone.axis)));
        (factor > 0.0).then_some((axis, distance, self.color * factor))
    }

    /// What a view along `ray` (its direction of unit length), as wide as `cone`, shows of the light itself, W/(sr m^2): the light's disc with an
    /// edge as wide as the view, and never narrower than it, so that small lights are neither lost between views nor made brighter. Nothing
    /// where the view was not turned, and of a dome.
    pub fn seen_along(&self, ray: &Ray, cone: &ViewCone) -> Vec3 {
        if !cone.turned {
            return Vec3::ZERO;
        }
        let Some(LightSample { direction, distance, irradiance }) = self.center(ray.origin) else {
            return Vec3::ZERO;
        };
        let cos = ray.direction.dot(direction);
        let off = ray.direction.cross(direction).length().atan2(cos);
        // the light's radius in metres, and the sine of the angle under which it shows
        let (metres, radius) = match self.shape {
            Shape::Local { radius2, .. } => {
                (radius2.sqrt(), radius2.sqrt() / distance.max(f32::MIN_POSITIVE))
            }
            Shape::Distant { one_minus_cos, .. } => (0.0, (one_minus_cos * (2.0 - one_minus_cos)).sqrt()),
            Shape::Dome(_) => (0.0, 0.0),
        };
        if radius >= 1.0 {
            // within its sphere it is as on it
            return irradiance * (1.0 / PI);
        }
        // where the ray enters the sphere, or comes closest to it: a lamp that sinks into a wall is hidden bit by bit
        let along = distance * cos;
        let half_chord = (metres * metres - (distance * off.sin()).powi(2)).max(0.0).sqrt();
        if cos <= 0.0
            || (distance.is_finite() && along - half_chord > ray.t_max)
            || (distance == f32::INFINITY && ray.t_max != f32::INFINITY)
        {
            return Vec3::ZERO;
        }
        let spread = cone.angle_at(distance);
        let spread2 = (spread * spread).max(f32::MIN_POSITIVE);
        // a disc that fades over the spread to both sides of its edge holds as much as a sharp one of `wide2`
        let wide2 = (radius * radius).max(spread2 * (4.0 / 3.0));
        let edge = (wide2 - spread2 * (1.0 / 3.0)).sqrt().min(1.0).asin();
        let part = ((edge + spread - off) / (2.0 * spread2.sqrt())).clamp(0.0, 1.0);
        irradiance * (part / (PI * wide2))
    }

    /// The whole light as if it shone from its centre. On a surface that has all of the light above its horizon,
    /// `irradiance * cos` is exactly what the light brings, whatever its extent. `None` for a dome too.
    pub fn center(&self, position: Vec3) -> Option<LightSample> {
        match self.shape {
            Shape::Local { radius2, .. } => {
                let (direction, distance, intensity) = self.towards(position)?;
                let irradiance = intensity / (distance * distance).max(radius2);
                Some(LightSample { direction, distance, irradiance })
            }
            Shape::Distant { direction, .. } => {
                Some(LightSample { direction, distance: f32::INFINITY, irradiance: self.color })
            }
            Shape::Dome(_) => None,
        }
    }

    /// See [`sample`].
    pub fn sample(&self, position: Vec3, sample: Vec2) -> Option<LightSample> {
        match self.shape {
            Shape::Local { radius2, .. } => {
                let (axis, distance, intensity) = self.towards(position)?;
                if radius2 > 0.0 {
                    return Some(sphere_sample(axis, distance, radius2, intensity, sample));
                }
                let irradiance = intensity / (distance * distance);
                Some(LightSample { direction: axis, distance, irradiance })
            }
            Shape::Distant { direction, one_minus_cos } => {
                if one_minus_cos == 0.0 {
                    let irradiance = self.color;
                    return Some(LightSample { direction, distance: f32::INFINITY, irradiance });
                }
                // the mean cosine over the disc is (1 + cos) / 2
                let irradiance = self.color / (1.0 - 0.5 * one_minus_cos);
                let (direction, _) = within_cone(direction, one_minus_cos, sample);
                Some(LightSample { direction, distance: f32::INFINITY, irradiance })
            }
            Shape::Dome(ref dome) => dome.sample(sample).map(|(light, _)| light),
        }
    }
}

/// One sample of a sphere of radiance `intensity / (pi radius^2)` whose centre lies `distance` along `axis`: radiance
/// times the solid angle `2 pi (1 - cos)` is `2 intensity / (d^2 (1 + cos))`.
fn sphere_sample(axis: Vec3, distance: f32, radius2: f32, intensity: Vec3, sample: Vec2) -> LightSample {
    let distance2 = (distance * distance).max(radius2);
    let sin2_max = radius2 / distance2;
    let cos_max = (1.0 - sin2_max).max(0.0).sqrt();
    let (direction, height) = within_cone(axis, sin2_max / (1.0 + cos_max), sample);
    let sin2 = height * (2.0 - height);
    let half_chord = (radius2 - distance2 * sin2).max(0.0).sqrt();
    let outside = distance * distance > radius2;
    let to_surface = if outside { (distance * (1.0 - height) - half_chord).max(0.0) } else { 0.0 };
    LightSample {
        direction,
        distance: to_surface,
        irradiance: intensity * (2.0 / (distance2 * (1.0 + cos_max))),
    }
}

#[cfg(test)]
#[path = "light_tests.rs"]
mod tests;
