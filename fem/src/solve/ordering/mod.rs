//! The order in which a factorization eliminates the nodes of a graph, as a forest of sets that are eliminated together.
//!
//! No order is best for all graphs: planes divide compact bodies well; slender bodies, and bodies side by side that touch in places, are
//! far better off with the minimum degree.

mod dissection;
mod minimum_degree;

pub use dissection::dissect;
pub use minimum_degree::by_degree;

use super::Pattern;

/// Multiply-adds that it takes to eliminate `own` unknowns of a dense front and pass on the square of `passed` others.
pub fn elimination_work(own: f64, passed: f64) -> f64 {
    own * own * own / 6.0 + own * own * passed / 2.0 + own * passed * passed / 2.0
}

/// Nodes that are eliminated together, in this order, and those that must be eliminated before them.
#[derive(Debug)]
pub struct Supernode {
    pub nodes: Vec<u32>,
    pub children: Vec<Supernode>,
}
