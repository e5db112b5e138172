//! Gather samples as they are kept: points, their sub-samples, and what they emit.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{PackedNormal, PackedUnit};

/// Sub-samples a gather sample: points spread over the patch it stands for. More would resolve light's edges on the
/// cloud better and flicker less under a moving light, for as much more shading (not more shadow rays).
pub const SUB_SAMPLES: usize = 16;

/// A point that stands for a patch of surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GatherSample {
    /// Metres, world space; the sub-sample nearest to the patch's middle. Of the sky: in the middle of its cell, on a sphere a thousand
    /// times as far away as the scene is large.
    pub position: Vec3,
    /// Square metres; of the sky, on that sphere.
    pub area: f32,
    /// Unit, world space, on the side that the sample stands for.
    pub normal: Vec3,
    /// Triangle that `position` lies on; `u32::MAX` of the sky.
    pub triangle: u32,
    /// Mean over the patch of the hemispherical reflectance.
    pub albedo: Vec3,
    /// Padding; zero.
    pub reserved: u32,
    /// Mean over the patch of the emitted radiance, W/(sr m^2).
    pub emission: Vec3,
    /// Padding; zero.
    pub reserved2: u32,
}

/// One of the points spread over a gather sample's patch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SubSample {
    /// Metres, world space, on the surface.
    pub position: Vec3,
    /// The triangle's normal, on the side that the sample stands for.
    pub normal: PackedNormal,
    /// Hemispherical reflectance.
    pub albedo: PackedUnit,
    /// Share of the patch's light that it stands for, `65535` is all of it; 0 fills up a patch that has fewer.
    pub(super) weight: u16,
}

impl SubSample {
    /// Share of the patch that it stands for, `0..=1`.
    pub fn weight(&self) -> f32 {
        f32::from(self.weight) * (1.0 / 65535.0)
    }
}

/// How a sub-sample's albedo follows its material's base colour.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DiffusePart {
    /// What the diffuse lobe adds to the albedo under a white base colour factor.
    pub white: PackedUnit,
    /// The material's index, its lower half first: whole numbers of 32 bits would leave gaps.
    material: [u16; 2],
}

impl DiffusePart {
    /// From its parts.
    pub fn new(white: PackedUnit, material: u32) -> Self {
        Self { white, material: [material as u16, (material >> 16) as u16] }
    }

    /// Index of the material.
    pub fn material(&self) -> u32 {
        u32::from(self.material[0]) | u32::from(self.material[1]) << 16
    }
}

/// What one material emits on a gather sample's patch.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Emitted {
    /// Index of the gather sample.
    pub sample: u32,
    /// Index of the material.
    pub material: u32,
    /// Mean over the whole patch, W/(sr m^2).
    pub radiance: Vec3,
}
