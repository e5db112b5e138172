//! BSDFs and light models: how a point answers to a light.
//!
//! A [`Surface`] is a point with its normals and material; a [`Bsdf`] is a surface seen from one direction; a
//! [`PreparedLight`] says what arrives at a point, before visibility. The reference and the relighting engine
//! both shade by these, so that they can differ in light transport only. Nothing here allocates a point.

mod bsdf;
mod dome;
mod energy;
mod ggx;
mod light;
mod light_lanes;
mod lobe;
mod point_group;
mod specular;
mod surface;

pub use bsdf::{Bsdf, BsdfSample};
pub use dome::Dome;
pub use light::{LightSample, PreparedLight, needs_samples, sample, shadow_ray};
pub(crate) use light_lanes::{CenterLanes, LANES, Lane};
pub(crate) use lobe::LobeTerms;
pub use lobe::SpecularLobe;
pub use point_group::PointGroup;
pub use specular::{
    LEAST_THROUGHPUT, MAX_SPECULAR_EVENTS, Medium, POLISHED_ROUGHNESS, SpecularEvent, ViewCone,
};
pub use surface::{MIN_ROUGHNESS, Surface, surface_at, surface_on_triangle};

/// Warms the one table that shading reads (about 10 ms, once a process), so that no frame pays for it.
pub fn warm_up() {
    energy::table();
}
