//! The knee: how the patella lies in its groove when the tibia is bent.

pub mod anatomy;
pub mod pose;
pub mod rigid;
