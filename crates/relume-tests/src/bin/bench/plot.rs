//! How all figures grow along one axis: four panels, both axes logarithmic, so that a power law is a straight line.

use std::path::Path;

use plotters::backend::SVGBackend;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement};
use plotters::series::{LineSeries, PointSeries};
use plotters::style::{BLACK, Color, IntoFont, WHITE};
use relume::{Error, Result};
use relume_tests::reports::{COLORS, write_text};

use crate::report::{FIGURES, Series};
use crate::section::exponent as told;

/// Width and height of a plot, pixels.
const SIZE: (u32, u32) = (920, 680);
/// What each panel shows: its title, and which of [`FIGURES`].
const PANELS: [(&str, std::ops::Range<usize>); 4] =
    [("preparation", 0..1), ("relighting", 1..3), ("memory", 3..5), ("size", 5..7)];

type Faults = Box<dyn std::error::Error>;

/// Writes the plot of a series as SVG.
///
/// # Errors
/// As [`write_text`].
pub(crate) fn write(scene: &str, series: &Series, path: &Path) -> Result<()> {
    let svg = draw(scene, series)
        .map_err(|error| Error::Setting(format!("{} cannot be drawn: {error}", path.display())))?;
    // plotters ends no line of it
    write_text(path, &(svg.trim_end().to_owned() + "\n"))
}

fn draw(scene: &str, series: &Series) -> Result<String, Faults> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let title = format!("{scene}: what grows with {}", series.axis.name());
        let area = area.titled(&title, ("sans-serif", 18))?;
        for ((name, figures), panel) in PANELS.into_iter().zip(area.split_evenly((2, 2))) {
            draw_panel(&panel, name, series, figures)?;
        }
        area.present()?;
    }
    Ok(svg)
}

/// From a little below the least to a little above the most. `above` is how much of their span is left free above, on a logarithmic axis.
fn range(values: impl Iterator<Item = f64> + Clone, above: f64) -> std::ops::Range<f64> {
    let least = values.clone().filter(|value| *value > 0.0).fold(f64::INFINITY, f64::min);
    let most = values.fold(0.0, f64::max);
    // what does not exist has no logarithm
    if most <= 0.0 {
        return 0.1..1.0;
    }
    let (low, high) = (least / 1.4, most * 1.4);
    low..high * (high / low).powf(above)
}

/// The round numbers within a range, 1, 2, 5, 10 and so on; of a wide range powers of ten alone.
fn round_numbers(range: &std::ops::Range<f64>) -> Vec<f64> {
    let first = range.start.log10().floor() as i32;
    let last = range.end.log10().ceil() as i32;
    let steps: &[f64] = if last - first > 3 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let all = (first..=last).flat_map(|power| steps.iter().map(move |step| step * 10_f64.powi(power)));
    all.filter(|number| range.contains(number)).collect()
}

fn draw_panel(
    panel: &DrawingArea<SVGBackend<'_>, Shift>,
    name: &str,
    series: &Series,
    figures: std::ops::Range<usize>,
) -> Result<(), Faults> {
    let figures = &FIGURES[figures];
    let curves: Vec<Vec<(f64, f64)>> = figures.iter().map(|figure| series.curve(figure)).collect();
    let all = || curves.iter().flatten().copied();
    let places: Vec<f64> = series.points.iter().map(|point| point.along(series.axis)).collect();
    let (across, up) = (range(places.iter().copied(), 0.0), range(all().map(|(_, y)| y), 0.5));
    let marks = round_numbers(&up);
    let mut chart = ChartBuilder::on(panel)
        .caption(name, ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(52)
        .build_cartesian_2d(
            across.log_scale().with_key_points(places),
            up.log_scale().with_key_points(marks),
        )?;
    chart
        .configure_mesh()
        .x_desc(series.axis.name())
        .x_label_formatter(&|count| short(*count))
        .y_label_formatter(&|value| short(*value))
        .label_style(("sans-serif", 12).into_font())
        .light_line_style(WHITE)
        .draw()?;
    for ((curve, figure), color) in curves.iter().zip(figures).zip(COLORS) {
        let points = || curve.iter().copied().filter(|(_, y)| *y > 0.0);
        let exponent = series.exponent(figure);
        let grows = exponent.map_or_else(String::new, |exponent| format!("  (e = {})", told(exponent)));
        chart
            .draw_series(LineSeries::new(points(), color.stroke_width(2)))?
            .label(figure.label() + &grows)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(4)));
        chart.draw_series(PointSeries::<_, _, Circle<_, _>, _>::new(points(), 4, color.filled()))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK)
        .label_font(("sans-serif", 12))
        .draw()?;
    Ok(())
}

/// A number in few characters.
fn short(number: f64) -> String {
    let scaled = |by: f64, sign: &str| format!("{}{sign}", (number / by * 100.0).round() / 100.0);
    match number {
        1e6.. => scaled(1e6, "M"),
        1e4.. => scaled(1e3, "k"),
        1.0.. => scaled(1.0, ""),
        // without the last bits of decimal fractions
        _ => format!("{}", (number * 1e4).round() / 1e4),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example;

    #[test]
    fn every_figure_that_is_known_has_its_points() {
        let svg = draw("room", &example().scenes[0].series[0]).unwrap();
        let known = FIGURES.iter().filter(|figure| figure.name != "peak memory, relighting");
        for figure in known.clone() {
            assert!(svg.contains(&figure.label()), "{}", figure.name);
        }
        assert_eq!(svg.matches("<circle").count(), 3 * known.count());
        assert!(svg.contains("e = 1.00") && svg.contains("room: what grows with pixels"));
        let empty = Series { points: Vec::new(), ..example().scenes[0].series[0].clone() };
        assert!(draw("nothing", &empty).unwrap().starts_with("<svg"));
    }

    #[test]
    fn marks_are_round_and_within_the_range() {
        assert_eq!(round_numbers(&(0.4..12.0)), [0.5, 1.0, 2.0, 5.0, 10.0]);
        assert_eq!(round_numbers(&(3.0..90_000.0)), [10.0, 100.0, 1000.0, 10_000.0]);
        let free = range([10.0, 1000.0].into_iter(), 0.5);
        assert!(free.start < 10.0 && free.end > 1e4 && range([10.0].into_iter(), 0.0).end < 20.0);
        assert_eq!(range(std::iter::empty(), 0.5), 0.1..1.0);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.25, 5.0, 20_000.0, 1_200_000.0].map(short), ["0.25", "5", "20k", "1.2M"]);
    }
}
