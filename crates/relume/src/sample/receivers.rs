//! Receivers: the points at which indirect light is gathered for the view samples.
//!
//! Indirect light changes slowly over a surface, so that the four samples of a pixel may share what its centre receives
//! (Hasan 2006, section 3.6). Where even the most similar centre of the 3x3 pixels around is not similar (an edge, a leaf, a fold),
//! a pixel has further receivers. Normals change within a pixel too: a normal map has texels of its own. Irradiance is nearly linear in the
//! normal, so that a receiver with the mean normal of its samples receives nearly the mean of what these do.

use glam::Vec3;
use rayon::prelude::*;

use super::alike::{Alike, Seen};
use super::{ViewSample, ViewSamples, cluster_order, ordering_steps, places_in};
use crate::scene::Camera;
use crate::{Progress, Result};

/// Runs of receivers that lie together, longer and shorter ones.
const ORDERED: [usize; 2] = [4096, 16];

/// A point that receives light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Metres, world space.
    pub position: Vec3,
    /// For the cosine: the mean over the samples that take their light here, weighted by what they reflect.
    pub shading_normal: Vec3,
    /// For the horizon.
    pub geometric_normal: Vec3,
    /// What a pixel sees there, metres across.
    pub pixel: f32,
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
    /// First one for every pixel whose centre gathers light, row by row, then the further ones; then the same for what is seen in
    /// mirrors and through glass. Or in an order of their own, where there are records.
    pub points: Vec<Receiver>,
    /// The receiver of each of [`ViewSamples::centers`]; [`Receivers::NONE`] where nothing is gathered.
    pub of_centers: Vec<u32>,
    /// The same for [`ViewSamples::quads`].
    pub of_quads: Vec<u32>,
    /// The same for the branches of [`ViewSamples::center_chains`].
    pub of_center_branches: Vec<u32>,
    /// The same for those of [`ViewSamples::quad_chains`].
    pub of_quad_branches: Vec<u32>,
    /// The quad that each of the further receivers lies on.
    pub further: Vec<u32>,
    /// The branch of a quad that each of those lies on that are seen in mirrors and through glass.
    pub further_branches: Vec<u32>,
}

/// Where one sample takes its light from.
#[derive(Clone, Copy)]
enum Source {
    Nothing,
    /// A centre, or a branch of one.
    Center(u32),
    /// A further receiver, by its number in the row of pixels.
    Further(u32),
}

/// Where the samples of a row of pixels take their light from, and those of them that are further receivers.
#[derive(Default)]
struct Sources {
    sources: Vec<Source>,
    further: Vec<u32>,
}

/// What takes its light from where, of centres and of quads, and the quads of the further receivers.
type Placed = (Vec<u32>, Vec<u32>, Vec<u32>);

impl Receiver {
    fn of(seen: Seen<'_>) -> Self {
        let surface = seen.sample.surface();
        let view = (seen.eye - surface.position).normalize_or(surface.geometric_normal);
        Self {
            position: surface.position,
            shading_normal: surface.shading_normal,
            geometric_normal: surface.geometric_normal,
            pixel: seen.pixel,
            gloss: Gloss {
                view,
                roughness: surface.roughness,
                f0: surface.specular_f0.element_sum() / 3.0,
                f90: surface.specular_f90,
            },
        }
    }
}

impl Receivers {
    /// In place of a receiver where nothing is gathered.
    pub const NONE: u32 = u32::MAX;

    /// Places receivers for what `camera` sees; `glossy` says whether light is gathered along specular lobes as well.
    pub fn new(view: &ViewSamples, camera: &Camera, glossy: bool) -> Self {
        let alike = Alike { pixel: camera.pixel_angle(view.width, view.height), glossy };
        let mut receivers = Self::default();
        let rows = (0..view.height).into_par_iter().map(|row| sources(view, row, alike)).collect();
        let centers = view.centers.iter().map(|center| alike.straight(center, view.camera.position()));
        let quads = |quad: u32| alike.straight(&view.quads[quad as usize], view.camera.position());
        (receivers.of_centers, receivers.of_quads, receivers.further) =
            receivers.place(centers, quads, rows, glossy);
        let rows = (0..view.height).into_par_iter().map(|row| branch_sources(view, row, alike)).collect();
        let centers = view.center_chains.branches.iter().map(|branch| alike.branch(branch, 1.0));
        let quads = |branch: u32| alike.branch(&view.quad_chains.branches[branch as usize], 2.0);
        (receivers.of_center_branches, receivers.of_quad_branches, receivers.further_branches) =
            receivers.place(centers, quads, rows, glossy);
        let straight = view.quads.iter().map(|sample| (sample, 1.0)).zip(&receivers.of_quads);
        let branches = view.quad_chains.branches.iter();
        let branches = branches.map(|branch| (&branch.sample, branch.throughput.get().element_sum() / 3.0));
        let branches = branches.zip(&receivers.of_quad_branches);
        average(&mut receivers.points, straight.chain(branches), glossy);
        receivers
    }

    /// Numbers the receivers anew: those that lie together and face alike come after each other.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    pub(crate) fn put_in_order(&mut self, progress: &dyn Progress) -> Result<()> {
        progress.stage("receivers", ordering_steps(self.points.len()));
        let places: Vec<(Vec3, Vec3)> =
            self.points.iter().map(|point| (point.position, point.shading_normal)).collect();
        let order = cluster_order(&places, ORDERED, progress)?;
        self.points = order.iter().map(|&number| self.points[number as usize]).collect();
        let places = places_in(&order);
        let all = [
            &mut self.of_centers,
            &mut self.of_quads,
            &mut self.of_center_branches,
            &mut self.of_quad_branches,
        ];
        for receiver in all.into_iter().flatten().filter(|receiver| **receiver != Self::NONE) {
            *receiver = places[*receiver as usize];
        }
        Ok(())
    }

    /// Places a receiver at each of the centres that gather, and the further ones of all rows of pixels.
    fn place<'a>(
        &mut self,
        centers: impl Iterator<Item = Seen<'a>>,
        quads: impl Fn(u32) -> Seen<'a>,
        rows: Vec<Sources>,
        glossy: bool,
    ) -> Placed {
        let mut place = |seen| {
            self.points.push(Receiver::of(seen));
            self.points.len() as u32 - 1
        };
        let gathers = |seen: &Seen<'_>| seen.sample.gathers(glossy);
        let of_centers: Vec<u32> =
            centers.map(|seen| if gathers(&seen) { place(seen) } else { Self::NONE }).collect();
        let (mut of_quads, mut all_further) = (Vec::new(), Vec::new());
        for Sources { sources, further } in rows {
            let numbers: Vec<u32> = further.iter().map(|&quad| place(quads(quad))).collect();
            all_further.extend(further);
            of_quads.extend(sources.iter().map(|source| match *source {
                Source::Nothing => Self::NONE,
                Source::Center(center) => of_centers[center as usize],
                Source::Further(number) => numbers[number as usize],
            }));
        }
        (of_centers, of_quads, all_further)
    }
}

impl Sources {
    /// Adds the source of the quad `index`: the most alike of `centers`, where it serves; else a further receiver of the pixel. Those are the
    /// ones from `first` on.
    fn add<'a>(
        &mut self,
        index: u32,
        centers: impl Iterator<Item = (u32, Seen<'a>)>,
        quads: impl Fn(u32) -> Seen<'a>,
        first: usize,
        alike: Alike,
    ) {
        let seen = quads(index);
        if !seen.sample.gathers(alike.glossy) {
            self.sources.push(Source::Nothing);
            return;
        }
        let nearest = seen.nearest(centers.filter(|(_, center)| center.sample.gathers(alike.glossy)));
        if let Some((center, _)) = nearest.filter(|(_, center)| alike.serves(center, &seen)) {
            self.sources.push(Source::Center(center));
            return;
        }
        let own = self.further[first..].iter().position(|&quad| alike.serves(&quads(quad), &seen));
        let number = own.map_or(self.further.len(), |own| first + own);
        if own.is_none() {
            self.further.push(index);
        }
        self.sources.push(Source::Further(number as u32));
    }
}

/// Of the quads of a row of pixels.
fn sources(view: &ViewSamples, row: usize, alike: Alike) -> Sources {
    let mut sources = Sources::default();
    let straight = |sample| alike.straight(sample, view.camera.position());
    for column in 0..view.width {
        let first = sources.further.len();
        let pixel = row * view.width + column;
        for quad in 4 * pixel..4 * pixel + 4 {
            let centers =
                view.around(row, column).map(|pixel| (pixel as u32, straight(&view.centers[pixel])));
            sources.add(quad as u32, centers, |quad| straight(&view.quads[quad as usize]), first, alike);
        }
    }
    sources
}

/// Of their branches.
fn branch_sources(view: &ViewSamples, row: usize, alike: Alike) -> Sources {
    let mut sources = Sources::default();
    let (center_chains, quad_chains) = (&view.center_chains, &view.quad_chains);
    let of_center = |branch: usize| (branch as u32, alike.branch(&center_chains.branches[branch], 1.0));
    let of_quad = |branch: u32| alike.branch(&quad_chains.branches[branch as usize], 2.0);
    for column in 0..view.width {
        let first = sources.further.len();
        let pixel = row * view.width + column;
        for branch in (4 * pixel..4 * pixel + 4).flat_map(|quad| quad_chains.range_of(quad)) {
            let around = view.around(row, column).flat_map(|pixel| center_chains.range_of(pixel));
            sources.add(branch as u32, around.map(of_center), of_quad, first, alike);
        }
    }
    sources
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

/// Gives every receiver the mean shading normal and the mean gloss of the samples it serves, weighted by what the camera sees of what these
/// reflect. `samples` have the part of their light that reaches it, and their receivers.
///
/// The samples' facets face as far apart as their lobes are wide and as their normals differ: both variances add up to that of one
/// lobe (Toksvig 2005; Olano and Baker 2010), which shows the mean of what the samples' own lobes would.
fn average<'a>(
    points: &mut [Receiver],
    samples: impl Iterator<Item = ((&'a ViewSample, f32), &'a u32)>,
    glossy: bool,
) {
    let mut sums = vec![Sums::default(); points.len()];
    for ((sample, seen), &receiver) in samples {
        if let Some(sums) = sums.get_mut(receiver as usize) {
            let surface = sample.surface();
            let f0 = surface.specular_f0.element_sum() / 3.0;
            let specular = seen * f0;
            let reflected =
                seen * surface.diffuse_albedo.element_sum() + if glossy { 3.0 * specular } else { 0.0 };
            sums.normals += surface.shading_normal * reflected;
            sums.reflected += reflected;
            sums.facets += surface.shading_normal * specular;
            sums.slopes += surface.roughness.powi(4) * specular;
            sums.f0 += f0 * specular;
            sums.f90 += surface.specular_f90 * specular;
            sums.specular += specular;
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
        let mut points = [Receiver::of(Alike { pixel: 1e-3, glossy: true }.straight(&samples[0], CAMERA))];
        average(&mut points, samples.iter().map(|sample| ((sample, 1.0), &0)), true);
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
