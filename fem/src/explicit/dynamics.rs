//! Motion in time by central differences: what is truly dynamic, and what is slow enough to be taken for rest.
//!
//! v ← v − ½ h M⁻¹ g(x),  x ← x + h v,  v ← v − ½ h M⁻¹ g(x): second order, momentum to round-off, stable for h ω ≤ 2. Masses are lumped; with a
//! longer step than the material bears, nodes weigh more where and along what they must ([`masses`](super::masses)): a tendon, and not the
//! muscle behind it. Steps count where the masses were enough at their end, too: else they are taken back, and tried anew with what would have been
//! enough, fewer at a time.
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
/// Times in a row that steps are taken back and tried anew: from [`RENEW`] steps to one, and this one some ten times with more mass or half as long.
const MAX_REPEATS: usize = 20;
/// Steps from one look at the kinetic energy to the next.
const SAMPLE: usize = 5;
/// Quotient h²ω² of a step beyond which it is near the end of the stable ones.
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
        let fixed = potential.fixed().to_vec();
        let is_fixed: Vec<bool> = (0..x.len()).map(|i| fixed.get(i) == Some(&true)).collect();
        let Moving { masses: given, v, duration } = moving;
        v.iter_mut().zip(&is_fixed).filter(|(_, fixed)| **fixed).for_each(|(v, _)| *v = 0.0);
        if let Some(i) = (0..x.len()).find(|&i| !is_fixed[i] && !(given[i] > 0.0)) {
            return Err((Reason::NoMass { node: potential.node_name(i / 3) }, 0));
        }
        let (duration, factor) = (*duration, self.settings.time_step_factor);
        let mut looks = Looks { given, factor, natural: 0.0, bound: Bound::default(), vector: Vec::new() };
        let stride = looks.first(potential, x).map_err(|reason| (reason, 0))?;
        potential.renew(x);
        let mut g = vec![0.0; x.len()];
        potential.gradient(x, &mut g);
        let energy = potential.energy(x);
        let kinetic = 0.5 * stride.masses.square(v);
        let motion = Motion {
            time_step: f64::INFINITY,
            natural_step: looks.natural,
            mass: given.iter().sum::<f64>() / 3.0,
            added_mass: stride.masses.added,
            kinetic_before: kinetic,
            largest_kinetic: kinetic,
            ..Motion::default()
        };
        let drives = is_driven(potential, x, &g);
        let mut course = Course {
            potential,
            given,
            is_fixed,
            duration,
            alpha: self.settings.damping,
            drives,
            retries: 0,
            dx: Vec::new(),
        };
        let mut at = State { x: x.to_vec(), v: v.clone(), g, energy, time: 0.0, motion };
        let outcome = self.travel(&mut course, &mut looks, &mut at, stride);
        report.retries += course.retries;
        x.copy_from_slice(&at.x);
        let (stride, round_off) = outcome.map_err(|reason| (reason, at.motion.taken()))?;
        let (det_f, _) = potential.least_det_f(x);
        if !(det_f > 0.0) {
            return Err((Reason::Inverted, at.motion.taken()));
        }
        v.copy_from_slice(&at.v);
        let mut motion = at.motion;
        motion.time_step = motion.time_step.min(duration);
        motion.kinetic = 0.5 * stride.masses.square(v);
        motion.largest_kinetic = motion.largest_kinetic.max(motion.kinetic);
        motion.stored = potential.energy(x) - energy;
        let (missing, allowed) = (motion.missing(), IMBALANCE * motion.in_play() + round_off);
        if !(missing.is_finite() && missing.abs() <= allowed) {
            let reason = Reason::Imbalance { missing, in_play: motion.in_play() };
            return Err((reason, motion.taken()));
        }
        Ok(motion)
    }

    /// Steps to the end of the frame, a block at a time; returns the last [`Stride`], and the energy \[J\] that round-off can make on the way.
    fn travel(
        &self,
        course: &mut Course,
        looks: &mut Looks,
        at: &mut State,
        mut stride: Stride,
    ) -> Result<(Stride, f64), Reason> {
        let longest = if looks.factor > 1.0 { RENEW_ADDED } else { RENEW };
        let (mut block, mut repeats, mut round_off) = (longest, 0, stride.round_off(&at.x));
        let mut kept = at.clone();
        loop {
            let until = at.motion.steps + block;
            let (mut quotient, mut is_held_up) = (0.0, false);
            while quotient <= STABLE && !is_held_up && at.time < course.duration && at.motion.steps < until {
                if at.motion.taken() >= self.settings.max_steps {
                    return Err(Reason::NotSettled { steps: at.motion.taken() });
                }
                match course.step(at, &stride) {
                    Ok(of_step) => quotient = of_step,
                    // Surfaces in its way, or a motion that blows up: the look says which.
                    Err(_) => is_held_up = true,
                }
            }
            if !(quotient <= STABLE) {
                looks.stiffest(&course.dx);
            }
            // The quotient alone says nothing: where bodies drive it from rest, forces change that no stiffness of a free node answers for.
            let look = if at.is_finite() {
                looks.again(course.potential, &at.x, &stride)
            } else {
                Look::TooLong(None)
            };
            let next = match look {
                Look::Borne(_) if is_held_up => return Err(Reason::Touch),
                Look::Borne(next) => {
                    round_off = round_off.max(stride.round_off(&at.x));
                    if at.time >= course.duration {
                        return Ok((stride, round_off));
                    }
                    (block, repeats) = ((2 * block).min(longest), 0);
                    next
                }
                Look::TooLong(_) if repeats == MAX_REPEATS => return Err(Reason::BlowsUp),
                Look::TooLong(enough) => {
                    let taken = at.motion.taken();
                    at.clone_from(&kept);
                    at.motion.repeated = taken - at.motion.steps;
                    course.potential.set_load(at.time / course.duration, &mut at.x);
                    course.potential.renew(&at.x);
                    let same = || if block == 1 { stride.doubled(looks.factor) } else { stride.clone() };
                    let next = enough.unwrap_or_else(same);
                    (block, repeats) = ((block / 2).max(1), repeats + 1);
                    next
                }
            };
            at.motion.kinetic_before += 0.5 * (next.masses.square(&at.v) - stride.masses.square(&at.v));
            at.motion.added_mass = at.motion.added_mass.max(next.masses.added);
            stride = next;
            kept.clone_from(at);
        }
    }
}

/// Where a motion has come to.
#[derive(Clone)]
struct State {
    x: Vec<f64>,
    v: Vec<f64>,
    /// Gradient at `x`.
    g: Vec<f64>,
    /// Potential energy \[J\], where the load changes it.
    energy: f64,
    time: f64,
    motion: Motion,
}

impl State {
    /// Whether all that a look or a balance rests on is a number.
    fn is_finite(&self) -> bool {
        let energies = [self.energy, self.motion.work, self.motion.lag, self.motion.dissipated];
        self.x.iter().chain(&self.g).chain(&energies).all(|v| v.is_finite())
    }
}

/// What steps are taken with: their length \[s\], and masses that bear it.
#[derive(Clone)]
struct Stride {
    h: f64,
    masses: Masses,
}

impl Stride {
    /// Twice as heavy, or half as long where no mass is added.
    fn doubled(&self, factor: f64) -> Stride {
        match factor > 1.0 {
            true => Stride { h: self.h, masses: self.masses.doubled() },
            false => Stride { h: 0.5 * self.h, masses: self.masses.clone() },
        }
    }

    /// Energy \[J\] that round-off of the positions alone can make: ε x·Kx with K ⪯ 4/h² M.
    fn round_off(&self, x: &[f64]) -> f64 {
        f64::EPSILON * 4.0 / (self.h * self.h) * self.masses.square(x)
    }
}

/// A motion on its way.
struct Course<'a> {
    potential: &'a mut dyn Loading,
    given: &'a [f64],
    is_fixed: Vec<bool>,
    duration: f64,
    /// Damping \[1/s\].
    alpha: f64,
    /// Whether the load changes anything.
    drives: bool,
    /// Steps that were shortened before a collision.
    retries: usize,
    /// How far the unknowns went in the last step \[m\], 0 where prescribed.
    dx: Vec<f64>,
}

impl Course<'_> {
    /// One step; returns h²ω² of its own shape, which is 4 where stability ends.
    fn step(&mut self, at: &mut State, stride: &Stride) -> Result<f64, Reason> {
        let (masses, alpha, duration, n) = (&stride.masses, self.alpha, self.duration, at.x.len());
        // Equal steps to the end.
        let left = duration - at.time;
        let mut length = left / (left / stride.h * (1.0 - 1e-12)).ceil().max(1.0);
        let (before, start, old) = (at.x.clone(), at.v.clone(), at.g.clone());
        let places = self.potential.touching(&at.x);
        let damped = masses.square(&at.v);
        let mut a = at.g.clone();
        masses.answer_in_place(&mut a);
        loop {
            at.v.iter_mut().zip(&a).for_each(|(v, a)| *v -= 0.5 * length * (a + alpha * *v));
            for i in 0..n {
                at.x[i] = before[i] + length * at.v[i];
            }
            let reached = if length >= left { 1.0 } else { (at.time + length) / duration };
            self.potential.set_load(reached, &mut at.x);
            let free =
                if places.is_empty() { 1.0 } else { self.potential.collision_free_step(&places, &at.x) };
            if free >= 1.0 {
                break;
            }
            self.retries += 1;
            at.v.copy_from_slice(&start);
            at.x.copy_from_slice(&before);
            self.potential.set_load(at.time / duration, &mut at.x);
            length *= (SHORT_OF * free).max(1e-3);
            if length < LEAST_STEP * duration {
                return Err(Reason::Touch);
            }
        }
        let since = at.time;
        at.time = if length >= left { duration } else { at.time + length };
        at.motion.steps += 1;
        if at.time < duration {
            at.motion.time_step = at.motion.time_step.min(length);
        }
        self.dx = (0..n).map(|i| if self.is_fixed[i] { 0.0 } else { at.x[i] - before[i] }).collect();
        self.potential.renew(&at.x);
        self.potential.gradient(&at.x, &mut at.g);
        // The second half: v = v½ − ½ h (M⁻¹ g + α v).
        a.copy_from_slice(&at.g);
        masses.answer_in_place(&mut a);
        at.v.iter_mut()
            .zip(&a)
            .for_each(|(v, a)| *v = (*v - 0.5 * length * a) / (1.0 + 0.5 * length * alpha));
        let motion = &mut at.motion;
        motion.dissipated += 0.5 * length * alpha * (damped + masses.square(&at.v));
        // a − α v at a step, whose square h²/8 times over is what central differences keep less than ½ v·Mv.
        let lag = |g: &[f64], v: &[f64]| {
            let square = masses.inverse_square(g) + alpha * (2.0 * dot(g, v) + alpha * masses.square(v));
            0.125 * length * length * square
        };
        motion.lag += lag(&at.g, &at.v) - lag(&old, &start);
        if self.drives {
            // The work that belongs to central differences: what the potential gains by the load alone, mean of before and after.
            let ahead = self.energy(&before, at.time);
            let behind = self.energy(&at.x, since);
            let now = self.energy(&at.x, at.time);
            at.motion.work += 0.5 * (ahead - at.energy + now - behind);
            at.energy = now;
        }
        if at.motion.steps.is_multiple_of(SAMPLE) {
            let all = masses.square(&at.v);
            let own = at.v.iter().zip(self.given).map(|(v, m)| m * v * v).sum::<f64>();
            at.motion.largest_kinetic = at.motion.largest_kinetic.max(0.5 * all);
            at.motion.added_kinetic = at.motion.added_kinetic.max(0.5 * (all - own));
        }
        let square = masses.square(&self.dx);
        Ok(if square == 0.0 { 0.0 } else { length * length * dot_difference(&self.dx, &at.g, &old) / square })
    }

    /// Potential energy \[J\] at `x` under the load of `time`.
    fn energy(&mut self, x: &[f64], time: f64) -> f64 {
        let mut x = x.to_vec();
        self.potential.set_load(if time >= self.duration { 1.0 } else { time / self.duration }, &mut x);
        self.potential.energy(&x)
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

/// Looks at the stiffness: the longest step, the masses, and what is known for the next look.
struct Looks<'a> {
    given: &'a [f64],
    /// Wanted step beside the longest that the given masses bear.
    factor: f64,
    /// The longest step at the start that the given masses bear \[s\].
    natural: f64,
    /// Where mass is added.
    bound: Bound,
    /// The shape of the given masses that is fastest, for the next time.
    vector: Vec<f64>,
}

/// What a look at the end of some steps says of them.
enum Look {
    /// They were short enough for the stiffness there; how to go on.
    Borne(Stride),
    /// They were not; what would have been enough, where there is a stiffness to speak of.
    TooLong(Option<Stride>),
}

impl Looks<'_> {
    /// The first step and masses.
    fn first(&mut self, potential: &dyn Loading, x: &[f64]) -> Result<Stride, Reason> {
        let masses = Masses::new(self.given, &vec![[0.0; 9]; x.len() / 3]);
        let fastest = MARGIN * largest(potential, x, &masses, &mut self.vector);
        if !fastest.is_finite() {
            return Err(Reason::BlowsUp);
        }
        self.natural = 2.0 / fastest.sqrt();
        if self.factor <= 1.0 {
            return Ok(Stride { h: self.natural, masses });
        }
        let h = self.factor * self.natural;
        match self.again(potential, x, &Stride { h, masses }) {
            Look::Borne(stride) | Look::TooLong(Some(stride)) => Ok(stride),
            Look::TooLong(None) => Err(Reason::BlowsUp),
        }
    }

    /// Looks at `x`, where steps with `stride` have led. With added mass the step stays what it was at the start, so that stiffness that comes later
    /// is answered by mass.
    fn again(&mut self, potential: &dyn Loading, x: &[f64], stride: &Stride) -> Look {
        let Stride { h, masses } = stride;
        if self.factor <= 1.0 {
            let fastest = largest(potential, x, masses, &mut self.vector);
            let next = Stride { h: 2.0 / (MARGIN * fastest).sqrt(), masses: masses.clone() };
            return match fastest * h * h {
                square if square <= 4.0 => Look::Borne(next),
                square if square.is_finite() => Look::TooLong(Some(next)),
                _ => Look::TooLong(None),
            };
        }
        self.bound.renew(potential, x);
        if !self.bound.is_finite() {
            return Look::TooLong(None);
        }
        let least = |room: f64| self.bound.times(0.25 * room * h * h);
        match masses.cover(&least(1.0)) {
            true => Look::Borne(Stride { h: *h, masses: Masses::new(self.given, &least(ROOM)) }),
            false => Look::TooLong(Some(Stride { h: *h, masses: masses.at_least(&least(ROOM)) })),
        }
    }

    /// Has the next look begin with the shape `dx` of a step that was too long.
    fn stiffest(&mut self, dx: &[f64]) {
        let vector = if self.factor > 1.0 { &mut self.bound.vector } else { &mut self.vector };
        vector.clear();
        vector.extend(dx);
    }
}
