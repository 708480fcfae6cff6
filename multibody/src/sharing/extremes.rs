//! What force sharing leaves open: the least and the greatest of linear functions of the joint forces over all admissible tensions.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};

use super::SharingProblem;
use super::scaled::Canonical;
use super::simplex::{Least, Polytope};

/// Least and greatest value of wᵀ x over all tensions that carry the moments within all bounds, for each `w` of `objectives`
/// \[unit of w × N\].
///
/// `f`: an admissible answer \[N\], from which the search starts; `s`: its reserve moments \[N·m\], which are kept.
/// NaN where the end could not be proved; infinite where nothing bounds it (tensions without upper bounds).
pub fn extremes(
    problem: &SharingProblem,
    f: &DVector<f64>,
    s: &DVector<f64>,
    objectives: &[DVector<f64>],
) -> Vec<[f64; 2]> {
    // With the reserves kept, the moments are equalities.
    let posed = SharingProblem { tau: &problem.tau - s, w_s: None, ..problem.clone() };
    let c = Canonical::new(&posed, None);
    let (n, m, ne) = (c.n(), c.n_rows(), c.n_equalities);
    // Each bounded row gets a variable of its own, the row's value.
    let mut A = DMatrix::zeros(m, n + m - ne);
    A.columns_mut(0, n).copy_from(&c.A);
    for row in ne..m {
        A[(row, n + row - ne)] = -1.0;
    }
    let z = f.component_div(&c.variable_scale);
    let rows = &c.A * &z;
    let join = |variables: &DVector<f64>, rows: &DVector<f64>| {
        let all = variables.iter().chain(rows.iter().skip(ne)).copied();
        DVector::from_iterator(n + m - ne, all)
    };
    let (lower, upper) = (join(&c.lower, &c.lo), join(&c.upper, &c.hi));
    // A point of round-off outside its bounds starts on them.
    let start = join(&z, &rows).zip_zip_map(&lower, &upper, |z, l, u| z.clamp(l, u));
    let b = DVector::from_fn(m, |row, _| if row < ne { c.lo[row] } else { 0.0 });
    let polytope = Polytope::new(A, b, lower, upper, start);
    objectives
        .iter()
        .map(|w| {
            let constant = w.dot(&problem.x0);
            let own = problem.X.tr_mul(w).component_mul(&c.variable_scale);
            let cost = DVector::from_fn(n + m - ne, |j, _| if j < n { own[j] } else { 0.0 });
            let value = |least: Least, sign: f64| match least {
                Least::Proved(value) => constant + sign * value,
                Least::Unbounded => -sign * f64::INFINITY,
                Least::Unsettled => f64::NAN,
            };
            [value(polytope.least(&cost), 1.0), value(polytope.least(&-&cost), -1.0)]
        })
        .collect()
}
