//! Images that are written, one or a sequence, while the window goes on.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use relume::image::{Layers, Tonemap};
use relume::relight::RelightSettings;
use relume::{Error, LightRig, Progress, Relighter, Result, Transfer};
use relume_io::{AnimatedRig, FrameNames, ImageKind, frame_attributes, write_behind, write_frame};

use crate::lighting::Frame;

/// How often an export that rests looks whether it may go on.
const ASKED_EVERY: Duration = Duration::from_millis(20);

/// What to write.
pub(crate) struct Job {
    pub(crate) transfer: Arc<Transfer>,
    pub(crate) sheets: Sheets,
    /// Where to: the name of the file, or of a sequence with one group of `#`.
    pub(crate) path: PathBuf,
    /// Whether an EXR has the layers of each light.
    pub(crate) per_light: bool,
    /// Of a PNG.
    pub(crate) curve: Tonemap,
}

/// What the images are of.
pub(crate) enum Sheets {
    /// One, of this rig; the picture of it where it is lit already.
    One { animated: AnimatedRig, rig: LightRig, lit: Option<Arc<Frame>> },
    /// One for each frame.
    Sequence { animated: AnimatedRig, frames: RangeInclusive<i32>, shown: Shown },
}

/// What of a rig is shown.
pub(crate) type Shown = Box<dyn Fn(LightRig) -> LightRig + Send>;

/// Images at work, for as long as this lives.
pub(crate) struct Export {
    path: PathBuf,
    /// Images.
    of: u32,
    began: Instant,
    shared: Arc<Shared>,
    end: Receiver<Result<()>>,
}

#[derive(Default)]
struct Shared {
    written: AtomicU32,
    stopped: AtomicBool,
    resting: AtomicBool,
}

impl Export {
    /// Begins to write; `wake` is called with every image, and at the end.
    ///
    /// # Errors
    /// [`Error::File`] for a name that cannot be; [`Error::Io`] where the system gives no thread.
    pub(crate) fn start(job: Job, wake: impl Fn() + Send + Sync + 'static) -> Result<Self> {
        let kind = ImageKind::of(&job.path)?;
        let of = match &job.sheets {
            Sheets::One { .. } => 1,
            Sheets::Sequence { frames, .. } => {
                FrameNames::new(&job.path)?;
                frames.end().abs_diff(*frames.start()) + 1
            }
        };
        // not the pool of frames, which would wait for these
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(rayon::current_num_threads())
            .thread_name(|number| format!("export {number}"))
            .build();
        let refused = |error| Error::io("threads for the window", "start", error);
        let pool = pool.map_err(|error| refused(std::io::Error::other(error)))?;
        let (shared, path) = (Arc::new(Shared::default()), job.path.clone());
        let (sender, end) = channel();
        let tally = Arc::clone(&shared);
        let run = move || {
            // a window that has closed need not be told
            let _ = sender.send(pool.install(|| job.write(kind, &tally, &wake)));
            wake();
        };
        std::thread::Builder::new().name("export".to_owned()).spawn(run).map_err(refused)?;
        Ok(Self { path, of, began: Instant::now(), shared, end })
    }

    /// The file, or the files.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// How many images are written, and how many there will be.
    pub(crate) fn progress(&self) -> (u32, u32) {
        (self.shared.written.load(Ordering::Relaxed), self.of)
    }

    /// How much longer it will take, once that can be told.
    pub(crate) fn left(&self) -> Option<Duration> {
        let (written, of) = self.progress();
        (written > 0).then(|| self.began.elapsed().mul_f64(f64::from(of - written) / f64::from(written)))
    }

    /// Lets it rest while something is dragged: the processor is wanted for frames.
    pub(crate) fn rest(&self, resting: bool) {
        self.shared.resting.store(resting, Ordering::Relaxed);
    }

    /// Ends it; images that are written stay.
    pub(crate) fn stop(&self) {
        self.shared.stopped.store(true, Ordering::Relaxed);
    }

    /// How it has ended, once it has.
    pub(crate) fn ended(&self) -> Option<Result<()>> {
        match self.end.try_recv() {
            Ok(end) => Some(end),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(self.failed("has failed"))),
        }
    }

    /// Waits for its end, but no longer than this.
    pub(crate) fn finish_within(&self, time: Duration) -> Result<()> {
        self.end.recv_timeout(time).unwrap_or_else(|_| Err(self.failed("has not come to an end")))
    }

    fn failed(&self, what: &str) -> Error {
        Error::file(&self.path, format!("writing it {what}; export it once more"))
    }
}

impl Drop for Export {
    fn drop(&mut self) {
        self.stop();
    }
}

impl Shared {
    /// Waits for as long as something is dragged.
    fn rest(&self) -> Result<()> {
        while self.resting.load(Ordering::Relaxed) && !self.cancelled() {
            std::thread::sleep(ASKED_EVERY);
        }
        if self.cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// Work stops where nobody wants it any more.
impl Progress for Shared {
    fn cancelled(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// One image, ready to be written.
struct Sheet {
    file: PathBuf,
    layers: Layers,
    exposure: f32,
}

impl Job {
    fn write(self, kind: ImageKind, shared: &Shared, wake: &(impl Fn() + Sync)) -> Result<()> {
        let Self { transfer, sheets, path, per_light, curve } = self;
        let per_light = per_light && kind == ImageKind::Exr;
        let settings = RelightSettings { per_light, ..RelightSettings::default() };
        let attributes = frame_attributes(&transfer, &settings);
        let write = |Sheet { file, layers, exposure }: Sheet| {
            write_frame(file, kind, &layers, (exposure, curve), attributes.clone())?;
            shared.written.fetch_add(1, Ordering::Relaxed);
            wake();
            Ok(())
        };
        match sheets {
            Sheets::One { animated, rig, lit } => {
                keep_maps(&animated, std::iter::once(path.clone()))?;
                let fits = |lit: &Arc<Frame>| !per_light || !lit.layers.per_light.is_empty();
                let layers = match lit.filter(fits) {
                    Some(lit) => {
                        let mut layers = lit.layers.clone();
                        if !per_light {
                            layers.per_light.clear();
                        }
                        layers
                    }
                    None => Relighter::new(transfer).relight_watched(&rig, &settings, shared)?,
                };
                write(Sheet { file: path, layers, exposure: rig.exposure })
            }
            Sheets::Sequence { animated, frames, shown } => {
                let names = FrameNames::new(&path)?;
                keep_maps(&animated, frames.clone().map(|frame| names.file(frame)))?;
                let mut relighter = Relighter::new(transfer);
                let rig = |frame: i32| animated.rig(frame.into()).map(&shown);
                for frame in frames.clone() {
                    if shared.cancelled() {
                        return Err(Error::Cancelled);
                    }
                    // before the first is written
                    let told = |error| Error::Setting(format!("at frame {frame}: {error}"));
                    relighter.check(&rig(frame)?, &settings).map_err(told)?;
                }
                let sheets = frames.map(|frame| {
                    shared.rest()?;
                    let rig = rig(frame)?;
                    let layers = relighter.relight_watched(&rig, &settings, shared)?;
                    Ok(Sheet { file: names.file(frame), layers, exposure: rig.exposure })
                });
                write_behind(sheets, write)
            }
        }
    }
}

/// Refuses images that would take the place of a map.
fn keep_maps(animated: &AnimatedRig, mut files: impl Iterator<Item = PathBuf>) -> Result<()> {
    let maps: Vec<PathBuf> = animated.maps().filter_map(|map| map.canonicalize().ok()).collect();
    if maps.is_empty() {
        return Ok(());
    }
    match files.find(|file| file.canonicalize().is_ok_and(|file| maps.contains(&file))) {
        Some(file) => {
            Err(Error::file(file, "is a map of this rig and would be overwritten; name another file"))
        }
        None => Ok(()),
    }
}
