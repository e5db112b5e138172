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
use super::tiles::GatherPoint;
use crate::shade::LobeTerms;
use crate::trace::sampling::{hash, sobol_2d};
use crate::trace::{Hit, Ray};

/// `b`: how far a hit that is expected is trusted against a form factor. More leave more to the hits, which are noisier; fewer leave
/// cells to form factors that are large enough for these to be wrong.
const BALANCE: f32 = 0.1;

/// Responses and densities of the lobes of a tile towards some cells, a row a point, times `cos_x / r^2` and the area.
#[derive(Default)]
struct Lobes {
    responses: Vec<f32>,
    densities: Vec<f32>,
}

/// Cells as structure of arrays: where they are, and their normals times `area / pi`.
#[derive(Default)]
struct Targets {
    cells: Vec<u32>,
    place: [Vec<f32>; 3],
    weighted: [Vec<f32>; 3],
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
        let lobes: Vec<Vec<LobeTerms>> = tiles.iter().map(lobes_of).collect();
        let mut rays = 0;
        let mut first = 0;
        for (number, (tile, lobes)) in tiles.iter().zip(&lobes).enumerate() {
            let (end, hemisphere_rays) = scratch.found_ends[number];
            if tile.points.iter().any(|point| point.lobe.is_some()) {
                let each = [hemisphere_rays as f32, self.rays_each(tile, self.settings.lobe_rays) as f32];
                let (sent, found) = self.follow_lobes(tile, scratch);
                rays += sent;
                for found in scratch.found[first..end].iter().chain(&found) {
                    self.add_hit(tile, lobes, found, each, rows);
                }
            }
            first = end;
        }
        for chunk in self.chunks() {
            self.form_factors(points, &tiles, chunk, scratch);
            for (number, (tile, lobes)) in tiles.iter().zip(&lobes).enumerate() {
                if tile.points.iter().all(|point| point.lobe.is_none()) {
                    continue;
                }
                let targets = self.targets(&tiling, tile, chunk, scratch);
                let each = [scratch.found_ends[number].1, self.rays_each(tile, self.settings.lobe_rays)];
                let terms = terms_towards(tile, lobes, &targets);
                // the rays that are expected to hit each cell
                let shares = scratch.shares(chunk, number);
                let mut expected: Vec<f32> =
                    targets.cells.iter().map(|&cell| each[0] as f32 * shares[cell as usize]).collect();
                for densities in terms.densities.chunks_exact(targets.cells.len().max(1)) {
                    for (expected, density) in expected.iter_mut().zip(densities) {
                        *expected += each[1] as f32 * density;
                    }
                }
                scratch.visible.resize(chunk.width, 0.0);
                scratch.told.resize(chunk.width, 0.0);
                let responses = terms.responses.chunks_exact(targets.cells.len().max(1));
                for (&member, responses) in tile.members.iter().zip(responses) {
                    scratch.see(&tiling, chunk, member as usize);
                    let row = &mut rows[member as usize * self.patches.len() + chunk.first..][..chunk.width];
                    for ((&cell, response), expected) in targets.cells.iter().zip(responses).zip(&expected) {
                        let (visible, told) = (scratch.visible[cell as usize], scratch.told[cell as usize]);
                        if visible > 0.0 {
                            row[cell as usize] += visible / told * response / (BALANCE * expected + 1.0);
                        }
                    }
                }
            }
        }
        drop(tiles);
        scratch.tiling = tiling;
        rays
    }

    /// Sends each point's rays along its lobe; returns how many and what they found.
    fn follow_lobes(&self, tile: &Tile<'_>, scratch: &mut RowScratch) -> (u64, Vec<Found>) {
        let each = self.rays_each(tile, self.settings.lobe_rays);
        let rays = &mut scratch.rays;
        rays.clear();
        for point in &tile.points {
            let Some(lobe) = point.lobe else { continue };
            let origin = point.origin();
            let seed = hash(4, point.seed);
            let directions = (0..each as u32).map(|index| lobe.sample(sobol_2d(index, 0, seed)));
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

    /// A hit's share. `each` are the hemisphere and the lobe rays of a point.
    fn add_hit(&self, tile: &Tile<'_>, lobes: &[LobeTerms], found: &Found, each: [f32; 2], rows: &mut [f32]) {
        let count = self.patches.len();
        let mut terms = [[0.0; super::tiles::TILE]; 3];
        let [geometry, responses, densities] = terms.each_mut().map(|terms| &mut terms[..tile.points.len()]);
        terms_at(tile, lobes, found, geometry, responses, densities);
        let sum = |values: &[f32]| values.iter().sum::<f32>();
        let expected = each[0] * sum(geometry) + each[1] * sum(densities);
        if expected <= 0.0 {
            return;
        }
        let area = self.patches.area(found.cell as usize);
        // a cell whose area nothing has seen before has no form factor: the hits count alone
        let by_area = if area > 0.0 { 1.0 / area } else { 0.0 };
        let weight = BALANCE / (BALANCE * expected + by_area);
        for (&member, &response) in tile.members.iter().zip(&*responses) {
            rows[member as usize * count + found.cell as usize] += weight * response;
        }
    }

    /// The cells of a chunk that are seen from the tile or near it.
    fn targets(
        &self,
        tiling: &super::tiles::Tiling,
        tile: &Tile<'_>,
        chunk: Chunk,
        scratch: &RowScratch,
    ) -> Targets {
        let mut cells: Vec<u32> = scratch.seen_near(tiling, chunk, tile.members).collect();
        cells.sort_unstable();
        cells.dedup();
        let mut targets = Targets::default();
        for &cell in &cells {
            let (place, weighted) = self.patches.placed(chunk.first + cell as usize);
            for axis in 0..3 {
                targets.place[axis].push(place[axis]);
                targets.weighted[axis].push(weighted[axis]);
            }
        }
        targets.cells = cells;
        targets
    }
}

fn lobes_of(tile: &Tile<'_>) -> Vec<LobeTerms> {
    tile.points.iter().map(|point| point.lobe.map(|lobe| lobe.terms()).unwrap_or_default()).collect()
}

fn terms_towards(tile: &Tile<'_>, lobes: &[LobeTerms], targets: &Targets) -> Lobes {
    let count = targets.cells.len();
    let mut terms =
        Lobes { responses: vec![0.0; lobes.len() * count], densities: vec![0.0; lobes.len() * count] };
    if count == 0 {
        return terms;
    }
    let out = terms.responses.chunks_exact_mut(count).zip(terms.densities.chunks_exact_mut(count));
    for ((point, lobe), (responses, densities)) in tile.points.iter().zip(lobes).zip(out) {
        towards_cells(lobe, point.position, targets, responses, densities);
    }
    terms
}

/// The lobe's response and density towards each cell, times `cos_x A / r^2`.
#[multiversion(targets("x86_64+avx2+fma"))]
fn towards_cells(
    lobe: &LobeTerms,
    from: Vec3,
    targets: &Targets,
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
