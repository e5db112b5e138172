//! What the window looks like: menus, panels, questions.

use std::path::{Path, PathBuf};
use std::time::Duration;

use eframe::egui::{
    self, Button, CentralPanel, CollapsingHeader, ComboBox, MenuBar, Panel, ScrollArea, Ui, ViewportCommand,
};
use relume::{Error, LightKind};

use super::Viewer;
use crate::command::Command;
use crate::dialog::Purpose;
use crate::document::NewLight;
use crate::panels::{self, MapWish, Playing};
use crate::picture::{Around, Tool};
use crate::preferences::Curve;
use crate::shot::{Shot, Stage};
use crate::view::{PLAIN, View};

/// Longest that a window which closes waits for an image to be written.
const WRITTEN_WITHIN: Duration = Duration::from_secs(60);
/// Stops by which a picture may be made brighter or darker.
const EXPOSURES: std::ops::RangeInclusive<f32> = -12.0..=12.0;

impl eframe::App for Viewer {
    fn logic(&mut self, ctx: &egui::Context, _: &mut eframe::Frame) {
        self.listen(ctx);
        self.ask_before_closing(ctx);
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        self.drawn += 1;
        self.take_dropped(&ctx);
        self.take_keys(&ctx);
        self.play(&ctx);
        Panel::top("menu").show(ui, |ui| self.menu(ui));
        Panel::bottom("status").show(ui, |ui| {
            self.timeline(ui);
            panels::messages(ui, &mut self.messages);
            self.probe(ui);
            panels::exports(ui, &self.exports);
            panels::status(
                ui,
                self.shot.as_ref(),
                self.lit.as_deref(),
                self.latencies.last().copied(),
                self.reading > 0,
            );
        });
        Panel::right("side").default_size(330.0).min_size(260.0).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| self.side(ui));
        });
        Panel::top("views").show(ui, |ui| self.toolbar(ui));
        CentralPanel::no_frame().show(ui, |ui| self.show_picture(ui));
        self.questions(ui);
        self.title(&ctx);
        self.order(&ctx);
        self.keep(&ctx);
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        self.preferences.theme = self.theme;
        self.preferences.save(storage);
    }

    fn on_exit(&mut self) {
        self.tell_latencies();
        // what is being written is written to its end
        self.shot.iter().for_each(Shot::finish_saving);
        for export in &self.exports {
            if export.progress().1 > 1 {
                export.stop(); // whoever closes the window was asked
            }
            match export.finish_within(WRITTEN_WITHIN) {
                Ok(()) | Err(Error::Cancelled) => {}
                Err(error) => eprintln!("error: {error}"),
            }
        }
        // saved, or given up; whatever else ends the window leaves them for the next time
        let Some(autosave) = &self.autosave else { return };
        if self.recovered.is_some() {
            return; // what is there has not been seen yet
        }
        if self.may_close || !self.document.is_changed() {
            autosave.forget();
        } else if let Err(error) = autosave.keep(&self.document.whole()) {
            eprintln!("error: {error}");
        }
    }
}

impl Viewer {
    fn take_dropped(&mut self, ctx: &egui::Context) {
        let dropped: Vec<PathBuf> =
            ctx.input(|input| input.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        for path in dropped {
            self.open(ctx, path);
        }
    }

    fn take_keys(&mut self, ctx: &egui::Context) {
        if self.question.is_open() || self.pending.is_some() || self.picture.is_held() {
            return;
        }
        if let Some(command) = self.after_typing.take() {
            self.run(ctx, command);
        }
        let types = ctx.egui_wants_keyboard_input();
        let drags = ctx.input(|input| input.pointer.any_down());
        for (command, key) in Command::keys() {
            // letters alone belong to whoever types, and a value that is dragged to one frame
            let waits = (types && !key.modifiers.any()) || (drags && command.is_of_time());
            // taken also where there is nothing to do: else a shorter combination would be
            if waits || !ctx.input_mut(|input| input.consume_shortcut(&key)) {
                continue;
            }
            if types && matches!(command, Command::Save | Command::SaveAs | Command::Close) {
                // what is being typed is to be in it: it is taken up once its field is left
                ctx.memory_mut(|memory| memory.focused().map(|id| memory.surrender_focus(id)));
                ctx.request_repaint();
                self.after_typing = Some(command);
            } else if self.can(command) {
                self.run(ctx, command);
            }
        }
    }

    /// Goes on playing, where nothing is held.
    fn play(&mut self, ctx: &egui::Context) {
        let Some(playing) = &mut self.playing else { return };
        let held = ctx.input(|input| input.pointer.any_down()) || ctx.text_edit_focused();
        if held {
            // what is dragged or typed is so at one frame
            *playing = Playing::from(self.document.frame());
        } else if !playing.go_on(&mut self.document, self.preferences.rate) {
            self.playing = None;
        }
        ctx.request_repaint_after(Duration::from_secs_f32(0.5 / self.preferences.rate));
    }

    fn timeline(&mut self, ui: &mut Ui) {
        let playing = self.playing.is_some();
        let asked = panels::timeline(ui, &mut self.document, playing, &mut self.preferences.rate);
        if let Some(command) = asked {
            let ctx = ui.ctx().clone();
            self.run(&ctx, command);
        }
    }

    /// A line of a menu.
    fn item(&mut self, ui: &mut Ui, command: Command) {
        let enabled = self.can(command);
        let mut button = Button::new(command.name());
        if let Some(key) = command.key() {
            button = button.shortcut_text(ui.ctx().format_shortcut(&key));
        }
        if ui.add_enabled(enabled, button).on_hover_text(command.explanation()).clicked() {
            let ctx = ui.ctx().clone();
            self.run(&ctx, command);
            ui.close();
        }
    }

    fn menu(&mut self, ui: &mut Ui) {
        MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| self.file_menu(ui));
            ui.menu_button("Edit", |ui| {
                for (command, of) in
                    [(Command::Undo, self.document.undoes()), (Command::Redo, self.document.redoes())]
                        .map(|(command, of)| (command, of.map(str::to_owned)))
                {
                    let enabled = of.is_some();
                    let text = of.map_or(command.name().to_owned(), |of| format!("{} {of}", command.name()));
                    let key = command.key().map(|key| ui.ctx().format_shortcut(&key)).unwrap_or_default();
                    if ui.add_enabled(enabled, Button::new(text).shortcut_text(key)).clicked() {
                        let ctx = ui.ctx().clone();
                        self.run(&ctx, command);
                        ui.close();
                    }
                }
            });
            ui.menu_button("Light", |ui| {
                self.item(ui, Command::Duplicate);
                self.item(ui, Command::Delete);
                ui.separator();
                self.item(ui, Command::Key);
                for command in [Command::Play, Command::FrameBefore, Command::FrameAfter] {
                    self.item(ui, command);
                }
                ui.separator();
                for tool in [Tool::Aim, Tool::Highlight, Tool::SHADOW] {
                    self.item(ui, Command::Tool(tool));
                }
                self.item(ui, Command::LookThrough);
            });
            ui.menu_button("View", |ui| {
                for command in
                    [Command::Fit, Command::Actual, Command::Wipe, Command::ShowLights, Command::Snapshot]
                {
                    self.item(ui, command);
                }
                ui.separator();
                for theme in
                    [egui::ThemePreference::Dark, egui::ThemePreference::Light, egui::ThemePreference::System]
                {
                    if ui.selectable_value(&mut self.theme, theme, format!("{theme:?} theme")).clicked() {
                        ui.ctx().set_theme(theme);
                        ui.close();
                    }
                }
            });
            ui.menu_button("Help", |ui| self.item(ui, Command::Help));
        });
    }

    fn file_menu(&mut self, ui: &mut Ui) {
        for command in [Command::OpenShot, Command::OpenRig] {
            self.item(ui, command);
        }
        let recent = self.preferences.recent.clone();
        ui.add_enabled_ui(!recent.is_empty(), |ui| {
            ui.menu_button("Open recent", |ui| {
                for path in recent {
                    if ui.button(path.display().to_string()).clicked() {
                        let ctx = ui.ctx().clone();
                        self.open(&ctx, path);
                        ui.close();
                    }
                }
            });
        });
        ui.separator();
        self.item(ui, Command::Save);
        self.item(ui, Command::SaveAs);
        ui.separator();
        self.item(ui, Command::ExportImage);
        self.item(ui, Command::ExportSequence);
        ui.checkbox(&mut self.preferences.per_light, "Layers of each light in EXR")
            .on_hover_text("What is exported as .exr has direct and indirect light of each light as well");
        ui.separator();
        self.item(ui, Command::Close);
    }

    fn toolbar(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            self.choose_view(ui, 0, "Show");
            let mut wipes = self.picture.wipe.is_some();
            if ui.checkbox(&mut wipes, "Wipe").on_hover_text(Command::Wipe.explanation()).changed() {
                let ctx = ui.ctx().clone();
                self.run(&ctx, Command::Wipe);
            }
            if wipes {
                self.choose_view(ui, 1, "Beside");
            }
            ui.separator();
            let name = ui.label("Exposure");
            let exposure = &mut self.document.rig.exposure;
            panels::exact(ui, exposure, 2, |drag| drag.speed(0.02).range(EXPOSURES).suffix(" stops"))
                .labelled_by(name.id)
                .on_hover_text("Of the picture, not of its light");
            ComboBox::from_id_salt("curve")
                .selected_text(self.preferences.curve.name())
                .width(70.0)
                .show_ui(ui, |ui| {
                    for (curve, name, what) in Curve::ALL {
                        ui.selectable_value(&mut self.preferences.curve, curve, name).on_hover_text(what);
                    }
                })
                .response
                .on_hover_text("Tone curve: how light becomes a picture");
            ui.separator();
            for (tool, name) in [(Tool::Aim, "Aim"), (Tool::Highlight, "Highlight"), (Tool::SHADOW, "Shadow")]
            {
                let active = std::mem::discriminant(&self.picture.tool) == std::mem::discriminant(&tool);
                let command = Command::Tool(tool);
                let button =
                    ui.add_enabled(self.document.selected.is_some(), Button::selectable(active, name));
                if button.on_hover_text(command.explanation()).clicked() {
                    self.picture.tool = if active { Tool::Select } else { tool };
                }
            }
            ui.separator();
            let through = ui.selectable_label(self.picture.inset.is_open, "Through");
            if through.on_hover_text(Command::LookThrough.explanation()).clicked() {
                let ctx = ui.ctx().clone();
                self.run(&ctx, Command::LookThrough);
            }
            self.tell_truth(ui);
        });
    }

    /// How good the reference is by now, while it is looked at.
    fn tell_truth(&self, ui: &mut Ui) {
        let shows = |view: &View| *view == View::Reference;
        if !self.looks_at(shows) {
            return;
        }
        ui.separator();
        match &self.truth {
            _ if self.scene.is_none() => {
                ui.label("a cache has no scene to path trace: open the scene");
            }
            None => {
                ui.spinner();
                ui.label("path tracing");
            }
            Some(truth) => {
                let off = self
                    .off
                    .as_ref()
                    .filter(|_| self.reference_is_current())
                    .map_or("of earlier lights".to_owned(), |(_, _, error)| {
                        format!("off by {:.1}%", 100.0 * error)
                    });
                let text =
                    format!("reference: {} paths, noise {:.1}%; {off}", truth.paths, 100.0 * truth.noise);
                ui.label(text).on_hover_text("Relative L2 of the relit image against it. Its own noise is in that figure: wait until it is small");
            }
        }
    }

    fn choose_view(&mut self, ui: &mut Ui, side: usize, name: &str) {
        let mut view = self.views[side].clone();
        let label = ui.label(name);
        let lights: Vec<View> =
            self.document.rig.lights.iter().map(|light| View::Light(light.name.clone())).collect();
        let stored = self.snapshots.iter().map(|snapshot| View::Snapshot(snapshot.number));
        let others: Vec<View> = lights.into_iter().chain(stored).collect();
        ComboBox::from_id_salt(name)
            .selected_text(view.name())
            .width(86.0)
            .height(500.0)
            .show_ui(ui, |ui| {
                for choice in PLAIN.into_iter().chain(others) {
                    let (text, what) = (choice.name(), choice.explanation());
                    ui.selectable_value(&mut view, choice, text).on_hover_text(what);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(view.explanation());
        self.views[side] = view;
    }

    fn side(&mut self, ui: &mut Ui) {
        if let Some(histogram) = &self.histogram {
            panels::histogram(ui, histogram);
        }
        ui.add_space(4.0);
        ui.heading("Lights");
        let stage = self.stage();
        if let Some(fault) = panels::lights(ui, &mut self.document, stage, &mut self.renaming) {
            self.messages.warn(fault);
        }
        // a light that is shown alone may be gone, or have another name
        let lights = &self.document.rig.lights;
        let gone = |view: &&mut View| matches!(view, View::Light(name) if lights.iter().all(|light| light.name != *name));
        self.views.iter_mut().filter(gone).for_each(|view| *view = View::Full);
        ui.separator();
        let measure = &mut self.preferences.measure;
        if let Some(light) = self.document.selected_light() {
            ui.strong(format!("{} ({})", light.name, NewLight::of(light).name().to_lowercase()));
            match panels::fields(ui, light, measure) {
                MapWish::None => {}
                MapWish::Remove => {
                    if let LightKind::Dome { map, .. } = &mut light.kind {
                        *map = None;
                    }
                }
                MapWish::Choose => {
                    let folder =
                        self.document.path().and_then(Path::parent).unwrap_or(Path::new("")).to_owned();
                    self.question.ask(ui.ctx(), self.options.dialogs, Purpose::Map, &folder);
                }
            }
        }
        CollapsingHeader::new("Motion")
            .default_open(self.document.frames().is_some())
            .show(ui, |ui| panels::motion(ui, &mut self.document));
        let Some(report) = self.report().cloned() else { return };
        ui.separator();
        if !self.emissive.is_empty() {
            let header = CollapsingHeader::new("Emitters").default_open(true);
            header.show(ui, |ui| panels::emitters(ui, &mut self.document.rig, &report, &self.emissive));
        }
        let header = CollapsingHeader::new("Materials");
        header.show(ui, |ui| panels::materials(ui, &mut self.document.rig, &report, &self.shown_materials));
        if !self.snapshots.is_empty() {
            CollapsingHeader::new("Snapshots").default_open(true).show(ui, |ui| self.list_snapshots(ui));
        }
    }

    fn list_snapshots(&mut self, ui: &mut Ui) {
        let mut dropped = None;
        for snapshot in &self.snapshots {
            let view = View::Snapshot(snapshot.number);
            ui.horizontal(|ui| {
                if ui.button(view.name()).on_hover_text("Show it beside the picture").clicked() {
                    self.views[1] = view.clone();
                    self.picture.wipe = self.picture.wipe.or(Some(0.5));
                }
                if panels::cross(ui, &format!("Forget {}", view.name())) {
                    dropped = Some(snapshot.number);
                }
            });
        }
        if let Some(number) = dropped {
            self.snapshots.retain(|snapshot| snapshot.number != number);
            let gone = View::Snapshot(number);
            self.views.iter_mut().filter(|view| **view == gone).for_each(|view| *view = View::Full);
        }
    }

    fn probe(&self, ui: &mut Ui) {
        let text = self
            .picture
            .probe
            .zip(self.lit.as_deref())
            .and_then(|(pixel, lit)| panels::probe_text(lit, pixel));
        // a line that is always there, so that the picture does not jump
        ui.monospace(text.unwrap_or_else(|| " ".to_owned()));
    }

    /// What a pane is called, and that it is not there where it is not.
    fn pane_name(&self, side: usize) -> String {
        let view = &self.views[side];
        match view {
            View::Reference if self.scene.is_none() => format!("{}: no scene to trace", view.name()),
            View::Reference if self.truth.is_none() => format!("{}: not there yet", view.name()),
            _ => view.name(),
        }
    }

    fn show_picture(&mut self, ui: &mut Ui) {
        let around = Around {
            lit: self.lit.as_ref(),
            anchor: self.stage().center,
            names: [self.pane_name(0), self.pane_name(1)],
            in_stops: self.views[0] == View::Luminance,
            is_open: self.shot.as_ref().is_some_and(|shot| shot.stage() != Stage::Stopped),
            eye: self.eye(),
        };
        self.picture.ui(ui, &mut self.document, &around);
    }

    fn title(&mut self, ctx: &egui::Context) {
        let star = if self.document.is_changed() { "*" } else { "" };
        let shot = self.shot.as_ref().and_then(|shot| shot.source().path.file_name());
        let shot = shot.map_or(String::new(), |shot| format!(" - {}", shot.to_string_lossy()));
        let title = format!("{star}{}{shot} - Relume", self.document.name());
        if title != self.shown_title {
            ctx.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.shown_title = title;
        }
    }
}
