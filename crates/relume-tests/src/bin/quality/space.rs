//! The free space around what a camera sees: where a lighting artist would put a light.

use relume::Camera;
use relume::glam::{Vec2, Vec3};
use relume::scene::Geometry;
use relume::trace::sampling::{cosine_hemisphere, hash, uniform_sphere, unit};
use relume::trace::{Accel, Ray};

/// Rays along a row of the grid that looks for surfaces.
const COLUMNS: usize = 32;
/// Rows of that grid.
const ROWS: usize = 24;
/// Places tried before a draw gives up.
const TRIES: u32 = 64;
/// From a surface to a lamp that is close to it, metres.
pub(crate) const NEAR: f32 = 0.1;

/// A point that the camera sees.
#[derive(Clone, Copy, Debug)]
struct SeenPoint {
    position: Vec3,
    /// Unit, geometric, towards the camera.
    normal: Vec3,
}

/// Where lights can stand, and what they can be pointed at.
pub(crate) struct FreeSpace<'a> {
    accel: &'a Accel,
    camera: Vec3,
    seen: Vec<SeenPoint>,
    /// Root mean square distance of what is seen from its centre, metres.
    pub(crate) radius: f32,
}

/// Random numbers of one light: the same seed gives the same ones.
#[derive(Clone, Debug)]
pub(crate) struct Draws {
    seed: u32,
    drawn: u32,
}

impl Draws {
    /// Those of try `attempt` at light `light`.
    pub(crate) fn new(seed: u32, light: u32, attempt: u32) -> Self {
        Self { seed: hash(hash(seed, light), attempt), drawn: 0 }
    }

    /// In `[0, 1)`.
    pub(crate) fn unit(&mut self) -> f32 {
        self.drawn += 1;
        unit(hash(self.seed, self.drawn))
    }

    /// In `[low, high)`.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    fn pair(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }
}

impl<'a> FreeSpace<'a> {
    /// Looks through `camera` with an image of `size` pixels.
    pub(crate) fn new(geometry: &Geometry, accel: &'a Accel, camera: &Camera, size: (usize, usize)) -> Self {
        let origin = camera.position();
        let scale = (size.0 as f32 / COLUMNS as f32, size.1 as f32 / ROWS as f32);
        let look = |index: usize| {
            let (x, y) = ((index % COLUMNS) as f32 + 0.5, (index / COLUMNS) as f32 + 0.5);
            let direction = camera.direction(x * scale.0, y * scale.1, size.0, size.1);
            let hit = accel.closest(&Ray::new(origin, direction));
            hit.is_hit().then(|| {
                let normal = geometry.area_vector(hit.triangle as usize).normalize_or_zero();
                let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
                SeenPoint { position: origin + direction * hit.t, normal }
            })
        };
        let seen: Vec<_> = (0..COLUMNS * ROWS).filter_map(look).collect();
        let count = seen.len().max(1) as f32;
        let center = seen.iter().map(|point| point.position).sum::<Vec3>() / count;
        let squares: f32 = seen.iter().map(|point| point.position.distance_squared(center)).sum();
        Self { accel, camera: origin, seen, radius: (squares / count).sqrt().max(1e-3) }
    }

    /// A point that the camera sees, just off its surface; the camera's own where it sees nothing.
    fn seen(&self, draws: &mut Draws) -> SeenPoint {
        let index = (draws.unit() * self.seen.len() as f32) as usize;
        let point = self.seen.get(index).copied();
        let mut point = point.unwrap_or(SeenPoint { position: self.camera, normal: Vec3::Y });
        point.position += point.normal * (1e-3 * self.radius);
        point
    }

    /// Metres free from `origin` along the unit `direction`, at most `most`.
    fn free(&self, origin: Vec3, direction: Vec3, most: f32) -> f32 {
        self.accel.closest(&Ray::new(origin, direction)).t.min(most)
    }

    /// Whether nothing is closer to `position` than `distance` along the axes and the diagonals.
    fn is_clear(&self, position: Vec3, distance: f32) -> bool {
        let directions = (0..27).filter(|&i| i != 13).map(|i| {
            let axis = |k: i32| (i / k % 3 - 1) as f32;
            Vec3::new(axis(1), axis(3), axis(9)).normalize()
        });
        directions.into_iter().all(|direction| self.free(position, direction, f32::INFINITY) >= distance)
    }

    /// A place in the open: reached in a straight line from what the camera sees, or, every other time, around one more
    /// corner.
    pub(crate) fn place(&self, draws: &mut Draws) -> Vec3 {
        for _ in 0..TRIES {
            let point = self.seen(draws);
            let mut direction = cosine_hemisphere(point.normal, draws.pair());
            let mut position = point.position;
            let legs = 1 + u32::from(draws.unit() < 0.5);
            for _ in 0..legs {
                let free = self.free(position, direction, 2.0 * self.radius);
                position += direction * (free * draws.between(0.15, 0.85));
                direction = uniform_sphere(draws.pair());
            }
            if self.is_clear(position, 0.05 * self.radius) {
                return position;
            }
        }
        self.camera
    }

    /// A place [`NEAR`] in front of a surface that the camera sees, and no closer to any other; `None` where there is
    /// none.
    pub(crate) fn place_near(&self, draws: &mut Draws) -> Option<Vec3> {
        (0..TRIES).find_map(|_| {
            let point = self.seen(draws);
            let position = point.position + point.normal * (NEAR - 1e-3 * self.radius);
            let open = self.free(point.position, point.normal, f32::INFINITY) > 1.5 * NEAR;
            (open && self.is_clear(position, 0.99 * NEAR)).then_some(position)
        })
    }

    /// What a spot at `position` could be pointed at: a point that the camera sees and that the spot reaches, where a
    /// few tries find one.
    pub(crate) fn target(&self, position: Vec3, draws: &mut Draws) -> Vec3 {
        let mut target = self.seen(draws).position;
        for _ in 0..8 {
            let far_enough = target.distance(position) > 1e-2 * self.radius;
            if far_enough && !self.accel.occluded(&Ray::between(position, target)) {
                return target;
            }
            target = self.seen(draws).position;
        }
        if target == position { position - Vec3::Y } else { target }
    }

    /// The way the light of a sun travels that reaches what the camera sees, or what lies around one corner from it,
    /// from 10 to 80 degrees above the horizon; `None` where the sky is not found.
    pub(crate) fn sun(&self, draws: &mut Draws) -> Option<Vec3> {
        (0..4 * TRIES).find_map(|_| {
            let point = self.seen(draws);
            let elevation = draws.between(10.0, 80.0).to_radians();
            let (sin, cos) = (std::f32::consts::TAU * draws.unit()).sin_cos();
            let towards = Vec3::new(cos * elevation.cos(), elevation.sin(), sin * elevation.cos());
            let direct = towards.dot(point.normal) > 0.0;
            let start = if direct { point.position } else { self.place(draws) };
            (!self.accel.occluded(&Ray::new(start, towards))).then_some(-towards)
        })
    }
}
