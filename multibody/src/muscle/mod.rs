//! Muscles.

pub mod path;
