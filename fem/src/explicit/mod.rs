//! Solvers without matrices: all they ask of a potential is its gradient, step by step, and what resists at each node now and then.
//!
//! [`Relaxation`] finds an equilibrium as the rest of a damped motion of fictitious masses; [`Dynamics`] is motion in time, with masses that are
//! real but where a time step is wanted that they do not bear. Both take steps by central differences over the same [`masses::Masses`].

mod dynamics;
pub mod masses;
mod relaxation;

pub use dynamics::{Dynamics, IMBALANCE, Moving};
pub use relaxation::Relaxation;
