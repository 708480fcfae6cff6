//! The deformable thigh as the coupling sees it.

pub mod build;
pub mod lines;
