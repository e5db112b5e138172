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
    /// Share of the patch that it stands for, `65535` is all of it; 0 fills up a patch that has fewer.
    weight: u16,
}

impl SubSample {
    /// Share of the patch that it stands for, `0..=1`.
    pub fn weight(&self) -> f32 {
        f32::from(self.weight) * (1.0 / 65535.0)
    }
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
        let sample = self.sample_of_cell[(first + within) as usize];
        (sample != NONE).then_some(sample as usize)
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
        let build = Build { scene, geometry, accel, seen, seed, diagonal };
        let facets = build.reached_facets(count)?;
        progress.advance(1);
        let (patches, mut map) = build.patches(facets, count)?;
        progress.advance(1);
        let keys: Vec<_> = patches.iter().map(|patch| patch.key(diagonal)).collect();
        let order = tree::order(&keys);
        progress.advance(1);
        let mut cloud = Self::default();
        let mut rest = &order[..];
        let mut sample_of_cell = vec![NONE; map.sample_of_cell.len()];
        for size in tree::leaf_sizes(order.len(), count) {
            let (members, after) = rest.split_at(size);
            rest = after;
            let members: Vec<&Patch> = members.iter().map(|&member| &patches[member as usize]).collect();
            for patch in &members {
                sample_of_cell[patch.cell as usize] = cloud.samples.len() as u32;
            }
            cloud.push(&members);
        }
        stand_in(&mut sample_of_cell);
        map.sample_of_cell = sample_of_cell;
        progress.advance(1);
        Ok((cloud, map))
    }

    /// Adds a sample that stands for all of `members`.
    fn push(&mut self, members: &[&Patch]) {
        let area: f32 = members.iter().map(|patch| patch.area).sum();
        // What lies open counts for more than what is covered.
        let open_area: f32 = members.iter().map(|patch| patch.area * patch.openness).sum();
        let expected = |patch: &Patch| patch.area * patch.openness / open_area.max(1e-30);
        let middle: Vec3 = members.iter().map(|patch| patch.position * expected(patch)).sum();
        let facing: Vec3 = members.iter().map(|patch| patch.normal * expected(patch)).sum();
        // The sample's light is the light of what is seen of it: each patch speaks by how often it was seen.
        let sightings: f32 = members.iter().map(|patch| patch.sightings).sum();
        let share = |patch: &Patch| {
            (patch.sightings + PRIOR_SIGHTINGS * expected(patch)) / (sightings + PRIOR_SIGHTINGS)
        };
        let mean =
            |of: fn(&Patch) -> Vec3| members.iter().map(|patch| of(patch) * share(patch)).sum::<Vec3>();
        // the most typical point: near the middle, and facing as the patch does
        let unlike = |patch: &Patch| {
            patch.position.distance_squared(middle) + area * patch.normal.distance_squared(facing)
        };
        let nearest = |best, next| if unlike(next) < unlike(best) { next } else { best };
        let typical = members[1..].iter().copied().fold(members[0], nearest);
        self.samples.push(GatherSample {
            position: typical.position,
            area,
            normal: typical.normal,
            triangle: typical.triangle,
            albedo: mean(|patch| patch.albedo),
            reserved: 0,
            emission: mean(|patch| patch.emission),
            reserved2: 0,
        });
        let sub_sample = |patch: &Patch, share: f32| SubSample {
            position: patch.position,
            normal: PackedNormal::new(patch.normal),
            albedo: PackedUnit::new(patch.albedo),
            weight: (share * 65535.0).round() as u16,
        };
        self.sub_samples.extend(members.iter().map(|patch| sub_sample(patch, share(patch))));
        let padding = SUB_SAMPLES.saturating_sub(members.len());
        self.sub_samples.extend((0..padding).map(|_| sub_sample(members[0], 0.0)));
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

/// Gives every cell without a sample that of the last cell before it that has one, or else the first after it. A cell is
/// left without one where a hole was found at its one point; rays may still meet the rest of it, and their light must
/// not be lost. Cells come in an order in which neighbours follow each other.
fn stand_in(sample_of_cell: &mut [u32]) {
    let mut last = sample_of_cell.iter().copied().find(|&sample| sample != NONE).unwrap_or(NONE);
    for sample in sample_of_cell {
        if *sample == NONE {
            *sample = last;
        }
        last = *sample;
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

/// A small part of a surface, with one point that stands for it.
struct Patch {
    cell: u32,
    position: Vec3,
    normal: Vec3,
    triangle: u32,
    area: f32,
    /// See [`reach::Surroundings`].
    openness: f32,
    /// How often it was seen.
    sightings: f32,
    albedo: Vec3,
    emission: Vec3,
}

impl Patch {
    fn key(&self, diagonal: f32) -> tree::Key {
        tree::key(self.position, self.normal, self.openness, diagonal)
    }
}

/// What a cloud is built from.
struct Build<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    accel: &'a Accel,
    seen: &'a [(Hit, Vec3)],
    seed: u32,
    diagonal: f32,
}

/// Rays by which a coarse cell is found to be reached.
const COARSE_RAYS: usize = 32;
/// Sightings of a gather sample that weigh as much as what its patches' areas let expect.
const PRIOR_SIGHTINGS: f32 = 4.0;
/// Rays by which a fine patch is found to be reached, and how open it lies.
const FINE_RAYS: usize = 8;

impl Build<'_> {
    /// The sides of triangles from which light can leave for the camera, judged by coarse cells.
    fn reached_facets(&self, count: usize) -> Result<Vec<Facet>> {
        let mut facets = facets(self.scene, self.geometry);
        if facets.is_empty() {
            return Err(nothing());
        }
        let (cells, map, surroundings) = self.explored(&mut facets, count, (COARSE_RAYS, 1.0));
        let reached = reach::reached(self.geometry, &surroundings, &map, self.seen);
        let facets = reach::keep_reached(&cells, &reached, facets);
        if facets.is_empty() { Err(nothing()) } else { Ok(facets) }
    }

    fn explored(
        &self,
        facets: &mut [Facet],
        count: usize,
        (rays, scale): (usize, f32),
    ) -> (Vec<Cell>, CellMap, Vec<reach::Surroundings>) {
        let cells = cells::split(self.geometry, facets, count, tree::normal_scale(self.diagonal));
        let map = CellMap::new(self.geometry.triangles.len(), &cells);
        let found = reach::explore(self.geometry, self.accel, &cells, &map, (rays, scale), self.seed);
        (cells, map, found)
    }

    /// Fine patches of all reached surfaces, `SUB_SAMPLES` for each of `count` gather samples or a few less, and how open
    /// each lies. Patches in the holes of alpha masks, or that nothing reaches, are left out.
    fn patches(&self, mut facets: Vec<Facet>, count: usize) -> Result<(Vec<Patch>, CellMap)> {
        let area: f64 = facets.iter().map(|facet| f64::from(facet.area)).sum();
        let scale = (area / count as f64).sqrt() as f32; // the size of a gather sample's patch
        let (cells, map, surroundings) = self.explored(&mut facets, SUB_SAMPLES * count, (FINE_RAYS, scale));
        let reached = reach::reached(self.geometry, &surroundings, &map, self.seen);
        let sightings =
            reach::sightings(self.geometry, self.accel, &surroundings, &map, self.seen, self.seed);
        let patches: Vec<Patch> = cells
            .par_iter()
            .enumerate()
            .filter(|&(cell, _)| reached[cell])
            .filter_map(|(cell, shape)| {
                self.patch(cell as u32, shape, surroundings[cell].openness, sightings[cell])
            })
            .collect();
        if patches.len() < count {
            return Err(Error::Setting(format!(
                "too few surfaces that light the view for {count} gather samples; ask for fewer"
            )));
        }
        Ok((patches, map))
    }

    fn patch(&self, cell: u32, shape: &Cell, openness: f32, sightings: f32) -> Option<Patch> {
        let points = shape.points(self.geometry, 1, hash(cell, self.seed));
        let (facet, uv) = points.first()?;
        if !self.accel.masks().is_solid(facet.triangle, uv.x, uv.y) {
            return None;
        }
        let (scene, geometry) = (self.scene, self.geometry);
        let surface = shade::surface_on_triangle(scene, geometry, facet.triangle, uv.x, uv.y, !facet.back);
        Some(Patch {
            cell,
            position: surface.position,
            normal: facet.normal,
            triangle: facet.triangle,
            area: shape.area(geometry),
            openness: openness.max(1e-3),
            sightings,
            albedo: surface.hemispherical_reflectance(),
            emission: surface.emission,
        })
    }
}

fn nothing() -> Error {
    Error::Setting("the camera sees no surface that reflects light: nothing to relight".into())
}
