//! Dynamic relaxation: an equilibrium as the rest of a damped motion.
//!
//! Central differences with unit steps, masses M = ¼ λ D of [`masses`](super::masses), so that the fastest mode is just stable, and damping 2ω of the
//! slowest mode that still moves. Its frequency is the quotient of the last step, ω² = Δx·Δg / Δx·MΔx: as fast modes die the quotient falls to
//! that of slower ones, and the damping with it. Near the end the error shrinks by 1 − 2 √(ω²/4) a step, as that of conjugate gradients does.
//! Underwood, in: Computational Methods for Transient Analysis (1983), 245-265; Papadrakakis, Comput Methods Appl Mech Eng 25 (1981) 35-48;
//! Oakley & Knight, Comput Methods Appl Mech Eng 126 (1995) 67-89 (with the diagonal of the stiffness in the quotient, here with the true change of the
//! gradient, which costs nothing more).

use super::masses::{Block, Bound, Masses, dot, dot_difference};
use crate::solve::{Advance, Iteration, Loading, NotConverged, Reason, Settings, SolveError};
use std::time::Instant;

/// Steps from one look at det F to the next, from where a motion that inverts an element starts anew.
const CHECK: usize = 20;
/// Steps from one look at the masses and the forces in play to the next, each worth some twenty steps.
const RENEW: usize = 500;
/// Wanted residual relative to the forces in play where the load is only on its way.
const ON_THE_WAY: f64 = 5e-2;
/// ω² of a step beyond which it is near the end of the stable ones, 4: masses are too small here.
const STABLE: f64 = 3.9;
/// Round-off of the gradient, as a fraction of the wanted residual, up to which a residual is looked for that is small enough beside it.
const ROOM: f64 = 0.5;
/// Motions in a row that end in inverted elements before it is given up.
const MAX_RETRIES: usize = 20;
/// Damping at most: what it would be for a mode as fast as the step can bear, less a little, so that motion does not end.
const MOST_DAMPING: f64 = 1.9;
/// Fraction of det F that the way of the load may leave of it.
const DET_F_FRACTION: f64 = 0.3;
/// Shortest piece of the way of the load beside the longest.
const LEAST_PIECE: f64 = 1.0 / 64.0;

/// Dynamic relaxation of one island.
#[derive(Debug)]
pub struct Relaxation {
    name: String,
    settings: Settings,
}

/// One call of `advance`.
struct Run<'a> {
    name: &'a str,
    settings: Settings,
    step: usize,
    fixed: Vec<bool>,
    bound: Bound,
    log: &'a mut Vec<Iteration>,
    report: Advance,
}

impl Relaxation {
    /// `name`: of the island, for messages.
    pub fn new(name: &str, settings: Settings) -> Relaxation {
        Relaxation { name: name.to_string(), settings }
    }

    /// Carries `x`, near rest at load 0, to rest at load 1. As that of [`Solver`](crate::solve::Solver): after an error `x` is where the load
    /// that the error names came to rest.
    pub fn advance(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        step: usize,
        log: &mut Vec<Iteration>,
    ) -> Result<Advance, SolveError> {
        let start = Instant::now();
        self.settings.begin(potential, x, &self.name, step)?;
        let mut run = Run {
            name: &self.name,
            settings: self.settings,
            step,
            fixed: potential.fixed().to_vec(),
            bound: Bound::default(),
            log,
            report: Advance::default(),
        };
        let (settled, mut t) = (x.to_vec(), 0.0);
        let wanted = self.settings.tolerance;
        while t < 1.0 {
            let before = t;
            t = carry(potential, x, t);
            let is_stuck = t == before;
            let outcome = match is_stuck {
                true => Err(run.failure(potential, x, Reason::Inversion, 0)),
                false => run.settle(potential, x, t, if t < 1.0 { wanted.max(ON_THE_WAY) } else { wanted }),
            };
            if let Err(failure) = outcome {
                x.copy_from_slice(&settled);
                potential.set_load(0.0, x);
                return Err(SolveError::NotConverged(failure));
            }
            run.report.load_steps += 1;
            run.report.loose_steps += usize::from(t < 1.0);
        }
        let mut report = run.report;
        report.contact_s = potential.contact_seconds();
        report.total_s = start.elapsed().as_secs_f64();
        report.assembly_s = report.total_s;
        Ok(report)
    }
}

impl Run<'_> {
    /// Moves `x` to rest at the load `t`, to a residual of `tolerance` relative to the forces in play.
    fn settle(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        t: f64,
        tolerance: f64,
    ) -> Result<(), Box<NotConverged>> {
        let n = x.len();
        let (mut g, mut old, mut v) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut start = Instant::now();
        potential.renew(x);
        let mut masses = self.masses(potential, x, 1.0);
        self.gradient(potential, x, &mut g);
        let mut good = x.to_vec();
        let (mut retries, mut lighter) = (0, 1.0);
        // 0: at rest, so that the first step is half of one.
        let (mut damping, mut motion, mut wanted) = (0.0, 0.0, f64::INFINITY);
        for k in 0.. {
            if self.report.iterations >= self.settings.max_steps {
                break;
            }
            let residual = dot(&g, &g).sqrt();
            let looks_settled = residual <= wanted;
            if looks_settled || k % CHECK == 0 || !residual.is_finite() {
                let (det_f, _) = potential.least_det_f(x);
                if !(det_f > 0.0 && residual.is_finite()) {
                    retries += 1;
                    self.report.retries += 1;
                    if retries > MAX_RETRIES {
                        x.copy_from_slice(&good);
                        return Err(self.failure(potential, x, Reason::Inversion, k));
                    }
                    x.copy_from_slice(&good);
                    v.fill(0.0);
                    (damping, motion) = (0.0, 0.0);
                    lighter *= 2.0;
                    masses = self.masses(potential, x, lighter);
                    self.gradient(potential, x, &mut g);
                    continue;
                }
                good.copy_from_slice(x);
            }
            if looks_settled || k % RENEW == 0 {
                let scale = potential.force_scale(x);
                wanted = tolerance * scale.max(self.settings.least_force);
                let report = &mut self.report;
                (report.residual, report.force_scale, report.wanted) = (residual, scale, wanted);
                report.energy = potential.energy(x);
                report.least_det_f = potential.least_det_f(x).0;
                self.record(t, k, damping, start);
                start = Instant::now();
                // A residual that is known less exactly than that may be small by chance.
                let round_off = self.bound.round_off(x);
                if residual + round_off <= wanted {
                    return Ok(());
                }
                if residual <= wanted && round_off > ROOM * wanted {
                    let reachable = tolerance * (round_off / wanted).max(1.0) / ROOM;
                    let reason = Reason::RoundOff { floor: round_off, reachable, far: None };
                    return Err(self.failure(potential, x, reason, k));
                }
                if k > 0 && k % RENEW == 0 {
                    (retries, lighter) = (0, 1.0);
                    masses = self.masses(potential, x, lighter);
                }
            }
            let (keep, push) = match motion == 0.0 {
                true => (0.0, 0.5),
                false => ((2.0 - damping) / (2.0 + damping), 2.0 / (2.0 + damping)),
            };
            motion = masses.step(x, &mut v, &g, keep, push);
            std::mem::swap(&mut g, &mut old);
            potential.renew(x);
            self.gradient(potential, x, &mut g);
            self.report.iterations += 1;
            let quotient = if motion > 0.0 { dot_difference(&v, &g, &old) / motion } else { 0.0 };
            damping = (2.0 * quotient.max(0.0).sqrt()).min(MOST_DAMPING);
            if quotient > STABLE {
                masses = self.masses(potential, x, lighter);
                v.fill(0.0);
                motion = 0.0;
            }
        }
        let reason = Reason::NotSettled { steps: self.settings.max_steps };
        Err(self.failure(potential, x, reason, self.settings.max_steps))
    }

    /// Masses for unit steps, `factor` times what the bound on the stiffness at `x` asks for.
    fn masses(&mut self, potential: &dyn Loading, x: &[f64], factor: f64) -> Masses {
        self.bound.renew(potential, x);
        let least: Vec<Block> = self.bound.times(0.25 * factor);
        Masses::new(&[], &least)
    }

    /// Gradient with zeros at prescribed unknowns.
    fn gradient(&self, potential: &dyn Loading, x: &[f64], g: &mut [f64]) {
        potential.gradient(x, g);
        g.iter_mut().zip(&self.fixed).filter(|(_, fixed)| **fixed).for_each(|(g, _)| *g = 0.0);
    }

    fn record(&mut self, load: f64, iteration: usize, damping: f64, start: Instant) {
        let report = &self.report;
        let row = Iteration {
            island: self.name.to_string(),
            step: self.step,
            load,
            iteration,
            residual: report.residual,
            force_scale: report.force_scale,
            energy: report.energy,
            step_length: damping,
            least_det_f: report.least_det_f,
            linear_iterations: 0,
            factorizations: 0,
            projected: false,
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
    ) -> Box<NotConverged> {
        let (det_f, place) = potential.least_det_f(x);
        let mut g = vec![0.0; x.len()];
        self.gradient(potential, x, &mut g);
        let scale = potential.force_scale(x).max(self.settings.least_force);
        Box::new(NotConverged {
            island: self.name.to_string(),
            step: self.step,
            load: 0.0,
            reason,
            iterations,
            residual: dot(&g, &g).sqrt(),
            wanted: self.settings.tolerance * scale,
            det_f,
            place,
        })
    }
}

/// Moves the load on from `t`, as far as nothing folds or touches, and the free nodes along with it; returns where it is.
fn carry(potential: &mut dyn Loading, x: &mut [f64], t: f64) -> f64 {
    let longest = 1.0 / potential.n_pieces(1.0).max(1) as f64;
    let (mut reached, mut length) = (t, longest);
    let mut trial = x.to_vec();
    let (before, _) = potential.least_det_f(x);
    while reached < 1.0 {
        let load = if reached + 1.5 * length > 1.0 { 1.0 } else { reached + length };
        let places = potential.touching(x);
        trial.copy_from_slice(x);
        potential.predict(load, &mut trial);
        let is_free = potential.collision_free_step(&places, &trial) >= 1.0;
        if is_free && potential.least_det_f(&trial).0 >= DET_F_FRACTION * before {
            x.copy_from_slice(&trial);
            reached = load;
            continue;
        }
        potential.set_load(reached, x);
        length /= 2.0;
        if reached > t || length < LEAST_PIECE * longest {
            break;
        }
    }
    reached
}
