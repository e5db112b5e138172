use glam::{Affine3A, Vec2, Vec3, Vec3A};

/// A pinhole camera that looks along its own -Z with +Y up.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// The name in the file.
    pub name: String,
    /// Rigid: rotation and translation only.
    pub world_from_camera: Affine3A,
    /// Vertical field of view, radians; the image's size decides the horizontal one.
    pub vertical_fov: f32,
}

impl Camera {
    /// Where the camera stands, world space.
    pub fn position(&self) -> Vec3 {
        self.world_from_camera.translation.into()
    }

    /// Unit direction through the image point (`x`, `y`) in pixels from the top left corner, world space.
    pub fn direction(&self, x: f32, y: f32, width: usize, height: usize) -> Vec3 {
        let half_height = (0.5 * self.vertical_fov).tan();
        let pixel = 2.0 * half_height / height as f32;
        let dir_camera = Vec3::new((x - 0.5 * width as f32) * pixel, (0.5 * height as f32 - y) * pixel, -1.0);
        self.world_from_camera.transform_vector3(dir_camera).normalize()
    }

    /// The image point at which `point` of world space is seen, pixels from the top left corner, in the picture or beside it, and how far before the camera
    /// it is along its axis, metres; `None` for points that are not before it. The inverse of [`Self::direction`].
    pub fn project(&self, point: Vec3, width: usize, height: usize) -> Option<(Vec2, f32)> {
        let in_camera = self.world_from_camera.inverse().transform_point3a(Vec3A::from(point));
        let depth = -in_camera.z;
        let pixel = 2.0 * (0.5 * self.vertical_fov).tan() / height as f32;
        let at = Vec2::new(in_camera.x, -in_camera.y) / (depth * pixel);
        (depth > 0.0 && at.is_finite()).then(|| (at + 0.5 * Vec2::new(width as f32, height as f32), depth))
    }

    /// Whether a camera can stand so: rigid, with a field of view that is one.
    pub(crate) fn is_usable(&self) -> bool {
        let axes = self.world_from_camera.matrix3;
        let rigid = (axes.transpose() * axes).abs_diff_eq(glam::Mat3A::IDENTITY, 1e-3);
        let sees = self.vertical_fov > 0.0 && self.vertical_fov < std::f32::consts::PI;
        rigid && sees && self.position().is_finite()
    }

    /// The angle between the middle of the picture and a pixel beside it, radians.
    pub fn pixel_angle(&self, width: usize, height: usize) -> f32 {
        let (x, y) = (0.5 * width as f32, 0.5 * height as f32);
        self.direction(x, y, width, height).distance(self.direction(x + 1.0, y, width, height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, Quat};

    #[test]
    fn points_are_seen_where_rays_go() {
        let turned = Mat3::from_quat(Quat::from_euler(glam::EulerRot::YXZ, 0.7, -0.4, 0.2));
        let camera = Camera {
            name: "turned".to_owned(),
            world_from_camera: Affine3A::from_mat3_translation(turned, Vec3::new(1.0, 2.0, -3.0)),
            vertical_fov: 0.9,
        };
        for (x, y) in [(0.0, 0.0), (320.0, 240.0), (17.5, 400.25), (-90.0, 700.0)] {
            let direction = camera.direction(x, y, 640, 480);
            let (at, depth) = camera.project(camera.position() + direction * 4.0, 640, 480).unwrap();
            assert!(at.distance(Vec2::new(x, y)) < 1e-2, "{x} {y}: {at}");
            assert!(depth > 0.0 && depth <= 4.0);
        }
        let behind = camera.position() - camera.direction(320.0, 240.0, 640, 480);
        assert_eq!(camera.project(behind, 640, 480), None);
        assert_eq!(camera.project(camera.position(), 640, 480), None);
    }

    #[test]
    fn a_camera_that_cannot_stand_is_told() {
        let camera = Camera { vertical_fov: 1.0, ..Camera::default() };
        assert!(camera.is_usable());
        assert!(!Camera { vertical_fov: f32::NAN, ..camera.clone() }.is_usable());
        assert!(!Camera { vertical_fov: 0.0, ..camera.clone() }.is_usable());
        let wide = Affine3A::from_scale(Vec3::new(1.0, 2.0, 1.0));
        assert!(!Camera { world_from_camera: wide, ..camera.clone() }.is_usable());
        let lost = Affine3A::from_translation(Vec3::new(f32::INFINITY, 0.0, 0.0));
        assert!(!Camera { world_from_camera: lost, ..camera }.is_usable());
    }
}
