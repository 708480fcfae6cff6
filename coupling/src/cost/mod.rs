//! What accuracy costs in time: a ladder of settings, what each rung took, and how far its numbers are from those of a finer one.
//!
//! [`ladder`] reads what a person writes down and makes scenes of it, [`rung`] is what came of one, [`accuracy`] how sure its numbers are.

pub mod accuracy;
pub mod curve;
pub mod ladder;
pub mod rung;
