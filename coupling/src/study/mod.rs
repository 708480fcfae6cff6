//! A study: many runs of one kind, subjects by settings by samples.
//!
//! [`mod@file`] is what a person writes down ([`keys`], [`names`]), [`vary`] what differs from sample to sample and how it is distributed, [`run`] the unit of work: one run with a
//! folder and a status of its own, the same wherever it is carried out; [`rows`] reads what came of the runs, [`statistics`] and [`indices`] sum it up.

mod admissible;
pub mod file;
pub mod indices;
pub mod keys;
pub mod names;
pub mod rows;
pub mod run;
pub mod statistics;
pub mod vary;

pub use file::Study;
