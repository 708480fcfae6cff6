//! The deformable thigh: from bone motion and activation to deformation, stress and section forces.

pub mod mesh;
pub mod solve;
