//! What is around the picture.

mod bars;
mod color;
mod fields;
mod histogram;
mod lights;
mod surfaces;
mod timeline;

use eframe::egui::{DragValue, Response, Role, Ui, WidgetInfo};

pub(crate) use bars::{exports, messages, probe_text, status};
pub(crate) use color::Measure;
pub(crate) use fields::{MapWish, fields};
pub(crate) use histogram::histogram;
pub(crate) use lights::{Renaming, lights};
pub(crate) use surfaces::{emitters, materials};
pub(crate) use timeline::{Playing, motion, timeline};

/// Gives a number a name of its own, for those who hear the window instead of seeing it.
pub(crate) fn number(response: Response, name: &str) -> Response {
    response.widget_info(|| WidgetInfo::labeled(Role::SpinButton, true, name));
    response
}

/// A number that is dragged or typed, shown with so many decimals at most. Whoever clicks into it and leaves it again has changed nothing, however many digits it has.
pub(crate) fn exact(
    ui: &mut Ui,
    value: &mut f32,
    decimals: usize,
    how: impl FnOnce(DragValue<'_>) -> DragValue<'_>,
) -> Response {
    let before = *value;
    let drag = DragValue::new(&mut *value).clamp_existing_to_range(false).max_decimals(decimals);
    let response = ui.add(how(drag));
    let shown = |value: f32| format!("{value:.decimals$}");
    if response.lost_focus() && shown(*value) == shown(before) {
        *value = before;
    }
    response
}

/// A small button that takes something away; whether it was clicked.
pub(crate) fn cross(ui: &mut Ui, what: &str) -> bool {
    let response = ui.small_button("x").on_hover_text(what);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, what));
    response.clicked()
}
