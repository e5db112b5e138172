//! Acceleration structure, rays, sampling sequences: the only place that names the BVH library.
//!
//! [`Accel`] answers which triangle a ray meets first and whether anything lies between two points, cutting
//! alpha-masked holes for both. Rays are given in batches; a batch is traced by one kernel that was
//! compiled for the widest vector instructions this processor has, chosen at run time. Shadow rays that run side by
//! side walk the tree together, in packets.

mod accel;
mod alpha;
mod kernel;
mod packet;
pub mod sampling;
mod wide;

pub use accel::{Accel, AccelStats};
pub use alpha::{AlphaMask, AlphaMasks};

use glam::Vec3;

/// A segment of a straight line: the points `origin + t * direction` with `t_min < t < t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// World space.
    pub origin: Vec3,
    /// World space; need not be of unit length, `t` is measured in its lengths.
    pub direction: Vec3,
    /// Where the segment begins, not included.
    pub t_min: f32,
    /// Where the segment ends, not included.
    pub t_max: f32,
}

impl Ray {
    /// A half line.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The segment from `from` to just before `to`: what a shadow ray asks about.
    pub fn between(from: Vec3, to: Vec3) -> Self {
        Self { origin: from, direction: to - from, t_min: 0.0, t_max: 1.0 - 1e-4 }
    }
}

/// Where a ray meets a triangle first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// In lengths of the ray's direction; infinite for a miss.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
    /// Index of the triangle; [`Hit::MISS`]'s is `u32::MAX`.
    pub triangle: u32,
}

impl Hit {
    /// The ray met nothing.
    pub const MISS: Self = Self { t: f32::INFINITY, u: 0.0, v: 0.0, triangle: u32::MAX };

    /// Whether the ray met a triangle.
    pub fn is_hit(&self) -> bool {
        self.triangle != u32::MAX
    }
}

/// `position` moved off its surface along the unit `normal`, far enough that rounding cannot put a ray that
/// starts there behind the surface, and no farther: 2^-16 of the largest coordinate, at least 0.01 mm.
pub fn offset_origin(position: Vec3, normal: Vec3) -> Vec3 {
    let scale = position.abs().max_element();
    position + normal * (scale * (1.0 / 65536.0) + 1e-5)
}
