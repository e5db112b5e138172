//! The second difference by step.

use std::path::Path;

use plotters::backend::SVGBackend;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::coord::combinators::IntoLogRange;
use plotters::drawing::IntoDrawingArea;
use plotters::element::PathElement;
use plotters::series::LineSeries;
use plotters::style::{BLACK, Color, IntoFont, WHITE};
use relume::{Error, Result};
use relume_tests::reports::{COLORS, write_text};

use crate::report::{Report, Row};

/// Width and height of a plot, pixels.
const SIZE: (u32, u32) = (760, 460);

/// Writes the relative second difference over the steps as SVG, a line for each row; where it is lost in grain, a line has a gap.
///
/// # Errors
/// As [`write_text`].
pub(crate) fn write(report: &Report, path: &Path) -> Result<()> {
    let svg = draw(&report.scene, &report.rows)
        .map_err(|error| Error::Setting(format!("{} cannot be drawn: {error}", path.display())))?;
    write_text(path, &svg)
}

fn draw(title: &str, rows: &[Row]) -> Result<String, Box<dyn std::error::Error>> {
    let all = || rows.iter().flat_map(|row| &row.second_differences).map(|value| 100.0 * value);
    let least = all().filter(|value| *value > 0.0).fold(f64::INFINITY, f64::min);
    let most = all().fold(0.0, f64::max);
    // sequences that do not move at all have no logarithm
    let (least, most) = if most > 0.0 { (0.8 * least, 2.5 * most) } else { (0.1, 1.0) };
    let steps = rows.iter().map(|row| row.second_differences.len()).max().unwrap_or_default() + 1;
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(format!("{title}: second difference of the indirect light"), ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..steps as f64, (least..most).log_scale())?;
        chart
            .configure_mesh()
            .x_desc("step")
            .y_desc("relative to the image, %")
            .x_label_formatter(&|step| format!("{step:.0}"))
            // without the last bits of decimal fractions
            .y_label_formatter(&|percent| format!("{}", (percent * 1e4).round() / 1e4))
            .label_style(("sans-serif", 13).into_font())
            .light_line_style(WHITE)
            .draw()?;
        for (row, color) in rows.iter().zip(COLORS.iter().cycle()) {
            for (number, piece) in pieces(&row.second_differences).into_iter().enumerate() {
                let series = chart.draw_series(LineSeries::new(piece, color.stroke_width(2)))?;
                if number == 0 {
                    series
                        .label(&row.label)
                        .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(4)));
                }
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK)
            .label_font(("sans-serif", 13))
            .draw()?;
        area.present()?;
    }
    Ok(svg)
}

/// Runs of positive values with their steps, in percent.
fn pieces(values: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let points: Vec<_> = (1..).zip(values).map(|(step, value)| (f64::from(step), 100.0 * value)).collect();
    let runs = points.split(|(_, value)| *value <= 0.0).filter(|run| !run.is_empty());
    runs.map(<[_]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_gaps_where_nothing_is_known() {
        let found = pieces(&[0.1, 0.2, 0.0, 0.3]);
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].len(), found[1][0].0), (2, 4.0));
        assert!(pieces(&[0.0, 0.0]).is_empty());
    }
}
