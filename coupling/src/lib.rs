//! The command `sartorius`: the only crate that knows both the rigid leg and the deformable thigh.

pub mod cli;
pub mod error;
pub mod measured;
pub mod optimize;
pub mod output;
pub mod report;
pub mod thigh_tables;
