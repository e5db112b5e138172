//! What is around the picture.

mod bars;
mod color;
mod fields;
mod histogram;
mod lights;
mod surfaces;
mod timeline;

use eframe::egui::{DragValue, Event, Key, Response, Role, Ui, WidgetInfo};

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
    let id = response.id.with("typed");
    if response.gained_focus() {
        ui.data_mut(|data| data.remove::<bool>(id));
    }
    if (response.has_focus() || response.lost_focus()) && ui.input(|input| input.events.iter().any(types)) {
        ui.data_mut(|data| data.insert_temp(id, true));
    }
    if response.lost_focus() && !ui.data_mut(|data| data.remove_temp::<bool>(id)).unwrap_or(false) {
        *value = before;
    }
    response
}

/// Whether an event changes a text.
fn types(event: &Event) -> bool {
    let erases = |key: &Key| matches!(key, Key::Backspace | Key::Delete);
    match event {
        Event::Text(_) | Event::Paste(_) | Event::Cut | Event::Ime(_) => true,
        Event::Key { key, pressed, .. } => *pressed && erases(key),
        _ => false,
    }
}

/// A small button that takes something away; whether it was clicked.
pub(crate) fn cross(ui: &mut Ui, what: &str) -> bool {
    let response = ui.small_button("x").on_hover_text(what);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, what));
    response.clicked()
}
