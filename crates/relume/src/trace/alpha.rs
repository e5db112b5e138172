//! Alpha masks: holes that every ray sees.

use std::collections::HashMap;

use glam::Vec2;

use crate::scene::{AlphaMode, Geometry, Scene, Wrap};

/// The alpha channel of one masked material.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaMask {
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` alpha values, 255 is opaque.
    pub alpha: Vec<u8>,
    /// Outside `0..1`, along u and v.
    pub wrap: [Wrap; 2],
    /// Solid where the interpolated alpha, in `0..=255`, is at least this.
    pub cutoff: f32,
}

impl AlphaMask {
    /// Whether there is a surface at `uv`; bilinear, as the textures are.
    pub fn is_solid(&self, uv: Vec2) -> bool {
        let u = (uv.x * self.width as f32 - 0.5).clamp(-1e9, 1e9);
        let v = (uv.y * self.height as f32 - 0.5).clamp(-1e9, 1e9);
        let (x, y) = (u.floor(), v.floor());
        let (fx, fy) = (u - x, v - y);
        let column = |x: i64| self.wrap[0].texel(x, self.width);
        let row = |y: i64| self.wrap[1].texel(y, self.height) * self.width;
        let (x0, x1) = (column(x as i64), column(x as i64 + 1));
        let (y0, y1) = (row(y as i64), row(y as i64 + 1));
        let at = |texel: usize| f32::from(self.alpha[texel]);
        let top = at(y0 + x0) * (1.0 - fx) + at(y0 + x1) * fx;
        let bottom = at(y1 + x0) * (1.0 - fx) + at(y1 + x1) * fx;
        top * (1.0 - fy) + bottom * fy >= self.cutoff
    }
}

/// Which triangles are masked, and by what. Most scenes have few; the others pay nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlphaMasks {
    /// The masks.
    pub masks: Vec<AlphaMask>,
    /// Masked triangles, ascending.
    pub triangles: Vec<u32>,
    /// For each masked triangle, its mask.
    pub mask_ids: Vec<u32>,
    /// For each masked triangle, the texture coordinates of its corners.
    pub uvs: Vec<[Vec2; 3]>,
}

impl AlphaMasks {
    /// The masks of a scene's alpha-masked materials.
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let mut masks = Self::default();
        let mut mask_of_material = HashMap::new();
        for (triangle, &material_id) in geometry.materials.iter().enumerate() {
            let material = &scene.materials[material_id as usize];
            let AlphaMode::Mask { cutoff } = material.alpha_mode else { continue };
            let texture_ref = material.base_color_texture;
            if texture_ref.is_none() && material.base_color.w >= cutoff {
                continue;
            }
            let mask_id = *mask_of_material.entry(material_id).or_insert_with(|| {
                // alpha factor * texel >= cutoff, with the factor moved to the other side
                let cutoff = 255.0 * cutoff / material.base_color.w.max(1e-6);
                masks.masks.push(match texture_ref.map(|reference| &scene.textures[reference.texture]) {
                    Some(texture) => AlphaMask {
                        width: texture.width,
                        height: texture.height,
                        alpha: texture.texels.iter().map(|texel| texel[3]).collect(),
                        wrap: texture.wrap,
                        cutoff,
                    },
                    // the factor alone is below the cutoff: a hole all over
                    None => {
                        AlphaMask { width: 1, height: 1, alpha: vec![255], wrap: [Wrap::Repeat; 2], cutoff }
                    }
                });
                masks.masks.len() as u32 - 1
            });
            masks.triangles.push(triangle as u32);
            masks.mask_ids.push(mask_id);
            let uv = |vertex: u32| {
                texture_ref.map_or(Vec2::ZERO, |reference| reference.uv(geometry.uvs[vertex as usize]))
            };
            masks.uvs.push(geometry.triangles[triangle].map(uv));
        }
        masks
    }

    /// Whether `triangle` has a mask.
    pub fn is_masked(&self, triangle: u32) -> bool {
        self.triangles.binary_search(&triangle).is_ok()
    }

    /// Whether there is a surface at barycentric (`u`, `v`) of `triangle`.
    pub fn is_solid(&self, triangle: u32, u: f32, v: f32) -> bool {
        let Ok(index) = self.triangles.binary_search(&triangle) else { return true };
        let [a, b, c] = self.uvs[index];
        self.masks[self.mask_ids[index] as usize].is_solid(a + (b - a) * u + (c - a) * v)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Vec3, Vec4};

    use super::*;
    use crate::scene::{Instance, Material, Mesh};

    /// Whether one triangle of a material without a texture is there.
    fn is_there(alpha: f32, alpha_mode: AlphaMode) -> bool {
        let base_color = Vec4::new(1.0, 1.0, 1.0, alpha);
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let instance =
            Instance { name: String::new(), mesh: 0, world_from_object: Affine3A::IDENTITY, object: 0 };
        let scene = Scene {
            meshes: vec![mesh],
            instances: vec![instance],
            materials: vec![Material { base_color, alpha_mode, ..Material::default() }],
            ..Scene::default()
        };
        let masks = AlphaMasks::new(&scene, &Geometry::new(&scene));
        [(0.0, 0.0), (0.3, 0.3), (0.9, 0.1)].iter().all(|&(u, v)| masks.is_solid(0, u, v))
    }

    #[test]
    fn a_mask_without_a_texture_cuts_by_its_factor() {
        let mask = AlphaMode::Mask { cutoff: 0.5 };
        assert!(is_there(0.5, mask) && is_there(1.0, mask) && is_there(0.2, AlphaMode::Opaque));
        assert!(!is_there(0.49, mask) && !is_there(0.0, mask));
        assert!(is_there(0.0, AlphaMode::Mask { cutoff: 0.0 }));
    }
}
