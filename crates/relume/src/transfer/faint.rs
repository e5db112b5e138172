//! Clusters of cells that matter too little for a ray to each.

/// Most cells that one of them may answer for: a power of four, a cluster of the tree.
pub(super) const FAINT_CLUSTER: usize = 64;
/// A form factor that does not count; quotients of smaller ones might not be finite.
const NOTHING: f32 = 1e-30;

/// Chooses which of the `count` cells from `first` on, a cluster of the tree, are asked for, and what the form factor of each then
/// counts for: every cell by itself, or one for all of a cluster whose form factors (`shares`) add up to less than `faint`.
pub(super) fn choose_speakers(
    shares: &[f32],
    (first, count): (usize, usize),
    faint: f32,
    draw: &impl Fn(usize) -> f32,
    chosen: &mut Vec<(u32, f32)>,
) {
    let cluster = &shares[first..first + count];
    let total: f32 = cluster.iter().sum();
    if total < NOTHING {
        return;
    }
    if count > 1 && total >= faint {
        for child in 0..4 {
            choose_speakers(shares, (first + child * count / 4, count / 4), faint, draw, chosen);
        }
        return;
    }
    let picked = pick(cluster, draw(first + count) * total);
    chosen.push(((first + picked) as u32, total / cluster[picked].max(NOTHING)));
}

/// The entry in which the running sum of `weights` passes `at`; never one of weight zero unless all are.
fn pick(weights: &[f32], at: f32) -> usize {
    let (mut sum, mut last) = (0.0, 0);
    for (index, &weight) in weights.iter().enumerate() {
        if weight > 0.0 {
            last = index;
            sum += weight;
            if sum > at {
                break;
            }
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::sampling::{hash, unit};

    /// What the cells of a cluster count for in the mean over many draws, of those of which `sees` says so.
    fn mean_visibility(shares: &[f32], faint: f32, sees: impl Fn(usize) -> bool) -> (Vec<f32>, usize) {
        const DRAWS: u32 = 20_000;
        let (mut sums, mut asked) = (vec![0.0; shares.len()], 0);
        for seed in 0..DRAWS {
            let mut chosen = Vec::new();
            let draw = |cluster: usize| unit(hash(cluster as u32, hash(seed, 5)));
            choose_speakers(shares, (0, shares.len()), faint, &draw, &mut chosen);
            asked += chosen.len();
            for (cell, weight) in chosen.into_iter().filter(|&(cell, _)| sees(cell as usize)) {
                sums[cell as usize] += weight / DRAWS as f32;
            }
        }
        (sums, asked / DRAWS as usize)
    }

    #[test]
    fn one_cell_answers_for_a_faint_cluster_and_every_cell_keeps_its_own_visibility() {
        let shares: Vec<f32> = (0..64).map(|cell| 1.0 + unit(hash(cell, 1))).collect();
        let total: f32 = shares.iter().sum();
        let hidden = |cell: usize| cell % 4 < 2;
        for (faint, rays) in [(2.0 * total, 1), (0.5 * total, 4), (0.1 * total, 16), (0.0, 64)] {
            let (seen, asked) = mean_visibility(&shares, faint, |cell| !hidden(cell));
            assert_eq!(asked, rays);
            for (cell, &visibility) in seen.iter().enumerate() {
                if hidden(cell) {
                    assert!(
                        visibility == 0.0,
                        "{cell} is hidden, and would not be if the answer were shared"
                    );
                } else {
                    assert!((visibility - 1.0).abs() < 0.25, "{faint}: {visibility} of cell {cell}");
                }
            }
            let sum: f32 = seen.iter().zip(&shares).map(|(seen, share)| seen * share).sum();
            let truth: f32 =
                shares.iter().enumerate().filter(|(cell, _)| !hidden(*cell)).map(|(_, s)| s).sum();
            assert!((sum / truth - 1.0).abs() < 0.02, "{faint}: {sum} of {truth}");
        }
    }

    #[test]
    fn cells_that_are_next_to_nothing_weigh_no_more_than_a_number_can() {
        let mut chosen = Vec::new();
        choose_speakers(&[1e-44, 0.0, 1e-3, 0.0], (0, 4), 1.0, &|_| 0.5, &mut chosen);
        assert!(chosen.len() == 1 && chosen[0].1.is_finite());
        chosen.clear();
        choose_speakers(&[1e-40, 1e-44, 0.0, 0.0], (0, 4), 1.0, &|_| 0.5, &mut chosen);
        assert!(chosen.is_empty(), "{chosen:?}");
    }

    #[test]
    fn what_weighs_nothing_is_never_picked() {
        let weights = [0.0, 1.0, 0.0, 3.0, 0.0];
        assert_eq!([0.0, 0.99, 1.0, 3.99, 4.0].map(|at| pick(&weights, at)), [1, 1, 3, 3, 3]);
        assert_eq!(pick(&[0.0; 4], 0.0), 0);
    }
}
