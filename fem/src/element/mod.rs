//! Finite elements: shape functions, quadrature, and the element integrals of a solid.

#![allow(non_snake_case)]

pub mod cluster;
pub mod kernel;
pub mod principal;
pub mod psd;
pub mod shape;

pub use cluster::{Cluster, Part, Sample};
pub use kernel::{Formulation, SolidElement};
pub use shape::Rule;
