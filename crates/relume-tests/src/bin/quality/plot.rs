//! Error against size, one scene a plot.

use std::path::Path;

use plotters::backend::SVGBackend;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::drawing::IntoDrawingArea;
use plotters::element::{Circle, PathElement};
use plotters::series::{LineSeries, PointSeries};
use plotters::style::{BLACK, Color, IntoFont, WHITE};
use relume::{Error, Result};
use relume_tests::reports::{COLORS, write_text};

use crate::arguments::way;
use crate::report::SceneReport;

/// Width and height of a plot, pixels.
const SIZE: (u32, u32) = (640, 420);
/// One encoding's mark at one size: errors in percent.
#[derive(Clone, Debug, PartialEq)]
struct Mark {
    encoding: String,
    bytes_per_pixel: f64,
    median: f64,
    worst: f64,
}

/// Writes the relative error of the indirect light over bytes a pixel as SVG: for each encoding the median over lights
/// as a full point, the worst as a ring, and a line between them; where it was measured at several sizes, its medians and its worsts are joined.
/// Shows the first truth and the last number of bounces.
///
/// # Errors
/// As [`write_text`].
pub(crate) fn write(scene: &SceneReport, path: &Path) -> Result<()> {
    let svg = draw(&scene.name, &marks(scene))
        .map_err(|error| Error::Setting(format!("{} cannot be drawn: {error}", path.display())))?;
    write_text(path, &svg)
}

fn marks(scene: &SceneReport) -> Vec<Mark> {
    let of = |report: &crate::report::EncodingReport| {
        let first = report.columns.first()?.paths;
        let column = report.columns.iter().rfind(|column| column.paths == first)?;
        let spread = column.summary.indirect.as_ref()?;
        let mark = Mark {
            encoding: way(&report.settings),
            bytes_per_pixel: report.bytes_per_pixel,
            median: 100.0 * spread.median,
            worst: 100.0 * spread.worst,
        };
        (mark.median.is_finite() && mark.worst.is_finite()).then_some(mark)
    };
    scene.encodings.iter().filter_map(of).collect()
}

/// The marks of each encoding, in the order in which it first comes, from small to large.
fn curves(marks: &[Mark]) -> Vec<Vec<&Mark>> {
    let mut curves: Vec<Vec<&Mark>> = Vec::new();
    for mark in marks {
        match curves.iter_mut().find(|curve| curve[0].encoding == mark.encoding) {
            Some(curve) => curve.push(mark),
            None => curves.push(vec![mark]),
        }
    }
    for curve in &mut curves {
        curve.sort_by(|a, b| a.bytes_per_pixel.total_cmp(&b.bytes_per_pixel));
    }
    curves
}

fn draw(title: &str, marks: &[Mark]) -> Result<String, Box<dyn std::error::Error>> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        // room above for the legend
        let most = |figure: fn(&Mark) -> f64| 1.25 * marks.iter().map(figure).fold(1.0, f64::max);
        let mut chart = ChartBuilder::on(&area)
            .caption(format!("{title}: error of the indirect light over size"), ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(56)
            .build_cartesian_2d(0.0..most(|mark| mark.bytes_per_pixel), 0.0..most(|mark| mark.worst))?;
        chart
            .configure_mesh()
            .x_desc("bytes a pixel")
            .y_desc("relative L2, % (point: median light, ring: worst)")
            .x_label_formatter(&|bytes| format!("{bytes:.0}"))
            .y_label_formatter(&|percent| format!("{percent:.0}"))
            .label_style(("sans-serif", 13).into_font())
            .light_line_style(WHITE)
            .draw()?;
        for (curve, color) in curves(marks).iter().zip(COLORS.iter().cycle()) {
            let along =
                |figure: fn(&Mark) -> f64| curve.iter().map(move |mark| (mark.bytes_per_pixel, figure(mark)));
            let (medians, worsts) = (along(|mark| mark.median), along(|mark| mark.worst));
            for (median, worst) in medians.clone().zip(worsts.clone()) {
                chart.draw_series(LineSeries::new([median, worst], color.stroke_width(1)))?;
            }
            chart.draw_series(LineSeries::new(medians.clone(), color.stroke_width(2)))?;
            chart.draw_series(LineSeries::new(worsts.clone(), color.mix(0.5).stroke_width(2)))?;
            chart
                .draw_series(PointSeries::<_, _, Circle<_, _>, _>::new(medians, 5, color.filled()))?
                .label(&curve[0].encoding)
                .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(4)));
            chart.draw_series(PointSeries::<_, _, Circle<_, _>, _>::new(worsts, 5, color.stroke_width(2)))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_has_its_mark() {
        let mark = |encoding: &str, x| Mark {
            encoding: encoding.into(),
            bytes_per_pixel: x,
            median: 8.0,
            worst: 20.0,
        };
        let svg = draw("room", &[mark("low-rank", 123.0), mark("haar-rows", 325.0)]).unwrap();
        for text in ["low-rank", "haar-rows", "bytes a pixel", "room"] {
            assert!(svg.contains(text), "{text}");
        }
        assert_eq!(svg.matches("<circle").count(), 4);
        assert_eq!(draw("room", &[mark("low-rank", 1.0)]).unwrap().matches("<circle").count(), 2);
        assert!(draw("nothing", &[]).unwrap().starts_with("<svg"));
        // two sizes of one are one curve
        let marks = [mark("low-rank", 123.0), mark("haar-rows", 325.0), mark("low-rank", 30.0)];
        let sizes: Vec<Vec<f64>> = curves(&marks)
            .iter()
            .map(|curve| curve.iter().map(|mark| mark.bytes_per_pixel).collect())
            .collect();
        assert_eq!(sizes, [vec![30.0, 123.0], vec![325.0]]);
        let svg = draw("room", &marks).unwrap();
        assert_eq!((svg.matches("<circle").count(), svg.matches(">\nlow-rank\n<").count()), (6, 1));
    }
}
