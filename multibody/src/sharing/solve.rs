//! One frame after another: guess from the previous frame, Clarabel, exact answer, verdict.

#![allow(non_snake_case)]

use nalgebra::DVector;
use rayon::prelude::*;

use super::active_set::{self, ActiveSet, NoOptimum, Optimum};
use super::interior::{Interior, InteriorPoint};
use super::scaled::Canonical;
use super::verdict::{active_bounds, named};
use super::{
    Blocking, KKT_TOLERANCE, Multipliers, Names, Residuals, SharingError, SharingProblem, residuals,
};
use crate::trial::{Shortfall, Status, Verdict};

/// What to do beyond solving.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SharingOptions {
    /// On an infeasible frame, multiply all finite strengths by the smallest common factor that makes it
    /// feasible, up to this one, and report those forces. The frame stays infeasible.
    pub raise_bounds: Option<f64>,
}

/// The answer of an infeasible frame with raised strengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raised {
    /// All finite upper bounds of the tensions were multiplied by this.
    pub factor: f64,
}

/// The forces of one frame and the verdict on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Sharing {
    /// Tensions, n_muscles \[N\]; NaN where the frame failed.
    pub f: DVector<f64>,
    /// Contact, ligament, tendon and bone forces x0 + X f, n_x \[N\]; NaN where the frame failed.
    pub x: DVector<f64>,
    /// Reserve moments, n_coordinates \[N·m\]; zero where no reserve was asked for.
    pub s: DVector<f64>,
    /// Moments that are missing, n_coordinates \[N·m\]: tau − R f − s of the least-violation answer.
    pub missing: DVector<f64>,
    /// Cost 1/2 (Σ w_f (f − target)² + Σ w_x x² + Σ w_s s²).
    pub objective: f64,
    /// Multipliers of the problem that was solved.
    pub multipliers: Multipliers,
    /// Residuals of the problem that was solved: as posed, or the least-violation or raised problem.
    pub residuals: Residuals,
    /// Solved, infeasible or failed, and why. `kkt_residual` is the largest of `residuals`;
    /// `equality_residual` always refers to the problem as posed.
    pub verdict: Verdict,
    /// Bounds on x that stand in the way (infeasible frames).
    pub blocking: Vec<Blocking>,
    /// Coordinates that no muscle moves.
    pub unactuated: Vec<usize>,
    /// Set when the forces are those of raised strengths.
    pub raised: Option<Raised>,
}

/// Solves frame after frame of the same leg.
///
/// Answers are the same bits whatever was solved before. The bounds that held in the previous frame are a
/// guess only: they are taken when every sign is right with room to spare, for then they are the only
/// possible ones and the numbers follow from them alone. Otherwise Clarabel finds the bounds from scratch.
pub struct SharingSolver {
    pub(super) names: Names,
    pub(super) options: SharingOptions,
    interior: InteriorPoint,
    guess: Option<ActiveSet>,
}

/// A solution of some problem, as posed or relaxed.
pub(super) struct Point {
    pub f: DVector<f64>,
    pub s: DVector<f64>,
    pub multipliers: Multipliers,
    pub residuals: Residuals,
    pub iterations: u32,
    set: ActiveSet,
}

/// Why there is no [`Point`].
pub(super) struct NoPoint {
    pub reason: String,
    pub iterations: u32,
}

/// Margin from which the active bounds are beyond doubt (scaled units).
const CLEAR: f64 = 1e-8;
/// Linear systems spent on the guess from the previous frame before Clarabel is asked.
const WARM_STEPS: u32 = 40;
/// Linear systems spent on the bounds that Clarabel found.
const EXACT_STEPS: u32 = 200;

impl SharingSolver {
    /// A solver for problems whose rows and columns have these names.
    pub fn new(names: Names, options: SharingOptions) -> SharingSolver {
        SharingSolver { names, options, interior: InteriorPoint::default(), guess: None }
    }

    /// Forces and verdict of one frame; an error only where the problem itself is malformed.
    pub fn solve(&mut self, problem: &SharingProblem) -> Result<Sharing, SharingError> {
        problem.validate(&self.names)?;
        match self.optimum(problem, None, self.guess.clone()) {
            Ok(point) => {
                self.guess = Some(point.set.clone());
                Ok(self.solved(problem, point))
            }
            Err(no_point) => Ok(self.infeasible(problem, no_point)),
        }
    }

    /// The optimum of `problem`, with violations of the bounds of x weighted by `soft_x` if given.
    pub(super) fn optimum(
        &mut self,
        problem: &SharingProblem,
        soft_x: Option<f64>,
        guess: Option<ActiveSet>,
    ) -> Result<Point, NoPoint> {
        let canonical = Canonical::new(problem, soft_x);
        let mut steps = 0;
        if let Some(guess) = guess.filter(|guess| guess.fits(&canonical)) {
            steps += WARM_STEPS;
            if let Ok(optimum) = active_set::solve(&canonical, guess, WARM_STEPS)
                && optimum.margin > CLEAR
            {
                let point = Point::new(problem, &canonical, optimum, 0);
                if point.is_optimal(soft_x) {
                    return Ok(point);
                }
            }
        }
        let (start, word, iterations) = match self.interior.solve(&canonical) {
            Interior::Optimal(set, iterations) => (set, None, iterations),
            Interior::Infeasible(iterations) => {
                (ActiveSet::free(&canonical), Some("infeasible".into()), iterations)
            }
            Interior::Stuck(status, iterations) => (ActiveSet::free(&canonical), Some(status), iterations),
        };
        let reason = match active_set::solve(&canonical, start, EXACT_STEPS) {
            Ok(optimum) => {
                let point = Point::new(problem, &canonical, optimum, iterations);
                if point.is_optimal(soft_x) {
                    return Ok(point);
                }
                format!("KKT residual {:.1e}", point.residuals.largest())
            }
            Err(NoOptimum::Infeasible) => "no tensions within the bounds carry the load".into(),
            Err(NoOptimum::Unsettled) => {
                format!(
                    "the active bounds could not be settled (interior-point method: {})",
                    word.unwrap_or("optimal".into())
                )
            }
        };
        Err(NoPoint { reason, iterations: iterations + steps })
    }

    /// The answer of a frame that was solved as posed.
    fn solved(&self, problem: &SharingProblem, point: Point) -> Sharing {
        let unactuated = super::scaled::unactuated(problem);
        self.answer(problem, point, Status::Solved, unactuated)
    }

    /// Everything that follows from a point; the parts of an infeasible frame are filled in by the caller.
    pub(super) fn answer(
        &self,
        problem: &SharingProblem,
        point: Point,
        status: Status,
        unactuated: Vec<usize>,
    ) -> Sharing {
        let Point { f, s, multipliers, residuals, iterations, .. } = point;
        let moment = &problem.R * &f;
        let own =
            DVector::from_fn(s.len(), |k, _| if problem.reserve_weight(k).is_finite() { s[k] } else { 0.0 });
        let missing = if status == Status::Solved { DVector::zeros(s.len()) } else { &s - &own };
        let equality = (&problem.tau - &moment - &own).amax() / problem.tau.amax().max(1.0);
        let carried: f64 = own.iter().zip(&problem.tau).map(|(s, tau)| s.abs() + (tau - s).abs()).sum();
        let (active_bounds, saturated) = active_bounds(problem, &f, &multipliers);
        let verdict = Verdict {
            status,
            reason: None,
            kkt_residual: residuals.largest(),
            equality_residual: equality,
            iterations,
            active_bounds,
            reserve_share: if carried > 0.0 { own.lp_norm(1) / carried } else { 0.0 },
            shortfall: Vec::new(),
            saturated: named(&self.names.muscles, &saturated),
        };
        Sharing {
            x: problem.reactions(&f),
            objective: problem.objective(&f, &own),
            f,
            s: own,
            missing,
            multipliers,
            residuals,
            verdict,
            blocking: Vec::new(),
            unactuated,
            raised: None,
        }
    }

    /// The answer of a frame for which there is none.
    pub(super) fn failed(&self, problem: &SharingProblem, reason: String, iterations: u32) -> Sharing {
        let nan = |n: usize| DVector::from_element(n, f64::NAN);
        let (nm, nx, nc) = (problem.n_muscles(), problem.n_reactions(), problem.n_coordinates());
        Sharing {
            f: nan(nm),
            x: nan(nx),
            s: nan(nc),
            missing: nan(nc),
            objective: f64::NAN,
            multipliers: Multipliers { moments: nan(nc), reactions: nan(nx) },
            residuals: Residuals {
                stationarity: f64::NAN,
                primal: f64::NAN,
                dual: f64::NAN,
                complementarity: f64::NAN,
                equality: f64::NAN,
            },
            verdict: Verdict {
                status: Status::Failed,
                reason: Some(reason),
                kkt_residual: f64::NAN,
                equality_residual: f64::NAN,
                iterations,
                active_bounds: 0,
                reserve_share: 0.0,
                shortfall: Vec::<Shortfall>::new(),
                saturated: Vec::new(),
            },
            blocking: Vec::new(),
            unactuated: super::scaled::unactuated(problem),
            raised: None,
        }
    }
}

impl Point {
    fn new(problem: &SharingProblem, canonical: &Canonical, optimum: Optimum, iterations: u32) -> Point {
        let mut f = optimum.z.component_mul(&canonical.variable_scale);
        // Scaling back must not leave a tension one round-off outside its bound.
        for i in 0..f.len() {
            match optimum.set.variables[i] {
                active_set::Bound::Lower => f[i] = problem.lower_f[i],
                active_set::Bound::Upper => f[i] = problem.upper_f[i],
                active_set::Bound::Free => {}
            }
        }
        let y = optimum.y.component_mul(&canonical.multiplier_scale);
        let ne = canonical.n_equalities;
        let moments = y.rows(0, ne).into_owned();
        let mut reactions = DVector::zeros(problem.n_reactions());
        for (k, &x) in canonical.bounded.iter().enumerate() {
            reactions[x] = y[ne + k];
        }
        let s = DVector::from_fn(ne, |k, _| moments[k] / problem.reserve_weight(k));
        let multipliers = Multipliers { moments, reactions };
        let residuals = residuals(problem, &f, &s, &multipliers);
        Point { f, s, multipliers, residuals, iterations: iterations + optimum.steps, set: optimum.set }
    }

    /// All conditions hold; bounds of x that may be violated are not asked.
    fn is_optimal(&self, soft_x: Option<f64>) -> bool {
        let r = &self.residuals;
        if soft_x.is_some() {
            return r.stationarity.max(r.equality) < KKT_TOLERANCE;
        }
        r.largest() < KKT_TOLERANCE
    }
}

/// Frames that share one kept solver; fixed, so that iteration counts do not depend on threads either.
const CHUNK: usize = 32;

/// Solves frames 0..n_frames in parallel; `problem` builds a frame. The same bits on any number of threads.
pub fn share_frames<E: From<SharingError> + Send>(
    n_frames: usize,
    names: &Names,
    options: SharingOptions,
    problem: impl Fn(usize) -> Result<SharingProblem, E> + Sync,
) -> Result<Vec<Sharing>, E> {
    let frames: Vec<usize> = (0..n_frames).collect();
    let chunks: Vec<Result<Vec<Sharing>, E>> = frames
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut solver = SharingSolver::new(names.clone(), options);
            chunk.iter().map(|frame| Ok(solver.solve(&problem(*frame)?)?)).collect()
        })
        .collect();
    let mut all = Vec::with_capacity(n_frames);
    for chunk in chunks {
        all.extend(chunk?);
    }
    Ok(all)
}
