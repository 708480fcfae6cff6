//! The conditions of optimality, recomputed from the answer on the problem as posed.

#![allow(non_snake_case)]

use nalgebra::DVector;

use super::{Names, SharingProblem};

/// A frame counts as solved when its residuals are below this.
pub const KKT_TOLERANCE: f64 = 1e-8;

/// Multipliers of the equalities and of the bounds on x. Those of the bounds on f follow from them.
#[derive(Clone, Debug, PartialEq)]
pub struct Multipliers {
    /// Of `R f + s = tau`, n_coordinates \[cost/(N·m)\].
    pub moments: DVector<f64>,
    /// Of the bounds on x, n_x \[cost/N\]: positive at a lower, negative at an upper bound, else 0.
    pub reactions: DVector<f64>,
}

/// Scaled Karush-Kuhn-Tucker residuals; each is a pure number and does not change with the units of force,
/// length or cost.
///
/// With d_i = 1/√(w_f,i + Σ w_x X_ji²) (the force at which muscle i costs 1/2), Λ = the largest of all terms
/// d_i |∂cost/∂f_i|, d_i |R_ki λ_k|, d_i |X_ji μ_j|, and Φ = the largest of all |f_i|, |x_j|, and terms |X_ji f_i|, |x0_j|:
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residuals {
    /// Gradient that no bound balances: d_i |g_i| / Λ over the muscles strictly within their bounds,
    /// g = W_f (f − target) + Xᵀ W_x x − Rᵀ λ − Xᵀ μ; and for reserves |w_s s − λ| / max |λ|.
    pub stationarity: f64,
    /// Violated bounds \[N\] / Φ.
    pub primal: f64,
    /// Multipliers of wrong sign, scaled like stationarity (those of x by the largest d_i |X_ji|).
    pub dual: f64,
    /// Products of multiplier and distance from the bound, / (Λ max f_i/d_i).
    pub complementarity: f64,
    /// Largest violated equality |R f + s − tau| / max(|tau|, 1 N·m).
    pub equality: f64,
}

impl Residuals {
    /// The largest of them.
    pub fn largest(&self) -> f64 {
        // `f64::max` drops NaN; an answer with NaN must not look solved.
        let all = [self.stationarity, self.primal, self.dual, self.complementarity, self.equality];
        if all.iter().any(|r| r.is_nan()) { f64::NAN } else { all.into_iter().fold(0.0, f64::max) }
    }
}

/// A bound on x that keeps a frame from being solved.
#[derive(Clone, Debug, PartialEq)]
pub struct Blocking {
    /// Contact, ligament, tendon or bone force.
    pub reaction: String,
    /// The bound \[N\].
    pub bound: f64,
    /// Force that the moments need, were it not for this and the other blocking bounds \[N\]; `None`
    /// when the moments cannot be carried even then.
    pub needed: Option<f64>,
}

/// A distance from a bound below this times Φ counts as holding the bound.
const AT_BOUND: f64 = 1e-9;

/// Residuals of an answer (tensions `f`, reserves `s`) with its multipliers.
pub fn residuals(p: &SharingProblem, f: &DVector<f64>, s: &DVector<f64>, m: &Multipliers) -> Residuals {
    let (n, nx, nc) = (p.n_muscles(), p.n_reactions(), p.n_coordinates());
    let (x, off) = (p.reactions(f), p.off_target(f));
    let mut force = f.amax();
    let mut d = DVector::zeros(n);
    let mut g = DVector::zeros(n);
    let mut lambda_scale = f64::MIN_POSITIVE;
    for i in 0..n {
        let mut h = p.w_f[i];
        let mut cost = p.w_f[i] * off[i];
        let mut rows = 0.0;
        let mut largest: f64 = 0.0;
        for j in 0..nx {
            h += p.w_x[j] * p.X[(j, i)].powi(2);
            cost += p.X[(j, i)] * p.w_x[j] * x[j];
            let term = p.X[(j, i)] * m.reactions[j];
            rows += term;
            largest = largest.max(term.abs());
            force = force.max((p.X[(j, i)] * f[i]).abs());
        }
        for k in 0..nc {
            let term = p.R[(k, i)] * m.moments[k];
            rows += term;
            largest = largest.max(term.abs());
        }
        d[i] = 1.0 / h.sqrt();
        g[i] = cost - rows;
        lambda_scale = lambda_scale.max(d[i] * largest.max(cost.abs()));
    }
    for j in 0..nx {
        force = force.max(p.x0[j].abs()).max(x[j].abs());
    }
    let force = force.max(f64::MIN_POSITIVE);
    let cost_scale = (0..n).map(|i| f[i].abs() / d[i]).fold(f64::MIN_POSITIVE, f64::max) * lambda_scale;

    let mut r = Residuals::default();
    let mut worst = |slot: Slot, value: f64| {
        let slot = match slot {
            Slot::Stationarity => &mut r.stationarity,
            Slot::Primal => &mut r.primal,
            Slot::Dual => &mut r.dual,
            Slot::Complementarity => &mut r.complementarity,
            Slot::Equality => &mut r.equality,
        };
        if value > *slot || value.is_nan() {
            *slot = value;
        }
    };
    for i in 0..n {
        let (below, above) = (f[i] - p.lower_f[i], p.upper_f[i] - f[i]);
        worst(Slot::Primal, (-below).max(-above) / force);
        let (at_lower, at_upper) = (below <= AT_BOUND * force, above <= AT_BOUND * force);
        let nu = d[i] * g[i] / lambda_scale;
        match (at_lower, at_upper) {
            (false, false) => worst(Slot::Stationarity, nu.abs()),
            (true, false) => worst(Slot::Dual, -nu),
            (false, true) => worst(Slot::Dual, nu),
            (true, true) => {}
        }
        let gap = if g[i] > 0.0 { below } else { above };
        if (at_lower && g[i] > 0.0) || (at_upper && g[i] < 0.0) {
            worst(Slot::Complementarity, (g[i] * gap).abs() / cost_scale);
        }
    }
    for j in 0..nx {
        let mu = m.reactions[j];
        let (below, above) = (x[j] - p.lower_x[j], p.upper_x[j] - x[j]);
        worst(Slot::Primal, (-below).max(-above) / force);
        let reach = (0..n).map(|i| d[i] * p.X[(j, i)].abs()).fold(0.0, f64::max);
        let open = if mu > 0.0 { p.lower_x[j] } else { p.upper_x[j] };
        if mu != 0.0 && open.is_infinite() {
            worst(Slot::Dual, mu.abs() * reach / lambda_scale);
        } else if mu != 0.0 {
            let gap = if mu > 0.0 { below } else { above };
            worst(Slot::Complementarity, (mu * gap).abs() / cost_scale);
        }
    }
    let tau_scale = p.tau.amax().max(1.0);
    let multiplier_scale = m.moments.amax().max(f64::MIN_POSITIVE);
    let moment = &p.R * f + s - &p.tau;
    for k in 0..nc {
        worst(Slot::Equality, moment[k].abs() / tau_scale);
        let w_s = p.reserve_weight(k);
        if w_s.is_finite() {
            worst(Slot::Stationarity, (w_s * s[k] - m.moments[k]).abs() / multiplier_scale);
        }
    }
    r
}

/// Which residual a number belongs to.
enum Slot {
    Stationarity,
    Primal,
    Dual,
    Complementarity,
    Equality,
}

/// Bounds that hold with a positive multiplier, and the muscles at their upper bound.
pub(super) fn active_bounds(p: &SharingProblem, f: &DVector<f64>, m: &Multipliers) -> (usize, Vec<usize>) {
    let x = p.reactions(f);
    let force = f.amax().max(x.iter().fold(0.0, |a: f64, b| a.max(b.abs())));
    let cost: DVector<f64> = p.w_f.component_mul(&p.off_target(f)) + p.X.tr_mul(&p.w_x.component_mul(&x));
    let g = cost - p.R.tr_mul(&m.moments) - p.X.tr_mul(&m.reactions);
    let mut active = m.reactions.iter().filter(|mu| **mu != 0.0).count();
    let mut saturated = Vec::new();
    for i in 0..p.n_muscles() {
        let at_lower = f[i] - p.lower_f[i] <= AT_BOUND * force;
        let at_upper = p.upper_f[i] - f[i] <= AT_BOUND * force;
        if (at_lower && g[i] > 0.0) || (at_upper && g[i] < 0.0) {
            active += 1;
        }
        if at_upper {
            saturated.push(i);
        }
    }
    (active, saturated)
}

/// The names of `indices`.
pub(super) fn named(names: &[String], indices: &[usize]) -> Vec<String> {
    indices.iter().map(|i| names[*i].clone()).collect()
}

/// The sentence of an infeasible verdict: what is missing and what stands in the way.
pub(super) fn infeasible_reason(
    names: &Names,
    missing: &DVector<f64>,
    tolerance: f64,
    unactuated: &[usize],
    saturated: &[usize],
    blocking: &[Blocking],
    excess: &[(usize, f64)],
) -> String {
    let mut parts = Vec::new();
    // What is a thousandth of the worst would only clutter the sentence; `Verdict::shortfall` has it.
    let worth_saying = tolerance.max(1e-3 * missing.amax());
    for (k, missing) in missing.iter().enumerate().filter(|(_, m)| m.abs() > worth_saying) {
        let why = if unactuated.contains(&k) { " (no muscle moves it)" } else { "" };
        parts.push(format!("{} lacks {missing:.3} N·m{why}", names.coordinates[k]));
    }
    for (j, excess) in excess {
        parts
            .push(format!("{} misses its bound by {excess:.3} N whatever the tensions", names.reactions[*j]));
    }
    if !saturated.is_empty() {
        parts.push(format!("saturated: {}", named(&names.muscles, saturated).join(", ")));
    }
    for block in blocking {
        let needed = block.needed.map_or(String::new(), |needed| format!(", needed: {needed:.1} N"));
        parts.push(format!("{} is held at its bound of {:.1} N{needed}", block.reaction, block.bound));
    }
    parts.join("; ")
}
