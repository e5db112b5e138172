//! An eight-wide BVH, collapsed from the library's binary one, with triangles stored beside each other for
//! vector instructions.

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::triangle::Triangle;

use super::AlphaMasks;

/// Children of a node, and lanes of its box test.
pub(super) const WIDTH: usize = 8;
/// Triangles of a leaf, and lanes of its test.
pub(super) const LEAF: usize = 4;
/// Marks a child that is a leaf; the other bits number its block.
pub(super) const LEAF_BIT: u32 = 1 << 31;

/// Eight boxes. An unused child has an inverted box that no ray meets.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// `bounds[axis][0]` are the smallest, `bounds[axis][1]` the largest coordinates of the children.
    pub(super) bounds: [[[f32; WIDTH]; 2]; 3],
    /// Index of a node, or of a block with [`LEAF_BIT`] set.
    pub(super) children: [u32; WIDTH],
}

/// Up to four triangles. Unused lanes are degenerate and never hit.
#[repr(C, align(16))]
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// First corner, by axis.
    pub(super) corner: [[f32; LEAF]; 3],
    /// Second corner minus first.
    pub(super) edge1: [[f32; LEAF]; 3],
    /// Third corner minus first.
    pub(super) edge2: [[f32; LEAF]; 3],
    /// Which triangles these are.
    pub(super) triangles: [u32; LEAF],
    /// Bit per lane: the triangle is alpha-masked.
    pub(super) masked: u32,
}

/// Nodes and blocks; node 0 is the root.
#[derive(Debug, Default)]
pub(super) struct WideBvh {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// Entries a traversal may have waiting at once.
    pub(super) stack_size: usize,
}

impl Node {
    fn empty() -> Self {
        let axis = [[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]];
        Self { bounds: [axis; 3], children: [0; WIDTH] }
    }

    fn set_bounds(&mut self, lane: usize, min: Vec3, max: Vec3) {
        for axis in 0..3 {
            // A hair of room keeps rays that run within a face, or along an axis, inside.
            let room = 1e-6 * min[axis].abs().max(max[axis].abs()) + 1e-7;
            self.bounds[axis][0][lane] = min[axis] - room;
            self.bounds[axis][1][lane] = max[axis] + room;
        }
    }
}

struct Collapse<'a> {
    binary: &'a Bvh2,
    corners: &'a [Triangle],
    masks: &'a AlphaMasks,
    wide: WideBvh,
}

impl WideBvh {
    /// Builds over triangles given by their corners.
    pub(super) fn new(corners: &[Triangle], masks: &AlphaMasks) -> Self {
        if corners.is_empty() {
            return Self { nodes: vec![Node::empty()], blocks: Vec::new(), stack_size: 2 };
        }
        let params = BvhBuildParams { max_prims_per_leaf: LEAF as u32, ..BvhBuildParams::medium_build() };
        let binary = build_bvh2_from_tris(corners, params, &mut std::time::Duration::default());
        let mut collapse = Collapse { binary: &binary, corners, masks, wide: Self::default() };
        let depth = collapse.run();
        let mut wide = collapse.wide;
        wide.stack_size = depth * (WIDTH - 1) + 2;
        wide
    }

    /// Bytes of nodes and blocks.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.blocks.as_slice())
    }
}

impl Collapse<'_> {
    /// Fills the wide tree; returns its depth. Works from a list, so that a deep tree cannot exhaust the stack.
    fn run(&mut self) -> usize {
        self.wide.nodes.push(Node::empty());
        let mut waiting = vec![(0_usize, 0_usize, 1_usize)]; // binary node, wide node, depth
        let mut deepest = 1;
        while let Some((binary_id, wide_id, depth)) = waiting.pop() {
            deepest = deepest.max(depth);
            for (lane, child) in self.children_of(binary_id).into_iter().enumerate() {
                let node = &self.binary.nodes[child];
                let aabb = node.aabb();
                let (min, max) = (Vec3::from(aabb.min), Vec3::from(aabb.max));
                let leaf = node.is_leaf();
                let reference = if leaf {
                    self.add_block(node.first_index as usize, node.prim_count as usize)
                } else {
                    self.wide.nodes.push(Node::empty());
                    let id = self.wide.nodes.len() - 1;
                    waiting.push((child, id, depth + 1));
                    id as u32
                };
                self.wide.nodes[wide_id].set_bounds(lane, min, max);
                self.wide.nodes[wide_id].children[lane] = reference;
            }
        }
        deepest
    }

    /// Up to eight descendants of a binary node, found by opening the largest box again and again.
    fn children_of(&self, binary_id: usize) -> Vec<usize> {
        let nodes = &self.binary.nodes;
        let mut children = vec![binary_id];
        while children.len() < WIDTH {
            let largest = children
                .iter()
                .enumerate()
                .filter(|&(_, &child)| !nodes[child].is_leaf())
                .map(|(place, &child)| (place, nodes[child].aabb().half_area()))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((place, _)) = largest else { break };
            let first = nodes[children[place]].first_index as usize;
            children[place] = first;
            children.push(first + 1);
        }
        children
    }

    fn add_block(&mut self, first: usize, count: usize) -> u32 {
        debug_assert!(count <= LEAF, "leaves are built for at most {LEAF} triangles");
        let zero = [[0.0; LEAF]; 3];
        let mut block =
            Block { corner: zero, edge1: zero, edge2: zero, triangles: [u32::MAX; LEAF], masked: 0 };
        for lane in 0..count {
            let id = self.binary.primitive_indices[first + lane];
            let Triangle { v0, v1, v2 } = self.corners[id as usize];
            let (edge1, edge2) = (v1 - v0, v2 - v0);
            for axis in 0..3 {
                block.corner[axis][lane] = v0[axis];
                block.edge1[axis][lane] = edge1[axis];
                block.edge2[axis][lane] = edge2[axis];
            }
            block.triangles[lane] = id;
            block.masked |= u32::from(self.masks.is_masked(id)) << lane;
        }
        self.wide.blocks.push(block);
        LEAF_BIT | (self.wide.blocks.len() as u32 - 1)
    }
}
