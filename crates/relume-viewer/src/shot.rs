//! What is open: a scene that is prepared while it is lit, or a cache.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use relume::transfer::{Preparing, Settings, Status};
use relume::{Error, Preparation, Result, Scene, Transfer};
use relume_io::load_scene;

/// Endings of scenes; any other file is taken for a cache.
const SCENES: [&str; 3] = ["glb", "gltf", "obj"];
/// How often a preparation is asked whether a finer transfer is there.
const ASKED_EVERY: Duration = Duration::from_millis(20);
/// Ending of files of finished blocks, as the command line has it.
const BLOCKS: &str = "relume-blocks";

/// What to open.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// A scene (`.glb`, `.gltf`, `.obj`) or a cache.
    pub path: PathBuf,
    /// The camera of the scene, by name or number; `None` for the first.
    pub camera: Option<String>,
    /// Where the transfer of a scene is kept. `None` for the scene's name with the ending `.relume`, beside it; or, where that is of other settings or no cache
    /// at all, `.view.relume`.
    pub cache: Option<PathBuf>,
    /// Threads to prepare on; 0 stands for one a processor.
    pub threads: usize,
    /// How a scene is prepared; its `camera` is that of [`Self::camera`].
    pub settings: Settings,
}

impl Source {
    /// A file, with default settings.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), camera: None, cache: None, threads: 0, settings: Settings::default() }
    }

    /// Whether it is a scene, by its ending.
    pub fn is_scene(&self) -> bool {
        let ending = self.path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        ending.is_some_and(|ending| SCENES.contains(&&*ending))
    }

    /// The files that the transfer may be in, those that may be replaced by another one last.
    fn caches(&self) -> Vec<PathBuf> {
        match &self.cache {
            Some(cache) => vec![cache.clone()],
            None => ["relume", "view.relume"].map(|ending| self.path.with_extension(ending)).into(),
        }
    }
}

/// What happens while a shot is opened and prepared.
pub(crate) enum Event {
    /// The scene is read.
    Scene(Arc<Scene>, Vec<String>),
    /// A transfer is there, finer than the one before.
    Transfer(Arc<Transfer>),
    /// The last one is there, and in the cache.
    Ready(Option<PathBuf>),
    /// Something to know.
    Notice(String),
    /// It ends here.
    Failed(Error),
}

/// How far the opening is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Stage {
    /// A file is being read.
    Reading,
    /// The transfer is being prepared.
    Preparing(Work),
    /// The cache is being written.
    Saving,
    /// Nothing is left to do.
    Ready,
    /// It was cancelled, or has failed: what is there can be lit.
    Stopped,
}

/// A preparation at work.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Work {
    /// The stage at work.
    pub(crate) status: Status,
    /// How long the preparation has been at it, all stages told.
    pub(crate) for_so_long: Duration,
    /// How much longer the stage will take, as far as it has shown.
    pub(crate) left: Option<Duration>,
}

/// When the preparation began, and the stage that it was seen at last.
struct Clock {
    began: Instant,
    read: Instant,
    stage: (String, Instant),
}

impl Clock {
    fn new() -> Self {
        let now = Instant::now();
        Self { began: now, read: now, stage: (String::new(), now) }
    }

    fn read(&mut self, status: Status) -> Work {
        let now = Instant::now();
        if self.stage.0 != status.stage {
            self.stage = (status.stage.clone(), now);
        }
        // at rest, time stands still
        let passed = now - std::mem::replace(&mut self.read, now);
        if status.paused {
            self.began += passed;
            self.stage.1 += passed;
        }
        let share = status.done as f64 / status.of.max(1) as f64;
        let spent = now - self.stage.1.min(now);
        // the first steps tell little
        let left = (share > 0.02 && spent > Duration::from_secs(1))
            .then(|| spent.mul_f64((1.0 - share.min(1.0)) / share));
        Work { status, for_so_long: now - self.began.min(now), left }
    }
}

/// An open shot, for as long as this lives.
pub(crate) struct Shot {
    source: Source,
    events: Receiver<Event>,
    shared: Arc<Shared>,
}

struct Shared {
    stage: Mutex<Stage>,
    clock: Mutex<Option<Clock>>,
    preparing: Mutex<Option<Preparing>>,
    /// Whether whoever is at the window has paused it.
    paused: AtomicBool,
    /// Whether it rests for as long as something is dragged.
    resting: AtomicBool,
    cancelled: AtomicBool,
}

/// What a panicking thread held is still whole: every change is a single assignment.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shot {
    /// Begins to open a shot; `wake` is called whenever there is something to [`Self::next`].
    pub(crate) fn open(source: Source, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (sender, events) = channel();
        let shared = Arc::new(Shared {
            stage: Mutex::new(Stage::Reading),
            clock: Mutex::new(None),
            preparing: Mutex::new(None),
            paused: AtomicBool::new(false),
            resting: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
        });
        let opening = Opening {
            source: source.clone(),
            shared: Arc::clone(&shared),
            events: sender,
            wake: Box::new(wake),
        };
        std::thread::Builder::new().name("opening".to_owned()).spawn(move || opening.run())?;
        Ok(Self { source, events, shared })
    }

    pub(crate) fn source(&self) -> &Source {
        &self.source
    }

    pub(crate) fn next(&self) -> Option<Event> {
        match self.events.try_recv() {
            Ok(event) => Some(event),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => self.abandoned(),
        }
    }

    /// What there is to tell, once, of an opening that has come to an end which nothing here foresees.
    fn abandoned(&self) -> Option<Event> {
        let mut stage = lock(&self.shared.stage);
        if matches!(*stage, Stage::Ready | Stage::Stopped) {
            return None;
        }
        *stage = Stage::Stopped;
        let text = "the preparation has failed; open the shot again, and it goes on from what is done";
        Some(Event::Failed(Error::Setting(text.to_owned())))
    }

    pub(crate) fn stage(&self) -> Stage {
        let stage = lock(&self.shared.stage).clone();
        let Stage::Preparing(before) = stage else { return stage };
        let status = lock(&self.shared.preparing).as_ref().map(Preparing::status);
        Stage::Preparing(match (status, &mut *lock(&self.shared.clock)) {
            (Some(status), Some(clock)) => clock.read(status),
            _ => before,
        })
    }

    /// Whether whoever is at the window has paused the preparation.
    pub(crate) fn is_paused(&self) -> bool {
        self.shared.paused.load(Ordering::Relaxed)
    }

    /// Pauses the preparation, or lets it go on.
    pub(crate) fn pause(&self, paused: bool) {
        self.shared.paused.store(paused, Ordering::Relaxed);
        self.shared.rest();
    }

    /// Lets the preparation rest while something is dragged: the processor is wanted for frames.
    pub(crate) fn rest(&self, resting: bool) {
        if self.shared.resting.swap(resting, Ordering::Relaxed) != resting {
            self.shared.rest();
        }
    }

    /// Waits while the cache is being written.
    pub(crate) fn finish_saving(&self) {
        while self.stage() == Stage::Saving {
            std::thread::sleep(ASKED_EVERY);
        }
    }

    /// Ends the preparation. What is there stays, and finished blocks are kept for the next time.
    pub(crate) fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
        if let Some(preparing) = &*lock(&self.shared.preparing) {
            preparing.cancel();
        }
    }
}

impl Drop for Shot {
    fn drop(&mut self) {
        self.cancel();
    }
}

impl Shared {
    fn rest(&self) {
        if let Some(preparing) = &*lock(&self.preparing) {
            preparing.pause(self.paused.load(Ordering::Relaxed) || self.resting.load(Ordering::Relaxed));
        }
    }

    fn set(&self, stage: Stage) {
        *lock(&self.stage) = stage;
    }
}

struct Opening {
    source: Source,
    shared: Arc<Shared>,
    events: Sender<Event>,
    wake: Box<dyn Fn() + Send>,
}

impl Opening {
    fn tell(&self, event: Event) {
        // a window that has closed need not be told
        let _ = self.events.send(event);
        (self.wake)();
    }

    fn run(self) {
        let stage = match self.opened() {
            Ok(kept) => {
                self.shared.set(Stage::Ready);
                return self.tell(Event::Ready(kept));
            }
            Err(Error::Cancelled) => Event::Notice("The preparation was ended".to_owned()),
            Err(error) => Event::Failed(error),
        };
        self.shared.set(Stage::Stopped);
        self.tell(stage);
    }

    /// Everything up to the last transfer; returns where that was written, if it was.
    fn opened(&self) -> Result<Option<PathBuf>> {
        let path = &self.source.path;
        if !self.source.is_scene() {
            self.tell(Event::Transfer(Arc::new(Transfer::load(path)?)));
            return Ok(None);
        }
        // before the scene is read, so that the next opening is instant; of a named camera the scene has to tell the number
        let early = match &self.source.camera {
            None => Some(self.known(self.source.settings.camera)?),
            Some(_) => None,
        };
        if let Some((_, Some(known))) = &early {
            self.tell(Event::Transfer(Arc::clone(known)));
        }
        let imported = load_scene(path)?;
        let scene = Arc::new(imported.scene);
        self.tell(Event::Scene(Arc::clone(&scene), imported.warnings));
        let camera = match &self.source.camera {
            Some(camera) => scene.find_camera(Some(camera)).map_err(|message| Error::file(path, message))?,
            None => self.source.settings.camera,
        };
        let settings = Settings { camera, ..self.source.settings.clone() };
        let (cache, known) = early.map_or_else(|| self.known(camera), Ok)?;
        if let Some(known) = known {
            if preparation(&scene, path, &settings).would_make(&known)? {
                if self.source.camera.is_some() {
                    self.tell(Event::Transfer(known));
                }
                return Ok(None);
            }
            self.tell(Event::Notice(format!(
                "{} has changed since it was prepared, and is prepared again",
                path.display()
            )));
        }
        self.prepare(scene, settings, &cache).map(Some)
    }

    /// Where the transfer is kept, and what lies there already that was made by the same settings. What was made by others is left alone.
    ///
    /// # Errors
    /// [`Error::File`] where the file that was asked for is something else.
    fn known(&self, camera: usize) -> Result<(PathBuf, Option<Arc<Transfer>>)> {
        let wanted = Settings { camera, ..self.source.settings.clone() };
        let mut left_alone = None;
        for cache in self.source.caches() {
            if !cache.exists() {
                return Ok((cache, None));
            }
            let why = match Transfer::load(&cache) {
                Ok(transfer) => {
                    if transfer.report.settings == wanted {
                        return Ok((cache, Some(Arc::new(transfer))));
                    }
                    "was prepared with other settings, or for another camera".to_owned()
                }
                Err(error) => format!("cannot be used ({error})"),
            };
            left_alone = Some((cache, why));
        }
        // the last of them is this window's own, unless it was named
        let (cache, why) = left_alone.unwrap_or_default();
        if self.source.cache.is_some() {
            return Err(Error::file(cache, format!("{why}; name another cache, or remove this one")));
        }
        Ok((cache, None))
    }

    fn prepare(&self, scene: Arc<Scene>, settings: Settings, cache: &Path) -> Result<PathBuf> {
        let blocks = cache.with_extension(BLOCKS);
        let begun = self.prepare_with(&scene, &settings, Some(&blocks));
        let transfer = match begun {
            // a folder that cannot be written, or blocks that another window is at: nothing is kept on the way, but all can be lit
            Err(error) if is_about(&error, &blocks) => {
                self.tell(Event::Notice(format!("finished parts are not kept: {error}")));
                self.prepare_with(&scene, &settings, None)
            }
            transfer => transfer,
        }?;
        self.shared.set(Stage::Saving);
        (self.wake)();
        transfer.save(cache)?;
        // A file that stays is read, found to be of the same preparation, and removed the next time.
        let _ = std::fs::remove_file(&blocks);
        Ok(cache.to_owned())
    }

    fn prepare_with(
        &self,
        scene: &Arc<Scene>,
        settings: &Settings,
        blocks: Option<&Path>,
    ) -> Result<Arc<Transfer>> {
        let (path, settings, blocks) =
            (self.source.path.clone(), settings.clone(), blocks.map(Path::to_owned));
        let preparing = Preparing::start(Arc::clone(scene), self.source.threads, move |scene| {
            let preparation = preparation(scene, &path, &settings).direct_first();
            match blocks {
                Some(blocks) => preparation.checkpoint(blocks),
                None => preparation,
            }
        })?;
        let mut clock = Clock::new();
        self.shared.set(Stage::Preparing(clock.read(Status::default())));
        *lock(&self.shared.clock) = Some(clock);
        *lock(&self.shared.preparing) = Some(preparing);
        self.shared.rest();
        if self.shared.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let mut seen = 0;
        let preparing = loop {
            let mut slot = lock(&self.shared.preparing);
            let Some(preparing) = slot.as_ref() else { return Err(Error::Cancelled) };
            // in this order: what is shown last is there before it has ended
            let ended = preparing.is_finished();
            let transfers = preparing.status().transfers;
            if transfers > seen {
                seen = transfers;
                let current = preparing.current();
                drop(slot);
                current.into_iter().for_each(|transfer| self.tell(Event::Transfer(transfer)));
                continue;
            }
            if let Some(preparing) = slot.take_if(|_| ended) {
                break preparing;
            }
            drop(slot);
            std::thread::sleep(ASKED_EVERY);
        };
        preparing.wait()
    }
}

/// Whether an error is of this file.
fn is_about(error: &Error, file: &Path) -> bool {
    matches!(error, Error::File { path, .. } | Error::Io { path, .. } if path == file)
}

fn preparation<'a>(scene: &'a Scene, path: &Path, settings: &Settings) -> Preparation<'a> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Preparation::new(scene).name(name).settings(settings.clone())
}
