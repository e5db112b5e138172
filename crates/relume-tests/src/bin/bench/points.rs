//! What is measured: one figure grows at a time, the others stay.

use serde::{Deserialize, Serialize};

/// What grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Axis {
    /// Of the image.
    Pixels,
    /// Gather samples.
    Gather,
    /// Of the scene.
    Triangles,
}

/// One preparation and its relighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Point {
    /// Pixels: width and height.
    pub(crate) size: (usize, usize),
    /// Gather samples.
    pub(crate) gather: usize,
    /// How often each triangle of the scene is parted into four.
    pub(crate) subdivisions: u32,
}

/// All points of a scene.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    pub(crate) axes: Vec<Axis>,
    pub(crate) sizes: Vec<(usize, usize)>,
    pub(crate) gather: Vec<usize>,
    pub(crate) subdivisions: Vec<u32>,
}

impl Axis {
    /// In plots and tables.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Pixels => "pixels",
            Self::Gather => "gather samples",
            Self::Triangles => "triangles",
        }
    }

    /// In names of files.
    pub(crate) fn stem(self) -> &'static str {
        match self {
            Self::Pixels => "pixels",
            Self::Gather => "gather",
            Self::Triangles => "triangles",
        }
    }
}

impl Point {
    /// Roughly how long it takes, beside others.
    pub(crate) fn work(&self) -> u64 {
        let (width, height) = self.size;
        (width * height + 2 * self.gather + 2000 * 4_usize.pow(self.subdivisions)) as u64
    }
}

impl Plan {
    /// Where the axes cross.
    fn base(&self) -> Option<Point> {
        let size = *self.sizes.get(self.sizes.len() / 2)?;
        let gather = *self.gather.get(self.gather.len() / 2)?;
        Some(Point { size, gather, subdivisions: *self.subdivisions.first()? })
    }

    /// The points along an axis.
    pub(crate) fn along(&self, axis: Axis) -> Vec<Point> {
        let Some(base) = self.base() else { return Vec::new() };
        match axis {
            Axis::Pixels => self.sizes.iter().map(|&size| Point { size, ..base }).collect(),
            Axis::Gather => self.gather.iter().map(|&gather| Point { gather, ..base }).collect(),
            Axis::Triangles => {
                self.subdivisions.iter().map(|&subdivisions| Point { subdivisions, ..base }).collect()
            }
        }
    }

    /// All points, each once, those of a scene with the same triangles together.
    pub(crate) fn points(&self) -> Vec<Point> {
        let mut points: Vec<Point> = Vec::new();
        for point in self.axes.iter().flat_map(|&axis| self.along(axis)) {
            if !points.contains(&point) {
                points.push(point);
            }
        }
        points.sort_by_key(|point| point.subdivisions);
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_cross_at_one_point_that_is_measured_once() {
        let plan = Plan {
            axes: vec![Axis::Triangles, Axis::Pixels, Axis::Gather],
            sizes: vec![(4, 3), (8, 6), (16, 12)],
            gather: vec![256, 1024, 4096],
            subdivisions: vec![0, 1, 2],
        };
        let base = Point { size: (8, 6), gather: 1024, subdivisions: 0 };
        for axis in plan.axes.clone() {
            let along = plan.along(axis);
            assert_eq!((along.len(), along.contains(&base)), (3, true));
        }
        let points = plan.points();
        assert_eq!(points.len(), 7);
        assert_eq!(points[5..].iter().map(|point| point.subdivisions).collect::<Vec<_>>(), [1, 2]);
        assert!(points[6].work() > base.work());
    }
}
