//! Products of row-major matrices, split into a fixed number of blocks so that the result does not
//! depend on the number of threads. The products themselves are nalgebra's (whose entry point, unlike
//! the gemm crate's, is safe).

use nalgebra::{Dyn, MatrixView, MatrixViewMut};
use rayon::prelude::*;

/// A borrowed matrix with any strides.
pub type View<'a> = MatrixView<'a, f32, Dyn, Dyn, Dyn, Dyn>;

/// Blocks that a parallel product is split into.
const BLOCKS: usize = 8;

/// A row-major `[rows, cols]` matrix.
pub fn matrix(data: &[f32], rows: usize, cols: usize) -> View<'_> {
    View::from_slice_with_strides_generic(data, Dyn(rows), Dyn(cols), Dyn(cols), Dyn(1))
}

/// The transpose of a row-major `[rows, cols]` matrix, as a view `[cols, rows]`.
pub fn transposed(data: &[f32], rows: usize, cols: usize) -> View<'_> {
    View::from_slice_with_strides_generic(data, Dyn(cols), Dyn(rows), Dyn(1), Dyn(cols))
}

/// `out = keep * out + a b`, `out` row-major `[a.rows, b.cols]`.
pub fn product(out: &mut [f32], a: &View<'_>, b: &View<'_>, keep: f32) {
    let (m, n) = (a.nrows(), b.ncols());
    let mut out: MatrixViewMut<'_, f32, Dyn, Dyn, Dyn, Dyn> =
        MatrixViewMut::from_slice_with_strides_generic(out, Dyn(m), Dyn(n), Dyn(n), Dyn(1));
    out.gemm(1.0, a, b, keep);
}

/// As [`product`], with the rows of `out` split over threads.
pub fn product_parallel(out: &mut [f32], a: &View<'_>, b: &View<'_>, keep: f32) {
    let (m, n) = (a.nrows(), b.ncols());
    let block = m.div_ceil(BLOCKS).max(1);
    out.par_chunks_mut(block * n).enumerate().for_each(|(i, out)| {
        let rows = out.len() / n;
        product(out, &a.rows(i * block, rows), b, keep);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_with_transposes_agree_with_the_definition() {
        let a: Vec<f32> = (0..7 * 11).map(|i| (i % 13) as f32 - 6.0).collect();
        let b: Vec<f32> = (0..9 * 11).map(|i| (i % 17) as f32 - 8.0).collect();
        let mut out = vec![1.0; 7 * 9];
        product_parallel(&mut out, &matrix(&a, 7, 11), &transposed(&b, 9, 11), 2.0);
        for i in 0..7 {
            for j in 0..9 {
                let dot: f32 = (0..11).map(|k| a[i * 11 + k] * b[j * 11 + k]).sum();
                assert_eq!(out[i * 9 + j], 2.0 + dot);
            }
        }
    }
}
