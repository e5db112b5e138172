//! Points that gather together.
//!
//! Points that face alike and lie close together, beside the distance of what surrounds them, see the same surfaces. They are
//! parted into *tiles*: in the open a tile is large; in a corner every point may be one by itself. What a tile sees is seen from
//! the points around it too, mostly. Each point takes the mean of what the near tiles see, weighted by *tents*, which fall off
//! with the distance of a tile's middle: where what is seen changes evenly, as in a penumbra, the mean does so too, while a
//! tile by itself would be a step.

use glam::Vec3;

use crate::trace::offset_origin;

/// Most points of a tile.
pub(super) const TILE: usize = 64;

/// A point that gathers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GatherPoint {
    /// On the surface.
    pub(super) position: Vec3,
    /// For the cosine.
    pub(super) shading_normal: Vec3,
    /// For the horizon.
    pub(super) geometric_normal: Vec3,
    /// Distinguishes the points' random numbers.
    pub(super) seed: u32,
}

impl GatherPoint {
    /// Where its rays start.
    pub(super) fn origin(&self) -> Vec3 {
        offset_origin(self.position, self.geometric_normal)
    }

    /// Whether it faces as `head` does and lies in its plane.
    fn is_like(&self, head: &Self) -> bool {
        let apart = self.position - head.position;
        let off_plane = apart.dot(head.geometric_normal).abs();
        self.geometric_normal.dot(head.geometric_normal) > 0.8
            && self.shading_normal.dot(head.shading_normal) > 0.8
            && off_plane < 0.25 * apart.length() + 1e-4
    }
}

/// What counts as near: shares of the harmonic mean distance of what points see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    /// Farthest from the first point of a tile to its others. More share more rays, and blur what lies close to them.
    pub(super) tile: f32,
    /// Where a tile's tent ends, from its middle. More leave less noise, and blur more.
    pub(super) tent: f32,
}

/// The tiles of a block of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Tiling {
    /// Numbers of the points of each tile.
    pub(super) tiles: Vec<Vec<u32>>,
    /// For each point the tiles near it and their weights, which add up to 1.
    pub(super) near: Vec<Vec<(u32, f32)>>,
}

impl Tiling {
    /// Parts `points`, of which those that follow each other are tried together. `clearances` are the harmonic mean distances of
    /// what they see, metres.
    pub(super) fn new(points: &[GatherPoint], clearances: &[f32], spread: Spread) -> Self {
        let tiles = tiles(points, clearances, spread.tile);
        let mut near = vec![Vec::new(); points.len()];
        for (number, tile) in tiles.iter().enumerate() {
            let head = tile[0] as usize;
            let sum: Vec3 = tile.iter().map(|&member| points[member as usize].position).sum();
            let middle = sum / tile.len() as f32;
            for ((point, near), clearance) in points.iter().zip(&mut near).zip(clearances) {
                let reach = spread.tent * clearance.min(clearances[head]);
                let weight = 1.0 - point.position.distance(middle) / reach;
                if weight > 0.0 && point.is_like(&points[head]) {
                    near.push((number as u32, weight));
                }
            }
        }
        for (number, tile) in tiles.iter().enumerate() {
            for &member in tile {
                let near = &mut near[member as usize];
                if near.is_empty() {
                    near.push((number as u32, 1.0));
                }
                let total: f32 = near.iter().map(|(_, weight)| weight).sum();
                near.iter_mut().for_each(|(_, weight)| *weight /= total);
            }
        }
        Self { tiles, near }
    }
}

/// Each point joins the first tile, of those of the up to [`TILE`] points before, that it is like and close enough to.
fn tiles(points: &[GatherPoint], clearances: &[f32], spread: f32) -> Vec<Vec<u32>> {
    let mut tiles: Vec<Vec<u32>> = Vec::new();
    for start in (0..points.len()).step_by(TILE) {
        let first = tiles.len();
        for candidate in start..(start + TILE).min(points.len()) {
            let point = &points[candidate];
            let home = tiles[first..].iter_mut().find(|tile| {
                let head = tile[0] as usize;
                let reach = spread * clearances[candidate].min(clearances[head]);
                point.position.distance(points[head].position) < reach && point.is_like(&points[head])
            });
            match home {
                Some(tile) => tile.push(candidate as u32),
                None => tiles.push(vec![candidate as u32]),
            }
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: GatherPoint =
        GatherPoint { position: Vec3::ZERO, shading_normal: Vec3::Y, geometric_normal: Vec3::Y, seed: 0 };

    fn tile_count(point: GatherPoint, clearances: [f32; 2]) -> usize {
        Tiling::new(&[HEAD, point], &clearances, Spread { tile: 0.1, tent: 0.2 }).tiles.len()
    }

    #[test]
    fn points_share_a_tile_that_are_near_in_the_plane_and_face_alike() {
        let beside = GatherPoint { position: Vec3::new(0.09, 0.0, 0.0), ..HEAD };
        assert_eq!(tile_count(beside, [1.0; 2]), 1);
        assert_eq!(tile_count(beside, [1.0, 0.8]), 2, "surroundings are closer than that");
        let tilted = Vec3::new(0.8, 0.6, 0.0);
        assert_eq!(tile_count(GatherPoint { shading_normal: tilted, ..beside }, [1.0; 2]), 2);
        assert_eq!(tile_count(GatherPoint { geometric_normal: tilted, ..beside }, [1.0; 2]), 2);
        let step = GatherPoint { position: Vec3::new(0.09, 0.03, 0.0), ..HEAD };
        assert_eq!(tile_count(step, [1.0; 2]), 2, "another plane");
    }

    /// A row of points along x, a unit from each other.
    fn line(count: usize) -> Vec<GatherPoint> {
        let position = |x: usize| Vec3::new(x as f32, 0.0, 0.0);
        (0..count).map(|x| GatherPoint { position: position(x), ..HEAD }).collect()
    }

    #[test]
    fn what_changes_evenly_over_the_tiles_changes_evenly_over_the_points() {
        let points = line(16 * TILE);
        let tiling = Tiling::new(&points, &vec![1e3; points.len()], Spread { tile: 1.0, tent: 0.128 });
        assert_eq!(tiling.tiles.len(), 16);
        let middle = |tile: u32| (tile as f32 + 0.5) * TILE as f32 - 0.5;
        for (x, near) in tiling.near.iter().enumerate() {
            assert!((near.iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-5);
            let mean: f32 = near.iter().map(|&(tile, weight)| weight * middle(tile)).sum();
            let inside = (2 * TILE..14 * TILE).contains(&x);
            assert!(!inside || (mean - x as f32).abs() < 0.02 * TILE as f32, "{mean} at {x}");
        }
    }

    #[test]
    fn a_point_that_is_near_no_tile_has_its_own() {
        let mut points = line(3);
        points[1].position.y = 0.5;
        let tiling = Tiling::new(&points, &[1.0; 3], Spread { tile: 0.1, tent: 0.0 });
        assert_eq!(tiling.near, [[(0, 1.0)], [(1, 1.0)], [(2, 1.0)]]);
    }
}
