//! The list of lights.

use eframe::egui::{self, Button, Key, Role, Sense, TextEdit, Ui, WidgetInfo};

use crate::document::{Document, NewLight, Stage};

/// A name that is being typed: the light's name as it is, and the text so far.
pub(crate) type Renaming = Option<(String, String)>;

/// The list, with what can be done to it. Returns what is wrong with a name that was typed.
pub(crate) fn lights(
    ui: &mut Ui,
    document: &mut Document,
    stage: Stage,
    renaming: &mut Renaming,
) -> Option<String> {
    let mut fault = None;
    ui.horizontal(|ui| {
        ui.menu_button("Add", |ui| {
            for kind in NewLight::ALL {
                if ui.button(kind.name()).on_hover_text(kind.explanation()).clicked() {
                    document.add(kind, stage);
                    ui.close();
                }
            }
        })
        .response
        .on_hover_text("Add a light where it shows");
        let selected = document.selected.is_some();
        let button = |ui: &mut Ui, text: &str, what: &str| {
            ui.add_enabled(selected, Button::new(text)).on_hover_text(what).clicked()
        };
        if button(ui, "Duplicate", "Add a copy of the selected light (Ctrl+D)") {
            document.duplicate();
        }
        if button(ui, "Delete", "Delete the selected light (Del)") {
            document.delete();
        }
    });
    let mut moved = None;
    for index in 0..document.rig.lights.len() {
        let (from, to) = row(ui, document, index, renaming, &mut fault);
        moved = moved.or(from.zip(to));
    }
    if renaming.as_ref().is_some_and(|(name, _)| document.place(name).is_none()) {
        *renaming = None;
    }
    if let Some((from, to)) = moved {
        document.reorder(from, to);
    }
    if document.rig.lights.is_empty() {
        ui.weak("No lights yet: add one.");
    }
    fault
}

/// One light. Returns from where a light was dropped on it, and its own place then.
fn row(
    ui: &mut Ui,
    document: &mut Document,
    index: usize,
    renaming: &mut Renaming,
    fault: &mut Option<String>,
) -> (Option<usize>, Option<usize>) {
    let mut dropped = (None, None);
    ui.push_id(index, |ui| {
        let response = ui.horizontal(|ui| {
            let selected = document.selected == Some(index);
            let Some(light) = document.rig.lights.get_mut(index) else { return };
            let name = light.name.clone();
            let enable = format!("Enable {name}");
            let checkbox = ui.checkbox(&mut light.enabled, "").on_hover_text(&enable);
            checkbox.widget_info(|| WidgetInfo::selected(Role::CheckBox, true, light.enabled, &enable));
            let alone = document.solo.as_deref() == Some(&name);
            let solo = ui.selectable_label(alone, "S").on_hover_text(format!("Solo {name}: show it alone"));
            solo.widget_info(|| WidgetInfo::selected(Role::Button, true, alone, format!("Solo {name}")));
            if solo.clicked() {
                document.solo = (!alone).then(|| name.clone());
            }
            if renaming.as_ref().is_some_and(|(renamed, _)| *renamed == name) {
                rename(ui, document, renaming, fault);
                return;
            }
            let label = ui.add(Button::selectable(selected, &name).sense(Sense::click_and_drag()));
            let label = label.on_hover_text("Click selects, a double click renames, dragging reorders");
            if label.clicked() {
                document.selected = Some(index);
            }
            if label.double_clicked() {
                *renaming = Some((name.clone(), name));
            }
            label.dnd_set_drag_payload(Row(index));
        });
        let response = response.response.interact(Sense::hover());
        if let Some(from) = response.dnd_release_payload::<Row>() {
            dropped = (Some(from.0), Some(index));
        }
        if response.dnd_hover_payload::<Row>().is_some() {
            let stroke = ui.visuals().selection.stroke;
            // where it would be dropped
            let below = response.dnd_hover_payload::<Row>().is_some_and(|row| row.0 < index);
            let y = if below { response.rect.bottom() } else { response.rect.top() };
            ui.painter().hline(response.rect.x_range(), y, stroke);
        }
    });
    dropped
}

/// A row that is being dragged.
#[derive(Clone, Copy)]
struct Row(usize);

fn rename(ui: &mut Ui, document: &mut Document, renaming: &mut Renaming, fault: &mut Option<String>) {
    let Some((name, text)) = renaming else { return };
    let edit = ui.add(TextEdit::singleline(text).desired_width(140.0)).on_hover_text("Name of the light");
    if ui.input(|input| input.key_pressed(Key::Escape)) {
        *renaming = None;
    } else if edit.lost_focus() {
        // the list may have changed under it
        *fault = document.place(name).and_then(|index| document.rename(index, text).err());
        *renaming = None;
    } else if !edit.has_focus() {
        edit.request_focus();
        select_all(ui, edit.id, text.chars().count());
    }
}

fn select_all(ui: &Ui, id: egui::Id, length: usize) {
    use egui::text::{CCursor, CCursorRange};
    let mut state = TextEdit::load_state(ui.ctx(), id).unwrap_or_default();
    state.cursor.set_char_range(Some(CCursorRange::two(CCursor::new(0), CCursor::new(length))));
    state.store(ui.ctx(), id);
}
