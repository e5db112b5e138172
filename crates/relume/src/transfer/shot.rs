//! The stages of a preparation: samples, what is learned of light, and the operators.

use glam::{Vec2, Vec3};

use super::block_file::{Part, Shard};
use super::blocks::{self, Blocks};
use super::budget;
use super::compute::{self, Computed, Encoder, Finished, Haar, Plan, RowEstimator};
use super::effort::{Effort, bounce_block, receiver_block};
use super::form_factors::Patches;
use super::gathering::Gathering;
use super::low_rank::LowRankSettings;
use super::memory::Memory;
use super::outlook::Outlook;
use super::paper_rows::{ClusterBounds, PaperRows};
use super::photons::PhotonSource;
use super::prior::LightPrior;
use super::rows::{RowSettings, RowSource};
use super::training::Training;
use super::{Encoding, ImageLayout, Multibounce, Operator, RowMethod, Selection, Settings};
use crate::Result;
use crate::progress::Progress;
use crate::sample::{
    CellMap, CloudSettings, GatherCloud, GatherSample, Gloss, QUAD, Receiver, Receivers, ViewHits,
    ViewSamples, places_in,
};
use crate::scene::{Camera, Geometry, Scene};
use crate::trace::{Accel, Hit};

/// Lights of other kinds than are learned from, by which encodings are judged as well.
const OTHER_LIGHTS: usize = 24;
/// Opening threshold of the paper's cluster cut, squared size over squared distance.
const PAPER_THRESHOLD: f32 = 0.01;
/// Pixels that a record counts as where lengths of blocks are chosen.
const RECORD_STANDS_FOR: usize = 4;
/// Sets random numbers of the bounces apart from those of the final gather.
const BOUNCE_SEED: u32 = 0x5bd1_e995;
/// Coefficients a row of the paper's multi-bounce matrix, as a share of the final gather's: 40 of 100.
const PAPER_BOUNCE_SHARE: f64 = 0.4;
/// How many times as much as the final gather the bounces may lose, which reach the picture by way of it alone.
const BOUNCES_LOSE: f32 = 3.0;

/// What all stages read.
pub(super) struct Shot<'a> {
    pub(super) scene: &'a Scene,
    pub(super) geometry: &'a Geometry,
    pub(super) accel: &'a Accel,
    pub(super) settings: &'a Settings,
    /// Blocks that need not be computed.
    pub(super) finished: Finished<'a>,
    pub(super) memory: Memory,
}

impl Shot<'_> {
    pub(super) fn samples(
        &self,
        camera: &Camera,
        view: &ViewSamples,
        hits: &ViewHits,
        progress: &dyn Progress,
    ) -> Result<(Receivers, GatherCloud, CellMap)> {
        let (width, height) = self.settings.size;
        let mut receivers = Receivers::new(view, camera, self.settings.glossy);
        if self.settings.gather_spacing().is_some() {
            receivers.put_in_order(progress)?;
        }
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
        let Settings { gather: count, cloud: method, sky, seed, .. } = *self.settings;
        let rays = self.settings.quality.effort().sight_rays;
        let settings = CloudSettings { count, method, sky, rays, seed };
        let (cloud, map) =
            GatherCloud::new(self.scene, self.geometry, self.accel, &seen, &settings, progress)?;
        Ok((receivers, cloud, map))
    }

    /// The final gather, the bounces, and the row of each receiver, where each has one.
    pub(super) fn operators(
        &self,
        receivers: &Receivers,
        cloud: &GatherCloud,
        map: &CellMap,
        progress: &dyn Progress,
    ) -> Result<(Computed, Computed, Option<Vec<u32>>)> {
        let (patches, bounds) = (Patches::new(cloud, map), ClusterBounds::new(cloud));
        let rows = self.rows(cloud, map, (&patches, &bounds));
        let learned = self.learn((cloud, map), rows.effort.training_lights, progress)?;
        let prior = self.prior(cloud, &learned, None, progress)?;
        let bounce = rows.all_bounces(prior, progress)?;
        let prior = self.prior(cloud, &learned, Some(&bounce.operator), progress)?;
        drop(learned);
        let (gather, numbers) =
            rows.final_gather(receivers, prior, progress, |plan, blocks, gathering| {
                progress.stage(Part::FinalGather.name(), blocks.points.len() as u64);
                let gather = compute::compute(plan, (Part::FinalGather, blocks), self.finished, progress)?;
                let interpolation = gathering.interpolation(&blocks.owners);
                let numbers = interpolation.is_none().then(|| places_in(&blocks.owners));
                Ok((gather.interpolated(interpolation), numbers))
            })?;
        Ok((gather, bounce, numbers))
    }

    /// The blocks of a shard, kept in the file. Returns how many there are.
    pub(super) fn share(
        &self,
        receivers: &Receivers,
        (cloud, map): (&GatherCloud, &CellMap),
        (shard, bounces_only): (Shard, bool),
        progress: &dyn Progress,
    ) -> Result<usize> {
        let (patches, bounds) = (Patches::new(cloud, map), ClusterBounds::new(cloud));
        let rows = self.rows(cloud, map, (&patches, &bounds));
        let learned = self.learn((cloud, map), rows.effort.training_lights, progress)?;
        let prior = self.prior(cloud, &learned, None, progress)?;
        let share = |part: Part| {
            move |plan: Plan<'_>, blocks: &Blocks| {
                compute::compute_share(plan, (part, blocks), self.finished, shard, progress)
            }
        };
        if bounces_only {
            return rows.bounces(prior, progress, |plan, (blocks, _), _| share(Part::Bounces)(plan, blocks));
        }
        let bounce = rows.all_bounces(prior, progress)?;
        let prior = self.prior(cloud, &learned, Some(&bounce.operator), progress)?;
        drop(learned);
        rows.final_gather(receivers, prior, progress, |plan, blocks, _| {
            share(Part::FinalGather)(plan, blocks)
        })
    }

    fn rows<'b>(
        &'b self,
        cloud: &'b GatherCloud,
        map: &'b CellMap,
        (patches, bounds): (&'b Patches, &'b ClusterBounds),
    ) -> Rows<'b> {
        Rows { shot: self, cloud, map, patches, bounds, effort: self.settings.quality.effort() }
    }

    /// Whether something is learned from random lights: what light is likely, or at least, which of it goes together.
    fn learns(&self) -> bool {
        self.settings.encoding == Encoding::LowRank || self.settings.selection() == Selection::Prior
    }

    /// Light on the cloud to learn from, where anything is learned, and what `low-rank` expects of it.
    fn learn(
        &self,
        (cloud, map): (&GatherCloud, &CellMap),
        count: usize,
        progress: &dyn Progress,
    ) -> Result<(Training, Outlook)> {
        if !self.learns() {
            return Ok(Default::default());
        }
        let seed = self.settings.seed;
        let changes: Vec<Vec3> =
            self.scene.materials.iter().map(|material| Vec3::ONE - material.base_color.truncate()).collect();
        // the photon form has the colours in it, and cannot be painted anew
        let paintable = self.settings.multibounce == Multibounce::Iterated;
        let painted = paintable.then(|| cloud.recolored(&changes)).flatten();
        let white = painted.as_ref().unwrap_or(cloud);
        let training = Training::new((cloud, white), self.accel, (count, OTHER_LIGHTS), seed, progress)?;
        let outlook = match self.settings.encoding {
            Encoding::LowRank => Outlook::new((white, map), self.accel, seed, progress)?,
            Encoding::HaarRows | Encoding::HaarBlocks => Outlook::default(),
        };
        Ok((training, outlook))
    }

    fn prior(
        &self,
        cloud: &GatherCloud,
        (lights, outlook): &(Training, Outlook),
        bounce: Option<&Operator>,
        progress: &dyn Progress,
    ) -> Result<Option<LightPrior>> {
        if !self.learns() {
            return Ok(None);
        }
        let times = self.settings.multibounce.times_to_learn();
        let bounce = bounce.map(|operator| (operator, times));
        progress.stage("light prior", (lights.alike.len() + lights.others.len()) as u64);
        LightPrior::new(cloud, (lights, outlook), self.settings, bounce, progress).map(Some)
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

    /// The whole operator of the bounces.
    fn all_bounces(&self, prior: Option<LightPrior>, progress: &dyn Progress) -> Result<Computed> {
        self.bounces(prior, progress, |plan, (blocks, gathering), rays| {
            progress.stage(Part::Bounces.name(), blocks.points.len() as u64);
            let finished = self.shot.finished;
            let computed = compute::compute(plan, (Part::Bounces, blocks), finished, progress)?;
            let computed = Computed { rays: computed.rays + rays, ..computed };
            Ok(computed.interpolated(gathering.interpolation(&blocks.owners)))
        })
    }

    /// What `work` makes of the blocks of the bounces, being told of rays that were traced for them before.
    fn bounces<T>(
        &self,
        prior: Option<LightPrior>,
        progress: &dyn Progress,
        work: impl FnOnce(Plan<'_>, (&Blocks, &Gathering<'_>), u64) -> Result<T>,
    ) -> Result<T> {
        let (settings, count, memory) = (self.shot.settings, self.patches.len(), self.shot.memory);
        let per_row = (settings.coefficients as f64 * PAPER_BOUNCE_SHARE).ceil() as usize;
        let gathering = self.of_cloud(progress)?;
        let length = bounce_block(gathering.records());
        let mut store =
            Store::new(settings, self.effort.bounce_encoding.of_blocks(length), prior, per_row, count);
        let (points, served) = gathering.rows();
        let (rows, layout) = if gathering.is_whole() {
            let rows = blocks::of_cloud(self.cloud, length, settings.seed);
            let layout = ImageLayout::of_cloud(count, rows.points.len());
            (rows, layout)
        } else {
            let seed = settings.seed ^ BOUNCE_SEED;
            let rows = blocks::of_receivers(&points, &served, length, seed, progress)?;
            (rows, ImageLayout::of_records(settings.size.0, points.len()))
        };
        let finish = |estimator, rays| {
            self.meet_budget(BOUNCES_LOSE, &mut store, (estimator, &layout, &rows), progress)?;
            let plan = Plan { estimator, encoder: store.encoder(&layout), glossy: false, count, memory };
            work(plan, (&rows, &gathering), rays)
        };
        match settings.multibounce {
            Multibounce::Iterated => finish(self.estimator(self.effort.bounce_rows), 0),
            Multibounce::Photon => {
                let source = self.photons();
                let photons = source.shoot(progress)?;
                finish(RowEstimator::Photons(&photons), photons.rays())
            }
        }
    }

    /// Where so much may be lost, and no more, `store` asks for the price of a byte at which `rows` lose `times` as much. Where no block is to be made no price is
    /// wanted.
    fn meet_budget(
        &self,
        times: f32,
        store: &mut Store,
        (estimator, layout, rows): (RowEstimator<'_>, &ImageLayout, &Blocks),
        progress: &dyn Progress,
    ) -> Result<()> {
        let finished = self.shot.finished.complete;
        if let Some(error) = self.shot.settings.error.filter(|_| !finished) {
            let (count, memory) = (self.patches.len(), self.shot.memory);
            let plan = Plan { estimator, encoder: store.encoder(layout), glossy: false, count, memory };
            let price = budget::price_for(plan, rows, f64::from(times * error), progress)?;
            store.multiply_price(price);
        }
        Ok(())
    }

    /// The points to which light bounces. Photons are counted at each gather sample.
    fn of_cloud(&self, progress: &dyn Progress) -> Result<Gathering<'_>> {
        let settings = self.shot.settings;
        let point = |sample: &GatherSample| Receiver {
            position: sample.position,
            shading_normal: sample.normal,
            geometric_normal: sample.normal,
            pixel: 0.0,
            gloss: Gloss::default(),
        };
        let points: Vec<Receiver> = self.cloud.surfaces().iter().map(point).collect();
        let spacing = settings.bounce_spacing().filter(|_| settings.multibounce == Multibounce::Iterated);
        Gathering::new(points, self.shot.accel, spacing, settings.seed ^ BOUNCE_SEED, progress)
    }

    fn photons(&self) -> PhotonSource<'_> {
        let Shot { accel, geometry, .. } = *self.shot;
        let Settings { photons: settings, seed, .. } = *self.shot.settings;
        PhotonSource { accel, geometry, map: self.map, cloud: self.cloud, settings, seed }
    }

    /// What `work` makes of the blocks of the final gather.
    fn final_gather<T>(
        &self,
        receivers: &Receivers,
        prior: Option<LightPrior>,
        progress: &dyn Progress,
        work: impl FnOnce(Plan<'_>, &Blocks, &Gathering<'_>) -> Result<T>,
    ) -> Result<T> {
        let (settings, count, memory) = (self.shot.settings, self.patches.len(), self.shot.memory);
        let (accel, spacing) = (self.shot.accel, settings.gather_spacing());
        let gathering = Gathering::new(&receivers.points, accel, spacing, settings.seed, progress)?;
        let (points, served) = gathering.rows();
        // records stand for receivers around them
        let length = if gathering.is_whole() {
            receiver_block(settings.size.0 * settings.size.1)
        } else {
            receiver_block(RECORD_STANDS_FOR * points.len())
        };
        let encoding = self.effort.gather_encoding.of_blocks(length);
        let mut store = Store::new(settings, encoding, prior, settings.coefficients, count);
        let rows = blocks::of_receivers(&points, &served, length, settings.seed, progress)?;
        let layout = if gathering.is_whole() {
            ImageLayout::of_receivers(settings.size.0, receivers, &rows.owners)
        } else {
            ImageLayout::of_records(settings.size.0, points.len())
        };
        let estimator = self.estimator(self.effort.gather_rows_of(length));
        self.meet_budget(1.0, &mut store, (estimator, &layout, &rows), progress)?;
        let plan =
            Plan { estimator, encoder: store.encoder(&layout), glossy: settings.glossy, count, memory };
        work(plan, &rows, &gathering)
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
