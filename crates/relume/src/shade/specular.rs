//! Mirrors and glass: how the camera's view goes on from a smooth surface.
//!
//! A surface that is polished mirrors along one direction; one that transmits shows what lies behind it, bent where it bounds a solid
//! (Snell's law). Both shares follow Schlick's approximation of Fresnel's equations, as the lobes do.

use glam::Vec3;

use super::Surface;
use super::ggx::schlick;
use crate::scene::Interior;

/// Perceptual roughness up to which a surface is polished, and from which on it is not at all: half of what its lobe reflects comes from within
/// 0.2 and 0.4 degrees around the mirrored view. Between them it mirrors one part and spreads the other, so that a texture has no seam there.
pub const POLISHED_ROUGHNESS: (f32, f32) = (0.04, 0.06);
/// Mirrors and panes that a view is followed through, one after the other. What lies behind more is black.
pub const MAX_SPECULAR_EVENTS: u32 = 8;
/// A view of which less than this reaches the camera is not followed.
pub const LEAST_THROUGHPUT: f32 = 1.0 / 256.0;

/// What light passes through; the default is empty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Medium {
    /// Light fades by `exp(-extinction * metres)`.
    pub extinction: Vec3,
}

/// One way on from a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularEvent {
    /// Unit, from the surface to where its light comes from.
    pub direction: Vec3,
    /// The part of that light that leaves towards the viewer.
    pub weight: Vec3,
    /// What is entered; `None` where the medium stays the same.
    pub medium: Option<Medium>,
    /// How far the view turns with the normal: twice as far in a mirror, not at all in a thin pane.
    pub bending: f32,
}

/// How wide a view is: a cone around its ray, which curved surfaces open (Akenine-Moeller et al. 2021, "Improved Shader and Texture Level of
/// Detail Using Ray Cones").
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCone {
    /// Radius where its last part starts, metres.
    pub width: f32,
    /// Half of the cone's angle, radians.
    pub spread: f32,
    /// Whether the view was mirrored or goes another way than it started: then lights show themselves in it, which the camera does not see
    /// straight nor through panes.
    pub turned: bool,
    /// Unit, where it started to; zero once it was mirrored.
    straight: Vec3,
}

/// Least squared distance of unit directions that are not the same: a panes' faces are parallel only as far as f32 goes.
const TURNED: f32 = 1e-6;

/// Widest half angle of a view, radians.
const MAX_SPREAD: f32 = 0.5;
/// Least cosine at which a view widens as it meets a curved surface.
const LEAST_COS: f32 = 0.2;

impl ViewCone {
    /// From the camera along the unit `direction`; `spread` is half of the angle between view samples.
    pub fn new(spread: f32, direction: Vec3) -> Self {
        Self { width: 0.0, spread, turned: false, straight: direction }
    }

    /// The cone of a view that was turned, from where its last part starts.
    pub fn of_turned(width: f32, spread: f32) -> Self {
        Self { width, spread, turned: true, straight: Vec3::ZERO }
    }

    /// Half of the angle that the view takes up of what is so many metres away from where it starts, radians.
    pub fn angle_at(&self, metres: f32) -> f32 {
        self.spread + self.width / metres.max(1e-6)
    }

    /// After so many metres, and `event` at `surface`, which is seen along the unit `view`.
    #[must_use]
    pub fn after(self, metres: f32, surface: &Surface, view: Vec3, event: &SpecularEvent) -> Self {
        let width = self.width + self.spread * metres;
        if event.bending == 0.0 {
            return Self { width, ..self };
        }
        let mirrored =
            event.direction.dot(surface.geometric_normal) * surface.geometric_normal.dot(view) > 0.0;
        let straight = if mirrored { Vec3::ZERO } else { self.straight };
        let turned = straight.distance_squared(event.direction) > TURNED;
        let turn = surface.curvature * width / surface.shading_normal.dot(view).max(LEAST_COS);
        let lobe = event.bending * surface.roughness * surface.roughness;
        let spread = (self.spread + event.bending * turn).hypot(lobe).min(MAX_SPREAD);
        Self { width, spread, turned, straight }
    }
}

impl Medium {
    /// The part of light that is left after so many metres.
    pub fn transmittance(&self, metres: f32) -> Vec3 {
        (self.extinction * -metres).exp()
    }
}

/// How a ray passes from one medium into another.
struct Refraction {
    /// Unit.
    direction: Vec3,
    /// Cosine with the normal on the side of the smaller refractive index.
    outer_cos: f32,
    /// [`SpecularEvent::bending`].
    bending: f32,
}

impl Surface {
    /// Which part of the light that the specular lobe reflects is mirrored instead, `0..=1`.
    fn polish(&self) -> f32 {
        let (all, none) = POLISHED_ROUGHNESS;
        let reflects = self.lit && self.specular_f90 > 0.0;
        if reflects { ((none - self.roughness) / (none - all)).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Whether light is mirrored here rather than spread by a lobe, or in part.
    pub fn is_polished(&self) -> bool {
        self.polish() > 0.0
    }

    /// The ways on from here of the view along the unit `view`, from the surface to the viewer: mirrored, and passing through.
    pub fn specular_events(&self, view: Vec3) -> impl Iterator<Item = SpecularEvent> {
        let transmits = self.lit && self.transmission != Vec3::ZERO;
        let refraction = self.refraction(view).filter(|_| transmits);
        let total = transmits && refraction.is_none();
        let outer_cos =
            refraction.as_ref().map_or(self.shading_normal.dot(view), |refraction| refraction.outer_cos);
        let reflectance = self.specular_f0.lerp(Vec3::splat(self.specular_f90), schlick(outer_cos));
        let polish = reflectance * self.polish();
        let mirrored = (self.is_polished() || total).then(|| SpecularEvent {
            direction: self.mirrored(view),
            // beyond the critical angle all that would pass is reflected
            weight: if total { polish.lerp(Vec3::ONE, self.passing) } else { polish },
            medium: None,
            bending: 2.0,
        });
        let passed = refraction.map(|refraction| SpecularEvent {
            direction: refraction.direction,
            weight: self.transmission * (Vec3::ONE - reflectance),
            bending: refraction.bending,
            medium: match self.interior {
                Interior::Thin => None,
                Interior::Solid { extinction } if self.front => Some(Medium { extinction }),
                Interior::Solid { .. } => Some(Medium::default()),
            },
        });
        mirrored.into_iter().chain(passed)
    }

    /// What is left to reflect light where [`Self::specular_events`] show the rest.
    #[must_use]
    pub fn beside_events(&self, view: Vec3) -> Self {
        // from within a solid, whose lobes are not those of its outside, events show all that is reflected at its surface
        let within =
            self.lit && !self.front && self.transmission != Vec3::ZERO && self.interior != Interior::Thin;
        if !self.is_polished() && !within {
            return *self;
        }
        let spread = if within { 0.0 } else { 1.0 - self.polish() };
        Self {
            diffuse_albedo: self.diffuse(self.shading_normal.dot(view)),
            specular_f0: self.specular_f0 * spread,
            specular_f90: self.specular_f90 * spread,
            dielectric_specular: 0.0,
            ..*self
        }
    }

    fn mirrored(&self, view: Vec3) -> Vec3 {
        let about = |normal: Vec3| normal * (2.0 * normal.dot(view)) - view;
        let direction = about(self.shading_normal);
        // a bent normal must not send the view into the surface
        let leaves = direction.dot(self.geometric_normal) > 0.0;
        if leaves { direction } else { about(self.geometric_normal) }.normalize_or(self.geometric_normal)
    }

    /// `None` where all light is reflected.
    fn refraction(&self, view: Vec3) -> Option<Refraction> {
        let straight = -view;
        let cos = self.shading_normal.dot(view);
        if self.interior == Interior::Thin {
            return Some(Refraction { direction: straight, outer_cos: cos, bending: 0.0 });
        }
        let eta = if self.front { 1.0 / self.ior } else { self.ior };
        let cos_beyond = (1.0 - eta * eta * (1.0 - cos * cos)).max(0.0).sqrt();
        if cos_beyond == 0.0 {
            return None;
        }
        let bent = straight * eta + self.shading_normal * (eta * cos - cos_beyond);
        let enters = bent.dot(self.geometric_normal) < 0.0;
        let direction = if enters { bent.normalize_or(straight) } else { straight };
        let outer_cos = if self.front { cos } else { cos_beyond };
        Some(Refraction { direction, outer_cos, bending: (1.0 - eta).abs() })
    }
}

#[cfg(test)]
#[path = "specular_tests.rs"]
mod tests;
