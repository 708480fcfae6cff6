//! Islands side by side: each solved alone, results and log in their order whatever finishes first.

use super::{Advance, Iteration, Loading, Settings, SolveError, Solver};
use rayon::prelude::*;

/// An island with its state and solver.
pub struct Island {
    /// What it minimizes.
    pub potential: Box<dyn Loading>,
    /// Positions of its free nodes \[m\].
    pub x: Vec<f64>,
    /// Its solver, with the factor kept from step to step.
    pub solver: Solver,
}

impl Island {
    /// An island at positions `x`.
    pub fn new(name: &str, potential: Box<dyn Loading>, x: Vec<f64>, settings: Settings) -> Island {
        assert_eq!(x.len(), potential.n_unknowns(), "positions of the free nodes of `{name}`");
        Island { potential, x, solver: Solver::new(name, settings) }
    }
}

/// Carries every island from load 0 to load 1, in parallel. One result per island, log rows in their order.
pub fn advance_islands(
    islands: &mut [Island],
    step: usize,
    log: &mut Vec<Iteration>,
) -> Vec<Result<Advance, SolveError>> {
    let run = |island: &mut Island| {
        let mut rows = Vec::new();
        let Island { potential, x, solver } = island;
        let result = solver.advance(potential.as_mut(), x, step, &mut rows);
        (result, rows)
    };
    let done: Vec<_> = islands.par_iter_mut().with_max_len(1).map(run).collect();
    done.into_iter()
        .map(|(result, rows)| {
            log.extend(rows);
            result
        })
        .collect()
}
