//! The sky over the arcade: late morning, as an environment map.

use std::f64::consts::{PI, TAU};

use anyhow::Result;
use glam::{DVec3, Vec3};
use image::Rgb;
use image::codecs::hdr::HdrEncoder;

const WIDTH: usize = 128;
const HEIGHT: usize = 64;
/// Towards the sun; that of `arcade.toml` shines from there too.
const SUN: DVec3 = DVec3::new(-0.42, 1.30, 0.58);
/// On a surface that faces it, W/m^2.
const SUNLIGHT: DVec3 = DVec3::new(6.6, 5.4, 3.9);

/// The direction of a pixel's middle: the layout of OpenEXR's latitude-longitude maps.
fn direction(pixel: usize) -> DVec3 {
    let longitude = (0.5 - ((pixel % WIDTH) as f64 + 0.5) / WIDTH as f64) * TAU;
    let polar = ((pixel / WIDTH) as f64 + 0.5) / HEIGHT as f64 * PI;
    let out = libm::sin(polar);
    DVec3::new(libm::sin(longitude) * out, libm::cos(polar), libm::cos(longitude) * out)
}

/// Radiance from a direction, W/(sr m^2), without the sun's disc.
fn radiance(direction: DVec3) -> DVec3 {
    let (zenith, horizon) = (DVec3::new(0.16, 0.30, 0.62), DVec3::new(0.62, 0.68, 0.74));
    let ground = DVec3::new(0.20, 0.17, 0.13);
    let height = direction.y;
    if height < 0.0 {
        // haze up to the horizon
        return ground.lerp(0.7 * horizon, (1.0 + 8.0 * height).max(0.0));
    }
    let toward_sun = direction.dot(SUN.normalize()).max(0.0);
    let glow = 0.5 * libm::pow(toward_sun, 8.0) + 1.5 * libm::pow(toward_sun, 64.0);
    horizon.lerp(zenith, libm::pow(height, 0.45)) + DVec3::new(0.9, 0.75, 0.5) * glow
}

/// The map, as a Radiance file.
pub(super) fn sky() -> Result<Vec<u8>> {
    let mut texels: Vec<DVec3> = (0..WIDTH * HEIGHT).map(|pixel| radiance(direction(pixel))).collect();
    // the sun is the pixel nearest to it
    let towards_sun = |&a: &usize, &b: &usize| direction(a).dot(SUN).total_cmp(&direction(b).dot(SUN));
    let sun = (0..texels.len()).max_by(towards_sun).unwrap_or(0);
    let edge = |row: usize| libm::cos(row as f64 / HEIGHT as f64 * PI);
    let solid_angle = TAU / WIDTH as f64 * (edge(sun / WIDTH) - edge(sun / WIDTH + 1));
    texels[sun] += SUNLIGHT / solid_angle;
    let pixel = |texel: DVec3| {
        let Vec3 { x, y, z } = texel.as_vec3();
        Rgb([x, y, z])
    };
    let pixels: Vec<Rgb<f32>> = texels.into_iter().map(pixel).collect();
    let mut file = Vec::new();
    HdrEncoder::new(&mut file).encode(&pixels, WIDTH, HEIGHT)?;
    Ok(file)
}
