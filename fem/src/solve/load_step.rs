//! One load step: the load is carried over, Newton's method finds the equilibrium, an unstable one is left.
//!
//! From t₀ to t₁ K Δx = −(g + ∂g/∂t (t₁ − t)) moves the free nodes along with what is prescribed, by the largest fraction of the
//! step that inverts nothing; from there Newton's method starts.

use super::convexity::Convexity;
use super::linear::norm;
use super::newton::{Run, Taken};
use super::{Loading, NotConverged, Reason, Stability, Way};
use std::time::Instant;

/// While the load is carried over, least det F may fall to this fraction in one go.
pub(crate) const DET_F_FRACTION: f64 = 0.1;
/// Shortest fraction of what is left of a load step that is carried over at once.
const LEAST_PREDICTION: f64 = 1.0 / 256.0;
/// Residual relative to the forces in play at which the rest of a load step that contact cut short is gone about.
const ON_THE_WAY: f64 = 0.05;
/// Fractions of the activation distance below which contact is softened, one after the other. Surfaces are parted to the last one then: what
/// has been in equilibrium with hardest softened contact is so with guarded contact, but for edges.
const SCHEDULE: [f64; 3] = [0.8, 0.1, 0.03];
/// Where among them a guess of a coarser mesh begins, which is near equilibrium with hard contact: the softest would first lead away from it.
const FROM_GUESS: usize = 1;
/// Unstable equilibria that are left in one load step.
const MAX_KICKS: usize = 3;
/// Predictions that are tried within one load step.
const MAX_PREDICTIONS: usize = 16;

/// Whether no element is inverted at `x`, and none flatter than `least` where that is a bound.
fn is_sound(potential: &dyn Loading, x: &[f64], least: f64) -> bool {
    potential.energy(x).is_finite() && (least <= 0.0 || potential.least_det_f(x).0 >= least)
}

/// How a way through softened contact ended.
#[derive(Debug)]
enum Soft {
    /// At this load, where nothing overlaps.
    Apart(f64),
    /// At this load, unsettled, in overlaps that could not be parted, or in cells that this has folded.
    Failed(f64),
    /// Nothing touches or folds on the way.
    Needless,
}

impl Run<'_> {
    /// From the equilibrium at `t` to that at `target`, or as far as contact and folding cells let the load be carried over at
    /// once; returns the load reached.
    pub(super) fn load_step(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        t: f64,
        target: f64,
    ) -> Result<f64, Box<NotConverged>> {
        self.convexity = Convexity::none();
        self.met_indefinite = false;
        self.may_approach = false;
        self.tolerance = self.settings.tolerance;
        let softly = match self.settings.way {
            Way::Guided => self.predict_softened(potential, x, t, target),
            Way::Strict => None,
        };
        let reached = match softly {
            Some(reached) => {
                // Near a guess the true Hessian is hardly ever definite; whether it is counts only where stability does.
                if self.settings.stability == Stability::Never {
                    self.convexity = Convexity::falling();
                }
                reached
            }
            None => {
                let reached = self.predict_guarded(potential, x, t, target)?;
                self.may_approach = self.settings.way == Way::Guided;
                reached
            }
        };
        if reached < target {
            // On the way nobody asks for the equilibrium but the next piece of it, which starts from it.
            self.tolerance = self.settings.tolerance.max(ON_THE_WAY);
            self.newton(potential, x, reached)?;
            self.report.loose_steps += 1;
            return Ok(reached);
        }
        let mut kicks = 0;
        loop {
            self.newton(potential, x, target)?;
            if self.report.least_det_f <= 0.0 {
                return Err(self.stop(potential, x, Reason::Inverted));
            }
            if self.met_indefinite && self.report.indefinite_at.last() != Some(&target) {
                self.report.indefinite_at.push(target);
            }
            let doubtful = match self.settings.stability {
                Stability::Always => true,
                Stability::WhereDoubtful => self.met_indefinite,
                Stability::Never => false,
            };
            self.report.tested_stable = doubtful && self.supported;
            if !self.report.tested_stable || self.is_stable(potential, x) {
                return Ok(target);
            }
            self.report.unstable_at.push(target);
            if kicks == MAX_KICKS {
                return Err(self.stop(potential, x, Reason::Unstable));
            }
            tracing::info!(island = %self.name, step = self.step, load = target, "equilibrium is unstable, leaving it");
            kicks += 1;
            self.leave(potential, x, kicks);
        }
    }

    /// Why the equilibrium at `x` is none to be handed on.
    fn stop(&self, potential: &dyn Loading, x: &[f64], reason: Reason) -> Box<NotConverged> {
        let mut g = vec![0.0; x.len()];
        self.gradient(potential, x, &mut g);
        self.failure(potential, x, reason, 0, &g)
    }

    /// Takes `x` towards the equilibrium at the load `load` by way of softened contact; returns whether that led to a better place
    /// where nothing overlaps, and otherwise leaves `x`. Where it led a body through another, collision detection alone goes on to the end of
    /// the frame.
    pub(super) fn approach(&mut self, potential: &mut dyn Loading, x: &mut [f64], load: f64) -> bool {
        let (start, before) = (x.to_vec(), potential.energy(x));
        let mut better =
            self.equilibrate_softly(potential, x, load, &SCHEDULE) && potential.energy(x) < before;
        if better && !potential.keeps_sides(&potential.sides(&start), x) {
            self.report.wrong_ways += 1;
            self.settings.way = Way::Strict;
            better = false;
        }
        tracing::debug!(island = %self.name, step = self.step, load, better, "approached through softened contact");
        match better {
            true => self.report.soft_ways += 1,
            false => x.copy_from_slice(&start),
        }
        better
    }

    /// Takes `x` to equilibrium at the load `load` with contact softened as `schedule` says, less and less so, and parts what overlaps then; returns
    /// whether that led to a place where nothing overlaps. Newton's method does not try it once more on the way.
    fn equilibrate_softly(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        load: f64,
        schedule: &[f64],
    ) -> bool {
        self.may_approach = false;
        let hardest = schedule[schedule.len() - 1];
        let parted = schedule.iter().all(|&softness| self.relax(potential, x, load, softness))
            && potential.untangle(x, hardest);
        potential.soften(0.0);
        parted && is_sound(potential, x, 0.0)
    }

    /// Takes `x` near equilibrium at the load `load` with contact softened below `softness`; returns whether it got there.
    fn relax(&mut self, potential: &mut dyn Loading, x: &mut [f64], load: f64, softness: f64) -> bool {
        let tolerance = self.tolerance;
        self.tolerance = self.settings.tolerance.max(ON_THE_WAY);
        self.linear.forget();
        let before = std::mem::replace(&mut self.convexity, Convexity::full());
        let outcome = potential.soften(softness).then(|| self.newton(potential, x, load));
        if let Some(Err(failure)) = &outcome {
            let (det_f, reason) = (failure.det_f, &failure.reason);
            tracing::debug!(island = %self.name, step = self.step, load, softness, det_f, %reason, "softened contact does not settle");
        }
        self.tolerance = tolerance;
        self.convexity = before;
        self.linear.forget();
        matches!(outcome, Some(Ok(())))
    }

    /// Moves the load towards `target` through whatever the free nodes touch, see [`go_softly`](Self::go_softly), and
    /// half as far where that fails; returns the load reached, and otherwise leaves `x` and the load `t`.
    /// Where nothing touches or folds on the way there is nothing to gain by it. Where it leads a body through another, collision detection
    /// alone goes from here to the end of the frame.
    fn predict_softened(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        t: f64,
        target: f64,
    ) -> Option<f64> {
        let n = potential.n_pieces(target);
        if n == 0 || !potential.soften(SCHEDULE[0]) {
            return None;
        }
        let piece = (target - t) / n as f64;
        let (start, sides) = (x.to_vec(), potential.sides(x));
        let mut until = target;
        let outcome = loop {
            let outcome = self.go_softly(potential, x, t, until, piece);
            tracing::debug!(island = %self.name, step = self.step, from = t, to = until, n, ?outcome, "carried along softly");
            let keeps_sides = !matches!(outcome, Soft::Apart(_)) || potential.keeps_sides(&sides, x);
            if let (Soft::Apart(reached), true) = (&outcome, keeps_sides) {
                self.report.soft_ways += 1;
                break Some(*reached);
            }
            x.copy_from_slice(&start);
            potential.soften(0.0);
            potential.set_load(t, x);
            self.report.wrong_ways += usize::from(!keeps_sides);
            let (Soft::Apart(reached) | Soft::Failed(reached)) = outcome else { break None };
            if potential.is_guessed(until) && potential.forget_guess() {
                return self.predict_softened(potential, x, t, target);
            }
            if !keeps_sides {
                self.settings.way = Way::Strict;
                break None;
            }
            // Up to where it failed it would go the same way again.
            until = (t + (until - t) / 2.0).min(reached);
            if until - t < piece {
                break None;
            }
            potential.soften(SCHEDULE[0]);
        };
        potential.soften(0.0);
        outcome
    }

    /// Goes to what is guessed of `until`, or moves the load there from `t` in pieces no longer than `piece` and lets the predictor move the
    /// free nodes along through whatever they touch, to equilibrium with softened contact, and some way towards it where cells would fold
    /// before. Where that fails `x` and the load are left anywhere.
    fn go_softly(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        mut t: f64,
        until: f64,
        piece: f64,
    ) -> Soft {
        if t < until && potential.is_guessed(until) {
            // Through whatever is on the way: only what is there at its end counts.
            potential.predict(until, x);
            if !potential.meets(x) {
                return Soft::Needless;
            }
            return match self.equilibrate_softly(potential, x, until, &SCHEDULE[FROM_GUESS..]) {
                true => Soft::Apart(until),
                false => Soft::Failed(until),
            };
        }
        let mut meets = false;
        let mut trial = x.to_vec();
        loop {
            let from = t;
            let (det_before, _) = potential.least_det_f(x);
            let mut length = piece;
            while t < until {
                let next = if t + 1.01 * length > until { until } else { t + length };
                let places = potential.touching(x);
                trial.copy_from_slice(x);
                potential.predict(next, &mut trial);
                // No point may come past the middle of a body at once.
                let fraction = potential.collision_free_step(&places, &trial);
                if fraction < 1.0 && length > LEAST_PREDICTION * piece {
                    potential.set_load(t, x);
                    length *= (0.9 * fraction).clamp(0.1, 0.9);
                    continue;
                }
                if fraction < 1.0 || !(potential.least_det_f(&trial).0 >= DET_F_FRACTION * det_before) {
                    potential.set_load(t, x);
                    break;
                }
                x.copy_from_slice(&trial);
                t = next;
                length = (2.0 * length).min(piece);
                meets = meets || potential.meets(x);
            }
            if t == until {
                if !meets {
                    return Soft::Needless;
                }
                break;
            }
            meets = true;
            if t == from {
                // The rest is a load step of its own, from where surfaces are apart again.
                break;
            }
            if !self.relax(potential, x, t, SCHEDULE[0]) {
                return Soft::Failed(t);
            }
        }
        match self.equilibrate_softly(potential, x, t, &SCHEDULE) {
            true => Soft::Apart(t),
            false => Soft::Failed(t),
        }
    }

    /// Moves the load to `target`, or as far as contact allows, and the free nodes along with it; returns the load.
    fn predict_guarded(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        mut t: f64,
        target: f64,
    ) -> Result<f64, Box<NotConverged>> {
        let n = x.len();
        let first = t;
        if let Some(reached) = self.predict_kinematic(potential, x, t, target) {
            return Ok(reached);
        }
        let (mut g, mut ahead, mut moved) = (vec![0.0; n], vec![0.0; n], x.to_vec());
        let (mut dx, mut trial) = (vec![0.0; n], vec![0.0; n]);
        for iteration in 0..MAX_PREDICTIONS {
            if t >= target {
                return Ok(t);
            }
            let start = Instant::now();
            // ∂g/∂t by a difference over a millionth of the way: only a prediction hangs on it.
            let fraction = 1e-6;
            potential.gradient(x, &mut g);
            moved.copy_from_slice(x);
            potential.set_load(t + fraction * (target - t), &mut moved);
            potential.gradient(&moved, &mut ahead);
            potential.set_load(t, x);
            let places = potential.touching(x);
            let displaces = potential.displaces(target);
            if moved == x && ahead == g && (places.is_empty() || !displaces) {
                potential.set_load(target, x); // nothing moves with the load: no step to predict
                return Ok(target);
            }
            let rhs: Vec<f64> = (0..n).map(|i| -g[i] - (ahead[i] - g[i]) / fraction).collect();
            self.report.assembly_s += start.elapsed().as_secs_f64();
            if rhs.iter().any(|r| !r.is_finite()) {
                return Err(self.failure(potential, x, Reason::NotFinite, iteration, &g));
            }
            let (report, projected) = self.direction(potential, x, rhs, 1e-3, &mut dx)?;
            for i in 0..n {
                if self.is_fixed(i) {
                    dx[i] = (moved[i] - x[i]) / fraction;
                }
            }
            let (det_before, _) = potential.least_det_f(x);
            let (mut length, mut is_held_up) = (1.0, false);
            loop {
                let load = if length == 1.0 { target } else { t + length * (target - t) };
                potential.go(x, &dx, length, &mut trial);
                potential.set_load(load, &mut trial);
                let free =
                    if places.is_empty() { 1.0 } else { potential.collision_free_step(&places, &trial) };
                if free >= 1.0 && is_sound(potential, &trial, DET_F_FRACTION * det_before) {
                    x.copy_from_slice(&trial);
                    t = load;
                    break;
                }
                is_held_up |= free < 1.0;
                // Forces alone: Newton's first step predicts with the stiffness that they bring, and searches along its line.
                if t == first && places.is_empty() && !displaces {
                    potential.set_load(target, x);
                    return Ok(target);
                }
                // Bodies turn, so the shorter way is another one and is checked again.
                length *= if free < 1.0 { (0.9 * free).max(1e-3) } else { 0.5 };
                if length < LEAST_PREDICTION {
                    if free < 1.0 && self.move_prescribed(potential, x, &places, target, &mut trial) {
                        return Ok(target);
                    }
                    potential.set_load(t, x);
                    if t > first && !places.is_empty() {
                        return Ok(t);
                    }
                    let reason = if free < 1.0 { Reason::Touch } else { Reason::Inversion };
                    return Err(self.failure(potential, x, reason, iteration, &g));
                }
            }
            let taken = Taken { step_length: length, linear: report, projected };
            potential.gradient(x, &mut g);
            let state = [norm(&g), potential.force_scale(x), potential.energy(x)];
            self.record(potential, x, t, 0, state, &taken, start);
            // What contact holds up is brought near equilibrium first: its barrier has met what it had not seen.
            if is_held_up {
                return Ok(t);
            }
        }
        if t >= target || !potential.touching(x).is_empty() {
            return Ok(t);
        }
        Err(self.failure(potential, x, Reason::Inversion, MAX_PREDICTIONS, &g))
    }

    /// Moves the load towards `target` and lets the predictor move the free nodes along, piece by piece, as far as nothing folds or
    /// touches; returns the load reached. `None`: it has no guess, or its first piece fails already.
    fn predict_kinematic(
        &self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        t: f64,
        target: f64,
    ) -> Option<f64> {
        let n = potential.n_pieces(target);
        if n == 0 {
            return None;
        }
        let (det_before, _) = potential.least_det_f(x);
        let mut reached = t;
        let mut length = (target - t) / n as f64;
        let mut trial = x.to_vec();
        while reached < target {
            let load = if reached + 1.5 * length > target { target } else { reached + length };
            let places = potential.touching(x);
            trial.copy_from_slice(x);
            potential.predict(load, &mut trial);
            if potential.collision_free_step(&places, &trial) >= 1.0
                && is_sound(potential, &trial, DET_F_FRACTION * det_before)
            {
                x.copy_from_slice(&trial);
                reached = load;
                continue;
            }
            potential.set_load(reached, x);
            // A guess that cannot be gone to at once is none.
            if potential.forget_guess() {
                return self.predict_kinematic(potential, x, t, target);
            }
            length /= 2.0;
            if length < (target - t) / (8 * n) as f64 {
                break;
            }
        }
        tracing::debug!(island = %self.name, step = self.step, from = t, to = reached, target, "carried along");
        (reached > t).then_some(reached)
    }

    /// Moves the load to `target` and nothing else, where that touches nothing: a part that only contact will hold has no
    /// place to be carried to. Returns whether it did.
    fn move_prescribed(
        &self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        places: &[f64],
        target: f64,
        trial: &mut [f64],
    ) -> bool {
        trial.copy_from_slice(x);
        potential.set_load(target, trial);
        let works =
            potential.energy(trial).is_finite() && potential.collision_free_step(places, trial) >= 1.0;
        if works {
            x.copy_from_slice(trial);
        }
        works
    }
}
