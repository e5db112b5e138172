//! The window itself: who is told what, and when.

mod files;
mod layout;
mod listen;
mod orders;
mod questions;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui::SurrenderFocusOn;
use relume::glam::Vec3;
use relume::image::Image;
use relume::relight::FrameStats;
use relume::scene::EnvironmentMap;
use relume::transfer::{Report, Settings};
use relume::{Error, LightRig, Result, Scene, Transfer};
use relume_io::AnimatedRig;

use crate::autosave::Autosave;
use crate::command::Command;
use crate::develop::{self, Developer, Histogram, Recipe};
use crate::dialog::{Dialogs, Purpose, Question};
use crate::document::{Document, Stage};
use crate::export::Export;
use crate::lighting::{self, Frame, Lighting, Order};
use crate::messages::Messages;
use crate::panels::{Playing, Renaming};
use crate::picture::{Picture, Tool};
use crate::preferences::Preferences;
use crate::shot::{Shot, Source};
use crate::through::{self, Looking};
use crate::truth::{self, PathTracing, Truth};
use crate::view::View;

/// How long after an edit unsaved work is kept for good.
const AUTOSAVE_AFTER: Duration = Duration::from_millis(700);

/// How long what is typed must stay as it is to be one edit.
const AT_REST: Duration = Duration::from_millis(500);

/// What to show, and how.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The shot; `None` opens an empty window.
    pub source: Option<Source>,
    /// The lights; without them the scene's own, or one that shows.
    pub rig: Option<PathBuf>,
    /// The folder for unsaved edits and what is remembered of the window; `None` keeps no edits.
    pub state: Option<PathBuf>,
    /// How scenes are prepared that are opened later.
    pub settings: Settings,
    /// On how many threads; 0 stands for one a processor.
    pub threads: usize,
    /// How files are asked for.
    pub dialogs: Dialogs,
    /// Say on stderr how long after this moment pictures come (the first one, the first with indirect light, the last), and in the end how long edits took
    /// to be seen.
    pub times: Option<Instant>,
}

/// The window.
pub struct Viewer {
    options: Options,
    /// Moments that have been told.
    told: Vec<&'static str>,
    preferences: Preferences,
    messages: Messages,
    question: Question,
    /// Something that waits until unsaved edits are saved or given up.
    pending: Option<Pending>,
    may_close: bool,
    /// Edits from before a crash, which wait for the lights that they are edits of.
    recovered: Option<AnimatedRig>,
    /// What is done once a field that was typed into is left.
    after_typing: Option<Command>,
    /// What the rig was when the window was drawn last, and since when it is so.
    seen: (LightRig, Instant),
    /// Names in the rig that the shot has not, which were told.
    unknown: BTreeSet<String>,
    /// Files that are being read, and how many.
    read: (Sender<Read>, Receiver<Read>),
    reading: usize,
    /// Rigs and maps that were asked for, the newest rig and the newest map that have come, and rigs that have been there.
    asked: u64,
    newest_rig: u64,
    newest_map: u64,
    documents: u64,
    /// Images that are being written.
    exports: Vec<Export>,
    /// Whether the worker that relights has failed.
    is_dark: bool,
    theme: egui::ThemePreference,
    shown_title: String,
    shows_help: bool,

    shot: Option<Shot>,
    scene: Option<Arc<Scene>>,
    transfer: Option<Arc<Transfer>>,
    /// Of the transfer: numbers of materials that emit, and of those that show.
    emissive: Vec<u32>,
    shown_materials: Vec<u32>,

    document: Document,
    /// Whether the lights are still to be made or taken from the scene.
    wants_lights: bool,
    autosave: Option<Autosave>,
    edited: Option<Instant>,
    /// The revision of the document that was looked at last.
    revision: u64,
    renaming: Renaming,
    playing: Option<Playing>,

    lighting: Lighting,
    ordered: Option<Order>,
    lit: Option<Arc<Frame>>,
    developer: Developer,
    /// What was developed last, and how.
    developed: Option<(Arc<Frame>, Recipe)>,
    histogram: Option<Histogram>,
    /// Negatives that were made, and the number of the one that is on the screen.
    negatives: u64,
    printed: u64,
    /// What is on the screen.
    print: Option<(Arc<egui::ColorImage>, Option<Arc<egui::ColorImage>>)>,
    /// What developing that took.
    developing: Duration,
    /// How often the window was drawn.
    drawn: u64,
    /// From edits to their pictures, the newest last.
    latencies: Vec<Duration>,
    looking: Looking,
    looked: Option<through::Order>,
    tracing: PathTracing,
    truth: Option<Truth>,
    /// How far the picture is from it, of which frame and after how many paths.
    off: Option<(Arc<Frame>, u32, f64)>,
    traced: Option<LightRig>,

    picture: Picture,
    views: [View; 2],
    snapshots: Vec<Snapshot>,
    snapshots_made: u64,
}

/// A picture that was stored to compare with.
struct Snapshot {
    number: u64,
    image: Arc<Image>,
}

/// One half of a wipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pane {
    /// What fills the picture without a wipe.
    Left,
    /// What is beside it.
    Right,
}

/// A file that was read.
enum Read {
    /// A rig.
    Rig(PathBuf, Result<Box<OpenedRig>>),
    /// A map, by its whole path, for the dome of that name, or for one that is to be added; of which rig, and of all files the how manieth it is.
    Map { map: Result<EnvironmentMap>, dome: Option<String>, document: u64, number: u64 },
    /// Nothing, of a file by which the reader has failed.
    Failed(PathBuf),
}

/// A rig that was read.
struct OpenedRig {
    document: Document,
    /// What may be lost for it.
    given_up: AnimatedRig,
    /// Of all files that were asked for, the how manieth it is.
    number: u64,
}

/// What waits for unsaved edits, or for files.
#[derive(Clone, Debug, PartialEq)]
enum Pending {
    Close,
    /// The same, once edits are saved or given up, for frames to be written.
    Frames,
    Rig(PathBuf),
}

impl Viewer {
    /// The window as it opens.
    ///
    /// # Errors
    /// What is wrong with the rig; [`Error::Io`] where the system gives no threads.
    pub fn new(context: &eframe::CreationContext<'_>, options: Options) -> Result<Self> {
        let document = options.rig.as_deref().map(Document::open).transpose()?;
        Self::with_document(context, options, document)
    }

    /// The same with the rig that was read already, where there is one.
    pub(crate) fn with_document(
        context: &eframe::CreationContext<'_>,
        options: Options,
        document: Option<Document>,
    ) -> Result<Self> {
        let ctx = context.egui_ctx.clone();
        let preferences = Preferences::load(context.storage);
        ctx.set_theme(preferences.theme);
        // a field that was typed into is left before the click that leaves it does anything
        ctx.options_mut(|options| options.input_options.surrender_focus_on = SurrenderFocusOn::Presses);
        let document = document.map_or_else(|| Document::new(&LightRig::default()), Ok)?;
        let wake = || {
            let ctx = ctx.clone();
            move || ctx.request_repaint()
        };
        let threads = |error| Error::io("threads for the window", "start", error);
        let mut viewer = Self {
            told: Vec::new(),
            messages: Messages::default(),
            question: Question::default(),
            pending: None,
            may_close: false,
            recovered: None,
            after_typing: None,
            seen: (document.rig.clone(), Instant::now()),
            unknown: BTreeSet::new(),
            read: channel(),
            reading: 0,
            asked: 0,
            newest_rig: 0,
            newest_map: 0,
            documents: 0,
            exports: Vec::new(),
            is_dark: false,
            theme: preferences.theme,
            shown_title: String::new(),
            shows_help: false,
            shot: None,
            scene: None,
            transfer: None,
            emissive: Vec::new(),
            shown_materials: Vec::new(),
            wants_lights: options.rig.is_none(),
            document,
            autosave: None,
            edited: None,
            revision: 0,
            renaming: None,
            playing: None,
            lighting: lighting::start(wake()).map_err(threads)?,
            ordered: None,
            lit: None,
            developer: develop::start(wake()).map_err(threads)?,
            developed: None,
            histogram: None,
            negatives: 0,
            printed: 0,
            print: None,
            developing: Duration::ZERO,
            drawn: 0,
            latencies: Vec::new(),
            looking: through::start(wake()).map_err(threads)?,
            looked: None,
            tracing: truth::start(wake()).map_err(threads)?,
            truth: None,
            off: None,
            traced: None,
            picture: Picture::default(),
            views: [View::Full, View::Direct],
            snapshots: Vec::new(),
            snapshots_made: 0,
            preferences,
            options,
        };
        match viewer.options.source.clone() {
            Some(source) => viewer.open_shot(&ctx, source),
            None => viewer.recover(),
        }
        Ok(viewer)
    }

    /// Where new lights go.
    fn stage(&self) -> Stage {
        let Some(transfer) = &self.transfer else {
            return Stage { eye: Vec3::new(0.0, 1.6, 4.0), center: Vec3::new(0.0, 1.0, 0.0) };
        };
        let (view, camera) = (&transfer.view, &transfer.view.camera);
        let middle = view.centers.get((view.height / 2) * view.width + view.width / 2);
        let seen = |sample: &&relume::sample::ViewSample| !sample.is_sky();
        let center =
            middle.filter(seen).or_else(|| view.centers.iter().find(seen)).map(|sample| sample.position);
        let ahead = camera.world_from_camera.transform_vector3(Vec3::NEG_Z) * 3.0;
        Stage { eye: camera.position(), center: center.unwrap_or(camera.position() + ahead) }
    }

    /// What the selected light is looked through with, while it is.
    fn eye(&self) -> Option<relume::Camera> {
        self.transfer.as_ref()?;
        let light = self.document.rig.lights.get(self.document.selected?)?;
        let Stage { eye, center } = self.stage();
        light.camera(center, 0.7 * eye.distance(center)).filter(|_| self.picture.inset.is_open)
    }

    fn report(&self) -> Option<&Report> {
        self.transfer.as_ref().map(|transfer| &transfer.report)
    }

    fn tell_moments(&mut self) {
        let Some(lit) = &self.lit else { return };
        let (direct_only, preview) = (lit.transfer.is_direct_only(), lit.preview);
        self.tell("first picture");
        if !direct_only && !preview {
            self.tell("first indirect light");
        }
    }

    /// How long edits took to be seen.
    fn tell_latencies(&self) {
        let mut sorted = self.latencies.clone();
        sorted.sort_unstable();
        let at = |share: f64| {
            sorted.get(((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1)))
        };
        if let (true, Some(median), Some(late)) = (self.options.times.is_some(), at(0.5), at(0.95)) {
            let ms = |time: &Duration| time.as_secs_f64() * 1e3;
            let (count, drawn, median, late) = (sorted.len(), self.drawn, ms(median), ms(late));
            eprintln!(
                "{count} edits seen after {median:.0} ms (median), {late:.0} ms (95%); the window was drawn {drawn} times"
            );
        }
    }

    fn tell(&mut self, moment: &'static str) {
        if let Some(began) = self.options.times.filter(|_| !self.told.contains(&moment)) {
            self.told.push(moment);
            eprintln!("{moment}: {:.2} s", began.elapsed().as_secs_f64());
        }
    }

    /// Notes edits once they are at rest, and keeps them for good a little later.
    fn keep(&mut self, ctx: &egui::Context) {
        if self.seen.0 != self.document.rig {
            self.seen = (self.document.rig.clone(), Instant::now());
        }
        // a value is being typed for as long as it changes, whatever has the keyboard then
        let rests = AT_REST.saturating_sub(self.seen.1.elapsed());
        let typed = ctx.egui_wants_keyboard_input() && !rests.is_zero();
        if typed {
            ctx.request_repaint_after(rests);
        }
        if !typed && !ctx.input(|input| input.pointer.any_down()) {
            self.document.note();
        }
        if std::mem::replace(&mut self.revision, self.document.revision()) != self.document.revision() {
            self.edited = Some(Instant::now());
        }
        if let Some(fault) = self.document.fault() {
            self.messages.error(&fault);
        }
        let Some(edited) = self.edited else { return };
        let left = AUTOSAVE_AFTER.saturating_sub(edited.elapsed());
        if !left.is_zero() {
            return ctx.request_repaint_after(left);
        }
        if self.recovered.is_some() {
            return; // its file is not to be written over
        }
        self.edited = None;
        let Some(autosave) = &self.autosave else { return };
        if !self.document.is_changed() {
            autosave.forget();
        } else if let Err(error) = autosave.keep(&self.document.whole()) {
            self.messages.error(&error);
        }
    }

    /// Whether there is anything that a command could be done to.
    fn can(&self, command: Command) -> bool {
        match command {
            Command::ExportImage => self.lit.is_some(),
            Command::ExportSequence => self.lit.is_some() && self.document.frames().is_some(),
            Command::Undo => self.document.undoes().is_some() || self.document.is_changed(),
            Command::Redo => self.document.redoes().is_some(),
            Command::Save => self.document.is_changed() || self.document.path().is_none(),
            Command::Duplicate | Command::Delete | Command::Key => self.document.selected.is_some(),
            // what is in hand can always be put away
            Command::Tool(tool) => self.document.selected.is_some() || self.picture.tool == tool,
            Command::LookThrough => self.document.selected.is_some() || self.picture.inset.is_open,
            Command::Play | Command::FrameBefore | Command::FrameAfter => self.document.frames().is_some(),
            _ => true,
        }
    }

    fn run(&mut self, ctx: &egui::Context, command: Command) {
        let folder = || {
            let shot = self.shot.as_ref().and_then(|shot| shot.source().path.parent());
            self.document.path().and_then(Path::parent).or(shot).unwrap_or(Path::new("")).to_owned()
        };
        let ask = |this: &mut Self, purpose: Purpose, suggested: PathBuf| {
            this.question.ask(ctx, this.options.dialogs, purpose, &suggested);
        };
        match command {
            Command::OpenShot => ask(self, Purpose::OpenShot, folder()),
            Command::OpenRig => ask(self, Purpose::OpenRig, folder()),
            Command::Save => match self.document.path().map(Path::to_owned) {
                Some(path) => self.save(&path),
                None => self.run(ctx, Command::SaveAs),
            },
            Command::SaveAs => {
                let path = self.document.path().map_or_else(|| folder().join("lights.toml"), Path::to_owned);
                ask(self, Purpose::SaveRig, path);
            }
            Command::ExportImage => {
                let path = folder().join(Path::new(&self.document.name()).with_extension("exr"));
                ask(self, Purpose::ExportImage, path);
            }
            Command::ExportSequence => {
                let name = self.document.name();
                let stem =
                    Path::new(&name).file_stem().unwrap_or_default().to_string_lossy().replace('#', "_");
                ask(self, Purpose::ExportSequence, folder().join(format!("{stem}.####.exr")));
            }
            Command::Close => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            Command::Undo => self.document.undo(),
            Command::Redo => self.document.redo(),
            Command::Duplicate => self.document.duplicate(),
            Command::Delete => self.document.delete(),
            Command::Key => self.document.key_selected(),
            Command::Play => self.play_or_pause(),
            Command::FrameBefore => self.document.go_to(self.document.frame().saturating_sub(1)),
            Command::FrameAfter => self.document.go_to(self.document.frame().saturating_add(1)),
            Command::Tool(tool) => {
                self.picture.tool = if self.picture.tool == tool { Tool::Select } else { tool }
            }
            Command::Fit => self.picture.fit(),
            Command::Actual => self.picture.show_actual(ctx),
            Command::Wipe => self.picture.wipe = if self.picture.wipe.is_some() { None } else { Some(0.5) },
            Command::ShowLights => self.picture.shows_lights = !self.picture.shows_lights,
            Command::LookThrough => self.picture.inset.is_open = !self.picture.inset.is_open,
            Command::Snapshot => self.store_snapshot(),
            Command::Help => self.shows_help = !self.shows_help,
        }
    }

    fn play_or_pause(&mut self) {
        self.playing = match self.playing {
            Some(_) => None,
            None => Some(Playing::from(self.document.frame())),
        };
    }

    fn store_snapshot(&mut self) {
        if let Some(lit) = &self.lit {
            self.snapshots_made += 1;
            let image = Arc::new(lit.layers.full());
            self.snapshots.push(Snapshot { number: self.snapshots_made, image });
        }
    }

    /// The rig as it is edited.
    pub fn rig(&self) -> &LightRig {
        &self.document.rig
    }

    /// The last picture's direct and indirect light, and whether it is a coarse one; `None` before the first.
    pub fn picture(&self) -> Option<(&relume::image::Layers, bool)> {
        self.lit.as_deref().map(|lit| (&lit.layers, lit.preview))
    }

    /// What the last picture took: relighting it, and developing it for the screen.
    pub fn work(&self) -> Option<(&FrameStats, Duration)> {
        self.lit.as_deref().map(|lit| (&lit.stats, self.developing))
    }

    /// Display pixels as they were shown last; the right ones are there where a wipe is.
    pub fn shown(&self, pane: Pane) -> Option<&egui::ColorImage> {
        let (left, right) = self.print.as_ref()?;
        match pane {
            Pane::Left => Some(left),
            Pane::Right => right.as_deref(),
        }
    }

    /// Of the path-traced picture: paths a pixel, relative L2 of its noise, and of the relit picture against it.
    pub fn reference(&self) -> Option<(u32, f64, f64)> {
        let truth = self.truth.as_ref()?;
        Some((truth.paths, truth.noise, self.off.as_ref()?.2))
    }

    /// Whether that is of the lights that are lit now.
    pub fn reference_is_current(&self) -> bool {
        self.off.as_ref().zip(self.lit.as_ref()).is_some_and(|((frame, ..), lit)| Arc::ptr_eq(frame, lit))
    }

    /// How long edits took to be seen, the newest last.
    pub fn latencies(&self) -> &[Duration] {
        &self.latencies
    }

    /// Where the selected light stands in the picture, pixels from its top left corner; `None` of light from far away, and behind the camera.
    pub fn handle(&self) -> Option<relume::glam::Vec2> {
        let view = &self.transfer.as_ref()?.view;
        let light = self.document.rig.lights.get(self.document.selected?)?;
        view.camera.project(light.position()?, view.width, view.height).map(|(at, _)| at)
    }

    /// Whether all that was asked for is there to be seen: the newest edit, in full.
    pub fn is_settled(&self) -> bool {
        let newest = self.ordered.as_ref().zip(self.lit.as_ref());
        newest.is_some_and(|(ordered, lit)| {
            let lights =
                !lit.preview && ordered.rig == lit.rig && Arc::ptr_eq(&ordered.transfer, &lit.transfer);
            let layers = ordered.per_light <= !lit.layers.per_light.is_empty()
                && ordered.albedo <= lit.albedo.is_some();
            lights && layers && self.printed == self.negatives
        })
    }

    /// Whether a file is being read that was asked for: a rig, or a map.
    pub fn is_reading(&self) -> bool {
        self.reading > 0
    }

    /// Whether the shot is prepared in full.
    pub fn is_prepared(&self) -> bool {
        self.shot.as_ref().is_some_and(|shot| shot.stage() == crate::shot::Stage::Ready)
    }
}
