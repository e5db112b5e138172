//! The section of a page that a run rewrites; all else of the page stays.

use std::fmt::Write;
use std::path::Path;

use relume_tests::reports::table;

use crate::points::Axis;
use crate::report::{FIGURES, Figure, Measured, Report, SceneReport, Series};

/// Where the section begins and ends in the page.
const MARKERS: [&str; 2] = ["<!-- cargo xtask bench: begin -->", "<!-- cargo xtask bench: end -->"];

/// The page with `section` between its markers.
///
/// # Errors
/// Where the markers are missing or out of order.
pub(crate) fn replaced(page: &str, section: &str) -> Result<String, String> {
    let [begin, end] = MARKERS;
    let [once, once_more] = MARKERS.map(|marker| page.matches(marker).count() == 1);
    let parts = page.split_once(begin).and_then(|(before, rest)| Some((before, rest.split_once(end)?.1)));
    match parts {
        Some((before, after)) if once && once_more => {
            Ok(format!("{before}{begin}\n\n{}\n\n{end}{after}", section.trim()))
        }
        _ => Err(format!("needs the lines `{begin}` and `{end}`, once each in this order, for the section")),
    }
}

/// The section: what was measured on what, and for each scene its tables and plots, which lie in `plots` as seen from the page. `figures` is the
/// file that has them all.
pub(crate) fn section(report: &Report, figures: &Path, plots: &str) -> String {
    let mut text = format!(
        "## Growth\n\n    {}\n\nWritten by this command, version {}, on: {}. Quality {}; each point is prepared once and relit {} times, one light \
         moving, of which the median counts; every job is a process of its own. The transfer part of a frame is its bounces within the cloud and \
         its final gather. The last line of each table is `e` where a figure grows as the first column to the power `e`, as least squares of logarithms \
         have it; peak memory is what was resident, and of relighting counts what of the cache was read. All figures, those of the stages too, are in `{}`.\n",
        report.command,
        report.version,
        report.machine.sentence(),
        report.quality,
        report.frames,
        figures.display(),
    );
    for scene in &report.scenes {
        of_scene(&mut text, scene, plots);
    }
    text
}

fn of_scene(text: &mut String, scene: &SceneReport, plots: &str) {
    let light = scene.series.iter().flat_map(|series| &series.points).next();
    let light = light.map_or_else(String::new, |point| format!(", `{}` moves", point.relight.light));
    let _ = writeln!(text, "\n### {}\n\nLit by `{}`{light}.", scene.name, scene.rig);
    for series in &scene.series {
        let axis = series.axis;
        let _ = writeln!(
            text,
            "\n{}\n![{}: what grows with {}]({plots}{}.svg)",
            of_series(series),
            scene.name,
            axis.name(),
            plot_stem(scene, axis)
        );
    }
}

/// The name of a plot's file, without its ending.
pub(crate) fn plot_stem(scene: &SceneReport, axis: Axis) -> String {
    format!("{}-{}", scene.name, axis.stem())
}

/// A line for each point, and one for the exponents.
fn of_series(series: &Series) -> String {
    let axis = series.axis;
    let others: Vec<Axis> =
        [Axis::Pixels, Axis::Gather, Axis::Triangles].into_iter().filter(|&other| other != axis).collect();
    let axes = || [axis].into_iter().chain(others.iter().copied());
    let header = axes().map(|axis| axis.name().to_owned()).chain(FIGURES.iter().map(Figure::label));
    let header: Vec<String> = header.collect();
    let row = |point: &Measured| {
        let places = axes().map(|axis| thousands(point.along(axis)));
        let figures =
            FIGURES.iter().map(|figure| (figure.of)(point).map_or_else(|| "-".to_owned(), three_digits));
        places.chain(figures).collect()
    };
    let mut rows: Vec<Vec<String>> = series.points.iter().map(row).collect();
    let exponents =
        FIGURES.iter().map(|figure| series.exponent(figure).map_or_else(|| "-".to_owned(), exponent));
    rows.push(["*grows as*", "", ""].map(str::to_owned).into_iter().chain(exponents).collect());
    table(&header.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

/// From a page to files in `folder`: a path that a link in it can begin with.
pub(crate) fn link_to(folder: &Path, page: Option<&Path>) -> String {
    let beside = page.and_then(Path::parent).and_then(|parent| folder.strip_prefix(parent).ok());
    // a page that is written into the folder itself needs none
    let path = if page.is_some() { beside.unwrap_or(folder) } else { Path::new("") };
    let parts: Vec<_> = path.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.iter().map(|part| format!("{part}/")).collect()
}

/// An exponent, without a sign where it is zero.
pub(crate) fn exponent(exponent: f64) -> String {
    format!("{:.2}", (exponent * 100.0).round() / 100.0 + 0.0)
}

/// A whole number, its thousands apart.
fn thousands(number: f64) -> String {
    let digits = format!("{number:.0}");
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// As many decimals as make three digits, as far as there are any.
fn three_digits(number: f64) -> String {
    match number {
        100.0.. => thousands(number),
        10.0.. => format!("{number:.1}"),
        _ => format!("{number:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example;

    #[test]
    fn only_what_lies_between_the_markers_changes() {
        let [begin, end] = MARKERS;
        let page = format!("# Before\n\n{begin}\nold\n{end}\n\n# After\n");
        let new = replaced(&page, "new\n").unwrap();
        assert_eq!(new, format!("# Before\n\n{begin}\n\nnew\n\n{end}\n\n# After\n"));
        assert_eq!(replaced(&new, "new").unwrap(), new, "a second time changes nothing");
        for wrong in [
            String::from("# No markers\n"),
            format!("{begin}\n"),
            format!("{end}\n{begin}\n"),
            format!("{begin}\n{end}\n{begin}\n{end}\n"),
        ] {
            assert!(replaced(&wrong, "new").is_err(), "{wrong}");
        }
    }

    #[test]
    fn every_point_and_every_exponent_has_its_place() {
        let text = section(&example(), Path::new("docs/benchmarks/bench.json"), "benchmarks/");
        for part in [
            "    cargo xtask bench --quick\n",
            "Some CPU, 2 cores",
            "| 19,200 | 1,024 | 12,345 | 19.2 | 192 | 5.00 | 139 | - | 5.76 | 300 |",
            "| *grows as* |  |  | 1.00 | 1.00 | 0.00 | 0.50 | - | 1.00 | 0.00 |",
            "](benchmarks/room-pixels.svg)",
        ] {
            assert!(text.contains(part), "{part} in\n{text}");
        }
    }

    #[test]
    fn links_lead_from_the_page_to_the_plots() {
        let page = Path::new("docs/BENCHMARKS.md");
        assert_eq!(link_to(Path::new("docs/benchmarks"), Some(page)), "benchmarks/");
        assert_eq!(link_to(Path::new("out/bench"), Some(page)), "out/bench/");
        assert_eq!(link_to(Path::new("out/bench"), None), "");
    }

    #[test]
    fn numbers_have_three_digits() {
        let told = [0.1234, 12.34, 123.4, 1234.5].map(three_digits);
        assert_eq!(told, ["0.12", "12.3", "123", "1,234"]);
        assert_eq!([-0.001, 0.996].map(exponent), ["0.00", "1.00"]);
        assert_eq!(thousands(2_163_236.0), "2,163,236");
    }
}
