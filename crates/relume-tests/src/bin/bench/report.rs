//! What `bench.json` holds.

use relume::{Error, Result};
use serde::Serialize;

use crate::growth::exponent;
use crate::machine::Machine;
use crate::points::{Axis, Point};
use crate::program::{Prepared, Relit};

/// A run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    /// Of Relume.
    pub(crate) version: &'static str,
    /// The command line to repeat it by.
    pub(crate) command: String,
    pub(crate) machine: Machine,
    pub(crate) quality: String,
    /// Relit, of which the median counts.
    pub(crate) frames: u32,
    pub(crate) scenes: Vec<SceneReport>,
}

/// A scene.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneReport {
    /// Without folder and ending.
    pub(crate) name: String,
    /// The rig's file, without its folder.
    pub(crate) rig: String,
    pub(crate) series: Vec<Series>,
}

/// Points along an axis.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Series {
    pub(crate) axis: Axis,
    /// How each figure grows: `e` of the power law that fits best.
    pub(crate) exponents: Vec<Growth>,
    pub(crate) points: Vec<Measured>,
}

/// How one figure grows along an axis.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Growth {
    pub(crate) figure: &'static str,
    /// `null` where there are not two points.
    pub(crate) exponent: Option<f64>,
}

/// A point with its figures.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Measured {
    #[serde(flatten)]
    pub(crate) point: Point,
    pub(crate) prepare: Prepared,
    pub(crate) relight: Relit,
}

/// A figure of a point, in the unit that it is shown in.
#[derive(Clone, Copy)]
pub(crate) struct Figure {
    pub(crate) name: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) of: fn(&Measured) -> Option<f64>,
}

/// All that is plotted and tabled.
pub(crate) const FIGURES: [Figure; 7] = [
    Figure { name: "preparation", unit: "s", of: |point| Some(point.prepare.seconds) },
    Figure { name: "frame", unit: "ms", of: |point| Some(point.relight.frame_ms) },
    Figure { name: "its transfer part", unit: "ms", of: |point| Some(point.relight.transfer_ms()) },
    Figure {
        name: "peak memory, preparing",
        unit: "MB",
        of: |point| megabytes(point.prepare.peak_rss_bytes),
    },
    Figure {
        name: "peak memory, relighting",
        unit: "MB",
        of: |point| megabytes(point.relight.peak_rss_bytes),
    },
    Figure { name: "cache", unit: "MB", of: |point| megabytes(Some(point.prepare.cache_bytes)) },
    Figure { name: "bytes a pixel", unit: "", of: |point| Some(point.prepare.bytes_per_pixel) },
];

fn megabytes(bytes: Option<u64>) -> Option<f64> {
    bytes.map(|bytes| bytes as f64 * 1e-6)
}

impl Figure {
    /// With its unit.
    pub(crate) fn label(&self) -> String {
        if self.unit.is_empty() { self.name.to_owned() } else { format!("{}, {}", self.name, self.unit) }
    }
}

impl Measured {
    /// Where the point stands on an axis.
    pub(crate) fn along(&self, axis: Axis) -> f64 {
        let count = match axis {
            Axis::Pixels => (self.point.size.0 * self.point.size.1) as u64,
            Axis::Gather => self.point.gather as u64,
            Axis::Triangles => self.prepare.triangles,
        };
        count as f64
    }
}

impl Series {
    /// With the exponents of all figures.
    pub(crate) fn new(axis: Axis, points: Vec<Measured>) -> Self {
        let mut series = Self { axis, points, exponents: Vec::new() };
        let growth =
            |figure: &Figure| Growth { figure: figure.name, exponent: exponent(&series.curve(figure)) };
        series.exponents = FIGURES.iter().map(growth).collect();
        series
    }

    /// A figure's points, where it is known.
    pub(crate) fn curve(&self, figure: &Figure) -> Vec<(f64, f64)> {
        let place = |point: &Measured| Some((point.along(self.axis), (figure.of)(point)?));
        self.points.iter().filter_map(place).collect()
    }

    /// Of a figure.
    pub(crate) fn exponent(&self, figure: &Figure) -> Option<f64> {
        self.exponents.iter().find(|growth| growth.figure == figure.name)?.exponent
    }
}

impl Report {
    /// `bench.json`.
    ///
    /// # Errors
    /// None that are known.
    pub(crate) fn json(&self) -> Result<String> {
        let text = serde_json::to_string_pretty(self);
        text.map(|text| text + "\n")
            .map_err(|error| Error::io("bench.json", "write", std::io::Error::other(error)))
    }
}

/// A run as it might be: three points in which time grows as pixels and memory as their square root.
#[cfg(test)]
pub(crate) fn example() -> Report {
    let measured = |(width, height): (usize, usize)| {
        let pixels = (width * height) as f64;
        Measured {
            point: Point { size: (width, height), gather: 1024, subdivisions: 0 },
            prepare: Prepared {
                seconds: pixels * 1e-3,
                peak_rss_bytes: Some((pixels.sqrt() * 1e6) as u64),
                cache_bytes: (pixels * 300.0) as u64,
                bytes_per_pixel: 300.0,
                triangles: 12_345,
                receivers: 7,
                threads: 2,
                stages: Vec::new(),
            },
            relight: Relit {
                light: "key".into(),
                frame_ms: pixels * 1e-2,
                frame_p95_ms: pixels * 1.1e-2,
                direct_ms: 1.0,
                cloud_ms: 2.0,
                bounces_ms: 3.0,
                gather_ms: 4.0,
                upsample_ms: 5.0,
                sum_ms: 6.0,
                color_change_ms: 7.0,
                shadow_rays: 8,
                peak_rss_bytes: None,
            },
        }
    };
    let points = [(40, 30), (80, 60), (160, 120)].map(measured);
    Report {
        version: "0.0.0",
        command: "cargo xtask bench --quick".into(),
        machine: Machine {
            processor: "Some CPU".into(),
            architecture: "x86_64",
            system: "linux",
            date: "2026-01-31".into(),
            cores: 2,
            memory_bytes: None,
            load: None,
        },
        quality: "draft".into(),
        frames: 8,
        scenes: vec![SceneReport {
            name: "room".into(),
            rig: "room.toml".into(),
            series: vec![Series::new(Axis::Pixels, points.to_vec())],
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_grow_as_they_were_made_to() {
        let series = &example().scenes[0].series[0];
        let of = |name: &str| {
            let figure = FIGURES.iter().find(|figure| figure.name == name).unwrap();
            series.exponent(figure).map(|exponent| (100.0 * exponent).round() as i32)
        };
        assert_eq!(of("preparation"), Some(100));
        assert_eq!(of("peak memory, preparing"), Some(50));
        assert_eq!(of("its transfer part"), Some(0));
        assert_eq!(of("peak memory, relighting"), None, "the system does not tell");
        assert!(example().json().unwrap().contains("\"axis\": \"pixels\""));
    }
}
