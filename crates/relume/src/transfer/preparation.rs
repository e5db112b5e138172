//! From a scene to a transfer.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use glam::Vec3;
use xxhash_rust::xxh3::Xxh3;

use super::block_file::{BlockFile, BlocksOf, Shard};
use super::compute::Finished;
use super::haar_rows::HaarRows;
use super::memory::Memory;
use super::needs::{Needs, scene_bytes};
use super::shot::Shot;
use super::{
    Buffer, EncodingError, Matrix, Occluders, Operator, Quality, Report, Settings, Timings, Transfer,
    gathering_pixels,
};
use crate::progress::Progress;
use crate::sample::{GatherCloud, Receivers, ViewHits, ViewSamples};
use crate::scene::{Camera, Geometry, Scene};
use crate::trace::Accel;
use crate::{Error, Result};

/// A preparation that is about to run: the scene and how to prepare it.
#[derive(Clone, Debug)]
pub struct Preparation<'a> {
    scene: &'a Scene,
    name: String,
    settings: Settings,
    own_blocks: Option<PathBuf>,
    finished_blocks: Vec<PathBuf>,
    memory_limit: Option<u64>,
    direct_first: bool,
}

impl<'a> Preparation<'a> {
    /// Prepares `scene` with the default settings, unless told otherwise.
    pub fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            name: String::new(),
            settings: Settings::default(),
            own_blocks: None,
            finished_blocks: Vec::new(),
            memory_limit: None,
            direct_first: false,
        }
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

    /// Keeps finished blocks in this file, and begins with those that it holds of the same preparation already, left by one that was interrupted:
    /// the transfer is the same, bit for bit. Who has saved the transfer may remove the file.
    #[must_use]
    pub fn checkpoint(mut self, path: impl Into<PathBuf>) -> Self {
        self.own_blocks = Some(path.into());
        self
    }

    /// Takes blocks also from these files, which other runs of the same preparation have left.
    #[must_use]
    pub fn finished_blocks(mut self, paths: impl IntoIterator<Item = PathBuf>) -> Self {
        self.finished_blocks.extend(paths);
        self
    }

    /// How many bytes of memory the process may take, all that it holds already included. Fewer blocks of rows are then made at once than there are
    /// threads, where all have no room; where not even one has, the preparation is refused, as early as it can be told. The result does not depend on it.
    /// Memory that others take of the process meanwhile may be in the way. Where the system does not tell how much is in use, sizes are counted.
    #[must_use]
    pub fn memory_limit(mut self, bytes: u64) -> Self {
        self.memory_limit = Some(bytes);
        self
    }

    /// Puts a step before the steps of [`Self::run_in_steps`]: a transfer of direct light alone ([`Transfer::is_direct_only`]), as soon as it is known
    /// what the camera sees.
    #[must_use]
    pub fn direct_first(mut self) -> Self {
        self.direct_first = true;
        self
    }

    /// Whether `transfer` is what this preparation would make: of the same scene, as it is now, by the same settings.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, and scenes with nothing to relight.
    pub fn would_make(&self, transfer: &Transfer) -> Result<bool> {
        let camera = self.settings.check(self.scene)?;
        let Report { settings, scene_hash: hash, .. } = &transfer.report;
        let same = !transfer.is_direct_only() && *settings == self.settings;
        Ok(same && *hash == scene_hash(self.scene, &Geometry::new(self.scene), camera))
    }

    /// Does it, on the current rayon thread pool. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, scenes with nothing to relight, and too little memory; [`Error::Cancelled`].
    pub fn run(self, progress: &dyn Progress) -> Result<Transfer> {
        self.run_with(false, progress)
    }

    /// Puts the blocks of all shards together, computing none: what [`Self::run`] returns, bit for bit.
    ///
    /// # Errors
    /// As of [`Self::run`]; [`Error::Setting`] where a block is in none of the files.
    pub fn merge(self, progress: &dyn Progress) -> Result<Transfer> {
        self.run_with(true, progress)
    }

    fn run_with(self, complete: bool, progress: &dyn Progress) -> Result<Transfer> {
        let camera = self.settings.check(self.scene)?;
        self.memory(&self.settings, complete)?;
        let stages = Stages::new(progress);
        let looked = Looked::new(self.scene, camera, self.settings.size, &stages)?;
        let files = self.files(&looked, None, progress)?;
        self.transfer(&self.settings, looked, files.finished(complete), stages)
    }

    /// Computes the blocks of one shard and keeps them in the file of [`Self::checkpoint`]: [`Self::merge`] makes one transfer of all shards'. The
    /// bounces, which the final gather needs to know, are computed by each shard but for those that are there; with `bounces_only` each computes
    /// its own and leaves it at that. Returns how many blocks are the shard's.
    ///
    /// # Errors
    /// As of [`Self::run`]; [`Error::Setting`] for a shard that is none, and without a file.
    pub fn run_shard(self, shard: Shard, bounces_only: bool, progress: &dyn Progress) -> Result<usize> {
        let camera = self.settings.check(self.scene)?;
        if !(1..=shard.of).contains(&shard.number) {
            return Err(Error::Setting(format!(
                "shard {} of {}: shards are numbered from 1",
                shard.number, shard.of
            )));
        }
        if self.own_blocks.is_none() {
            return Err(Error::Setting("a shard needs a file to keep its blocks in".to_owned()));
        }
        let (memory, needs) = self.memory(&self.settings, false)?;
        let looked = Looked::new(self.scene, camera, self.settings.size, progress)?;
        memory.with(needs.looked).check(needs.after_looking)?;
        let files = self.files(&looked, Some(shard), progress)?;
        if let Some(own) = &files.own {
            own.begin()?;
        }
        let (geometry, accel) = looked.opaque();
        let (settings, finished) = (&self.settings, files.finished(false));
        let memory = memory.with(needs.looked);
        let beside = memory.with(needs.beside_blocks);
        let shot = Shot { scene: self.scene, geometry, accel, settings, finished, memory: beside };
        let (receivers, cloud, map) = shot.samples(camera, &looked.view, &looked.hits, progress)?;
        memory.check(needs.after_cloud)?;
        shot.share(&receivers, (&cloud, &map), (shard, bounces_only), progress)
    }

    /// What memory there is, and what is needed of it, before anything is done; `complete` where no block is to be made.
    ///
    /// # Errors
    /// [`Error::Setting`] where it is too little.
    fn memory(&self, settings: &Settings, complete: bool) -> Result<(Memory, Needs)> {
        let memory = Memory::new(self.memory_limit).with(scene_bytes(self.scene));
        let needs = Needs::new(settings, self.scene, !complete);
        memory.check(needs.looked + needs.after_looking)?;
        Ok((memory, needs))
    }

    /// Opens the files of finished blocks.
    fn files(&self, looked: &Looked<'_>, shard: Option<Shard>, progress: &dyn Progress) -> Result<Files> {
        if self.own_blocks.is_none() && self.finished_blocks.is_empty() {
            return Ok(Files::default());
        }
        let hash = scene_hash(self.scene, &looked.geometry, looked.camera);
        let of = BlocksOf::new(self.settings.clone(), hash);
        let own = self.own_blocks.as_ref().map(|path| BlockFile::resume(path, &of, shard)).transpose()?;
        if let Some(own) = own.as_ref().filter(|own| own.len() > 0) {
            progress.notice(&format!("{}: finished blocks are there: {}", own.path().display(), own.len()));
        }
        if own.as_ref().is_some_and(BlockFile::replaces) {
            let path = self.own_blocks.as_deref().unwrap_or_else(|| Path::new(""));
            progress.notice(&format!("{} holds blocks of other work, which are replaced", path.display()));
        }
        let mut others = Vec::new();
        for path in &self.finished_blocks {
            match BlockFile::open(path, &of) {
                Ok(file) => others.push(file),
                // what lies beside a shard is taken where it fits: it may be old, or just about to be written
                Err(error) if shard.is_some() => progress.notice(&format!("left aside: {error}")),
                Err(error) => return Err(error),
            }
        }
        for cut in others.iter().filter(|file| file.is_cut()) {
            progress.notice(&format!(
                "{} was cut off, or is being written: its whole blocks are taken",
                cut.path().display()
            ));
        }
        Ok(Files { own, others })
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
        self.memory(&self.settings, false)?;
        let stages = Stages::new(progress);
        let looked = Looked::new(self.scene, camera, self.settings.size, &stages)?;
        if self.direct_first {
            show(self.direct_alone(&looked, stages.clone()))?;
        }
        let files = self.files(&looked, None, progress)?;
        stages.rest();
        for settings in self.settings.coarser() {
            show(self.transfer(&settings, looked.clone(), Finished::default(), stages.clone())?)?;
        }
        self.transfer(&self.settings, looked, files.finished(false), stages)
    }

    fn transfer(
        &self,
        settings: &Settings,
        mut looked: Looked<'_>,
        finished: Finished<'_>,
        stages: Stages<'_>,
    ) -> Result<Transfer> {
        let hits = std::mem::take(&mut looked.hits);
        let (opaque, accel) = looked.opaque();
        let needs = Needs::new(settings, self.scene, !finished.complete);
        let memory = Memory::new(self.memory_limit).with(scene_bytes(self.scene) + needs.looked);
        memory.check(needs.after_looking)?;
        let beside = memory.with(needs.beside_blocks);
        let shot = Shot { scene: self.scene, geometry: opaque, accel, settings, finished, memory: beside };
        let Looked { camera, view, .. } = &looked;
        let (receivers, cloud, map) = shot.samples(camera, view, &hits, &stages)?;
        drop(hits);
        memory.check(needs.after_cloud)?;
        let (gather, bounce, numbers) = shot.operators(&receivers, &cloud, &map, &stages)?;
        let of_centers = [&receivers.of_centers[..], &receivers.of_center_branches[..]];
        let lit = gathering_pixels(view, of_centers).max(1) as f64;
        let known_as = |receivers: &[u32]| renumbered(receivers, numbers.as_deref());
        let report = Report {
            rays_per_pixel: gather.rays as f64 / lit,
            rays_per_gather_sample: bounce.rays as f64 / cloud.surfaces().len() as f64,
            gather_error: gather.operator.expected_error,
            glossy_error: gather.glossy.as_ref().map(|glossy| glossy.expected_error),
            bounce_error: bounce.operator.expected_error,
            ..self.report(settings, &looked)
        };
        let occluders = looked.occluders();
        Ok(Transfer {
            report,
            timings: stages.finish(),
            view: looked.view,
            cloud,
            gather: gather.operator,
            glossy: gather.glossy,
            bounce: bounce.operator,
            receivers_of_centers: known_as(&receivers.of_centers),
            receivers_of_quads: known_as(&receivers.of_quads),
            receivers_of_center_branches: known_as(&receivers.of_center_branches),
            receivers_of_quad_branches: known_as(&receivers.of_quad_branches),
            occluders,
        })
    }
}

impl Preparation<'_> {
    /// What is to tell of a transfer before there is anything of it.
    fn report(&self, settings: &Settings, looked: &Looked<'_>) -> Report {
        let materials = &self.scene.materials;
        Report {
            settings: settings.clone(),
            scene: self.name.clone(),
            materials: materials.iter().map(|material| material.name.clone()).collect(),
            base_colors: materials.iter().map(|material| material.base_color.truncate().to_array()).collect(),
            emissive: (0..)
                .zip(materials)
                .filter(|(_, material)| material.emission != Vec3::ZERO)
                .map(|(number, _)| number)
                .collect(),
            scene_hash: scene_hash(self.scene, &looked.geometry, looked.camera),
            triangles: looked.geometry.triangles.len() as u64,
            ..Report::default()
        }
    }

    /// What can be shown of a scene by looking at it.
    fn direct_alone(&self, looked: &Looked<'_>, stages: Stages<'_>) -> Transfer {
        let view = looked.view.clone();
        let from_none = |samples: usize| Buffer::from(vec![Receivers::NONE; samples]);
        let none = || {
            let matrix = Matrix::HaarRows(HaarRows::default());
            Operator::new(0, matrix, Default::default(), EncodingError::default())
        };
        Transfer {
            report: self.report(&self.settings, looked),
            timings: stages.finish(),
            cloud: GatherCloud::default(),
            gather: none(),
            glossy: None,
            bounce: none(),
            receivers_of_centers: from_none(view.centers.len()),
            receivers_of_quads: from_none(view.quads.len()),
            receivers_of_center_branches: from_none(view.center_chains.branches.len()),
            receivers_of_quad_branches: from_none(view.quad_chains.branches.len()),
            occluders: looked.occluders(),
            view,
        }
    }
}

/// A scene as rays meet it, and what the camera sees of it: the same for all steps of a preparation.
#[derive(Clone)]
struct Looked<'a> {
    camera: &'a Camera,
    geometry: Arc<Geometry>,
    all: Arc<Accel>,
    /// Without clear surfaces, where there are any: what light meets.
    opaque: Option<(Arc<Accel>, Arc<Geometry>)>,
    view: ViewSamples,
    hits: ViewHits,
}

impl<'a> Looked<'a> {
    fn new(scene: &Scene, camera: &'a Camera, size: (usize, usize), progress: &dyn Progress) -> Result<Self> {
        let geometry = Geometry::new(scene);
        progress.stage("acceleration structure", 1);
        let all = Accel::new(scene, &geometry);
        let opaque =
            geometry.without_clear().map(|geometry| (Accel::new(scene, &geometry).into(), geometry.into()));
        let (view, hits) = ViewSamples::new(scene, &geometry, &all, camera, size, progress)?;
        Ok(Self { camera, geometry: geometry.into(), all: all.into(), opaque, view, hits })
    }

    /// The surfaces that light meets, and how rays meet them.
    fn opaque(&self) -> (&Arc<Geometry>, &Arc<Accel>) {
        match &self.opaque {
            Some((accel, geometry)) => (geometry, accel),
            None => (&self.geometry, &self.all),
        }
    }

    fn occluders(&self) -> Occluders {
        let (geometry, accel) = self.opaque();
        Occluders::of(geometry, Arc::clone(accel))
    }
}

/// Opened files of finished blocks.
#[derive(Default)]
struct Files {
    own: Option<BlockFile>,
    others: Vec<BlockFile>,
}

impl Files {
    fn finished(&self, complete: bool) -> Finished<'_> {
        Finished { own: self.own.as_ref(), others: &self.others, complete }
    }
}

/// Passes progress on and notes how long each stage took.
struct Stages<'a> {
    progress: &'a dyn Progress,
    times: Mutex<Times>,
}

#[derive(Clone, Default)]
struct Times {
    /// Of stages that are over, seconds.
    over: Vec<(String, f64)>,
    /// The stage at work, and when it began.
    at_work: Option<(String, Instant)>,
}

impl Clone for Stages<'_> {
    fn clone(&self) -> Self {
        Self { progress: self.progress, times: Mutex::new(self.times().clone()) }
    }
}

impl<'a> Stages<'a> {
    fn new(progress: &'a dyn Progress) -> Self {
        let at_work = Some(("triangles".to_owned(), Instant::now()));
        Self { progress, times: Mutex::new(Times { at_work, ..Times::default() }) }
    }

    fn times(&self) -> MutexGuard<'_, Times> {
        self.times.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the stage at work.
    fn rest(&self) {
        let Times { over, at_work } = &mut *self.times();
        over.extend(at_work.take().map(|(name, began)| (name, began.elapsed().as_secs_f64())));
    }

    fn finish(&self) -> Timings {
        self.rest();
        let stages = self.times().over.clone();
        Timings { seconds: stages.iter().map(|(_, seconds)| seconds).sum(), stages }
    }
}

impl Progress for Stages<'_> {
    fn stage(&self, name: &str, steps: u64) {
        self.rest();
        self.times().at_work = Some((name.to_owned(), Instant::now()));
        self.progress.stage(name, steps);
    }

    fn advance(&self, steps: u64) {
        self.progress.advance(steps);
    }

    fn notice(&self, text: &str) {
        self.progress.notice(text);
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
}

/// Receivers by other numbers, if there are any.
fn renumbered(receivers: &[u32], numbers: Option<&[u32]>) -> Buffer<u32> {
    let number = |&receiver: &u32| match receiver {
        Receivers::NONE => Receivers::NONE,
        receiver => numbers.map_or(receiver, |numbers| numbers[receiver as usize]),
    };
    receivers.iter().map(number).collect::<Vec<_>>().into()
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
