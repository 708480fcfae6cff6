//! Equilibria that are no minimum are left, or not called solved.

use super::lattice::{Lattice, STIFFNESS, dense, residual};
use fem::solve::{
    Admissible, BlockMatrix, Loading, PRESCRIBED, Pattern, Potential, Reason, Settings, SolveError, Solver,
    Stability,
};
use std::sync::Arc;

#[test]
fn buckled_column_is_left_for_a_stable_one() {
    // A slender column pressed exactly along its axis, five times beyond Euler's strain of 4π² (0.5 m / 24 m)²: the
    // straight state stays an equilibrium but is no minimum.
    let press = |p: &[f64; 3]| [0.0, 0.0, -0.08 * p[2]];
    let mut column = Lattice::new([2, 2, 25], |p| p[2] == 0.0 || p[2] == 24.0, |_| false, press);
    let mut x = column.start();
    let mut solver = Solver::new("column", Settings::default());
    let advance = solver.advance(&mut column, &mut x, 0, &mut Vec::new()).unwrap();
    assert!(!advance.indefinite_at.is_empty(), "the instability is reported");
    assert!(advance.tested_stable, "and what is handed back was tested");
    let mut k = BlockMatrix::zeros(column.pattern.clone());
    column.hessian(&x, 0.0, &mut k);
    let least = dense(&k).symmetric_eigenvalues().min();
    assert!(least > 0.0, "the equilibrium reported is stable, least eigenvalue {least:.1e}");
    let sideways = x.chunks_exact(3).map(|p| (p[0] - 0.5).abs().max((p[1] - 0.5).abs())).fold(0.0, f64::max);
    assert!(sideways > 1.5, "the column bends out, by {sideways:.2} m");
}

#[test]
fn equilibrium_that_is_no_minimum_is_found_out() {
    // One spring pushed together exactly along its line by a weaker pair: g = 0 all the way, K is not positive.
    let press = |_: &[f64; 3]| [0.0, 0.0, 0.0];
    let rest =
        vec![[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [4.0, 0.0, 1.0], [0.0, 4.0, 1.0], [1.0, 1.0, 2.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED, PRESCRIBED, PRESCRIBED, 1];
    let springs = vec![[0, 1], [1, 2], [1, 3], [1, 4], [5, 1], [5, 2], [5, 3], [5, 4]];
    let mut lattice = Lattice::of(rest, free, vec![false; 6], springs, press);
    lattice.length[0] = 1.8; // both compressed by almost half: the middle wants to snap sideways
    lattice.length[1] = 1.8;
    let mut x = lattice.start();
    assert!(residual(&lattice, &x) < 1e-12);
    let settings = Settings { stability: Stability::Always, ..Settings::default() };
    let advance = Solver::new("pair", settings).advance(&mut lattice, &mut x, 0, &mut Vec::new()).unwrap();
    assert_eq!(advance.unstable_at, [1.0]);
    assert!(x[0].hypot(x[1]) > 0.1, "snapped to {x:?}");
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x));
}

/// A lattice whose Hessian is indefinite wherever it is looked at as it is.
struct Saddle(Lattice);

impl Potential for Saddle {
    fn pattern(&self) -> &Arc<Pattern> {
        self.0.pattern()
    }

    fn energy(&self, x: &[f64]) -> f64 {
        self.0.energy(x)
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        self.0.gradient(x, g);
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        self.0.hessian(x, convexity, k);
        if convexity == 0.0 {
            k.add_block(0, 0, &[-1e4 * STIFFNESS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
    }

    fn force_scale(&self, x: &[f64]) -> f64 {
        self.0.force_scale(x)
    }
}

impl Admissible for Saddle {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        self.0.least_det_f(x)
    }
}

impl Loading for Saddle {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.0.set_load(t, x);
    }
}

/// Once the fourth equilibrium was called solved without a look at its stability.
#[test]
fn an_equilibrium_that_stays_unstable_is_not_solved() {
    let pull = |p: &[f64; 3]| [0.0, 0.0, 0.1 * p[2]];
    let mut saddle = Saddle(Lattice::new([3, 3, 3], |p| p[2] == 0.0 || p[2] == 2.0, |_| false, pull));
    let mut x = saddle.0.start();
    let settings = Settings { stability: Stability::Always, least_step: 0.5, ..Settings::default() };
    let error = Solver::new("saddle", settings).advance(&mut saddle, &mut x, 0, &mut Vec::new()).unwrap_err();
    let SolveError::NotConverged(stop) = &error else { panic!("{error}") };
    assert_eq!(stop.reason, Reason::Unstable, "{error}");
}
