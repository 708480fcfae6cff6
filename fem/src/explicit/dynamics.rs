//! Motion in time by central differences: what is truly dynamic, and what is slow enough to be taken for rest.
//!
//! v ← v − ½ h M⁻¹ g(x),  x ← x + h v,  v ← v − ½ h M⁻¹ g(x): second order, momentum to round-off, stable for h ω ≤ 2. Masses are lumped; with a
//! longer step than the material bears, nodes weigh more where and along what they must ([`masses`](super::masses)): a tendon, and not the
//! muscle behind it.
//! Belytschko, Liu, Moran & Elkhodary, Nonlinear Finite Elements for Continua and Structures, 2nd ed., §6.2.

use super::masses::{Bound, MARGIN, Masses, dot, dot_difference, largest};
use crate::solve::{Advance, Iteration, Loading, Motion, NotConverged, Reason, Settings, SolveError};
use std::time::Instant;

/// Steps from one look at the stiffness to the next.
const RENEW: usize = 500;
/// The same where mass is added: many nodes weigh just what the step asks of them, and what gets stiffer, as a muscle that is activated, is unstable at
/// once. With no [`ROOM`] three muscles of the thigh blow up within 80 steps at 10 times the step where it is looked after 500, and do not after 25; a look
/// costs some ten steps.
const RENEW_ADDED: usize = 25;
/// Factor on added mass above what is just stable, 1/0.67²: steps of two thirds of the longest, as is usual where much happens (LS-DYNA Keyword User's
/// Manual, TSSFAC). Without it a bar of tissue that is drawn by a fifth blows up at 10 times its step, however often it is looked at.
const ROOM: f64 = 2.2;
/// Steps from one look at the kinetic energy to the next.
const SAMPLE: usize = 5;
/// Quotient h²ω² of a step beyond which it is near the end of the stable ones, 4.
const STABLE: f64 = 3.9;
/// Fraction of the way to a collision that a shortened step goes.
const SHORT_OF: f64 = 0.9;
/// Steps shorter than this fraction of the frame are not tried.
const LEAST_STEP: f64 = 1e-9;
/// Energy that may be missing or too much at the end of a frame, relative to the energies in play.
pub const IMBALANCE: f64 = 0.01;

/// What belongs to the motion of an island: its masses and how fast it is.
#[derive(Clone, Debug)]
pub struct Moving {
    /// Mass of each unknown \[kg\]; 0 where it is prescribed.
    pub masses: Vec<f64>,
    /// Velocity of each unknown \[m/s\].
    pub v: Vec<f64>,
    /// Time that passes while the load goes from 0 to 1 \[s\].
    pub duration: f64,
}

/// Explicit dynamics of one island.
#[derive(Debug)]
pub struct Dynamics {
    name: String,
    settings: Settings,
}

impl Dynamics {
    /// `name`: of the island, for messages.
    pub fn new(name: &str, settings: Settings) -> Dynamics {
        Dynamics { name: name.to_string(), settings }
    }

    /// Moves `x` and `moving.v` while the load goes from 0 to 1. After an error `x` is where it began.
    pub fn advance(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        moving: &mut Moving,
        step: usize,
        log: &mut Vec<Iteration>,
    ) -> Result<Advance, SolveError> {
        let clock = Instant::now();
        let start = x.to_vec();
        self.settings.begin(potential, x, &self.name, step)?;
        let mut report = Advance { load_steps: 1, ..Advance::default() };
        match self.go(potential, x, moving, &mut report) {
            Ok(motion) => {
                if let Some(warning) = motion.warning() {
                    tracing::warn!(island = %self.name, step, "{warning}");
                }
                report.iterations = motion.steps;
                report.motion = Some(motion);
                report.energy = potential.energy(x);
                report.least_det_f = potential.least_det_f(x).0;
                report.contact_s = potential.contact_seconds();
                report.total_s = clock.elapsed().as_secs_f64();
                report.assembly_s = report.total_s;
                let row = Iteration {
                    island: self.name.clone(),
                    step,
                    load: 1.0,
                    iteration: motion.steps,
                    energy: report.energy,
                    least_det_f: report.least_det_f,
                    seconds: report.total_s,
                    ..Iteration::default()
                };
                row.trace();
                log.push(row);
                Ok(report)
            }
            Err((reason, iterations)) => {
                let (det_f, place) = potential.least_det_f(x);
                x.copy_from_slice(&start);
                potential.set_load(0.0, x);
                let island = self.name.clone();
                let stop = NotConverged {
                    island,
                    step,
                    load: 0.0,
                    reason,
                    iterations,
                    residual: 0.0,
                    wanted: 0.0,
                    det_f,
                    place,
                };
                Err(SolveError::NotConverged(Box::new(stop)))
            }
        }
    }

    fn go(
        &self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        moving: &mut Moving,
        report: &mut Advance,
    ) -> Result<Motion, (Reason, usize)> {
        let n = x.len();
        let fixed = potential.fixed().to_vec();
        let is_fixed = |i: usize| fixed.get(i) == Some(&true);
        let Moving { masses: given, v, duration } = moving;
        v.iter_mut().enumerate().filter(|(i, _)| is_fixed(*i)).for_each(|(_, v)| *v = 0.0);
        if let Some(i) = (0..n).find(|&i| !is_fixed(i) && !(given[i] > 0.0)) {
            return Err((Reason::NoMass { node: potential.node_name(i / 3) }, 0));
        }
        let (duration, alpha) = (*duration, self.settings.damping);
        let mut motion =
            Motion { time_step: f64::INFINITY, mass: given.iter().sum::<f64>() / 3.0, ..Motion::default() };
        let mut scale = Scale::default();
        let factor = self.settings.time_step_factor;
        let after = if factor > 1.0 { RENEW_ADDED } else { RENEW };
        let (mut h, mut masses) = scale.renew(potential, x, given, factor).map_err(|reason| (reason, 0))?;
        motion.natural_step = scale.natural;
        motion.added_mass = masses.added;
        let (mut g, mut old) = (vec![0.0; n], vec![0.0; n]);
        let (mut before, mut dx) = (vec![0.0; n], vec![0.0; n]);
        potential.renew(x);
        potential.gradient(x, &mut g);
        motion.kinetic_before = 0.5 * masses.square(v);
        motion.largest_kinetic = motion.kinetic_before;
        let mut energy = potential.energy(x);
        let (first, drives) = (energy, is_driven(potential, x, &g));
        // a − α v at a step, whose square h²/8 times over is what central differences keep less than ½ v·Mv.
        let lag = |masses: &Masses, g: &[f64], v: &[f64], h: f64| {
            let square = masses.inverse_square(g) + alpha * (2.0 * dot(g, v) + alpha * masses.square(v));
            0.125 * h * h * square
        };
        let (mut time, mut renewed) = (0.0, 0);
        while time < duration {
            if motion.steps >= self.settings.max_steps {
                return Err((Reason::NotSettled { steps: motion.steps }, motion.steps));
            }
            if motion.steps - renewed >= after {
                renewed = motion.steps;
                (h, masses) = scale.renew_moving(potential, x, given, factor, v, &masses, &mut motion)?;
            }
            // Equal steps to the end.
            let left = duration - time;
            let mut length = left / (left / h * (1.0 - 1e-12)).ceil().max(1.0);
            before.copy_from_slice(x);
            let places = potential.touching(x);
            let kick = |v: &mut [f64], g: &[f64], length: f64| {
                let mut a = g.to_vec();
                masses.answer_in_place(&mut a);
                v.iter_mut().zip(&a).for_each(|(v, a)| *v -= 0.5 * length * (a + alpha * *v));
            };
            let start = v.clone();
            let damped = masses.square(v);
            loop {
                kick(v, &g, length);
                for i in 0..n {
                    x[i] = before[i] + length * v[i];
                }
                let reached = if length >= left { 1.0 } else { (time + length) / duration };
                potential.set_load(reached, x);
                let free = if places.is_empty() { 1.0 } else { potential.collision_free_step(&places, x) };
                if free >= 1.0 {
                    break;
                }
                report.retries += 1;
                v.copy_from_slice(&start);
                x.copy_from_slice(&before);
                potential.set_load(time / duration, x);
                length *= (SHORT_OF * free).max(1e-3);
                if length < LEAST_STEP * duration {
                    return Err((Reason::Touch, motion.steps));
                }
            }
            let since = time;
            time = if length >= left { duration } else { time + length };
            motion.steps += 1;
            if time < duration {
                motion.time_step = motion.time_step.min(length);
            }
            for i in 0..n {
                dx[i] = if is_fixed(i) { 0.0 } else { x[i] - before[i] };
            }
            std::mem::swap(&mut g, &mut old);
            potential.renew(x);
            potential.gradient(x, &mut g);
            // The second half: v = v½ − ½ h (M⁻¹ g + α v).
            let mut a = g.clone();
            masses.answer_in_place(&mut a);
            v.iter_mut()
                .zip(&a)
                .for_each(|(v, a)| *v = (*v - 0.5 * length * a) / (1.0 + 0.5 * length * alpha));
            motion.dissipated += 0.5 * length * alpha * (damped + masses.square(v));
            motion.lag += lag(&masses, &g, v, length) - lag(&masses, &old, &start, length);
            let square = masses.square(&dx);
            let quotient =
                if square > 0.0 { length * length * dot_difference(&dx, &g, &old) / square } else { 0.0 };
            if !quotient.is_finite() {
                return Err((Reason::Inversion, motion.steps));
            }
            if quotient > STABLE {
                renewed = motion.steps;
                scale.vector.copy_from_slice(&dx);
                (h, masses) = scale.renew_moving(potential, x, given, factor, v, &masses, &mut motion)?;
            }
            if drives {
                // The work that belongs to central differences: what the potential gains by the load alone, mean of before and after.
                let at = |potential: &mut dyn Loading, x: &[f64], time: f64| {
                    let mut x = x.to_vec();
                    potential.set_load(if time >= duration { 1.0 } else { time / duration }, &mut x);
                    potential.energy(&x)
                };
                let ahead = at(potential, &before, time);
                let behind = at(potential, x, since);
                let now = at(potential, x, time);
                motion.work += 0.5 * (ahead - energy + now - behind);
                energy = now;
            }
            if motion.steps.is_multiple_of(SAMPLE) {
                let (all, own) =
                    (masses.square(v), v.iter().zip(given.iter()).map(|(v, m)| m * v * v).sum::<f64>());
                motion.largest_kinetic = motion.largest_kinetic.max(0.5 * all);
                motion.added_kinetic = motion.added_kinetic.max(0.5 * (all - own));
            }
        }
        let (det_f, _) = potential.least_det_f(x);
        if !(det_f > 0.0) {
            return Err((Reason::Inverted, motion.steps));
        }
        motion.time_step = motion.time_step.min(duration);
        motion.kinetic = 0.5 * masses.square(v);
        motion.largest_kinetic = motion.largest_kinetic.max(motion.kinetic);
        motion.stored = potential.energy(x) - first;
        let (missing, allowed) = (motion.missing(), IMBALANCE * motion.in_play() + scale.round_off);
        if !(missing.abs() <= allowed) {
            return Err((Reason::Imbalance { missing, in_play: motion.in_play() }, motion.steps));
        }
        Ok(motion)
    }
}

/// Whether anything changes with the load: energy and gradient `g` at `x` do. Leaves the load at 0.
fn is_driven(potential: &mut dyn Loading, x: &[f64], g: &[f64]) -> bool {
    let (mut moved, mut other) = (x.to_vec(), vec![0.0; x.len()]);
    let before = potential.energy(x);
    let differs = [0.5, 1.0].into_iter().any(|t| {
        potential.set_load(t, &mut moved);
        potential.gradient(&moved, &mut other);
        moved != x || potential.energy(&moved) != before || other != g
    });
    potential.set_load(0.0, &mut x.to_vec());
    differs
}

/// The longest time step, and what is known of the stiffness for the next look at it.
#[derive(Default)]
struct Scale {
    bound: Bound,
    vector: Vec<f64>,
    /// Longest step without added mass \[s\].
    natural: f64,
    /// Energy that round-off of the positions alone can make \[J\].
    round_off: f64,
}

impl Scale {
    /// The same as [`renew`](Scale::renew) on the way, at velocities `v`: what mass that comes or goes brings is told in `motion`. `before`: the
    /// masses so far.
    fn renew_moving(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        given: &[f64],
        factor: f64,
        v: &[f64],
        before: &Masses,
        motion: &mut Motion,
    ) -> Result<(f64, Masses), (Reason, usize)> {
        let (h, masses) = self.renew(potential, x, given, factor).map_err(|reason| (reason, motion.steps))?;
        motion.kinetic_before -= 0.5 * before.square(v);
        motion.kinetic_before += 0.5 * masses.square(v);
        motion.added_mass = motion.added_mass.max(masses.added);
        Ok((h, masses))
    }

    /// Time step and masses at `x`: with `factor` times the step that the `given` masses bear, they are as much larger as it takes. A motion that has
    /// blown up has no stiffness.
    fn renew(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        given: &[f64],
        factor: f64,
    ) -> Result<(f64, Masses), Reason> {
        let none = vec![[0.0; 9]; x.len() / 3];
        let physical = Masses::new(given, &none);
        let steps = super::masses::POWERS[usize::from(self.vector.len() == x.len())];
        let fastest = MARGIN * largest(potential, x, &physical, &mut self.vector, steps);
        if !fastest.is_finite() {
            return Err(Reason::Inversion);
        }
        let natural = 2.0 / fastest.sqrt();
        self.round_off = self.round_off.max(f64::EPSILON * fastest * physical.square(x));
        if self.natural == 0.0 {
            self.natural = natural;
        }
        if factor <= 1.0 {
            return Ok((natural, physical));
        }
        // The step of the start, so that stiffness that comes later is answered by mass.
        let h = factor * self.natural;
        self.bound.renew(potential, x);
        if !self.bound.largest.is_finite() {
            return Err(Reason::Inversion);
        }
        Ok((h, Masses::new(given, &self.bound.times(0.25 * ROOM * h * h))))
    }
}
