//! A second solver for strictly convex quadratic programmes, to check the first with.
//!
//! Dual active-set method of Goldfarb & Idnani, Math Program 1983;27:1, dense, with Givens updates:
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
    let n = a.len();
    let factor = G.clone().cholesky().expect("G is positive definite");
    let mut state = State {
        J: factor.l().transpose().solve_upper_triangular(&DMatrix::identity(n, n)).expect("regular"),
        R: DMatrix::zeros(n, n),
        active: Vec::new(),
        u: Vec::new(),
    };
    let mut x = -factor.solve(a);
    let norm: Vec<f64> = constraints.iter().map(|c| c.n.norm().max(f64::MIN_POSITIVE)).collect();
    for (k, c) in constraints[..n_equalities].iter().enumerate() {
        let (z, r, slope) = state.direction(&c.n);
        let gap = c.b - c.n.dot(&x);
        if slope <= state.negligible(&c.n) {
            if gap.abs() > 1e-9 * norm[k] * x.amax().max(1.0) {
                return None;
            }
            continue;
        }
        let t = gap / slope;
        x += z * t;
        state.step(&r, t);
        state.add(k, &c.n, t);
    }
    for _ in 0..1000 * (n + constraints.len()) {
        let tolerance = 1e-11 * x.amax().max(1.0);
        let violation = |k: usize| (constraints[k].n.dot(&x) - constraints[k].b) / norm[k];
        let worst = (n_equalities..constraints.len())
            .filter(|k| !state.active.contains(k))
            .map(|k| (k, violation(k)))
            .fold((usize::MAX, -tolerance), |a, b| if b.1 < a.1 { b } else { a })
            .0;
        let Some(c) = constraints.get(worst) else { return Some(x) };
        let mut u_new = 0.0;
        loop {
            let (z, r, slope) = state.direction(&c.n);
            let (mut t_dual, mut blocking) = (f64::INFINITY, None);
            for k in 0..state.active.len() {
                if state.active[k] >= n_equalities && r[k] > 1e-14 && state.u[k] / r[k] < t_dual {
                    (t_dual, blocking) = (state.u[k] / r[k], Some(k));
                }
            }
            let dependent = slope <= state.negligible(&c.n);
            let t_primal = if dependent { f64::INFINITY } else { (c.b - c.n.dot(&x)) / slope };
            let t = t_dual.min(t_primal);
            if t.is_infinite() {
                return None;
            }
            if !dependent {
                x += z * t;
            }
            state.step(&r, t);
            u_new += t;
            match blocking {
                Some(k) if t_dual < t_primal => state.drop(k),
                _ => {
                    state.add(worst, &c.n, u_new);
                    break;
                }
            }
        }
    }
    panic!("the dual active-set method cycles");
}

/// Active constraints with multipliers u and the factors Jᵀ N = [R; 0], J Jᵀ = G⁻¹.
struct State {
    J: DMatrix<f64>,
    R: DMatrix<f64>,
    active: Vec<usize>,
    u: Vec<f64>,
}

impl State {
    /// Primal direction z, change of multipliers r, and slope zᵀn.
    fn direction(&self, normal: &DVector<f64>) -> (DVector<f64>, DVector<f64>, f64) {
        let q = self.active.len();
        let d = self.J.tr_mul(normal);
        let rest = d.rows(q, d.len() - q);
        let z = self.J.columns(q, d.len() - q) * rest;
        let R = self.R.view((0, 0), (q, q));
        let r = R.solve_upper_triangular(&d.rows(0, q).into_owned()).expect("R is regular");
        (z, r, rest.norm_squared())
    }

    /// Slopes below this mean that the normal depends on the active ones.
    fn negligible(&self, normal: &DVector<f64>) -> f64 {
        1e-18 * self.J.tr_mul(normal).norm_squared()
    }

    fn step(&mut self, r: &DVector<f64>, t: f64) {
        for (u, r) in self.u.iter_mut().zip(r) {
            *u -= t * r;
        }
    }

    fn add(&mut self, index: usize, normal: &DVector<f64>, u: f64) {
        let q = self.active.len();
        let mut d = self.J.tr_mul(normal);
        for j in (q + 1..d.len()).rev() {
            let (c, s, h) = givens(d[j - 1], d[j]);
            d[j - 1] = h;
            d[j] = 0.0;
            rotate_columns(&mut self.J, j - 1, j, c, s);
        }
        self.R.column_mut(q).rows_mut(0, q + 1).copy_from(&d.rows(0, q + 1));
        self.active.push(index);
        self.u.push(u);
    }

    fn drop(&mut self, k: usize) {
        self.active.remove(k);
        self.u.remove(k);
        let q = self.active.len();
        for j in k..q {
            let next = self.R.column(j + 1).into_owned();
            self.R.column_mut(j).copy_from(&next);
        }
        for j in k..q {
            let (c, s, _) = givens(self.R[(j, j)], self.R[(j + 1, j)]);
            for column in j..q {
                let (a, b) = (self.R[(j, column)], self.R[(j + 1, column)]);
                self.R[(j, column)] = c * a + s * b;
                self.R[(j + 1, column)] = c * b - s * a;
            }
            rotate_columns(&mut self.J, j, j + 1, c, s);
        }
        self.R.column_mut(q).fill(0.0);
        self.R.row_mut(q).fill(0.0);
    }
}

fn givens(a: f64, b: f64) -> (f64, f64, f64) {
    let h = a.hypot(b);
    if h == 0.0 { (1.0, 0.0, 0.0) } else { (a / h, b / h, h) }
}

fn rotate_columns(J: &mut DMatrix<f64>, i: usize, j: usize, c: f64, s: f64) {
    for row in 0..J.nrows() {
        let (a, b) = (J[(row, i)], J[(row, j)]);
        J[(row, i)] = c * a + s * b;
        J[(row, j)] = c * b - s * a;
    }
}
