//! What is asked before something is lost, and help.

use eframe::egui::{self, Key, Modal, ScrollArea, Ui, ViewportCommand};

use super::{Pending, Viewer};
use crate::command::Command;
use crate::panels;

impl Viewer {
    /// Whatever is asked at the moment.
    pub(super) fn questions(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        if let Some((purpose, path)) = self.question.answer(ui) {
            self.answer(&ctx, purpose, path);
        }
        match self.pending {
            Some(Pending::Frames) => self.ask_to_stop(ui),
            Some(_) if !self.question.is_open() => self.ask_to_save(ui),
            _ => {}
        }
        if self.shows_help {
            let close = Modal::new(egui::Id::unique("help")).show(&ctx, help).should_close();
            self.shows_help = !close;
        }
    }

    /// Keeps the window open where there are unsaved edits, until it is known what shall become of them. Also where it is hidden, and nothing is drawn.
    pub(super) fn ask_before_closing(&mut self, ctx: &egui::Context) {
        if !ctx.input(|input| input.viewport().close_requested()) || self.may_close {
            return;
        }
        self.document.note();
        if self.document.is_changed() || self.writes_a_sequence() {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            ctx.send_viewport_cmd(ViewportCommand::Minimized(false));
            ctx.send_viewport_cmd(ViewportCommand::Focus);
            self.pending = Some(Pending::Close);
        }
    }

    fn writes_a_sequence(&self) -> bool {
        self.exports.iter().any(|export| export.progress().1 > 1)
    }

    /// Whether the frames that are still being written shall be waited for, before the window closes.
    fn ask_to_stop(&mut self, ui: &mut Ui) {
        let mut go_on = !self.writes_a_sequence();
        if !go_on {
            Modal::new(egui::Id::unique("frames")).show(ui.ctx(), |ui| {
                ui.heading("Frames are still being written");
                panels::exports(ui, &self.exports);
                ui.weak("The window closes once they are there");
                ui.horizontal(|ui| {
                    go_on = ui.button("Stop and close").clicked();
                    if ui.button("Keep it open").clicked() || ui.input(|input| input.key_pressed(Key::Escape))
                    {
                        self.pending = None;
                    }
                });
            });
        }
        if go_on {
            self.close(ui.ctx());
        }
    }

    fn close(&mut self, ctx: &egui::Context) {
        self.pending = None;
        self.may_close = true;
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }

    /// What shall become of unsaved edits, before something takes their place.
    fn ask_to_save(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let mut go_on = !self.document.is_changed();
        if !go_on {
            Modal::new(egui::Id::unique("unsaved")).show(&ctx, |ui| {
                ui.heading(format!("Save the changes to {}?", self.document.name()));
                ui.horizontal(|ui| {
                    if ui.button("Save").clicked() {
                        self.run(&ctx, Command::Save);
                    }
                    go_on = ui.button("Discard").clicked();
                    if ui.button("Cancel").clicked() || ui.input(|input| input.key_pressed(Key::Escape)) {
                        self.pending = None;
                    }
                });
            });
        }
        if !go_on {
            return;
        }
        match self.pending.take() {
            Some(Pending::Close | Pending::Frames) if self.writes_a_sequence() => {
                self.pending = Some(Pending::Frames);
            }
            Some(Pending::Close | Pending::Frames) => self.close(&ctx),
            Some(Pending::Rig(path)) => self.open_rig(&ctx, path),
            None => {}
        }
    }
}

/// Every key, and what the pointer does.
fn help(ui: &mut Ui) {
    ui.set_width(560.0);
    ui.heading("Keys and pointer");
    let height = ui.ctx().content_rect().height() - 140.0;
    ScrollArea::vertical().max_height(height.max(100.0)).show(ui, |ui| {
        egui::Grid::new("keys").num_columns(4).striped(true).show(ui, |ui| {
            let keys: Vec<_> = Command::keys().collect();
            let half = keys.len().div_ceil(2);
            for row in 0..half {
                for (command, key) in [keys.get(row), keys.get(row + half)].into_iter().flatten() {
                    ui.monospace(ui.ctx().format_shortcut(key));
                    ui.label(command.name()).on_hover_text(command.explanation());
                }
                ui.end_row();
            }
        });
        ui.separator();
        egui::Grid::new("pointer").num_columns(2).striped(true).show(ui, |ui| {
            for (pointer, what) in [
                ("wheel, pinch", "Zoom at the pointer"),
                ("drag", "Move the picture; at a handle, move or turn the selected light"),
                ("right or middle drag", "Move the picture, with every tool"),
                ("click on a light", "Select it"),
                ("Esc", "End a tool; during a drag, take it back"),
            ] {
                ui.monospace(pointer);
                ui.label(what);
                ui.end_row();
            }
        });
    });
    ui.add_space(6.0);
    if ui.button("Close").clicked() {
        ui.close();
    }
}
