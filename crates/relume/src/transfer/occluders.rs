use glam::Vec3;

use crate::scene::Geometry;
use crate::trace::{Accel, AlphaMasks};

/// World-space triangles and alpha masks: what a relit frame's shadow rays meet.
#[derive(Clone, Debug, Default)]
pub struct Occluders {
    /// Metres, world space.
    pub positions: Vec<Vec3>,
    /// Indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// Holes.
    pub masks: AlphaMasks,
}

impl Occluders {
    pub(super) fn new(geometry: &Geometry, masks: &AlphaMasks) -> Self {
        Self {
            positions: geometry.positions.clone(),
            triangles: geometry.triangles.clone(),
            masks: masks.clone(),
        }
    }

    /// The acceleration structure over them.
    pub fn accel(&self) -> Accel {
        Accel::from_triangles(&self.positions, &self.triangles, self.masks.clone())
    }
}
