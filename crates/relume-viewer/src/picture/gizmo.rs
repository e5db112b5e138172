//! Handles by which lights are moved and turned in the picture.

use eframe::egui::{Color32, Pos2, Shape, Stroke, Vec2, vec2};
use relume::glam::{Quat, Vec3};
use relume::{Camera, Light, LightKind};

use super::frame::Frame;

/// Length of an axis on the screen, points.
const AXIS: f32 = 72.0;
/// Radius of a ring.
const RING: f32 = 54.0;
/// Straight pieces that a ring is drawn of.
const RING_STEPS: f32 = 48.0;
/// Cosine between axis and view below which a ring is turned by pulling along it instead of around its middle.
const FROM_THE_SIDE: f32 = 0.3;
/// How near the pointer must be to take a handle, points.
const REACH: f32 = 9.0;

/// Something to take hold of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Handle {
    /// Moves along an axis of the world: 0 is X.
    Along(usize),
    /// Moves in the plane of the picture.
    InPlane,
    /// The target of a spot, which is drawn over surfaces.
    Target,
    /// Turns about an axis of the world.
    About(usize),
}

/// The axes of the world, with what they are called and their colours.
const AXES: [(Vec3, &str, Color32); 3] = [
    (Vec3::X, "X", Color32::from_rgb(235, 87, 87)),
    (Vec3::Y, "Y", Color32::from_rgb(111, 207, 90)),
    (Vec3::Z, "Z", Color32::from_rgb(86, 150, 255)),
];

/// The handles of one light, as they lie in the picture.
pub(crate) struct Gizmo<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) camera: &'a Camera,
    pub(crate) light: &'a Light,
    /// Where a light from far away has its handles.
    pub(crate) anchor: Vec3,
}

/// A drag at a handle, from where it began.
#[derive(Clone, Debug)]
pub(crate) struct Drag {
    pub(crate) handle: Handle,
    /// The light as it was.
    light: Light,
    from: Pos2,
    anchor: Vec3,
    /// Of a ring that is seen from the side: how far its point under the pointer moves on the screen, points a radian.
    tangent: Option<Vec2>,
}

impl Gizmo<'_> {
    fn place(&self) -> Vec3 {
        self.light.position().unwrap_or(self.anchor)
    }

    fn middle(&self) -> Option<Pos2> {
        self.frame.screen_from_world(self.camera, self.place())
    }

    /// Metres that are [`AXIS`] points on the screen where the light is.
    fn reach(&self) -> Option<f32> {
        let size = self.frame.size;
        let (_, depth) = self.camera.project(self.place(), size.x as usize, size.y as usize)?;
        let metres_a_pixel = 2.0 * (0.5 * self.camera.vertical_fov).tan() * depth / size.y;
        Some(AXIS * metres_a_pixel / self.frame.zoom)
    }

    /// The ends of the axes on the screen; those that point at the camera are short.
    fn ends(&self) -> Option<[Pos2; 3]> {
        let (place, reach) = (self.place(), self.reach()?);
        let end = |axis: usize| self.frame.screen_from_world(self.camera, place + AXES[axis].0 * reach);
        Some([end(0)?, end(1)?, end(2)?])
    }

    /// Axes about which this light can be turned.
    fn turns(&self) -> &'static [usize] {
        match self.light.kind {
            LightKind::Omni { .. } => &[],
            LightKind::Spot { .. } | LightKind::Distant { .. } => &[0, 1, 2],
            LightKind::Dome { .. } => &[1],
        }
    }

    /// Points of the ring about an axis, on the screen.
    fn ring(&self, axis: usize) -> Vec<Pos2> {
        let Some(radius) = self.reach().map(|reach| reach * RING / AXIS) else { return Vec::new() };
        let (normal, place) = (AXES[axis].0, self.place());
        let (u, v) = normal.any_orthonormal_pair();
        let point = |step: u16| {
            let (sin, cos) = (f32::from(step) * std::f32::consts::TAU / RING_STEPS).sin_cos();
            self.frame.screen_from_world(self.camera, place + (u * cos + v * sin) * radius)
        };
        (0..=RING_STEPS as u16).filter_map(point).collect()
    }

    fn target(&self) -> Option<Pos2> {
        match self.light.kind {
            LightKind::Spot { target, .. } => self.frame.screen_from_world(self.camera, target),
            _ => None,
        }
    }

    /// The handle at a point of the screen; small ones win over long ones.
    pub(crate) fn handle_at(&self, pointer: Pos2) -> Option<Handle> {
        if self.target().is_some_and(|target| target.distance(pointer) < REACH) {
            return Some(Handle::Target);
        }
        let moves = self.light.position().is_some();
        let middle = self.middle()?;
        if moves && middle.distance(pointer) < REACH {
            return Some(Handle::InPlane);
        }
        let along = self.ends().filter(|_| moves).and_then(|ends| {
            let near = |axis: &usize| distance_to_line(pointer, middle, ends[*axis]);
            let axis = (0..3).filter(|axis| ends[*axis].distance(middle) > 2.0 * REACH);
            let nearest = axis.min_by(|a, b| near(a).total_cmp(&near(b)))?;
            (near(&nearest) < REACH).then_some(Handle::Along(nearest))
        });
        let about = self.turns().iter().find(|&&axis| {
            let ring = self.ring(axis);
            ring.windows(2).any(|ends| distance_to_line(pointer, ends[0], ends[1]) < 0.6 * REACH)
        });
        along.or(about.map(|&axis| Handle::About(axis)))
    }

    /// Begins a drag.
    pub(crate) fn take(&self, handle: Handle, from: Pos2) -> Drag {
        let tangent = match handle {
            Handle::About(axis) => self.tangent(axis, from),
            _ => None,
        };
        Drag { handle, light: self.light.clone(), from, anchor: self.anchor, tangent }
    }

    fn tangent(&self, axis: usize, at: Pos2) -> Option<Vec2> {
        let place = self.place();
        let seen = (self.camera.position() - place).normalize_or_zero().dot(AXES[axis].0).abs();
        let ring = self.ring(axis);
        let near = |index: &usize| ring[*index].distance(at);
        let nearest = (1..ring.len().checked_sub(1)?).min_by(|a, b| near(a).total_cmp(&near(b)))?;
        let tangent = (ring[nearest + 1] - ring[nearest - 1]) * (0.5 * RING_STEPS / std::f32::consts::TAU);
        (seen < FROM_THE_SIDE && tangent.length() > 1.0).then_some(tangent)
    }

    /// What is drawn; `hot` is brighter.
    pub(crate) fn shapes(&self, hot: Option<Handle>) -> Vec<Shape> {
        let mut shapes = Vec::new();
        let (Some(middle), Some(ends)) = (self.middle(), self.ends()) else { return shapes };
        let stroke = |handle: Handle, color: Color32| {
            let is_hot = hot == Some(handle);
            Stroke::new(if is_hot { 4.0 } else { 2.0 }, if is_hot { Color32::WHITE } else { color })
        };
        for &axis in self.turns() {
            let color = AXES[axis].2.gamma_multiply(0.75);
            shapes.push(Shape::line(self.ring(axis), stroke(Handle::About(axis), color)));
        }
        if self.light.position().is_some() {
            for (axis, &end) in ends.iter().enumerate() {
                let stroke = stroke(Handle::Along(axis), AXES[axis].2);
                shapes.push(Shape::line_segment([middle, end], stroke));
                shapes.push(Shape::circle_filled(end, 4.0, stroke.color));
            }
            let color = stroke(Handle::InPlane, Color32::from_gray(230));
            shapes.push(Shape::circle_stroke(middle, 6.0, color));
        }
        if let Some(way) = self.way(middle) {
            shapes.extend(Shape::dashed_line(&way, Stroke::new(1.5, Color32::from_gray(220)), 6.0, 4.0));
        }
        if let Some(target) = self.target() {
            let stroke = stroke(Handle::Target, Color32::from_rgb(255, 210, 90));
            shapes.push(Shape::circle_stroke(target, 7.0, stroke));
            for side in [vec2(11.0, 0.0), vec2(0.0, 11.0)] {
                shapes.push(Shape::line_segment([target - side, target + side], stroke));
            }
        }
        shapes
    }

    /// The way in which a light shines, as far as it is drawn.
    fn way(&self, middle: Pos2) -> Option<[Pos2; 2]> {
        match self.light.kind {
            LightKind::Spot { .. } => Some([middle, self.target()?]),
            LightKind::Distant { .. } => {
                let from = self.anchor - self.light.direction()? * self.reach()?;
                Some([self.frame.screen_from_world(self.camera, from)?, middle])
            }
            _ => None,
        }
    }
}

impl Drag {
    /// The light with the pointer at `to`. `surface` tells where the surface is that is seen there. What cannot be told stays as it was.
    pub(crate) fn light(
        &self,
        frame: &Frame,
        camera: &Camera,
        to: Pos2,
        surface: impl Fn(Pos2) -> Option<Vec3>,
    ) -> Light {
        let mut light = self.light.clone();
        let place = light.position().unwrap_or(self.anchor);
        match self.handle {
            Handle::Along(axis) => {
                let along = |at: Pos2| {
                    nearest_on_axis(camera.position(), frame.direction(camera, at), place, AXES[axis].0)
                };
                if let (Some(from), Some(to)) = (along(self.from), along(to)) {
                    light.translate(AXES[axis].0 * (to - from));
                }
            }
            Handle::InPlane => {
                let normal = camera.world_from_camera.transform_vector3(Vec3::NEG_Z);
                let hit = |at: Pos2| in_plane(camera.position(), frame.direction(camera, at), place, normal);
                if let (Some(from), Some(to)) = (hit(self.from), hit(to)) {
                    light.translate(to - from);
                }
            }
            Handle::Target => {
                if let Some(point) = surface(to) {
                    light.aim_at(point);
                }
            }
            Handle::About(axis) => {
                if let Some(tangent) = self.tangent {
                    let angle = (to - self.from).dot(tangent) / tangent.length_sq();
                    light.turn(Quat::from_axis_angle(AXES[axis].0, angle));
                } else if let Some(middle) = frame.screen_from_world(camera, place) {
                    let towards = AXES[axis].0.dot(camera.position() - place).signum();
                    // the screen's y points down
                    let angle = -towards * (angle(to - middle) - angle(self.from - middle));
                    light.turn(Quat::from_axis_angle(AXES[axis].0, angle));
                }
            }
        }
        light
    }

    /// The light as it was before.
    pub(crate) fn before(&self) -> &Light {
        &self.light
    }
}

fn angle(vector: Vec2) -> f32 {
    vector.y.atan2(vector.x)
}

fn distance_to_line(point: Pos2, from: Pos2, to: Pos2) -> f32 {
    let (way, offset) = (to - from, point - from);
    let share = (offset.dot(way) / way.length_sq().max(1e-6)).clamp(0.0, 1.0);
    (offset - way * share).length()
}

/// How far along an axis through `place` it is nearest to a ray; `None` where both run the same way.
fn nearest_on_axis(origin: Vec3, direction: Vec3, place: Vec3, axis: Vec3) -> Option<f32> {
    let cosine = direction.dot(axis);
    let sine_squared = 1.0 - cosine * cosine;
    let offset = origin - place;
    let along = (offset.dot(axis) - cosine * offset.dot(direction)) / sine_squared;
    (sine_squared > 1e-4).then_some(along)
}

/// Where a ray meets the plane through `place`.
fn in_plane(origin: Vec3, direction: Vec3, place: Vec3, normal: Vec3) -> Option<Vec3> {
    let distance = (place - origin).dot(normal) / direction.dot(normal);
    (distance > 0.0 && distance.is_finite()).then_some(origin + direction * distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Rect, pos2};
    use relume::glam::Affine3A;

    use crate::picture::frame::Framing;

    fn camera() -> Camera {
        let world_from_camera = Affine3A::from_translation(Vec3::new(0.0, 1.0, 5.0));
        Camera { name: "camera".to_owned(), world_from_camera, vertical_fov: 0.8 }
    }

    fn frame() -> Frame {
        let room = Rect::from_min_size(pos2(20.0, 40.0), vec2(960.0, 720.0));
        Framing::default().frame(room, (640, 480))
    }

    fn spot() -> Light {
        let kind = LightKind::Spot {
            position: Vec3::new(0.5, 1.5, 0.0),
            target: Vec3::new(-0.5, 0.2, -0.5),
            intensity: Vec3::ONE,
            inner_angle: 10.0,
            outer_angle: 20.0,
            radius: 0.0,
        };
        Light { name: "spot".to_owned(), enabled: true, kind }
    }

    /// The light after a drag at what lies at `from`.
    fn dragged(light: &Light, from: Pos2, to: Pos2) -> (Handle, Light) {
        let (frame, camera) = (frame(), camera());
        let gizmo = Gizmo { frame: &frame, camera: &camera, light, anchor: Vec3::new(0.0, 1.0, 0.0) };
        let handle = gizmo.handle_at(from).expect("a handle");
        (handle, gizmo.take(handle, from).light(&frame, &camera, to, |_| Some(Vec3::new(0.1, 0.0, 0.2))))
    }

    #[test]
    fn an_axis_moves_along_itself_and_under_the_pointer() {
        let (frame, camera, light) = (frame(), camera(), spot());
        let at = |point: Vec3| frame.screen_from_world(&camera, point).unwrap();
        let from = at(Vec3::new(0.7, 1.5, 0.0));
        let (handle, moved) = dragged(&light, from, at(Vec3::new(1.2, 1.5, 0.0)) + vec2(0.0, 13.0));
        assert_eq!(handle, Handle::Along(0));
        assert!(moved.position().unwrap().distance(Vec3::new(1.0, 1.5, 0.0)) < 2e-2, "{moved:?}");
        assert!(moved.direction().unwrap().distance(light.direction().unwrap()) < 1e-5);
    }

    #[test]
    fn the_middle_moves_in_the_plane_of_the_picture() {
        let (frame, camera, light) = (frame(), camera(), spot());
        let at = |point: Vec3| frame.screen_from_world(&camera, point).unwrap();
        let to = Vec3::new(-0.3, 0.9, 0.0);
        let (handle, moved) = dragged(&light, at(Vec3::new(0.5, 1.5, 0.0)), at(to));
        assert_eq!(handle, Handle::InPlane);
        assert!(moved.position().unwrap().distance(to) < 1e-3);
    }

    #[test]
    fn a_target_goes_to_the_surface_under_the_pointer() {
        let (frame, camera, light) = (frame(), camera(), spot());
        let from = frame.screen_from_world(&camera, Vec3::new(-0.5, 0.2, -0.5)).unwrap();
        let (handle, aimed) = dragged(&light, from, from + vec2(30.0, 0.0));
        assert_eq!(handle, Handle::Target);
        assert!(matches!(aimed.kind, LightKind::Spot { target, .. } if target == Vec3::new(0.1, 0.0, 0.2)));
        assert_eq!(aimed.position(), light.position());
    }

    #[test]
    fn rings_turn_lights() {
        let kind =
            LightKind::Distant { direction: Vec3::new(1.0, -0.001, 0.0), irradiance: Vec3::ONE, angle: 0.0 };
        let sun = Light { name: "sun".to_owned(), enabled: true, kind };
        // about Z, which points at the camera: a quarter turn upwards
        let (frame, camera) = (frame(), camera());
        let middle = frame.screen_from_world(&camera, Vec3::new(0.0, 1.0, 0.0)).unwrap();
        let diagonal = RING * std::f32::consts::FRAC_1_SQRT_2;
        let (handle, turned) =
            dragged(&sun, middle + vec2(diagonal, diagonal), middle + vec2(diagonal, -diagonal));
        assert_eq!(handle, Handle::About(2));
        assert!(turned.direction().unwrap().distance(Vec3::Y) < 2e-2, "{:?}", turned.direction());
        let gizmo = Gizmo { frame: &frame, camera: &camera, light: &sun, anchor: Vec3::new(0.0, 1.0, 0.0) };
        assert!(
            !matches!(gizmo.handle_at(middle), Some(Handle::InPlane | Handle::Along(_))),
            "the sun does not move"
        );
        assert!(!gizmo.shapes(None).is_empty());
    }

    #[test]
    fn a_ring_seen_from_the_side_is_pulled_along() {
        let kind = LightKind::Distant { direction: Vec3::Z, irradiance: Vec3::ONE, angle: 0.0 };
        let sun = Light { name: "sun".to_owned(), enabled: true, kind };
        let (frame, camera) = (frame(), camera());
        let middle = frame.screen_from_world(&camera, Vec3::new(0.0, 1.0, 0.0)).unwrap();
        // the near side of the ring about Y, pulled to the right: by its radius, which is a radian
        let at = middle + vec2(20.0, 0.0);
        let (handle, turned) = dragged(&sun, at, at + vec2(RING, 0.0));
        assert_eq!(handle, Handle::About(1));
        let way = turned.direction().unwrap();
        assert!(way.y.abs() < 1e-5 && way.x.abs() > 0.7, "{way}");
    }

    #[test]
    fn nothing_is_taken_of_a_light_behind_the_camera() {
        let mut light = spot();
        light.translate(Vec3::new(0.0, 0.0, 20.0));
        let (frame, camera) = (frame(), camera());
        let gizmo = Gizmo { frame: &frame, camera: &camera, light: &light, anchor: Vec3::ZERO };
        assert_eq!(gizmo.handle_at(frame.room.center()), None);
        assert!(gizmo.shapes(None).is_empty());
    }
}
