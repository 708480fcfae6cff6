//! Clarabel on the canonical problem: finds the bounds that hold, whatever the start.
//!
//! One Clarabel solver is kept per structure (which bounds exist, which rows are soft) and updated. Its own
//! equilibration stays off, because it would remember the first problem; ours is redone for each frame.

#![allow(non_snake_case)]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};

use super::active_set::{ActiveSet, Bound};
use super::scaled::Canonical;

/// What decides the pattern of the matrices.
#[derive(Clone, PartialEq)]
struct Structure {
    n: usize,
    n_equalities: usize,
    diagonal: bool,
    /// One entry per inequality, in the order of the rows.
    sides: Vec<Side>,
    /// Rows with compliance; each has one extra variable.
    soft: Vec<usize>,
}

/// One inequality.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    LowerVariable(usize),
    UpperVariable(usize),
    LowerRow(usize),
    UpperRow(usize),
}

/// Outcome of one interior-point solve.
pub(super) enum Interior {
    /// Optimal up to the solver's tolerance.
    Optimal(ActiveSet, u32),
    /// A certificate says that there is no admissible point.
    Infeasible(u32),
    /// Neither, with the solver's word for it.
    Stuck(String, u32),
}

/// A kept Clarabel solver and the structure that it was built for.
#[derive(Default)]
pub(super) struct InteriorPoint {
    kept: Vec<(Structure, DefaultSolver<f64>)>,
}

/// Structures kept at a time: the frame as posed and its relaxations.
const MAX_KEPT: usize = 4;

impl InteriorPoint {
    pub fn solve(&mut self, canonical: &Canonical) -> Interior {
        let structure = Structure::of(canonical);
        let (P, q, A, b) = matrices(canonical, &structure);
        if let Some(slot) = self.kept.iter().position(|(kept, _)| *kept == structure) {
            let solver = &mut self.kept[slot].1;
            if solver.update_data(&P, &q, &A, &b).is_err() {
                self.kept.remove(slot);
            }
        }
        if !self.kept.iter().any(|(kept, _)| *kept == structure) {
            let n_inequalities = structure.sides.len();
            let mut cones = vec![SupportedConeT::ZeroConeT(structure.n_equalities)];
            if n_inequalities > 0 {
                cones.push(SupportedConeT::NonnegativeConeT(n_inequalities));
            }
            // Enough to tell which bounds hold; the numbers come from the active set.
            let settings =
                DefaultSettings { tol_gap_abs: 1e-6, tol_gap_rel: 1e-6, tol_feas: 1e-6, ..settings() };
            match DefaultSolver::new(&P, &q, &A, &b, &cones, settings) {
                Ok(solver) => {
                    if self.kept.len() == MAX_KEPT {
                        self.kept.remove(0);
                    }
                    self.kept.push((structure.clone(), solver));
                }
                Err(error) => return Interior::Stuck(error.to_string(), 0),
            }
        }
        let Some((_, solver)) = self.kept.iter_mut().find(|(kept, _)| *kept == structure) else {
            return Interior::Stuck("no solver".into(), 0);
        };
        solver.solve();
        let (solution, iterations) = (&solver.solution, solver.solution.iterations);
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                let ne = structure.n_equalities;
                let holds = |k: usize| solution.s[ne + k] < solution.z[ne + k];
                Interior::Optimal(structure.active_set(canonical, holds), iterations)
            }
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                Interior::Infeasible(iterations)
            }
            status => Interior::Stuck(status.to_string(), iterations),
        }
    }
}

/// Settings without anything that depends on earlier problems, the clock or the number of threads.
pub(super) fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        direct_solve_method: "qdldl".into(),
        equilibrate_enable: false,
        presolve_enable: false,
        input_sparse_dropzeros: false,
        ..DefaultSettings::default()
    }
}

impl Structure {
    fn of(c: &Canonical) -> Structure {
        let variables = (0..c.n()).flat_map(|i| {
            let lower = c.lower[i].is_finite().then_some(Side::LowerVariable(i));
            let upper = c.upper[i].is_finite().then_some(Side::UpperVariable(i));
            lower.into_iter().chain(upper)
        });
        let rows = (c.n_equalities..c.n_rows()).flat_map(|r| {
            let lower = c.lo[r].is_finite().then_some(Side::LowerRow(r));
            let upper = c.hi[r].is_finite().then_some(Side::UpperRow(r));
            lower.into_iter().chain(upper)
        });
        Structure {
            n: c.n(),
            n_equalities: c.n_equalities,
            diagonal: c.diagonal,
            sides: variables.chain(rows).collect(),
            soft: (0..c.n_rows()).filter(|r| c.compliance[*r] > 0.0).collect(),
        }
    }

    /// The bounds for which `holds` is true.
    fn active_set(&self, c: &Canonical, holds: impl Fn(usize) -> bool) -> ActiveSet {
        let mut set = ActiveSet::free(c);
        for (_, side) in self.sides.iter().enumerate().filter(|(k, _)| holds(*k)) {
            match *side {
                Side::LowerVariable(i) => set.variables[i] = Bound::Lower,
                Side::UpperVariable(i) => set.variables[i] = Bound::Upper,
                Side::LowerRow(r) => set.rows[r - c.n_equalities] = Bound::Lower,
                Side::UpperRow(r) => set.rows[r - c.n_equalities] = Bound::Upper,
            }
        }
        set
    }
}

/// P (upper triangle), q, A, b of Clarabel's form min 1/2 yᵀPy + qᵀy, A y + s = b, y = [z; t], where
/// v_r = √c_r t_r for the soft rows.
fn matrices(c: &Canonical, structure: &Structure) -> (CscMatrix<f64>, Vec<f64>, CscMatrix<f64>, Vec<f64>) {
    let (n, n_soft) = (structure.n, structure.soft.len());
    let (mut colptr, mut rowval, mut nzval) = (vec![0], Vec::new(), Vec::new());
    for j in 0..n {
        for i in if structure.diagonal { j } else { 0 }..=j {
            rowval.push(i);
            nzval.push(c.H[(i, j)]);
        }
        colptr.push(rowval.len());
    }
    for j in n..n + n_soft {
        rowval.push(j);
        nzval.push(1.0);
        colptr.push(rowval.len());
    }
    let P = CscMatrix::new(n + n_soft, n + n_soft, colptr, rowval, nzval);
    let mut q = c.q.as_slice().to_vec();
    q.resize(n + n_soft, 0.0);

    let ne = structure.n_equalities;
    let mut b = c.lo.as_slice()[..ne].to_vec();
    b.extend(structure.sides.iter().map(|side| match *side {
        Side::LowerVariable(i) => -c.lower[i],
        Side::UpperVariable(i) => c.upper[i],
        Side::LowerRow(r) => -c.lo[r],
        Side::UpperRow(r) => c.hi[r],
    }));
    let (mut colptr, mut rowval, mut nzval) = (vec![0], Vec::new(), Vec::new());
    for j in 0..n {
        for r in 0..ne {
            rowval.push(r);
            nzval.push(c.A[(r, j)]);
        }
        for (k, side) in structure.sides.iter().enumerate() {
            let value = match *side {
                Side::LowerVariable(i) if i == j => -1.0,
                Side::UpperVariable(i) if i == j => 1.0,
                Side::LowerRow(r) => -c.A[(r, j)],
                Side::UpperRow(r) => c.A[(r, j)],
                _ => continue,
            };
            rowval.push(ne + k);
            nzval.push(value);
        }
        colptr.push(rowval.len());
    }
    for &soft in &structure.soft {
        let root = c.compliance[soft].sqrt();
        if soft < ne {
            rowval.push(soft);
            nzval.push(root);
        }
        for (k, side) in structure.sides.iter().enumerate() {
            match *side {
                Side::LowerRow(r) if r == soft => {
                    rowval.push(ne + k);
                    nzval.push(-root);
                }
                Side::UpperRow(r) if r == soft => {
                    rowval.push(ne + k);
                    nzval.push(root);
                }
                _ => {}
            }
        }
        colptr.push(rowval.len());
    }
    let A = CscMatrix::new(b.len(), n + n_soft, colptr, rowval, nzval);
    (P, q, A, b)
}
