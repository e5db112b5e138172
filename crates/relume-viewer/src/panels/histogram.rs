//! How bright the picture is.

use eframe::egui::{Align2, Color32, FontId, Sense, Stroke, Ui, pos2, vec2};

use crate::develop::Histogram;

/// Draws it: each channel a line, a mark at middle grey and at the end of a display without a curve.
pub(crate) fn histogram(ui: &mut Ui, histogram: &Histogram) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 84.0), Sense::hover());
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 3.0, ui.visuals().extreme_bg_color);
    let most = histogram.channels.iter().flatten().skip(1).copied().fold(1e-4, f32::max);
    let colors =
        [Color32::from_rgb(235, 90, 90), Color32::from_rgb(100, 200, 100), Color32::from_rgb(100, 150, 255)];
    let (low, high) = Histogram::RANGE;
    let at = |stops: f32| rect.left() + (stops - low) / (high - low) * rect.width();
    for (stops, name) in [(0.18_f32.log2(), "18%"), (0.0, "1")] {
        painter.vline(at(stops), rect.y_range(), Stroke::new(1.0, Color32::from_gray(120)));
        let font = FontId::proportional(10.0);
        painter.text(
            pos2(at(stops) + 3.0, rect.top() + 2.0),
            Align2::LEFT_TOP,
            name,
            font,
            Color32::from_gray(150),
        );
    }
    for (channel, color) in histogram.channels.iter().zip(colors) {
        let bins = channel.len() as f32;
        let point = |(bin, share): (usize, &f32)| {
            let x = rect.left() + (bin as f32 + 0.5) / bins * rect.width();
            pos2(x, rect.bottom() - (share / most).sqrt().min(1.0) * (rect.height() - 4.0))
        };
        painter.line(channel.iter().enumerate().map(point).collect(), Stroke::new(1.2, color));
    }
    response.on_hover_text(format!(
        "How many pixels are how bright, in stops, after the exposure. {:.1}% are above 1.",
        100.0 * histogram.clipped
    ));
}
