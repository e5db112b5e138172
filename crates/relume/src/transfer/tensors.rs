//! Arrays on their way into a cache.

use bytemuck::Pod;
use safetensors::tensor::Dtype;

use super::{Matrix, Operator};
use crate::sample::Chains;

/// The arrays on their way into a file.
#[derive(Default)]
pub(super) struct Tensors<'a>(pub(super) Vec<(String, Dtype, Vec<usize>, &'a [u8])>);

impl<'a> Tensors<'a> {
    /// Adds an array of `T`; `inner` is the shape of one element in units of `dtype`.
    pub(super) fn add<T: Pod>(&mut self, name: &str, dtype: Dtype, inner: &[usize], values: &'a [T]) {
        let shape = std::iter::once(values.len()).chain(inner.iter().copied()).collect();
        self.0.push((name.to_owned(), dtype, shape, bytemuck::cast_slice(values)));
    }

    /// What is seen in mirrors and through glass; its emission stands beside it, as bytes.
    pub(super) fn add_chains(&mut self, name: &str, (chains, emission): (&'a Chains, &'a [[u32; 4]])) {
        self.add(&format!("{name}_branches"), Dtype::U8, &[84], &chains.branches);
        self.add(&format!("{name}_branch_emission"), Dtype::U32, &[4], emission);
        self.add(&format!("{name}_sky"), Dtype::U8, &[48], &chains.sky);
    }

    pub(super) fn add_interpolation(&mut self, name: &str, operator: &'a Operator) {
        let Some(interpolation) = &operator.interpolation else { return };
        let part = |part: &str| format!("{name}.interpolation_{part}");
        self.add(&part("runs"), Dtype::U32, &[2], &interpolation.runs);
        self.add(&part("table"), Dtype::U32, &[], &interpolation.table);
        self.add(&part("counts"), Dtype::U8, &[], &interpolation.counts);
        self.add(&part("shares"), Dtype::U8, &[2], &interpolation.shares);
    }

    pub(super) fn add_operator(&mut self, name: &str, operator: &'a Operator) {
        let part = |part: &str| format!("{name}.{part}");
        self.add(&part("sample_weights"), Dtype::F32, &[], &operator.sample_weights);
        self.add(&part("weights"), Dtype::F32, &[], &operator.weights);
        match &operator.matrix {
            Matrix::LowRank(matrix) => {
                self.add(&part("shapes"), Dtype::U32, &[3], &matrix.shapes);
                self.add(&part("indices"), Dtype::U16, &[], &matrix.indices);
                self.add(&part("high"), Dtype::U8, &[], &matrix.high);
                self.add(&part("v_widths"), Dtype::U8, &[], &matrix.v.widths);
                self.add(&part("v"), Dtype::U8, &[], &matrix.v.bytes);
                self.add(&part("v_scales"), Dtype::F32, &[], &matrix.v_scales);
                self.add(&part("u_widths"), Dtype::U8, &[], &matrix.u.widths);
                self.add(&part("u"), Dtype::U8, &[], &matrix.u.bytes);
                self.add(&part("u_scales"), Dtype::F32, &[], &matrix.u_scales);
            }
            Matrix::HaarRows(matrix) => {
                self.add(&part("indices"), Dtype::U16, &[], &matrix.indices);
                self.add(&part("high"), Dtype::U8, &[], &matrix.high);
                self.add(&part("values"), Dtype::I8, &[], &matrix.values);
                self.add(&part("scales"), Dtype::F32, &[], &matrix.scales);
            }
            Matrix::HaarBlocks(matrix) => {
                self.add(&part("places"), Dtype::U32, &[], &matrix.layout.places);
                self.add(&part("tiles"), Dtype::U32, &[], &matrix.tiles);
                self.add(&part("blocks"), Dtype::U8, &[24], &matrix.blocks);
                self.add(&part("texels"), Dtype::U8, &[], &matrix.texels);
            }
        }
    }
}
