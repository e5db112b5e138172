//! What emits, and base colours of materials.

use eframe::egui::{Button, Grid, Role, Ui, WidgetInfo, color_picker};
use relume::glam::Vec3;
use relume::transfer::Report;
use relume::{Emitter, LightRig, MaterialEdit};

/// How much brighter what emits may be made.
const BRIGHTEST: f32 = 1e4;

/// Materials that emit, and by what their light is multiplied. `shining` are their numbers.
pub(crate) fn emitters(ui: &mut Ui, rig: &mut LightRig, report: &Report, shining: &[u32]) {
    Grid::new("emitters").num_columns(4).show(ui, |ui| {
        for name in shining.iter().filter_map(|&number| report.materials.get(number as usize)) {
            let edit = rig.emitters.iter().position(|emitter| emitter.material == *name);
            let was = edit.map_or(Vec3::ONE, |index| rig.emitters[index].scale);
            let mut scale = was;
            ui.label(name);
            let (mut strength, hue) =
                (scale.max_element(), scale / scale.max_element().max(f32::MIN_POSITIVE));
            let hue = if strength > 0.0 { hue } else { Vec3::ONE };
            let now = strength;
            let response = super::exact(ui, &mut strength, 3, |drag| {
                drag.speed(0.01).range(0.0..=BRIGHTEST).prefix("x ")
            });
            let what = format!("{name}: times what it emits in the scene");
            super::number(response, &what).on_hover_text(what);
            if strength != now {
                scale = hue * strength.clamp(0.0, BRIGHTEST); // arrow keys step past the range
            }
            let mut rgb = hue.to_array();
            let picker = color_picker::color_edit_button_rgb(ui, &mut rgb);
            if picker.on_hover_text(format!("{name}: colour, times that of the scene")).changed() {
                scale = Vec3::from(rgb) * strength;
            }
            if reset(ui, edit.is_some(), name) {
                rig.emitters.retain(|emitter| emitter.material != *name);
            } else if scale != was {
                match edit {
                    Some(index) => rig.emitters[index].scale = scale,
                    None => rig.emitters.push(Emitter { material: name.clone(), scale }),
                }
            }
            ui.end_row();
        }
    });
}

/// Materials that show, and their base colours. `shown` are their numbers.
pub(crate) fn materials(ui: &mut Ui, rig: &mut LightRig, report: &Report, shown: &[u32]) {
    Grid::new("materials").num_columns(3).show(ui, |ui| {
        for &number in shown {
            let (Some(name), Some(&own)) =
                (report.materials.get(number as usize), report.base_colors.get(number as usize))
            else {
                continue;
            };
            let edit = rig.materials.iter().position(|edit| edit.name == *name);
            let was = edit.map_or(own, |index| rig.materials[index].base_color.to_array());
            let mut rgb = was;
            ui.label(name);
            let picker = color_picker::color_edit_button_rgb(ui, &mut rgb);
            picker.on_hover_text(format!("{name}: base colour, linear; textures stay"));
            if reset(ui, edit.is_some(), name) {
                rig.materials.retain(|edit| edit.name != *name);
            } else if rgb != was {
                let base_color = Vec3::from(rgb).clamp(Vec3::ZERO, Vec3::ONE);
                match edit {
                    Some(index) => rig.materials[index].base_color = base_color,
                    None => rig.materials.push(MaterialEdit { name: name.clone(), base_color }),
                }
            }
            ui.end_row();
        }
    });
}

fn reset(ui: &mut Ui, edited: bool, name: &str) -> bool {
    let what = format!("{name} as in the scene");
    let response = ui.add_enabled(edited, Button::new("Reset").small()).on_hover_text(&what);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, edited, &what));
    response.clicked()
}
