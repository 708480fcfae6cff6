//! Linear systems with a positive semidefinite matrix.

#![allow(non_snake_case)]

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Pivots and slopes below this fraction of their size without the other rows belong to dependent rows.
pub(super) const DEPENDENT: f64 = 1e-13;

/// Cholesky factor of a positive semidefinite matrix with diagonal pivoting; the solution is 0 in the
/// dependent rows.
pub(super) struct PivotedCholesky {
    factor: Option<Cholesky<f64, Dyn>>,
    /// Independent rows.
    kept: Vec<usize>,
    /// 1/√S_kk.
    scale: DVector<f64>,
}

impl PivotedCholesky {
    /// `size`: diagonal that S could have; rows whose diagonal is negligible against it are dependent.
    pub fn new(S: DMatrix<f64>, size: &DVector<f64>) -> PivotedCholesky {
        let n = S.nrows();
        let scale =
            DVector::from_fn(
                n,
                |k, _| {
                    if S[(k, k)] > DEPENDENT * size[k] { 1.0 / S[(k, k)].sqrt() } else { 0.0 }
                },
            );
        let scaled = DMatrix::from_fn(n, n, |i, j| S[(i, j)] * scale[i] * scale[j]);
        // Outer-product elimination on a copy finds the independent rows.
        let mut rest = scaled.clone();
        let mut kept = Vec::with_capacity(n);
        let mut left: Vec<usize> = (0..n).collect();
        while let Some(position) = (0..left.len()).reduce(|a, b| {
            let (a_pivot, b_pivot) = (rest[(left[a], left[a])], rest[(left[b], left[b])]);
            if b_pivot > a_pivot { b } else { a }
        }) {
            let pivot_row = left.swap_remove(position);
            let pivot = rest[(pivot_row, pivot_row)];
            if pivot <= DEPENDENT {
                break;
            }
            kept.push(pivot_row);
            for &j in &left {
                let factor = rest[(pivot_row, j)] / pivot;
                for &i in &left {
                    rest[(i, j)] -= rest[(i, pivot_row)] * factor;
                }
            }
        }
        let factor = Cholesky::new(scaled.select_columns(&kept).select_rows(&kept));
        PivotedCholesky { factor, kept, scale }
    }

    pub fn solve_mut(&self, b: &mut DVector<f64>) {
        let mut reduced =
            DVector::from_iterator(self.kept.len(), self.kept.iter().map(|k| b[*k] * self.scale[*k]));
        b.fill(0.0);
        match &self.factor {
            Some(factor) => factor.solve_mut(&mut reduced),
            None => reduced.fill(f64::NAN),
        }
        for (k, row) in self.kept.iter().enumerate() {
            b[*row] = reduced[k] * self.scale[*row];
        }
    }
}
