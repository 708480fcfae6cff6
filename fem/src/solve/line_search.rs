//! Line search on the energy along a Newton direction.
//!
//! Nocedal & Wright, Numerical Optimization, 2nd ed., ch. 3; the test that takes over where energy differences drown in
//! round-off is the approximate Wolfe condition of Hager & Zhang, SIAM J. Optim. 16 (2005).

use super::linear::dot;
use super::newton::Run;
use super::{Loading, Reason};

/// Shortest fraction of a Newton step or of a load step carried over that is tried.
const LEAST_STEP_LENGTH: f64 = 1e-6;
/// Fraction of the predicted decrease that a step must reach (Armijo).
const ARMIJO: f64 = 1e-4;
/// Energy differences below this fraction of the energy are taken for round-off.
const ENERGY_ROUND_OFF: f64 = 1e-11;

impl Run<'_> {
    /// Finds the fraction of `dx` to take; leaves x + fraction · dx in `trial` and its energy in `energy`. `round_off` of the
    /// energy \[J\] where it is near zero.
    pub(super) fn line_search(
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
        let from = potential.touching(x);
        let free = self.free_length(potential, x, dx, &from, trial);
        if free <= 0.0 {
            return Err(Reason::Touch);
        }
        let mut length = free;
        let mut inverted = false;
        let mut g_trial = Vec::new();
        while length >= LEAST_STEP_LENGTH * free {
            potential.go(x, dx, length, trial);
            if length < free && potential.is_curved() && !from.is_empty() {
                // A shorter way is another one.
                let fraction = potential.collision_free_step(&from, trial);
                if fraction < 1.0 {
                    length *= (0.9 * fraction).max(0.1);
                    continue;
                }
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

    /// Greatest fraction of `dx` on whose way from the places `from` nothing touches; 1 where nothing can. Overwrites `trial`.
    fn free_length(
        &self,
        potential: &dyn Loading,
        x: &[f64],
        dx: &[f64],
        from: &[f64],
        trial: &mut [f64],
    ) -> f64 {
        if from.is_empty() {
            return 1.0;
        }
        potential.go(x, dx, 1.0, trial);
        potential.collision_free_step(from, trial)
    }
}
