//! The cluster tree: a perfectly balanced quad-tree by equal-split k-means (Hasan 2006, section 4.2).
//!
//! The tree is nothing but an order of the samples: every run of `4^j` samples that starts at a multiple of `4^j` is
//! a cluster, and the order is at once the Morton order of the flattened `2^k x 2^k` gather image.

use glam::Vec3;

use crate::{Error, Progress, Result};

/// Where a sample lies for the tree: position and normal scaled as in eq. 9, so that the squared distance of two
/// keys is `K^2 |dp|^2 + d^2 |dn|^2`.
pub(super) type Key = [f32; AXES];

const AXES: usize = 6;

/// Weight of positions in eq. 9; the paper found 20 to 40 good.
const POSITION_WEIGHT: f32 = 30.0;
/// Rounds of k-means a split may take; it mostly settles in fewer.
const ROUNDS: usize = 12;
/// Samples that one thread parts alone.
const ALONE: usize = 2048;

/// The key of a sample in a scene whose bounding box has a diagonal of `diagonal` metres.
pub(super) fn key(position: Vec3, normal: Vec3, diagonal: f32) -> Key {
    let (p, n) = (position * POSITION_WEIGHT, normal * diagonal);
    [p.x, p.y, p.z, n.x, n.y, n.z]
}

/// Metres that weigh as much as a difference of one between unit normals.
pub(super) fn normal_scale(diagonal: f32) -> f32 {
    diagonal / POSITION_WEIGHT
}

/// The samples' numbers in tree order, with runs as in [`cluster_order`] where their number is no power of four; else their lengths are 1.
///
/// # Errors
/// [`Error::Cancelled`].
pub(super) fn order(keys: &[Key], lengths: [usize; 2], progress: &dyn Progress) -> Result<Vec<u32>> {
    order_of_runs(keys, lengths, progress)
}

/// The numbers of points in an order in which every run of `lengths[0]` that starts at a multiple of it lies together, and so
/// does, within these, every run of `lengths[1]`. Advances `progress` by [`ordering_steps`].
///
/// # Errors
/// [`Error::Cancelled`].
pub(crate) fn cluster_order(
    points: &[(Vec3, Vec3)],
    lengths: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<u32>> {
    let low = points.iter().fold(Vec3::INFINITY, |low, point| low.min(point.0));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, point| high.max(point.0));
    let diagonal = low.distance(high);
    let keys: Vec<Key> = points.iter().map(|&(position, normal)| key(position, normal, diagonal)).collect();
    order_of_runs(&keys, lengths, progress)
}

/// Where each number stands in an order of all of them.
pub(crate) fn places_in(order: &[u32]) -> Vec<u32> {
    let mut places = vec![0; order.len()];
    for (place, &number) in (0..).zip(order) {
        places[number as usize] = place;
    }
    places
}

/// Steps of ordering so many points: each of them goes through as many halvings as it takes to be alone.
pub(crate) fn ordering_steps(count: usize) -> u64 {
    count as u64 * halvings(count)
}

fn halvings(count: usize) -> u64 {
    u64::from(usize::BITS - count.leading_zeros())
}

fn order_of_runs(keys: &[Key], lengths: [usize; 2], progress: &dyn Progress) -> Result<Vec<u32>> {
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    split_watched(keys, &mut order, lengths, halvings(keys.len()), progress)?;
    Ok(order)
}

/// Where to part so many: in the middle, but at the end of a run.
fn middle(count: usize, lengths: [usize; 2]) -> usize {
    match lengths.into_iter().find(|&length| length < count) {
        Some(length) if length > 1 => count.div_ceil(length) / 2 * length,
        _ => count / 2,
    }
}

/// Splits in parallel. Every point is told of `left` times, all at once where a thread goes on alone.
fn split_watched(
    keys: &[Key],
    part: &mut [u32],
    lengths: [usize; 2],
    left: u64,
    progress: &dyn Progress,
) -> Result<()> {
    if progress.cancelled() {
        return Err(Error::Cancelled);
    }
    let count = part.len() as u64;
    if part.len() <= ALONE {
        split(keys, part, lengths);
        progress.advance(count * left);
        return Ok(());
    }
    let middle = middle(part.len(), lengths);
    halve(keys, part, middle);
    progress.advance(count);
    let (near, far) = part.split_at_mut(middle);
    let left = left.saturating_sub(1);
    let (near, far) = rayon::join(
        || split_watched(keys, near, lengths, left, progress),
        || split_watched(keys, far, lengths, left, progress),
    );
    near.and(far)
}

fn split(keys: &[Key], part: &mut [u32], lengths: [usize; 2]) {
    if part.len() <= 1 {
        return;
    }
    let middle = middle(part.len(), lengths);
    halve(keys, part, middle);
    let (near, far) = part.split_at_mut(middle);
    split(keys, near, lengths);
    split(keys, far, lengths);
}

fn mean(keys: &[Key], part: &[u32]) -> [f64; AXES] {
    let mut sum = [0.0; AXES];
    for &sample in part {
        for (sum, value) in sum.iter_mut().zip(keys[sample as usize]) {
            *sum += f64::from(value);
        }
    }
    sum.map(|sum| sum / part.len() as f64)
}

/// Parts the samples into the first `middle` and the others, each as alike as possible.
fn halve(keys: &[Key], part: &mut [u32], middle: usize) {
    let mut axis = widest_axis(keys, part);
    let mut scored: Vec<(f32, u32)> = Vec::with_capacity(part.len());
    for _ in 0..ROUNDS {
        // d(s, c1) - d(s, c2) is linear in s: sorting by it is sorting along the line between the centroids.
        scored.clear();
        scored.extend(part.iter().map(|&sample| {
            let key = &keys[sample as usize];
            let along: f64 = key.iter().zip(&axis).map(|(&k, a)| f64::from(k) * a).sum();
            (along as f32, sample)
        }));
        scored.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (place, &(_, sample)) in part.iter_mut().zip(&scored) {
            *place = sample;
        }
        let (near, far) = (mean(keys, &part[..middle]), mean(keys, &part[middle..]));
        let next: [f64; AXES] = std::array::from_fn(|i| far[i] - near[i]);
        if cosine(&next, &axis) > 0.999_999 {
            break;
        }
        axis = next;
    }
    // the order within a half must not depend on how the selection left it
    part[..middle].sort_unstable();
    part[middle..].sort_unstable();
}

fn cosine(a: &[f64; AXES], b: &[f64; AXES]) -> f64 {
    let dot = |a: &[f64; AXES], b: &[f64; AXES]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-300)
}

fn widest_axis(keys: &[Key], part: &[u32]) -> [f64; AXES] {
    let center = mean(keys, part);
    let mut variance = [0.0; AXES];
    for &sample in part {
        for axis in 0..AXES {
            variance[axis] += (f64::from(keys[sample as usize][axis]) - center[axis]).powi(2);
        }
    }
    let widest = (0..AXES).fold(0, |best, axis| if variance[axis] > variance[best] { axis } else { best });
    std::array::from_fn(|axis| if axis == widest { 1.0 } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;
    use crate::trace::sampling::{hash, unit};

    fn random_keys(count: u32) -> Vec<Key> {
        (0..count).map(|i| std::array::from_fn(|axis| unit(hash(AXES as u32 * i + axis as u32, 5)))).collect()
    }

    /// Mean squared distance of the samples of each cluster of `size` to the cluster's mean.
    fn spread(keys: &[Key], order: &[u32], size: usize) -> f64 {
        let square = |part: &[u32]| {
            let center = mean(keys, part);
            part.iter()
                .map(|&s| {
                    (0..AXES).map(|a| (f64::from(keys[s as usize][a]) - center[a]).powi(2)).sum::<f64>()
                })
                .sum::<f64>()
        };
        order.chunks(size).map(square).sum::<f64>() / order.len() as f64
    }

    #[test]
    fn the_order_is_a_permutation_that_keeps_like_samples_together() {
        let keys = random_keys(4096);
        let order = order(&keys, [1, 1], &()).unwrap();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &s)| s == i as u32));
        let unordered: Vec<u32> = (0..4096).collect();
        let (tree, chance) = (spread(&keys, &order, 64), spread(&keys, &unordered, 64));
        assert!(tree < 0.35 * chance, "clusters of 64 spread {tree}, chance gives {chance}");
    }

    #[test]
    fn runs_of_the_cluster_order_lie_together_and_end_where_asked() {
        let points: Vec<(Vec3, Vec3)> = (0..1000)
            .map(|i| {
                let at = |axis| unit(hash(axis, hash(i, 9)));
                (Vec3::new(at(0), at(1), at(2)), Vec3::Y)
            })
            .collect();
        let order = cluster_order(&points, [256, 16], &()).unwrap();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &s)| s == i as u32));
        let spread = |size: usize| {
            let of_run = |run: &[u32]| {
                let center = run.iter().map(|&s| points[s as usize].0).sum::<Vec3>() / run.len() as f32;
                run.iter().map(|&s| points[s as usize].0.distance_squared(center)).sum::<f32>()
            };
            order.chunks(size).map(of_run).sum::<f32>() / order.len() as f32
        };
        // the cube is parted into 4 and into 63 parts of equal volume: 1/4 is the mean square of the whole
        assert!(spread(256) < 0.15, "{}", spread(256));
        assert!(spread(16) < 0.03, "{}", spread(16));
        let middles: Vec<usize> =
            [1000, 512, 257, 256, 40, 17, 16, 3].map(|count| middle(count, [256, 16])).to_vec();
        assert_eq!(middles, [512, 256, 256, 128, 16, 16, 8, 1]);
    }

    /// Counts steps, and asks to stop once `most` are done.
    struct Counted {
        most: u64,
        done: AtomicU64,
    }

    impl Progress for Counted {
        fn advance(&self, steps: u64) {
            self.done.fetch_add(steps, Ordering::Relaxed);
        }

        fn cancelled(&self) -> bool {
            self.done.load(Ordering::Relaxed) >= self.most
        }
    }

    #[test]
    fn every_step_of_ordering_is_told_and_it_can_be_stopped() {
        let keys = random_keys(10_000);
        let order = |lengths, most| {
            let listener = Counted { most, done: AtomicU64::new(0) };
            (order_of_runs(&keys, lengths, &listener), listener.done.into_inner())
        };
        for lengths in [[1, 1], [256, 64], [1024, 64], [6000, 1000]] {
            let (whole, steps) = order(lengths, u64::MAX);
            assert_eq!(steps, ordering_steps(10_000), "{lengths:?}");
            assert_eq!(whole.unwrap(), order_of_runs(&keys, lengths, &()).unwrap());
            for most in [0, 10_000] {
                assert!(matches!(order(lengths, most).0, Err(Error::Cancelled)), "{lengths:?}, {most}");
            }
        }
    }

    #[test]
    fn two_distant_clumps_are_parted() {
        let mut keys = random_keys(64);
        for key in &mut keys[..32] {
            key[4] += 100.0;
        }
        let order = order(&keys, [1, 1], &()).unwrap();
        assert!(order[..32].iter().all(|&s| s < 32) || order[..32].iter().all(|&s| s >= 32));
    }
}
