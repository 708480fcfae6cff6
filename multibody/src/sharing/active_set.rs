//! The exact answer: linear systems for given active bounds, and exchanges until every sign is right.
//!
//! For a given active set the problem is linear: with F the free variables and J the rows that hold
//!
//! ```text
//! H_FF z_F − A_JFᵀ y = −q_F − H_FB z_B,      A_JF z_F + C y = b_J − A_JB z_B
//! ```
//!
//! solved by Cholesky of H_FF and of the Schur complement (pivoted: dependent rows get y = 0), with
//! refinement. Starting from a guess, bounds with a multiplier of wrong sign are released; from there the dual
//! method adds violated bounds one by one, each step raising the dual objective, so that it ends: at the optimum or
//! with a proof that there is no admissible point (Goldfarb & Idnani, Math Program 1983;27:1).

#![allow(non_snake_case)]

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::scaled::Canonical;
use super::semidefinite::{DEPENDENT, PivotedCholesky};

/// Which side of its bounds a variable or row sits on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bound {
    Free,
    Lower,
    Upper,
}

/// The bounds that hold.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ActiveSet {
    pub variables: Vec<Bound>,
    /// Rows after the equalities.
    pub rows: Vec<Bound>,
}

/// A point that satisfies all conditions of optimality to round-off.
#[derive(Clone, Debug)]
pub(super) struct Optimum {
    pub z: DVector<f64>,
    /// Multipliers of all rows: positive at a lower, negative at an upper bound, 0 where none holds.
    pub y: DVector<f64>,
    pub set: ActiveSet,
    /// Least distance of a free variable or row from its bounds, and least multiplier of an active one.
    /// Positive: no other set of bounds is optimal.
    pub margin: f64,
    /// Linear systems solved.
    pub steps: u32,
}

/// Why a search ended without an optimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NoOptimum {
    /// The dual is unbounded: no point satisfies all bounds and equalities.
    Infeasible,
    /// Out of steps, or round-off stands in the way.
    Unsettled,
}

/// Signs and bounds are kept to this, in scaled units.
const TOLERANCE: f64 = 1e-11;
/// Hard rows hold to this, in scaled units.
const HOLDS: f64 = 1e-10;

impl ActiveSet {
    /// Nothing holds.
    pub fn free(c: &Canonical) -> ActiveSet {
        ActiveSet {
            variables: vec![Bound::Free; c.n()],
            rows: vec![Bound::Free; c.n_rows() - c.n_equalities],
        }
    }

    /// State of a bounded quantity: variables first, then rows.
    fn get(&self, index: usize) -> Bound {
        index.checked_sub(self.variables.len()).map_or_else(|| self.variables[index], |k| self.rows[k])
    }

    fn set(&mut self, index: usize, bound: Bound) {
        match index.checked_sub(self.variables.len()) {
            None => self.variables[index] = bound,
            Some(k) => self.rows[k] = bound,
        }
    }

    /// Can be a set of this problem: same sizes, no infinite bound holds.
    pub fn fits(&self, c: &Canonical) -> bool {
        let possible = |bound: &Bound, lower: f64, upper: f64| match bound {
            Bound::Free => true,
            Bound::Lower => lower.is_finite(),
            Bound::Upper => upper.is_finite(),
        };
        let ne = c.n_equalities;
        self.variables.len() == c.n()
            && self.rows.len() == c.n_rows() - ne
            && self.variables.iter().enumerate().all(|(i, b)| possible(b, c.lower[i], c.upper[i]))
            && self.rows.iter().enumerate().all(|(k, b)| possible(b, c.lo[ne + k], c.hi[ne + k]))
    }
}

/// Searches the optimum from the active set `guess`, with at most `max_steps` factorizations.
pub(super) fn solve(c: &Canonical, guess: ActiveSet, max_steps: u32) -> Result<Optimum, NoOptimum> {
    let mut steps = 0;
    let mut state = dual_feasible(c, guess, max_steps, &mut steps)?;
    loop {
        let Some((index, bound, violation)) = most_violated(c, &state) else {
            let State { set, z, y, nu } = state;
            let margin = margin(c, &set, &z, &y, &nu);
            return Ok(Optimum { z, y, set, margin, steps });
        };
        add(c, &mut state, index, bound, violation, max_steps, &mut steps)?;
    }
}

/// A point that minimises under the bounds of `set` alone, with its multipliers.
struct State {
    set: ActiveSet,
    z: DVector<f64>,
    y: DVector<f64>,
    /// Hz + q − Aᵀy: multipliers of the bounds on variables.
    nu: DVector<f64>,
}

impl State {
    fn at(c: &Canonical, set: ActiveSet, system: &System) -> State {
        let (z, y) = system.minimiser(c, &set);
        let nu = &c.H * &z + &c.q - c.A.tr_mul(&y);
        State { set, z, y, nu }
    }

    /// Value of a bounded quantity: variable, or row with the slack of its compliance.
    fn value(&self, c: &Canonical, index: usize) -> f64 {
        match index.checked_sub(c.n()) {
            None => self.z[index],
            Some(k) => {
                let r = c.n_equalities + k;
                c.A.row(r).tr_dot(&self.z) + c.compliance[r] * self.y[r]
            }
        }
    }

    /// Multiplier of a bounded quantity, positive at a lower bound.
    fn multiplier(&self, c: &Canonical, index: usize) -> f64 {
        index.checked_sub(c.n()).map_or_else(|| self.nu[index], |k| self.y[c.n_equalities + k])
    }

    fn multiplier_tolerance(&self) -> f64 {
        TOLERANCE * self.y.amax().max(self.z.amax()).max(1.0)
    }

    /// Largest violation of an equality or of an active row.
    fn worst_row(&self, c: &Canonical) -> f64 {
        let moment = &c.A * &self.z;
        let gap = |r: usize, target: f64| (moment[r] + c.compliance[r] * self.y[r] - target).abs();
        let equalities = (0..c.n_equalities).map(|r| gap(r, c.lo[r]));
        let rows =
            self.set.rows.iter().enumerate().filter(|(_, bound)| **bound != Bound::Free).map(|(k, bound)| {
                let r = c.n_equalities + k;
                gap(r, if *bound == Bound::Lower { c.lo[r] } else { c.hi[r] })
            });
        equalities.chain(rows).fold(0.0, f64::max)
    }
}

/// Bounds of a bounded quantity (variables first, then the rows after the equalities).
fn bounds(c: &Canonical, index: usize) -> (f64, f64) {
    match index.checked_sub(c.n()) {
        None => (c.lower[index], c.upper[index]),
        Some(k) => (c.lo[c.n_equalities + k], c.hi[c.n_equalities + k]),
    }
}

/// Releases bounds of `guess` until no multiplier has the wrong sign and all rows that should hold do.
fn dual_feasible(
    c: &Canonical,
    guess: ActiveSet,
    max_steps: u32,
    steps: &mut u32,
) -> Result<State, NoOptimum> {
    let mut set = guess;
    loop {
        *steps += 1;
        if *steps > max_steps {
            return Err(NoOptimum::Unsettled);
        }
        let Some(system) = System::new(c, &set) else { return Err(NoOptimum::Unsettled) };
        let state = State::at(c, set, &system);
        if state.worst_row(c) > HOLDS * state.z.amax().max(1.0) {
            // Too many bounds hold for the equalities: start from none. Then only a contradiction is left.
            let none = ActiveSet::free(c);
            if state.set == none {
                return Err(NoOptimum::Infeasible);
            }
            set = none;
            continue;
        }
        let tolerance = state.multiplier_tolerance();
        let mut next = state.set.clone();
        for index in 0..c.n() + next.rows.len() {
            let (lower, upper) = bounds(c, index);
            let inward = match next.get(index) {
                Bound::Free => continue,
                // A pinned quantity carries a multiplier of either sign.
                _ if lower == upper => continue,
                Bound::Lower => state.multiplier(c, index),
                Bound::Upper => -state.multiplier(c, index),
            };
            if inward < -tolerance {
                next.set(index, Bound::Free);
            }
        }
        if next == state.set {
            return Ok(state);
        }
        set = next;
    }
}

/// The bound that is violated most, with the amount.
fn most_violated(c: &Canonical, state: &State) -> Option<(usize, Bound, f64)> {
    let tolerance = TOLERANCE * state.z.amax().max(1.0);
    let mut worst: Option<(usize, Bound, f64)> = None;
    for index in 0..c.n() + state.set.rows.len() {
        if state.set.get(index) != Bound::Free {
            continue;
        }
        let (lower, upper) = bounds(c, index);
        let value = state.value(c, index);
        for (bound, violation) in [(Bound::Lower, lower - value), (Bound::Upper, value - upper)] {
            if violation > worst.map_or(tolerance, |w| w.2) {
                worst = Some((index, bound, violation));
            }
        }
    }
    worst
}

/// One dual step: raises the multiplier of a violated bound until it holds, releasing bounds whose multiplier
/// vanishes on the way.
fn add(
    c: &Canonical,
    state: &mut State,
    index: usize,
    bound: Bound,
    mut violation: f64,
    max_steps: u32,
    steps: &mut u32,
) -> Result<(), NoOptimum> {
    let sign = if bound == Bound::Lower { 1.0 } else { -1.0 };
    let row = index.checked_sub(c.n()).map(|k| c.n_equalities + k);
    let normal = match row {
        None => DVector::from_fn(c.n(), |i, _| if i == index { sign } else { 0.0 }),
        Some(r) => c.A.row(r).transpose() * sign,
    };
    let compliance = row.map_or(0.0, |r| c.compliance[r]);
    loop {
        *steps += 1;
        if *steps > max_steps {
            return Err(NoOptimum::Unsettled);
        }
        let Some(system) = System::new(c, &state.set) else { return Err(NoOptimum::Unsettled) };
        let (dz, dy, own_slope) = system.direction(c, &normal);
        let slope = normal.dot(&dz) + compliance;
        let dependent = slope <= DEPENDENT * own_slope;
        let dnu = &c.H * &dz - c.A.tr_mul(&dy) - &normal;

        let (mut t_dual, mut blocking) = (f64::INFINITY, None);
        for other in 0..c.n() + state.set.rows.len() {
            let outward = match state.set.get(other) {
                Bound::Free => continue,
                Bound::Lower => 1.0,
                Bound::Upper => -1.0,
            };
            let (lower, upper) = bounds(c, other);
            if lower == upper {
                continue;
            }
            let change = match other.checked_sub(c.n()) {
                None => dnu[other],
                Some(k) => dy[c.n_equalities + k],
            };
            let (multiplier, change) = ((outward * state.multiplier(c, other)).max(0.0), outward * change);
            if change < 0.0 && multiplier / -change < t_dual {
                (t_dual, blocking) = (multiplier / -change, Some(other));
            }
        }
        let t_primal = if dependent { f64::INFINITY } else { violation / slope };
        if t_primal <= t_dual && t_primal.is_finite() {
            state.set.set(index, bound);
            let Some(system) = System::new(c, &state.set) else { return Err(NoOptimum::Unsettled) };
            *state = State::at(c, state.set.clone(), &system);
            if state.worst_row(c) > HOLDS * state.z.amax().max(1.0) {
                return Err(NoOptimum::Unsettled);
            }
            return Ok(());
        }
        let Some(blocking) = blocking else { return Err(NoOptimum::Infeasible) };
        if !dependent {
            state.z += &dz * t_dual;
            violation -= slope * t_dual;
        }
        state.y += dy * t_dual;
        state.nu += dnu * t_dual;
        if let Some(r) = row {
            state.y[r] += sign * t_dual;
        }
        state.set.set(blocking, Bound::Free);
    }
}

/// Least distance of free quantities from their bounds and least multiplier of active ones.
fn margin(c: &Canonical, set: &ActiveSet, z: &DVector<f64>, y: &DVector<f64>, nu: &DVector<f64>) -> f64 {
    let state = State { set: set.clone(), z: z.clone(), y: y.clone(), nu: nu.clone() };
    let mut margin = f64::INFINITY;
    for index in 0..c.n() + set.rows.len() {
        let (lower, upper) = bounds(c, index);
        let room = match set.get(index) {
            _ if lower == upper => continue,
            Bound::Free => {
                let value = state.value(c, index);
                (value - lower).min(upper - value)
            }
            Bound::Lower => state.multiplier(c, index),
            Bound::Upper => -state.multiplier(c, index),
        };
        margin = margin.min(room);
    }
    margin
}

/// The linear system of one active set, factorized.
struct System {
    free: Vec<usize>,
    rows: Vec<usize>,
    A: DMatrix<f64>,
    compliance: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    schur: PivotedCholesky,
}

impl System {
    fn new(c: &Canonical, set: &ActiveSet) -> Option<System> {
        let free: Vec<usize> = (0..c.n()).filter(|i| set.variables[*i] == Bound::Free).collect();
        let holds = (0..set.rows.len()).filter(|k| set.rows[*k] != Bound::Free).map(|k| c.n_equalities + k);
        let rows: Vec<usize> = (0..c.n_equalities).chain(holds).collect();
        let factor = Cholesky::new(DMatrix::from_fn(free.len(), free.len(), |i, j| c.H[(free[i], free[j])]))?;
        let A = DMatrix::from_fn(rows.len(), free.len(), |k, i| c.A[(rows[k], free[i])]);
        let compliance = DVector::from_fn(rows.len(), |k, _| c.compliance[rows[k]]);
        let mut G = A.transpose();
        factor.l_dirty().solve_lower_triangular_mut(&mut G);
        let mut S = G.tr_mul(&G);
        for k in 0..rows.len() {
            S[(k, k)] += compliance[k];
        }
        let full = DVector::from_fn(rows.len(), |k, _| c.A.row(rows[k]).norm_squared() + compliance[k]);
        Some(System { free, rows, A, compliance, factor, schur: PivotedCholesky::new(S, &full) })
    }

    /// Solves H_FF z − A_JFᵀ y = r, A_JF z + C y = p in place.
    fn solve_mut(&self, r: &mut DVector<f64>, p: &mut DVector<f64>) {
        self.factor.solve_mut(r);
        p.gemv(-1.0, &self.A, r, 1.0);
        self.schur.solve_mut(p);
        let mut correction = self.A.tr_mul(p);
        self.factor.solve_mut(&mut correction);
        *r += correction;
    }

    /// z and y (of all rows) with exactly the bounds of `set` holding.
    fn minimiser(&self, c: &Canonical, set: &ActiveSet) -> (DVector<f64>, DVector<f64>) {
        let mut z = DVector::from_fn(c.n(), |i, _| match set.variables[i] {
            Bound::Free => 0.0,
            Bound::Lower => c.lower[i],
            Bound::Upper => c.upper[i],
        });
        let target = |k: usize| match self.rows[k].checked_sub(c.n_equalities) {
            Some(row) if set.rows[row] == Bound::Upper => c.hi[self.rows[k]],
            _ => c.lo[self.rows[k]],
        };
        let mut y = DVector::zeros(self.rows.len());
        // First pass from z_F = 0, y = 0, then refinement of the same equations.
        for _ in 0..3 {
            let gradient = &c.H * &z + &c.q;
            let moment = &c.A * &z;
            let mut r = self.A.tr_mul(&y) - gradient.select_rows(&self.free);
            let mut p = DVector::from_fn(y.len(), |k, _| {
                target(k) - moment[self.rows[k]] - self.compliance[k] * y[k]
            });
            self.solve_mut(&mut r, &mut p);
            for (k, i) in self.free.iter().enumerate() {
                z[*i] += r[k];
            }
            y += p;
        }
        (z, self.scatter_rows(c, &y))
    }

    /// Change of z and y per unit multiplier of a further constraint with this normal, and the slope that the
    /// normal would have without rows.
    fn direction(&self, c: &Canonical, normal: &DVector<f64>) -> (DVector<f64>, DVector<f64>, f64) {
        let reduced = normal.select_rows(&self.free);
        let own_slope = reduced.dot(&self.factor.solve(&reduced)).max(DEPENDENT * normal.norm_squared());
        let mut dz = DVector::zeros(c.n());
        let mut dy = DVector::zeros(self.rows.len());
        for _ in 0..2 {
            let free_dz = dz.select_rows(&self.free);
            let mut r = &reduced + self.A.tr_mul(&dy) - (&c.H * &dz).select_rows(&self.free);
            let mut p = -(&self.A * free_dz) - self.compliance.component_mul(&dy);
            self.solve_mut(&mut r, &mut p);
            for (k, i) in self.free.iter().enumerate() {
                dz[*i] += r[k];
            }
            dy += p;
        }
        (dz, self.scatter_rows(c, &dy), own_slope)
    }

    fn scatter_rows(&self, c: &Canonical, y: &DVector<f64>) -> DVector<f64> {
        let mut all = DVector::zeros(c.n_rows());
        for (k, row) in self.rows.iter().enumerate() {
            all[*row] = y[k];
        }
        all
    }
}
