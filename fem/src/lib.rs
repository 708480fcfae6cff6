//! The deformable thigh: from bone motion and activation to deformation, stress and section forces.

pub mod effect;
pub mod element;
pub mod material;
pub mod mesh;
pub mod solve;
