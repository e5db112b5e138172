//! Colours of light: a hue, and how much of it.

use eframe::egui::{self, Ui, color_picker};
use relume::glam::Vec3;
use relume::scene::{TEMPERATURES, black_body_color, nearest_temperature};

/// How strong a light may be made here, in its unit.
const STRONGEST: f32 = 1e7;
/// Stops below 1 at which a light is black.
const DARKEST: f32 = -20.0;

/// In what light is measured out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Measure {
    /// In its own unit.
    #[default]
    Linear,
    /// In powers of two of that.
    Stops,
}

/// The strength of a colour, its largest channel, and the rest of it. Of black, the hue it had before.
fn parts(ui: &Ui, id: egui::Id, color: Vec3) -> (f32, Vec3) {
    let strength = color.max_element();
    let hue = if strength > 0.0 {
        color / strength
    } else {
        ui.data(|data| data.get_temp(id)).map_or(Vec3::ONE, Vec3::from_array)
    };
    ui.data_mut(|data| data.insert_temp(id, hue.to_array()));
    (strength, hue)
}

/// Rows of a grid in which a colour of light is edited. `unit` is what its channels are in.
pub(crate) fn light(ui: &mut Ui, color: &mut Vec3, unit: &str, measure: &mut Measure) {
    let (mut strength, mut hue) = parts(ui, ui.scope_id().with("hue"), *color);
    let (was, hue_was) = (strength, hue);

    let name = ui.label("Intensity");
    ui.horizontal(|ui| {
        match measure {
            Measure::Linear => {
                let speed = (f64::from(strength) * 0.01).max(1e-3);
                super::exact(ui, &mut strength, 4, |drag| drag.speed(speed).range(0.0..=STRONGEST))
                    .labelled_by(name.id)
            }
            Measure::Stops => {
                let now = strength.log2().max(DARKEST);
                let mut stops = now;
                let range = DARKEST..=STRONGEST.log2();
                let response = super::exact(ui, &mut stops, 2, |drag| drag.speed(0.02).range(range));
                let response = response.labelled_by(name.id);
                if stops != now {
                    strength = if stops <= DARKEST { 0.0 } else { stops.exp2() };
                }
                response
            }
        }
        .on_hover_text("Of the strongest channel; drag, or click and type");
        egui::ComboBox::from_id_salt("measure")
            .width(64.0)
            .selected_text(if *measure == Measure::Stops { "stops" } else { unit })
            .show_ui(ui, |ui| {
                ui.selectable_value(measure, Measure::Linear, unit);
                ui.selectable_value(measure, Measure::Stops, "stops")
                    .on_hover_text(format!("Powers of two of 1 {unit}"));
            })
            .response
            .on_hover_text("Unit of the intensity");
    });
    ui.end_row();

    let name = ui.label("Colour");
    ui.horizontal(|ui| {
        let mut rgb = hue.to_array();
        let picker = color_picker::color_edit_button_rgb(ui, &mut rgb).labelled_by(name.id);
        if picker.on_hover_text("Colour of the light, linear; its brightness is the intensity").changed() {
            let most = Vec3::from(rgb).max_element();
            hue = if most > 0.0 { Vec3::from(rgb) / most } else { hue };
        }
        let found = nearest_temperature(hue).unwrap_or(6500.0);
        let mut kelvin = found;
        let response = super::exact(ui, &mut kelvin, 0, |drag| drag.speed(20.0).range(TEMPERATURES).suffix(" K"));
        super::number(response, "Colour temperature").on_hover_text(
            "Colour temperature: 1900 is a candle, 2700 a lamp, 5500 noon, 10,000 a clear sky. For other colours, the nearest.",
        );
        if kelvin != found {
            hue = black_body_color(kelvin);
        }
    });
    ui.end_row();

    if (strength, hue) != (was, hue_was) {
        // arrow keys step past the range
        strength = if strength == was { was } else { strength.clamp(0.0, STRONGEST) };
        ui.data_mut(|data| data.insert_temp(ui.scope_id().with("hue"), hue.to_array()));
        *color = hue * strength;
    }
}
