//! Finite elements: shape functions, quadrature, and the element integrals of a solid.

#![allow(non_snake_case)]

pub mod kernel;
pub mod principal;
pub mod psd;
pub mod shape;

pub use kernel::{Formulation, SolidElement};
pub use shape::Rule;
