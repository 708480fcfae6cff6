//! One linear system per Newton step: conjugate gradients around a Cholesky factor that is kept while it helps.
//!
//! The factor is of single precision: half the memory and time, and a perfect preconditioner still, since the products
//! and the answer are of double precision. Where single precision breaks down, or serves badly, double takes over.
//! Nothing here depends on the clock, so that the same input gives the same bits.

use super::patience::Patience;
use super::{Analysis, BlockMatrix, Cholesky, Indefinite, Pattern};
use rayon::prelude::*;
use std::sync::Arc;

/// Iterations with a fresh factor of single precision after which double precision takes over.
const FRESH_LIMIT: usize = 40;
/// Solves at most for which a kept factor that did not serve is not tried.
const LONGEST_WAIT: u32 = 4;

/// What a solve took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinearReport {
    /// Conjugate gradient iterations.
    pub iterations: usize,
    /// Factorizations, failed ones included.
    pub factorizations: usize,
    /// Seconds in factorizations.
    pub factorization_s: f64,
    /// ‖b − K x‖ / ‖b‖ reached.
    pub relative_residual: f64,
}

/// Solves systems with matrices of one pattern, keeping the factor from one to the next.
#[derive(Debug)]
pub struct LinearSolver {
    analysis: Arc<Analysis>,
    /// Places of the nodes, to divide their graph.
    points: Vec<f64>,
    /// The pattern of the factor where blocks outside the matrix's own pattern belong to it.
    joint: Option<Arc<Pattern>>,
    single: Option<Cholesky<f32>>,
    double: Option<Cholesky<f64>>,
    /// Single precision has failed: it is not tried again.
    needs_double: bool,
    /// The kept factor is worth a try.
    usable: bool,
    patience: Patience,
    /// Iterations that a factorization is worth.
    worth: usize,
}

impl LinearSolver {
    /// `points`: places of the nodes, three coordinates each; `double`: factors of double precision from the start.
    pub fn new(analysis: Arc<Analysis>, points: &[f64], double: bool) -> LinearSolver {
        let worth = worth(&analysis);
        LinearSolver {
            analysis,
            points: points.to_vec(),
            joint: None,
            single: None,
            double: None,
            needs_double: double,
            usable: false,
            patience: Patience::new(LONGEST_WAIT),
            worth,
        }
    }

    /// The analysis of the pattern.
    pub fn analysis(&self) -> &Arc<Analysis> {
        &self.analysis
    }

    /// The kept factor is not tried for the next matrix.
    pub fn forget(&mut self) {
        self.usable = false;
    }

    /// Solves K x = b to ‖b − K x‖ ≤ `tolerance` ‖b‖; `x` starts from zero. The kept factor is tried first.
    ///
    /// The error says that K is not positive definite. `definite`: the caller knows that it is, so that a factorization of
    /// single precision that fails is blamed on round-off and repeated in double.
    pub fn solve(
        &mut self,
        k: &BlockMatrix,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        definite: bool,
    ) -> (LinearReport, Result<(), Indefinite>) {
        let mut report = LinearReport::default();
        x.fill(0.0);
        if self.usable && self.patience.is_over() {
            let outcome = self.iterate(k, b, x, tolerance, self.worth, &mut report);
            // Most of the worth is spent: the next matrix, farther away, will need a factor of its own.
            self.usable = outcome == Outcome::Converged && 2 * report.iterations <= self.worth;
            match outcome {
                Outcome::Converged => {
                    self.patience.succeed();
                    return (report, Ok(()));
                }
                Outcome::Limit => self.patience.fail(),
                Outcome::NegativeCurvature(unknown) => return (report, Err(Indefinite { unknown })),
            }
        }
        loop {
            if let Err(indefinite) = self.factorize(k, definite, &mut report) {
                return (report, Err(indefinite));
            }
            let outcome = self.iterate(k, b, x, tolerance, FRESH_LIMIT, &mut report);
            self.usable = outcome == Outcome::Converged;
            match outcome {
                Outcome::NegativeCurvature(unknown) => return (report, Err(Indefinite { unknown })),
                Outcome::Limit if !self.needs_double => self.needs_double = true,
                // With a factor of double precision this is as good as it gets; the caller sees the residual.
                Outcome::Converged | Outcome::Limit => return (report, Ok(())),
            }
        }
    }

    /// Factorizes `k` now, whatever is kept; a failure in single precision is checked in double.
    pub fn refactorize(&mut self, k: &BlockMatrix) -> Result<(), Indefinite> {
        self.factorize(k, true, &mut LinearReport::default())
    }

    /// x = (L Lᵀ)⁻¹ b with the kept factor, as it is.
    pub fn apply(&self, b: &[f64], x: &mut [f64]) {
        self.precondition(b, x);
    }

    /// Factorizes K, in single precision where that works.
    fn factorize(
        &mut self,
        k: &BlockMatrix,
        definite: bool,
        report: &mut LinearReport,
    ) -> Result<(), Indefinite> {
        self.usable = false;
        let start = std::time::Instant::now();
        let joint;
        let k = match self.join(k) {
            Some(pattern) => {
                joint = k.spread(&pattern);
                &joint
            }
            None => k,
        };
        let mut done = Err(Indefinite { unknown: 0 });
        if !self.needs_double {
            let single = self.single.get_or_insert_with(|| Cholesky::new(self.analysis.clone()));
            done = single.factorize(k);
            report.factorizations += 1;
        }
        if done.is_err() && (definite || self.needs_double) {
            let double = self.double.get_or_insert_with(|| Cholesky::new(self.analysis.clone()));
            done = double.factorize(k);
            report.factorizations += 1;
            if done.is_ok() {
                self.needs_double = true;
                self.single = None;
            } else if !self.needs_double {
                self.double = None; // give the memory back
            }
        }
        report.factorization_s += start.elapsed().as_secs_f64();
        done
    }

    /// The pattern on which to factorize a matrix with blocks outside its own, analysed anew where the last one lacks some
    /// of them or has far more; `None`: its own.
    fn join(&mut self, k: &BlockMatrix) -> Option<Arc<Pattern>> {
        if k.n_cross() == 0 && self.joint.is_none() {
            return None;
        }
        let n_blocks = k.pattern().n_blocks() + k.n_cross();
        let kept = self.joint.take().filter(|p| p.n_blocks() <= STALE * n_blocks / 4 && k.fits(p));
        let pattern = kept.unwrap_or_else(|| {
            let pattern = Arc::new(k.joint_pattern());
            self.analysis = Arc::new(Analysis::new(&pattern, &self.points));
            self.worth = worth(&self.analysis);
            self.single.iter_mut().for_each(|factor| factor.renew(self.analysis.clone()));
            self.double.iter_mut().for_each(|factor| factor.renew(self.analysis.clone()));
            pattern
        });
        self.joint = Some(pattern.clone());
        Some(pattern)
    }

    fn precondition(&self, r: &[f64], z: &mut [f64]) {
        z.copy_from_slice(r);
        match (&self.double, &self.single) {
            (Some(factor), _) => factor.solve(z),
            (None, Some(factor)) => factor.solve(z),
            (None, None) => unreachable!("a factor exists before the first iteration"),
        }
    }

    /// Preconditioned conjugate gradients from `x`, at most `limit` iterations; flexible (Polak-Ribière), because the
    /// preconditioner rounds. Notay, Flexible conjugate gradients, SIAM J. Sci. Comput. 22 (2000).
    fn iterate(
        &self,
        k: &BlockMatrix,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        limit: usize,
        report: &mut LinearReport,
    ) -> Outcome {
        let n = b.len();
        let wanted = tolerance * norm(b);
        let (mut r, mut z, mut q) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        k.multiply(x, &mut q);
        for i in 0..n {
            r[i] = b[i] - q[i];
        }
        let mut p = vec![0.0; n];
        let mut old_rz = 0.0;
        let mut old_r = vec![0.0; n];
        for _ in 0..limit {
            let residual = norm(&r);
            report.relative_residual = if residual > 0.0 { residual / norm(b) } else { 0.0 };
            if residual <= wanted {
                return Outcome::Converged;
            }
            self.precondition(&r, &mut z);
            let rz = dot(&r, &z);
            let beta = if old_rz > 0.0 { ((rz - dot(&old_r, &z)) / old_rz).max(0.0) } else { 0.0 };
            for i in 0..n {
                p[i] = z[i] + beta * p[i];
            }
            k.multiply(&p, &mut q);
            let curvature = dot(&p, &q);
            if curvature <= 0.0 || curvature.is_nan() {
                let steepest = (0..n).max_by(|&i, &j| p[i].abs().total_cmp(&p[j].abs())).unwrap_or(0);
                return Outcome::NegativeCurvature(steepest);
            }
            let alpha = dot(&r, &p) / curvature;
            old_r.copy_from_slice(&r);
            for i in 0..n {
                x[i] += alpha * p[i];
                r[i] -= alpha * q[i];
            }
            old_rz = rz;
            report.iterations += 1;
        }
        report.relative_residual = norm(&r) / norm(b);
        if norm(&r) <= wanted { Outcome::Converged } else { Outcome::Limit }
    }
}

/// Quarters of the wanted number of blocks beyond which a pattern that fits is given up.
const STALE: usize = 5;

/// Iterations that a factorization is worth. Measured with factors of 10⁶ to 10⁸ numbers: a number in the factor costs
/// as much in one iteration as 30 multiply-adds of the factorization.
fn worth(analysis: &Analysis) -> usize {
    ((analysis.work() / (30.0 * analysis.n_values() as f64)) as usize).clamp(3, 100)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Outcome {
    Converged,
    Limit,
    /// pᵀ K p ≤ 0, with the unknown that moves most in p.
    NegativeCurvature(usize),
}

/// Scalar product, summed in pieces of fixed length: same bits on any number of threads.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let piece = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let pieces: Vec<f64> = a.par_chunks(8192).zip(b.par_chunks(8192)).map(piece).collect();
    pieces.iter().sum()
}

/// Euclidean norm.
pub(super) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
