use glam::{Affine2, Vec2, Vec3, Vec4};

/// A glTF metallic-roughness material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the file.
    pub name: String,
    /// Linear RGB factor and alpha.
    pub base_color: Vec4,
    /// sRGB colour and alpha.
    pub base_color_texture: Option<TextureRef>,
    /// Factor, `0..=1`.
    pub metallic: f32,
    /// Factor on perceptual roughness, `0..=1`.
    pub roughness: f32,
    /// Scales the dielectric specular reflection (normal and grazing), `0..=1`, as the factor of
    /// KHR_materials_specular does; 0 leaves a purely diffuse dielectric.
    pub specular: f32,
    /// Linear: roughness in G, metallic in B.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent space, +Y up.
    pub normal_texture: Option<TextureRef>,
    /// Scales X and Y of the normal map.
    pub normal_scale: f32,
    /// Emitted radiance, W/(sr m^2): the factor times the strength.
    pub emission: Vec3,
    /// sRGB, multiplies `emission`.
    pub emission_texture: Option<TextureRef>,
    /// Whether alpha cuts holes.
    pub alpha_mode: AlphaMode,
    /// A one-sided surface neither reflects nor emits at its back, but blocks light there; one that transmits reflects there all the same.
    pub double_sided: bool,
    /// The part of the light within a dielectric that passes its surface instead of being scattered back, `0..=1`
    /// (KHR_materials_transmission). It is tinted by the base colour.
    pub transmission: f32,
    /// Linear: R multiplies `transmission`.
    pub transmission_texture: Option<TextureRef>,
    /// Refractive index of a dielectric, at least 1 (KHR_materials_ior).
    pub ior: f32,
    /// What lies behind a transmitting surface.
    pub interior: Interior,
}

/// What a transmitting surface bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Interior {
    /// A pane too thin to bend light.
    #[default]
    Thin,
    /// A solid (KHR_materials_volume): light is refracted where it enters, at the front, and where it leaves.
    Solid {
        /// Light fades by `exp(-extinction * metres)`.
        extinction: Vec3,
    },
}

impl Material {
    /// Whether surfaces reflect light at their backs.
    pub fn shows_back(&self) -> bool {
        self.double_sided || self.transmission > 0.0
    }
}

/// How a material uses its alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Where alpha is below the cutoff there is nothing, for any ray.
    Mask {
        /// `0..=1`.
        cutoff: f32,
    },
}

/// A texture and the map from the mesh's coordinates to its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`super::Scene::textures`].
    pub texture: usize,
    /// KHR_texture_transform, or the identity.
    pub texture_from_mesh: Affine2,
}

impl TextureRef {
    /// A texture used with the mesh's own coordinates.
    pub fn new(texture: usize) -> Self {
        Self { texture, texture_from_mesh: Affine2::IDENTITY }
    }

    /// The texture's coordinates at the mesh's `uv`.
    pub fn uv(&self, uv: Vec2) -> Vec2 {
        self.texture_from_mesh.transform_point2(uv)
    }
}

impl Default for Material {
    /// A white rough dielectric: the glTF default, but not metallic.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            specular: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission: Vec3::ZERO,
            emission_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            transmission: 0.0,
            transmission_texture: None,
            ior: 1.5,
            interior: Interior::Thin,
        }
    }
}
