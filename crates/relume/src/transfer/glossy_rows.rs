//! Rows of the glossy final gather `F_g` (Hasan 2006, section 4.3): what of the light along a point's specular lobe comes from
//! each cell, as a share of what the lobe reflects. The lobe's colour is applied outside.
//!
//! The estimators are those of the diffuse rows (`rows.rs`), and what these found out is used again: their hemisphere rays, and what
//! the tiles near a point told of visibility. Points send further rays along their own lobes. All rays of a tile are taken as one
//! sample of the surfaces: of `n` cosine-distributed and `m` lobe rays a point, `N = A sum_q (n G_q + m S_q)` are expected to
//! hit a cell of area `A` (`S_q` as `G_q`, with the density of the lobe's rays for `cos / pi`), so that a hit at `x` adds
//! `R_p A / N(x) w` to the row of `p`, with `R_p` the lobe's response in place of `cos / pi` and `w = b N / (b N + 1)`. Cells that
//! few rays are expected to hit are small beside the lobe, and get the rest, `1 - w`, by their form factor `V R_p A`.
//! A sharp lobe is subdivided around its peak by the rays themselves, which fall where it is high.

use glam::Vec3;
use multiversion::multiversion;

use super::rows::{Chunk, Found, RowScratch, RowSource, Tile};
use super::tiles::{GatherPoint, TILE, Tiling};
use crate::shade::LobeTerms;
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Hit, Ray};

/// `b`: how far a hit that is expected is trusted against a form factor. Fewer leave more of a lobe to form factors, of which one may
/// stand for a whole cluster: single rows then miss their sums by far. More leave wide lobes to the hits alone, which are noisier.
const BALANCE: f32 = 2.0;

/// Lobes of less perceptual roughness are sharp; GGX's alpha is its square.
const SHARP: f32 = 0.4;

/// Responses and densities of the lobes of a tile towards some cells, a row a point, times `cos_x / r^2` and the area.
struct Lobes {
    responses: Vec<f32>,
    densities: Vec<f32>,
}

/// Cells as structure of arrays: where they are, and their normals times `area / pi`.
struct Targets<'a> {
    cells: &'a [u32],
    place: [Vec<f32>; 3],
    weighted: [Vec<f32>; 3],
}

/// A tile of which a point at least has a lobe.
struct ShinyTile<'a> {
    /// Its number in the block.
    number: usize,
    tile: &'a Tile<'a>,
    lobes: Vec<LobeTerms>,
    /// Hemisphere and lobe rays of each of its points.
    rays: [usize; 2],
}

impl ShinyTile<'_> {
    /// How many of the tile's rays are expected to hit each of the targets. `shares` are form factors added up over the tile.
    fn expected_hits(&self, terms: &Lobes, targets: &Targets<'_>, shares: &[f32]) -> Vec<f32> {
        let [hemisphere, lobe] = self.rays.map(|rays| rays as f32);
        let mut expected: Vec<f32> =
            targets.cells.iter().map(|&cell| hemisphere * shares[cell as usize]).collect();
        for densities in terms.densities.chunks_exact(expected.len()) {
            expected.iter_mut().zip(densities).for_each(|(expected, density)| *expected += lobe * density);
        }
        expected
    }
}

impl RowSource<'_> {
    /// Adds the glossy rows of the block that [`Self::block`] was last called for with `scratch` to `rows`, which has one entry a cell
    /// for each of `points`, zero on entry. Returns the number of rays.
    pub(super) fn glossy_block(
        &self,
        points: &[GatherPoint],
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) -> u64 {
        let tiling = std::mem::take(&mut scratch.tiling);
        let tiles: Vec<Tile<'_>> = tiling.tiles.iter().map(|members| Tile::new(points, members)).collect();
        let shiny: Vec<ShinyTile<'_>> = tiles
            .iter()
            .enumerate()
            .filter(|(_, tile)| tile.points.iter().any(|point| point.lobe.is_some()))
            .map(|(number, tile)| ShinyTile {
                number,
                tile,
                lobes: lobes_of(tile),
                rays: [
                    scratch.found_ends[number].1,
                    self.rays_each(tile, lobe_rays(tile, self.settings.lobe_rays)),
                ],
            })
            .collect();
        let mut rays = 0;
        for shiny in &shiny {
            rays += self.add_glossy_hits(shiny, rows, scratch);
        }
        for chunk in self.chunks() {
            self.form_factors(points, &tiles, chunk, scratch);
            for shiny in &shiny {
                self.add_glossy_form_factors(shiny, &tiling, chunk, rows, scratch);
            }
        }
        scratch.tiling = tiling;
        rays
    }

    /// The share of a tile's rays, of those that were sent for the diffuse rows and of further ones along its points' lobes. Returns
    /// the number of the latter.
    fn add_glossy_hits(&self, shiny: &ShinyTile<'_>, rows: &mut [f32], scratch: &mut RowScratch) -> u64 {
        let (sent, found) = self.follow_lobes(shiny, scratch);
        let first = shiny.number.checked_sub(1).map_or(0, |before| scratch.found_ends[before].0);
        let before = &scratch.found[first..scratch.found_ends[shiny.number].0];
        for found in before.iter().chain(&found) {
            self.add_glossy_hit(shiny, found, rows);
        }
        sent
    }

    /// Sends each point's rays along its lobe; returns how many and what they found.
    fn follow_lobes(&self, shiny: &ShinyTile<'_>, scratch: &mut RowScratch) -> (u64, Vec<Found>) {
        let rays = &mut scratch.rays;
        rays.clear();
        for point in &shiny.tile.points {
            let Some(lobe) = point.lobe else { continue };
            let origin = point.origin();
            let seed = hash(4, point.seed);
            let directions = (0..shiny.rays[1] as u32).map(|index| lobe.sample(sobol_2d(index, 0, seed)));
            let above = directions.filter(|direction| {
                direction.dot(point.geometric_normal) > 0.0 && direction.dot(point.shading_normal) > 0.0
            });
            rays.extend(above.map(|direction| Ray::new(origin, direction)));
        }
        scratch.hits.resize(rays.len(), Hit::MISS);
        self.accel.closest_batch(rays, &mut scratch.hits);
        let found = rays.iter().zip(&scratch.hits).filter_map(|(ray, hit)| self.found(ray, hit));
        (rays.len() as u64, found.collect())
    }

    fn add_glossy_hit(&self, shiny: &ShinyTile<'_>, found: &Found, rows: &mut [f32]) {
        let (count, members) = (self.patches.len(), shiny.tile.members);
        let mut terms = [[0.0; TILE]; 3];
        let [geometry, responses, densities] = terms.each_mut().map(|terms| &mut terms[..members.len()]);
        terms_at(shiny.tile, &shiny.lobes, found, geometry, responses, densities);
        let sum = |values: &[f32]| values.iter().sum::<f32>();
        // a square metre
        let expected = shiny.rays[0] as f32 * sum(geometry) + shiny.rays[1] as f32 * sum(densities);
        if expected <= 0.0 {
            return;
        }
        let area = self.patches.area(found.cell as usize);
        // a cell whose area nothing has seen before has no form factor: the hits count alone
        let by_area = if area > 0.0 { 1.0 / area } else { 0.0 };
        let weight = BALANCE / (BALANCE * expected + by_area);
        for (&member, &response) in members.iter().zip(&*responses) {
            rows[member as usize * count + found.cell as usize] += weight * response;
        }
    }

    /// The form factors' share of a chunk of cells whose diffuse form factors are at hand.
    fn add_glossy_form_factors(
        &self,
        shiny: &ShinyTile<'_>,
        tiling: &Tiling,
        chunk: Chunk,
        rows: &mut [f32],
        scratch: &mut RowScratch,
    ) {
        scratch.gather_sight(tiling, chunk, shiny.tile.members);
        let targets = self.targets(chunk, &scratch.sight.cells);
        if targets.cells.is_empty() {
            return;
        }
        let terms = terms_towards(shiny, &targets);
        let expected = shiny.expected_hits(&terms, &targets, scratch.shares(chunk, shiny.number));
        let responses = terms.responses.chunks_exact(targets.cells.len());
        for (&member, responses) in shiny.tile.members.iter().zip(responses) {
            scratch.see(tiling, chunk, member as usize);
            let row = &mut rows[member as usize * self.patches.len() + chunk.first..][..chunk.width];
            for (place, cell, visible) in scratch.sight.seen() {
                row[cell] += visible * responses[place] / (BALANCE * expected[place] + 1.0);
            }
        }
    }

    /// Some cells of a chunk.
    fn targets<'a>(&self, chunk: Chunk, cells: &'a [u32]) -> Targets<'a> {
        let mut targets = Targets { cells, place: Default::default(), weighted: Default::default() };
        for &cell in cells {
            let (place, weighted) = self.patches.placed(chunk.first + cell as usize);
            for axis in 0..3 {
                targets.place[axis].push(place[axis]);
                targets.weighted[axis].push(weighted[axis]);
            }
        }
        targets
    }
}

/// Wide lobes find with the rays of the whole tile what sharp ones must find with their own.
fn lobe_rays(tile: &Tile<'_>, of_sharp: usize) -> usize {
    let sharp =
        tile.points.iter().any(|point| point.lobe.is_some_and(|lobe| lobe.terms().alpha2 < SHARP.powi(4)));
    if sharp { of_sharp } else { of_sharp.div_ceil(4) }
}

fn lobes_of(tile: &Tile<'_>) -> Vec<LobeTerms> {
    tile.points.iter().map(|point| point.lobe.map(|lobe| lobe.terms()).unwrap_or_default()).collect()
}

fn terms_towards(shiny: &ShinyTile<'_>, targets: &Targets<'_>) -> Lobes {
    let (count, points) = (targets.cells.len(), &shiny.tile.points);
    let [mut responses, mut densities] = [0, 1].map(|_| vec![0.0; points.len() * count]);
    let out = responses.chunks_exact_mut(count).zip(densities.chunks_exact_mut(count));
    for ((point, lobe), (responses, densities)) in points.iter().zip(&shiny.lobes).zip(out) {
        towards_cells(lobe, point.position, targets, responses, densities);
    }
    Lobes { responses, densities }
}

/// The lobe's response and density towards each cell, times `cos_x A / r^2`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn towards_cells(
    lobe: &LobeTerms,
    from: Vec3,
    targets: &Targets<'_>,
    responses: &mut [f32],
    densities: &mut [f32],
) {
    let count = responses.len();
    let densities = &mut densities[..count];
    let [x, y, z] = targets.place.each_ref().map(|axis| &axis[..count]);
    let [nx, ny, nz] = targets.weighted.each_ref().map(|axis| &axis[..count]);
    for i in 0..count {
        let (dx, dy, dz) = (x[i] - from.x, y[i] - from.y, z[i] - from.z);
        let square = dx * dx + dy * dy + dz * dz + 1e-12;
        let inverse = 1.0 / square.sqrt();
        let facing = -(dx * nx[i] + dy * ny[i] + dz * nz[i]) * inverse;
        let facing = if facing > 0.0 { facing } else { 0.0 };
        // the normals are over pi
        let solid_angle = std::f32::consts::PI * facing * inverse * inverse;
        let (response, density) = lobe.towards([dx * inverse, dy * inverse, dz * inverse]);
        responses[i] = response * solid_angle;
        densities[i] = density * solid_angle;
    }
}

/// For every point of the tile towards where a ray hit: `G_p`, and the lobe's response and density times `cos_x / r^2`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn terms_at(
    tile: &Tile<'_>,
    lobes: &[LobeTerms],
    found: &Found,
    geometry: &mut [f32],
    responses: &mut [f32],
    densities: &mut [f32],
) {
    let count = geometry.len();
    let (lobes, responses, densities) = (&lobes[..count], &mut responses[..count], &mut densities[..count]);
    let [px, py, pz] = tile.x.each_ref().map(|axis| &axis[..count]);
    let [nx, ny, nz] = tile.n.each_ref().map(|axis| &axis[..count]);
    let ([x, y, z], [mx, my, mz]) = (found.position.to_array(), found.normal.to_array());
    for i in 0..count {
        let (dx, dy, dz) = (x - px[i], y - py[i], z - pz[i]);
        let inverse = 1.0 / (dx * dx + dy * dy + dz * dz + 1e-12).sqrt();
        let facing = -(dx * mx + dy * my + dz * mz) * inverse;
        let facing = if facing > 0.0 { facing * inverse * inverse } else { 0.0 };
        let cos = (dx * nx[i] + dy * ny[i] + dz * nz[i]) * inverse;
        let cos = if cos > 0.0 { cos } else { 0.0 };
        let (response, density) = lobes[i].towards([dx * inverse, dy * inverse, dz * inverse]);
        geometry[i] = std::f32::consts::FRAC_1_PI * cos * facing;
        responses[i] = response * facing;
        densities[i] = density * facing;
    }
}
