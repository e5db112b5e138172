//! OpenEXR images: the full frame, its layers and what is known about it, in one file of one part.
//!
//! | channels | what |
//! |---|---|
//! | `R G B` | the full image: direct plus indirect |
//! | `direct.R/G/B`, `indirect.R/G/B` | its two parts |
//! | `NAME.direct.R/G/B`, `NAME.indirect.R/G/B` | those of each light, when asked for |
//! | `edges.Y` | 1 on pixels on a geometric edge, 0 elsewhere |
//! | `noise.R/G/B` | standard error of the full image (reference images) |
//!
//! Scene-linear Rec. 709, ZIP-compressed scan lines, half floats unless asked otherwise. Compositing programs
//! read the part before the last dot of a channel as its layer. The same frame gives the same bytes.

mod header;
mod read;
mod write;

use relume::image::{Image, LightLayers};

pub use read::read_exr;
pub use write::{write_exr, write_exr_image};

/// How channels are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 16-bit floats: 11 bits of precision, values beyond ±65504 become ±65504.
    #[default]
    Half,
    /// 32-bit floats, bit for bit, at twice the size.
    Float,
}

/// The value of a header attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// Written as a double; any number type is read.
    Number(f64),
    /// Any text.
    Text(String),
}

/// What is stored beside the pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrMeta {
    /// How channels are stored. The edge channel is always half.
    pub precision: Precision,
    /// Header attributes by name: ASCII letters, digits and `_.:-`, at most 255, none that OpenEXR itself
    /// defines. `software` is always written and names Relume and its version.
    pub attributes: Vec<(String, Attribute)>,
}

/// What an EXR file holds, as far as Relume knows it.
#[derive(Clone, Debug, Default)]
pub struct ExrImage {
    /// `R G B`.
    pub image: Image,
    /// Layer `direct`.
    pub direct: Option<Image>,
    /// Layer `indirect`.
    pub indirect: Option<Image>,
    /// Every `NAME` that has both layers, by the order of names in the file (alphabetical).
    pub per_light: Vec<LightLayers>,
    /// Channel `edges.Y`, true above one half.
    pub edges: Option<Vec<bool>>,
    /// Layer `noise`.
    pub noise: Option<Image>,
    /// Texts and numbers of the header, `software` among them, sorted by name.
    pub attributes: Vec<(String, Attribute)>,
}

const DIRECT: &str = "direct";
const INDIRECT: &str = "indirect";
const NOISE: &str = "noise";
const EDGES: &str = "edges.Y";
const SOFTWARE: &str = "software";

#[cfg(test)]
mod tests;
