//! The command sartorius.
