//! The deformable thigh: from bone motion and activation to deformation, stress and section forces.

// Comparisons are written so that NaN fails them.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod effect;
pub mod element;
pub mod material;
pub mod mesh;
pub mod solve;
