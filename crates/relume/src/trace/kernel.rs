//! Traversal of one ray. It is plain Rust over fixed-size lanes, compiled once for every instruction set named in
//! [`closest_batch`]; which one runs is decided at run time, once a batch.

use multiversion::multiversion;

use super::wide::{Block, LEAF, LEAF_BIT, Node, WIDTH, WideBvh};
use super::{AlphaMasks, Hit, Ray};

/// Boxes are widened by this factor of their far distance: three roundings of the slab test
/// (Ize 2013, "Robust BVH Ray Traversal").
pub(super) const FAR_SCALE: f32 = 1.000_000_4;

/// A ray as the box test wants it.
pub(super) struct Slabs {
    pub(super) origin: [f32; 3],
    pub(super) inverse: [f32; 3],
    /// 1 where the ray runs towards smaller coordinates.
    pub(super) near: [usize; 3],
}

impl Slabs {
    #[inline(always)]
    pub(super) fn new(ray: &Ray) -> Self {
        let mut slabs = Self { origin: ray.origin.to_array(), inverse: [0.0; 3], near: [0; 3] };
        for axis in 0..3 {
            // A zero (of either sign) would make 0 * inf = NaN on a box's face; a tiny slope keeps all finite.
            let d = ray.direction[axis];
            let d = if d.abs() < 1e-18 { 1e-18 } else { d };
            slabs.inverse[axis] = 1.0 / d;
            slabs.near[axis] = usize::from(d < 0.0);
        }
        slabs
    }
}

#[inline(always)]
pub(super) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Where the ray enters each child's box, and a bit for each box it meets in `t_min..t_max`.
#[inline(always)]
fn enter(node: &Node, slabs: &Slabs, t_min: f32, t_max: f32) -> ([f32; WIDTH], u32) {
    let mut entry = [t_min; WIDTH];
    let mut exit = [t_max; WIDTH];
    for axis in 0..3 {
        let near = &node.bounds[axis][slabs.near[axis]];
        let far = &node.bounds[axis][1 - slabs.near[axis]];
        let (origin, inverse) = (slabs.origin[axis], slabs.inverse[axis]);
        for lane in 0..WIDTH {
            entry[lane] = max((near[lane] - origin) * inverse, entry[lane]);
            exit[lane] = min((far[lane] - origin) * inverse * FAR_SCALE, exit[lane]);
        }
    }
    let mut mask = 0;
    for lane in 0..WIDTH {
        mask |= u32::from(entry[lane] <= exit[lane]) << lane;
    }
    (entry, mask)
}

/// Möller-Trumbore on four triangles: distance, barycentrics, and a bit for each hit in `t_min..t_max`.
#[inline(always)]
pub(super) fn intersect(
    block: &Block,
    ray: &Ray,
    t_max: f32,
) -> ([f32; LEAF], [f32; LEAF], [f32; LEAF], u32) {
    let [ox, oy, oz] = ray.origin.to_array();
    let [dx, dy, dz] = ray.direction.to_array();
    let (mut t, mut u, mut v) = ([0.0; LEAF], [0.0; LEAF], [0.0; LEAF]);
    let mut mask = 0;
    for i in 0..LEAF {
        let (ax, ay, az) = (block.edge1[0][i], block.edge1[1][i], block.edge1[2][i]);
        let (bx, by, bz) = (block.edge2[0][i], block.edge2[1][i], block.edge2[2][i]);
        let (px, py, pz) = (dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx);
        let determinant = ax * px + ay * py + az * pz;
        let inverse = 1.0 / determinant;
        let (sx, sy, sz) = (ox - block.corner[0][i], oy - block.corner[1][i], oz - block.corner[2][i]);
        u[i] = (sx * px + sy * py + sz * pz) * inverse;
        let (qx, qy, qz) = (sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax);
        v[i] = (dx * qx + dy * qy + dz * qz) * inverse;
        t[i] = (bx * qx + by * qy + bz * qz) * inverse;
    }
    for i in 0..LEAF {
        // A degenerate triangle gives NaN or infinities, which fail a comparison. The small slack on the
        // barycentrics closes the seam between neighbours.
        let inside = (u[i] >= -1e-6) & (v[i] >= -1e-6) & (u[i] + v[i] <= 1.000_002);
        mask |= u32::from(inside & (t[i] > ray.t_min) & (t[i] < t_max)) << i;
    }
    (t, u, v, mask)
}

#[inline(always)]
fn closest(bvh: &WideBvh, masks: &AlphaMasks, ray: &Ray, stack: &mut [(f32, u32)]) -> Hit {
    let slabs = Slabs::new(ray);
    let mut hit = Hit { t: ray.t_max, ..Hit::MISS };
    let mut waiting = 1;
    stack[0] = (ray.t_min, 0);
    while waiting > 0 {
        waiting -= 1;
        let (entry, child) = stack[waiting];
        if entry > hit.t {
            continue;
        }
        if child & LEAF_BIT != 0 {
            let block = &bvh.blocks[(child & !LEAF_BIT) as usize];
            let (t, u, v, mut mask) = intersect(block, ray, hit.t);
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let triangle = block.triangles[lane];
                let solid = block.masked >> lane & 1 == 0 || masks.is_solid(triangle, u[lane], v[lane]);
                if solid && t[lane] < hit.t {
                    hit = Hit { t: t[lane], u: u[lane], v: v[lane], triangle };
                }
            }
            continue;
        }
        let node = &bvh.nodes[child as usize];
        let (entries, mut mask) = enter(node, &slabs, ray.t_min, hit.t);
        let first = waiting;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            // insertion keeps the nearest child on top of the stack
            let mut place = waiting;
            while place > first && stack[place - 1].0 < entries[lane] {
                stack[place] = stack[place - 1];
                place -= 1;
            }
            stack[place] = (entries[lane], node.children[lane]);
            waiting += 1;
        }
    }
    if hit.is_hit() { hit } else { Hit::MISS }
}

/// Whether anything solid of a block lies on a ray.
#[inline(always)]
pub(super) fn blocks(block: &Block, masks: &AlphaMasks, ray: &Ray) -> bool {
    let (_, u, v, mask) = intersect(block, ray, ray.t_max);
    if mask & !block.masked != 0 {
        return true;
    }
    (0..LEAF).any(|lane| mask >> lane & 1 != 0 && masks.is_solid(block.triangles[lane], u[lane], v[lane]))
}

/// Whether anything below a node or block lies on a ray.
#[inline(always)]
pub(super) fn occluded_below(
    bvh: &WideBvh,
    masks: &AlphaMasks,
    ray: &Ray,
    below: u32,
    stack: &mut [(f32, u32)],
) -> bool {
    let slabs = Slabs::new(ray);
    let mut waiting = 1;
    stack[0].1 = below;
    while waiting > 0 {
        waiting -= 1;
        let child = stack[waiting].1;
        if child & LEAF_BIT != 0 {
            if blocks(&bvh.blocks[(child & !LEAF_BIT) as usize], masks, ray) {
                return true;
            }
            continue;
        }
        let node = &bvh.nodes[child as usize];
        let (_, mut mask) = enter(node, &slabs, ray.t_min, ray.t_max);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            stack[waiting].1 = node.children[lane];
            waiting += 1;
        }
    }
    false
}

/// The first hit of each ray.
#[multiversion(targets("x86_64+avx2+fma+bmi1+bmi2+lzcnt", "x86_64+sse4.1"))]
pub(super) fn closest_batch(
    bvh: &WideBvh,
    masks: &AlphaMasks,
    rays: &[Ray],
    hits: &mut [Hit],
    stack: &mut [(f32, u32)],
) {
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = closest(bvh, masks, ray, stack);
    }
}

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
