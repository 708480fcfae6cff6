//! Linear programmes of force sharing: what a linear function of the tensions can be at least and at most.
//!
//! ```text
//! min cᵀ z   subject to   A z = b,   l ≤ z ≤ u
//! ```
//!
//! Simplex method with bounded variables on a dense tableau (Dantzig 1963, chapter 18). It starts from an admissible point that is known,
//! the answer of force sharing, so there is no first phase: variables between their bounds that are not basic move like any other.
//! A tableau of 15 rows serves ten objectives of a frame, each some twenty pivots away.
//! The end is shown to be the optimum by weak duality, from the rows as posed and not from the tableau.
//!
//! Why not a library: of the pure Rust ones behind `good_lp`, `microlp` gives no multipliers, so nothing could be proved; Clarabel does, but begins every
//! objective anew.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};

/// Reduced costs below this fraction of the largest cost do not count.
const PRICE: f64 = 1e-9;
/// Pivots smaller than this are not taken; the rows have unit norm.
const PIVOT: f64 = 1e-9;
/// How far a variable may pass its bound; loads are of order one.
const GIVE: f64 = 1e-10;
/// Steps without length after which the least index is taken (Bland 1977), so that no cycle goes on.
const PATIENCE: usize = 30;
/// Steps of one objective; some twenty are needed.
const MOST_STEPS: usize = 1000;
/// Width of the bracket between the point reached and the dual bound, relative to the terms of the objective and to its largest coefficient: variables are
/// scaled so that loads are of order one, and where all muscles of an objective rest its terms are round-off alone.
const BRACKET: f64 = 1e-8;

/// Equalities with bounds on every variable, and a point that satisfies them.
pub(super) struct Polytope {
    /// Rows as posed, m × n.
    A: DMatrix<f64>,
    b: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    start: Tableau,
}

/// B⁻¹ A with a point.
#[derive(Clone)]
struct Tableau {
    T: DMatrix<f64>,
    /// Basic variable of each row; none where the row depends on the others.
    basis: Vec<Option<usize>>,
    is_basic: Vec<bool>,
    z: DVector<f64>,
}

/// A basic variable that runs into its bound.
struct Stop {
    row: usize,
    variable: usize,
    /// Change of the variable per step; positive towards its upper bound.
    rate: f64,
    /// Way to the bound.
    room: f64,
}

/// How one objective ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Least {
    /// No admissible point gives less: the bound that duality proves, below the point reached by round-off alone.
    Proved(f64),
    /// There is no least value.
    Unbounded,
    /// Out of steps, or duality does not confirm the point.
    Unsettled,
}

impl Polytope {
    /// `z` satisfies the rows and bounds to round-off.
    pub fn new(
        A: DMatrix<f64>,
        b: DVector<f64>,
        lower: DVector<f64>,
        upper: DVector<f64>,
        z: DVector<f64>,
    ) -> Polytope {
        let (m, n) = A.shape();
        let mut start = Tableau { T: A.clone(), basis: vec![None; m], is_basic: vec![false; n], z };
        // Variables far from their bounds make a basis that few steps leave.
        let room = |j: usize| (start.z[j] - lower[j]).min(upper[j] - start.z[j]);
        let mut order: Vec<(f64, usize)> = (0..n).map(|j| (room(j), j)).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, j) in order {
            let free = (0..m).filter(|&r| start.basis[r].is_none());
            let row = free.max_by(|&a, &b| start.T[(a, j)].abs().total_cmp(&start.T[(b, j)].abs()));
            let Some(row) = row else { break };
            // A basis on small pivots would be a basis of round-off.
            if start.T[(row, j)].abs() > 1e-3 {
                start.pivot(row, j);
            }
        }
        for row in 0..m {
            if start.basis[row].is_none() {
                let column = (0..n).filter(|&j| !start.is_basic[j]);
                let best =
                    column.max_by(|&a, &b| start.T[(row, a)].abs().total_cmp(&start.T[(row, b)].abs()));
                if let Some(j) = best.filter(|&j| start.T[(row, j)].abs() > PIVOT) {
                    start.pivot(row, j);
                }
            }
        }
        Polytope { A, b, lower, upper, start }
    }

    /// The least value of cᵀ z.
    pub fn least(&self, c: &DVector<f64>) -> Least {
        let scale = c.amax();
        if scale == 0.0 {
            return Least::Proved(0.0);
        }
        let mut t = self.start.clone();
        let mut idle = 0;
        for _ in 0..MOST_STEPS {
            let Some((j, direction)) = self.entering(&t, c, scale, idle > PATIENCE) else {
                return self.proved(&t, c);
            };
            let Some(length) = self.step(&mut t, j, direction) else { return Least::Unbounded };
            idle = if length > 0.0 { 0 } else { idle + 1 };
        }
        Least::Unsettled
    }

    /// The variable that lowers the objective fastest, or the first that does, with the direction in which it does.
    fn entering(&self, t: &Tableau, c: &DVector<f64>, scale: f64, first: bool) -> Option<(usize, f64)> {
        let c_B: Vec<f64> = t.basis.iter().map(|k| k.map_or(0.0, |k| c[k])).collect();
        let mut best: Option<(usize, f64, f64)> = None;
        for j in (0..c.len()).filter(|&j| !t.is_basic[j] && self.lower[j] < self.upper[j]) {
            let d = c[j] - t.T.column(j).iter().zip(&c_B).map(|(a, c)| a * c).sum::<f64>();
            let blocked = if d > 0.0 { t.z[j] <= self.lower[j] } else { t.z[j] >= self.upper[j] };
            if d.abs() > best.map_or(PRICE * scale, |b| b.2) && !blocked {
                best = Some((j, -d.signum(), d.abs()));
                if first {
                    break;
                }
            }
        }
        best.map(|(j, direction, _)| (j, direction))
    }

    /// Moves variable `j` until a bound stops it; how far, or nothing where none does.
    ///
    /// Bounds give by [`GIVE`] while the row is chosen, so that of those that stop it together the one with the largest pivot does (Harris,
    /// Math Program 1973;5:1): small pivots would fill the tableau with round-off.
    fn step(&self, t: &mut Tableau, j: usize, direction: f64) -> Option<f64> {
        let own = if direction > 0.0 { self.upper[j] - t.z[j] } else { t.z[j] - self.lower[j] }.max(0.0);
        let stops: Vec<Stop> = (t.basis.iter().enumerate())
            .filter_map(|(row, k)| {
                let (k, rate) = ((*k)?, -direction * t.T[(row, j)]);
                let room = if rate > 0.0 { self.upper[k] - t.z[k] } else { t.z[k] - self.lower[k] };
                (rate.abs() > PIVOT).then_some(Stop { row, variable: k, rate, room })
            })
            .collect();
        let limit = stops.iter().map(|s| (s.room + GIVE) / s.rate.abs()).fold(own, f64::min);
        if limit.is_infinite() {
            return None;
        }
        let until = |s: &Stop| s.room.max(0.0) / s.rate.abs();
        let together = stops.iter().filter(|s| limit < own && until(s) <= limit);
        let leaving = together.max_by(|a, b| a.rate.abs().total_cmp(&b.rate.abs()));
        let length = leaving.map_or(own, until);
        t.z[j] += direction * length;
        for (row, k) in t.basis.iter().enumerate() {
            if let Some(k) = *k {
                t.z[k] -= direction * length * t.T[(row, j)];
            }
        }
        match leaving {
            Some(stop) => {
                let bounds = if stop.rate > 0.0 { &self.upper } else { &self.lower };
                t.z[stop.variable] = bounds[stop.variable];
                t.pivot(stop.row, j);
            }
            None => t.z[j] = if direction > 0.0 { self.upper[j] } else { self.lower[j] },
        }
        Some(length)
    }

    /// Weak duality: with any multipliers y, no admissible point gives less than bᵀy + Σ min over l ≤ z ≤ u of (c − Aᵀy)_j z_j.
    fn proved(&self, t: &Tableau, c: &DVector<f64>) -> Least {
        let rows: Vec<(usize, usize)> =
            t.basis.iter().enumerate().filter_map(|(row, k)| Some((row, (*k)?))).collect();
        let B = DMatrix::from_fn(rows.len(), rows.len(), |i, k| self.A[(rows[k].0, rows[i].1)]);
        let c_B = DVector::from_fn(rows.len(), |i, _| c[rows[i].1]);
        let Some(y_B) = B.lu().solve(&c_B) else { return Least::Unsettled };
        let mut y = DVector::zeros(self.b.len());
        for ((row, _), value) in rows.iter().zip(y_B.iter()) {
            y[*row] = *value;
        }
        let d = c - self.A.tr_mul(&y);
        let mut bound = self.b.dot(&y);
        let mut terms = self.b.component_mul(&y).abs().sum();
        for j in 0..c.len() {
            let at = if d[j] >= 0.0 { self.lower[j] } else { self.upper[j] };
            // A variable without that bound has a reduced cost of zero, up to round-off.
            let term = if at.is_finite() {
                d[j] * at
            } else if d[j].abs() <= PRICE * c.amax() {
                d[j] * t.z[j]
            } else {
                return Least::Unsettled;
            };
            bound += term;
            terms += term.abs();
        }
        let reached = c.dot(&t.z);
        terms += c.component_mul(&t.z).abs().sum();
        let misses = (&self.A * &t.z - &self.b).amax();
        let is_met = (reached - bound).abs() <= BRACKET * (terms + c.amax())
            && misses <= BRACKET * t.z.amax().max(self.b.amax());
        if is_met { Least::Proved(bound) } else { Least::Unsettled }
    }
}

impl Tableau {
    /// Variable `j` becomes the basic one of `row`.
    fn pivot(&mut self, row: usize, j: usize) {
        let m = self.T.nrows();
        let mut own: DVector<f64> = self.T.column(j).into_owned();
        let inverse = 1.0 / own[row];
        own[row] = 0.0;
        for mut column in self.T.column_iter_mut() {
            let scaled = column[row] * inverse;
            if scaled != 0.0 {
                column.axpy(-scaled, &own, 1.0);
            }
            column[row] = scaled;
        }
        // Exact, whatever the rounding.
        for r in 0..m {
            self.T[(r, j)] = if r == row { 1.0 } else { 0.0 };
        }
        if let Some(old) = self.basis[row].replace(j) {
            self.is_basic[old] = false;
        }
        self.is_basic[j] = true;
    }
}
