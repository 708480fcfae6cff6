//! Does the solver find equilibria, refuse what has none, and name why?

mod equilibria;
mod factors;
mod lattice;
mod softened_way;
mod stability;
