//! `quality.md`: the tables, ready for the benchmarks page.

use std::fmt::Write;

use relume_tests::reports::table;

use crate::arguments::name_of;
use crate::figures::Column;
use crate::pictures::CAPTION;
use crate::progress::duration;
use crate::report::{EncodingReport, Report, SceneReport};
use crate::summary::Spread;

/// The whole page.
pub(crate) fn page(report: &Report, command: &str) -> String {
    let (width, height) = report.size;
    let mut page = format!(
        "# Quality\n\n    {command}\n\n{width}x{height}, {} gather samples, quality {}. Errors are relative L2 on linear \
         RGB, in percent, against the path tracer at {} paths a pixel. Its noise is taken out: it is independent in two \
         halves, whose products are free of it. ± is the standard error that is left; an error of 0.0 is lost in it, which \
         more paths a pixel mend. Every light is judged alone; `emission` is what surfaces emit.\n\n## All scenes\n\n{}",
        report.gather_samples,
        name_of(&report.quality),
        report.spp,
        overview(report)
    );
    for name in &report.skipped {
        let _ = writeln!(page, "\n{name}: skipped, not in the folder of scenes.");
    }
    for scene in &report.scenes {
        scene_section(&mut page, scene);
    }
    page
}

/// A line for each scene, encoding, truth and number of bounces.
pub(crate) fn overview(report: &Report) -> String {
    let mut rows = Vec::new();
    for scene in &report.scenes {
        for encoding in &scene.encodings {
            rows.extend(encoding.columns.iter().map(|column| overview_row(scene, encoding, column)));
        }
    }
    table(
        &[
            "scene",
            "encoding",
            "truth",
            "bounces",
            "bytes a pixel",
            "indirect: median",
            "±",
            "worst",
            "no edges: median",
            "worst",
            "whole: median",
            "worst",
            "no edges: median",
            "worst",
        ],
        &rows,
    )
}

fn overview_row(scene: &SceneReport, encoding: &EncodingReport, column: &Column) -> Vec<String> {
    let summary = &column.summary;
    let median = |spread: &Option<Spread>| percent(spread.as_ref().map(|spread| spread.median));
    let mut row = vec![
        scene.name.clone(),
        encoding.encoding.clone(),
        column.paths.to_owned(),
        column.bounces.to_string(),
        format!("{:.0}", encoding.bytes_per_pixel),
        median(&summary.indirect),
        median(&summary.indirect_uncertainty),
        worst(&summary.indirect),
    ];
    for spread in [&summary.indirect_no_edges, &summary.whole, &summary.whole_no_edges] {
        row.extend([median(spread), worst(spread)]);
    }
    row
}

fn scene_section(page: &mut String, scene: &SceneReport) {
    let name = &scene.name;
    let _ = write!(page, "\n## {name}\n\n{} triangles, {} lights.\n\n", scene.triangles, scene.lights.len());
    let rows: Vec<_> = scene.encodings.iter().map(preparation_row).collect();
    let header = [
        "encoding",
        "bytes a pixel",
        "of bounces",
        "preparation",
        "threads",
        "rays a pixel",
        "rays a gather sample",
        "peak memory",
    ];
    page.push_str(&table(&header, &rows));
    for encoding in &scene.encodings {
        for column in &encoding.columns {
            let (label, paths, bounces) = (&encoding.encoding, column.paths, column.bounces);
            let _ = write!(page, "\n### {name}, {label}, truth {paths}, bounces {bounces}\n\n");
            page.push_str(&light_table(column));
        }
    }
    let _ = write!(
        page,
        "\n![{name}: error over bytes a pixel]({name}.svg)\n\n![{name}: pictures]({name}.png)\n"
    );
    let _ = writeln!(page, "\n{CAPTION} Rows from the top:\n");
    for pictured in scene.encodings.iter().flat_map(|encoding| &encoding.pictured) {
        let _ = writeln!(page, "- {pictured}");
    }
}

fn preparation_row(report: &EncodingReport) -> Vec<String> {
    let memory = |bytes: u64| format!("{:.2} GB", bytes as f64 * 1e-9);
    vec![
        report.encoding.clone(),
        format!("{:.1}", report.bytes_per_pixel),
        format!("{:.1} MB", report.bounce_bytes as f64 * 1e-6),
        duration(report.prepare_seconds),
        report.threads.to_string(),
        format!("{:.0}", report.rays_per_pixel),
        format!("{:.0}", report.rays_per_gather_sample),
        report.peak_rss_bytes.map_or("not known".to_owned(), memory),
    ]
}

/// Light by light, then median and worst.
fn light_table(column: &Column) -> String {
    let row = |label: String, figures: [Option<f64>; 7]| {
        std::iter::once(label).chain(figures.map(percent)).collect::<Vec<_>>()
    };
    let mut rows: Vec<_> = column
        .lights
        .iter()
        .map(|light| {
            let errors = &light.errors;
            let figures = [
                Some(errors.indirect),
                Some(errors.indirect_uncertainty),
                errors.indirect_no_edges,
                Some(errors.whole),
                errors.whole_no_edges,
                Some(errors.indirect_noise),
                Some(errors.whole_noise),
            ];
            row(light.light.clone(), figures)
        })
        .collect();
    let summary = &column.summary;
    let spreads = [
        &summary.indirect,
        &summary.indirect_uncertainty,
        &summary.indirect_no_edges,
        &summary.whole,
        &summary.whole_no_edges,
        &summary.indirect_noise,
        &summary.whole_noise,
    ];
    let over = |figure: fn(&Spread) -> f64| spreads.map(|spread| spread.as_ref().map(figure));
    rows.push(row("**median**".to_owned(), over(|spread| spread.median)));
    rows.push(row("**worst**".to_owned(), over(|spread| spread.worst)));
    let header = [
        "light",
        "indirect",
        "±",
        "indirect, no edges",
        "whole",
        "whole, no edges",
        "noise of the reference: indirect",
        "whole",
    ];
    table(&header, &rows)
}

fn percent(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        // against a truth that is all noise
        Some(value) if value >= 10.0 => ">999".to_owned(),
        Some(value) => format!("{:.1}", 100.0 * value),
    }
}

fn worst(spread: &Option<Spread>) -> String {
    let named = |spread: &Spread| format!("{} ({})", percent(Some(spread.worst)), spread.worst_light);
    spread.as_ref().map_or("-".to_owned(), named)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::Bounces;
    use crate::figures::{Errors, LightErrors, Summary};
    use relume::transfer::{Quality, Settings};

    fn light(light: &str, indirect: f64) -> LightErrors {
        let errors = Errors {
            indirect,
            indirect_no_edges: Some(indirect / 2.0),
            indirect_uncertainty: 0.001,
            whole: indirect / 10.0,
            whole_no_edges: None,
            indirect_noise: 0.3,
            whole_noise: 0.05,
        };
        LightErrors { light: light.to_owned(), errors }
    }

    fn report(lights: Vec<LightErrors>) -> Report {
        let summary = Summary::of(&lights);
        let columns = vec![Column { paths: "transfer", bounces: Bounces(None), summary, lights }];
        let encoding = EncodingReport {
            encoding: "low-rank".into(),
            settings: Settings::default(),
            bytes_per_pixel: 123.4,
            bounce_bytes: 1_200_000,
            prepare_seconds: 262.0,
            threads: 2,
            rays_per_pixel: 1365.0,
            rays_per_gather_sample: 792.0,
            peak_rss_bytes: Some(1_240_000_000),
            columns,
            pictured: vec!["low-rank, key".into()],
        };
        let scene = SceneReport {
            name: "room".into(),
            scene_hash: String::new(),
            triangles: 22,
            lights: Vec::new(),
            encodings: vec![encoding],
        };
        Report {
            version: "0",
            size: (64, 48),
            gather_samples: 256,
            quality: Quality::Draft,
            spp: 64,
            scenes: vec![scene],
            skipped: vec!["sponza".into()],
        }
    }

    /// The first table's line, by hand; the wrong input is the same with one light's error another.
    #[test]
    fn medians_and_worst_stand_in_the_table() {
        let lights = || vec![light("key", 0.2), light("a|b", 0.5), light("fill", 0.1)];
        let line = "| room | low-rank | transfer | all | 123 | 20.0 | 0.1 | 50.0 (a\\|b) | 10.0 | 25.0 (a\\|b) | 2.0 | \
                    5.0 (a\\|b) | - | - |";
        assert_eq!(overview(&report(lights())).lines().nth(2), Some(line));
        let mut wrong = lights();
        wrong[0].errors.indirect = 0.21;
        assert_ne!(overview(&report(wrong)).lines().nth(2), Some(line));
        let page = page(&report(lights()), "cargo xtask quality");
        for text in [
            "| low-rank | 123.4 | 1.2 MB | 4 min 22 s | 2 |",
            "64x48, 256 gather samples, quality draft.",
            "1.24 GB",
            "| **median** | 20.0 | 0.1 | 10.0 | 2.0 | - | 30.0 | 5.0 |",
            "| **worst** | 50.0 |",
            "sponza: skipped",
            "- low-rank, key",
            "(room.svg)",
        ] {
            assert!(page.contains(text), "{text} in\n{page}");
        }
    }
}
