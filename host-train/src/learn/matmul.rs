//! Products of row-major matrices, split into a fixed number of blocks so that the result does not depend on the
//! number of threads. ndarray computes them, because its entry point is safe and the gemm crate's is not.

use ndarray::linalg::general_mat_mul;
use ndarray::{ArrayView2, ArrayViewMut2, s};
use rayon::prelude::*;

/// Blocks that a parallel product is split into.
const BLOCKS: usize = 8;

/// A row-major `[rows, cols]` matrix; its transpose is `.t()`.
pub fn matrix(data: &[f32], rows: usize, cols: usize) -> ArrayView2<'_, f32> {
    ArrayView2::from_shape((rows, cols), data).expect("as many values as the matrix has")
}

/// `out = keep * out + a b`, `out` row-major `[a.rows, b.cols]`.
pub fn product(out: &mut [f32], a: ArrayView2<'_, f32>, b: ArrayView2<'_, f32>, keep: f32) {
    let shape = (a.nrows(), b.ncols());
    let mut out = ArrayViewMut2::from_shape(shape, out).expect("as many values as the product has");
    general_mat_mul(1.0, &a, &b, keep, &mut out);
}

/// As [`product`], with the rows of `out` split over threads.
pub fn product_parallel(
    out: &mut [f32],
    a: ArrayView2<'_, f32>,
    b: ArrayView2<'_, f32>,
    keep: f32,
) {
    let n = b.ncols();
    let block = a.nrows().div_ceil(BLOCKS).max(1);
    out.par_chunks_mut((block * n).max(1))
        .enumerate()
        .for_each(|(i, out)| {
            let rows = i * block..i * block + out.len() / n;
            product(out, a.slice(s![rows, ..]), b, keep);
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
        product_parallel(&mut out, matrix(&a, 7, 11), matrix(&b, 9, 11).t(), 2.0);
        for i in 0..7 {
            for j in 0..9 {
                let dot: f32 = (0..11).map(|k| a[i * 11 + k] * b[j * 11 + k]).sum();
                assert_eq!(out[i * 9 + j], 2.0 + dot);
            }
        }
    }
}
