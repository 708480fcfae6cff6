//! Newton's method on the total potential at a fixed load, with a Hessian that is made positive definite where it is not.
//!
//! Nocedal & Wright, Numerical Optimization, 2nd ed., ch. 3 and 6.

use super::convexity::Convexity;
use super::linear::{LinearReport, LinearSolver, dot, norm};
use super::round_off::{energy_round_off, round_off};
use super::{Advance, BlockMatrix, Indefinite, Iteration, Loading, NotConverged, Reason, Settings};
use std::time::Instant;

/// Length of a step below which softened contact is asked for a better guess.
const CUT_SHORT: f64 = 0.25;
/// Round-off of the gradient, as a fraction of the wanted residual, up to which a residual is looked for that is small enough beside it.
const ROOM: f64 = 0.5;
/// Fraction of the slope of a Newton direction that has to be left where the ways of single nodes are shortened.
const LEAST_SLOPE: f64 = 0.1;

/// One call of `advance`.
pub(super) struct Run<'a> {
    pub(super) name: String,
    pub(super) settings: Settings,
    pub(super) step: usize,
    /// Wanted residual relative to the forces in play: that of the settings, or what does on the way.
    pub(super) tolerance: f64,
    pub(super) log: &'a mut Vec<Iteration>,
    pub(super) report: Advance,
    /// The linear solver with the factor it keeps, and room for the Hessian.
    pub(super) linear: &'a mut LinearSolver,
    pub(super) k: &'a mut BlockMatrix,
    /// Nothing can move freely, but for contact.
    pub(super) supported: bool,
    /// Unknowns that are prescribed.
    pub(super) fixed: Vec<bool>,
    /// How convex the next Hessian is made.
    pub(super) convexity: Convexity,
    /// Newton's method may try softened contact where steps are cut short.
    pub(super) may_approach: bool,
    /// An indefinite Hessian was met in this load step.
    pub(super) met_indefinite: bool,
}

impl Run<'_> {
    /// Why round-off ends the way from a residual to that of `wanted` \[N\] at `x`.
    pub(super) fn round_off(&self, x: &[f64], residual: f64, wanted: f64) -> Reason {
        let extent = extent(x);
        let farthest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let floor = round_off(self.k, x);
        // The same body about the origin would have been told apart.
        let is_far = extent > 0.0 && floor * extent / farthest <= wanted;
        let reachable = self.tolerance * floor.max(residual) / wanted;
        Reason::RoundOff { floor, reachable, far: is_far.then_some((farthest, extent)) }
    }
}

/// Greatest extent \[m\] of some positions along x, y or z.
pub(super) fn extent(x: &[f64]) -> f64 {
    let along = |c: usize| x.iter().skip(c).step_by(3);
    let width = |c| along(c).fold(f64::MIN, |m, v| m.max(*v)) - along(c).fold(f64::MAX, |m, v| m.min(*v));
    (0..3).map(width).fold(0.0, f64::max)
}

/// What one iteration adds to the log.
#[derive(Default)]
pub(super) struct Taken {
    pub(super) step_length: f64,
    pub(super) linear: LinearReport,
    pub(super) projected: bool,
}

impl Run<'_> {
    /// Newton's method at a fixed load, to a residual of `self.tolerance` relative to the forces in play.
    pub(super) fn newton(
        &mut self,
        potential: &mut dyn Loading,
        x: &mut [f64],
        load: f64,
    ) -> Result<(), Box<NotConverged>> {
        let n = x.len();
        let (mut g, mut dx, mut trial) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        potential.renew(x);
        let mut energy = potential.energy(x);
        self.gradient(potential, x, &mut g);
        let mut scale = potential.force_scale(x);
        let mut last = f64::INFINITY;
        for iteration in 1..=self.settings.max_iterations {
            let start = Instant::now();
            let residual = norm(&g);
            if !residual.is_finite() || !energy.is_finite() {
                return Err(self.failure(potential, x, Reason::NotFinite, iteration, &g));
            }
            let wanted = self.wanted(scale);
            (self.report.residual, self.report.force_scale, self.report.energy) = (residual, scale, energy);
            self.report.wanted = wanted;
            if residual <= wanted {
                // A residual that is known less exactly than that may be small by chance.
                let round_off = self.k.gradient_round_off(x, &self.fixed);
                if residual + round_off <= wanted {
                    self.report.least_det_f = potential.least_det_f(x).0;
                    return Ok(());
                }
                // Where round-off leaves room for a smaller one, that is looked for.
                if round_off > ROOM * wanted {
                    let reason = self.round_off(x, residual, wanted);
                    return Err(self.failure(potential, x, reason, iteration, &g));
                }
            }
            if residual > last / 2.0 && residual <= round_off(self.k, x) {
                let reason = self.round_off(x, residual, wanted);
                return Err(self.failure(potential, x, reason, iteration, &g));
            }
            // Exact enough for quadratic convergence, and no more exact than the last step needs.
            let forcing = (residual / last).powi(2).min(1e-3).max(0.1 * wanted / residual).min(0.1);
            last = residual;
            let rhs: Vec<f64> = g.iter().map(|g| -g).collect();
            let (report, projected) = self.direction(potential, x, rhs, forcing, &mut dx)?;
            let assembly = Instant::now();
            let short = shortened(&dx, &g, potential.longest_step());
            let floor = energy_round_off(self.k, x);
            let mut search =
                |dx: &[f64]| self.line_search(potential, x, &g, dx, floor, &mut energy, &mut trial);
            let mut found = search(short.as_deref().unwrap_or(&dx));
            if found.is_err() && short.is_some() {
                found = search(&dx);
            }
            let length = match found {
                Ok(length) => length,
                Err(_) if !projected => {
                    self.convexity.next = self.convexity.enough;
                    self.met_indefinite = true;
                    self.linear.forget();
                    continue;
                }
                // Round-off, not the mechanics, ends the descent a little above the estimate.
                Err(_) if wanted.min(0.01 * residual) <= round_off(self.k, x) => {
                    let reason = self.round_off(x, residual, wanted);
                    return Err(self.failure(potential, x, reason, iteration, &g));
                }
                Err(reason) => return Err(self.failure(potential, x, reason, iteration, &g)),
            };
            x.copy_from_slice(&trial);
            if potential.renew(x) {
                energy = potential.energy(x);
            }
            self.gradient(potential, x, &mut g);
            scale = potential.force_scale(x);
            self.report.assembly_s += assembly.elapsed().as_secs_f64();
            self.report.iterations += 1;
            let taken = Taken { step_length: length, linear: report, projected };
            self.record(potential, x, load, iteration, [norm(&g), scale, energy], &taken, start);
            if length < CUT_SHORT
                && self.may_approach
                && !potential.touching(x).is_empty()
                && self.approach(potential, x, load)
            {
                (last, energy) = (f64::INFINITY, potential.energy(x));
                self.gradient(potential, x, &mut g);
                scale = potential.force_scale(x);
            }
        }
        // Where what is wanted lies below round-off, stiffness and softness too far apart are why it creeps.
        let wanted = self.wanted(scale);
        let reason = match round_off(self.k, x) > wanted {
            true => self.round_off(x, norm(&g), wanted),
            false => Reason::Iterations,
        };
        Err(self.failure(potential, x, reason, self.settings.max_iterations, &g))
    }

    /// Solves H Δx = rhs with the Hessian at `x`: as it is where it is positive definite; otherwise with as much convexity as
    /// that takes and no more (full convexity is so stiff that it creeps along valleys and away from saddles); at last with a
    /// multiple of its diagonal added. Returns whether H is not the true Hessian.
    pub(super) fn direction(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        mut rhs: Vec<f64>,
        tolerance: f64,
        dx: &mut [f64],
    ) -> Result<(LinearReport, bool), Box<NotConverged>> {
        for i in 0..rhs.len() {
            if self.is_fixed(i) {
                rhs[i] = 0.0;
            }
        }
        if self.report.work >= self.settings.max_work {
            return Err(self.failure(potential, x, Reason::Work { most: self.settings.max_work }, 0, &rhs));
        }
        self.report.work += 1;
        let mut total = LinearReport::default();
        let (mut convexity, mut shift) = (self.convexity.next, 0.0);
        loop {
            let start = Instant::now();
            if shift > 0.0 {
                self.k.shift(shift);
            } else {
                potential.hessian(x, convexity, self.k);
                self.k.constrain(&self.fixed);
            }
            self.report.assembly_s += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let (report, outcome) = self.linear.solve(self.k, &rhs, dx, tolerance, convexity == 1.0);
            self.report.linear_s += start.elapsed().as_secs_f64() - report.factorization_s;
            self.report.factorization_s += report.factorization_s;
            self.report.factorizations += report.factorizations;
            self.report.linear_iterations += report.iterations;
            total.iterations += report.iterations;
            total.factorizations += report.factorizations;
            total.relative_residual = report.relative_residual;
            match outcome {
                Ok(()) if dot(dx, &rhs) > 0.0 || norm(&rhs) == 0.0 => {
                    self.convexity.suffices(convexity);
                    return Ok((total, convexity > 0.0));
                }
                _ if convexity < self.convexity.enough => {
                    self.met_indefinite = true;
                    convexity = self.convexity.enough;
                }
                _ if convexity < 1.0 => convexity = (4.0 * convexity).min(1.0),
                _ if shift < 1.0 => shift = if shift == 0.0 { 1e-8 } else { 100.0 * shift },
                Ok(()) => return Err(self.failure(potential, x, Reason::NoDescent, 0, &rhs)),
                Err(Indefinite { unknown }) => {
                    let node = potential.node_name(unknown / 3);
                    let direction = ['x', 'y', 'z'][unknown % 3];
                    return Err(self.failure(potential, x, Reason::Singular { node, direction }, 0, &rhs));
                }
            }
            self.linear.forget();
        }
    }

    /// Norm of the gradient at which the iteration ends \[N\], given the forces in play.
    fn wanted(&self, force_scale: f64) -> f64 {
        self.tolerance * force_scale.max(self.settings.least_force)
    }

    /// Gradient with zeros at prescribed unknowns.
    pub(super) fn gradient(&self, potential: &dyn Loading, x: &[f64], g: &mut [f64]) {
        potential.gradient(x, g);
        for i in 0..self.fixed.len() {
            if self.fixed[i] {
                g[i] = 0.0;
            }
        }
    }

    pub(super) fn is_fixed(&self, i: usize) -> bool {
        self.fixed.get(i) == Some(&true)
    }

    pub(super) fn record(
        &mut self,
        potential: &dyn Loading,
        x: &[f64],
        load: f64,
        iteration: usize,
        [residual, force_scale, energy]: [f64; 3],
        taken: &Taken,
        start: Instant,
    ) {
        let row = Iteration {
            island: self.name.clone(),
            step: self.step,
            load,
            iteration,
            residual,
            force_scale,
            energy,
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

    pub(super) fn failure(
        &self,
        potential: &dyn Loading,
        x: &[f64],
        reason: Reason,
        iterations: usize,
        g: &[f64],
    ) -> Box<NotConverged> {
        let (det_f, place) = potential.least_det_f(x);
        let wanted = self.wanted(potential.force_scale(x));
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

/// The step `dx` with shorter ways of those nodes that go farther than `longest` \[m\], so that these few do not hold up all others; `None`
/// where there are none, or too little of the descent along the gradient `g` would remain.
fn shortened(dx: &[f64], g: &[f64], longest: f64) -> Option<Vec<f64>> {
    let length = |u: &[f64]| (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).sqrt();
    if longest == f64::INFINITY || dx.chunks_exact(3).all(|u| length(u) <= longest) {
        return None;
    }
    let mut short = dx.to_vec();
    for u in short.chunks_exact_mut(3) {
        let fraction = (longest / length(u)).min(1.0);
        u.iter_mut().for_each(|u| *u *= fraction);
    }
    (dot(g, &short) <= LEAST_SLOPE * dot(g, dx)).then_some(short)
}
