//! Clusters of cells that matter too little for a ray to each.

/// Most cells that one of them may answer for: a power of four, a cluster of the tree.
pub(super) const FAINT_CLUSTER: usize = 64;
/// How many times as much a cluster may matter, and one of its cells still answers for it, where rays that would have found it found
/// nothing of it: at 16 no further rays are saved.
const UNSEEN: f32 = 8.0;
/// A form factor that does not count; quotients of smaller ones might not be finite.
const NOTHING: f32 = 1e-30;

/// Chooses which of the `count` cells from `first` on, a cluster of the tree, are asked for, and what the form factor of each then
/// counts for: every cell by itself, or one for all of a cluster whose form factors (`shares`) add up to less than `faint`, or to less than
/// [`UNSEEN`] times as much where no cell of it has its bit among `hits`.
pub(super) fn choose_speakers(
    shares: &[f32],
    (first, count): (usize, usize),
    hits: u64,
    faint: f32,
    draw: &impl Fn(usize) -> f32,
    chosen: &mut Vec<(u32, f32)>,
) {
    debug_assert!(count.is_power_of_two() && count.trailing_zeros() % 2 == 0, "{count} is no power of four");
    let cluster = &shares[first..first + count];
    let total: f32 = cluster.iter().sum();
    if total < NOTHING {
        return;
    }
    let least = if hits == 0 { UNSEEN * faint } else { faint };
    if count > 1 && total >= least {
        let quarter = count / 4;
        for child in 0..4 {
            let hits = hits >> (child * quarter) & (u64::MAX >> (64 - quarter));
            choose_speakers(shares, (first + child * quarter, quarter), hits, faint, draw, chosen);
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
    fn mean_visibility(
        shares: &[f32],
        hits: u64,
        faint: f32,
        sees: impl Fn(usize) -> bool,
    ) -> (Vec<f32>, usize) {
        const DRAWS: u32 = 20_000;
        let (mut sums, mut asked) = (vec![0.0; shares.len()], 0);
        for seed in 0..DRAWS {
            let mut chosen = Vec::new();
            let draw = |cluster: usize| unit(hash(cluster as u32, hash(seed, 5)));
            choose_speakers(shares, (0, shares.len()), hits, faint, &draw, &mut chosen);
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
            let (seen, asked) = mean_visibility(&shares, u64::MAX, faint, |cell| !hidden(cell));
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
    fn clusters_in_which_nothing_was_hit_are_asked_less_and_right_on_average() {
        let shares = [1.0; 64];
        let faint = 64.0 / UNSEEN;
        // of what was hit, eighths would be asked one by one: there are only quarters and their quarters
        let all = mean_visibility(&shares, u64::MAX, faint, |_| true).1;
        let none = mean_visibility(&shares, 0, faint * 1.01, |_| true).1;
        let first_quarter = mean_visibility(&shares, 0xffff, faint, |_| true).1;
        assert_eq!((all, none, first_quarter), (16, 1, 7));
        // a few cells are seen all the same
        let (seen, _) = mean_visibility(&shares, 0, 1.01 * faint, |cell| cell % 16 == 5);
        for (cell, visibility) in seen.into_iter().enumerate() {
            let truth = if cell % 16 == 5 { 1.0 } else { 0.0 };
            assert!((visibility - truth).abs() < 0.25, "{visibility} of cell {cell}");
        }
    }

    #[test]
    fn cells_that_are_next_to_nothing_weigh_no_more_than_a_number_can() {
        let mut chosen = Vec::new();
        choose_speakers(&[1e-44, 0.0, 1e-3, 0.0], (0, 4), u64::MAX, 1.0, &|_| 0.5, &mut chosen);
        assert!(chosen.len() == 1 && chosen[0].1.is_finite());
        chosen.clear();
        choose_speakers(&[1e-40, 1e-44, 0.0, 0.0], (0, 4), u64::MAX, 1.0, &|_| 0.5, &mut chosen);
        assert!(chosen.is_empty(), "{chosen:?}");
    }

    #[test]
    fn what_weighs_nothing_is_never_picked() {
        let weights = [0.0, 1.0, 0.0, 3.0, 0.0];
        assert_eq!([0.0, 0.99, 1.0, 3.99, 4.0].map(|at| pick(&weights, at)), [1, 1, 3, 3, 3]);
        assert_eq!(pick(&[0.0; 4], 0.0), 0);
    }
}
