//! The gather cloud: points on all surfaces that can light the view samples.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::cells::{self, Cell, Facet};
use super::{PackedNormal, PackedUnit, reach, tree};
use crate::progress::Progress;
use crate::scene::{Geometry, Scene};
use crate::shade;
use crate::trace::sampling::hash;
use crate::trace::{Accel, Hit};
use crate::{Error, Result};

/// Sub-samples a gather sample: points spread over the patch it stands for. More would resolve light's edges on the
/// cloud better and flicker less under a moving light, for as much more shading (not more shadow rays).
pub const SUB_SAMPLES: usize = 16;

/// A point that stands for a patch of surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GatherSample {
    /// Metres, world space; the sub-sample nearest to the patch's middle.
    pub position: Vec3,
    /// Square metres.
    pub area: f32,
    /// Unit, world space, on the side that the sample stands for.
    pub normal: Vec3,
    /// Triangle that `position` lies on.
    pub triangle: u32,
    /// Mean over the patch of the hemispherical reflectance.
    pub albedo: Vec3,
    /// Padding; zero.
    pub reserved: u32,
    /// Mean over the patch of the emitted radiance, W/(sr m^2).
    pub emission: Vec3,
    /// Padding; zero.
    pub reserved2: u32,
}

/// One of the points spread over a gather sample's patch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SubSample {
    /// Metres, world space, on the surface.
    pub position: Vec3,
    /// The triangle's normal, on the side that the sample stands for.
    pub normal: PackedNormal,
    /// Hemispherical reflectance.
    pub albedo: PackedUnit,
    /// Padding; zero.
    pub reserved: u16,
}

/// Gather samples in the order of the cluster tree (which is the Morton order of the flattened gather image), with
/// [`SUB_SAMPLES`] sub-samples each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GatherCloud {
    /// `4^k` samples.
    pub samples: Vec<GatherSample>,
    /// `SUB_SAMPLES` a sample, neighbours close together.
    pub sub_samples: Vec<SubSample>,
}

/// Which gather sample stands for a point of a surface.
#[derive(Clone, Debug, Default)]
pub struct CellMap {
    /// By side of triangle: the first of its cells in the order they were cut, or `NONE`.
    first: Vec<u32>,
    /// By side of triangle: how many cells it was cut into.
    count: Vec<u32>,
    /// The gather sample of each cell.
    sample_of_cell: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl CellMap {
    fn new(triangles: usize, cells: &[Cell]) -> Self {
        let mut map = Self {
            first: vec![NONE; 2 * triangles],
            count: vec![1; 2 * triangles],
            sample_of_cell: (0..cells.len() as u32).collect(),
        };
        for (index, cell) in cells.iter().enumerate() {
            match cell {
                Cell::Group(facets) => {
                    facets.iter().for_each(|facet| map.first[facet.side()] = index as u32);
                }
                Cell::Piece(facet, _) if map.first[facet.side()] == NONE => {
                    map.first[facet.side()] = index as u32;
                }
                Cell::Piece(facet, _) => map.count[facet.side()] += 1,
            }
        }
        map
    }

    /// The gather sample that stands for where a ray of direction `direction` hit, seen from where the ray came from;
    /// `None` where no sample stands (the ray missed, or this side of the surface is never seen).
    pub fn sample_at(&self, geometry: &Geometry, hit: &Hit, direction: Vec3) -> Option<usize> {
        if !hit.is_hit() {
            return None;
        }
        let triangle = hit.triangle as usize;
        let back = geometry.area_vector(triangle).dot(direction) > 0.0;
        let side = 2 * triangle + usize::from(back);
        let first = self.first[side];
        if first == NONE {
            return None;
        }
        let within = match self.count[side] {
            1 => 0,
            count => cells::piece_at(geometry.corners(triangle), count, Vec2::new(hit.u, hit.v)),
        };
        Some(self.sample_of_cell[(first + within) as usize] as usize)
    }
}

/// The sides of triangles that may reflect: fronts, and the backs of two-sided materials.
fn facets(scene: &Scene, geometry: &Geometry) -> Vec<Facet> {
    (0..geometry.triangles.len() as u32)
        .into_par_iter()
        .flat_map_iter(|triangle| {
            let material = geometry.materials[triangle as usize] as usize;
            let backs = scene.materials[material].double_sided;
            [false, true]
                .into_iter()
                .filter(move |&back| !back || backs)
                .filter_map(move |back| Facet::new(geometry, triangle, back))
        })
        .collect()
}

impl GatherCloud {
    /// A cloud of `count` samples, uniform over all surfaces from which light can find a way to the camera.
    ///
    /// `seen` are the camera's first hits with the directions of their rays.
    ///
    /// # Errors
    /// [`Error::Setting`] unless `count` is a power of four from 256 to 4^10; [`Error::Cancelled`].
    pub fn new(
        scene: &Scene,
        geometry: &Geometry,
        accel: &Accel,
        seen: &[(Hit, Vec3)],
        count: usize,
        seed: u32,
        progress: &dyn Progress,
    ) -> Result<(Self, CellMap)> {
        check_count(count)?;
        progress.stage("gather cloud", 4);
        let bounds = geometry.bounds().unwrap_or_default();
        let diagonal = bounds.0.distance(bounds.1).max(1e-6);
        let scale = tree::normal_scale(diagonal);
        let mut facets = facets(scene, geometry);
        let all_cells = cells::split(geometry, &mut facets, count, scale);
        progress.advance(1);
        let map = CellMap::new(geometry.triangles.len(), &all_cells);
        let reached = reach::reached(geometry, accel, &all_cells, &map, seen, seed);
        let mut facets = reach::keep_reached(&all_cells, &reached, facets);
        if facets.is_empty() {
            return Err(Error::Setting(
                "the camera sees no surface that reflects light: nothing to relight".into(),
            ));
        }
        progress.advance(1);
        let cells = cells::split(geometry, &mut facets, count, scale);
        let mut map = CellMap::new(geometry.triangles.len(), &cells);
        progress.advance(1);
        let cloud = Self::from_cells(scene, geometry, &cells, seed);
        let keys: Vec<_> = cloud.samples.iter().map(|s| tree::key(s.position, s.normal, diagonal)).collect();
        let order = tree::order(&keys);
        for (place, &cell) in order.iter().enumerate() {
            map.sample_of_cell[cell as usize] = place as u32;
        }
        progress.advance(1);
        Ok((cloud.reordered(&order), map))
    }

    fn from_cells(scene: &Scene, geometry: &Geometry, cells: &[Cell], seed: u32) -> Self {
        let built: Vec<(GatherSample, Vec<SubSample>)> = cells
            .par_iter()
            .enumerate()
            .map(|(index, cell)| build_sample(scene, geometry, cell, hash(index as u32, seed)))
            .collect();
        let mut cloud = Self::default();
        for (sample, sub_samples) in built {
            cloud.samples.push(sample);
            cloud.sub_samples.extend(sub_samples);
        }
        cloud
    }

    fn reordered(&self, order: &[u32]) -> Self {
        let sub_samples = |&cell: &u32| {
            let first = cell as usize * SUB_SAMPLES;
            self.sub_samples[first..first + SUB_SAMPLES].iter().copied()
        };
        Self {
            samples: order.iter().map(|&cell| self.samples[cell as usize]).collect(),
            sub_samples: order.iter().flat_map(sub_samples).collect(),
        }
    }

    /// Number of gather samples, `n_g`.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }
}

fn check_count(count: usize) -> Result<()> {
    let power_of_four = count.is_power_of_two() && count.trailing_zeros().is_multiple_of(2);
    if power_of_four && (256..=1 << 20).contains(&count) {
        return Ok(());
    }
    Err(Error::Setting(format!(
        "{count} gather samples: the number must be a power of four from 256 to 1048576, such as 16384, 65536 or 262144"
    )))
}

fn build_sample(
    scene: &Scene,
    geometry: &Geometry,
    cell: &Cell,
    seed: u32,
) -> (GatherSample, Vec<SubSample>) {
    let points = cell.points(geometry, SUB_SAMPLES, seed);
    let (mut albedo, mut emission, mut middle, mut facing) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
    let mut sub_samples = Vec::with_capacity(points.len());
    for (facet, uv) in &points {
        let surface = shade::surface_on_triangle(scene, geometry, facet.triangle, uv.x, uv.y, !facet.back);
        let reflectance = surface.hemispherical_reflectance();
        albedo += reflectance;
        emission += surface.emission;
        middle += surface.position;
        facing += facet.normal;
        sub_samples.push(SubSample {
            position: surface.position,
            normal: PackedNormal::new(facet.normal),
            albedo: PackedUnit::new(reflectance),
            reserved: 0,
        });
    }
    let share = 1.0 / points.len() as f32;
    let (middle, facing) = (middle * share, facing * share);
    let area = cell.area(geometry);
    // the most typical point: near the middle, and facing as the patch does
    let unlike = |place: usize| {
        sub_samples[place].position.distance_squared(middle)
            + area * points[place].0.normal.distance_squared(facing)
    };
    let typical = (0..points.len()).fold(0, |best, i| if unlike(i) < unlike(best) { i } else { best });
    let sample = GatherSample {
        position: sub_samples[typical].position,
        area,
        normal: points[typical].0.normal,
        triangle: points[typical].0.triangle,
        albedo: albedo * share,
        reserved: 0,
        emission: emission * share,
        reserved2: 0,
    };
    (sample, sub_samples)
}
