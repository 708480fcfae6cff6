//! Solvers without matrices: all they ask of a potential is its gradient, step by step, and what resists at each node now and then.

pub mod masses;
mod relaxation;

pub use relaxation::Relaxation;
