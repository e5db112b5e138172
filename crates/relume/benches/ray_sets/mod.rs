//! The rays that rates are told for: of one camera over one scene.
//!
//! Also the rays of `crates/relume-tests/benches/embree`.

use std::path::{Path, PathBuf};

use relume::Scene;
use relume::glam::Vec3;
use relume::scene::Geometry;
use relume::trace::sampling::{cosine_hemisphere, hash, sobol_2d};
use relume::trace::{Accel, Hit, Ray, offset_origin};

/// Pixels along a side of the image that the camera's rays make.
const SIDE: usize = 256;

/// The scene that rates are told for.
pub(crate) fn scene_file() -> PathBuf {
    let shared = std::env::var_os("RELUME_SCENES").map(|folder| Path::new(&folder).join("sponza.glb"));
    let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/arcade.glb");
    shared.filter(|path| path.is_file()).unwrap_or(demo)
}

/// A point that the camera sees, just in front of its surface.
#[derive(Clone, Copy)]
struct Seen {
    position: Vec3,
    /// Unit, towards the camera.
    normal: Vec3,
}

/// The rays of each row of the table, in the order of the image that they belong to.
pub(crate) struct Rays {
    /// From the camera through the pixels.
    pub(crate) primary: Vec<Ray>,
    /// From what the camera sees, one into the hemisphere over each point: incoherent.
    pub(crate) hemisphere: Vec<Ray>,
    /// From what the camera sees to other such points at random.
    pub(crate) between: Vec<Ray>,
    /// From what the camera sees to one place in its midst: coherent.
    pub(crate) to_light: Vec<Ray>,
}

impl Rays {
    /// Of the first camera.
    ///
    /// # Panics
    /// If it sees nothing.
    pub(crate) fn new(scene: &Scene, geometry: &Geometry, accel: &Accel) -> Self {
        let camera = &scene.cameras[0];
        let origin: Vec3 = camera.world_from_camera.translation.into();
        let through = |x: usize, y: usize| camera.direction(x as f32 + 0.5, y as f32 + 0.5, SIDE, SIDE);
        let primary: Vec<Ray> =
            (0..SIDE * SIDE).map(|pixel| Ray::new(origin, through(pixel % SIDE, pixel / SIDE))).collect();
        let mut hits = vec![Hit::MISS; primary.len()];
        accel.closest_batch(&primary, &mut hits);
        let seen: Vec<Seen> = primary
            .iter()
            .zip(&hits)
            .filter(|(_, hit)| hit.is_hit())
            .map(|(ray, hit)| {
                let front = geometry.area_vector(hit.triangle as usize).normalize();
                let normal = if front.dot(ray.direction) < 0.0 { front } else { -front };
                Seen { position: offset_origin(ray.origin + hit.t * ray.direction, normal), normal }
            })
            .collect();
        assert!(!seen.is_empty(), "the first camera sees nothing");
        let low = seen.iter().fold(Vec3::INFINITY, |low, seen| low.min(seen.position));
        let high = seen.iter().fold(Vec3::NEG_INFINITY, |high, seen| high.max(seen.position));
        let numbered = || (0_u32..).zip(&seen);
        let other = |index: u32| seen[hash(index, 1) as usize % seen.len()].position;
        Self {
            hemisphere: numbered()
                .map(|(index, seen)| {
                    Ray::new(seen.position, cosine_hemisphere(seen.normal, sobol_2d(index, 0, 0)))
                })
                .collect(),
            between: numbered().map(|(index, seen)| Ray::between(seen.position, other(index))).collect(),
            to_light: seen.iter().map(|seen| Ray::between(seen.position, 0.5 * (low + high))).collect(),
            primary,
        }
    }
}
