use std::cell::RefCell;

use glam::Vec3;
use obvhs::triangle::Triangle;

use super::packet::{self, Waiting};
use super::{AlphaMasks, Hit, Ray, kernel, wide::WideBvh};
use crate::scene::{Geometry, Scene};

/// The acceleration structure over a scene's world-space triangles.
#[derive(Debug)]
pub struct Accel {
    bvh: WideBvh,
    masks: AlphaMasks,
    triangles: usize,
}

/// What an [`Accel`] holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelStats {
    /// Triangles.
    pub triangles: usize,
    /// Eight-wide nodes.
    pub nodes: usize,
    /// Bytes of nodes and leaves.
    pub bytes: usize,
}

/// Where a thread's traversals keep what is still to be visited: of rays alone, and of packets.
struct Stacks {
    single: Vec<(f32, u32)>,
    packet: Vec<Waiting>,
}

thread_local! {
    static STACKS: RefCell<Stacks> = const { RefCell::new(Stacks { single: Vec::new(), packet: Vec::new() }) };
}

impl Accel {
    /// Builds over all triangles of `geometry`, with the alpha masks of `scene`'s materials.
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        Self::from_triangles(&geometry.positions, &geometry.triangles, AlphaMasks::new(scene, geometry))
    }

    /// Builds over `triangles` of `positions`. Every index is below `positions.len()`.
    pub fn from_triangles(positions: &[Vec3], triangles: &[[u32; 3]], masks: AlphaMasks) -> Self {
        let corners: Vec<Triangle> = triangles
            .iter()
            .map(|&[a, b, c]| Triangle {
                v0: positions[a as usize].into(),
                v1: positions[b as usize].into(),
                v2: positions[c as usize].into(),
            })
            .collect();
        Self { bvh: WideBvh::new(&corners, &masks), masks, triangles: triangles.len() }
    }

    /// The alpha masks that rays see.
    pub fn masks(&self) -> &AlphaMasks {
        &self.masks
    }

    /// Sizes.
    pub fn stats(&self) -> AccelStats {
        AccelStats { triangles: self.triangles, nodes: self.bvh.nodes.len(), bytes: self.bvh.bytes() }
    }

    fn with_stacks<T>(&self, run: impl FnOnce(&mut [(f32, u32)], &mut Vec<Waiting>) -> T) -> T {
        STACKS.with_borrow_mut(|Stacks { single, packet }| {
            if single.len() < self.bvh.stack_size {
                single.resize(self.bvh.stack_size, (0.0, 0));
            }
            run(single, packet)
        })
    }

    /// The first hit of one ray. For many rays [`Self::closest_batch`] is faster.
    pub fn closest(&self, ray: &Ray) -> Hit {
        let mut hit = [Hit::MISS];
        self.closest_batch(std::slice::from_ref(ray), &mut hit);
        hit[0]
    }

    /// Whether anything lies on one ray.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut blocked = [false];
        self.occluded_batch(std::slice::from_ref(ray), &mut blocked);
        blocked[0]
    }

    /// The first hit of each ray; best where neighbours in the batch run side by side.
    ///
    /// # Panics
    /// If `rays` and `hits` differ in length.
    pub fn closest_batch(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        self.with_stacks(|stack, _| kernel::closest_batch(&self.bvh, &self.masks, rays, hits, stack));
    }

    /// Whether anything lies on each ray; best where each sixteen in the batch run side by side, which are then traced as a
    /// packet. A ray gets the same answer in any company.
    ///
    /// # Panics
    /// If `rays` and `blocked` differ in length.
    pub fn occluded_batch(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "one answer a ray");
        self.with_stacks(|stack, waiting| {
            packet::occluded_batch(&self.bvh, &self.masks, rays, blocked, stack, waiting);
        });
    }
}
