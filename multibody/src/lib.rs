//! The rigid lower limb: from markers and ground reaction to muscle forces and activations.

pub mod natural;
pub mod trial;
