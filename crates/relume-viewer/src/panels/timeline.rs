//! Frames and keys: the line below the picture, and what moves of a light.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::time::Instant;

use eframe::egui::{
    Align2, Button, Color32, ComboBox, DragValue, FontId, Painter, Pos2, Rect, Response, Role, Sense, Shape,
    Stroke, Ui, WidgetInfo, pos2, vec2,
};
use relume_io::{Field, Interpolation, Subject};

use crate::command::Command;
use crate::document::{Document, named};

/// Frames that are shown at least, so that there is a place to go to.
const SHORTEST: i32 = 24;
/// Frames are whole numbers from minus this to this, as in files.
const LAST: i32 = 1_000_000;
const HEIGHT: f32 = 30.0;
/// Frames in a second.
pub(crate) const RATES: RangeInclusive<f32> = 1.0..=120.0;

/// Time that goes on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Playing {
    began: Instant,
    from: i32,
    /// Where it was last.
    at: i32,
}

impl Playing {
    /// From that frame on.
    pub(crate) fn from(frame: i32) -> Self {
        Self { began: Instant::now(), from: frame, at: frame }
    }

    /// Goes to the frame that is due, at so many a second; from another one on where someone has gone there meanwhile. Whether it can go on.
    pub(crate) fn go_on(&mut self, document: &mut Document, rate: f32) -> bool {
        let Some(frames) = document.frames() else { return false };
        if document.frame() != self.at {
            *self = Self::from(document.frame());
        }
        let (first, last) = (i64::from(*frames.start()), i64::from(*frames.end()));
        let passed = (self.began.elapsed().as_secs_f32() * rate) as i64;
        let at = first + (i64::from(self.from) - first + passed).rem_euclid(last - first + 1);
        self.at = at as i32;
        document.go_to(self.at);
        document.frame() == self.at // else the rig cannot be there, which is told
    }
}

/// The line of frames. Returns what was asked for.
pub(crate) fn timeline(
    ui: &mut Ui,
    document: &mut Document,
    playing: bool,
    rate: &mut f32,
) -> Option<Command> {
    let mut asked = None;
    let frames = document.frames()?;
    ui.horizontal(|ui| {
        let mut jump = None;
        let mut button = |ui: &mut Ui, text: &str, what: &str, to: Option<i32>| {
            let button = ui.add_enabled(to.is_some(), Button::new(text).min_size(vec2(24.0, 0.0)));
            button.widget_info(|| WidgetInfo::labeled(Role::Button, to.is_some(), what));
            if button.on_hover_text(what).clicked() {
                jump = to;
            }
        };
        button(ui, "|<", "First frame", Some(*frames.start()));
        button(ui, "<", "Key before", document.next_key(false));
        let name = if playing { "Pause playing" } else { "Play" };
        let play = ui.add(Button::new(if playing { "Pause" } else { "Play" }).min_size(vec2(44.0, 0.0)));
        play.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
        if play.on_hover_text("Play from the first keyed frame to the last, over and over (Space)").clicked()
        {
            asked = Some(Command::Play);
        }
        button(ui, ">", "Key after", document.next_key(true));
        button(ui, ">|", "Last frame", Some(*frames.end()));
        let mut frame = document.frame();
        let label = ui.label("Frame");
        if ui.add(DragValue::new(&mut frame).range(-LAST..=LAST).speed(0.1)).labelled_by(label.id).changed() {
            jump = Some(frame);
        }
        let per_second = DragValue::new(rate).range(RATES).max_decimals(2).speed(0.1).suffix(" fps");
        super::number(ui.add(per_second), "Frames a second").on_hover_text("How fast it is played");
        if let Some(frame) = jump.or(line(ui, document, &frames)) {
            document.go_to(frame);
        }
    });
    asked
}

/// Keys by their frames, and the present one. Returns where it was dragged to.
fn line(ui: &mut Ui, document: &Document, frames: &RangeInclusive<i32>) -> Option<i32> {
    let size = vec2(ui.available_width().max(60.0), HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let now = document.frame();
    let info = || WidgetInfo::slider(true, f64::from(now), "Frames and keys");
    response.widget_info(info);
    let (first, last) = span(ui, &response, now, frames);
    let inner = rect.shrink2(vec2(8.0, 0.0));
    let span = f64::from(last) - f64::from(first);
    let x = |frame: i32| inner.left() + ((f64::from(frame) - f64::from(first)) / span) as f32 * inner.width();
    let painter = ui.painter_at(rect);
    let visuals = ui.visuals();
    let (weak, strong) = (visuals.weak_text_color(), visuals.text_color());
    painter.rect_filled(rect, 3.0, visuals.extreme_bg_color);
    let moving = Rect::from_x_y_ranges(x(*frames.start())..=x(*frames.end()), rect.top()..=rect.bottom());
    painter.rect_filled(moving, 3.0, visuals.faint_bg_color);
    for frame in marks(first, last, inner.width()) {
        painter.vline(x(frame), rect.bottom() - 4.0..=rect.bottom(), Stroke::new(1.0, weak));
        let at = pos2(x(frame), rect.bottom() - 4.0);
        painter.text(at, Align2::CENTER_BOTTOM, frame.to_string(), FontId::proportional(9.0), weak);
    }
    let selected = document.selected.and_then(|selected| document.rig.lights.get(selected));
    let own = selected.map(|light| Subject::Light(light.name.clone()));
    // one a pixel, those of the selected light over the others
    let mut columns = BTreeSet::new();
    for curve in document.curves() {
        let is_own = own.as_ref() == Some(&curve.field.of);
        columns.extend(curve.frames.iter().map(|&frame| (is_own, x(frame).round() as i32)));
    }
    for (is_own, column) in columns {
        let (color, size) = if is_own { (visuals.warn_fg_color, 4.0) } else { (weak, 3.0) };
        diamond(&painter, pos2(column as f32, rect.top() + 8.0), size, (color, Stroke::NONE));
    }
    painter.vline(x(now), rect.y_range(), Stroke::new(1.5, strong));
    let at = response.interact_pointer_pos().filter(|_| response.dragged() || response.clicked());
    let to = at.map(|at| {
        let share = f64::from(((at.x - inner.left()) / inner.width()).clamp(0.0, 1.0));
        (f64::from(first) + share * span).round() as i32
    });
    response.on_hover_text(
        "Drag or click: the frame that is shown. Diamonds are keys, those of the selected light bright",
    );
    to.filter(|&frame| frame != now)
}

/// The frames that are shown: as they were when a drag began, until it ends, or the frame that one points at would run away.
fn span(ui: &Ui, response: &Response, now: i32, frames: &RangeInclusive<i32>) -> (i32, i32) {
    let first = (*frames.start()).min(now);
    let last = (*frames.end()).max(now).max(first.saturating_add(SHORTEST));
    let id = response.id.with("span");
    if !response.is_pointer_button_down_on() {
        ui.data_mut(|data| data.insert_temp(id, (first, last)));
    }
    ui.data(|data| data.get_temp(id)).unwrap_or((first, last))
}

/// The sign of a key.
fn diamond(painter: &Painter, at: Pos2, size: f32, (fill, stroke): (Color32, Stroke)) {
    let corners = [vec2(0.0, -size), vec2(size, 0.0), vec2(0.0, size), vec2(-size, 0.0)];
    painter.add(Shape::convex_polygon(corners.map(|corner| at + corner).to_vec(), fill, stroke));
}

/// Frames that are numbered: round ones, not too close.
fn marks(first: i32, last: i32, width: f32) -> impl Iterator<Item = i32> {
    let span = i64::from(last) - i64::from(first);
    let most = (width / 45.0).max(1.0) as i64;
    let steps = (0..).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_i64.pow(power)));
    let step = steps.take(21).find(|step| span / step <= most).unwrap_or(span.max(1));
    let begin = i64::from(first).div_euclid(step) * step;
    (0..=span / step + 1)
        .map(move |mark| begin + mark * step)
        .filter(move |mark| (i64::from(first)..=i64::from(last)).contains(mark))
        .map(|mark| mark as i32)
}

/// What moves of the selected light, of the rig, of emitters and materials: keys, the way between them, and what else could move.
pub(crate) fn motion(ui: &mut Ui, document: &mut Document) {
    let light = document.selected.and_then(|selected| document.rig.lights.get(selected));
    let own = light.map(|light| Subject::Light(light.name.clone()));
    let frame = document.frame();
    let shown = |of: &Subject| !matches!(of, Subject::Light(_)) || own.as_ref() == Some(of);
    let curves: Vec<(Field, Interpolation, bool, bool)> = document
        .curves()
        .filter(|curve| shown(&curve.field.of))
        .map(|curve| {
            let keyed = curve.frames.contains(&frame);
            (curve.field.clone(), curve.interpolation, keyed, curve.blends)
        })
        .collect();
    for (field, interpolation, keyed, blends) in curves {
        ui.push_id(named(&field), |ui| {
            ui.horizontal(|ui| row(ui, document, &field, (interpolation, keyed, blends)));
        });
    }
    ui.horizontal(|ui| {
        let more = ComboBox::from_id_salt("animate").selected_text("Animate ...").show_ui(ui, |ui| {
            for field in document.resting() {
                if ui.button(named(&field)).clicked() {
                    document.key(&field);
                    ui.close();
                }
            }
        });
        more.response.on_hover_text(
            "Let a field move: it gets a key at this frame, and another one wherever it is edited at another frame",
        );
    });
}

/// One field that moves.
fn row(
    ui: &mut Ui,
    document: &mut Document,
    field: &Field,
    (interpolation, keyed, blends): (Interpolation, bool, bool),
) {
    let name = named(field);
    let what = if keyed { format!("Take the key of {name} away") } else { format!("Key {name}") };
    let key = ui.add(Button::new("").small().min_size(vec2(18.0, 0.0))).on_hover_text(&what);
    let color = ui.visuals().warn_fg_color;
    let fill = if keyed { color } else { Color32::TRANSPARENT };
    diamond(ui.painter(), key.rect.center(), 4.5, (fill, Stroke::new(1.0, color)));
    key.widget_info(|| WidgetInfo::labeled(Role::Button, true, &what));
    if key.clicked() {
        if keyed { document.unkey(field) } else { document.key(field) }
    }
    ui.label(&name);
    if blends {
        let mut chosen = interpolation;
        let ways = ComboBox::from_id_salt("way").selected_text(interpolation.name()).width(64.0);
        let ways = ways.show_ui(ui, |ui| {
            for way in Interpolation::ALL {
                ui.selectable_value(&mut chosen, way, way.name()).on_hover_text(explained(way));
            }
        });
        ways.response.on_hover_text("How it goes from key to key");
        if chosen != interpolation {
            document.interpolate(field, chosen);
        }
    } else {
        ui.weak("step");
    }
    if super::cross(ui, &format!("Hold {name} as it is")) {
        document.hold(field);
    }
}

fn explained(way: Interpolation) -> &'static str {
    match way {
        Interpolation::Smooth => "At rest at the first and the last key, and never beyond the keys around",
        Interpolation::Linear => "Straight from key to key",
        Interpolation::Step => "As the key before, up to the next one",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_apart() {
        assert_eq!(marks(1, 25, 600.0).collect::<Vec<_>>(), [2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24]);
        assert_eq!(marks(-7, 13, 100.0).collect::<Vec<_>>(), [0, 10]);
        for (first, last) in [(-LAST, LAST), (0, 24), (5, 5), (i32::MIN, i32::MAX)] {
            let all: Vec<i32> = marks(first, last, 600.0).collect();
            assert!(all.len() <= 16, "{first}..{last}: {all:?}");
        }
    }
}
