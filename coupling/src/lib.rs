//! What couples the rigid leg with the deformable thigh: the only crate that knows both, apart from the command on top of it.
//!
//! [`optimize`] is the rigid leg end to end, [`scene`] what a person writes down, [`steps`] what it says of a gait step, [`thigh`] the mesh, [`fibres`] what its muscles
//! pull with, [`comparison`] the road from a scene to forces compared, [`two_way`] the passes back into force sharing, [`mod@solve`] bodies of
//! one's own, [`session`] either side by itself, [`mod@study`] many runs.

#![warn(clippy::print_stderr)]

/// A line on standard error. Unlike `eprintln!` it goes on where nobody reads that any more: a closed pipe ends no run, and keeps none from
/// ending.
#[macro_export]
macro_rules! say {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}

pub mod changes;
pub mod comparison;
pub mod configuration;
pub mod cost;
pub mod error;
pub mod fibres;
pub mod form;
pub mod knee;
pub mod measured;
pub mod number;
pub mod optimize;
pub mod options;
pub mod samples;
pub mod scene;
pub mod session;
pub mod solve;
mod source;
pub mod steps;
pub mod study;
pub mod subject;
pub mod thigh;
pub mod thigh_capacities;
pub mod two_way;
