//! Placeholder until its stage stands.
