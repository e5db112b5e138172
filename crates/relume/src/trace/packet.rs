//! Shadow rays in packets: sixteen rays that run side by side walk the tree together.
//!
//! A node's eight boxes are first tested against the whole packet at once, by interval arithmetic over its origins and
//! directions (Wald et al. 2007, "Ray Tracing Deformable Scenes Using Dynamic Bounding Volume Hierarchies", section 4.2), then the few
//! that remain against each ray, one box against all rays; a triangle against all rays where many of them come to it. All tests round as those of a
//! single ray do, and in the same direction, so that a ray gets the same answer alone and in company. Rays that have parted from the others go on
//! alone. What blocked a packet is asked first by the next one, which runs beside it and mostly meets the same.

use multiversion::multiversion;

use super::kernel::{FAR_SCALE, Slabs, blocks, max, min, occluded_below};
use super::wide::{Block, LEAF, LEAF_BIT, Node, WIDTH, WideBvh};
use super::{AlphaMasks, Ray};

/// Rays of a packet, and lanes of its test.
const PACKET: usize = 16;
/// So few rays below a node are faster alone.
const FEW: u32 = 2;

/// What waits on the stack: a [`place`] and a bit for each ray that is to visit the child there.
pub(super) type Waiting = (u32, u32);

/// A child of a node by where it stands: `WIDTH` times the node, plus the lane.
#[inline(always)]
fn place(node: u32, lane: usize) -> u32 {
    node * WIDTH as u32 + lane as u32
}

/// The node and the lane of a [`place`].
#[inline(always)]
fn at(bvh: &WideBvh, place: u32) -> (&Node, usize) {
    (&bvh.nodes[place as usize / WIDTH], place as usize % WIDTH)
}

/// Rays side by side, as structure of arrays by axis.
struct Packet {
    origin: [[f32; PACKET]; 3],
    direction: [[f32; PACKET]; 3],
    inverse: [[f32; PACKET]; 3],
    t_min: [f32; PACKET],
    t_max: [f32; PACKET],
    bounds: Bounds,
}

/// Intervals that hold all rays of a packet.
struct Bounds {
    /// By axis, of the origin that enters boxes last, and first.
    late: [f32; 3],
    early: [f32; 3],
    /// Smallest and largest inverse directions.
    inverse: [[f32; 2]; 3],
    /// As in [`Slabs`]; the same for all rays.
    near: [usize; 3],
    t_min: f32,
    t_max: f32,
}

impl Packet {
    /// `None` where rays run towards different octants.
    #[inline(always)]
    fn new(rays: &[Ray; PACKET]) -> Option<Self> {
        let first = Slabs::new(&rays[0]);
        let zero = [[0.0; PACKET]; 3];
        let (mut origin, mut direction, mut inverse) = (zero, zero, zero);
        for (lane, ray) in rays.iter().enumerate() {
            let slabs = Slabs::new(ray);
            if slabs.near != first.near {
                return None;
            }
            for axis in 0..3 {
                origin[axis][lane] = slabs.origin[axis];
                direction[axis][lane] = ray.direction[axis];
                inverse[axis][lane] = slabs.inverse[axis];
            }
        }
        let (t_min, t_max) = (rays.map(|ray| ray.t_min), rays.map(|ray| ray.t_max));
        let bounds = Bounds::new(&origin, &inverse, first.near, least(&t_min), most(&t_max));
        Some(Self { origin, direction, inverse, t_min, t_max, bounds })
    }

    /// Puts the children of a node that some of the `active` rays meet to what waits.
    #[inline(always)]
    fn enter(&self, bvh: &WideBvh, node: u32, active: u32, waiting: &mut Vec<Waiting>) {
        let children = &bvh.nodes[node as usize];
        let mut met = self.bounds.enter(children);
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let rays = self.meet(children, lane) & active;
            if rays != 0 {
                waiting.push((place(node, lane), rays));
            }
        }
    }

    /// A bit for each ray that meets a child's box.
    #[inline(always)]
    fn meet(&self, node: &Node, child: usize) -> u32 {
        let (mut entry, mut exit) = (self.t_min, self.t_max);
        for axis in 0..3 {
            let near = node.bounds[axis][self.bounds.near[axis]][child];
            let far = node.bounds[axis][1 - self.bounds.near[axis]][child];
            let (origin, inverse) = (&self.origin[axis], &self.inverse[axis]);
            for lane in 0..PACKET {
                entry[lane] = max((near - origin[lane]) * inverse[lane], entry[lane]);
                exit[lane] = min((far - origin[lane]) * inverse[lane] * FAR_SCALE, exit[lane]);
            }
        }
        let mut mask = 0;
        for lane in 0..PACKET {
            mask |= u32::from(entry[lane] <= exit[lane]) << lane;
        }
        mask
    }
}

/// A bit for each ray of a packet that a triangle of a block lies on, solid there or not, and where: as
/// [`intersect`](super::kernel::intersect) has it, term by term.
#[inline(always)]
fn meet_triangle(packet: &Packet, block: &Block, i: usize) -> (u32, [f32; PACKET], [f32; PACKET]) {
    let [ax, ay, az] = [0, 1, 2].map(|axis| block.edge1[axis][i]);
    let [bx, by, bz] = [0, 1, 2].map(|axis| block.edge2[axis][i]);
    let [cx, cy, cz] = [0, 1, 2].map(|axis| block.corner[axis][i]);
    let ([x, y, z], [dx, dy, dz]) = (&packet.origin, &packet.direction);
    let (mut t, mut u, mut v) = ([0.0; PACKET], [0.0; PACKET], [0.0; PACKET]);
    for lane in 0..PACKET {
        let (dx, dy, dz) = (dx[lane], dy[lane], dz[lane]);
        let (px, py, pz) = (dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx);
        let determinant = ax * px + ay * py + az * pz;
        let inverse = 1.0 / determinant;
        let (sx, sy, sz) = (x[lane] - cx, y[lane] - cy, z[lane] - cz);
        u[lane] = (sx * px + sy * py + sz * pz) * inverse;
        let (qx, qy, qz) = (sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax);
        v[lane] = (dx * qx + dy * qy + dz * qz) * inverse;
        t[lane] = (bx * qx + by * qy + bz * qz) * inverse;
    }
    let mut mask = 0;
    for lane in 0..PACKET {
        let inside = (u[lane] >= -1e-6) & (v[lane] >= -1e-6) & (u[lane] + v[lane] <= 1.000_002);
        let within = (t[lane] > packet.t_min[lane]) & (t[lane] < packet.t_max[lane]);
        mask |= u32::from(inside & within) << lane;
    }
    (mask, u, v)
}

/// A bit for each of the `active` rays that something solid of a block lies on.
#[inline(always)]
fn blocked_by(block: &Block, masks: &AlphaMasks, packet: &Packet, rays: &[Ray; PACKET], active: u32) -> u32 {
    let triangles = block.triangles.iter().take_while(|triangle| **triangle != u32::MAX).count();
    let mut blocked = 0;
    if active.count_ones() as usize <= 2 * triangles {
        let mut left = active;
        while left != 0 {
            let lane = left.trailing_zeros();
            left &= left - 1;
            blocked |= u32::from(blocks(block, masks, &rays[lane as usize])) << lane;
        }
        return blocked;
    }
    for triangle in 0..triangles.min(LEAF) {
        let (mask, u, v) = meet_triangle(packet, block, triangle);
        let mut met = mask & active & !blocked;
        if block.masked >> triangle & 1 == 0 {
            blocked |= met;
            continue;
        }
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let solid = masks.is_solid(block.triangles[triangle], u[lane], v[lane]);
            blocked |= u32::from(solid) << lane;
        }
    }
    blocked
}

impl Bounds {
    #[inline(always)]
    fn new(
        origin: &[[f32; PACKET]; 3],
        inverse: &[[f32; PACKET]; 3],
        near: [usize; 3],
        t_min: f32,
        t_max: f32,
    ) -> Self {
        let mut bounds = Self { late: [0.0; 3], early: [0.0; 3], inverse: [[0.0; 2]; 3], near, t_min, t_max };
        for axis in 0..3 {
            let (low, high) = (least(&origin[axis]), most(&origin[axis]));
            // the farther along its way a ray begins, the sooner it enters a box
            let (late, early) = if near[axis] == 0 { (low, high) } else { (high, low) };
            (bounds.late[axis], bounds.early[axis]) = (late, early);
            bounds.inverse[axis] = [least(&inverse[axis]), most(&inverse[axis])];
        }
        bounds
    }

    /// A bit for each child whose box some ray within the bounds could meet.
    #[inline(always)]
    fn enter(&self, node: &Node) -> u32 {
        let mut entry = [self.t_min; WIDTH];
        let mut exit = [self.t_max; WIDTH];
        for axis in 0..3 {
            let near = &node.bounds[axis][self.near[axis]];
            let far = &node.bounds[axis][1 - self.near[axis]];
            let [low, high] = self.inverse[axis];
            let (early, late) = (self.early[axis], self.late[axis]);
            for lane in 0..WIDTH {
                let (soonest, latest) = (near[lane] - early, far[lane] - late);
                entry[lane] = max(min(soonest * low, soonest * high), entry[lane]);
                exit[lane] = min(max(latest * low, latest * high) * FAR_SCALE, exit[lane]);
            }
        }
        let mut mask = 0;
        for lane in 0..WIDTH {
            mask |= u32::from(entry[lane] <= exit[lane]) << lane;
        }
        mask
    }
}

#[inline(always)]
fn least(values: &[f32; PACKET]) -> f32 {
    values.iter().fold(f32::INFINITY, |least, &value| min(value, least))
}

#[inline(always)]
fn most(values: &[f32; PACKET]) -> f32 {
    values.iter().fold(f32::NEG_INFINITY, |most, &value| max(value, most))
}

/// A bit for each of `rays` that something lies on. `before` is the [`place`] of the leaf that blocked the packet before, and becomes that of
/// the one that blocks this one.
#[inline(always)]
fn occluded_packet(
    bvh: &WideBvh,
    masks: &AlphaMasks,
    rays: &[Ray; PACKET],
    stack: &mut [(f32, u32)],
    waiting: &mut Vec<Waiting>,
    before: &mut Option<u32>,
) -> u32 {
    const ALL: u32 = (1 << PACKET) - 1;
    let Some(packet) = Packet::new(rays) else {
        return alone(bvh, masks, rays, ALL, 0, stack);
    };
    let mut blocked = 0;
    if let Some(leaf) = before.take() {
        // within the leaf's box alone, as whoever comes down the tree
        let (node, lane) = at(bvh, leaf);
        let block = &bvh.blocks[(node.children[lane] & !LEAF_BIT) as usize];
        blocked = blocked_by(block, masks, &packet, rays, packet.meet(node, lane));
        *before = (blocked != 0).then_some(leaf);
        if blocked == ALL {
            return ALL;
        }
    }
    waiting.clear();
    packet.enter(bvh, 0, ALL, waiting);
    while let Some((place, wanted)) = waiting.pop() {
        let active = wanted & !blocked;
        if active == 0 {
            continue;
        }
        let (node, lane) = at(bvh, place);
        let child = node.children[lane];
        if child & LEAF_BIT != 0 {
            let block = &bvh.blocks[(child & !LEAF_BIT) as usize];
            let found = blocked_by(block, masks, &packet, rays, active);
            if found != 0 {
                *before = Some(place);
                blocked |= found;
            }
        } else if active.count_ones() <= FEW {
            blocked |= alone(bvh, masks, rays, active, child, stack);
        } else {
            packet.enter(bvh, child, active, waiting);
        }
        if blocked == ALL {
            break;
        }
    }
    blocked
}

/// The same for those of `rays` that `active` has a bit for, one by one, below a node.
#[inline(always)]
fn alone(
    bvh: &WideBvh,
    masks: &AlphaMasks,
    rays: &[Ray; PACKET],
    active: u32,
    node: u32,
    stack: &mut [(f32, u32)],
) -> u32 {
    let (mut left, mut blocked) = (active, 0);
    while left != 0 {
        let lane = left.trailing_zeros();
        left &= left - 1;
        blocked |= u32::from(occluded_below(bvh, masks, &rays[lane as usize], node, stack)) << lane;
    }
    blocked
}

/// Whether anything lies on each ray.
#[multiversion(targets("x86_64+avx2+fma+bmi1+bmi2+lzcnt", "x86_64+sse4.1"))]
pub(super) fn occluded_batch(
    bvh: &WideBvh,
    masks: &AlphaMasks,
    rays: &[Ray],
    blocked: &mut [bool],
    stack: &mut [(f32, u32)],
    waiting: &mut Vec<Waiting>,
) {
    let (packets, few) = rays.as_chunks::<PACKET>();
    let (answers, last) = blocked.as_chunks_mut::<PACKET>();
    let mut before = None;
    for (packet, answers) in packets.iter().zip(answers) {
        let mask = occluded_packet(bvh, masks, packet, stack, waiting, &mut before);
        for (lane, answer) in answers.iter_mut().enumerate() {
            *answer = mask >> lane & 1 != 0;
        }
    }
    for (ray, blocked) in few.iter().zip(last) {
        *blocked = occluded_below(bvh, masks, ray, 0, stack);
    }
}
