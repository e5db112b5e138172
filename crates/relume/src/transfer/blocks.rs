//! Which rows are encoded together.

use glam::Vec3;

use crate::sample::{GatherCloud, GatherSample, Gloss, Receiver, cluster_order, ordering_steps};
use crate::shade::SpecularLobe;
use crate::trace::sampling::hash;
use crate::transfer::tiles::{GatherPoint, TILE};
use crate::{Progress, Result};

/// Rows in block order: points, the length of each block, and what each row stands for.
pub(super) struct Blocks {
    pub(super) points: Vec<GatherPoint>,
    pub(super) lengths: Vec<usize>,
    /// The receiver, or the gather sample.
    pub(super) owners: Vec<u32>,
}

fn lobe(receiver: &Receiver) -> Option<SpecularLobe> {
    let Gloss { view, roughness, f0, f90 } = receiver.gloss;
    SpecularLobe::new(receiver.shading_normal, view, roughness, f0, f90)
}

/// Runs of `length` receivers that lie close together and face alike; the last may be shorter.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub(super) fn of_receivers(
    receivers: &[Receiver],
    length: usize,
    seed: u32,
    progress: &dyn Progress,
) -> Result<Blocks> {
    progress.stage("blocks of receivers", ordering_steps(receivers.len()));
    let point = |(index, receiver): (usize, &Receiver)| GatherPoint {
        position: receiver.position,
        shading_normal: receiver.shading_normal,
        geometric_normal: receiver.geometric_normal,
        seed: hash(index as u32, seed),
        lobe: lobe(receiver),
    };
    let points: Vec<GatherPoint> = receivers.iter().enumerate().map(point).collect();
    let low = points.iter().fold(Vec3::INFINITY, |low, point| low.min(point.position));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, point| high.max(point.position));
    let places: Vec<(Vec3, Vec3)> =
        points.iter().map(|point| (point.position, point.shading_normal)).collect();
    let order = cluster_order(&places, low.distance(high), [length, TILE], progress)?;
    let lengths = (0..points.len()).step_by(length).map(|first| length.min(points.len() - first)).collect();
    Ok(Blocks { points: order.iter().map(|&index| points[index as usize]).collect(), lengths, owners: order })
}

/// Runs of `length` gather samples of surfaces, a power of four, or of all if there are fewer: clusters of the tree. The last may be shorter.
pub(super) fn of_cloud(cloud: &GatherCloud, length: usize, seed: u32) -> Blocks {
    let surfaces = cloud.surfaces();
    let point = |(index, sample): (usize, &GatherSample)| GatherPoint {
        position: sample.position,
        shading_normal: sample.normal,
        geometric_normal: sample.normal,
        seed: hash(index as u32, seed ^ 0x5bd1_e995),
        lobe: None,
    };
    Blocks {
        points: surfaces.iter().enumerate().map(point).collect(),
        lengths: surfaces.chunks(length).map(<[_]>::len).collect(),
        owners: (0..surfaces.len() as u32).collect(),
    }
}
