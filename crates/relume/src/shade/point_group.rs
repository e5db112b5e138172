use glam::Vec3;

/// Against rounding: cosines nearer than this to those at which light ends count as within it, and spheres are as much larger.
pub(super) const MARGIN: f32 = 1e-4;

/// Points on surfaces that are asked for together whether a light could reach any of them
/// ([`PreparedLight::may_reach`](super::PreparedLight::may_reach)): a sphere around them, and a cone around their normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointGroup {
    /// Metres, world space.
    pub(super) center: Vec3,
    /// Metres; negative where there is no point.
    pub(super) radius: f32,
    axis: Vec3,
    /// Of the half angle of the cone, which is at most a right one; more is kept as `None`: such points face everywhere.
    spread: Option<Angle>,
}

/// An angle from zero to a right one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Angle {
    pub(super) sin: f32,
    pub(super) cos: f32,
}

impl Angle {
    pub(super) fn of_sin(sin: f32) -> Self {
        Self { sin, cos: (1.0 - sin * sin).max(0.0).sqrt() }
    }

    /// The sum, where that is below a right angle.
    fn plus(self, other: Self) -> Option<Self> {
        let cos = self.cos * other.cos - self.sin * other.sin;
        (cos > 0.0).then_some(Self { sin: self.sin * other.cos + self.cos * other.sin, cos })
    }
}

impl PointGroup {
    /// Positions, metres, and unit geometric normals.
    pub fn new(points: impl Iterator<Item = (Vec3, Vec3)> + Clone) -> Self {
        let (mut low, mut high, mut sum) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::ZERO);
        for (position, normal) in points.clone() {
            (low, high, sum) = (low.min(position), high.max(position), sum + normal);
        }
        let (center, axis) = (0.5 * (low + high), sum.normalize_or_zero());
        let (mut radius2, mut sin, mut bend) = (-1.0_f32, 0.0_f32, 1.0_f32);
        for (position, normal) in points {
            radius2 = radius2.max(position.distance_squared(center));
            // the sine by itself: of normals nearly alike, the cosine has lost all digits
            (sin, bend) = (sin.max(axis.cross(normal).length()), bend.min(axis.dot(normal)));
        }
        let radius = if radius2 < 0.0 { -1.0 } else { radius2.sqrt() * (1.0 + MARGIN) };
        let spread = (bend > 0.0 && sin < 1.0).then(|| Angle::of_sin(sin));
        Self { center, radius, axis, spread }
    }

    /// Whether one of the points could face light that comes from directions within `light` of the unit `direction` towards it.
    pub(super) fn may_face(&self, direction: Vec3, light: Angle) -> bool {
        let away = self.spread.and_then(|spread| spread.plus(light));
        away.is_none_or(|away| self.axis.dot(direction) > -away.sin - MARGIN)
    }
}
