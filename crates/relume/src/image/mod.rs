//! Images: layers, metrics, display transform.

pub mod display;
pub mod flip;
pub mod metrics;

pub use display::{Tonemap, display};
pub use metrics::{Comparison, compare, compare_watched};

use glam::Vec3;

/// A scene-linear Rec. 709 image, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels, row by row.
    pub pixels: Vec<Vec3>,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: bytemuck::zeroed_vec(width * height) }
    }
}

/// The layers of one relit or reference frame, all of one size.
#[derive(Clone, Debug, Default)]
pub struct Layers {
    /// Light that reaches a view sample straight from a light, and what surfaces emit.
    pub direct: Image,
    /// Light that met at least one surface on its way to the view sample.
    pub indirect: Image,
    /// The same two for each enabled light, when asked for.
    pub per_light: Vec<LightLayers>,
    /// Pixels on a geometric edge (where object, normal or depth breaks); empty where unknown.
    pub edges: Vec<bool>,
    /// Standard error of the full image, from two independent halves (reference images only).
    pub noise: Option<Image>,
}

/// One light's share of a frame.
#[derive(Clone, Debug)]
pub struct LightLayers {
    /// The light's name in the rig.
    pub name: String,
    /// Its direct light.
    pub direct: Image,
    /// Its indirect light.
    pub indirect: Image,
}

impl Layers {
    /// Direct plus indirect.
    pub fn full(&self) -> Image {
        let mut full = self.direct.clone();
        for (pixel, indirect) in full.pixels.iter_mut().zip(&self.indirect.pixels) {
            *pixel += *indirect;
        }
        full
    }
}
