//! A study: many runs of one kind, subjects by settings by samples.
//!
//! [`mod@file`] is what a person writes down, [`vary`] what differs from sample to sample and how it is distributed, [`run`] the unit of work: one run with a
//! folder and a status of its own, the same wherever it is carried out; [`rows`] reads what came of the runs, [`statistics`] sums it up.

pub mod file;
pub mod rows;
pub mod run;
pub mod statistics;
pub mod vary;

pub use file::Study;
