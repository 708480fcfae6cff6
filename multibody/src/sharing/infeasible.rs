//! Frames that no admissible tensions can carry: what is missing, what stands in the way, what would do.

#![allow(non_snake_case)]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::DVector;

use super::interior::settings;
use super::scaled::unactuated;
use super::solve::{NoPoint, Point, Raised};
use super::verdict::infeasible_reason;
use super::{Blocking, Sharing, SharingProblem, SharingSolver};
use crate::trial::{Shortfall, Status};

/// Cost of forces relative to that of missing moments in the least-violation problem. Small, so that the
/// forces only break ties: it moves the missing moments by about this fraction.
const TIE_BREAK: f64 = 1e-8;
/// Moments below this fraction of the largest required one (or of 1 N·m) are not missing.
const NOT_MISSING: f64 = 1e-6;
/// A bound of x is in the way when its multiplier reaches this fraction of that of the missing moments.
const IN_THE_WAY: f64 = 1e-3;
/// Raised strengths exceed the smallest sufficient ones by this fraction, so that there is an interior.
const RAISE_MARGIN: f64 = 1e-6;

impl SharingSolver {
    /// Verdict and least-violation answer of a frame without an optimum; `no_point` says why.
    ///
    /// The moments are equalities with slack s, min Σ s² \[(N·m)²\] with the cost as tie-break. Bounds on f
    /// always hold, those on x as long as any tensions satisfy them.
    pub(super) fn infeasible(&mut self, problem: &SharingProblem, no_point: NoPoint) -> Sharing {
        let d = problem.w_f.map(|w| 1.0 / w.sqrt());
        let largest_norm = |M: &nalgebra::DMatrix<f64>| {
            (0..M.nrows()).map(|k| M.row(k).tr_dot_scaled(&d)).fold(0.0, f64::max)
        };
        let reach = largest_norm(&problem.R);
        let weight = 1.0 / (TIE_BREAK * if reach > 0.0 { reach * reach } else { 1.0 });
        let mut relaxed = problem.clone();
        relaxed.w_s =
            Some(DVector::from_fn(problem.n_coordinates(), |k, _| problem.reserve_weight(k).min(weight)));

        let mut iterations = no_point.iterations;
        let mut soft = false;
        let attempt = self.optimum(&relaxed, None, None).or_else(|first| {
            iterations += first.iterations;
            soft = true;
            let reach_x = largest_norm(&problem.X);
            let weight_x = 1.0 / (TIE_BREAK * if reach_x > 0.0 { reach_x * reach_x } else { 1.0 });
            self.optimum(&relaxed, Some(weight_x), None)
        });
        let point = match attempt {
            Ok(point) => point,
            Err(second) => {
                let reason = format!("{}; least violation: {}", no_point.reason, second.reason);
                return self.failed(problem, reason, iterations + second.iterations);
            }
        };
        iterations += point.iterations;

        let unactuated = unactuated(problem);
        let tolerance = NOT_MISSING * problem.tau.amax().max(1.0);
        let blocked = blocking_rows(problem, &point, &d);
        let excess = excess(problem, &point, soft);
        let mut answer = self.answer(problem, point, Status::Infeasible, unactuated);
        answer.verdict.iterations = iterations;
        if answer.missing.amax() <= tolerance && excess.is_empty() {
            let reason = format!("{}, yet the moments can be met: a degenerate frame", no_point.reason);
            return self.failed(problem, reason, iterations);
        }
        answer.blocking = self.blocking(problem, &blocked);
        let saturated: Vec<usize> =
            (0..problem.n_muscles()).filter(|i| answer.f[*i] >= problem.upper_f[*i]).collect();
        answer.verdict.reason = Some(infeasible_reason(
            &self.names,
            &answer.missing,
            tolerance,
            &answer.unactuated,
            &saturated,
            &answer.blocking,
            &excess,
        ));
        answer.verdict.shortfall = (0..problem.n_coordinates())
            .filter(|k| answer.missing[*k].abs() > tolerance)
            .map(|k| Shortfall { coordinate: self.names.coordinates[k].clone(), missing: answer.missing[k] })
            .collect();
        match self.options.raise_bounds.and_then(|limit| smallest_factor(problem, limit)) {
            Some(factor) => self.raised(problem, answer, factor * (1.0 + RAISE_MARGIN)),
            None => answer,
        }
    }

    /// `answer` with the forces of strengths raised by `factor`, where that frame is solved.
    fn raised(&mut self, problem: &SharingProblem, answer: Sharing, factor: f64) -> Sharing {
        let mut stronger = problem.clone();
        stronger.upper_f *= factor;
        let Ok(point) = self.optimum(&stronger, None, None) else { return answer };
        let with_raised = self.answer(&stronger, point, Status::Infeasible, answer.unactuated.clone());
        let mut verdict = with_raised.verdict.clone();
        let reason = answer.verdict.reason.unwrap_or_default();
        verdict.reason =
            Some(format!("{reason}; forces are those of strengths raised by a factor {factor:.4}"));
        verdict.iterations += answer.verdict.iterations;
        verdict.shortfall = answer.verdict.shortfall;
        verdict.saturated = answer.verdict.saturated;
        Sharing {
            missing: answer.missing,
            blocking: answer.blocking,
            raised: Some(Raised { factor }),
            verdict,
            ..with_raised
        }
    }

    /// The blocking bounds with the forces that the moments need without them.
    fn blocking(&mut self, problem: &SharingProblem, rows: &[(usize, f64)]) -> Vec<Blocking> {
        if rows.is_empty() {
            return Vec::new();
        }
        let mut opened = problem.clone();
        for (x, multiplier) in rows {
            if *multiplier > 0.0 {
                opened.lower_x[*x] = f64::NEG_INFINITY;
            } else {
                opened.upper_x[*x] = f64::INFINITY;
            }
        }
        let needed = self.optimum(&opened, None, None).ok().map(|point| problem.reactions(&point.f));
        let bound = |x: usize, multiplier: f64| {
            if multiplier > 0.0 { problem.lower_x[x] } else { problem.upper_x[x] }
        };
        rows.iter()
            .map(|(x, multiplier)| Blocking {
                reaction: self.names.reactions[*x].clone(),
                bound: bound(*x, *multiplier),
                needed: needed.as_ref().map(|needed| needed[*x]),
            })
            .collect()
    }
}

/// Bounds of x whose multiplier is of the size of the missing moments' (not merely of the cost's).
fn blocking_rows(problem: &SharingProblem, point: &Point, d: &DVector<f64>) -> Vec<(usize, f64)> {
    let m = &point.multipliers;
    let moments = (0..problem.n_coordinates())
        .map(|k| m.moments[k].abs() * problem.R.row(k).tr_dot_scaled(d))
        .fold(0.0, f64::max);
    (0..problem.n_reactions())
        .map(|j| (j, m.reactions[j]))
        .filter(|(j, mu)| mu.abs() * problem.X.row(*j).tr_dot_scaled(d) > IN_THE_WAY * moments)
        .collect()
}

/// Violations of the bounds of x where these could not all be kept \[N\].
fn excess(problem: &SharingProblem, point: &Point, soft: bool) -> Vec<(usize, f64)> {
    if !soft {
        return Vec::new();
    }
    let x = problem.reactions(&point.f);
    let tolerance = NOT_MISSING * x.amax().max(1.0);
    let violation = |j: usize| (x[j] - problem.upper_x[j]).max(0.0) + (x[j] - problem.lower_x[j]).min(0.0);
    (0..x.len()).map(|j| (j, violation(j))).filter(|(_, v)| v.abs() > tolerance).collect()
}

/// The smallest common factor, from 1 to `limit`, on the finite strengths that makes the frame feasible:
/// min c subject to the equalities and bounds with f ≤ c upper_f. Lower bounds stay.
fn smallest_factor(problem: &SharingProblem, limit: f64) -> Option<f64> {
    let n = problem.n_muscles();
    let reach = |i: usize| {
        if problem.upper_f[i].is_finite() { problem.upper_f[i].max(f64::MIN_POSITIVE) } else { 1.0 }
    };
    // Columns z_i = f_i / reach_i, then c; rows scaled to unit norm.
    let mut equalities: Vec<(Vec<f64>, f64)> = Vec::new();
    let mut inequalities: Vec<(Vec<f64>, f64)> = Vec::new();
    let scaled = |coefficients: Vec<f64>, right: f64| {
        let norm = coefficients.iter().map(|c| c * c).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        (coefficients.iter().map(|c| c / norm).collect::<Vec<f64>>(), right / norm)
    };
    for k in (0..problem.n_coordinates()).filter(|k| problem.reserve_weight(*k).is_infinite()) {
        let mut row: Vec<f64> = (0..n).map(|i| problem.R[(k, i)] * reach(i)).collect();
        row.push(0.0);
        equalities.push(scaled(row, problem.tau[k]));
    }
    for j in 0..problem.n_reactions() {
        for (sign, bound) in [(1.0, problem.upper_x[j]), (-1.0, problem.lower_x[j])] {
            if bound.is_finite() {
                let mut row: Vec<f64> = (0..n).map(|i| sign * problem.X[(j, i)] * reach(i)).collect();
                row.push(0.0);
                inequalities.push(scaled(row, sign * (bound - problem.x0[j])));
            }
        }
    }
    for i in 0..n {
        let mut row = vec![0.0; n + 1];
        row[i] = -1.0;
        inequalities.push((row.clone(), -problem.lower_f[i] / reach(i)));
        if problem.upper_f[i].is_finite() {
            row[i] = 1.0;
            row[n] = -1.0;
            inequalities.push((row, 0.0));
        }
    }
    let mut row = vec![0.0; n + 1];
    row[n] = -1.0;
    inequalities.push((row.clone(), -1.0));
    row[n] = 1.0;
    inequalities.push((row, limit));

    let cones =
        [SupportedConeT::ZeroConeT(equalities.len()), SupportedConeT::NonnegativeConeT(inequalities.len())];
    let (rows, b): (Vec<Vec<f64>>, Vec<f64>) = equalities.into_iter().chain(inequalities).unzip();
    let A = CscMatrix::from(&rows);
    let P = CscMatrix::zeros((n + 1, n + 1));
    let mut q = vec![0.0; n + 1];
    q[n] = 1.0;
    let mut solver = DefaultSolver::new(&P, &q, &A, &b, &cones, settings()).ok()?;
    solver.solve();
    (solver.solution.status == SolverStatus::Solved).then(|| solver.solution.x[n].max(1.0))
}

/// Norm of a row with its entries scaled.
trait RowNorm {
    /// √ Σ (row_i d_i)².
    fn tr_dot_scaled(&self, d: &DVector<f64>) -> f64;
}

impl<S: nalgebra::RawStorage<f64, nalgebra::U1, nalgebra::Dyn>> RowNorm
    for nalgebra::Matrix<f64, nalgebra::U1, nalgebra::Dyn, S>
{
    fn tr_dot_scaled(&self, d: &DVector<f64>) -> f64 {
        self.iter().zip(d).map(|(a, d)| (a * d).powi(2)).sum::<f64>().sqrt()
    }
}
