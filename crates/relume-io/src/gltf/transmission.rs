//! KHR_materials_transmission, KHR_materials_ior and KHR_materials_volume: glass.

use ::gltf::json::extensions::material::Volume;
use ::gltf::json::material::Material as JsonMaterial;
use relume::glam::Vec3;
use relume::scene::Interior;
use relume::shade::POLISHED_ROUGHNESS;

/// Refractive index where a file says nothing, as glTF has it.
const USUAL_IOR: f32 = 1.5;
/// Colours that a solid takes on at the attenuation distance are not darker: light would end at once.
const DARKEST: f32 = 1e-6;

/// How light passes a material's surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transmission {
    /// `0..=1`.
    pub(super) factor: f32,
    pub(super) ior: f32,
    pub(super) interior: Interior,
}

/// Reads what `material` says of glass; an error is a sentence about it.
pub(super) fn transmission(
    material: &JsonMaterial,
    name: &str,
    warnings: &mut Vec<String>,
) -> Result<Transmission, String> {
    let extensions = material.extensions.as_ref();
    let factor = extensions.and_then(|e| e.transmission.as_ref()).map_or(0.0, |t| t.transmission_factor.0);
    let ior = extensions.and_then(|e| e.ior.as_ref()).map_or(USUAL_IOR, |ior| ior.ior.0);
    if !factor.is_finite() {
        return Err("has a transmission that is not a finite number; mend it".to_owned());
    }
    // 0 stands for an index without bounds, of materials that were converted from specular-glossiness
    if !(1.0..=1e3).contains(&ior) && ior != 0.0 {
        return Err(format!("has the refractive index {ior}; give one of at least 1"));
    }
    if ior == 0.0 {
        warnings.push(format!("material `{name}` has the refractive index 0; it is taken for {USUAL_IOR}"));
    }
    let surface = &material.pbr_metallic_roughness;
    if factor > 0.0 && surface.roughness_factor.0 > POLISHED_ROUGHNESS.1 {
        let where_rough = match surface.metallic_roughness_texture {
            Some(_) => format!(", where its texture makes it rougher than {}", POLISHED_ROUGHNESS.1),
            None => String::new(),
        };
        warnings.push(format!(
            "material `{name}` is frosted glass{where_rough}; what lies behind it is shown as through clear glass"
        ));
    }
    Ok(Transmission {
        factor: factor.clamp(0.0, 1.0),
        ior: if ior == 0.0 { USUAL_IOR } else { ior },
        interior: extensions.and_then(|e| e.volume.as_ref()).map_or(Ok(Interior::Thin), interior)?,
    })
}

/// What `volume` bounds. How thick it is, rays find out by themselves.
fn interior(volume: &Volume) -> Result<Interior, String> {
    let thickness = volume.thickness_factor.0;
    if !thickness.is_finite() || thickness < 0.0 {
        return Err(format!("has the thickness {thickness}; give one of at least 0"));
    }
    if thickness == 0.0 {
        return Ok(Interior::Thin);
    }
    let (color, distance) = (Vec3::from(volume.attenuation_color.0), volume.attenuation_distance.0);
    if !color.is_finite() || color.min_element() < 0.0 || distance.is_nan() || distance <= 0.0 {
        return Err("has an attenuation colour or distance out of range; mend it".to_owned());
    }
    let depth = color.clamp(Vec3::splat(DARKEST), Vec3::ONE).map(|channel| -channel.ln());
    Ok(Interior::Solid { extinction: depth / distance })
}
