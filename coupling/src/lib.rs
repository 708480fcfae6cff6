//! The command sartorius.

pub mod measured;
pub mod output;
pub mod report;
