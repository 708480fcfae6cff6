//! Why a command ended without results.

use coupling::error::CouplingError;
use thiserror::Error;

use crate::output::OutputError;

/// What stops a command.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CommandError {
    /// There are no results.
    #[error(transparent)]
    Coupling(#[from] CouplingError),
    /// What stops one leg of a trial of both.
    #[error("{side} leg: {source}")]
    OfLeg {
        /// `right` or `left`.
        side: &'static str,
        /// Why.
        source: Box<CouplingError>,
    },
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// What the command line says cannot be.
    #[error("{0}")]
    Option(String),
}

impl CommandError {
    /// Exit code of the process: 3 where a solver failed, 2 for bad input.
    pub fn exit_code(&self) -> u8 {
        match self {
            CommandError::Coupling(source) => source.exit_code(),
            CommandError::OfLeg { source, .. } => source.exit_code(),
            _ => 2,
        }
    }
}

/// What is read for a command alone stops it as it would stop a scene.
macro_rules! as_of_a_scene {
    ($($source:ty),+) => {
        $(impl From<$source> for CommandError {
            fn from(source: $source) -> CommandError {
                CommandError::Coupling(source.into())
            }
        })+
    };
}

as_of_a_scene!(
    multibody::InputError,
    multibody::model::ModelError,
    fem::mesh::MeshError,
    mesher::from_surface::SectionError
);
