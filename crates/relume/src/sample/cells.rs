//! Cells: the parts of surfaces that gather samples stand for.
//!
//! The paper splits a set of triangles by an axis-aligned plane until one sample is left, and lets that sample
//! stand for whatever triangles remain (Hasan 2006, section 4.1). Here the split may also separate normals (weighed as
//! in eq. 9), so that no cell bends round a corner, and a triangle that deserves several samples is cut, so that every
//! cell is a known part of the surfaces: points can be spread over it, and a ray's hit belongs to exactly one.

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
pub(super) const WHOLE: [Vec2; 3] = [Vec2::ZERO, Vec2::X, Vec2::Y];

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

pub(super) fn at(corners: [Vec3; 3], uv: Vec2) -> Vec3 {
    corners[0] + (corners[1] - corners[0]) * uv.x + (corners[2] - corners[0]) * uv.y
}

/// The two halves of a piece, cut through the middle of its longest edge.
pub(super) fn halves(corners: [Vec3; 3], piece: [Vec2; 3]) -> [[Vec2; 3]; 2] {
    let [i, j, k] = longest_edge(piece.map(|uv| at(corners, uv)));
    let middle = 0.5 * (piece[i] + piece[j]);
    [[piece[i], middle, piece[k]], [piece[j], middle, piece[k]]]
}

/// Whether a point of a piece, both in barycentric (u, v), lies in the second of its [`halves`].
pub(super) fn in_second_half(corners: [Vec3; 3], piece: [Vec2; 3], uv: Vec2) -> bool {
    let [i, j, k] = longest_edge(piece.map(|uv| at(corners, uv)));
    // the cut is the line from the opposite corner to the middle of the edge; corner `j` lies on its second side
    let middle = 0.5 * (piece[i] + piece[j]);
    let cut = middle - piece[k];
    let side = |point: Vec2| cut.perp_dot(point - piece[k]);
    side(uv) * side(piece[j]) > 0.0
}

/// Parts sides of triangles into two sets of about equal area, by place or by facing, whichever differs more.
///
/// `normal_scale` is the distance in metres that counts as much as a difference of one between two unit normals.
pub(super) fn halve_group(mut facets: Vec<Facet>, normal_scale: f32) -> [Vec<Facet>; 2] {
    let key = split_key(&facets, normal_scale);
    facets.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)).then_with(|| a.side().cmp(&b.side())));
    let far = facets.split_off(halfway_by_area(&facets));
    [facets, far]
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

/// Where to part two or more sorted facets so that both sides have about the same area.
fn halfway_by_area(facets: &[Facet]) -> usize {
    let total: f64 = facets.iter().map(|facet| f64::from(facet.area)).sum();
    let (mut area, mut best) = (0.0, (1, f64::INFINITY));
    for (index, facet) in facets[..facets.len() - 1].iter().enumerate() {
        area += f64::from(facet.area);
        let unlike = (2.0 * area - total).abs();
        if unlike < best.1 {
            best = (index + 1, unlike);
        }
    }
    best.0
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

    /// The centroid of the cell's area and its mean normal; that of its first side where normals cancel out.
    pub(super) fn middle(&self, geometry: &Geometry) -> (Vec3, Vec3) {
        match self {
            Self::Group(facets) => {
                let area = self.area(geometry);
                let mean = |of: fn(&Facet) -> Vec3| {
                    facets.iter().map(|facet| of(facet) * (facet.area / area)).sum::<Vec3>()
                };
                let normal = mean(|facet| facet.normal);
                let normal = if normal.length() > 0.5 { normal } else { facets[0].normal };
                (mean(|facet| facet.centroid), normal)
            }
            Self::Piece(facet, piece) => {
                let uv = (piece[0] + piece[1] + piece[2]) / 3.0;
                (at(geometry.corners(facet.triangle as usize), uv), facet.normal)
            }
        }
    }

    /// The sides of triangles that it is a part of, or made of.
    pub(super) fn facets(&self) -> &[Facet] {
        match self {
            Self::Group(facets) => facets,
            Self::Piece(facet, _) => std::slice::from_ref(facet),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_halves_of_a_piece_hold_each_of_its_points_once() {
        let corners = [Vec3::ZERO, Vec3::new(3.0, 0.5, 0.0), Vec3::new(0.2, 1.0, 0.4)];
        let mut piece = WHOLE;
        for round in 0..6 {
            let halves = halves(corners, piece);
            for (which, half) in halves.into_iter().enumerate() {
                let inside = half[0] * 0.2 + half[1] * 0.3 + half[2] * 0.5;
                assert_eq!(in_second_half(corners, piece, inside), which == 1, "round {round}");
            }
            piece = halves[round % 2];
        }
    }

    #[test]
    fn a_group_is_parted_by_area_and_by_facing() {
        let facet = |x: f32, normal: Vec3, area: f32, triangle| Facet {
            triangle,
            back: false,
            area,
            centroid: Vec3::new(x, 0.0, 0.0),
            normal,
        };
        let row: Vec<Facet> = (0..8).map(|i| facet(i as f32, Vec3::Y, 1.0 + i as f32, i)).collect();
        let [near, far] = halve_group(row, 0.1);
        let area = |facets: &[Facet]| facets.iter().map(|facet| facet.area).sum::<f32>();
        assert!((area(&near) - area(&far)).abs() < 8.0, "{} {}", area(&near), area(&far));
        assert!(near.iter().all(|facet| facet.centroid.x < far[0].centroid.x));
        let corner: Vec<Facet> =
            (0..8).map(|i| facet(i as f32, if i % 2 == 0 { Vec3::Y } else { Vec3::X }, 1.0, i)).collect();
        let [near, far] = halve_group(corner, 100.0);
        assert!(near.iter().all(|facet| facet.normal == near[0].normal) && near.len() == far.len());
    }
}
