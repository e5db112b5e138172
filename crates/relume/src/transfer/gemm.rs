//! Matrix products, by a library's kernels that choose their instruction set at run time.

use std::ops::Range;

/// A matrix in a slice: element (i, j) stands at `i * row_stride + j * column_stride`.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> View<'a> {
    /// `rows x columns`, row after row.
    pub(super) fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(values.len(), rows * columns, "a {rows} x {columns} matrix");
        Self { values, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// The part where the rows `rows` and the columns `columns` meet.
    pub(super) fn part(self, rows: Range<usize>, columns: Range<usize>) -> Self {
        assert!(rows.end <= self.rows && columns.end <= self.columns, "a part of the matrix");
        if rows.is_empty() || columns.is_empty() {
            return Self { values: &[], rows: rows.len(), columns: columns.len(), ..self };
        }
        let first = rows.start * self.row_stride + columns.start * self.column_stride;
        Self { values: &self.values[first..], rows: rows.len(), columns: columns.len(), ..self }
    }

    /// Every `step`th of its rows, from the first on.
    pub(super) fn every(self, step: usize) -> Self {
        Self { rows: self.rows.div_ceil(step), row_stride: step * self.row_stride, ..self }
    }

    pub(super) fn rows(self) -> usize {
        self.rows
    }

    pub(super) fn columns(self) -> usize {
        self.columns
    }

    pub(super) fn at(self, row: usize, column: usize) -> f32 {
        self.values[row * self.row_stride + column * self.column_stride]
    }

    /// The same values, rows and columns exchanged.
    pub(super) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// `a b`, row after row.
pub(super) fn product(a: View<'_>, b: View<'_>) -> Vec<f32> {
    assert_eq!(a.columns, b.rows, "inner dimensions");
    let mut out = vec![0.0; a.rows * b.columns];
    if out.is_empty() || a.columns == 0 {
        return out;
    }
    // SAFETY: `View::new` has checked that every element (i, j) of both operands lies within its slice, and what is made of a view has
    // elements of that view alone; `out` has a.rows * b.columns elements and is read and written only as such a matrix, row after row.
    #[expect(unsafe_code, reason = "the library takes pointers")]
    unsafe {
        matrixmultiply::sgemm(
            a.rows,
            a.columns,
            b.columns,
            1.0,
            a.values.as_ptr(),
            a.row_stride as isize,
            a.column_stride as isize,
            b.values.as_ptr(),
            b.row_stride as isize,
            b.column_stride as isize,
            0.0,
            out.as_mut_ptr(),
            b.columns as isize,
            1,
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_equal_the_definition_transposed_or_not() {
        let a: Vec<f32> = (0..6).map(|i| i as f32).collect(); // 2 x 3
        let b: Vec<f32> = (0..6).map(|i| (i * i) as f32).collect(); // 3 x 2
        let ab = product(View::new(&a, 2, 3), View::new(&b, 3, 2));
        for i in 0..2 {
            for j in 0..2 {
                let expected: f32 = (0..3).map(|k| a[3 * i + k] * b[2 * k + j]).sum();
                assert_eq!(ab[2 * i + j], expected);
            }
        }
        let ba = product(View::new(&b, 3, 2).transposed(), View::new(&a, 2, 3).transposed());
        assert_eq!(ba[1], ab[2], "(A B)^T = B^T A^T");
    }

    #[test]
    fn parts_of_a_matrix_are_matrices() {
        let a: Vec<f32> = (0..20).map(|i| i as f32).collect(); // 5 x 4
        let one = [1.0];
        let values = |view: View<'_>| -> Vec<f32> {
            (0..view.rows()).flat_map(|i| (0..view.columns()).map(move |j| view.at(i, j))).collect()
        };
        let view = View::new(&a, 5, 4);
        let part = view.part(1..3, 2..4);
        assert_eq!(values(part), [6.0, 7.0, 10.0, 11.0]);
        assert_eq!(values(part.transposed()), [6.0, 10.0, 7.0, 11.0]);
        assert_eq!(values(view.transposed().part(2..4, 1..3)), values(part.transposed()));
        assert_eq!(values(view.part(0..5, 3..4).every(2)), [3.0, 11.0, 19.0]);
        assert_eq!(product(view.part(1..5, 3..4).every(3), View::new(&one, 1, 1)), [7.0, 19.0]);
        assert!(product(view.part(2..2, 0..4), view.transposed()).is_empty());
        assert_eq!(product(view.part(0..2, 4..4), View::new(&[], 0, 3)), [0.0; 6]);
    }

    #[test]
    #[should_panic(expected = "a part of the matrix")]
    fn what_is_not_within_a_matrix_is_no_part_of_it() {
        View::new(&[0.0; 6], 2, 3).part(0..3, 0..3);
    }
}
