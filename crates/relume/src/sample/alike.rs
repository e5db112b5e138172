//! When view samples are alike enough to share what they receive.

use glam::Vec3;

use super::{Branch, ViewSample};

/// Least cosine between the geometric normals of a sample and of its receiver.
const SAME_FACE: f32 = 0.8;
/// Least cosine between their shading normals: the mean of normals that differ more says little about any of them.
const SAME_NORMAL: f32 = 0.9;
/// Farthest that one may lie off the other's plane, in pixels at that distance.
const SAME_PLANE: f32 = 1.0;
/// Farthest that one may lie from the other, in pixels at that distance. Samples that are seen straight are neighbours, farther apart only where
/// they are seen at grazing angles; a curved mirror shows a whole room in a few pixels.
const SAME_PLACE: f32 = 8.0;
/// Farthest that their roughnesses may lie apart, where both are sharp, and how much more at roughness 1 (it grows with the square, as the
/// lobe does): reflections are seen along one lobe. The same for the directions they are seen along.
const SAME_LOBE: (f32, f32) = (0.1, 1.0);

/// A view sample and where it is seen from.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) sample: &'a ViewSample,
    pub(super) eye: Vec3,
    /// What a pixel sees there, metres across.
    pub(super) pixel: f32,
    /// Whether it is seen by way of smooth surfaces.
    branch: bool,
}

/// How alike samples must be.
#[derive(Clone, Copy)]
pub(super) struct Alike {
    /// The angle of a pixel.
    pub(super) pixel: f32,
    /// Whether their lobes must be alike too.
    pub(super) glossy: bool,
}

impl Seen<'_> {
    fn view(&self) -> Vec3 {
        (self.eye - self.sample.position) / self.sample.depth
    }

    /// Which of `centers` is most like this sample in position and normal (Hasan 2006, section 3.6).
    pub(super) fn nearest<'c>(
        &self,
        centers: impl Iterator<Item = (u32, Seen<'c>)>,
    ) -> Option<(u32, Seen<'c>)> {
        let (geometric, shading) = (self.sample.geometric_normal.get(), self.sample.shading_normal.get());
        let mut best = (f32::INFINITY, None);
        for (index, center) in centers {
            // Distances in units of depth, and off the sample's plane much more than along it.
            let apart = (center.sample.position - self.sample.position) / self.sample.depth;
            let off_plane = apart.dot(geometric);
            let turned = center.sample.shading_normal.get().distance_squared(shading);
            let unlike = apart.length_squared() + 100.0 * off_plane * off_plane + 1e-3 * turned;
            if unlike < best.0 {
                best = (unlike, Some((index, center)));
            }
        }
        best.1
    }
}

impl Alike {
    /// Seen from the camera.
    pub(super) fn straight(self, sample: &ViewSample, camera: Vec3) -> Seen<'_> {
        Seen { sample, eye: camera, pixel: self.pixel * sample.depth, branch: false }
    }

    /// Seen by way of smooth surfaces, which may have widened the view. A pixel has so many views along each side: 1 of centres, 2 of quads.
    pub(super) fn branch(self, branch: &Branch, views: f32) -> Seen<'_> {
        let widened = 2.0 * views * (branch.width + branch.spread * branch.last);
        let Branch { sample, eye, .. } = branch;
        Seen { sample, eye: *eye, pixel: widened.max(self.pixel * sample.depth), branch: true }
    }

    /// Whether `seen` lies in the plane of `receiver`, faces as it does and is about as rough.
    pub(super) fn serves(self, receiver: &Seen<'_>, seen: &Seen<'_>) -> bool {
        let faces = |of: &ViewSample| (of.geometric_normal.get(), of.shading_normal.get());
        let (sample, other) = (seen.sample, receiver.sample);
        let ((geometric, shading), (its_geometric, its_shading)) = (faces(sample), faces(other));
        let apart = sample.position - other.position;
        let off_plane = apart.dot(geometric).abs().max(apart.dot(its_geometric).abs());
        let (rough, its_rough) = (sample.roughness(), other.roughness());
        let same_lobe = SAME_LOBE.0 + SAME_LOBE.1 * rough.min(its_rough).powi(2);
        let pixel = seen.pixel;
        its_geometric.dot(geometric) > SAME_FACE
            && its_shading.dot(shading) > SAME_NORMAL
            && off_plane < SAME_PLANE * pixel
            && (!self.glossy || (rough - its_rough).abs() < same_lobe)
            && (!seen.branch
                || apart.length() < SAME_PLACE * pixel
                    && (!self.glossy || seen.view().distance(receiver.view()) < same_lobe))
    }
}
