//! Which Haar coefficients a row keeps, and what weighs beside their values.

use super::haar;

/// What the value of a coefficient is weighted by where some are kept and others dropped. It stands for how much light is
/// expected to lie in that coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Selection {
    /// How many gather samples the basis function covers: "area-weighted wavelet culling", Hasan 2006, section 4.3.
    Area,
    /// Nothing.
    Plain,
    /// How much the coefficient varies over random lights in the scene.
    Prior,
}

impl Selection {
    /// The weight of each of `count` coefficients, mean square one, where nothing has to be learned for it.
    pub(super) fn unlearned(self, count: usize) -> Option<Vec<f32>> {
        match self {
            Self::Prior => None,
            Self::Plain => Some(vec![1.0; count]),
            Self::Area => {
                let areas = || (0..count).map(|coefficient| haar::support(coefficient, count) as f64);
                let square: f64 = areas().map(|area| area * area).sum();
                let scale = (count as f64 / square).sqrt();
                Some(areas().map(|area| (area * scale) as f32).collect())
            }
        }
    }
}

/// Some rows cut to the same number of coefficients each.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct KeptRows {
    /// Coefficients a row.
    pub(super) per_row: usize,
    /// Which ones: for each row as many, ascending.
    pub(super) indices: Vec<u32>,
    /// Their values.
    pub(super) values: Vec<f32>,
    /// For each row, the squared norm of all its coefficients.
    pub(super) energies: Vec<f64>,
    /// How much the rows count in the expected error.
    pub(super) weight: f64,
}

impl KeptRows {
    /// Of each row of plain Haar coefficients (`F W^T`, one for each of `weights`) the `per_row` of largest value times weight;
    /// all, where there are fewer. Ties go to the coarser one.
    pub(super) fn of(x: &[f32], weights: &[f32], per_row: usize) -> Self {
        let count = weights.len();
        let per_row = per_row.min(count);
        let mut kept = Self { per_row, weight: 1.0, ..Self::default() };
        for row in x.chunks_exact(count) {
            let mut order: Vec<u32> = (0..count as u32).collect();
            let score = |i: u32| row[i as usize].abs() * weights[i as usize];
            order.select_nth_unstable_by(per_row.min(count - 1), |&a, &b| {
                score(b).total_cmp(&score(a)).then(a.cmp(&b))
            });
            order.truncate(per_row);
            order.sort_unstable();
            kept.values.extend(order.iter().map(|&index| row[index as usize]));
            kept.indices.extend(order);
            kept.energies.push(row.iter().map(|&value| f64::from(value).powi(2)).sum());
        }
        kept
    }

    /// `rows` rows of zeros over `count` coefficients.
    pub(super) fn nothing(rows: usize, count: usize, per_row: usize) -> Self {
        let per_row = per_row.min(count);
        Self {
            per_row,
            weight: 1.0,
            indices: (0..rows).flat_map(|_| 0..per_row as u32).collect(),
            values: vec![0.0; rows * per_row],
            energies: vec![0.0; rows],
        }
    }

    /// Whether its parts are those of so many rows over `count` coefficients.
    pub(super) fn is_sound(&self, rows: usize, count: usize) -> bool {
        let values = rows.checked_mul(self.per_row);
        let ascending = |row: &[u32]| row.windows(2).all(|pair| pair[0] < pair[1]);
        self.energies.len() == rows
            && self.weight.is_finite()
            && self.values.iter().all(|value| value.is_finite())
            && self.energies.iter().all(|energy| energy.is_finite())
            && self.indices.chunks(self.per_row.max(1)).all(ascending)
            && values == Some(self.indices.len())
            && values == Some(self.values.len())
            && self.indices.iter().all(|&index| (index as usize) < count)
    }

    /// What they take in memory, bytes.
    pub(super) fn memory(&self) -> usize {
        size_of_val(&*self.indices) + size_of_val(&*self.values) + size_of_val(&*self.energies)
    }

    /// Row by row: which coefficients, their values, and the squared norm of the whole row.
    pub(super) fn rows(&self) -> impl Iterator<Item = (&[u32], &[f32], f64)> {
        let kept =
            self.indices.chunks_exact(self.per_row.max(1)).zip(self.values.chunks_exact(self.per_row.max(1)));
        kept.zip(&self.energies).map(|((indices, values), &energy)| (indices, values, energy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_selection_keeps_what_it_weighs_most() {
        let count = 64;
        let mut row = vec![0.0; count];
        // coarse and faint, fine and strong, and one between that only a prior asks for
        (row[1], row[5], row[63]) = (0.3, 0.2, 1.0);
        let mut prior = vec![1e-3; count];
        prior[5] = 1.0;
        let kept = |weights: &[f32]| KeptRows::of(&row, weights, 1).indices;
        let unlearned = |selection: Selection| selection.unlearned(count).unwrap();
        assert_eq!(kept(&unlearned(Selection::Area)), [1]);
        assert_eq!(kept(&unlearned(Selection::Plain)), [63]);
        assert_eq!(kept(&prior), [5]);
        assert!(Selection::Prior.unlearned(count).is_none());
    }

    #[test]
    fn weights_have_a_mean_square_of_one_and_grow_with_the_area() {
        for selection in [Selection::Area, Selection::Plain] {
            let weights = selection.unlearned(256).unwrap();
            let square: f32 = weights.iter().map(|weight| weight * weight).sum();
            assert!((square / 256.0 - 1.0).abs() < 1e-5, "{selection:?}: {square}");
        }
        let areas = Selection::Area.unlearned(256).unwrap();
        assert!((areas[0] / areas[255] - 256.0 / 4.0).abs() < 1e-3, "{} {}", areas[0], areas[255]);
    }

    #[test]
    fn rows_may_be_shorter_than_what_they_may_keep() {
        let weights = vec![1.0; 16];
        let x: Vec<f32> = (0..32).map(|i| i as f32).collect();
        let kept = KeptRows::of(&x, &weights, 100);
        assert_eq!((kept.per_row, kept.values), (16, x));
    }
}
