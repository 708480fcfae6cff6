//! Recorded files: markers, analog channels, force plates, tables over time.
//!
//! This is the only place where millimetres, N·mm and degrees exist. What leaves it is SI, in the axes of the
//! file. Gaps stay gaps. A count in a header is believed only after it was compared with the length of the file.

mod bytes;
pub mod c3d;
mod check;
mod knee_forces;
mod parameters;
mod plate;
mod series;
mod text;
mod trc;

use std::path::Path;

use nalgebra::Vector3;

pub use check::check;
use knee_forces::is_knee_forces;
pub use knee_forces::{KneeForces, read_knee_forces};
pub use parameters::{Parameter, Parameters, Values};
pub use plate::{ForcePlate, PlateLoad};
pub use series::{TimeSeries, parse_series, read_series};
pub(crate) use text::decode;
pub use text::with_plain_ends;
pub use trc::{parse_trc, read_trc};

use crate::error::{InputError, Place};

/// No laboratory is larger \[m\].
const LARGEST_POSITION: f64 = 1e4;
/// Fastest sampling that is believed \[Hz\].
const LARGEST_RATE: f64 = 1e6;

/// Paths of markers, in the axes of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MarkerRecording {
    /// One name per marker.
    pub names: Vec<String>,
    /// Frames per second \[Hz\].
    pub rate_hz: f64,
    /// Number of the first frame, as the file counts.
    pub first_frame: usize,
    /// Time of each frame \[s\].
    pub time: Vec<f64>,
    /// Position \[m\] by marker, then frame; `None` where not seen.
    pub position: Vec<Vec<Option<Vector3<f64>>>>,
    /// Unit of length written in the file, e.g. `mm`.
    pub file_unit: String,
}

impl MarkerRecording {
    /// Index of a marker.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Takes exact zeros for gaps.
    pub fn zeros_to_gaps(&mut self) {
        for place in self.position.iter_mut().flatten() {
            if *place == Some(Vector3::zeros()) {
                *place = None;
            }
        }
    }
}

/// Channels sampled together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnalogRecording {
    /// One name per channel.
    pub names: Vec<String>,
    /// SI unit of each channel (`N`, `N m`, `V`, …); an unknown unit stays as written.
    pub units: Vec<String>,
    /// Samples per second \[Hz\].
    pub rate_hz: f64,
    /// Time of each sample \[s\].
    pub time: Vec<f64>,
    /// Values by channel, then sample, in `units`.
    pub values: Vec<Vec<f64>>,
}

impl AnalogRecording {
    /// Index of a channel.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }
}

/// Reads markers from a C3D or TRC file, by its ending.
pub fn read_markers(path: &Path) -> Result<MarkerRecording, InputError> {
    match ending(path).as_str() {
        "c3d" => Ok(c3d::read(path)?.markers),
        "trc" => read_trc(path),
        _ => Err(InputError::UnknownKind { file: path.to_path_buf(), wanted: ".c3d, .trc" }),
    }
}

/// Lower-case ending of a file name.
pub(crate) fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The whole of a regular file, or of a shipped one. A pipe or device, which may never end, is refused.
pub(crate) fn file_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    if let Some(text) = crate::shipped::text(path) {
        return Ok(text.into());
    }
    let io = |source| InputError::Io { file: path.to_path_buf(), source };
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(io(std::io::Error::other("not a regular file")));
    }
    std::fs::read(path).map_err(io)
}

/// Metres per unit of length.
pub(crate) fn metres_per(unit: &str) -> Option<f64> {
    match unit.trim().to_lowercase().as_str() {
        "m" | "meter" | "meters" | "metre" | "metres" => Some(1.0),
        "cm" => Some(1e-2),
        "mm" | "millimeters" | "millimetres" => Some(1e-3),
        _ => None,
    }
}

fn malformed(file: &Path, at: Place, problem: impl Into<String>, remedy: impl Into<String>) -> InputError {
    InputError::Malformed { file: file.to_path_buf(), at, problem: problem.into(), remedy: remedy.into() }
}
