//! Equilibrium along a load: Newton's method on the total potential, in as few and as large load steps as it bears.
//!
//! A load step from t₀ to t₁ first *carries the load over*: K Δx = −(g + ∂g/∂t (t₁ − t)) moves the free nodes along
//! with what is prescribed, by the largest share of the step that inverts nothing. Then Newton's method with a line
//! search on the energy finds the equilibrium at t₁. A load step that fails is tried again from the last equilibrium
//! with a quarter of its length. Nocedal & Wright, Numerical Optimization, 2nd ed., ch. 3 and 6; the test that takes over
//! where energy differences drown in round-off is the approximate Wolfe condition of Hager & Zhang, SIAM J. Optim. 16 (2005).

use super::linear::{LinearReport, LinearSolver, dot, norm};
use super::rigid::free_parts;
use super::{Analysis, BlockMatrix, FreePart, Indefinite, Iteration, Loading, Pattern};
use std::sync::Arc;
use std::time::Instant;
use thiserror::Error;

/// How the solver works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Wanted ‖g‖ relative to the forces in play ([`Potential::force_scale`](super::Potential::force_scale)).
    pub tolerance: f64,
    /// Newton iterations in one load step before it is tried shorter.
    pub max_iterations: usize,
    /// First load step; 1 is all at once.
    pub first_step: f64,
    /// Load steps shorter than this are not tried.
    pub least_step: f64,
    /// Factors of double precision from the start (single is tried first otherwise; the answer is double either way).
    pub double_precision_factor: bool,
    /// Test every equilibrium for stability (one factorization each) and leave unstable ones. Without it only those
    /// are tested on whose way an indefinite Hessian was met.
    pub check_stability: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            tolerance: 1e-6,
            max_iterations: 60,
            first_step: 1.0,
            least_step: 1e-4,
            double_precision_factor: false,
            check_stability: false,
        }
    }
}

/// How an island came to equilibrium under the full load.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Advance {
    /// Load steps taken, and tried in vain.
    pub load_steps: usize,
    /// Load steps that failed and were tried again shorter.
    pub retries: usize,
    /// Newton iterations, those of failed load steps included.
    pub iterations: usize,
    /// Conjugate gradient iterations.
    pub linear_iterations: usize,
    /// Factorizations.
    pub factorizations: usize,
    /// Residual ‖g‖ \[N\] at the end.
    pub residual: f64,
    /// Forces in play \[N\] at the end.
    pub force_scale: f64,
    /// Potential \[J\] at the end.
    pub energy: f64,
    /// Least det F at the end.
    pub least_det_f: f64,
    /// Load steps (their ends) on whose way the Hessian was indefinite: buckling or a limit point is near, or the
    /// start of the step was far from equilibrium.
    pub indefinite_at: Vec<f64>,
    /// Loads at which an equilibrium was found unstable (buckling, snap-through) and left for a stable one.
    pub unstable_at: Vec<f64>,
    /// Seconds in assembly (energy, gradient, Hessian).
    pub assembly_s: f64,
    /// Seconds in factorizations.
    pub factorization_s: f64,
    /// Seconds in conjugate gradients.
    pub linear_s: f64,
    /// Seconds in all.
    pub total_s: f64,
}

/// Why a load step went no further.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// Every direction of descent inverts an element.
    Inversion,
    /// The energy does not fall along the Newton direction.
    NoDescent,
    /// The iterations ran out.
    Iterations,
    /// The Hessian is singular: no force resists this unknown.
    Singular {
        /// Its node.
        node: String,
        /// x, y or z.
        direction: char,
    },
    /// Round-off of the positions alone makes forces greater than the residual that is wanted.
    RoundOff {
        /// These forces \[N\].
        floor: f64,
    },
    /// A gradient or energy that is not a number.
    NotFinite,
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Reason::Inversion => write!(f, "every step would invert an element"),
            Reason::NoDescent => write!(f, "the energy does not fall along the Newton direction"),
            Reason::Iterations => write!(f, "the iterations ran out"),
            Reason::Singular { node, direction } => {
                write!(f, "nothing resists {node} along {direction}; support it or give it stiffness")
            }
            Reason::RoundOff { floor } => write!(
                f,
                "round-off of the positions alone makes forces of {floor:.1e} N; the stiffest parts are too stiff \
                 beside the softest, or the tolerance is too small"
            ),
            Reason::NotFinite => write!(f, "forces are not finite numbers"),
        }
    }
}

/// Why there is no equilibrium to report. The positions left behind are the last good ones.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The start is no admissible state.
    #[error(
        "`{island}`, step {step}: the start is inadmissible, {place} has det F = {det_f:.2e}; mend the mesh there"
    )]
    Inadmissible {
        /// Name of the island.
        island: String,
        /// Step of the run.
        step: usize,
        /// The worst element.
        place: String,
        /// Its least det F.
        det_f: f64,
    },
    /// Parts of the mesh can move freely.
    #[error(
        "`{island}` is not supported, it moves without resistance: {}; prescribe nodes or tie it to something",
        parts.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    )]
    Unsupported {
        /// Name of the island.
        island: String,
        /// What can move, and how.
        parts: Vec<FreePart>,
    },
    /// The load could not be carried to its end.
    #[error("{0}")]
    NotConverged(Box<NotConverged>),
}

/// Where and why the load could be carried no farther.
#[derive(Clone, Debug, PartialEq)]
pub struct NotConverged {
    /// Name of the island.
    pub island: String,
    /// Step of the run.
    pub step: usize,
    /// Load of the last equilibrium; its positions are kept.
    pub load: f64,
    /// What stopped the last attempt to go farther.
    pub reason: Reason,
    /// Newton iterations of that attempt.
    pub iterations: usize,
    /// Residual \[N\] where it stopped.
    pub residual: f64,
    /// Residual \[N\] that was wanted there.
    pub wanted: f64,
    /// Least det F where it stopped.
    pub det_f: f64,
    /// The element that has it.
    pub place: String,
}

impl std::fmt::Display for NotConverged {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let NotConverged { island, step, load, reason, iterations, residual, wanted, det_f, place } = self;
        write!(
            f,
            "`{island}`, step {step}: not converged beyond load {load:.4}: {reason}; after {iterations} iterations the \
             residual was {residual:.2e} N, wanted {wanted:.1e} N; least det F = {det_f:.2e} in {place}"
        )
    }
}

/// Solver of one island; keeps what the next step can use: analysis, factor, memory.
#[derive(Debug)]
pub struct Solver {
    name: String,
    settings: Settings,
    pattern: Option<Arc<Pattern>>,
    linear: Option<LinearSolver>,
    k: Option<BlockMatrix>,
}

/// Shortest share of a Newton step or of a load step carried over that is tried.
const LEAST_STEP_LENGTH: f64 = 1e-6;
/// Share of the predicted decrease that a step must reach (Armijo).
const ARMIJO: f64 = 1e-4;
/// Energy differences below this share of the energy are taken for round-off.
const ENERGY_ROUND_OFF: f64 = 1e-11;
/// While the load is carried over, least det F may fall to this share in one go.
const DET_F_SHARE: f64 = 0.1;
/// Share of the projected Hessian tried first, and the least one.
const FIRST_BLEND: f64 = 0.25;
const LEAST_BLEND: f64 = 1.0 / 256.0;
/// Attempts to carry the load over within one load step.
const MAX_CARRIES: usize = 16;

impl Solver {
    /// `name`: of the island, for messages.
    pub fn new(name: &str, settings: Settings) -> Solver {
        Solver { name: name.to_string(), settings, pattern: None, linear: None, k: None }
    }

    /// Name of the island.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Carries `x`, near an equilibrium at load 0, to the equilibrium at load 1.
    ///
    /// `step`: the caller's count, for log and messages. Rows for the log are appended to `log`. After an error `x` is the
    /// equilibrium at the load that the error names, and the potential has that load.
    pub fn advance(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        step: usize,
        log: &mut Vec<Iteration>,
    ) -> Result<Advance, SolveError> {
        let start = Instant::now();
        potential.set_load(0.0, x);
        if !potential.energy(x).is_finite() {
            let (det_f, place) = potential.least_det_f(x);
            return Err(SolveError::Inadmissible { island: self.name.clone(), step, place, det_f });
        }
        let mut run = Run {
            name: self.name.clone(),
            settings: self.settings,
            step,
            log,
            report: Advance::default(),
            fixed: potential.fixed().to_vec(),
            definite: false,
            blend: FIRST_BLEND,
            met_indefinite: false,
        };
        self.prepare(potential, x, &mut run)?;
        let (linear, k) = (self.linear.as_mut().expect("prepared"), self.k.as_mut().expect("prepared"));
        let (mut t, mut length) = (0.0, self.settings.first_step);
        let mut good = x.to_vec();
        while t < 1.0 {
            let target = if t + length > 1.0 - 1e-9 { 1.0 } else { t + length };
            let before = run.report.iterations;
            match run.load_step(potential, x, t, target, linear, k) {
                Ok(()) => {
                    run.report.load_steps += 1;
                    t = target;
                    good.copy_from_slice(x);
                    if run.report.iterations - before <= 12 {
                        length *= 2.0;
                    }
                }
                Err(failure) => {
                    run.report.retries += 1;
                    x.copy_from_slice(&good);
                    potential.set_load(t, x);
                    linear.forget();
                    length = (target - t) / 4.0;
                    tracing::info!(island = %self.name, step, load = target, reason = %failure.reason, "load step fails, retry");
                    let hopeless = matches!(failure.reason, Reason::NotFinite);
                    if length < self.settings.least_step || hopeless {
                        return Err(SolveError::NotConverged(Box::new(NotConverged { load: t, ..*failure })));
                    }
                }
            }
        }
        run.report.total_s = start.elapsed().as_secs_f64();
        Ok(run.report)
    }

    /// Analyses a new pattern and refuses an island that can move freely.
    fn prepare(
        &mut self,
        potential: &mut dyn Loading,
        x: &[f64],
        run: &mut Run<'_>,
    ) -> Result<(), SolveError> {
        let pattern = potential.pattern();
        if self.pattern.as_ref().is_some_and(|p| Arc::ptr_eq(p, pattern)) {
            return Ok(());
        }
        self.pattern = Some(pattern.clone());
        let analysis = Arc::new(Analysis::new(pattern, x));
        let mut k = BlockMatrix::zeros(pattern.clone());
        potential.hessian(x, false, &mut k);
        let parts = free_parts(&k, &run.fixed, x);
        if !parts.is_empty() {
            self.pattern = None;
            return Err(SolveError::Unsupported { island: run.name.clone(), parts });
        }
        self.linear = Some(LinearSolver::new(analysis, self.settings.double_precision_factor));
        self.k = Some(k);
        Ok(())
    }
}

/// One call of `advance`.
struct Run<'a> {
    name: String,
    settings: Settings,
    step: usize,
    log: &'a mut Vec<Iteration>,
    report: Advance,
    /// Unknowns that are prescribed.
    fixed: Vec<bool>,
    /// The next Hessian is made definite without a try of the true one.
    definite: bool,
    /// Share of the projected Hessian that made the last indefinite one definite.
    blend: f64,
    /// An indefinite Hessian was met in this load step.
    met_indefinite: bool,
}

/// What one iteration adds to the log.
#[derive(Default)]
struct Taken {
    step_length: f64,
    linear: LinearReport,
    projected: bool,
}

impl Run<'_> {
    /// From the equilibrium at `t` to that at `target`.
    fn load_step(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        t: f64,
        target: f64,
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
    ) -> Result<(), Box<NotConverged>> {
        self.definite = false;
        self.blend = FIRST_BLEND;
        self.met_indefinite = false;
        self.carry_over(potential, x, t, target, linear, k)?;
        let mut kicks = 0;
        loop {
            self.newton(potential, x, target, linear, k)?;
            if self.met_indefinite && self.report.indefinite_at.last() != Some(&target) {
                self.report.indefinite_at.push(target);
            }
            let doubtful = self.met_indefinite || self.settings.check_stability;
            if !doubtful || kicks == 3 || self.is_stable(potential, x, linear, k) {
                return Ok(());
            }
            self.report.unstable_at.push(target);
            tracing::info!(island = %self.name, step = self.step, load = target, "equilibrium is unstable, leaving it");
            kicks += 1;
            self.leave(potential, x, linear, k, kicks);
        }
    }

    /// Moves the load to `target` and the free nodes along with it.
    fn carry_over(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        mut t: f64,
        target: f64,
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
    ) -> Result<(), Box<NotConverged>> {
        let n = x.len();
        let (mut g, mut ahead, mut moved) = (vec![0.0; n], vec![0.0; n], x.to_vec());
        let (mut dx, mut trial) = (vec![0.0; n], vec![0.0; n]);
        for iteration in 0..MAX_CARRIES {
            if t >= target {
                return Ok(());
            }
            let start = Instant::now();
            // ∂g/∂t by a difference over a millionth of the way: only a prediction hangs on it.
            let share = 1e-6;
            potential.gradient(x, &mut g);
            moved.copy_from_slice(x);
            potential.set_load(t + share * (target - t), &mut moved);
            potential.gradient(&moved, &mut ahead);
            if moved == x && ahead == g {
                potential.set_load(target, x); // nothing moves with the load: no step to predict
                return Ok(());
            }
            potential.set_load(t, x);
            let rhs: Vec<f64> = (0..n).map(|i| -g[i] - (ahead[i] - g[i]) / share).collect();
            self.report.assembly_s += start.elapsed().as_secs_f64();
            if rhs.iter().any(|r| !r.is_finite()) {
                return Err(self.failure(potential, x, Reason::NotFinite, iteration, &g));
            }
            let (report, projected) = self.direction(potential, x, rhs, 1e-3, linear, k, &mut dx)?;
            for i in 0..n {
                if self.is_fixed(i) {
                    dx[i] = (moved[i] - x[i]) / share;
                }
            }
            let (det_before, _) = potential.least_det_f(x);
            let mut length = 1.0;
            loop {
                let load = if length == 1.0 { target } else { t + length * (target - t) };
                for i in 0..n {
                    trial[i] = x[i] + length * dx[i];
                }
                potential.set_load(load, &mut trial);
                let admissible = potential.energy(&trial).is_finite()
                    && (det_before <= 0.0 || potential.least_det_f(&trial).0 >= DET_F_SHARE * det_before);
                if admissible {
                    x.copy_from_slice(&trial);
                    t = load;
                    break;
                }
                length /= 2.0;
                if length < 1.0 / 256.0 {
                    potential.set_load(t, x);
                    return Err(self.failure(potential, x, Reason::Inversion, iteration, &g));
                }
            }
            let taken = Taken { step_length: length, linear: report, projected };
            potential.gradient(x, &mut g);
            self.record(potential, x, t, 0, &g, &taken, start);
        }
        if t >= target {
            return Ok(());
        }
        Err(self.failure(potential, x, Reason::Inversion, MAX_CARRIES, &g))
    }

    /// Newton's method at a fixed load.
    fn newton(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        load: f64,
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
    ) -> Result<(), Box<NotConverged>> {
        let n = x.len();
        let (mut g, mut dx, mut trial) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut energy = potential.energy(x);
        self.gradient(potential, x, &mut g);
        let mut last = f64::INFINITY;
        for iteration in 1..=self.settings.max_iterations {
            let start = Instant::now();
            let residual = norm(&g);
            if !residual.is_finite() || !energy.is_finite() {
                return Err(self.failure(potential, x, Reason::NotFinite, iteration, &g));
            }
            let wanted = self.settings.tolerance * potential.force_scale(x);
            if residual <= wanted || residual <= round_off(k, x) {
                self.report.residual = residual;
                self.report.force_scale = potential.force_scale(x);
                self.report.energy = energy;
                self.report.least_det_f = potential.least_det_f(x).0;
                return Ok(());
            }
            // Exact enough for quadratic convergence, and no more exact than the last step needs.
            let forcing = (residual / last).powi(2).min(1e-3).max(0.1 * wanted / residual).min(0.1);
            last = residual;
            let rhs: Vec<f64> = g.iter().map(|g| -g).collect();
            let (report, projected) = self.direction(potential, x, rhs, forcing, linear, k, &mut dx)?;
            let assembly = Instant::now();
            let length = match self.line_search(
                potential,
                x,
                &g,
                &dx,
                energy_round_off(k, x),
                &mut energy,
                &mut trial,
            ) {
                Ok(length) => length,
                // Round-off, not the mechanics, ends the descent a little above the estimate.
                Err(_) if residual <= 100.0 * round_off(k, x) => return Ok(()),
                Err(_) if !projected => {
                    self.definite = true;
                    self.met_indefinite = true;
                    linear.forget();
                    continue;
                }
                Err(_) if round_off(k, x) > wanted => {
                    let reason = Reason::RoundOff { floor: round_off(k, x) };
                    return Err(self.failure(potential, x, reason, iteration, &g));
                }
                Err(reason) => return Err(self.failure(potential, x, reason, iteration, &g)),
            };
            x.copy_from_slice(&trial);
            self.gradient(potential, x, &mut g);
            self.report.assembly_s += assembly.elapsed().as_secs_f64();
            self.report.iterations += 1;
            let taken = Taken { step_length: length, linear: report, projected };
            self.record(potential, x, load, iteration, &g, &taken, start);
        }
        Err(self.failure(potential, x, Reason::Iterations, self.settings.max_iterations, &g))
    }

    /// Solves H Δx = rhs with the Hessian at `x`: as it is where it is positive definite; otherwise moved towards the
    /// projected one, no farther than needed (projection alone is so stiff that it creeps along valleys and away from
    /// saddles); at last with a multiple of its diagonal added. Returns whether H is not the true Hessian.
    fn direction(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        mut rhs: Vec<f64>,
        tolerance: f64,
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
        dx: &mut [f64],
    ) -> Result<(LinearReport, bool), Box<NotConverged>> {
        for i in 0..rhs.len() {
            if self.is_fixed(i) {
                rhs[i] = 0.0;
            }
        }
        let mut total = LinearReport::default();
        let start = Instant::now();
        potential.hessian(x, false, k);
        k.constrain(&self.fixed);
        self.report.assembly_s += start.elapsed().as_secs_f64();
        let (mut blend, mut shift) = (0.0_f64, 0.0);
        let mut projected = None;
        let mut definite = std::mem::take(&mut self.definite);
        loop {
            if definite && (projected.is_none() || blend < 1.0) {
                let next = if projected.is_none() { self.blend } else { (4.0 * blend).min(1.0) };
                let start = Instant::now();
                let projected = projected.get_or_insert_with(|| {
                    let mut p = BlockMatrix::zeros(k.pattern().clone());
                    potential.hessian(x, true, &mut p);
                    p.constrain(&self.fixed);
                    p
                });
                k.approach(projected, (next - blend) / (1.0 - blend));
                self.report.assembly_s += start.elapsed().as_secs_f64();
                blend = next;
            } else if definite {
                shift = if shift == 0.0 { 1e-8 } else { 100.0 * shift };
                k.shift(shift);
            }
            let start = Instant::now();
            let (report, outcome) = linear.solve(k, &rhs, dx, tolerance, blend == 1.0);
            self.report.linear_s += start.elapsed().as_secs_f64() - report.factorization_s;
            self.report.factorization_s += report.factorization_s;
            self.report.factorizations += report.factorizations;
            self.report.linear_iterations += report.iterations;
            total.iterations += report.iterations;
            total.factorizations += report.factorizations;
            total.relative_residual = report.relative_residual;
            match outcome {
                Ok(()) if dot(dx, &rhs) > 0.0 || norm(&rhs) == 0.0 => {
                    if definite {
                        self.blend = (blend / 4.0).max(LEAST_BLEND);
                    }
                    return Ok((total, definite));
                }
                _ if !definite => {
                    definite = true;
                    self.met_indefinite = true;
                }
                _ if shift < 1.0 => {}
                Ok(()) => return Err(self.failure(potential, x, Reason::NoDescent, 0, &rhs)),
                Err(Indefinite { unknown }) => {
                    let node = potential.node_name(unknown / 3);
                    let direction = ['x', 'y', 'z'][unknown % 3];
                    return Err(self.failure(potential, x, Reason::Singular { node, direction }, 0, &rhs));
                }
            }
            linear.forget();
        }
    }

    /// Finds the share of `dx` to take; leaves x + share · dx in `trial` and its energy in `energy`. `round_off` of the
    /// energy \[J\] where it is near zero.
    fn line_search(
        &self,
        potential: &dyn Loading,
        x: &[f64],
        g: &[f64],
        dx: &[f64],
        round_off: f64,
        energy: &mut f64,
        trial: &mut [f64],
    ) -> Result<f64, Reason> {
        let slope = dot(g, dx);
        if slope >= 0.0 || slope.is_nan() {
            return Err(Reason::NoDescent);
        }
        let mut length = 1.0;
        let mut inverted = false;
        let mut g_trial = Vec::new();
        while length >= LEAST_STEP_LENGTH {
            for i in 0..x.len() {
                trial[i] = x[i] + length * dx[i];
            }
            let e = potential.energy(trial);
            if !e.is_finite() {
                inverted = true;
                length /= 2.0;
                continue;
            }
            inverted = false;
            let change = e - *energy;
            if change <= ARMIJO * length * slope {
                *energy = e;
                return Ok(length);
            }
            if change.abs() <= round_off.max(ENERGY_ROUND_OFF * energy.abs().max(e.abs())) {
                g_trial.resize(x.len(), 0.0);
                self.gradient(potential, trial, &mut g_trial);
                if dot(&g_trial, dx) <= -0.8 * slope {
                    *energy = e;
                    return Ok(length);
                }
            }
            let parabola = -0.5 * slope * length * length / (change - slope * length);
            length = parabola.clamp(0.1 * length, 0.5 * length);
        }
        Err(if inverted { Reason::Inversion } else { Reason::NoDescent })
    }

    /// Whether the Hessian at `x` is positive definite.
    fn is_stable(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
    ) -> bool {
        potential.hessian(x, false, k);
        k.constrain(&self.fixed);
        self.report.factorizations += 1;
        linear.refactorize(k).is_ok()
    }

    /// Leaves an unstable equilibrium along its softest mode, found by inverse iteration with the shifted Hessian: by a
    /// thousandth of the extent of the island, less where that is inadmissible.
    fn leave(
        &mut self,
        potential: &dyn Loading,
        x: &mut [f64],
        linear: &mut LinearSolver,
        k: &mut BlockMatrix,
        kick: usize,
    ) {
        let n = x.len();
        let mut shift = 1e-8;
        loop {
            potential.hessian(x, false, k);
            k.constrain(&self.fixed);
            k.shift(shift);
            if linear.refactorize(k).is_ok() || shift > 10.0 {
                break;
            }
            shift *= 10.0;
        }
        // Any start that no symmetry of the mesh makes orthogonal to the mode.
        let mut mode: Vec<f64> =
            (0..n).map(|i| ((i * i + kick) as f64 * 0.754_877_666).fract() - 0.5).collect();
        for _ in 0..8 {
            for i in (0..n).filter(|&i| self.is_fixed(i)) {
                mode[i] = 0.0;
            }
            let rhs: Vec<f64> = (0..n).map(|i| mode[i] * k.diagonal(i)).collect();
            linear.apply(&rhs, &mut mode);
            let largest = mode.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            mode.iter_mut().for_each(|v| *v /= largest);
        }
        let extent = (0..3)
            .map(|c| {
                let along = || x.iter().skip(c).step_by(3);
                along().fold(f64::MIN, |m, v| m.max(*v)) - along().fold(f64::MAX, |m, v| m.min(*v))
            })
            .fold(0.0, f64::max);
        let mut size = 1e-3 * extent * kick as f64;
        let mut trial = vec![0.0; n];
        for _ in 0..20 {
            for i in 0..n {
                trial[i] = x[i] + size * mode[i];
            }
            if potential.energy(&trial).is_finite() {
                x.copy_from_slice(&trial);
                break;
            }
            size /= 2.0;
        }
        linear.forget();
        self.definite = true;
    }

    /// Gradient with zeros at prescribed unknowns.
    fn gradient(&self, potential: &dyn Loading, x: &[f64], g: &mut [f64]) {
        potential.gradient(x, g);
        for i in 0..self.fixed.len() {
            if self.fixed[i] {
                g[i] = 0.0;
            }
        }
    }

    fn is_fixed(&self, i: usize) -> bool {
        self.fixed.get(i) == Some(&true)
    }

    fn record(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        load: f64,
        iteration: usize,
        g: &[f64],
        taken: &Taken,
        start: Instant,
    ) {
        let row = Iteration {
            island: self.name.clone(),
            step: self.step,
            load,
            iteration,
            residual: norm(g),
            force_scale: potential.force_scale(x),
            energy: potential.energy(x),
            step_length: taken.step_length,
            least_det_f: potential.least_det_f(x).0,
            linear_iterations: taken.linear.iterations,
            factorizations: taken.linear.factorizations,
            projected: taken.projected,
            seconds: start.elapsed().as_secs_f64(),
        };
        row.trace();
        self.log.push(row);
    }

    fn failure(
        &self,
        potential: &dyn Loading,
        x: &[f64],
        reason: Reason,
        iterations: usize,
        g: &[f64],
    ) -> Box<NotConverged> {
        let (det_f, place) = potential.least_det_f(x);
        let wanted = self.settings.tolerance * potential.force_scale(x);
        Box::new(NotConverged {
            island: self.name.clone(),
            step: self.step,
            load: 0.0, // the caller knows
            reason,
            iterations,
            residual: norm(g),
            wanted,
            det_f,
            place,
        })
    }
}

/// Round-off of the energy \[J\] near a stress-free shape, where the terms of a law cancel: ε times stiffness times length
/// squared, as moduli times volume are; of the softest unknown, so that nothing stiff beside it hides its descent.
fn energy_round_off(k: &BlockMatrix, x: &[f64]) -> f64 {
    let farthest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let softest = (0..x.len()).map(|i| k.diagonal(i)).fold(f64::INFINITY, f64::min).max(0.0);
    2.0 * f64::EPSILON * farthest * farthest * softest * (x.len() as f64).sqrt()
}

/// Residual \[N\] that round-off of the positions alone makes: ε · |x| in every position times its stiffness.
fn round_off(k: &BlockMatrix, x: &[f64]) -> f64 {
    let farthest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let stiffness = (0..x.len()).map(|i| k.diagonal(i).powi(2)).sum::<f64>().sqrt();
    2.0 * f64::EPSILON * farthest * stiffness
}
