//! Receivers: the points at which indirect light is gathered for the view samples.
//!
//! Indirect light changes slowly over a surface, so that the four samples of a pixel may share what its centre receives
//! (Hasan 2006, section 3.6). Where even the most similar centre of the 3x3 pixels around is not similar (an edge, a leaf, a fold),
//! a pixel has further receivers. Normals change within a pixel too: a normal map has texels of its own. Irradiance is nearly linear in the
//! normal, so that a receiver with the mean normal of its samples receives nearly the mean of what these do.

use glam::Vec3;
use rayon::prelude::*;

use super::{ViewSample, ViewSamples};
use crate::scene::Camera;

/// A point that receives light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Metres, world space.
    pub position: Vec3,
    /// For the cosine: the mean over the samples that take their light here, weighted by what they reflect.
    pub shading_normal: Vec3,
    /// For the horizon.
    pub geometric_normal: Vec3,
    /// What of the light along it is reflected towards the camera: the mean over the samples, weighted by what they reflect so.
    pub gloss: Gloss,
}

/// How a receiver reflects towards the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gloss {
    /// Unit, to the camera.
    pub view: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Specular reflectance along the normal, the mean of the channels.
    pub f0: f32,
    /// At grazing angles.
    pub f90: f32,
}

/// The receivers of a picture, and which of them each view sample takes its light from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Receivers {
    /// First one for every pixel whose centre is lit, row by row, then the further ones.
    pub points: Vec<Receiver>,
    /// The receiver of each of [`ViewSamples::centers`]; [`Receivers::NONE`] where nothing reflects.
    pub of_centers: Vec<u32>,
    /// The same for [`ViewSamples::quads`].
    pub of_quads: Vec<u32>,
    /// The quad that each of the further receivers lies on.
    pub further: Vec<u32>,
}

/// Least cosine between the geometric normals of a sample and of its receiver.
const SAME_FACE: f32 = 0.8;
/// Least cosine between their shading normals: the mean of normals that differ more says little about any of them.
const SAME_NORMAL: f32 = 0.9;
/// Farthest that one may lie off the other's plane, in pixels at that distance.
const SAME_PLANE: f32 = 1.0;

/// Farthest that their roughnesses may lie apart, where both are sharp, and how much more at roughness 1 (it grows with the square, as the
/// lobe does): reflections are seen along one lobe.
const SAME_LOBE: (f32, f32) = (0.1, 1.0);

/// Where one sample takes its light from.
#[derive(Clone, Copy)]
enum Source {
    Nothing,
    /// The centre of a pixel.
    Center(u32),
    /// A further receiver, by its number in the row of pixels.
    Further(u32),
}

impl Receiver {
    fn of(sample: &ViewSample, camera: Vec3) -> Self {
        let surface = sample.surface();
        Self {
            position: sample.position,
            shading_normal: surface.shading_normal,
            geometric_normal: surface.geometric_normal,
            gloss: Gloss {
                view: (camera - sample.position).normalize_or(surface.geometric_normal),
                roughness: surface.roughness,
                f0: surface.specular_f0.element_sum() / 3.0,
                f90: surface.specular_f90,
            },
        }
    }
}

impl Receivers {
    /// In place of a receiver where nothing reflects.
    pub const NONE: u32 = u32::MAX;

    /// Places receivers for what `camera` sees; `glossy` says whether light is gathered along specular lobes as well.
    pub fn new(view: &ViewSamples, camera: &Camera, glossy: bool) -> Self {
        let middle = |x: f32| camera.direction(x, 0.5 * view.height as f32, view.width, view.height);
        let half = 0.5 * view.width as f32;
        let alike = Alike { pixel: middle(half).distance(middle(half + 1.0)), glossy };
        let rows: Vec<(Vec<Source>, Vec<u32>)> =
            (0..view.height).into_par_iter().map(|row| sources(view, row, alike)).collect();
        let mut points = Vec::with_capacity(view.pixels());
        let of_centers: Vec<u32> = view
            .centers
            .iter()
            .map(|center| {
                if !center.is_lit() {
                    return Self::NONE;
                }
                points.push(Receiver::of(center, view.camera));
                points.len() as u32 - 1
            })
            .collect();
        let mut of_quads = Vec::with_capacity(view.quads.len());
        let mut further = Vec::new();
        for (sources, quads) in rows {
            let first = points.len() as u32;
            points.extend(quads.iter().map(|&quad| Receiver::of(&view.quads[quad as usize], view.camera)));
            further.extend(quads);
            of_quads.extend(sources.iter().map(|source| match *source {
                Source::Nothing => Self::NONE,
                Source::Center(pixel) => of_centers[pixel as usize],
                Source::Further(number) => first + number,
            }));
        }
        average(&mut points, view, &of_quads, glossy);
        Self { points, of_centers, of_quads, further }
    }
}

/// Where the samples of a row of pixels take their light from, and the quads that are further receivers.
fn sources(view: &ViewSamples, row: usize, alike: Alike) -> (Vec<Source>, Vec<u32>) {
    let mut further: Vec<u32> = Vec::new();
    let mut sources = Vec::with_capacity(4 * view.width);
    for column in 0..view.width {
        let first = further.len();
        for quad in 0..4 {
            let index = 4 * (row * view.width + column) + quad;
            let sample = &view.quads[index];
            if !alike.reflects(sample) {
                sources.push(Source::Nothing);
                continue;
            }
            let nearest = view.nearest_center(sample, row, column);
            if let Some(nearest) =
                nearest.filter(|&nearest| alike.serves(&view.centers[nearest as usize], sample))
            {
                sources.push(Source::Center(nearest));
                continue;
            }
            let own =
                further[first..].iter().position(|&quad| alike.serves(&view.quads[quad as usize], sample));
            let number = own.map_or(further.len(), |own| first + own);
            if own.is_none() {
                further.push(index as u32);
            }
            sources.push(Source::Further(number as u32));
        }
    }
    (sources, further)
}

/// When samples are alike enough to share a receiver.
#[derive(Clone, Copy)]
struct Alike {
    /// The angle of a pixel.
    pixel: f32,
    /// Whether their lobes must be alike too.
    glossy: bool,
}

impl Alike {
    /// Whether `sample` lies in the plane of `receiver`, faces as it does and is about as rough.
    fn serves(self, receiver: &ViewSample, sample: &ViewSample) -> bool {
        let faces = |of: &ViewSample| (of.geometric_normal.get(), of.shading_normal.get());
        let ((geometric, shading), (its_geometric, its_shading)) = (faces(sample), faces(receiver));
        let apart = sample.position - receiver.position;
        let off_plane = apart.dot(geometric).abs().max(apart.dot(its_geometric).abs());
        let (rough, its_rough) = (sample.roughness(), receiver.roughness());
        let wide = rough.min(its_rough).powi(2);
        its_geometric.dot(geometric) > SAME_FACE
            && its_shading.dot(shading) > SAME_NORMAL
            && off_plane < SAME_PLANE * self.pixel * sample.depth
            && (!self.glossy || (rough - its_rough).abs() < SAME_LOBE.0 + SAME_LOBE.1 * wide)
    }

    /// Whether any light from the surroundings is reflected.
    fn reflects(self, sample: &ViewSample) -> bool {
        let surface = sample.surface();
        let glossy = self.glossy && surface.specular_f90 > 0.0;
        sample.is_lit() && (surface.diffuse_albedo != Vec3::ZERO || glossy)
    }
}

/// Sums over the samples that a receiver serves.
#[derive(Clone, Copy, Default)]
struct Sums {
    normals: Vec3,
    reflected: f32,
    facets: Vec3,
    /// Of squared slopes, twice their variance along an axis.
    slopes: f32,
    f0: f32,
    f90: f32,
    specular: f32,
}

/// Gives every receiver the mean shading normal and the mean gloss of the samples it serves, weighted by what these reflect.
///
/// The samples' facets face as far apart as their lobes are wide and as their normals differ: both variances add up to that of one
/// lobe (Toksvig 2005; Olano and Baker 2010), which shows the mean of what the samples' own lobes would.
fn average(points: &mut [Receiver], view: &ViewSamples, of_quads: &[u32], glossy: bool) {
    let mut sums = vec![Sums::default(); points.len()];
    for (sample, &receiver) in view.quads.iter().zip(of_quads) {
        if let Some(sums) = sums.get_mut(receiver as usize) {
            let surface = sample.surface();
            let f0 = surface.specular_f0.element_sum() / 3.0;
            let reflected = surface.diffuse_albedo.element_sum() + if glossy { 3.0 * f0 } else { 0.0 };
            sums.normals += surface.shading_normal * reflected;
            sums.reflected += reflected;
            sums.facets += surface.shading_normal * f0;
            sums.slopes += surface.roughness.powi(4) * f0;
            sums.f0 += f0 * f0;
            sums.f90 += surface.specular_f90 * f0;
            sums.specular += f0;
        }
    }
    for (point, sums) in points.iter_mut().zip(sums) {
        if sums.reflected > 0.0 {
            point.shading_normal = sums.normals.normalize_or(point.shading_normal);
        }
        if sums.specular > 0.0 {
            let share = 1.0 / sums.specular;
            let apart = (1.0 - share * sums.facets.dot(point.shading_normal)).clamp(0.0, 1.0);
            let slopes = share * sums.slopes + 2.0 * apart;
            point.gloss.roughness = slopes.sqrt().sqrt().min(1.0);
            (point.gloss.f0, point.gloss.f90) = (sums.f0 * share, sums.f90 * share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::Surface;

    const CAMERA: Vec3 = Vec3::new(0.0, 3.0, 0.0);

    /// A metal sample whose normal is turned by `angle` radians about the z axis.
    fn sample(angle: f32, roughness: f32, f0: f32) -> ViewSample {
        let surface = Surface {
            geometric_normal: Vec3::Y,
            shading_normal: Vec3::new(angle.sin(), angle.cos(), 0.0),
            specular_f0: Vec3::splat(f0),
            specular_f90: 1.0,
            roughness,
            ..ViewSample::SKY.surface()
        };
        ViewSample::new(&Surface { lit: true, ..surface }, CAMERA, Vec3::ONE)
    }

    /// The roughness of a receiver of these samples.
    fn roughness_of(samples: &[ViewSample]) -> f32 {
        let view = ViewSamples { camera: CAMERA, quads: samples.to_vec(), ..ViewSamples::default() };
        let mut points = [Receiver::of(&samples[0], CAMERA)];
        average(&mut points, &view, &vec![0; samples.len()], true);
        points[0].gloss.roughness
    }

    #[test]
    fn a_lobe_is_as_wide_as_those_of_its_samples_together() {
        let close = |found: f32, expected: f32| (found - expected).abs() < 2e-3;
        assert!(close(roughness_of(&[sample(0.2, 0.3, 0.9); 4]), 0.3), "one normal, one lobe");
        let (angle, roughness) = (0.15_f32, 0.1_f32);
        let turned = [sample(angle, roughness, 0.9), sample(-angle, roughness, 0.9)];
        let expected = (roughness.powi(4) + 2.0 * (1.0 - angle.cos())).powf(0.25);
        let found = roughness_of(&turned);
        assert!(close(found, expected), "{found} instead of {expected}");
        assert!(!close(found, roughness), "turned normals must be noticed");
        // what reflects little counts little
        let faint = [sample(0.0, 0.1, 0.9), sample(0.0, 0.9, 0.01)];
        let weighed = ((0.9 * 0.1_f32.powi(4) + 0.01 * 0.9_f32.powi(4)) / 0.91).powf(0.25);
        assert!(close(roughness_of(&faint), weighed), "{} instead of {weighed}", roughness_of(&faint));
    }
}
