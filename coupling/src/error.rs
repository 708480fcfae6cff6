//! Why a run ended without results: mostly the input.

use multibody::InputError;
use multibody::calibration::CalibrationError;
use multibody::model::ModelError;
use multibody::muscle::hill::HillError;
use multibody::sharing::SharingError;
use thiserror::Error;

use crate::measured::MeasuredError;

/// What stops `optimize`, `solve`, or a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CouplingError {
    /// A file cannot be used.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Landmarks cannot be had.
    #[error("landmarks of `{trial}`: {source}")]
    Calibration {
        /// Trial.
        trial: String,
        /// Why.
        source: CalibrationError,
    },
    /// The leg cannot be built.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The force-sharing problem is malformed.
    #[error("force sharing: {0}")]
    Sharing(#[from] SharingError),
    /// Activations cannot be computed.
    #[error("activations: {0}")]
    Hill(#[from] HillError),
    /// The measured forces do not fit the trial.
    #[error(transparent)]
    Measured(#[from] MeasuredError),
    /// A mesh or its input cannot be used.
    #[error(transparent)]
    Mesh(#[from] fem::mesh::MeshError),
    /// A surface cannot be used.
    #[error(transparent)]
    Surface(#[from] fem::geometry::SurfaceError),
    /// A scene of bodies of one's own cannot be planned.
    #[error("scene `{}`: {source}", file.display())]
    Plan {
        /// The file.
        file: std::path::PathBuf,
        /// All that is wrong.
        source: fem::plan::SceneError,
    },
    /// The table that drives it cannot be used.
    #[error(transparent)]
    Drive(#[from] fem::drive::DriveError),
    /// Surfaces that give no sections.
    #[error(transparent)]
    Sections(#[from] mesher::from_surface::SectionError),
    /// An option contradicts the trial.
    #[error("{0}")]
    Option(String),
    /// All that is wrong with several files.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Several(Vec<CouplingError>),
    /// The input is good, but something on the way to the results found no solution.
    #[error("{0}")]
    NotConverged(String),
}

impl CouplingError {
    /// Exit code of the process: 3 where a solver failed, 2 for bad input.
    pub fn exit_code(&self) -> u8 {
        match self {
            CouplingError::NotConverged(_) => 3,
            _ => 2,
        }
    }
}

/// Mistakes of an input that are told all at once.
#[derive(Default)]
pub(crate) struct Mistakes(Vec<CouplingError>);

impl Mistakes {
    /// Notes one, or all of several.
    pub fn note(&mut self, error: CouplingError) {
        match error {
            CouplingError::Several(all) => self.0.extend(all),
            one => self.0.push(one),
        }
    }

    /// Notes why there is no value.
    pub fn keep<T, E: Into<CouplingError>>(&mut self, result: Result<T, E>) -> Option<T> {
        result.map_err(|error| self.note(error.into())).ok()
    }

    /// An error where something was noted.
    pub fn finish(mut self) -> Result<(), CouplingError> {
        match self.0.len() {
            0 => Ok(()),
            1 => Err(self.0.remove(0)),
            _ => Err(CouplingError::Several(self.0)),
        }
    }
}
