//! A second solver for strictly convex quadratic programmes, to check the first with: another algorithm, which knows no active sets.
//!
//! Primal-dual interior points with Mehrotra's predictor and corrector (Nocedal & Wright, Numerical Optimization, 2nd ed., alg. 16.4), dense:
//! min 1/2 xᵀGx + aᵀx subject to n_kᵀx = b_k (k < n_equalities) and n_kᵀx ≥ b_k (the others).

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};

/// A constraint n·x = b or n·x ≥ b.
pub struct Constraint {
    /// Normal.
    pub n: DVector<f64>,
    /// Right-hand side.
    pub b: f64,
}

/// The minimiser, or `None` when no point satisfies the constraints.
pub fn minimise(
    G: &DMatrix<f64>,
    a: &DVector<f64>,
    constraints: &[Constraint],
    n_equalities: usize,
) -> Option<DVector<f64>> {
    // Unit normals, the largest right-hand side one, the largest curvature one.
    let norms: Vec<f64> = constraints.iter().map(|c| c.n.norm().max(f64::MIN_POSITIVE)).collect();
    let length = constraints.iter().zip(&norms).map(|(c, norm)| (c.b / norm).abs()).fold(1.0, f64::max);
    let curvature = G.amax();
    let (G, a) = (G / curvature, a / (curvature * length));
    let rows = |range: std::ops::Range<usize>| {
        let A = DMatrix::from_fn(range.len(), a.len(), |r, c| {
            constraints[range.start + r].n[c] / norms[range.start + r]
        });
        let b = DVector::from_fn(range.len(), |r, _| {
            constraints[range.start + r].b / (norms[range.start + r] * length)
        });
        (A, b)
    };
    let (A, b) = rows(0..n_equalities);
    let (C, d) = rows(n_equalities..constraints.len());
    let (n, p, m) = (a.len(), A.nrows(), C.nrows());
    let (mut x, mut y) = (DVector::zeros(n), DVector::zeros(p));
    let mut s = (&C * &x - &d).map(|s: f64| s.max(1.0));
    let mut z = DVector::repeat(m, 1.0);
    for _ in 0..200 {
        let r_d = &G * &x + &a - A.transpose() * &y - C.transpose() * &z;
        let (r_e, r_c) = (&A * &x - &b, &C * &x - &d - &s);
        let mu = if m > 0 { s.dot(&z) / m as f64 } else { 0.0 };
        let residual =
            r_d.amax().max(if p > 0 { r_e.amax() } else { 0.0 }).max(if m > 0 { r_c.amax() } else { 0.0 });
        if residual <= 1e-13 && mu <= 1e-19 {
            break;
        }
        let D = z.component_div(&s);
        let mut K = DMatrix::zeros(n + p, n + p);
        K.view_mut((0, 0), (n, n)).copy_from(&(&G + C.transpose() * DMatrix::from_diagonal(&D) * &C));
        K.view_mut((0, n), (n, p)).copy_from(&-A.transpose());
        K.view_mut((n, 0), (p, n)).copy_from(&A);
        let K = K.full_piv_lu();
        // The step towards s∘z = s∘z − t.
        let step = |t: &DVector<f64>| {
            let mut right = DVector::zeros(n + p);
            let pull = t.component_div(&s) + D.component_mul(&r_c);
            right.rows_mut(0, n).copy_from(&(-&r_d - C.transpose() * pull));
            right.rows_mut(n, p).copy_from(&-&r_e);
            let found = K.solve(&right)?;
            let (dx, dy) = (found.rows(0, n).into_owned(), found.rows(n, p).into_owned());
            let ds = &C * &dx + &r_c;
            let dz = -t.component_div(&s) - D.component_mul(&ds);
            Some((dx, dy, ds, dz))
        };
        let longest = |ds: &DVector<f64>, dz: &DVector<f64>| {
            let of = |v: &DVector<f64>, dv: &DVector<f64>| {
                v.iter()
                    .zip(dv.iter())
                    .filter(|(_, dv)| **dv < 0.0)
                    .map(|(v, dv)| -v / dv)
                    .fold(1.0, f64::min)
            };
            of(&s, ds).min(of(&z, dz))
        };
        let (_, _, ds, dz) = step(&s.component_mul(&z))?;
        let free = longest(&ds, &dz);
        let ahead = (&s + free * &ds).dot(&(&z + free * &dz)) / m.max(1) as f64;
        let centring = if mu > 0.0 { (ahead / mu).powi(3) } else { 0.0 };
        let t = s.component_mul(&z) + ds.component_mul(&dz).add_scalar(-centring * mu);
        let Some((dx, dy, ds, dz)) = step(&t) else { break };
        let free = 0.995 * longest(&ds, &dz);
        x += free * dx;
        y += free * dy;
        s += free * ds;
        z += free * dz;
        if !(x.amax() < 1e9) || free < 1e-12 {
            break;
        }
    }
    let missed = (&A * &x - &b).iter().fold(0.0f64, |m, e| m.max(e.abs()));
    let violated = (&C * &x - &d).iter().fold(0.0f64, |m, e| m.max(-e));
    (missed.max(violated) < 1e-8).then(|| x * length)
}
