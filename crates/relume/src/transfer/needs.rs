//! How much memory the stages of a preparation need, by their sizes.
//!
//! Figures with a unit were measured and are rounded up: what is told to fit must fit.

use super::effort::{bounce_block, receiver_block};
use super::low_rank::LowRankSettings;
use super::low_rank_run::HEARD_TOGETHER;
use super::rows::CHUNK;
use super::{Encoding, Multibounce, Settings};
use crate::scene::Scene;

/// Of a triangle: what it is in world space, its part of an acceleration structure, and what is needed to build that.
const A_TRIANGLE: u64 = 400;
/// Of a pixel: its view samples, what they hit and where they gather.
const A_PIXEL: u64 = 800;
/// Of a ray that tells who sees what.
const A_SIGHT_RAY: u64 = 26;
/// Of a receiver, while records are chosen: its place, and what it takes of which.
const A_RECEIVER: u64 = 280;
/// Of a gather sample: while its cell is made beside such rays, while its portrait is taken, and then on.
const A_CELL: [u64; 3] = [1500, 4200, 3300];
/// Most gather samples that there can be.
const MOST_CELLS: usize = 1 << 20;
/// Of a photon.
const A_PHOTON: u64 = 96;
/// Of a row that is encoded at [`USUAL_PRICE`], diffuse and glossy; more where bytes are cheaper, by this power: in sponza 80 bytes in blocks of 1024 rows,
/// 200 at a fifth of the price, and 2400 in those of 64 at a hundredth (these before light was told as a multiple of what is expected).
const AN_ENCODED_ROW: f64 = 200.0;
const USUAL_PRICE: f64 = 3.2e-6;
const CHEAPER: f64 = 0.75;
/// Receivers for a pixel.
const RECEIVERS: f64 = 1.15;
/// Of an entry of a row, while it is made: what rays have found and seen, a share of what the entry itself takes. What it turns out to be is
/// measured.
const SCRATCH: f64 = 0.15;

/// Of an entry of a row while its chunk of cells is looked at: form factors, and the rays that ask for it.
const AN_ENTRY_AT_HAND: u64 = 16;
/// Of the directions and weights of a block, how many times as much there is while it and its parts are tried.
const BLOCKS_AT_ONCE: usize = 3;

/// What making one block of rows takes, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct BlockNeeds {
    /// Rows and what they are made with, by an estimate.
    pub(super) rows: u64,
    /// Copies that the encoder makes of parts of them, at most.
    pub(super) encoder: u64,
}

impl BlockNeeds {
    /// For blocks of up to `rows` rows of `count` entries, stored by their own coefficients.
    pub(super) fn of_rows(rows: usize, count: usize) -> Self {
        let entries = (rows * count * size_of::<f32>()) as f64;
        let looked_at = AN_ENTRY_AT_HAND * (rows * CHUNK.min(count)) as u64;
        Self { rows: (entries * (1.0 + SCRATCH)) as u64 + looked_at, encoder: (count * 32) as u64 }
    }

    /// The same, stored as [`Encoding::LowRank`], with what `lights` training lights teach.
    pub(super) fn of_low_rank(rows: usize, count: usize, settings: &LowRankSettings, lights: usize) -> Self {
        let candidates = (3 * settings.kept / 2).min(count);
        let width = (settings.rank + 8).min(rows);
        let (kept, weights) = (settings.kept.min(count), settings.rank.min(rows) * rows);
        let cut = settings.kept.max(HEARD_TOGETHER).min(count);
        // the run cut to the candidates, and a block of it to those that are kept, or those that are heard together, with their responses; what was learned of both; how rows go
        // together, in double precision, and a part of that product; directions along all candidates, and along those that are kept: one block's as
        // they are made and as they are quantised, and those of what it may be parted into; bases, in double precision
        let values = rows * (candidates + cut + lights)
            + 2 * candidates * lights
            + 3 * rows * rows
            + width * candidates
            + BLOCKS_AT_ONCE * (width * kept + weights)
            + 8 * width * (rows + width);
        let base = Self::of_rows(rows, count);
        Self { encoder: base.encoder + (values * size_of::<f32>()) as u64, ..base }
    }

    pub(super) fn bytes(self) -> u64 {
        self.rows + self.encoder
    }
}

/// What a preparation takes beside the scene, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Needs {
    /// Of the scene as rays meet it and what the camera sees of it.
    pub(super) looked: u64,
    /// Of all that follows, at most at once.
    pub(super) after_looking: u64,
    /// Of what follows on the gather cloud.
    pub(super) after_cloud: u64,
    /// Of the cloud and what is learned on it: what is there while blocks are made.
    pub(super) beside_blocks: u64,
}

impl Needs {
    /// `makes_rows` says whether there are blocks to be made.
    pub(super) fn new(settings: &Settings, scene: &Scene, makes_rows: bool) -> Self {
        let Settings { gather, size: (width, height), .. } = *settings;
        // others are refused by whoever makes the cloud
        let count = gather.min(MOST_CELLS);
        let effort = settings.quality.effort();
        let (pixels, cells) = ((width * height) as u64, count as u64);
        let lights = effort.training_lights as u64;
        // as if each had a row: of records there are fewer, whose rows take more
        let receivers = (RECEIVERS * pixels as f64) as usize;
        let operators = [
            (count, bounce_block(count), effort.bounce_encoding),
            (receivers, receiver_block(width * height), effort.gather_encoding),
        ];
        let blocks = operators.map(|(rows, length, encoding)| match settings.encoding {
            Encoding::LowRank => {
                let block = BlockNeeds::of_low_rank(length, count, &encoding, effort.training_lights);
                (block.bytes(), encoded_low_rank(rows, &encoding.of_blocks(length)))
            }
            Encoding::HaarRows | Encoding::HaarBlocks => (
                BlockNeeds::of_rows(length, count).bytes(),
                encoded_coefficients(rows, settings.coefficients),
            ),
        });
        let block = blocks.iter().map(|block| block.0).max().filter(|_| makes_rows).unwrap_or(0);
        let encoded: u64 = blocks.iter().map(|block| block.1).sum();
        let photons = match settings.multibounce {
            Multibounce::Photon => A_PHOTON * settings.photons.count as u64,
            Multibounce::Iterated => 0,
        };
        // the lights, their coefficients, and what is learned of these; of the three, the second is gone when blocks are made
        let learned = lights * cells * size_of::<f32>() as u64;
        let records = match settings.gather_spacing() {
            Some(_) => A_RECEIVER * (receivers + count) as u64,
            None => 0,
        };
        let after_cloud = (3 * learned).max(2 * learned + photons + records + block + encoded);
        let rays = (64 * pixels).min(effort.sight_rays as u64);
        let [beside_rays, portrait, then] = A_CELL.map(|bytes| bytes * cells);
        let making_cloud = (A_SIGHT_RAY * rays + beside_rays).max(portrait);
        Self {
            looked: A_TRIANGLE * triangles(scene) + A_PIXEL * pixels,
            after_looking: making_cloud.max(then + after_cloud),
            after_cloud,
            beside_blocks: then + 2 * learned + records,
        }
    }
}

/// What so many rows are expected to take as blocks of [`Encoding::LowRank`], bytes.
pub(super) fn encoded_low_rank(rows: usize, settings: &LowRankSettings) -> u64 {
    let cheap = (USUAL_PRICE / f64::from(settings.price)).max(1.0);
    (AN_ENCODED_ROW * rows as f64 * cheap.powf(CHEAPER)).round() as u64
}

/// What so many rows take by their own coefficients, diffuse and glossy: places and values, bytes.
pub(super) fn encoded_coefficients(rows: usize, per_row: usize) -> u64 {
    2 * rows as u64 * (8 * per_row as u64 + 8)
}

fn triangles(scene: &Scene) -> u64 {
    let of_mesh = |mesh: usize| scene.meshes.get(mesh).map_or(0, |mesh| mesh.triangles.len() as u64);
    scene.instances.iter().map(|instance| of_mesh(instance.mesh)).sum()
}

/// What a scene takes: its textures and meshes, bytes.
pub(super) fn scene_bytes(scene: &Scene) -> u64 {
    let texels: usize = scene.textures.iter().map(|texture| size_of_val(&*texture.texels)).sum();
    let meshes = scene.meshes.iter().map(|mesh| {
        size_of_val(&*mesh.positions)
            + size_of_val(&*mesh.normals)
            + size_of_val(&*mesh.uvs)
            + size_of_val(&*mesh.tangents)
            + size_of_val(&*mesh.triangles)
    });
    (texels + meshes.sum::<usize>()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needed(settings: &Settings, makes_rows: bool) -> u64 {
        let needs = Needs::new(settings, &Scene::default(), makes_rows);
        needs.looked + needs.after_looking
    }

    #[test]
    fn a_preparation_needs_most_for_a_block_and_for_its_cells() {
        let settings = Settings::default();
        let standard = needed(&settings, true);
        assert!((1_000_000_000..1_500_000_000).contains(&standard), "{standard}");
        // of 1024 rows of 65,536 entries, and less than as much again
        let block = BlockNeeds::of_low_rank(1024, 65_536, &settings.quality.effort().gather_encoding, 400);
        assert!((268_435_456..500_000_000).contains(&block.bytes()), "{block:?}");
        let rows = [1024, 64].map(|length| settings.quality.effort().gather_encoding.of_blocks(length));
        assert_eq!(rows.map(|encoding| encoded_low_rank(100, &encoding)), [20_000, 160_000]);
        assert!(standard - needed(&settings, false) > block.bytes() / 2, "merging makes none");
        let smaller = Settings { size: (320, 240), ..settings.clone() };
        let coarser = Settings { gather: 16_384, ..settings.clone() };
        assert!(
            needed(&smaller, true) < standard
                && needed(&coarser, true) < standard / 2 + needed(&smaller, true) / 2
        );
        // what nobody can prepare is refused elsewhere, and must not be too much for these sums
        let endless = Settings { size: (16_384, 16_384), gather: usize::MAX, ..settings };
        assert!(needed(&endless, true) > standard);
    }

    #[test]
    fn triangles_count_where_they_stand() {
        let mesh = crate::scene::Mesh { triangles: vec![[0, 1, 2]; 10], ..Default::default() };
        let instance = |mesh| crate::scene::Instance {
            name: String::new(),
            mesh,
            world_from_object: glam::Affine3A::IDENTITY,
            object: 0,
        };
        let scene =
            Scene { meshes: vec![mesh], instances: vec![instance(0), instance(0)], ..Scene::default() };
        assert_eq!(triangles(&scene), 20);
        assert_eq!(scene_bytes(&scene), 120);
    }
}
