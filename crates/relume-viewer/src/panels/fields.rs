//! Every field of a light.

use std::ops::RangeInclusive;

use eframe::egui::{Grid, Response, Ui};
use relume::glam::Vec3;
use relume::{Light, LightKind};

use super::color::{self, Measure};

/// Where lights may be put by typing, metres.
const FAR: f32 = 1e6;

/// The fields of one light. Returns whether another map is wanted for a dome.
pub(crate) fn fields(ui: &mut Ui, light: &mut Light, measure: &mut Measure) -> MapWish {
    let mut wish = MapWish::None;
    let grid = Grid::new("fields").num_columns(2).spacing([10.0, 6.0]);
    ui.push_id(light.name.clone(), |ui| {
        grid.show(ui, |ui| match &mut light.kind {
            LightKind::Omni { position, intensity, radius } => {
                color::light(ui, intensity, "W/sr", measure);
                triple(ui, "Position", "metres, world space", position, 0.01);
                length(ui, "Radius", RADIUS, radius);
            }
            LightKind::Spot { position, target, intensity, inner_angle, outer_angle, radius } => {
                color::light(ui, intensity, "W/sr", measure);
                let (from, to) = (*position, *target);
                triple(ui, "Position", "metres, world space", position, 0.01);
                triple(ui, "Target", "metres, world space: what the spot points at", target, 0.01);
                if *position == *target {
                    (*position, *target) = (from, to); // between them is the way it shines
                }
                let inner = "Within this angle from the axis it shines in full";
                if angle(ui, "Inner angle", inner, inner_angle, 0.0..=90.0).changed() {
                    *outer_angle = outer_angle.max(*inner_angle).max(0.1);
                }
                let outer = "Beyond this angle from the axis it does not shine";
                if angle(ui, "Outer angle", outer, outer_angle, 0.1..=90.0).changed() {
                    *inner_angle = inner_angle.min(*outer_angle);
                }
                length(ui, "Radius", RADIUS, radius);
            }
            LightKind::Distant { direction, irradiance, angle: diameter } => {
                color::light(ui, irradiance, "W/m²", measure);
                let was = *direction;
                triple(ui, "Direction", "the way the light travels, of any length", direction, 0.01);
                if direction.try_normalize().is_none() {
                    *direction = was;
                }
                let wide = "Diameter of the disc it comes from: the sun's is 0.53; 0 gives hard shadows";
                angle(ui, "Angle", wide, diameter, 0.0..=180.0);
            }
            LightKind::Dome { map, intensity, rotation } => {
                let unit = if map.is_some() { "times the map" } else { "W/(sr m²)" };
                color::light(ui, intensity, unit, measure);
                ui.label("Map");
                ui.horizontal(|ui| {
                    let name = map.as_ref().map_or("none: the same from everywhere", |map| map.name());
                    if ui.button("Choose ...").on_hover_text("An equirectangular map, .hdr or .exr").clicked()
                    {
                        wish = MapWish::Choose;
                    }
                    if map.is_some() && ui.button("None").on_hover_text("Leave out the map").clicked() {
                        wish = MapWish::Remove;
                    }
                    ui.label(name);
                });
                ui.end_row();
                let about = "By how much the map is turned about the vertical, from +Z towards +X";
                angle(ui, "Rotation", about, rotation, -3600.0..=3600.0);
            }
        });
    });
    wish
}

const RADIUS: &str = "Of the ball that shines, metres: larger gives softer shadows, 0 hard ones";

/// What is wanted of a dome's map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MapWish {
    None,
    Choose,
    Remove,
}

fn triple(ui: &mut Ui, name: &str, what: &str, value: &mut Vec3, speed: f64) {
    ui.label(name).on_hover_text(format!("{name}, {what}"));
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for (axis, component) in ["X", "Y", "Z"].into_iter().zip(value.as_mut()) {
            let was = *component;
            let response = super::exact(ui, component, 3, |drag| {
                drag.speed(speed).range(-FAR..=FAR).update_while_editing(false).prefix(format!("{axis} "))
            });
            super::number(response, &format!("{name} {axis}"))
                .on_hover_text(format!("{name} {axis}, {what}"));
            if *component != was {
                *component = component.clamp(-FAR, FAR); // arrow keys step past the range
            }
        }
    });
    ui.end_row();
}

fn length(ui: &mut Ui, name: &str, what: &str, value: &mut f32) {
    let label = ui.label(name);
    let was = *value;
    let response = super::exact(ui, value, 3, |drag| {
        drag.speed(0.002).range(0.0..=FAR).update_while_editing(false).suffix(" m")
    });
    response.labelled_by(label.id).on_hover_text(what);
    if *value != was {
        *value = value.clamp(0.0, FAR);
    }
    ui.end_row();
}

fn angle(ui: &mut Ui, name: &str, what: &str, value: &mut f32, range: RangeInclusive<f32>) -> Response {
    let label = ui.label(name);
    let was = *value;
    let response = super::exact(ui, value, 2, |drag| {
        drag.speed(0.2).range(range.clone()).update_while_editing(false).suffix("°")
    });
    let response = response.labelled_by(label.id).on_hover_text(what);
    if *value != was {
        *value = value.clamp(*range.start(), *range.end());
    }
    ui.end_row();
    response
}
