//! The command `sartorius`: the command line, the files of a run and its pages.
//!
//! What is computed is in [`coupling`]; nothing there knows of files that are written or of pages.

#![warn(clippy::print_stderr)]

pub mod cli;
pub mod error;
pub mod output;
pub mod program;
pub mod report;
