//! What is around the picture.

mod bars;
mod color;
mod fields;
mod histogram;
mod lights;
mod surfaces;
mod timeline;

use eframe::egui::{Response, Role, Ui, WidgetInfo};

pub(crate) use bars::{exports, messages, probe_text, status};
pub(crate) use color::Measure;
pub(crate) use fields::{MapWish, fields};
pub(crate) use histogram::histogram;
pub(crate) use lights::{Renaming, lights};
pub(crate) use surfaces::{emitters, materials};
pub(crate) use timeline::{Playing, motion, play, timeline};

/// Gives a number a name of its own, for those who hear the window instead of seeing it.
pub(crate) fn number(response: Response, name: &str) -> Response {
    response.widget_info(|| WidgetInfo::labeled(Role::SpinButton, true, name));
    response
}

/// A small button that takes something away; whether it was clicked.
pub(crate) fn cross(ui: &mut Ui, what: &str) -> bool {
    let response = ui.small_button("x").on_hover_text(what);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, what));
    response.clicked()
}
