//! Small encodings of normals and reflectances.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// A unit vector in 32 bits: octahedral, 16 bits a side; within 0.004 degrees
/// (Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors").
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PackedNormal([u16; 2]);

impl PackedNormal {
    /// +Z.
    pub const UP: Self = Self([32768, 32768]);

    /// Packs a unit vector.
    pub fn new(normal: Vec3) -> Self {
        let folded = normal / normal.abs().element_sum().max(1e-20);
        let mut flat = Vec2::new(folded.x, folded.y);
        if folded.z < 0.0 {
            flat = (Vec2::ONE - Vec2::new(flat.y, flat.x).abs()) * signs(flat);
        }
        let [x, y] = ((flat * 0.5 + 0.5) * 65535.0).round().to_array();
        Self([x as u16, y as u16])
    }

    /// Its place on the unfolded octahedron, -1 to 1.
    pub(crate) fn sides(self) -> [f32; 2] {
        self.0.map(|side| f32::from(side) * (2.0 / 65535.0) - 1.0)
    }

    /// The unit vector.
    pub fn get(self) -> Vec3 {
        unpacked(self.sides()).into()
    }
}

/// The unit vector at a place of the unfolded octahedron; to be compiled within loops over places side by side.
#[inline(always)]
pub(crate) fn unpacked([x, y]: [f32; 2]) -> [f32; 3] {
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let (x, y) = (if x >= 0.0 { x - fold } else { x + fold }, if y >= 0.0 { y - fold } else { y + fold });
    let recip = 1.0 / (x * x + y * y + z * z).sqrt();
    [x * recip, y * recip, z * recip]
}

fn signs(v: Vec2) -> Vec2 {
    Vec2::new(if v.x >= 0.0 { 1.0 } else { -1.0 }, if v.y >= 0.0 { 1.0 } else { -1.0 })
}

/// A reflectance: three numbers in `0..=1`, 16 bits each; within 8e-6.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PackedUnit([u16; 3]);

impl PackedUnit {
    /// Three zeros.
    pub const ZERO: Self = Self([0; 3]);

    /// Packs numbers in `0..=1`; others are clamped.
    pub fn new(value: Vec3) -> Self {
        let scaled = (value.clamp(Vec3::ZERO, Vec3::ONE) * 65535.0).round();
        Self(scaled.to_array().map(|channel| channel as u16))
    }

    /// The numbers.
    pub fn get(self) -> Vec3 {
        Vec3::from(self.0.map(f32::from)) * (1.0 / 65535.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{sobol_2d, uniform_sphere};

    #[test]
    fn normals_survive_packing() {
        let axes = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
        let random = (0..5000).map(|i| uniform_sphere(sobol_2d(i, 0, 1)));
        for normal in axes.into_iter().chain(random) {
            let distance = (PackedNormal::new(normal).get() - normal).length();
            // the worst, half a step along both sides where all three axes are alike, is 6.5e-5
            assert!(distance < 7e-5, "{normal} is off by {distance}");
        }
    }

    #[test]
    fn reflectances_survive_packing() {
        for i in 0..1000 {
            let value = Vec3::new(i as f32 / 999.0, 0.5, 1.0);
            assert!((PackedUnit::new(value).get() - value).abs().max_element() < 8e-6);
        }
    }
}
