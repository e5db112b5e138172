//! From a scene to a transfer.

use std::time::Instant;

use glam::{Vec2, Vec3};
use xxhash_rust::xxh3::Xxh3;

use super::compute::{self, Computed, Encoder, Haar, Plan, RowEstimator};
use super::form_factors::Patches;
use super::low_rank::LowRankSettings;
use super::paper_rows::{ClusterBounds, PaperRows};
use super::photons::{PhotonSettings, PhotonSource};
use super::prior::LightPrior;
use super::rows::{RowSettings, RowSource};
use super::tiles::{Spread, TILE};
use super::{
    Buffer, Encoding, ImageLayout, Multibounce, Occluders, Operator, Report, Selection, Timings, Transfer,
    blocks, prior,
};
use crate::progress::Progress;
use crate::sample::{CellMap, CloudMethod, CloudSettings, GatherCloud, QUAD, Receivers, ViewSamples};
use crate::scene::{Camera, Geometry, Scene};
use crate::trace::Accel;
use crate::{Error, Result};

/// How much time and space to spend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// For a first look.
    Draft,
    /// For lighting.
    #[default]
    Standard,
    /// For the last picture: several times the time.
    Final,
}

/// How rows of the final gather are estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowMethod {
    /// Hemisphere rays and form factors, balanced, with shared visibility; the default.
    #[default]
    Balanced,
    /// The paper's cluster cut with clamped entries, for comparison.
    Paper,
}

/// What a transfer is prepared with.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Settings {
    /// Pixels: width and height, 1 to 16,384 each.
    pub size: (usize, usize),
    /// Index into the scene's cameras.
    pub camera: usize,
    /// Gather samples: a power of four. More resolve light finer, for proportionally more time.
    pub gather: usize,
    /// Where gather samples are dense.
    pub cloud: CloudMethod,
    /// Time and space to spend.
    pub quality: Quality,
    /// How operators are stored.
    pub encoding: Encoding,
    /// By what an encoding chooses the coefficients that it keeps; `None` stands for its own way ([`Encoding::selection`]).
    pub selection: Option<Selection>,
    /// How rows are estimated.
    pub rows: RowMethod,
    /// What the bounce operator holds, and how it is estimated.
    pub multibounce: Multibounce,
    /// Of [`Multibounce::Photon`].
    pub photons: PhotonSettings,
    /// Whether surfaces also show reflections of indirect light, along their specular lobes.
    pub glossy: bool,
    /// Coefficients a row of `haar-rows` and `haar-blocks`; the paper keeps 100.
    pub coefficients: usize,
    /// Of all random numbers.
    pub seed: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: (640, 480),
            camera: 0,
            gather: 65_536,
            cloud: CloudMethod::Adaptive,
            quality: Quality::Standard,
            encoding: Encoding::LowRank,
            selection: None,
            rows: RowMethod::Balanced,
            multibounce: Multibounce::default(),
            photons: PhotonSettings::default(),
            glossy: true,
            coefficients: 100,
            seed: 0,
        }
    }
}

impl Settings {
    /// By what the encoding chooses coefficients.
    pub fn selection(&self) -> Selection {
        self.selection.unwrap_or_else(|| self.encoding.selection())
    }
}

/// What [`Quality`] stands for.
struct Effort {
    gather_rows: RowSettings,
    bounce_rows: RowSettings,
    gather_encoding: LowRankSettings,
    bounce_encoding: LowRankSettings,
    training_lights: usize,
}

/// Gather samples that share a basis of the bounce operator: a 64th of the scene, within these bounds; powers of four.
const BOUNCE_BLOCK: (usize, usize) = (64, 1024);
/// Blocks of small images are one run of points, with few tiles to take the mean of: less counts as faint there, by this factor.
const FAINT_ALONE: f32 = 0.4;
/// Opening threshold of the paper's cluster cut, squared size over squared distance.
const PAPER_THRESHOLD: f32 = 0.01;
/// Coefficients a row of the paper's multi-bounce matrix, as a share of the final gather's: 40 of 100.
const PAPER_BOUNCE_SHARE: f64 = 0.4;

impl Quality {
    fn effort(self) -> Effort {
        let rows = |hemisphere_rays, tile_rays, faint, (tile, tent)| RowSettings {
            hemisphere_rays,
            tile_rays,
            faint,
            lobe_rays: hemisphere_rays,
            spread: Spread { tile, tent },
        };
        let low_rank = |rank, kept, price| LowRankSettings { rank, kept, price };
        match self {
            Self::Draft => Effort {
                gather_rows: rows(16, 512, 4e-3, (0.1, 0.25)),
                bounce_rows: rows(16, 256, 1e-2, (0.4, 0.4)),
                gather_encoding: low_rank(96, 3072, 6e-6),
                bounce_encoding: low_rank(96, 3072, 6e-6),
                training_lights: 128,
            },
            Self::Standard => Effort {
                gather_rows: rows(64, 768, 2e-3, (0.04, 0.09)),
                bounce_rows: rows(32, 512, 4e-3, (0.25, 0.4)),
                gather_encoding: low_rank(256, 6144, 4.5e-7),
                bounce_encoding: low_rank(256, 6144, 3e-6),
                training_lights: 384,
            },
            Self::Final => Effort {
                gather_rows: rows(128, 2048, 4e-4, (0.025, 0.06)),
                bounce_rows: rows(64, 1024, 1e-3, (0.15, 0.3)),
                gather_encoding: low_rank(512, 12_288, 1.5e-7),
                bounce_encoding: low_rank(512, 12_288, 6e-7),
                training_lights: 576,
            },
        }
    }
}

/// Receivers that share a basis: fewer in small images, whose pixels lie farther apart and share less.
fn receiver_block(pixels: usize) -> usize {
    match pixels {
        0..40_000 => 64,
        40_000..160_000 => 256,
        _ => 1024,
    }
}

/// A preparation that is about to run: the scene and how to prepare it.
#[derive(Clone, Debug)]
pub struct Preparation<'a> {
    scene: &'a Scene,
    name: String,
    settings: Settings,
}

impl<'a> Preparation<'a> {
    /// Prepares `scene` with the default settings, unless told otherwise.
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene, name: String::new(), settings: Settings::default() }
    }

    /// The name to keep in the report, as the file's.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// All settings at once.
    #[must_use]
    pub fn settings(mut self, settings: Settings) -> Self {
        self.settings = settings;
        self
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(mut self, width: usize, height: usize) -> Self {
        self.settings.size = (width, height);
        self
    }

    /// Gather samples, a power of four.
    #[must_use]
    pub fn gather(mut self, count: usize) -> Self {
        self.settings.gather = count;
        self
    }

    /// Time and space to spend.
    #[must_use]
    pub fn quality(mut self, quality: Quality) -> Self {
        self.settings.quality = quality;
        self
    }

    /// Does it, on the current rayon thread pool. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range and scenes with nothing to relight; [`Error::Cancelled`].
    pub fn run(self, progress: &dyn Progress) -> Result<Transfer> {
        let camera = self.check()?.clone();
        let began = Instant::now();
        let stages = Stages::new(progress);
        let geometry = Geometry::new(self.scene);
        progress.stage("acceleration structure", 1);
        let accel = Accel::new(self.scene, &geometry);
        let shot = Shot { scene: self.scene, geometry: &geometry, accel: &accel, settings: &self.settings };
        let (view, receivers, cloud, map) = shot.samples(&camera, &stages)?;
        let (gather, bounce, owners) = shot.operators(&receivers, &cloud, &map, &stages)?;
        let settings = &self.settings;
        let lit = (receivers.points.len() - receivers.further.len()).max(1) as f64;
        let rows = row_numbers(&owners);
        let report = Report {
            settings: settings.clone(),
            scene: self.name,
            materials: self.scene.materials.iter().map(|material| material.name.clone()).collect(),
            base_colors: self
                .scene
                .materials
                .iter()
                .map(|material| material.base_color.truncate().to_array())
                .collect(),
            emissive: (0..)
                .zip(&self.scene.materials)
                .filter(|(_, material)| material.emission != Vec3::ZERO)
                .map(|(number, _)| number)
                .collect(),
            scene_hash: scene_hash(self.scene, &geometry, &camera),
            triangles: geometry.triangles.len() as u64,
            rays_per_pixel: gather.rays as f64 / lit,
            rays_per_gather_sample: bounce.rays as f64 / cloud.len() as f64,
            gather_error: gather.operator.expected_error,
            glossy_error: gather.glossy.as_ref().map(|glossy| glossy.expected_error),
            bounce_error: bounce.operator.expected_error,
        };
        let occluders = Occluders::new(&geometry, accel.masks());
        let timings = Timings { stages: stages.finish(), seconds: began.elapsed().as_secs_f64() };
        Ok(Transfer {
            report,
            timings,
            view,
            cloud,
            gather: gather.operator,
            glossy: gather.glossy,
            bounce: bounce.operator,
            rows_of_centers: rows(&receivers.of_centers),
            rows_of_quads: rows(&receivers.of_quads),
            occluders,
        })
    }

    fn check(&self) -> Result<&'a Camera> {
        let (width, height) = self.settings.size;
        if !(1..=16_384).contains(&width) || !(1..=16_384).contains(&height) {
            return Err(Error::Setting(format!(
                "an image of {width}x{height}: each side must be 1 to 16384 pixels"
            )));
        }
        if !(1..=4096).contains(&self.settings.coefficients) {
            return Err(Error::Setting(format!(
                "{} coefficients a row: must be 1 to 4096",
                self.settings.coefficients
            )));
        }
        self.settings.photons.check()?;
        self.scene.cameras.get(self.settings.camera).ok_or_else(|| {
            Error::Setting(format!(
                "no camera {}: the scene has {}, numbered from 0",
                self.settings.camera,
                self.scene.cameras.len()
            ))
        })
    }
}

/// Passes progress on and notes how long each stage took.
struct Stages<'a> {
    progress: &'a dyn Progress,
    began: std::sync::Mutex<Vec<(String, Instant)>>,
}

impl<'a> Stages<'a> {
    fn new(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            began: std::sync::Mutex::new(vec![("acceleration structure".into(), Instant::now())]),
        }
    }

    fn finish(&self) -> Vec<(String, f64)> {
        self.stage("", 0);
        let began = self.began.lock().map(|began| began.clone()).unwrap_or_default();
        began
            .windows(2)
            .map(|pair| (pair[0].0.clone(), pair[1].1.duration_since(pair[0].1).as_secs_f64()))
            .collect()
    }
}

impl Progress for Stages<'_> {
    fn stage(&self, name: &str, steps: u64) {
        if let Ok(mut began) = self.began.lock() {
            began.push((name.to_owned(), Instant::now()));
        }
        if steps > 0 {
            self.progress.stage(name, steps);
        }
    }

    fn advance(&self, steps: u64) {
        self.progress.advance(steps);
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
}

/// What all stages read.
struct Shot<'a> {
    scene: &'a Scene,
    geometry: &'a Geometry,
    accel: &'a Accel,
    settings: &'a Settings,
}

impl Shot<'_> {
    fn samples(
        &self,
        camera: &Camera,
        progress: &dyn Progress,
    ) -> Result<(ViewSamples, Receivers, GatherCloud, CellMap)> {
        let (width, height) = self.settings.size;
        let (view, hits) =
            ViewSamples::new(self.scene, self.geometry, self.accel, camera, (width, height), progress)?;
        let receivers = Receivers::new(&view, camera, self.settings.glossy);
        let look = |pixel: usize, offset: Vec2| {
            let (x, y) = ((pixel % width) as f32 + offset.x, (pixel / width) as f32 + offset.y);
            camera.direction(x, y, width, height)
        };
        let centers =
            hits.centers.iter().enumerate().map(|(pixel, &hit)| (hit, look(pixel, Vec2::splat(0.5))));
        let further = receivers.further.iter().map(|&quad| quad as usize);
        let further = further.map(|quad| (hits.quads[quad], look(quad / 4, QUAD[quad % 4])));
        let seen: Vec<_> = centers.chain(further).collect();
        let Settings { gather: count, cloud: method, seed, .. } = *self.settings;
        let settings = CloudSettings { count, method, seed };
        let (cloud, map) =
            GatherCloud::new(self.scene, self.geometry, self.accel, &seen, &settings, progress)?;
        Ok((view, receivers, cloud, map))
    }

    fn operators(
        &self,
        receivers: &Receivers,
        cloud: &GatherCloud,
        map: &CellMap,
        progress: &dyn Progress,
    ) -> Result<(Computed, Computed, Vec<u32>)> {
        let effort = self.settings.quality.effort();
        let seed = self.settings.seed;
        let patches = Patches::new(cloud, map);
        let bounds = ClusterBounds::new(cloud);
        let estimator = |settings| match self.settings.rows {
            RowMethod::Balanced => RowEstimator::Balanced(RowSource {
                accel: self.accel,
                geometry: self.geometry,
                map,
                patches: &patches,
                settings,
            }),
            RowMethod::Paper => RowEstimator::Paper(PaperRows {
                accel: self.accel,
                cloud,
                bounds: &bounds,
                threshold: PAPER_THRESHOLD,
            }),
        };
        let count = patches.len();
        let lights = self.training_light(cloud, effort.training_lights, progress)?;
        let bounce = {
            let prior = self.prior(cloud, &lights, None, progress)?;
            let share = (self.settings.coefficients as f64 * PAPER_BOUNCE_SHARE).ceil() as usize;
            let length = (count / 64).clamp(BOUNCE_BLOCK.0, BOUNCE_BLOCK.1);
            let store =
                Store::new(self.settings, effort.bounce_encoding.of_blocks(length), prior, share, count);
            let rows = blocks::of_cloud(cloud, length, seed);
            let layout = ImageLayout::of_cloud(count);
            let encoder = store.encoder(&layout);
            let compute = |estimator| {
                progress.stage("bounces", rows.points.len() as u64);
                compute::compute(Plan { estimator, encoder, glossy: false, count }, &rows, progress)
            };
            match self.settings.multibounce {
                Multibounce::Iterated => compute(estimator(effort.bounce_rows))?,
                Multibounce::Photon => {
                    let source = self.photons(cloud, map);
                    let photons = source.shoot(progress)?;
                    let computed = compute(RowEstimator::Photons(&photons))?;
                    Computed { rays: computed.rays + photons.rays(), ..computed }
                }
            }
        };
        let times = self.settings.multibounce.times_to_learn();
        let prior = self.prior(cloud, &lights, Some((&bounce.operator, times)), progress)?;
        drop(lights);
        let (width, height) = self.settings.size;
        let length = receiver_block(width * height);
        let encoding = effort.gather_encoding.of_blocks(length);
        let store = Store::new(self.settings, encoding, prior, self.settings.coefficients, count);
        let rows = blocks::of_receivers(&receivers.points, length, seed, progress)?;
        let layout = ImageLayout::of_receivers(width, receivers, &rows.owners);
        let mut gather_rows = effort.gather_rows;
        if length <= TILE {
            gather_rows.faint *= FAINT_ALONE;
        }
        progress.stage("final gather", rows.points.len() as u64);
        let plan = Plan {
            estimator: estimator(gather_rows),
            encoder: store.encoder(&layout),
            glossy: self.settings.glossy,
            count,
        };
        let gather = compute::compute(plan, &rows, progress)?;
        Ok((gather, bounce, rows.owners))
    }

    fn photons<'a>(&'a self, cloud: &'a GatherCloud, map: &'a CellMap) -> PhotonSource<'a> {
        let Settings { photons: settings, seed, .. } = *self.settings;
        PhotonSource { accel: self.accel, geometry: self.geometry, map, cloud, settings, seed }
    }

    /// Whether something is learned from random lights: what light is likely, or at least, which of it goes together.
    fn learns(&self) -> bool {
        self.settings.encoding == Encoding::LowRank || self.settings.selection() == Selection::Prior
    }

    /// Light on the cloud to learn from; none where nothing is learned.
    fn training_light(
        &self,
        cloud: &GatherCloud,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<f32>>> {
        if !self.learns() {
            return Ok(Vec::new());
        }
        let lights = prior::training_lights(cloud, self.accel, count, self.settings.seed);
        prior::train(cloud, self.accel, &lights, progress)
    }

    fn prior(
        &self,
        cloud: &GatherCloud,
        lights: &[Vec<f32>],
        bounce: Option<(&Operator, u32)>,
        progress: &dyn Progress,
    ) -> Result<Option<LightPrior>> {
        if !self.learns() {
            return Ok(None);
        }
        progress.stage("light prior", lights.len() as u64);
        LightPrior::new(cloud, lights, self.settings.selection(), bounce, progress).map(Some)
    }
}

/// From receivers to the rows of which they are the `owners`.
fn row_numbers(owners: &[u32]) -> impl Fn(&[u32]) -> Buffer<u32> {
    let mut rows = vec![Receivers::NONE; owners.len()];
    for (row, &receiver) in owners.iter().enumerate() {
        rows[receiver as usize] = row as u32;
    }
    move |receivers: &[u32]| {
        let row = |&receiver: &u32| match receiver {
            Receivers::NONE => Receivers::NONE,
            receiver => rows[receiver as usize],
        };
        receivers.iter().map(row).collect::<Vec<_>>().into()
    }
}

/// How one operator is stored, with what was learned for it.
enum Store {
    LowRank { settings: LowRankSettings, prior: LightPrior },
    Haar { per_row: usize, weights: Vec<f32>, as_images: bool },
}

impl Store {
    /// `prior` is there wherever something is learned.
    fn new(
        settings: &Settings,
        low_rank: LowRankSettings,
        prior: Option<LightPrior>,
        per_row: usize,
        count: usize,
    ) -> Self {
        match (settings.encoding, prior) {
            (Encoding::LowRank, Some(prior)) => Self::LowRank { settings: low_rank, prior },
            (encoding, prior) => Self::Haar {
                per_row,
                weights: match prior {
                    Some(prior) => prior.magnitudes,
                    None => settings.selection().unlearned(count).unwrap_or_else(|| vec![1.0; count]),
                },
                as_images: encoding == Encoding::HaarBlocks,
            },
        }
    }

    fn encoder<'a>(&'a self, layout: &'a ImageLayout) -> Encoder<'a> {
        match self {
            Self::LowRank { settings, prior } => Encoder::LowRank { settings: *settings, prior },
            Self::Haar { per_row, weights, as_images } => {
                Encoder::Haar(Haar { per_row: *per_row, weights, layout: as_images.then_some(layout) })
            }
        }
    }
}

/// A hash of what a preparation reads of the scene.
fn scene_hash(scene: &Scene, geometry: &Geometry, camera: &Camera) -> String {
    let mut hash = Xxh3::new();
    hash.update(bytemuck::cast_slice(&geometry.positions));
    hash.update(bytemuck::cast_slice(&geometry.normals));
    hash.update(bytemuck::cast_slice(&geometry.uvs));
    hash.update(bytemuck::cast_slice(&geometry.triangles));
    hash.update(bytemuck::cast_slice(&geometry.tangents));
    hash.update(bytemuck::cast_slice(&geometry.materials));
    hash.update(bytemuck::cast_slice(&geometry.objects));
    for material in &scene.materials {
        hash.update(format!("{material:?}").as_bytes());
    }
    for texture in &scene.textures {
        hash.update(
            format!("{} {} {:?} {:?}", texture.width, texture.height, texture.color_space, texture.wrap)
                .as_bytes(),
        );
        hash.update(bytemuck::cast_slice(&texture.texels));
    }
    hash.update(format!("{camera:?}").as_bytes());
    format!("{:016x}", hash.digest())
}
