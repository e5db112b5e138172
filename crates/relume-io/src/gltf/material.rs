//! glTF materials that the scene's primitives use.

use std::collections::HashMap;

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::{AlphaMode as JsonAlphaMode, Material as JsonMaterial};
use ::gltf::json::validation::Checked;
use relume::Result;
use relume::glam::{Affine2, Vec2, Vec3, Vec4};
use relume::scene::{AlphaMode, ColorSpace, Material, Texture, TextureRef};

use super::document::Document;
use super::texture::Textures;
use super::transmission::transmission;

/// What a material reads of a mesh's coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Coordinates {
    /// Whether it has any texture.
    pub(super) textured: bool,
    /// The `n` of `TEXCOORD_n`.
    pub(super) set: u32,
    /// The normal map's `texture_from_mesh`.
    pub(super) normal_map: Option<Affine2>,
}

/// The materials asked for so far.
#[derive(Debug)]
pub(super) struct Materials<'a> {
    document: &'a Document<'a>,
    converted: Vec<(Material, Coordinates)>,
    /// By index in the file; `None` is the material of primitives without one.
    index_of: HashMap<Option<usize>, usize>,
    textures: Textures<'a>,
}

/// A texture as a material names it.
#[derive(Clone, Copy, Debug)]
struct Use {
    texture: usize,
    set: u32,
    texture_from_mesh: Affine2,
}

impl<'a> Materials<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self { document, converted: Vec::new(), index_of: HashMap::new(), textures: Textures::new(document) }
    }

    /// The scene's index of a material, converted when it is first asked for.
    pub(super) fn request(&mut self, index: Option<usize>, warnings: &mut Vec<String>) -> Result<usize> {
        if let Some(&known) = self.index_of.get(&index) {
            return Ok(known);
        }
        let json = index.and_then(|index| Some((index, self.document.root.materials.get(index)?)));
        let converted = match json {
            Some((index, json)) => self.convert(index, json, warnings)?,
            None => {
                let material = Material { name: "default".to_owned(), ..Material::default() };
                (material, Coordinates::default())
            }
        };
        self.converted.push(converted);
        self.index_of.insert(index, self.converted.len() - 1);
        Ok(self.converted.len() - 1)
    }

    /// What the scene's material `index` reads of a mesh's coordinates.
    pub(super) fn coordinates(&self, index: usize) -> Coordinates {
        self.converted[index].1
    }

    /// All materials and the textures they use, decoded.
    pub(super) fn finish(self, warnings: &mut Vec<String>) -> Result<(Vec<Material>, Vec<Texture>)> {
        let textures = self.textures.decode(warnings)?;
        Ok((self.converted.into_iter().map(|(material, _)| material).collect(), textures))
    }

    fn convert(
        &mut self,
        index: usize,
        json: &JsonMaterial,
        warnings: &mut Vec<String>,
    ) -> Result<(Material, Coordinates)> {
        let name = json.name.clone().unwrap_or_else(|| format!("material {index}"));
        let pbr = &json.pbr_metallic_roughness;
        let fail = |message: &str| self.document.fail(format!("material `{name}`: {message}"));
        let uses = [
            pbr.base_color_texture.as_ref().map(use_of),
            pbr.metallic_roughness_texture.as_ref().map(use_of),
            json.normal_texture.as_ref().map(normal_use).transpose().map_err(|e| fail(&e))?,
            json.emissive_texture.as_ref().map(use_of),
            json.extensions
                .as_ref()
                .and_then(|e| e.transmission.as_ref()?.transmission_texture.as_ref())
                .map(use_of),
        ];
        let finite = uses.iter().flatten().all(|texture| texture.texture_from_mesh.is_finite());
        let strength = json.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
        let emission = Vec3::from_array(json.emissive_factor.0) * strength;
        let base_color = Vec4::from_array(pbr.base_color_factor.0);
        let normal_scale = json.normal_texture.as_ref().map_or(1.0, |normal| normal.scale);
        let numbers = [pbr.metallic_factor.0, pbr.roughness_factor.0, normal_scale];
        if !(finite
            && emission.is_finite()
            && base_color.is_finite()
            && numbers.iter().all(|n| n.is_finite()))
        {
            return Err(fail("has a factor that is not a finite number; mend it"));
        }
        if emission.min_element() < 0.0 {
            return Err(fail("has a negative emission; mend it"));
        }
        let glass = transmission(json, &name, warnings).map_err(|message| fail(&message))?;
        let mut material = Material {
            base_color: base_color.clamp(Vec4::ZERO, Vec4::ONE),
            metallic: pbr.metallic_factor.0.clamp(0.0, 1.0),
            roughness: pbr.roughness_factor.0.clamp(0.0, 1.0),
            normal_scale,
            emission,
            alpha_mode: alpha_mode(json, &name, glass.factor > 0.0, warnings),
            double_sided: json.double_sided,
            transmission: glass.factor,
            ior: glass.ior,
            interior: glass.interior,
            name,
            ..Material::default()
        };
        let coordinates = coordinates(&uses, &material.name, warnings);
        self.add_textures(&mut material, &uses)?;
        Ok((material, coordinates))
    }

    fn add_textures(&mut self, material: &mut Material, uses: &[Option<Use>; 5]) -> Result<()> {
        let [base_color, metallic_roughness, normal, emission, transmission] = uses;
        let mut request = |used: &Option<Use>, color_space| -> Result<Option<TextureRef>> {
            let Some(used) = used else { return Ok(None) };
            let texture = self.textures.request(used.texture, color_space, &material.name)?;
            Ok(Some(TextureRef { texture, texture_from_mesh: used.texture_from_mesh }))
        };
        let textures = (
            request(base_color, ColorSpace::Srgb)?,
            request(metallic_roughness, ColorSpace::Linear)?,
            request(normal, ColorSpace::Linear)?,
            request(emission, ColorSpace::Srgb)?,
            request(transmission, ColorSpace::Linear)?,
        );
        (
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.normal_texture,
            material.emission_texture,
            material.transmission_texture,
        ) = textures;
        Ok(())
    }
}

/// KHR_texture_transform as one map: scaled, then turned, then moved. A turn by a positive angle is
/// counter-clockwise as the image is seen, v pointing down.
fn affine(transform: &TextureTransform) -> Affine2 {
    let (sin, cos) = transform.rotation.0.sin_cos();
    let scale = transform.scale.0;
    Affine2::from_cols(
        scale[0] * Vec2::new(cos, -sin),
        scale[1] * Vec2::new(sin, cos),
        Vec2::from_array(transform.offset.0),
    )
}

fn with_transform(texture: usize, set: u32, transform: Option<&TextureTransform>) -> Use {
    Use {
        texture,
        set: transform.and_then(|t| t.tex_coord).unwrap_or(set),
        texture_from_mesh: transform.map_or(Affine2::IDENTITY, affine),
    }
}

fn use_of(info: &::gltf::json::texture::Info) -> Use {
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    with_transform(info.index.value(), info.tex_coord, transform)
}

fn normal_use(info: &::gltf::json::material::NormalTexture) -> Result<Use, String> {
    let json = info.extensions.as_ref().and_then(|e| e.others.get("KHR_texture_transform"));
    let transform: Option<TextureTransform> = json
        .map(|json| ::gltf::json::deserialize::from_value(json.clone()))
        .transpose()
        .map_err(|e| format!("KHR_texture_transform of the normal map: {e}"))?;
    Ok(with_transform(info.index.value(), info.tex_coord, transform.as_ref()))
}

/// A mesh of the scene has one set of coordinates: that of the material's first texture.
fn coordinates(uses: &[Option<Use>; 5], name: &str, warnings: &mut Vec<String>) -> Coordinates {
    let mut sets = uses.iter().flatten().map(|texture| texture.set);
    let Some(set) = sets.next() else { return Coordinates::default() };
    if let Some(other) = sets.find(|&other| other != set) {
        warnings.push(format!(
            "material `{name}` reads TEXCOORD_{set} and TEXCOORD_{other}; all its textures are read at TEXCOORD_{set}"
        ));
    }
    Coordinates { textured: true, set, normal_map: uses[2].map(|normal| normal.texture_from_mesh) }
}

fn alpha_mode(json: &JsonMaterial, name: &str, is_glass: bool, warnings: &mut Vec<String>) -> AlphaMode {
    match json.alpha_mode {
        Checked::Valid(JsonAlphaMode::Mask) => {
            let cutoff = json.alpha_cutoff.unwrap_or_default().0;
            if !(0.0..=1.0).contains(&cutoff) {
                warnings.push(format!(
                    "material `{name}` has the alpha cutoff {cutoff}, which was brought to 0..1"
                ));
            }
            AlphaMode::Mask { cutoff: if cutoff.is_nan() { 0.5 } else { cutoff.clamp(0.0, 1.0) } }
        }
        // what such glass lets through is said by its transmission
        Checked::Valid(JsonAlphaMode::Blend) if is_glass => AlphaMode::Opaque,
        Checked::Valid(JsonAlphaMode::Blend) => {
            warnings
                .push(format!("material `{name}` is blended; it is cut out where its alpha is below 0.5"));
            AlphaMode::Mask { cutoff: 0.5 }
        }
        _ => AlphaMode::Opaque,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::gltf::json::extensions::texture::{
        TextureTransformOffset, TextureTransformRotation, TextureTransformScale,
    };

    #[test]
    fn texture_transform_matches_the_specification_example() {
        // "Only the lower left quadrant of the source image, rotated clockwise 90 degrees."
        let transform = TextureTransform {
            offset: TextureTransformOffset([0.0, 1.0]),
            rotation: TextureTransformRotation(std::f32::consts::FRAC_PI_2),
            scale: TextureTransformScale([0.5, 0.5]),
            ..TextureTransform::default()
        };
        let map = affine(&transform);
        for (uv, expected) in [([0.0, 0.0], [0.0, 1.0]), ([1.0, 0.0], [0.0, 0.5]), ([0.0, 1.0], [0.5, 1.0])] {
            let mapped = map.transform_point2(Vec2::from_array(uv));
            assert!((mapped - Vec2::from_array(expected)).length() < 1e-6, "{uv:?} -> {mapped}");
        }
    }
}
