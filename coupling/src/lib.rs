//! The command `sartorius`: the only crate that knows both the rigid leg and the deformable thigh.

pub mod alone;
pub mod cache;
pub mod calibration;
pub mod capacity;
pub mod cli;
pub mod compare;
pub mod error;
pub mod explain;
pub mod fibres;
pub mod fixed_point;
pub mod hill_calibration;
pub mod measured;
pub mod muscle_unit;
pub mod number;
pub mod optimize;
pub mod output;
pub mod registration;
pub mod report;
pub mod scene;
pub mod section;
pub mod steps;
pub mod study;
pub mod subject;
pub mod thigh;
pub mod thigh_tables;
pub mod two_way;
