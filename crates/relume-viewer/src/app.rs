//! The window itself: who is told what, and when.

mod layout;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;
use relume::glam::Vec3;
use relume::image::{Image, Tonemap, display};
use relume::transfer::Report;
use relume::{Error, LightKind, LightRig, Result, Scene, Transfer};
use relume_io::{ExrMeta, check_materials, read_environment, write_exr, write_png};

use crate::autosave::Autosave;
use crate::command::Command;
use crate::develop::{Developer, Histogram, Negative};
use crate::dialog::{Dialogs, Purpose, Question};
use crate::document::{Document, Stage};
use crate::lighting::{Frame, Lighting, Order};
use crate::messages::Messages;
use crate::panels::Renaming;
use crate::picture::{Picture, Tool};
use crate::preferences::Preferences;
use crate::shot::{Event, Shot, Source};
use crate::truth::{self, PathTracing, Truth};
use crate::view::View;

/// How long after an edit unsaved work is kept for good.
const AUTOSAVE_AFTER: Duration = Duration::from_millis(700);

/// What to show, and how.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The shot; `None` opens an empty window.
    pub source: Option<Source>,
    /// The lights; without them the scene's own, or one that shows.
    pub rig: Option<PathBuf>,
    /// The folder for unsaved edits; `None` keeps none.
    pub state: Option<PathBuf>,
    /// How files are asked for.
    pub dialogs: Dialogs,
    /// Say on stderr when pictures come: the first one, the first with indirect light, the last.
    pub times: bool,
}

/// The window.
pub struct Viewer {
    options: Options,
    began: Instant,
    /// Moments that have been told.
    told: Vec<&'static str>,
    preferences: Preferences,
    messages: Messages,
    question: Question,
    /// Something that waits until unsaved edits are saved or given up.
    pending: Option<Pending>,
    may_close: bool,
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
    renaming: Renaming,

    lighting: Lighting,
    ordered: Option<Order>,
    lit: Option<Arc<Frame>>,
    developer: Developer,
    developed: Option<Wanted>,
    histogram: Option<Histogram>,
    /// Negatives that were made, and the number of the one that is on the screen.
    negatives: u64,
    printed: u64,
    /// What is on the screen.
    print: Option<(Arc<egui::ColorImage>, Option<Arc<egui::ColorImage>>)>,
    latency: Option<Duration>,
    tracing: PathTracing,
    truth: Option<Truth>,
    traced: Option<LightRig>,

    picture: Picture,
    views: [View; 2],
    snapshots: Vec<Snapshot>,
    snapshots_made: u64,
}

/// What the last negative was made of: another one is made where any of it changes.
#[derive(PartialEq)]
struct Wanted {
    frame: *const Frame,
    truth: Option<*const Image>,
    views: [View; 2],
    both: bool,
    exposure: f32,
    curve: Tonemap,
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

/// What waits for unsaved edits.
#[derive(Clone, Debug, PartialEq)]
enum Pending {
    Close,
    Rig(PathBuf),
    Shot(PathBuf),
}

impl Viewer {
    /// The window as it opens.
    ///
    /// # Errors
    /// What is wrong with the rig; [`Error::Io`] where the system gives no threads.
    pub fn new(context: &eframe::CreationContext<'_>, options: Options) -> Result<Self> {
        let ctx = context.egui_ctx.clone();
        let preferences = Preferences::load(context.storage);
        ctx.set_theme(preferences.theme);
        let document = match &options.rig {
            Some(rig) => Document::open(rig)?,
            None => Document::new(LightRig::default(), None),
        };
        let wake = || {
            let ctx = ctx.clone();
            move || ctx.request_repaint()
        };
        let threads = |error| Error::io("threads for the window", "start", error);
        let mut viewer = Self {
            began: Instant::now(),
            told: Vec::new(),
            messages: Messages::default(),
            question: Question::default(),
            pending: None,
            may_close: false,
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
            renaming: None,
            lighting: Lighting::start(wake()).map_err(threads)?,
            ordered: None,
            lit: None,
            developer: Developer::start(wake()).map_err(threads)?,
            developed: None,
            histogram: None,
            negatives: 0,
            printed: 0,
            print: None,
            latency: None,
            tracing: PathTracing::start(wake()).map_err(threads)?,
            truth: None,
            traced: None,
            picture: Picture::default(),
            views: [View::Full, View::Direct],
            snapshots: Vec::new(),
            snapshots_made: 0,
            preferences,
            options,
        };
        if let Some(source) = viewer.options.source.clone() {
            viewer.open_shot(&ctx, source);
        }
        Ok(viewer)
    }

    /// Opens a shot in place of the one that is open. The lights stay.
    fn open_shot(&mut self, ctx: &egui::Context, source: Source) {
        let wake = ctx.clone();
        (self.scene, self.transfer, self.lit, self.ordered) = (None, None, None, None);
        (self.truth, self.traced, self.developed) = (None, None, None);
        self.snapshots.clear();
        self.preferences.remember(&source.path);
        let path = source.path.clone();
        match Shot::open(source, move || wake.request_repaint()) {
            Ok(shot) => self.shot = Some(shot),
            Err(error) => self.messages.error(&Error::io(path, "open", error)),
        }
        self.recover();
    }

    /// Takes up edits that were never saved.
    fn recover(&mut self) {
        let shot = self.shot.as_ref().map(|shot| shot.source().path.clone());
        let of = self.document.path().map(Path::to_owned).or(shot);
        self.autosave = self.options.state.as_ref().zip(of).map(|(state, of)| {
            let folder = state.join("unsaved");
            Autosave::new(&folder, &of)
        });
        let Some(autosave) = &self.autosave else { return };
        match autosave.recovered() {
            Ok(Some(rig)) if rig != self.document.rig => {
                self.document.recover(rig);
                self.wants_lights = false;
                self.messages.warn("Edits that were never saved are here again; Edit, Undo drops them");
            }
            Ok(_) => {}
            Err(error) => {
                autosave.forget();
                self.messages.error(&error);
            }
        }
    }

    fn open_rig(&mut self, path: &Path) {
        match Document::open(path) {
            Ok(document) => {
                if let Some(autosave) = &self.autosave {
                    autosave.forget();
                }
                self.document = document;
                self.wants_lights = false;
                self.preferences.remember(path);
                self.check_materials();
                self.recover();
            }
            Err(error) => self.messages.error(&error),
        }
    }

    /// Says which of the rig's materials the shot has not, and leaves them out: no frame could be lit with them.
    fn check_materials(&mut self) {
        let Some(transfer) = &self.transfer else { return };
        let report = &transfer.report;
        let path = self.document.path().unwrap_or(Path::new("the rig")).to_owned();
        while let Err(error) = check_materials(&self.document.rig, &path, report.named_materials()) {
            let before = (self.document.rig.emitters.len(), self.document.rig.materials.len());
            let shines = |name: &str| report.named_materials().any(|(known, shines)| known == name && shines);
            self.document.rig.emitters.retain(|emitter| shines(&emitter.material));
            self.document.rig.materials.retain(|edit| report.materials.contains(&edit.name));
            self.messages.warn(format!("{error}; it is left out"));
            if before == (self.document.rig.emitters.len(), self.document.rig.materials.len()) {
                break;
            }
        }
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

    fn report(&self) -> Option<&Report> {
        self.transfer.as_ref().map(|transfer| &transfer.report)
    }

    /// Takes in what the workers have done since the last time.
    fn listen(&mut self, ctx: &egui::Context) {
        while let Some(event) = self.shot.as_ref().and_then(Shot::next) {
            self.hear(event);
        }
        while let Some(frame) = self.lighting.next() {
            match frame {
                // of a shot that was closed meanwhile
                Ok(frame)
                    if !self
                        .transfer
                        .as_ref()
                        .is_some_and(|now| now.report.scene_hash == frame.transfer.report.scene_hash) => {}
                Ok(frame) => self.lit = Some(Arc::new(frame)),
                Err(error) => self.messages.error(&error),
            }
        }
        if self.lighting.has_failed() && !std::mem::replace(&mut self.is_dark, true) {
            let text = "relighting has failed and goes no further: save your lights, and open the shot again";
            self.messages.error(&Error::Setting(text.to_owned()));
        }
        if let Some(print) = self.developer.next() {
            self.latency = print.asked.map(|asked| asked.elapsed()).or(self.latency);
            self.histogram = Some(print.histogram.clone());
            self.printed = print.number;
            self.print = Some((Arc::clone(&print.left), print.right.clone()));
            self.picture.take(ctx, print);
            self.tell_moments();
        }
        match self.tracing.next() {
            Some(Ok(truth)) => self.truth = Some(truth),
            Some(Err(error)) => self.messages.error(&error),
            None => {}
        }
        if let Some(again) = self.messages.age() {
            ctx.request_repaint_after(again);
        }
    }

    fn hear(&mut self, event: Event) {
        match event {
            Event::Scene(scene, warnings) => {
                warnings.into_iter().for_each(|warning| self.messages.warn(warning));
                if self.wants_lights && !scene.lights.lights.is_empty() {
                    self.document = Document::new(scene.lights.clone(), None);
                    self.wants_lights = false;
                }
                self.scene = Some(scene);
            }
            Event::Transfer(transfer) => {
                let first = self.transfer.is_none();
                self.emissive = transfer.emissive_materials();
                self.shown_materials = transfer.shown_materials();
                self.transfer = Some(transfer);
                if first {
                    self.check_materials();
                    self.make_light();
                }
            }
            Event::Ready(kept) => {
                if let Some(kept) = kept {
                    self.messages.notice(format!("Prepared, and kept in {}", kept.display()));
                }
                self.tell("prepared");
            }
            Event::Notice(text) => self.messages.notice(text),
            Event::Failed(error) => self.messages.error(&error),
        }
    }

    /// A first light, where neither rig nor scene have any.
    fn make_light(&mut self) {
        let scene_is_read =
            self.scene.is_some() || self.shot.as_ref().is_some_and(|shot| !shot.source().is_scene());
        let shines = !self.emissive.is_empty();
        if self.wants_lights && scene_is_read && self.document.rig.lights.is_empty() && !shines {
            let stage = self.stage();
            self.document.add(crate::document::NewLight::Omni, stage);
            self.document = Document::new(self.document.rig.clone(), None);
        }
        self.wants_lights &= !scene_is_read;
    }

    fn tell_moments(&mut self) {
        let Some(lit) = &self.lit else { return };
        let (direct_only, preview) = (lit.transfer.is_direct_only(), lit.preview);
        self.tell("first picture");
        if !direct_only && !preview {
            self.tell("first indirect light");
        }
    }

    fn tell(&mut self, moment: &'static str) {
        if self.options.times && !self.told.contains(&moment) {
            self.told.push(moment);
            eprintln!("{moment}: {:.2} s", self.began.elapsed().as_secs_f64());
        }
    }

    /// Asks the workers for what is to be shown now.
    fn order(&mut self, ctx: &egui::Context) {
        let Some(transfer) = &self.transfer else { return };
        let emissive = self
            .emissive
            .iter()
            .filter_map(|&number| transfer.report.materials.get(number as usize).cloned());
        let rig = LightRig { exposure: 0.0, ..self.document.shown(emissive) };
        let wants = |view: &dyn Fn(&View) -> bool| {
            view(&self.views[0]) || (self.picture.wipe.is_some() && view(&self.views[1]))
        };
        let per_light = wants(&|view| matches!(view, View::Light(_)));
        let albedo = wants(&|view| *view == View::Albedo);
        let down = ctx.input(|input| input.pointer.any_down());
        let changed = match &self.ordered {
            None => true,
            Some(last) => {
                let same = Arc::ptr_eq(&last.transfer, transfer) && last.rig == rig;
                !same || last.per_light != per_light || last.albedo != albedo || (last.dragging && !down)
            }
        };
        if let Some(shot) = &self.shot {
            shot.rest(down && self.ordered.as_ref().is_some_and(|last| last.dragging));
        }
        if changed {
            let moved = self.ordered.as_ref().is_some_and(|last| last.rig != rig);
            // what follows a drag is the full frame of the same edit, which was on the screen before
            let asked = moved.then(Instant::now);
            let order = Order {
                transfer: Arc::clone(transfer),
                rig,
                per_light,
                albedo,
                dragging: down && moved,
                asked,
            };
            self.lighting.order(order.clone());
            self.ordered = Some(order);
        }
        self.order_truth();
        self.develop();
    }

    /// Path traces for as long as the reference is looked at, anew for each rig.
    fn order_truth(&mut self) {
        let looked_at = self.views[0] == View::Reference
            || (self.picture.wipe.is_some() && self.views[1] == View::Reference);
        let full = self.lit.as_ref().filter(|lit| !lit.preview && looked_at);
        match (full, &self.scene, &self.transfer) {
            (Some(lit), Some(scene), Some(transfer)) if self.traced.as_ref() != Some(&lit.rig) => {
                let order = truth::Order {
                    scene: Arc::clone(scene),
                    camera: transfer.report.settings.camera,
                    lit: Arc::clone(lit),
                };
                self.traced = Some(lit.rig.clone());
                self.tracing.order(Some(order));
            }
            _ if !looked_at && self.traced.take().is_some() => self.tracing.order(None),
            _ => {}
        }
    }

    /// Has shown what there is.
    fn develop(&mut self) {
        let Some(lit) = &self.lit else { return };
        let truth = self.truth.as_ref().map(|truth| &truth.image);
        let wanted = Wanted {
            frame: Arc::as_ptr(lit),
            truth: truth.map(Arc::as_ptr),
            views: self.views.clone(),
            both: self.picture.wipe.is_some(),
            exposure: self.document.rig.exposure,
            curve: self.preferences.curve.into(),
        };
        if self.developed.as_ref() == Some(&wanted) {
            return;
        }
        let snapshot = |number| {
            let found = self.snapshots.iter().find(|snapshot| snapshot.number == number);
            found.map(|snapshot| Arc::clone(&snapshot.image))
        };
        let source = |view: &View| view.source(lit, truth, snapshot);
        // until a reference is there, what it will be compared with is shown
        let Some(left) = source(&self.views[0]).or_else(|| source(&View::Full)) else { return };
        let fresh = self.developed.as_ref().is_none_or(|last| last.frame != wanted.frame);
        self.negatives += 1;
        self.developer.order(Negative {
            number: self.negatives,
            left,
            right: if wanted.both { source(&self.views[1]) } else { None },
            exposure: wanted.exposure,
            curve: wanted.curve,
            asked: lit.asked.filter(|_| fresh),
        });
        self.developed = Some(wanted);
    }

    /// Notes edits once they are at rest, and keeps them for good a little later.
    fn keep(&mut self, ctx: &egui::Context) {
        let at_work = ctx.input(|input| input.pointer.any_down()) || ctx.egui_wants_keyboard_input();
        if !at_work && self.document.note() {
            self.edited = Some(Instant::now());
        }
        let Some(edited) = self.edited else { return };
        let left = AUTOSAVE_AFTER.saturating_sub(edited.elapsed());
        if !left.is_zero() {
            return ctx.request_repaint_after(left);
        }
        self.edited = None;
        let Some(autosave) = &self.autosave else { return };
        if !self.document.is_changed() {
            autosave.forget();
        } else if let Err(error) = autosave.keep(&self.document.rig) {
            self.messages.error(&error);
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
            Command::Close => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            Command::Undo => self.document.undo(),
            Command::Redo => self.document.redo(),
            Command::Duplicate => self.document.duplicate(),
            Command::Delete => self.document.delete(),
            Command::Tool(tool) => {
                self.picture.tool = if self.picture.tool == tool { Tool::Select } else { tool }
            }
            Command::Fit => self.picture.fit(),
            Command::Actual => self.picture.show_actual(ctx),
            Command::Wipe => self.picture.wipe = if self.picture.wipe.is_some() { None } else { Some(0.5) },
            Command::ShowLights => self.picture.shows_lights = !self.picture.shows_lights,
            Command::Snapshot => self.store_snapshot(),
            Command::Help => self.shows_help = !self.shows_help,
        }
        if matches!(command, Command::Undo | Command::Redo) {
            self.edited = Some(Instant::now());
        }
    }

    fn store_snapshot(&mut self) {
        if let Some(lit) = &self.lit {
            self.snapshots_made += 1;
            let image = Arc::new(lit.layers.full());
            self.snapshots.push(Snapshot { number: self.snapshots_made, image });
        }
    }

    /// Saves the rig. Returns to what waited for it.
    fn save(&mut self, path: &Path) {
        let path = if path.extension().is_none() { path.with_extension("toml") } else { path.to_owned() };
        match self.document.save(&path) {
            Ok(()) => {
                if let Some(autosave) = self.autosave.take() {
                    autosave.forget();
                }
                self.autosave =
                    self.options.state.as_ref().map(|state| Autosave::new(&state.join("unsaved"), &path));
                self.preferences.remember(&path);
                self.messages.notice(format!("Saved {}", path.display()));
            }
            Err(error) => {
                self.pending = None;
                self.messages.error(&error);
            }
        }
    }

    /// What was asked for, with the file for it.
    fn answer(&mut self, ctx: &egui::Context, purpose: Purpose, path: PathBuf) {
        match purpose {
            Purpose::OpenShot | Purpose::OpenRig => self.open(ctx, path),
            Purpose::SaveRig => self.save(&path),
            Purpose::ExportImage => self.export(&path),
            Purpose::Map => self.set_map(&path),
        }
    }

    /// Opens a file by its ending: a rig, an environment map, else a shot.
    fn open(&mut self, ctx: &egui::Context, path: PathBuf) {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("toml") if self.document.is_changed() => self.pending = Some(Pending::Rig(path)),
            Some("toml") => self.open_rig(&path),
            Some("hdr" | "exr") => self.set_map(&path),
            _ => {
                let settings =
                    self.options.source.as_ref().map(|source| source.settings.clone()).unwrap_or_default();
                let source = Source { settings, ..Source::new(&path) };
                if !path.is_file() {
                    let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
                    self.messages.error(&Error::io(&path, "read", missing));
                } else if self.document.is_changed() && self.document.path().is_none() {
                    self.pending = Some(Pending::Shot(path));
                } else {
                    self.open_shot(ctx, source);
                }
            }
        }
    }

    /// Gives the selected dome a map, or adds a dome with it.
    fn set_map(&mut self, path: &Path) {
        let folder =
            self.document.path().and_then(Path::parent).and_then(|folder| std::path::absolute(folder).ok());
        let file = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let name = folder.and_then(|folder| file.strip_prefix(folder).ok()).unwrap_or(&file);
        let read = match read_environment(path, &name.to_string_lossy()) {
            Ok(read) => Arc::new(read),
            Err(error) => return self.messages.error(&error),
        };
        let is_dome = |light: &relume::Light| matches!(light.kind, LightKind::Dome { .. });
        if !self.document.selected_light().is_some_and(|light| is_dome(light)) {
            match self.document.rig.lights.iter().position(is_dome) {
                Some(dome) => self.document.selected = Some(dome),
                None => {
                    let stage = self.stage();
                    self.document.add(crate::document::NewLight::Dome, stage);
                    if let Some(light) = self.document.selected_light() {
                        *light = light.with_color(Vec3::ONE);
                    }
                }
            }
        }
        if let Some(LightKind::Dome { map, .. }) = self.document.selected_light().map(|light| &mut light.kind)
        {
            *map = Some(read);
        }
    }

    /// Writes the picture on a thread of its own.
    fn export(&mut self, path: &Path) {
        let Some(lit) = self.lit.clone() else {
            return self.messages.warn("There is no picture to export yet");
        };
        if lit.preview {
            self.messages.warn("What was exported is a coarse frame: the full one is not there yet");
        }
        let (exposure, curve) = (self.document.rig.exposure, self.preferences.curve.into());
        let written =
            match path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).as_deref() {
                Some("exr") => write_exr(path, &lit.layers, &ExrMeta::default()),
                Some("png") => {
                    let image = lit.layers.full();
                    write_png(path, image.width, image.height, &display(&image, exposure, curve))
                }
                _ => Err(Error::file(path, "an image must end in .exr or .png; name it so")),
            };
        match written {
            Ok(()) => self.messages.notice(format!("Wrote {}", path.display())),
            Err(error) => self.messages.error(&error),
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
        self.truth.as_ref().map(|truth| (truth.paths, truth.noise, truth.error))
    }

    /// Whether that is of the lights that are lit now.
    pub fn reference_is_current(&self) -> bool {
        self.truth.as_ref().zip(self.lit.as_ref()).is_some_and(|(truth, lit)| truth.rig == lit.rig)
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

    /// Whether the shot is prepared in full.
    pub fn is_prepared(&self) -> bool {
        self.shot.as_ref().is_some_and(|shot| shot.stage() == crate::shot::Stage::Ready)
    }
}
