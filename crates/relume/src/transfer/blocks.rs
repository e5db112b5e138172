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
    /// For each block, how much of the picture one of its rows is, in receivers.
    pub(super) served: Vec<Served>,
}

/// How much of the picture a row is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Served {
    /// What its light counts for: the sum of the weights with which receivers take it.
    pub(super) light: f32,
    /// What its errors count for, if they are independent of other rows': the sum of the squares of these weights.
    pub(super) errors: f32,
}

impl Served {
    /// A row of one receiver's own.
    pub(super) const ONE: Self = Self { light: 1.0, errors: 1.0 };
}

fn lobe(receiver: &Receiver) -> Option<SpecularLobe> {
    let Gloss { view, roughness, f0, f90 } = receiver.gloss;
    SpecularLobe::new(receiver.shading_normal, view, roughness, f0, f90)
}

/// Runs of `length` receivers that lie close together and face alike; the last may be shorter. `served` is how much of the picture each is.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub(super) fn of_receivers(
    receivers: &[Receiver],
    served: &[Served],
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
    let places: Vec<(Vec3, Vec3)> =
        points.iter().map(|point| (point.position, point.shading_normal)).collect();
    let order = cluster_order(&places, [length, TILE], progress)?;
    let lengths = (0..points.len()).step_by(length).map(|first| length.min(points.len() - first)).collect();
    let mean = |run: &[u32]| {
        let sum =
            |of: &dyn Fn(&Served) -> f32| run.iter().map(|&index| of(&served[index as usize])).sum::<f32>();
        let share = 1.0 / run.len() as f32;
        Served { light: share * sum(&|served| served.light), errors: share * sum(&|served| served.errors) }
    };
    Ok(Blocks {
        points: order.iter().map(|&index| points[index as usize]).collect(),
        lengths,
        served: order.chunks(length).map(mean).collect(),
        owners: order,
    })
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
        served: vec![Served::ONE; surfaces.len().div_ceil(length)],
        owners: (0..surfaces.len() as u32).collect(),
    }
}
