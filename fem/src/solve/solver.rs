//! The solver of one island: load steps as large as it bears, shorter where one fails.
//!
//! A load step that fails is tried again from the last equilibrium with a quarter of its length.

use super::convexity::Convexity;
use super::linear::LinearSolver;
use super::newton::{Run, extent};
use super::rigid::loose_components;
use super::{Advance, Analysis, BlockMatrix, Iteration, Loading, NotConverged, Pattern, Reason, SolveError};
use std::sync::Arc;
use std::time::Instant;

/// Growth of a body in a load step whose failure is put down to running away. Bars pulled to six times their length are the farthest known
/// equilibria.
const RUN_AWAY: f64 = 10.0;

/// Which equilibria are tested for stability.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stability {
    /// All.
    Always,
    /// Those on whose way an indefinite Hessian was met.
    #[default]
    WhereDoubtful,
    /// None: Newton's method descends, and a wrinkle of a slack muscle more or less is not asked for.
    Never,
}

/// How a load step in guarded contact gets from one equilibrium to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Way {
    /// Softened contact says where to go, collision detection goes there.
    #[default]
    Guided,
    /// Collision detection alone: for comparison, several times slower.
    Strict,
}

/// Which solver finds the equilibria.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Newton's method with sparse factors.
    #[default]
    Newton,
    /// Dynamic relaxation, without matrices.
    Relaxation,
    /// Central differences in time, without matrices: motion of what has inertia.
    Explicit,
}

/// How the solver works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Which solver.
    pub method: Method,
    /// Wanted ‖g‖ relative to the forces in play ([`Potential::force_scale`](super::Potential::force_scale)), above 0 and below 1.
    /// Nothing looser is ever called solved.
    pub tolerance: f64,
    /// Forces in play \[N\] are taken to be at least this, so that a slack body is not solved to forces that nobody asks for.
    pub least_force: f64,
    /// Newton iterations in one load step before it is tried shorter, at least 1.
    pub max_iterations: usize,
    /// Linear systems that a frame may solve per island, at least 1. Ten times what the hardest frames known take (slack straps: 441), so
    /// that a run that only creeps ends.
    pub max_work: usize,
    /// Time steps that a frame may take per island where there are no matrices, at least 1.
    pub max_steps: usize,
    /// Explicit dynamics: time step over the longest that the masses bear, at least 1; above 1 masses are added where it takes them.
    pub time_step_factor: f64,
    /// Explicit dynamics: rate at which velocities fade \[1/s\], 0 or positive.
    pub damping: f64,
    /// First load step, above 0; 1 is all at once.
    pub first_step: f64,
    /// Load steps shorter than this are not tried; above 0.
    pub least_step: f64,
    /// Factors of double precision from the start (single is tried first otherwise; the answer is double either way).
    pub double_precision_factor: bool,
    /// Which equilibria are tested for stability (a factorization each); unstable ones are left along their softest mode.
    pub stability: Stability,
    /// How load steps go where surfaces may touch.
    pub way: Way,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            method: Method::default(),
            tolerance: 1e-6,
            least_force: 0.0,
            max_iterations: 60,
            max_work: 5000,
            max_steps: 100_000,
            time_step_factor: 1.0,
            damping: 0.0,
            first_step: 1.0,
            least_step: 1e-4,
            double_precision_factor: false,
            stability: Stability::default(),
            way: Way::default(),
        }
    }
}

/// Whether a body grew so much from `good` to `x` \[m\] that its load step did not fail for anything else.
fn runs_away(good: &[f64], x: &[f64]) -> Option<Reason> {
    let (before, after) = (extent(good), extent(x));
    (before > 0.0 && after > RUN_AWAY * before).then_some(Reason::RunsAway { before, after })
}

impl Settings {
    /// Everything that cannot be, with what it must be.
    pub fn mistakes(&self) -> Vec<String> {
        let Settings {
            tolerance,
            least_force,
            max_iterations,
            max_work,
            max_steps,
            time_step_factor,
            damping,
            first_step,
            least_step,
            ..
        } = self;
        let number = |value: &f64| format!("{value:e}");
        [
            ("tolerance", number(tolerance), *tolerance > 0.0 && *tolerance < 1.0, "above 0 and below 1"),
            (
                "least_force [N]",
                number(least_force),
                *least_force >= 0.0 && least_force.is_finite(),
                "0 or a positive number",
            ),
            ("max_iterations", max_iterations.to_string(), *max_iterations > 0, "at least 1"),
            ("max_work", max_work.to_string(), *max_work > 0, "at least 1"),
            ("max_steps", max_steps.to_string(), *max_steps > 0, "at least 1"),
            (
                "time_step_factor",
                number(time_step_factor),
                *time_step_factor >= 1.0 && time_step_factor.is_finite(),
                "at least 1",
            ),
            (
                "damping [1/s]",
                number(damping),
                *damping >= 0.0 && damping.is_finite(),
                "0 or a positive number",
            ),
            (
                "first_step",
                number(first_step),
                *first_step > 0.0 && *first_step <= 1.0,
                "above 0 and at most 1",
            ),
            (
                "least_step",
                number(least_step),
                *least_step > 0.0 && *least_step <= 1.0,
                "above 0 and at most 1",
            ),
        ]
        .into_iter()
        .filter(|(_, _, good, _)| !good)
        .map(|(name, value, _, must)| format!("{name} is {value}, must be {must}"))
        .collect()
    }

    /// Refuses settings that cannot be.
    pub fn check(&self) -> Result<(), SolveError> {
        match self.mistakes() {
            mistakes if mistakes.is_empty() => Ok(()),
            mistakes => Err(SolveError::Settings { mistakes }),
        }
    }

    /// Puts a potential at the start of a load, as every solver does first. Settings that cannot be and a start that is not admissible are errors,
    /// in the name of the island and the step.
    pub(crate) fn begin(
        &self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        island: &str,
        step: usize,
    ) -> Result<(), SolveError> {
        self.check()?;
        potential.set_load(0.0, x);
        if potential.energy(x).is_finite() {
            return Ok(());
        }
        let (det_f, place) = potential.least_det_f(x);
        Err(SolveError::Inadmissible { island: island.to_string(), step, place, det_f })
    }
}

/// Solver of one island; keeps what the next step can use.
#[derive(Debug)]
pub struct Solver {
    name: String,
    settings: Settings,
    kept: Option<Kept>,
}

/// What one pattern needs.
#[derive(Debug)]
struct Kept {
    pattern: Arc<Pattern>,
    /// The analysis, and the factor as long as it helps.
    linear: LinearSolver,
    /// Room for the Hessian.
    k: BlockMatrix,
    /// Nothing can move freely; parts that only contact may hold can.
    supported: bool,
}

impl Solver {
    /// `name`: of the island, for messages.
    pub fn new(name: &str, settings: Settings) -> Solver {
        Solver { name: name.to_string(), settings, kept: None }
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
        self.settings.begin(potential, x, &self.name, step)?;
        let settings = self.settings;
        let mut run = self.run(potential, x, step, log)?;
        let (mut t, mut length) = (0.0, settings.first_step);
        let mut good = x.to_vec();
        // The last equilibrium to the tolerance; where a load step was cut short the way goes on from a looser one.
        let (mut settled, mut settled_at) = (x.to_vec(), 0.0);
        while t < 1.0 {
            let target = if t + length > 1.0 - 1e-9 { 1.0 } else { t + length };
            let before = run.report.iterations;
            match run.load_step(potential, x, t, target) {
                Ok(reached) => {
                    run.report.load_steps += 1;
                    t = reached;
                    good.copy_from_slice(x);
                    if reached == target {
                        settled.copy_from_slice(x);
                        settled_at = t;
                    }
                    // Where contact cut the step short its length was no fault of Newton's method.
                    // The strict way is asked for in parts of this length.
                    let may_grow = settings.way == Way::Guided;
                    if may_grow && reached == target && run.report.iterations - before <= 12 {
                        length *= 2.0;
                    }
                }
                Err(mut failure) => {
                    run.report.retries += 1;
                    potential.forget_guess();
                    if let Some(reason) = runs_away(&good, x) {
                        failure.reason = reason;
                    }
                    x.copy_from_slice(&good);
                    potential.set_load(t, x);
                    run.linear.forget();
                    length = (target - t) / 4.0;
                    tracing::info!(island = %run.name, step, load = target, reason = %failure.reason, "load step fails, retry");
                    let hopeless = matches!(failure.reason, Reason::NotFinite | Reason::Work { .. });
                    if length < settings.least_step || hopeless {
                        x.copy_from_slice(&settled);
                        potential.set_load(settled_at, x);
                        let stop = NotConverged { load: settled_at, ..*failure };
                        return Err(SolveError::NotConverged(Box::new(stop)));
                    }
                }
            }
        }
        run.report.contact_s = potential.contact_seconds();
        run.report.total_s = start.elapsed().as_secs_f64();
        Ok(run.report)
    }

    /// Takes `x` as near to equilibrium under the whole load as Newton's method comes, whether that is a state or not; returns the iterations.
    pub(crate) fn settle(&mut self, potential: &mut dyn Loading, x: &mut [f64]) -> Result<usize, SolveError> {
        potential.set_load(1.0, x);
        let mut log = Vec::new();
        let mut run = self.run(potential, x, 0, &mut log)?;
        run.convexity = Convexity::full();
        // Where it came to is all that is asked for.
        let _ = run.newton(potential, x, 1.0);
        Ok(run.report.iterations)
    }

    /// What a call needs, with what is kept of the ones before.
    fn run<'a>(
        &'a mut self,
        potential: &dyn Loading,
        x: &[f64],
        step: usize,
        log: &'a mut Vec<Iteration>,
    ) -> Result<Run<'a>, SolveError> {
        let (name, settings) = (self.name.clone(), self.settings);
        let Kept { linear, k, supported, .. } = self.prepare(potential, x)?;
        Ok(Run {
            name,
            settings,
            step,
            tolerance: settings.tolerance,
            log,
            report: Advance::default(),
            linear,
            k,
            supported: *supported,
            fixed: potential.fixed().to_vec(),
            convexity: Convexity::none(),
            met_indefinite: false,
            may_approach: false,
        })
    }

    /// Analyses a new pattern and refuses an island that can move freely, where nothing can touch that might hold it and it has no inertia.
    fn prepare(&mut self, potential: &dyn Loading, x: &[f64]) -> Result<&mut Kept, SolveError> {
        let pattern = potential.pattern();
        if !self.kept.as_ref().is_some_and(|kept| Arc::ptr_eq(&kept.pattern, pattern)) {
            let analysis = Arc::new(Analysis::new(pattern, x));
            let mut k = BlockMatrix::zeros(pattern.clone());
            potential.hessian(x, 0.0, &mut k);
            let parts = loose_components(&k, potential.fixed(), &potential.followers(), x);
            if !parts.is_empty() && potential.touching(x).is_empty() && !potential.holds_free_bodies() {
                self.kept = None;
                return Err(SolveError::Unsupported { island: self.name.clone(), parts });
            }
            let linear = LinearSolver::new(analysis, x, self.settings.double_precision_factor);
            let supported = parts.is_empty();
            self.kept = Some(Kept { pattern: pattern.clone(), linear, k, supported });
        }
        Ok(self.kept.as_mut().expect("kept for this pattern"))
    }
}
