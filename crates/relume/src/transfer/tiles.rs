//! Points that gather together.
//!
//! Points that face alike and lie close together, beside the distance of what surrounds them, see the same surfaces. They are
//! parted into *tiles*: in the open a tile is large; in a corner every point may be one by itself. What a tile sees is seen from
//! the points around it too, mostly. Each point takes the mean of what the near tiles see, weighted by *tents*, which fall off
//! with the distance of a tile's middle: where what is seen changes evenly, as in a penumbra, the mean does so too, while a
//! tile by itself would be a step.

use glam::{Mat3, Vec3};

use crate::shade::SpecularLobe;
use crate::trace::offset_origin;

/// Most points of a tile.
pub(super) const TILE: usize = 64;
/// Least weight of a point's own tile before weights are made to add up to one; the largest is 1.
const HOME: f32 = 0.25;
/// Added to the variance of the middles of the tiles near a point, a share of it: how far weights are bent for a mean that lies
/// closer to the point.
const RIDGE: f32 = 0.02;
/// What bending leaves of a weight at least: no tile near a point is left out, least of all its own.
const LEAST: f32 = 0.1;

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
    /// What it reflects towards the camera, if it has one and reflects any.
    pub(super) lobe: Option<SpecularLobe>,
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
        let middle = |tile: &Vec<u32>| {
            tile.iter().map(|&member| points[member as usize].position).sum::<Vec3>() / tile.len() as f32
        };
        let middles: Vec<Vec3> = tiles.iter().map(middle).collect();
        for (number, (tile, &middle)) in tiles.iter().zip(&middles).enumerate() {
            let head = tile[0] as usize;
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
                settle(points[member as usize].position, number as u32, &middles, &mut near[member as usize]);
            }
        }
        Self { tiles, near }
    }
}

/// Weighs the tiles near a point so that they add up to one. Its own, `home`, counts for something at least. Where tiles lie
/// more on one side, as at the border of the block, they are weighed so that their mean lies closer to the point.
fn settle(position: Vec3, home: u32, middles: &[Vec3], near: &mut Vec<(u32, f32)>) {
    match near.iter_mut().find(|(tile, _)| *tile == home) {
        Some((_, weight)) => *weight = weight.max(HOME),
        None => near.push((home, HOME)),
    }
    add_up_to_one(near);
    let mean: Vec3 = near.iter().map(|&(tile, weight)| weight * middles[tile as usize]).sum();
    let variance: f32 =
        near.iter().map(|&(tile, weight)| weight * mean.distance_squared(middles[tile as usize])).sum();
    if variance <= f32::MIN_POSITIVE {
        return;
    }
    // in units of the deviation
    let unit = variance.sqrt().recip();
    let from_mean = |tile: u32| (middles[tile as usize] - mean) * unit;
    let mut covariance = Mat3::from_diagonal(Vec3::splat(RIDGE));
    for &(tile, weight) in &*near {
        let d = from_mean(tile);
        covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * weight;
    }
    let tilt = covariance.inverse() * ((position - mean) * unit);
    near.iter_mut().for_each(|(tile, weight)| *weight *= (1.0 + tilt.dot(from_mean(*tile))).max(LEAST));
    add_up_to_one(near);
}

fn add_up_to_one(near: &mut [(u32, f32)]) {
    let total: f32 = near.iter().map(|(_, weight)| weight).sum();
    near.iter_mut().for_each(|(_, weight)| *weight /= total);
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

    const HEAD: GatherPoint = GatherPoint {
        position: Vec3::ZERO,
        shading_normal: Vec3::Y,
        geometric_normal: Vec3::Y,
        seed: 0,
        lobe: None,
    };

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
    fn a_point_that_is_near_no_other_tile_has_its_own() {
        let tiling = Tiling::new(&line(3), &[1.0; 3], Spread { tile: 0.1, tent: 0.2 });
        assert_eq!(tiling.near, [[(0, 1.0)], [(1, 1.0)], [(2, 1.0)]]);
    }

    #[test]
    fn a_tile_is_near_that_is_like_the_point_and_lies_within_both_reaches() {
        let near = |second: GatherPoint, clearances: [f32; 2]| {
            let tiling = Tiling::new(&[HEAD, second], &clearances, Spread { tile: 0.01, tent: 0.5 });
            assert_eq!(tiling.tiles.len(), 2);
            assert_eq!(tiling.near[0].len(), tiling.near[1].len());
            tiling.near[0].len() == 2
        };
        let beside = GatherPoint { position: Vec3::new(0.4, 0.0, 0.0), ..HEAD };
        assert!(near(beside, [1.0; 2]));
        assert!(!near(beside, [0.7, 1.0]) && !near(beside, [1.0, 0.7]), "out of reach");
        let tilted = Vec3::new(0.8, 0.6, 0.0);
        assert!(!near(GatherPoint { shading_normal: tilted, ..beside }, [1.0; 2]));
        assert!(!near(GatherPoint { geometric_normal: tilted, ..beside }, [1.0; 2]));
        assert!(!near(GatherPoint { position: Vec3::new(0.3, 0.2, 0.0), ..HEAD }, [1.0; 2]), "another plane");
    }

    #[test]
    fn at_the_border_the_mean_of_the_tiles_still_lies_close_to_the_point() {
        // no tile beyond the first: plain tents would lie a third of their reach inwards
        let points = line(16 * TILE);
        let spread = Spread { tile: 1.0, tent: 0.256 };
        let tiling = Tiling::new(&points, &vec![1e3; points.len()], spread);
        let middle = |tile: u32| (tile as f32 + 0.5) * TILE as f32 - 0.5;
        let mean = |x: usize| tiling.near[x].iter().map(|&(tile, weight)| weight * middle(tile)).sum::<f32>();
        let plain = |x: f32| {
            let tents = (0..16).map(|tile| ((1.0 - (middle(tile) - x).abs() / 256.0).max(0.0), middle(tile)));
            let (total, sum) = tents.fold((0.0, 0.0), |(t, s), (weight, at)| (t + weight, s + weight * at));
            sum / total
        };
        let x = TILE / 2;
        println!("at {x} the mean lies at {:.1}, of plain tents at {:.1}", mean(x), plain(x as f32));
        // measured 0.33 of a tile
        assert!((mean(x) - x as f32).abs() < 0.4 * TILE as f32);
        assert!((plain(x as f32) - x as f32).abs() > 0.75 * TILE as f32);
    }
}
