use glam::{Affine3A, Vec3};

/// A pinhole camera that looks along its own -Z with +Y up.
#[derive(Clone, Debug, PartialEq)]
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

    /// The angle between the middle of the picture and a pixel beside it, radians.
    pub fn pixel_angle(&self, width: usize, height: usize) -> f32 {
        let (x, y) = (0.5 * width as f32, 0.5 * height as f32);
        self.direction(x, y, width, height).distance(self.direction(x + 1.0, y, width, height))
    }
}
