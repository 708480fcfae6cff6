//! Equilibrium of an island: minimum of its total potential over the positions of its free nodes.
//!
//! An *island* is a set of nodes that nothing connects to the rest; each is one [`Potential`] and is solved alone.

mod analysis;
pub mod block_matrix;
pub mod cholesky;
mod convexity;
mod galerkin;
mod islands;
mod line_search;
mod linear;
mod load_step;
mod log;
mod motion;
mod newton;
mod ordering;
mod outcome;
mod patience;
mod potential;
mod rigid;
mod round_off;
mod solver;
mod stability;

pub use analysis::Analysis;
pub use block_matrix::{BlockMatrix, PRESCRIBED, Pattern, Slots};
pub use cholesky::{Cholesky, Indefinite};
pub use galerkin::Galerkin;
pub use islands::{Island, advance_islands};
pub use linear::{LinearReport, LinearSolver};
pub(crate) use load_step::DET_F_FRACTION;
pub use log::{Iteration, IterationLog};
pub use motion::{HEAVY, Motion};
pub use outcome::{Advance, NotConverged, Reason, SolveError};
pub use potential::{Admissible, Loading, Potential};
pub use rigid::{LooseComponent, loose_components};
pub use solver::{Method, Settings, Solver, Stability, Way};
