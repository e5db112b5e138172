use std::sync::{Arc, OnceLock};

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
    /// What rays are traced in, once that is built.
    built: OnceLock<Arc<Accel>>,
}

impl Occluders {
    /// Triangles with their masks; none of them has an index beyond `positions`.
    pub(super) fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, masks: AlphaMasks) -> Self {
        Self { positions, triangles, masks, built: OnceLock::new() }
    }

    /// Those of `geometry`, over which `accel` is built.
    pub(super) fn of(geometry: &Geometry, accel: Arc<Accel>) -> Self {
        let masks = accel.masks().clone();
        let own = Self::new(geometry.positions.clone(), geometry.triangles.clone(), masks);
        Self { built: accel.into(), ..own }
    }

    /// The acceleration structure over them, built when first asked for; clones share it.
    pub fn accel(&self) -> Arc<Accel> {
        let build = || Accel::from_triangles(&self.positions, &self.triangles, self.masks.clone()).into();
        Arc::clone(self.built.get_or_init(build))
    }
}
