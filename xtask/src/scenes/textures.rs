//! Procedural textures: paving, masonry, marble, cloth, a leaf.

use std::f32::consts::{PI, TAU};

use anyhow::{Context, Result};
use glam::{Vec2, Vec3, Vec4};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use libm::{cosf, powf, sinf};

use super::noise::{fractal, hash, smoothstep};

/// A colour in sRGB and the height of the surface there, in the texture's own unit.
#[derive(Clone, Copy)]
struct Texel {
    color: Vec3,
    height: f32,
}

/// The base colour and the normal map of one material, as PNG files.
pub(crate) struct Stone {
    /// sRGB.
    pub(crate) base_color: Vec<u8>,
    /// Tangent space, +Y up.
    pub(crate) normal: Vec<u8>,
}

fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn png(width: usize, height: usize, bytes: &[u8], color: ExtendedColorType) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive)
        .write_image(bytes, width as u32, height as u32, color)
        .context("cannot encode a texture")?;
    Ok(file)
}

fn texel_uv(index: usize, size: usize) -> Vec2 {
    Vec2::new((index % size) as f32 + 0.5, (index / size) as f32 + 0.5) / size as f32
}

/// Draws `size * size` texels of `surface` over the unit square. `depth` is the height unit in texels.
fn stone(size: usize, depth: f32, surface: impl Fn(Vec2) -> Texel) -> Result<Stone> {
    let texels: Vec<Texel> = (0..size * size).map(|index| surface(texel_uv(index, size))).collect();
    let colors: Vec<u8> = texels.iter().flat_map(|texel| texel.color.to_array().map(byte)).collect();
    let height = |x: usize, y: usize| depth * texels[(y % size) * size + x % size].height;
    let normals: Vec<u8> = (0..size * size)
        .flat_map(|index| {
            let (x, y) = (index % size + size, index / size + size);
            let slope_right = 0.5 * (height(x + 1, y) - height(x - 1, y));
            let slope_down = 0.5 * (height(x, y + 1) - height(x, y - 1));
            let normal = Vec3::new(-slope_right, slope_down, 1.0).normalize();
            (0.5 * normal + Vec3::splat(0.5)).to_array().map(byte)
        })
        .collect();
    Ok(Stone {
        base_color: png(size, size, &colors, ExtendedColorType::Rgb8)?,
        normal: png(size, size, &normals, ExtendedColorType::Rgb8)?,
    })
}

/// Pale slabs with dark diamonds at their corners: four slabs a side.
pub(crate) fn paving() -> Result<Stone> {
    const SLABS: f32 = 4.0;
    const DIAMOND: f32 = 0.24;
    stone(512, 2.5, |uv| {
        let p = uv * SLABS;
        let (cell, nearest) = (p.floor(), p.round());
        let to_edge = (p - nearest).abs();
        let beyond = (to_edge.x + to_edge.y - DIAMOND) * std::f32::consts::FRAC_1_SQRT_2;
        let dark = beyond < 0.0;
        let to_joint = if dark { -beyond } else { beyond.min(to_edge.x).min(to_edge.y) };
        let stone = smoothstep(0.006, 0.02, to_joint);
        let index = if dark { nearest } else { cell };
        let wrap = |x: f32| (x as i32).rem_euclid(SLABS as i32);
        let shade = hash(wrap(index.x), wrap(index.y), if dark { 11 } else { 12 }) - 0.5;
        let grain = fractal(uv, 16, 4, 20);
        let veins = fractal(uv + Vec2::splat(0.03 * grain), 5, 3, 30);
        let color = if dark {
            Vec3::new(0.40, 0.25, 0.21) * (1.0 + 0.18 * shade + 0.10 * grain + 0.12 * veins)
        } else {
            let warm = Vec3::new(0.80, 0.73, 0.62).lerp(Vec3::new(0.74, 0.70, 0.63), shade + 0.5);
            warm * (1.0 + 0.12 * shade + 0.06 * grain + 0.07 * veins)
        };
        Texel {
            color: Vec3::new(0.46, 0.41, 0.35).lerp(color, stone),
            height: stone + 0.10 * grain + 0.25 * shade * stone,
        }
    })
}

/// Dressed blocks in five courses.
pub(crate) fn ashlar() -> Result<Stone> {
    const COURSES: f32 = 5.0;
    stone(512, 2.0, |uv| {
        let y = uv.y * COURSES;
        let course = y.floor();
        let blocks = 2.0 + (course % 2.0);
        let x = uv.x * blocks + hash(course as i32, 0, 41);
        let block = x.floor();
        let metres = Vec2::new((x - x.round()).abs() * 2.0 / blocks, (y - y.round()).abs() * 2.0 / COURSES);
        let stone = smoothstep(0.003, 0.011, metres.min_element());
        let id = (block as i32).rem_euclid(blocks as i32);
        let shade = hash(id, course as i32, 42) - 0.5;
        let tint = hash(id, course as i32, 43);
        let grain = fractal(uv, 32, 3, 50);
        let stain = fractal(uv, 3, 4, 60);
        let color = Vec3::new(0.84, 0.76, 0.64).lerp(Vec3::new(0.80, 0.75, 0.68), tint)
            * (1.0 + 0.10 * shade + 0.05 * grain + 0.06 * stain);
        Texel {
            color: Vec3::new(0.62, 0.55, 0.46).lerp(color, stone),
            height: stone + 0.16 * grain + 0.12 * stain,
        }
    })
}

/// Veined pale stone for columns and mouldings.
pub(crate) fn marble() -> Result<Vec<u8>> {
    let stone = stone(256, 1.0, |uv| {
        let warp = fractal(uv, 4, 4, 70);
        let vein = 1.0 - fractal(uv + Vec2::new(0.08 * warp, 0.05 * warp), 3, 4, 80).abs();
        let vein = powf(vein.clamp(0.0, 1.0), 14.0);
        let color = Vec3::new(0.86, 0.80, 0.71) * (1.0 + 0.05 * warp);
        Texel { color: color.lerp(Vec3::new(0.70, 0.62, 0.52), 0.55 * vein), height: 0.0 }
    })?;
    Ok(stone.base_color)
}

/// Grey woven cloth with a damask figure, to be tinted by the material's factor.
pub(crate) fn fabric() -> Result<Vec<u8>> {
    let stone = stone(256, 1.0, |uv| {
        let thread = sinf(uv.x * 64.0 * TAU) * sinf(uv.y * 64.0 * TAU);
        let ogee = cosf(uv.x * TAU) + cosf(uv.y * TAU);
        let petals = cosf(2.0 * uv.x * TAU) * cosf(2.0 * uv.y * TAU) + 0.6 * ogee.abs();
        let figure = smoothstep(0.45, 0.60, petals) * (1.0 - 0.7 * smoothstep(1.35, 1.5, petals));
        let line = smoothstep(0.16, 0.08, ogee.abs());
        let light = 0.74 + 0.22 * figure.max(0.8 * line) + 0.03 * thread;
        Texel { color: Vec3::splat(light), height: 0.0 }
    })?;
    Ok(stone.base_color)
}

/// One leaf, its tip at the top, cut out by alpha. The green goes on outside it, so that no edge shows.
pub(crate) fn leaf() -> Result<Vec<u8>> {
    const SIZE: usize = 128;
    let bytes: Vec<u8> = (0..SIZE * SIZE)
        .flat_map(|index| {
            let uv = texel_uv(index, SIZE);
            let along = 1.0 - uv.y;
            let across = (2.0 * uv.x - 1.0).abs();
            let notch = 0.05 * sinf(along * 22.0 * PI).abs();
            let half_width = powf(sinf(PI * powf(along.clamp(0.0, 1.0), 0.75)).max(0.0), 0.8) - notch;
            let rib = smoothstep(0.07, 0.02, across);
            let vein = smoothstep(0.8, 1.0, cosf((along - 0.35 * across) * 11.0 * TAU));
            let green = Vec3::new(0.24, 0.42, 0.14).lerp(Vec3::new(0.33, 0.53, 0.20), along);
            let color = green.lerp(Vec3::new(0.52, 0.66, 0.33), rib.max(0.35 * vein));
            // A soft edge two texels wide, which the cutoff of one half turns into a clean outline.
            let alpha = ((half_width - across) * SIZE as f32 / 4.0 + 0.5).clamp(0.0, 1.0);
            let edge = Vec4::new(color.x, color.y, color.z, if half_width > 0.0 { alpha } else { 0.0 });
            edge.to_array().map(byte)
        })
        .collect();
    png(SIZE, SIZE, &bytes, ExtendedColorType::Rgba8)
}
