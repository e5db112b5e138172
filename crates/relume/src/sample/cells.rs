//! Cutting surfaces into cells of equal area: the recursive split of Hasan 2006, section 4.1.
//!
//! The paper splits a set of triangles by an axis-aligned plane until one sample is left, and lets that sample
//! stand for whatever triangles remain. Here the split may also separate normals (weighed as in eq. 9), so that no
//! cell bends round a corner, and a triangle that deserves several samples is cut into as many pieces, so that
//! every cell is a known patch: sub-samples can be spread over it, and a ray's hit belongs to exactly one.

use glam::{Vec2, Vec3};

use crate::scene::Geometry;
use crate::trace::sampling::{hash, uniform_triangle, unit};

/// One side of a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) triangle: u32,
    /// The side that the winding does not face.
    pub(super) back: bool,
    pub(super) area: f32,
    centroid: Vec3,
    pub(super) normal: Vec3,
}

impl Facet {
    /// `None` for a triangle without area.
    pub(super) fn new(geometry: &Geometry, triangle: u32, back: bool) -> Option<Self> {
        let [a, b, c] = geometry.corners(triangle as usize);
        let cross = (b - a).cross(c - a);
        let area = 0.5 * cross.length();
        (area > 0.0 && area.is_finite()).then(|| {
            let normal = if back { -cross } else { cross } / (2.0 * area);
            Self { triangle, back, area, centroid: (a + b + c) / 3.0, normal }
        })
    }

    /// Numbers sides of triangles.
    pub(super) fn side(&self) -> usize {
        2 * self.triangle as usize + usize::from(self.back)
    }
}

/// What one gather sample stands for.
#[derive(Clone, Debug)]
pub(super) enum Cell {
    /// Whole sides of triangles.
    Group(Vec<Facet>),
    /// Part of one, by the barycentric (u, v) of its corners.
    Piece(Facet, [Vec2; 3]),
}

/// Barycentric coordinates of a whole triangle's corners.
const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

/// The ends of the longest edge, and the corner opposite.
fn longest_edge(corners: [Vec3; 3]) -> [usize; 3] {
    let [a, b, c] = corners;
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    if ab >= bc && ab >= ca {
        [0, 1, 2]
    } else if bc >= ca {
        [1, 2, 0]
    } else {
        [2, 0, 1]
    }
}

fn at(corners: [Vec3; 3], uv: Vec2) -> Vec3 {
    corners[0] + (corners[1] - corners[0]) * uv.x + (corners[2] - corners[0]) * uv.y
}

/// The two halves of a piece, cut through the middle of its longest edge.
fn halves(corners: [Vec3; 3], piece: [Vec2; 3]) -> [[Vec2; 3]; 2] {
    let [i, j, k] = longest_edge(piece.map(|uv| at(corners, uv)));
    let middle = 0.5 * (piece[i] + piece[j]);
    [[piece[i], middle, piece[k]], [piece[j], middle, piece[k]]]
}

/// Which of `count` pieces of a triangle holds the point `uv`, in the order [`split`] makes them.
pub(super) fn piece_at(corners: [Vec3; 3], count: u32, uv: Vec2) -> u32 {
    let (mut piece, mut count, mut first) = (WHOLE, count, 0);
    // barycentric weights of the point within the piece, by corner
    let mut weight = [1.0 - uv.x - uv.y, uv.x, uv.y];
    while count > 1 {
        let [i, j, k] = longest_edge(piece.map(|uv| at(corners, uv)));
        let [near, far] = halves(corners, piece);
        let half = count / 2;
        if weight[i] >= weight[j] {
            (piece, count) = (near, half);
            weight = [weight[i] - weight[j], 2.0 * weight[j], weight[k]];
        } else {
            (piece, count, first) = (far, count - half, first + half);
            weight = [weight[j] - weight[i], 2.0 * weight[i], weight[k]];
        }
    }
    first
}

/// Cuts `facets` into exactly `budget` cells of about equal area. The pieces of one triangle follow each other.
///
/// `normal_scale` is the distance in metres that counts as much as a difference of one between two unit normals.
pub(super) fn split(
    geometry: &Geometry,
    facets: &mut [Facet],
    budget: usize,
    normal_scale: f32,
) -> Vec<Cell> {
    if budget <= 1 {
        return vec![Cell::Group(facets.to_vec())];
    }
    if let [facet] = *facets {
        let mut cells = Vec::with_capacity(budget);
        cut(facet, geometry.corners(facet.triangle as usize), WHOLE, budget, &mut cells);
        return cells;
    }
    let key = split_key(facets, normal_scale);
    facets.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)).then_with(|| a.side().cmp(&b.side())));
    let (middle, share) = halve_by_area(facets);
    let near_budget = ((budget as f64 * share).round() as usize).clamp(1, budget - 1);
    let (near, far) = facets.split_at_mut(middle);
    let (mut cells, far_cells) = rayon::join(
        || split(geometry, near, near_budget, normal_scale),
        || split(geometry, far, budget - near_budget, normal_scale),
    );
    cells.extend(far_cells);
    cells
}

fn cut(facet: Facet, corners: [Vec3; 3], piece: [Vec2; 3], count: usize, cells: &mut Vec<Cell>) {
    if count == 1 {
        cells.push(Cell::Piece(facet, piece));
        return;
    }
    let [near, far] = halves(corners, piece);
    cut(facet, corners, near, count / 2, cells);
    cut(facet, corners, far, count - count / 2, cells);
}

/// The coordinate along which the facets spread most: of the centroid or of the normal.
fn split_key(facets: &[Facet], normal_scale: f32) -> impl Fn(&Facet) -> f32 + use<> {
    let six = move |facet: &Facet| {
        let [x, y, z] = facet.centroid.to_array();
        let [a, b, c] = (facet.normal * normal_scale).to_array();
        [x, y, z, a, b, c]
    };
    let (mut lowest, mut highest) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for facet in facets {
        for (axis, value) in six(facet).into_iter().enumerate() {
            lowest[axis] = lowest[axis].min(value);
            highest[axis] = highest[axis].max(value);
        }
    }
    let widest =
        (0..6).fold(
            0,
            |best, axis| {
                if highest[axis] - lowest[axis] > highest[best] - lowest[best] { axis } else { best }
            },
        );
    move |facet| six(facet)[widest]
}

/// Where to part sorted facets so that both sides have about the same area, and the first side's share of it.
fn halve_by_area(facets: &[Facet]) -> (usize, f64) {
    let total: f64 = facets.iter().map(|facet| f64::from(facet.area)).sum();
    let (mut area, mut best) = (0.0, (1, f64::INFINITY, 0.5));
    for (index, facet) in facets[..facets.len() - 1].iter().enumerate() {
        area += f64::from(facet.area);
        let unlike = (2.0 * area - total).abs();
        if unlike < best.1 {
            best = (index + 1, unlike, area / total);
        }
    }
    (best.0, best.2)
}

/// A point of a cell: which side of which triangle, and barycentric (u, v) on it.
pub(super) type CellPoint = (Facet, Vec2);

impl Cell {
    /// Square metres.
    pub(super) fn area(&self, geometry: &Geometry) -> f32 {
        match self {
            Self::Group(facets) => facets.iter().map(|facet| facet.area).sum(),
            Self::Piece(facet, piece) => {
                let [a, b, c] = piece.map(|uv| at(geometry.corners(facet.triangle as usize), uv));
                0.5 * (b - a).cross(c - a).length()
            }
        }
    }

    /// Unit, world space; of a group, its first side's.
    pub(super) fn normal(&self) -> Vec3 {
        match self {
            Self::Group(facets) => facets[0].normal,
            Self::Piece(facet, _) => facet.normal,
        }
    }

    /// `count` points spread evenly over the cell's area, in an order in which neighbours lie close.
    pub(super) fn points(&self, geometry: &Geometry, count: usize, seed: u32) -> Vec<CellPoint> {
        match self {
            Self::Group(facets) => points_of_group(facets, count, seed),
            Self::Piece(facet, piece) => {
                let corners = geometry.corners(facet.triangle as usize);
                let mut points = Vec::with_capacity(count);
                points_of_piece(*facet, corners, *piece, count, seed, &mut points);
                points
            }
        }
    }
}

fn points_of_group(facets: &[Facet], count: usize, seed: u32) -> Vec<CellPoint> {
    let total: f32 = facets.iter().map(|facet| facet.area).sum();
    let (mut place, mut end) = (0, facets[0].area);
    (0..count as u32)
        .map(|index| {
            let random = [unit(hash(3 * index, seed)), unit(hash(3 * index + 1, seed))];
            let wanted = total * (index as f32 + unit(hash(3 * index + 2, seed))) / count as f32;
            while end < wanted && place + 1 < facets.len() {
                place += 1;
                end += facets[place].area;
            }
            let (u, v) = uniform_triangle(random.into());
            (facets[place], Vec2::new(u, v))
        })
        .collect()
}

/// Halves the piece until each part wants one point, then puts it at random there.
fn points_of_piece(
    facet: Facet,
    corners: [Vec3; 3],
    piece: [Vec2; 3],
    count: usize,
    seed: u32,
    points: &mut Vec<CellPoint>,
) {
    if count > 1 {
        let [near, far] = halves(corners, piece);
        points_of_piece(facet, corners, near, count / 2, seed, points);
        points_of_piece(facet, corners, far, count - count / 2, seed, points);
    } else if count == 1 {
        let index = points.len() as u32;
        let random = [unit(hash(2 * index, seed)), unit(hash(2 * index + 1, seed))];
        let (u, v) = uniform_triangle(random.into());
        points.push((facet, piece[0] + (piece[1] - piece[0]) * u + (piece[2] - piece[0]) * v));
    }
}
