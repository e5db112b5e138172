//! Cameras and KHR_lights_punctual.

use ::gltf::json::camera::Camera as JsonCamera;
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type};
use ::gltf::json::validation::Checked;
use relume::glam::{Affine3A, Vec3};
use relume::{Camera, LightKind};

/// A perspective camera; `None` and a warning for an orthographic one.
pub(super) fn camera(
    json: &JsonCamera,
    world_from_camera: Affine3A,
    name: &str,
    warnings: &mut Vec<String>,
) -> Result<Option<Camera>, String> {
    use ::gltf::json::camera::Type;
    let perspective = match (json.type_, &json.perspective) {
        (Checked::Valid(Type::Perspective), Some(perspective)) => perspective,
        (Checked::Valid(Type::Perspective), None) => {
            return Err("its camera has no `perspective`; export the camera again".to_owned());
        }
        _ => {
            warnings.push(format!("camera `{name}` is orthographic and was left out"));
            return Ok(None);
        }
    };
    let vertical_fov = perspective.yfov;
    if !(vertical_fov > 0.0 && vertical_fov < std::f32::consts::PI) {
        return Err(format!("its camera has a `yfov` of {vertical_fov}; it must lie between 0 and pi"));
    }
    Ok(Some(Camera { name: name.to_owned(), world_from_camera, vertical_fov }))
}

/// A light that shines along its node's -Z. Candela and lux are taken as W/sr and W/m^2.
pub(super) fn light_kind(json: &JsonLight, world_from_light: Affine3A) -> Result<LightKind, String> {
    let color = Vec3::from_array(json.color) * json.intensity;
    if !(color.is_finite() && color.min_element() >= 0.0) {
        return Err("its light has a colour or intensity that is negative or not finite".to_owned());
    }
    let position = Vec3::from(world_from_light.translation);
    let direction = -Vec3::from(world_from_light.matrix3.z_axis);
    match json.type_ {
        Checked::Valid(Type::Directional) => {
            Ok(LightKind::Distant { direction, irradiance: color, angle: 0.0 })
        }
        Checked::Valid(Type::Point) => Ok(LightKind::Omni { position, intensity: color, radius: 0.0 }),
        Checked::Valid(Type::Spot) => {
            let cone = json.spot.as_ref().ok_or("its spot light has no `spot`")?;
            let (inner, outer) = (cone.inner_cone_angle.to_degrees(), cone.outer_cone_angle.to_degrees());
            // pi/2 as f32 is more than 90 degrees by a rounding.
            let right_angle = 90.0 * (1.0 + 4.0 * f32::EPSILON);
            if !(0.0 <= inner && inner <= outer && outer <= right_angle) {
                return Err(format!(
                    "its spot light has cone angles of {inner} and {outer} degrees; they must be 0 <= inner <= outer <= 90"
                ));
            }
            let (inner_angle, outer_angle) = (inner.min(90.0), outer.min(90.0));
            let target = position + direction;
            Ok(LightKind::Spot { position, target, intensity: color, inner_angle, outer_angle, radius: 0.0 })
        }
        Checked::Invalid => Err("its light is of an unknown type".to_owned()),
    }
}
