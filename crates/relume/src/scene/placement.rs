//! Moving lights by what they do.

use glam::{Affine3A, Mat3, Quat, Vec3};

use super::{Camera, Light, LightKind};

/// A point of a surface as it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Metres, world space.
    pub position: Vec3,
    /// Unit, the shading normal towards the eye.
    pub normal: Vec3,
    /// Where the eye is, metres, world space.
    pub eye: Vec3,
}

impl SeenPoint {
    /// Unit, the way on which the eye would see light that is mirrored here.
    pub fn mirrored(&self) -> Vec3 {
        let to_eye = (self.eye - self.position).normalize_or(self.normal);
        (2.0 * to_eye.dot(self.normal) * self.normal - to_eye).normalize_or(self.normal)
    }
}

impl Light {
    /// Where it stands, metres; `None` for light from far away.
    pub fn position(&self) -> Option<Vec3> {
        match self.kind {
            LightKind::Omni { position, .. } | LightKind::Spot { position, .. } => Some(position),
            LightKind::Distant { .. } | LightKind::Dome { .. } => None,
        }
    }

    /// Unit, the way in which it shines; `None` for light in all directions.
    pub fn direction(&self) -> Option<Vec3> {
        match self.kind {
            LightKind::Spot { position, target, .. } => (target - position).try_normalize(),
            LightKind::Distant { direction, .. } => direction.try_normalize(),
            LightKind::Omni { .. } | LightKind::Dome { .. } => None,
        }
    }

    /// A camera that sees what it shines at: a spot's cone, the same width as height; from an omni light towards `center`; of a distant light, from far beyond a
    /// ball of `radius` metres around that. `None` for a dome, which is everywhere.
    pub fn camera(&self, center: Vec3, radius: f32) -> Option<Camera> {
        let (position, towards, vertical_fov) = match self.kind {
            LightKind::Omni { position, .. } => (position, center - position, WIDE),
            LightKind::Spot { position, target, outer_angle, .. } => {
                (position, target - position, (2.0 * outer_angle.to_radians()).min(WIDEST))
            }
            LightKind::Distant { direction, .. } => {
                let away = AWAY * radius;
                (center - direction.normalize_or(Vec3::NEG_Y) * away, direction, 2.0 * AWAY.recip().atan())
            }
            LightKind::Dome { .. } => return None,
        };
        let back = -towards.try_normalize()?;
        let right = Vec3::Y.cross(back).try_normalize().unwrap_or(Vec3::X);
        let axes = Mat3::from_cols(right, back.cross(right), back);
        let world_from_camera = Affine3A::from_mat3_translation(axes, position);
        Some(Camera { name: self.name.clone(), world_from_camera, vertical_fov })
    }

    /// Moves it, with its target, by so many metres; light from far away stays.
    pub fn translate(&mut self, by: Vec3) {
        match &mut self.kind {
            LightKind::Omni { position, .. } => *position += by,
            LightKind::Spot { position, target, .. } => {
                *position += by;
                *target += by;
            }
            LightKind::Distant { .. } | LightKind::Dome { .. } => {}
        }
    }

    /// Turns it where it stands. Of a dome's turn that about +Y is taken; an omni light looks the same.
    pub fn turn(&mut self, by: Quat) {
        match &mut self.kind {
            LightKind::Spot { position, target, .. } => *target = *position + by * (*target - *position),
            LightKind::Distant { direction, .. } => *direction = by * *direction,
            LightKind::Dome { rotation, .. } => {
                let turned = by * Vec3::Z;
                *rotation += turned.x.atan2(turned.z).to_degrees();
            }
            LightKind::Omni { .. } => {}
        }
    }

    /// Points a spot at `point` from where it stands. Other lights have no target: false, and nothing is changed.
    pub fn aim_at(&mut self, point: Vec3) -> bool {
        match &mut self.kind {
            LightKind::Spot { position, target, .. } if *position != point => {
                *target = point;
                true
            }
            _ => false,
        }
    }

    /// Puts it where the eye sees its highlight at `at`: on the mirrored view, as far from there as it is now but no farther than `farthest` metres. A spot
    /// is aimed there. A dome has no place: false, and nothing is changed.
    pub fn place_by_highlight(&mut self, at: SeenPoint, farthest: f32) -> bool {
        self.place_along(at.position, at.mirrored(), at.position, farthest)
    }

    /// Puts it where it throws the shadow of `edge`, a point on what is in the way, to `shadow`: on the line through both, as far beyond `edge` as it is from
    /// there now but no farther than `farthest` metres. A spot is aimed at where the shadow falls. A dome has no place: false, and nothing is changed; also
    /// where both are one point.
    pub fn place_by_shadow(&mut self, edge: Vec3, shadow: Vec3, farthest: f32) -> bool {
        match (edge - shadow).try_normalize() {
            Some(way) => self.place_along(edge, way, shadow, farthest),
            None => false,
        }
    }

    /// Puts it on the way from `from`, shining at `lit`.
    fn place_along(&mut self, from: Vec3, way: Vec3, lit: Vec3, farthest: f32) -> bool {
        let at = |position: Vec3| from + way * position.distance(from).max(NEAREST).min(farthest);
        match &mut self.kind {
            LightKind::Omni { position, .. } => *position = at(*position),
            LightKind::Spot { position, target, .. } => {
                *position = at(*position);
                *target = lit;
            }
            LightKind::Distant { direction, .. } => *direction = -way,
            LightKind::Dome { .. } => return false,
        }
        true
    }
}

/// What an omni light is looked through with, radians: a quarter of all around.
const WIDE: f32 = 1.6;
/// And no spot wider than this, of which less would be seen than distorted.
const WIDEST: f32 = 2.6;
/// How far away a distant light is looked through from, in radii of what is looked at.
const AWAY: f32 = 12.0;
/// A light is put no nearer to what it is placed by, metres, unless it must.
const NEAREST: f32 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    fn spot() -> Light {
        let kind = LightKind::Spot {
            position: Vec3::new(1.0, 3.0, 0.5),
            target: Vec3::ZERO,
            intensity: Vec3::ONE,
            inner_angle: 10.0,
            outer_angle: 20.0,
            radius: 0.0,
        };
        Light { name: "spot".to_owned(), enabled: true, kind }
    }

    fn sun() -> Light {
        let kind = LightKind::Distant { direction: Vec3::NEG_Y, irradiance: Vec3::ONE, angle: 0.5 };
        Light { name: "sun".to_owned(), enabled: true, kind }
    }

    #[test]
    fn a_highlight_is_where_the_half_vector_is_the_normal() {
        let at = SeenPoint {
            position: Vec3::new(0.3, 0.0, -1.0),
            normal: Vec3::new(0.1, 1.0, 0.2).normalize(),
            eye: Vec3::new(0.0, 1.5, 4.0),
        };
        let mut light = spot();
        let before = light.position().unwrap().distance(at.position);
        assert!(light.place_by_highlight(at, f32::INFINITY));
        let (position, to_eye) = (light.position().unwrap(), (at.eye - at.position).normalize());
        let to_light = (position - at.position).normalize();
        assert!((to_light + to_eye).normalize().distance(at.normal) < 1e-5);
        assert!((position.distance(at.position) - before).abs() < 1e-4);
        assert!(light.direction().unwrap().distance(-to_light) < 1e-5);
        assert!(light.place_by_highlight(at, 0.5));
        assert!((light.position().unwrap().distance(at.position) - 0.5).abs() < 1e-5);
        let mut sun = sun();
        assert!(sun.place_by_highlight(at, 1.0));
        assert!(sun.direction().unwrap().distance(-at.mirrored()) < 1e-6);
    }

    #[test]
    fn a_shadow_falls_where_it_was_put() {
        let (edge, shadow) = (Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.7, 0.0, -0.4));
        for mut light in [spot(), sun()] {
            assert!(light.place_by_shadow(edge, shadow, f32::INFINITY));
            let way = light
                .position()
                .map_or_else(|| light.direction().unwrap(), |from| (shadow - from).normalize());
            assert!(way.distance((shadow - edge).normalize()) < 1e-5, "{}", light.name);
        }
        let mut light = spot();
        assert!(!light.place_by_shadow(edge, edge, 1.0));
        assert_eq!(light, spot());
    }

    #[test]
    fn lights_turn_where_they_stand() {
        let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let mut light = spot();
        let (from, way) = (light.position().unwrap(), light.direction().unwrap());
        light.turn(quarter);
        assert_eq!(light.position(), Some(from));
        assert!(light.direction().unwrap().distance(quarter * way) < 1e-6);
        let kind = LightKind::Dome { map: None, intensity: Vec3::ONE, rotation: 10.0 };
        let mut dome = Light { name: "dome".to_owned(), enabled: true, kind };
        dome.turn(quarter);
        assert!(matches!(dome.kind, LightKind::Dome { rotation, .. } if (rotation - 100.0).abs() < 1e-3));
        assert!(!dome.aim_at(Vec3::ZERO) && !dome.place_by_shadow(Vec3::Y, Vec3::ZERO, 1.0));
    }

    #[test]
    fn a_light_sees_what_it_shines_at() {
        let light = spot();
        let camera = light.camera(Vec3::ZERO, 1.0).unwrap();
        let (at, _) = camera.project(Vec3::ZERO, 200, 200).unwrap();
        assert!(at.distance(glam::Vec2::splat(100.0)) < 1e-2, "the target is in the middle: {at}");
        // the edge of its cone is that of the picture
        let edge = Quat::from_axis_angle(camera.world_from_camera.matrix3.x_axis.into(), 20_f32.to_radians())
            * light.direction().unwrap();
        let (at, _) = camera.project(camera.position() + edge, 200, 200).unwrap();
        assert!((at - glam::Vec2::splat(100.0)).abs().max_element() > 99.0, "{at}");
        // the sun is far away, and sees a ball around the middle from edge to edge
        for direction in [Vec3::NEG_Y, Vec3::new(0.3, -1.0, 0.2)] {
            let mut sun = sun();
            if let LightKind::Distant { direction: way, .. } = &mut sun.kind {
                *way = direction;
            }
            let camera = sun.camera(Vec3::X, 2.0).unwrap();
            let side: Vec3 = camera.world_from_camera.matrix3.x_axis.into();
            let (at, depth) = camera.project(Vec3::X + 2.0 * side, 100, 100).unwrap();
            assert!((at.x - 100.0).abs() < 0.1 && depth > 20.0, "{at} {depth}");
        }
        let kind = LightKind::Dome { map: None, intensity: Vec3::ONE, rotation: 0.0 };
        assert_eq!(Light { kind, ..light }.camera(Vec3::ZERO, 1.0), None);
    }

    #[test]
    fn a_light_takes_its_target_along() {
        let mut light = spot();
        let way = light.direction();
        light.translate(Vec3::new(0.5, -1.0, 2.0));
        assert_eq!(light.position(), Some(Vec3::new(1.5, 2.0, 2.5)));
        assert_eq!(light.direction(), way);
        assert!(light.aim_at(Vec3::X) && !light.clone().aim_at(Vec3::new(1.5, 2.0, 2.5)));
        assert!(light.direction().unwrap().dot(Vec3::X - Vec3::new(1.5, 2.0, 2.5)) > 0.0);
    }
}
