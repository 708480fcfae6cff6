//! What a unit refuses, and what it cannot do.

use coupling::error::CouplingError;

/// Why a call did not do what was asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnitError {
    /// The call is wrong: in this mode, with these values. Nothing changed.
    #[error("{0}")]
    Wrong(String),
    /// The call is right, but there is no solution: the unit is where it was.
    #[error("{0}")]
    NoSolution(String),
}

impl UnitError {
    /// Of words.
    pub fn wrong(words: impl Into<String>) -> UnitError {
        UnitError::Wrong(words.into())
    }
}

impl From<CouplingError> for UnitError {
    fn from(error: CouplingError) -> UnitError {
        match error {
            CouplingError::NotConverged(words) => UnitError::NoSolution(words),
            bad => UnitError::Wrong(bad.to_string()),
        }
    }
}
