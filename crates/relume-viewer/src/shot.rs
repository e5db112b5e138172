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
    /// Where the transfer of a scene is kept; `None` for the scene's name with the ending `.relume`, beside it.
    pub cache: Option<PathBuf>,
    /// How a scene is prepared; its `camera` is that of [`Self::camera`].
    pub settings: Settings,
}

impl Source {
    /// A file, with default settings.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), camera: None, cache: None, settings: Settings::default() }
    }

    /// Whether it is a scene, by its ending.
    pub fn is_scene(&self) -> bool {
        let ending = self.path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        ending.is_some_and(|ending| SCENES.contains(&&*ending))
    }

    /// The file that the transfer is read from, and kept in.
    pub fn cache(&self) -> PathBuf {
        match &self.cache {
            _ if !self.is_scene() => self.path.clone(),
            Some(cache) => cache.clone(),
            None => self.path.with_extension("relume"),
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
    /// The transfer is being prepared: the stage at work, and since when.
    Preparing(Status, Instant),
    /// The cache is being written.
    Saving,
    /// Nothing is left to do.
    Ready,
    /// It was cancelled, or has failed: what is there can be lit.
    Stopped,
}

/// An open shot, for as long as this lives.
pub(crate) struct Shot {
    source: Source,
    events: Receiver<Event>,
    shared: Arc<Shared>,
}

struct Shared {
    stage: Mutex<Stage>,
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
        match (stage, lock(&self.shared.preparing).as_ref()) {
            (Stage::Preparing(_, since), Some(preparing)) => Stage::Preparing(preparing.status(), since),
            (stage, _) => stage,
        }
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
        let cache = self.source.cache();
        if !self.source.is_scene() {
            self.tell(Event::Transfer(Arc::new(Transfer::load(&cache)?)));
            return Ok(None);
        }
        let known = self.known(&cache);
        if let Some(known) = &known {
            // before the scene is read: the next opening is instant
            self.tell(Event::Transfer(Arc::clone(known)));
        }
        let imported = load_scene(&self.source.path)?;
        let scene = Arc::new(imported.scene);
        self.tell(Event::Scene(Arc::clone(&scene), imported.warnings));
        let camera = scene.find_camera(self.source.camera.as_deref());
        let camera = camera.map_err(|message| Error::file(&self.source.path, message))?;
        let settings = Settings { camera, ..self.source.settings.clone() };
        if let Some(known) = known {
            if preparation(&scene, &self.source.path, &settings).would_make(&known)? {
                return Ok(None);
            }
            let name = self.source.path.display();
            self.tell(Event::Notice(format!(
                "{name} has changed since it was prepared, and is prepared again"
            )));
        }
        self.prepare(scene, settings, &cache).map(Some)
    }

    /// What lies in the cache, if it was made by the same settings. A file that cannot be used is told, and replaced in the end.
    fn known(&self, cache: &Path) -> Option<Arc<Transfer>> {
        if !cache.exists() {
            return None;
        }
        match Transfer::load(cache) {
            Ok(transfer) => {
                let made_by = &transfer.report.settings;
                let wanted = Settings { camera: made_by.camera, ..self.source.settings.clone() };
                let same = *made_by == wanted;
                if !same {
                    let name = cache.display();
                    self.tell(Event::Notice(format!(
                        "{name} was prepared with other settings, and will be replaced"
                    )));
                }
                same.then(|| Arc::new(transfer))
            }
            Err(error) => {
                self.tell(Event::Notice(format!("the cache is made anew: {error}")));
                None
            }
        }
    }

    fn prepare(&self, scene: Arc<Scene>, settings: Settings, cache: &Path) -> Result<PathBuf> {
        let (path, blocks) = (self.source.path.clone(), cache.with_extension(BLOCKS));
        let kept = blocks.clone();
        let preparing = Preparing::start(scene, 0, move |scene| {
            preparation(scene, &path, &settings).checkpoint(kept).direct_first()
        })?;
        self.shared.set(Stage::Preparing(Status::default(), Instant::now()));
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
        let transfer = preparing.wait()?;
        self.shared.set(Stage::Saving);
        (self.wake)();
        transfer.save(cache)?;
        // A file that stays is read, found to be of the same preparation, and removed the next time.
        let _ = std::fs::remove_file(&blocks);
        Ok(cache.to_owned())
    }
}

fn preparation<'a>(scene: &'a Scene, path: &Path, settings: &Settings) -> Preparation<'a> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Preparation::new(scene).name(name).settings(settings.clone())
}
