//! The solvers without matrices: dynamic relaxation and explicit dynamics.

mod dynamics;
#[path = "../hard_cases/judge.rs"]
mod judge;
mod relaxation;
