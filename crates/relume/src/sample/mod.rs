//! What is lit: view samples (what the camera sees) and the gather cloud (what can light it).

mod alike;
mod cell_map;
mod cells;
mod chains;
mod cloud;
mod gather_sample;
mod illumination;
mod packed;
mod patch_light;
mod reach;
mod receivers;
mod records;
mod refine;
mod sightings;
mod sky;
mod sky_light;
mod speakers;
mod sub_samples;
mod tree;
mod view;
mod view_images;

pub use cell_map::{CellMap, TARGETS};
pub use chains::{Branch, Chains, SkyView};
pub use cloud::{CloudMethod, CloudSettings, GatherCloud};
pub use gather_sample::{DiffusePart, Emitted, GatherSample, SUB_SAMPLES, SubSample};
pub use illumination::{CloudLight, Detail, cloud_groups, illuminate, illuminate_with};
pub(crate) use packed::unpacked;
pub use packed::{PackedNormal, PackedUnit};
pub use receivers::{Gloss, Receiver, Receivers};
pub(crate) use records::{MOST as MOST_SHARES, Records, Spacing};
pub use sky::SkyCells;
pub use sky_light::illuminate_sky;
pub(crate) use tree::{cluster_order, ordering_steps, places_in};
pub(crate) use view::QUAD;
pub use view::{ViewGrid, ViewHits, ViewSample, ViewSamples, edge_pixels, kept_base_color};
