//! The knee: how the patella lies in its groove when the tibia is bent.

pub mod anatomy;
pub mod deep;
pub mod femur;
pub mod flexion;
pub mod frames;
pub mod level;
pub mod made;
pub mod muscles;
pub mod pose;
pub mod quadriceps;
pub mod rigid;
pub mod shape;
pub mod solid;
pub mod string;
