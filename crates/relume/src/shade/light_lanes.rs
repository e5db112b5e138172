use glam::Vec3;

use super::light::{MIN_DISTANCE2, PreparedLight, Shape};

/// Points that are lit side by side.
pub(crate) const LANES: usize = 16;

/// One value a point.
pub(crate) type Lane = [f32; LANES];

/// What arrives at points side by side, as [`PreparedLight::center`] has it.
pub(crate) struct CenterLanes {
    /// Unit, to the light, by axis.
    pub(crate) direction: [Lane; 3],
    /// Metres; infinite for distant lights.
    pub(crate) distance: Lane,
    /// What `irradiance` is multiplied by; 0 where nothing arrives.
    pub(crate) factor: Lane,
    /// W/m^2 under a factor of one.
    pub(crate) irradiance: Vec3,
}

impl PreparedLight {
    /// [`Self::center`] of points side by side, positions by axis; to be compiled within what calls it. Nothing of a dome.
    #[inline(always)]
    pub(crate) fn centers(&self, position: &[Lane; 3]) -> CenterLanes {
        let (mut direction, mut distances) = ([[0.0; LANES]; 3], [f32::INFINITY; LANES]);
        let mut factor = [0.0; LANES];
        match &self.shape {
            Shape::Local { position: center, radius2, cone } => {
                // no cone: a factor of one whatever the cosine
                let (axis, cos_outer, inverse_rim) = cone
                    .map_or((Vec3::ZERO, -1.0, 1.0), |cone| (cone.axis, cone.cos_outer, cone.inverse_rim));
                for i in 0..LANES {
                    let (x, y, z) =
                        (center.x - position[0][i], center.y - position[1][i], center.z - position[2][i]);
                    let distance2 = x * x + y * y + z * z;
                    let distance = distance2.sqrt();
                    let apart = distance2 > 1e-30;
                    let recip = 1.0 / if apart { distance } else { 1.0 };
                    let (dx, dy, dz) =
                        if apart { (x * recip, y * recip, z * recip) } else { (0.0, 1.0, 0.0) };
                    let cos = -(dx * axis.x + dy * axis.y + dz * axis.z);
                    let spot = ((cos - cos_outer) * inverse_rim).clamp(0.0, 1.0);
                    let squared = distance2.max(*radius2);
                    (direction[0][i], direction[1][i], direction[2][i]) = (dx, dy, dz);
                    distances[i] = distance;
                    factor[i] = if squared >= MIN_DISTANCE2 { spot * spot / squared } else { 0.0 };
                }
            }
            Shape::Distant { direction: towards, .. } => {
                direction = towards.to_array().map(|axis| [axis; LANES]);
                factor = [1.0; LANES];
            }
            Shape::Dome(_) => {}
        }
        CenterLanes { direction, distance: distances, factor, irradiance: self.color }
    }
}
