//! What is lit: view samples (what the camera sees) and the gather cloud (what can light it).

mod cells;
mod cloud;
mod illumination;
mod packed;
mod reach;
mod refine;
mod sightings;
mod speakers;
mod tree;
mod view;

pub use cloud::{
    CellMap, CloudMethod, CloudSettings, GatherCloud, GatherSample, SUB_SAMPLES, SubSample, TARGETS,
};
pub use illumination::{CloudLight, illuminate};
pub use packed::{PackedNormal, PackedUnit};
pub(crate) use tree::cluster_order;
pub use view::{ViewSample, ViewSamples, edge_pixels};
