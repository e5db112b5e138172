//! What a light sees: for placing it by what it reaches.

use glam::Vec3;
use rayon::prelude::*;

use crate::image::Image;
use crate::scene::Camera;
use crate::trace::{Hit, Ray, offset_origin};
use crate::transfer::Transfer;

/// How bright a surface is that is seen at a glancing angle, and how much brighter one that is faced.
const SHADE: (f32, f32) = (0.1, 0.4);
/// What the shot's camera sees as well is tinted so.
const SHARED: Vec3 = Vec3::new(1.5, 1.15, 0.6);

/// The scene as `eye` sees it, grey, brighter where it is faced; warm where the shot's own camera sees it too: what is lit there shows in the picture. Black
/// where nothing is. One ray a pixel, and one more where something is hit; values from 0 to 1, to be shown as they are.
pub fn look_through(transfer: &Transfer, eye: &Camera, width: usize, height: usize) -> Image {
    let (accel, shot) = (transfer.occluders.accel(), &transfer.view);
    let (positions, triangles) = (&transfer.occluders.positions, &transfer.occluders.triangles);
    let mut pixels = vec![Vec3::ZERO; width * height];
    pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, pixels)| {
        let direction = |column: usize| eye.direction(column as f32 + 0.5, row as f32 + 0.5, width, height);
        let rays: Vec<Ray> = (0..width).map(|column| Ray::new(eye.position(), direction(column))).collect();
        let mut hits = vec![Hit::MISS; width];
        accel.closest_batch(&rays, &mut hits);
        for ((pixel, ray), hit) in pixels.iter_mut().zip(&rays).zip(&hits).filter(|(_, hit)| hit.is_hit()) {
            let [a, b, c] = triangles[hit.triangle as usize].map(|vertex| positions[vertex as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let faced = normal.dot(ray.direction).abs();
            let at = ray.origin + ray.direction * hit.t;
            let to_camera = shot.camera.position() - at;
            let side = if normal.dot(to_camera) < 0.0 { -normal } else { normal };
            let seen = shot.camera.project(at, shot.width, shot.height).is_some_and(|(place, _)| {
                place.x >= 0.0
                    && place.y >= 0.0
                    && place.x < shot.width as f32
                    && place.y < shot.height as f32
                    && !accel.occluded(&Ray::between(offset_origin(at, side), shot.camera.position()))
            });
            let grey = SHADE.0 + SHADE.1 * faced;
            *pixel = grey * if seen { SHARED } else { Vec3::ONE };
        }
    });
    Image { width, height, pixels }
}
