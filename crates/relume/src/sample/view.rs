//! View samples: the deep frame buffer.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{PackedNormal, PackedUnit};
use crate::progress::Progress;
use crate::scene::{Camera, Geometry, Scene};
use crate::shade::{self, Surface};
use crate::trace::{Accel, Hit, Ray};
use crate::{Error, Result};

/// A point seen by the camera and how it reflects. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ViewSample {
    /// Metres, world space.
    pub position: Vec3,
    /// Distance from the camera, metres; infinite where the camera sees no surface.
    pub depth: f32,
    /// The normal that light is shaded by, towards the camera.
    pub shading_normal: PackedNormal,
    /// The triangle's normal, towards the camera.
    pub geometric_normal: PackedNormal,
    /// `k_d`: diffuse albedo with the share of the specular lobe taken off; dimensionless. Under the base colour that
    /// [`kept_base_color`] says, which is nearly always the material's own.
    pub diffuse: PackedUnit,
    /// Perceptual roughness, `65535` is 1; 0 where no light is reflected.
    roughness: u16,
    /// Specular reflectance at normal incidence.
    pub specular: PackedUnit,
    /// Specular reflectance at grazing angles, `65535` is 1.
    grazing: u16,
    /// Index of the material.
    pub material: u32,
    /// Object number.
    pub object: u32,
}

/// Base colours darker than this are not what view samples keep `k_d` for. Smaller, and a rig that makes a dark material bright would
/// bring out the steps of sixteen bits: of the brightest texel they are now a thousandth, a quarter of those of an 8-bit texture.
const DARKEST_KEPT: f32 = 1.0 / 64.0;

/// The base colour factor, linear RGB, under which a [`ViewSample`] keeps `k_d`: the material's own, so that nothing has to be applied
/// where it is not edited; 1 in channels that are so dark, or black, that nothing would be left of the texture.
pub fn kept_base_color(base_color: Vec3) -> Vec3 {
    Vec3::select(base_color.cmpge(Vec3::splat(DARKEST_KEPT)), base_color, Vec3::ONE)
}

fn unorm(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0).round() as u16
}

impl ViewSample {
    /// The camera sees nothing here.
    pub const SKY: Self = Self {
        position: Vec3::ZERO,
        depth: f32::INFINITY,
        shading_normal: PackedNormal::UP,
        geometric_normal: PackedNormal::UP,
        diffuse: PackedUnit::ZERO,
        roughness: 0,
        specular: PackedUnit::ZERO,
        grazing: 0,
        material: u32::MAX,
        object: u32::MAX,
    };

    /// `base_color` is the material's factor.
    pub(super) fn new(surface: &Surface, camera: Vec3, base_color: Vec3) -> Self {
        let to_camera = (camera - surface.position).normalize_or(surface.geometric_normal);
        let cos_view = to_camera.dot(surface.shading_normal);
        let (own, white) = (surface.diffuse(cos_view), surface.with_base_color(Vec3::ONE).diffuse(cos_view));
        let diffuse = Vec3::select(kept_base_color(base_color).cmpeq(base_color), own, white);
        Self {
            position: surface.position,
            depth: camera.distance(surface.position),
            shading_normal: PackedNormal::new(surface.shading_normal),
            geometric_normal: PackedNormal::new(surface.geometric_normal),
            diffuse: PackedUnit::new(diffuse),
            roughness: if surface.lit { unorm(surface.roughness).max(1) } else { 0 },
            specular: PackedUnit::new(surface.specular_f0),
            grazing: unorm(surface.specular_f90),
            material: surface.material,
            object: surface.object,
        }
    }

    /// Whether the camera sees no surface here.
    pub fn is_sky(&self) -> bool {
        self.depth == f32::INFINITY
    }

    /// Whether light can be reflected here: there is a surface, and not the back of a one-sided one.
    pub fn is_lit(&self) -> bool {
        self.roughness != 0
    }

    /// The surface as shading wants it. Its albedo is [`Self::diffuse`] already: its specular share is taken off. Of its white albedo
    /// nothing is known.
    pub fn surface(&self) -> Surface {
        Surface {
            position: self.position,
            geometric_normal: self.geometric_normal.get(),
            shading_normal: self.shading_normal.get(),
            diffuse_albedo: self.diffuse.get(),
            white_albedo: Vec3::ZERO,
            specular_f0: self.specular.get(),
            specular_f90: f32::from(self.grazing) * (1.0 / 65535.0),
            dielectric_specular: 0.0,
            roughness: self.roughness(),
            emission: Vec3::ZERO,
            material: self.material,
            object: self.object,
            lit: self.is_lit(),
        }
    }

    /// Perceptual roughness, `0..=1`.
    pub fn roughness(&self) -> f32 {
        f32::from(self.roughness) * (1.0 / 65535.0)
    }
}

/// What the camera sees: one sample through each pixel's centre, and a 2x2 grid in each pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewSamples {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Where the camera stands, world space.
    pub camera: Vec3,
    /// `width * height` samples through the pixels' centres, row by row.
    pub centers: Vec<ViewSample>,
    /// `4 * width * height` samples: four a pixel, the upper row first.
    pub quads: Vec<ViewSample>,
    /// Emitted radiance of those `centers` that emit, by index.
    pub center_emission: Vec<(u32, Vec3)>,
    /// Emitted radiance of those `quads` that emit, by index.
    pub quad_emission: Vec<(u32, Vec3)>,
}

/// Where the rays through the view samples first hit.
#[derive(Clone, Debug, Default)]
pub struct ViewHits {
    /// Of [`ViewSamples::centers`].
    pub centers: Vec<Hit>,
    /// Of [`ViewSamples::quads`].
    pub quads: Vec<Hit>,
}

/// Offsets of the four samples of a pixel from its top left corner.
pub(crate) const QUAD: [Vec2; 4] =
    [Vec2::new(0.25, 0.25), Vec2::new(0.75, 0.25), Vec2::new(0.25, 0.75), Vec2::new(0.75, 0.75)];

/// One row of pixels: samples and what they emit.
struct Row {
    samples: Vec<ViewSample>,
    emission: Vec<(u32, Vec3)>,
    hits: Vec<Hit>,
}

impl ViewSamples {
    /// Sends a ray through each pixel's centre and four more around it. Also returns their hits.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn new(
        scene: &Scene,
        geometry: &Geometry,
        accel: &Accel,
        camera: &Camera,
        (width, height): (usize, usize),
        progress: &dyn Progress,
    ) -> Result<(Self, ViewHits)> {
        progress.stage("view samples", height as u64);
        let look = |row: usize, offsets: &[Vec2]| -> Row {
            let rays: Vec<Ray> = (0..width)
                .flat_map(|column| offsets.iter().map(move |&offset| (column, offset)))
                .map(|(column, offset)| {
                    let (x, y) = (column as f32 + offset.x, row as f32 + offset.y);
                    Ray::new(camera.position(), camera.direction(x, y, width, height))
                })
                .collect();
            let mut hits = vec![Hit::MISS; rays.len()];
            accel.closest_batch(&rays, &mut hits);
            let first = (row * width * offsets.len()) as u32;
            let mut emission = Vec::new();
            let samples = rays.iter().zip(&hits).enumerate().map(|(index, (ray, hit))| {
                if !hit.is_hit() {
                    return ViewSample::SKY;
                }
                let surface = shade::surface_at(scene, geometry, hit, ray.direction);
                if surface.emission != Vec3::ZERO && surface.lit {
                    emission.push((first + index as u32, surface.emission));
                }
                let base_color = scene.materials[surface.material as usize].base_color.truncate();
                ViewSample::new(&surface, camera.position(), base_color)
            });
            Row { samples: samples.collect(), emission, hits }
        };
        let rows: Vec<(Row, Row)> = (0..height)
            .into_par_iter()
            .map(|row| {
                if progress.cancelled() {
                    return Err(Error::Cancelled);
                }
                let both = (look(row, &[Vec2::splat(0.5)]), look(row, &QUAD));
                progress.advance(1);
                Ok(both)
            })
            .collect::<Result<_>>()?;
        let mut view = Self { width, height, camera: camera.position(), ..Self::default() };
        let mut hits = ViewHits::default();
        for (center, quad) in rows {
            view.centers.extend(center.samples);
            view.center_emission.extend(center.emission);
            hits.centers.extend(center.hits);
            hits.quads.extend(quad.hits);
            view.quads.extend(quad.samples);
            view.quad_emission.extend(quad.emission);
        }
        Ok((view, hits))
    }

    /// Pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The pixel of the 3x3 around `(row, column)` whose lit centre is most like `sample` in position and normal (Hasan 2006,
    /// section 3.6); `None` where no centre is lit.
    pub(super) fn nearest_center(&self, sample: &ViewSample, row: usize, column: usize) -> Option<u32> {
        let (geometric, shading) = (sample.geometric_normal.get(), sample.shading_normal.get());
        let mut best = (f32::INFINITY, None);
        for y in row.saturating_sub(1)..(row + 2).min(self.height) {
            for x in column.saturating_sub(1)..(column + 2).min(self.width) {
                let pixel = y * self.width + x;
                let center = &self.centers[pixel];
                if !center.is_lit() {
                    continue;
                }
                // Distances in units of depth, and off the sample's plane much more than along it.
                let apart = (center.position - sample.position) / sample.depth;
                let off_plane = apart.dot(geometric);
                let turned = center.shading_normal.get().distance_squared(shading);
                let unlike = apart.length_squared() + 100.0 * off_plane * off_plane + 1e-3 * turned;
                if unlike < best.0 {
                    best = (unlike, Some(pixel as u32));
                }
            }
        }
        best.1
    }
}

/// Pixels on a geometric edge: those where the object, the normal (by more than 25 degrees) or the plane (by more
/// than 2% of the depth) breaks between the samples of the pixel and those of its four neighbours.
pub fn edge_pixels(view: &ViewSamples) -> Vec<bool> {
    let breaks = |a: &ViewSample, b: &ViewSample| {
        if a.is_sky() || b.is_sky() {
            return a.is_sky() != b.is_sky();
        }
        let normal = a.geometric_normal.get();
        a.object != b.object
            || normal.dot(b.geometric_normal.get()) < 0.9
            || (b.position - a.position).dot(normal).abs() > 0.02 * a.depth
    };
    (0..view.pixels())
        .into_par_iter()
        .map(|pixel| {
            let center = &view.centers[pixel];
            let (x, y) = (pixel % view.width, pixel / view.width);
            let mut around = view.quads[4 * pixel..4 * pixel + 4].iter().any(|s| breaks(center, s));
            let mut beside = |inside: bool, other: usize| {
                around |= inside && breaks(center, &view.centers[other]);
            };
            beside(x > 0, pixel.wrapping_sub(1));
            beside(x + 1 < view.width, pixel + 1);
            beside(y > 0, pixel.wrapping_sub(view.width));
            beside(y + 1 < view.height, pixel + view.width);
            around
        })
        .collect()
}
