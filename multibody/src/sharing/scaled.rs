//! The problem without units: variables, rows and loads of order one.
//!
//! ```text
//! min 1/2 zᵀ H z + qᵀ z + 1/2 Σ v_r² / c_r
//!     l ≤ z ≤ u,   A_r z + v_r = lo_r (r < n_equalities),   lo_r ≤ A_r z + v_r ≤ hi_r (other rows)
//! ```
//!
//! with z = f / (σ d). d_i = 1/√H_ii of the unscaled H = W_f + Xᵀ W_x X gives H a unit diagonal; every row has
//! unit norm; σ makes the loads at most one. `c_r` is the compliance of a row: 0 for a hard one, 1/w_s for
//! a moment with a reserve. Everything is computed from the problem of this frame alone.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};

use super::SharingProblem;

/// See the module. The rows after the equalities are the x that have a bound.
pub(super) struct Canonical {
    pub H: DMatrix<f64>,
    pub q: DVector<f64>,
    pub lower: DVector<f64>,
    pub upper: DVector<f64>,
    pub A: DMatrix<f64>,
    pub lo: DVector<f64>,
    pub hi: DVector<f64>,
    pub compliance: DVector<f64>,
    pub n_equalities: usize,
    /// Which x each row after the equalities stands for.
    pub bounded: Vec<usize>,
    /// f = variable_scale ∘ z \[N\].
    pub variable_scale: DVector<f64>,
    /// Multiplier of the posed row [cost/N·m or cost/N] = row_multiplier ∘ multiplier of the scaled row.
    pub multiplier_scale: DVector<f64>,
    /// No weights on x: H is diagonal.
    pub diagonal: bool,
}

impl Canonical {
    /// Scales `problem`. `soft_x`: weight of a squared violation of the bounds of x \[1/N²\]; `None`
    /// keeps them hard.
    pub fn new(problem: &SharingProblem, soft_x: Option<f64>) -> Canonical {
        let (n_equalities, n) = problem.R.shape();
        let diagonal = problem.w_x.iter().all(|w| *w == 0.0);
        let mut H = DMatrix::from_diagonal(&problem.w_f);
        let mut q = DVector::zeros(n);
        if !diagonal {
            let mut WX = problem.X.clone();
            for (mut row, w) in WX.row_iter_mut().zip(&problem.w_x) {
                row *= *w;
            }
            H.gemm(1.0, &problem.X.transpose(), &WX, 1.0);
            q.gemv_tr(1.0, &WX, &problem.x0, 0.0);
        }
        if let Some(target) = &problem.target_f {
            q -= problem.w_f.component_mul(target);
        }
        let d = H.diagonal().map(|h| 1.0 / h.sqrt());
        for j in 0..n {
            for i in 0..n {
                H[(i, j)] *= d[i] * d[j];
            }
        }
        q.component_mul_assign(&d);

        let has_bound = |x: usize| problem.lower_x[x].is_finite() || problem.upper_x[x].is_finite();
        let bounded: Vec<usize> = (0..problem.n_reactions()).filter(|x| has_bound(*x)).collect();
        let n_rows = n_equalities + bounded.len();
        let mut A = DMatrix::zeros(n_rows, n);
        let mut lo = DVector::zeros(n_rows);
        let mut hi = DVector::zeros(n_rows);
        let mut compliance = DVector::zeros(n_rows);
        for row in 0..n_equalities {
            A.row_mut(row).copy_from(&problem.R.row(row));
            lo[row] = problem.tau[row];
            hi[row] = problem.tau[row];
            compliance[row] = 1.0 / problem.reserve_weight(row);
        }
        for (k, &x) in bounded.iter().enumerate() {
            let row = n_equalities + k;
            A.row_mut(row).copy_from(&problem.X.row(x));
            lo[row] = problem.lower_x[x] - problem.x0[x];
            hi[row] = problem.upper_x[x] - problem.x0[x];
            compliance[row] = soft_x.map_or(0.0, |w| 1.0 / w);
        }
        for (mut column, d) in A.column_iter_mut().zip(&d) {
            column *= *d;
        }
        let mut norm = DVector::from_fn(n_rows, |row, _| A.row(row).norm());
        // A row that hardly depends on any muscle (an unactuated coordinate) keeps its own size.
        equal_where_negligible(&mut norm, 0..n_equalities);
        equal_where_negligible(&mut norm, n_equalities..n_rows);
        for row in 0..n_rows {
            A.row_mut(row).scale_mut(1.0 / norm[row]);
        }
        lo.component_div_assign(&norm);
        hi.component_div_assign(&norm);
        compliance.component_div_assign(&norm.component_mul(&norm));

        let lower = problem.lower_f.component_div(&d);
        let upper = problem.upper_f.component_div(&d);
        let largest =
            |v: &DVector<f64>| v.iter().filter(|v| v.is_finite()).fold(0.0, |m: f64, v| m.max(v.abs()));
        let sigma = [&lo, &hi, &q, &lower].into_iter().map(largest).fold(0.0, f64::max);
        let sigma = if sigma > 0.0 { sigma } else { 1.0 };
        for vector in [&mut q, &mut lo, &mut hi] {
            *vector /= sigma;
        }
        Canonical {
            H,
            q,
            lower: lower / sigma,
            upper: upper / sigma,
            A,
            lo,
            hi,
            compliance,
            n_equalities,
            bounded,
            variable_scale: d * sigma,
            multiplier_scale: norm.map(|norm| sigma / norm),
            diagonal,
        }
    }

    /// Number of variables.
    pub fn n(&self) -> usize {
        self.q.len()
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.lo.len()
    }
}

/// Coordinates whose row is negligible against the others: no muscle moves them.
pub(super) fn unactuated(problem: &SharingProblem) -> Vec<usize> {
    let norm = DVector::from_fn(problem.n_coordinates(), |row, _| problem.R.row(row).norm());
    (0..norm.len()).filter(|row| norm[*row] <= NEGLIGIBLE * norm.max()).collect()
}

/// Row norm below which a row counts as zero, relative to the largest of its kind.
const NEGLIGIBLE: f64 = 1e-9;

/// Replaces norms that are negligible by the largest of the range (by 1 if all are zero).
fn equal_where_negligible(norm: &mut DVector<f64>, rows: std::ops::Range<usize>) {
    let largest = rows.clone().map(|row| norm[row]).fold(0.0, f64::max);
    let largest = if largest > 0.0 { largest } else { 1.0 };
    for row in rows {
        if norm[row] <= NEGLIGIBLE * largest {
            norm[row] = largest;
        }
    }
}
