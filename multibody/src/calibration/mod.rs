//! Sources of landmarks; each ends in an [`Anatomy`](crate::anatomy::Anatomy).

pub mod table;
