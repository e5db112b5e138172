//! From a scene to a transfer.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use glam::{Vec2, Vec3};
use xxhash_rust::xxh3::Xxh3;

use super::budget;
use super::compute::{self, Computed, Encoder, Haar, Plan, RowEstimator};
use super::effort::{Effort, bounce_block, receiver_block};
use super::form_factors::Patches;
use super::low_rank::LowRankSettings;
use super::paper_rows::{ClusterBounds, PaperRows};
use super::photons::PhotonSource;
use super::prior::LightPrior;
use super::rows::{RowSettings, RowSource};
use super::training::Training;
use super::{
    Buffer, Encoding, ImageLayout, Multibounce, Occluders, Operator, Quality, Report, RowMethod, Selection,
    Settings, Timings, Transfer, blocks, gathering_pixels,
};
use crate::Result;
use crate::progress::Progress;
use crate::sample::{CellMap, CloudSettings, GatherCloud, QUAD, Receivers, ViewHits, ViewSamples};
use crate::scene::{Camera, Geometry, Scene};
use crate::trace::{Accel, Hit};

/// Rays that tell who sees what where no receivers are shared.
const SIGHT_RAYS: usize = 20_000_000;
/// Lights of other kinds than are learned from, by which encodings are judged as well.
const OTHER_LIGHTS: usize = 24;
/// Opening threshold of the paper's cluster cut, squared size over squared distance.
const PAPER_THRESHOLD: f32 = 0.01;
/// Coefficients a row of the paper's multi-bounce matrix, as a share of the final gather's: 40 of 100.
const PAPER_BOUNCE_SHARE: f64 = 0.4;

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
    /// [`crate::Error::Setting`] for settings out of range and scenes with nothing to relight; [`crate::Error::Cancelled`].
    pub fn run(self, progress: &dyn Progress) -> Result<Transfer> {
        let camera = self.settings.check(self.scene)?;
        let stages = Stages::new(progress);
        let looked = Looked::new(self.scene, camera, self.settings.size, &stages)?;
        self.transfer(&self.settings, looked, stages)
    }

    /// Does it in steps: a coarse transfer within seconds, a better one, and in the end what [`Self::run`] returns, bit for bit. `show` is given
    /// each but the last as soon as it is there.
    ///
    /// # Errors
    /// As of [`Self::run`], and what `show` returns.
    pub fn run_in_steps(
        self,
        progress: &dyn Progress,
        mut show: impl FnMut(Transfer) -> Result<()>,
    ) -> Result<Transfer> {
        let camera = self.settings.check(self.scene)?;
        let stages = Stages::new(progress);
        let looked = Looked::new(self.scene, camera, self.settings.size, &stages)?;
        for settings in self.settings.coarser() {
            show(self.transfer(&settings, looked.clone(), Stages::new(progress))?)?;
        }
        self.transfer(&self.settings, looked, stages)
    }

    fn transfer(&self, settings: &Settings, looked: Looked<'_>, stages: Stages<'_>) -> Result<Transfer> {
        let Looked { camera, geometry, all, opaque, view, hits } = looked;
        let (geometry, all) = (&*geometry, &*all);
        let opaque = opaque.as_deref();
        let (accel, surfaces) = opaque.map_or((all, geometry), |(accel, geometry)| (accel, geometry));
        let shot = Shot { scene: self.scene, geometry: surfaces, accel, settings };
        let (receivers, cloud, map) = shot.samples(camera, &view, &hits, &stages)?;
        let (gather, bounce, owners) = shot.operators(&receivers, &cloud, &map, &stages)?;
        let of_centers = [&receivers.of_centers[..], &receivers.of_center_branches[..]];
        let lit = gathering_pixels(&view, of_centers).max(1) as f64;
        let rows = row_numbers(&owners);
        let materials = &self.scene.materials;
        let report = Report {
            settings: settings.clone(),
            scene: self.name.clone(),
            materials: materials.iter().map(|material| material.name.clone()).collect(),
            base_colors: materials.iter().map(|material| material.base_color.truncate().to_array()).collect(),
            emissive: (0..)
                .zip(materials)
                .filter(|(_, material)| material.emission != Vec3::ZERO)
                .map(|(number, _)| number)
                .collect(),
            scene_hash: scene_hash(self.scene, geometry, camera),
            triangles: geometry.triangles.len() as u64,
            rays_per_pixel: gather.rays as f64 / lit,
            rays_per_gather_sample: bounce.rays as f64 / cloud.surfaces().len() as f64,
            gather_error: gather.operator.expected_error,
            glossy_error: gather.glossy.as_ref().map(|glossy| glossy.expected_error),
            bounce_error: bounce.operator.expected_error,
        };
        let occluders = Occluders::new(surfaces, accel.masks());
        Ok(Transfer {
            report,
            timings: stages.finish(),
            view,
            cloud,
            gather: gather.operator,
            glossy: gather.glossy,
            bounce: bounce.operator,
            rows_of_centers: rows(&receivers.of_centers),
            rows_of_quads: rows(&receivers.of_quads),
            rows_of_center_branches: rows(&receivers.of_center_branches),
            rows_of_quad_branches: rows(&receivers.of_quad_branches),
            occluders,
        })
    }
}

/// A scene as rays meet it, and what the camera sees of it: the same for all steps of a preparation.
#[derive(Clone)]
struct Looked<'a> {
    camera: &'a Camera,
    geometry: Arc<Geometry>,
    all: Arc<Accel>,
    /// Without clear surfaces, where there are any: what light meets.
    opaque: Option<Arc<(Accel, Geometry)>>,
    view: ViewSamples,
    hits: ViewHits,
}

impl<'a> Looked<'a> {
    fn new(scene: &Scene, camera: &'a Camera, size: (usize, usize), progress: &dyn Progress) -> Result<Self> {
        let geometry = Geometry::new(scene);
        progress.stage("acceleration structure", 1);
        let all = Accel::new(scene, &geometry);
        let opaque =
            geometry.without_clear().map(|geometry| Arc::new((Accel::new(scene, &geometry), geometry)));
        let (view, hits) = ViewSamples::new(scene, &geometry, &all, camera, size, progress)?;
        Ok(Self { camera, geometry: geometry.into(), all: all.into(), opaque, view, hits })
    }
}

/// Passes progress on and notes how long each stage took.
struct Stages<'a> {
    progress: &'a dyn Progress,
    began: Mutex<Vec<(String, Instant)>>,
}

impl<'a> Stages<'a> {
    fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, began: Mutex::new(vec![("acceleration structure".into(), Instant::now())]) }
    }

    fn finish(&self) -> Timings {
        self.stage("", 0);
        let began = self.began.lock().map(|began| began.clone()).unwrap_or_default();
        let stages: Vec<(String, f64)> = began
            .windows(2)
            .map(|pair| (pair[0].0.clone(), pair[1].1.duration_since(pair[0].1).as_secs_f64()))
            .collect();
        Timings { seconds: stages.iter().map(|(_, seconds)| seconds).sum(), stages }
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
        view: &ViewSamples,
        hits: &ViewHits,
        progress: &dyn Progress,
    ) -> Result<(Receivers, GatherCloud, CellMap)> {
        let (width, height) = self.settings.size;
        let receivers = Receivers::new(view, camera, self.settings.glossy, self.settings.sharing, progress)?;
        let look = |pixel: usize, offset: Vec2| {
            let (x, y) = ((pixel % width) as f32 + offset.x, (pixel / width) as f32 + offset.y);
            camera.direction(x, y, width, height)
        };
        let centers =
            hits.centers.iter().enumerate().map(|(pixel, &hit)| (hit, look(pixel, Vec2::splat(0.5))));
        let further = receivers.further.iter().map(|&quad| quad as usize);
        let further = further.map(|quad| (hits.quads[quad], look(quad / 4, QUAD[quad % 4])));
        let branches = receivers.further_branches.iter().map(|&branch| hits.quad_branches[branch as usize]);
        let branches = hits.center_branches.iter().copied().chain(branches);
        // clear surfaces are not there for the light that is gathered
        let opaque = self.geometry.triangles.len();
        let is_opaque = |(hit, _): &(Hit, Vec3)| !hit.is_hit() || (hit.triangle as usize) < opaque;
        let seen: Vec<_> = centers.chain(further).chain(branches).filter(is_opaque).collect();
        let Settings { gather: count, cloud: method, sky, seed, sharing, .. } = *self.settings;
        let settings = CloudSettings { count, method, sky, rays: SIGHT_RAYS / sharing, seed };
        let (cloud, map) =
            GatherCloud::new(self.scene, self.geometry, self.accel, &seen, &settings, progress)?;
        Ok((receivers, cloud, map))
    }

    fn operators(
        &self,
        receivers: &Receivers,
        cloud: &GatherCloud,
        map: &CellMap,
        progress: &dyn Progress,
    ) -> Result<(Computed, Computed, Vec<u32>)> {
        let rows = Rows {
            shot: self,
            cloud,
            map,
            patches: &Patches::new(cloud, map),
            bounds: &ClusterBounds::new(cloud),
            effort: self.settings.quality.effort(),
        };
        let lights = self.training(cloud, rows.effort.training_lights, progress)?;
        let prior = self.prior(cloud, &lights, None, progress)?;
        let bounce = rows.bounces(prior, progress)?;
        let times = self.settings.multibounce.times_to_learn();
        let prior = self.prior(cloud, &lights, Some((&bounce.operator, times)), progress)?;
        drop(lights);
        let (gather, owners) = rows.final_gather(receivers, prior, progress)?;
        Ok((gather, bounce, owners))
    }

    /// Whether something is learned from random lights: what light is likely, or at least, which of it goes together.
    fn learns(&self) -> bool {
        self.settings.encoding == Encoding::LowRank || self.settings.selection() == Selection::Prior
    }

    /// Light on the cloud to learn from; none where nothing is learned.
    fn training(&self, cloud: &GatherCloud, count: usize, progress: &dyn Progress) -> Result<Training> {
        if !self.learns() {
            return Ok(Training::default());
        }
        Training::new(cloud, self.accel, (count, OTHER_LIGHTS), self.settings.seed, progress)
    }

    fn prior(
        &self,
        cloud: &GatherCloud,
        lights: &Training,
        bounce: Option<(&Operator, u32)>,
        progress: &dyn Progress,
    ) -> Result<Option<LightPrior>> {
        if !self.learns() {
            return Ok(None);
        }
        progress.stage("light prior", (lights.alike.len() + lights.others.len()) as u64);
        LightPrior::new(cloud, lights, self.settings.selection(), bounce, progress).map(Some)
    }
}

/// What rows are made of.
struct Rows<'a> {
    shot: &'a Shot<'a>,
    cloud: &'a GatherCloud,
    map: &'a CellMap,
    patches: &'a Patches,
    bounds: &'a ClusterBounds,
    effort: Effort,
}

impl Rows<'_> {
    fn estimator(&self, settings: RowSettings) -> RowEstimator<'_> {
        let Shot { accel, geometry, .. } = *self.shot;
        match self.shot.settings.rows {
            RowMethod::Balanced => RowEstimator::Balanced(RowSource {
                accel,
                geometry,
                map: self.map,
                patches: self.patches,
                settings,
            }),
            RowMethod::Paper => RowEstimator::Paper(PaperRows {
                accel,
                cloud: self.cloud,
                bounds: self.bounds,
                threshold: PAPER_THRESHOLD,
            }),
        }
    }

    fn bounces(&self, prior: Option<LightPrior>, progress: &dyn Progress) -> Result<Computed> {
        let (settings, count) = (self.shot.settings, self.patches.len());
        let per_row = (settings.coefficients as f64 * PAPER_BOUNCE_SHARE).ceil() as usize;
        let length = bounce_block(count);
        let store =
            Store::new(settings, self.effort.bounce_encoding.of_blocks(length), prior, per_row, count);
        let rows = blocks::of_cloud(self.cloud, length, settings.seed);
        let layout = ImageLayout::of_cloud(count, rows.points.len());
        let compute = |estimator| {
            progress.stage("bounces", rows.points.len() as u64);
            let plan = Plan { estimator, encoder: store.encoder(&layout), glossy: false, count };
            compute::compute(plan, &rows, progress)
        };
        match settings.multibounce {
            Multibounce::Iterated => compute(self.estimator(self.effort.bounce_rows)),
            Multibounce::Photon => {
                let source = self.photons();
                let photons = source.shoot(progress)?;
                let computed = compute(RowEstimator::Photons(&photons))?;
                Ok(Computed { rays: computed.rays + photons.rays(), ..computed })
            }
        }
    }

    fn photons(&self) -> PhotonSource<'_> {
        let Shot { accel, geometry, .. } = *self.shot;
        let Settings { photons: settings, seed, .. } = *self.shot.settings;
        PhotonSource { accel, geometry, map: self.map, cloud: self.cloud, settings, seed }
    }

    /// Also returns the receivers to which the rows belong.
    fn final_gather(
        &self,
        receivers: &Receivers,
        prior: Option<LightPrior>,
        progress: &dyn Progress,
    ) -> Result<(Computed, Vec<u32>)> {
        let (settings, count) = (self.shot.settings, self.patches.len());
        let (width, height) = settings.size;
        let length = receiver_block(width * height / settings.sharing);
        let encoding = self.effort.gather_encoding.of_blocks(length);
        let mut store = Store::new(settings, encoding, prior, settings.coefficients, count);
        let rows = blocks::of_receivers(&receivers.points, length, settings.seed, progress)?;
        let layout = ImageLayout::of_receivers(width, receivers, &rows.owners);
        let estimator = self.estimator(self.effort.gather_rows_of(length));
        if let Some(error) = settings.error {
            let plan = Plan { estimator, encoder: store.encoder(&layout), glossy: false, count };
            let price = budget::price_for(plan, &rows, f64::from(error), progress)?;
            store.multiply_price(price);
        }
        progress.stage("final gather", rows.points.len() as u64);
        let plan = Plan { estimator, encoder: store.encoder(&layout), glossy: settings.glossy, count };
        Ok((compute::compute(plan, &rows, progress)?, rows.owners))
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

    /// Where bytes have a price.
    fn multiply_price(&mut self, by: f32) {
        if let Self::LowRank { settings, .. } = self {
            settings.price *= by;
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
