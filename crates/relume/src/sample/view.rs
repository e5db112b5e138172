//! View samples: the deep frame buffer.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::chains::{Branch, Chains, Followed, Surroundings};
use super::{PackedNormal, PackedUnit};
use crate::progress::Progress;
use crate::scene::{Camera, Geometry, Scene};
use crate::shade::{self, Surface, ViewCone};
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

    /// `base_color` is the material's factor. What a polished surface mirrors is left to its [`Chains`].
    pub(super) fn new(surface: &Surface, camera: Vec3, base_color: Vec3) -> Self {
        let to_camera = (camera - surface.position).normalize_or(surface.geometric_normal);
        let specular = surface.beside_events(to_camera);
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
            specular: PackedUnit::new(specular.specular_f0),
            grazing: unorm(specular.specular_f90),
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

    /// Whether light of lamps is reflected here: not by what is black but for what it mirrors.
    pub fn reflects(&self) -> bool {
        self.is_lit() && (self.diffuse != PackedUnit::ZERO || self.grazing != 0)
    }

    /// Whether light of other surfaces is gathered here: over the hemisphere, or where there are `glossy` rows, along a lobe.
    pub(super) fn gathers(&self, glossy: bool) -> bool {
        self.is_lit() && (self.diffuse != PackedUnit::ZERO || (glossy && self.grazing != 0))
    }

    /// The surface as shading wants it. Its albedo is [`Self::diffuse`] already: its specular share is taken off. Of its white albedo
    /// nothing is known.
    pub fn surface(&self) -> Surface {
        Surface {
            position: self.position,
            geometric_normal: self.geometric_normal.get(),
            shading_normal: self.shading_normal.get(),
            diffuse_albedo: self.diffuse.get(),
            specular_f0: self.specular.get(),
            specular_f90: self.grazing(),
            roughness: self.roughness(),
            material: self.material,
            object: self.object,
            lit: self.is_lit(),
            ..Surface::BLACK
        }
    }

    /// Specular reflectance at grazing angles, `0..=1`.
    pub fn grazing(&self) -> f32 {
        f32::from(self.grazing) * (1.0 / 65535.0)
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
    /// What they are seen by.
    pub camera: Camera,
    /// `width * height` samples through the pixels' centres, row by row.
    pub centers: Vec<ViewSample>,
    /// `4 * width * height` samples: four a pixel, the upper row first.
    pub quads: Vec<ViewSample>,
    /// Emitted radiance of those `centers` that emit, by index.
    pub center_emission: Vec<(u32, Vec3)>,
    /// Emitted radiance of those `quads` that emit, by index.
    pub quad_emission: Vec<(u32, Vec3)>,
    /// What `centers` show in mirrors and through glass.
    pub center_chains: Chains,
    /// What `quads` show so.
    pub quad_chains: Chains,
}

/// All that one of the two sets of view samples shows.
#[derive(Clone, Copy, Debug)]
pub struct ViewGrid<'a> {
    /// Pixel by pixel.
    pub samples: &'a [ViewSample],
    /// Emitted radiance of those that emit, by index.
    pub emission: &'a [(u32, Vec3)],
    /// What they show in mirrors and through glass.
    pub chains: &'a Chains,
    /// How many samples a pixel has.
    pub a_pixel: usize,
}

impl<'a> ViewGrid<'a> {
    /// Emitted radiance that reaches the camera: the sample it is seen at, the material that shines, and how much.
    pub fn emitted(&self) -> impl Iterator<Item = (usize, u32, Vec3)> + use<'a> {
        let Self { samples, emission, chains, .. } = *self;
        let straight = emission
            .iter()
            .map(|&(index, radiance)| (index as usize, samples[index as usize].material, radiance));
        let behind = chains.emission.iter().map(|&(index, radiance)| {
            let branch = &chains.branches[index as usize];
            (branch.owner as usize, branch.sample.material, radiance * branch.throughput.get())
        });
        straight.chain(behind)
    }
}

/// Where the rays through the view samples first hit.
#[derive(Clone, Debug, Default)]
pub struct ViewHits {
    /// Of [`ViewSamples::centers`].
    pub centers: Vec<Hit>,
    /// Of [`ViewSamples::quads`].
    pub quads: Vec<Hit>,
    /// Of the branches of [`ViewSamples::center_chains`], with the directions of their rays.
    pub center_branches: Vec<(Hit, Vec3)>,
    /// Of the branches of [`ViewSamples::quad_chains`].
    pub quad_branches: Vec<(Hit, Vec3)>,
}

/// Offsets of the four samples of a pixel from its top left corner.
pub(crate) const QUAD: [Vec2; 4] =
    [Vec2::new(0.25, 0.25), Vec2::new(0.75, 0.25), Vec2::new(0.25, 0.75), Vec2::new(0.75, 0.75)];

/// One row of pixels: samples, what they emit, and what is seen by way of them.
struct Row {
    samples: Vec<ViewSample>,
    emission: Vec<(u32, Vec3)>,
    hits: Vec<Hit>,
    followed: Followed,
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
        let around = Surroundings { scene, geometry, accel };
        let pixel = camera.pixel_angle(width, height);
        let look = |row: usize, offsets: &[Vec2]| -> Row {
            let spread = 0.5 * pixel / (offsets.len() as f32).sqrt();
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
            let (mut emission, mut followed) = (Vec::new(), Followed::default());
            let samples = rays.iter().zip(&hits).zip(first..).map(|((ray, hit), owner)| {
                if !hit.is_hit() {
                    return ViewSample::SKY;
                }
                let surface = shade::surface_at(scene, geometry, hit, ray.direction);
                if surface.emission != Vec3::ZERO && surface.lit {
                    emission.push((owner, surface.emission));
                }
                let cone = ViewCone::new(spread, ray.direction);
                followed.follow(around, owner, &surface, (ray.direction, hit.t, cone));
                let base_color = scene.materials[surface.material as usize].base_color.truncate();
                ViewSample::new(&surface, camera.position(), base_color)
            });
            Row { samples: samples.collect(), emission, hits, followed }
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
        let mut view = Self { width, height, camera: camera.clone(), ..Self::default() };
        let mut hits = ViewHits::default();
        for (center, quad) in rows {
            view.centers.extend(center.samples);
            view.center_emission.extend(center.emission);
            hits.centers.extend(center.hits);
            hits.quads.extend(quad.hits);
            view.center_chains.append(center.followed.chains);
            hits.center_branches.extend(center.followed.hits);
            view.quad_chains.append(quad.followed.chains);
            hits.quad_branches.extend(quad.followed.hits);
            view.quads.extend(quad.samples);
            view.quad_emission.extend(quad.emission);
        }
        Ok((view, hits))
    }

    /// Pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The samples of `aa` times `aa` a pixel: 1 are the centres, 2 the quads.
    pub fn grid(&self, aa: u32) -> ViewGrid<'_> {
        if aa == 1 {
            let (samples, emission, chains) = (&self.centers, &self.center_emission, &self.center_chains);
            ViewGrid { samples, emission, chains, a_pixel: 1 }
        } else {
            let (samples, emission, chains) = (&self.quads, &self.quad_emission, &self.quad_chains);
            ViewGrid { samples, emission, chains, a_pixel: 4 }
        }
    }

    /// The 3x3 pixels around one, or what of them is in the picture, by number.
    pub(super) fn around(&self, row: usize, column: usize) -> impl Iterator<Item = usize> + use<> {
        let columns = column.saturating_sub(1)..(column + 2).min(self.width);
        let width = self.width;
        (row.saturating_sub(1)..(row + 2).min(self.height))
            .flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }
}

/// Pixels on a geometric edge: those where the object, the normal (by more than 25 degrees) or the plane (by more
/// than 2% of the depth) breaks between the samples of the pixel and those of its four neighbours, or between what they show in mirrors and
/// through glass.
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
    let break_behind = |a: &[Branch], b: &[Branch]| {
        a.len() != b.len() || a.iter().zip(b).any(|(a, b)| breaks(&a.sample, &b.sample))
    };
    (0..view.pixels())
        .into_par_iter()
        .map(|pixel| {
            let center = &view.centers[pixel];
            let (x, y) = (pixel % view.width, pixel / view.width);
            let branches = |pixel| view.center_chains.of_owner(pixel);
            let of_quad = |quad| view.quad_chains.of_owner(quad);
            let own = branches(pixel);
            let mut around = (4 * pixel..4 * pixel + 4)
                .any(|quad| breaks(center, &view.quads[quad]) || break_behind(own, of_quad(quad)));
            let mut beside = |inside: bool, other: usize| {
                around |=
                    inside && (breaks(center, &view.centers[other]) || break_behind(own, branches(other)));
            };
            beside(x > 0, pixel.wrapping_sub(1));
            beside(x + 1 < view.width, pixel + 1);
            beside(y > 0, pixel.wrapping_sub(view.width));
            beside(y + 1 < view.height, pixel + view.width);
            around
        })
        .collect()
}
