//! The knee: how the patella lies in its groove when the tibia is bent.

pub mod anatomy;
pub mod flexion;
pub mod pose;
pub mod rigid;
pub mod tendon;
