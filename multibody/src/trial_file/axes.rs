//! From the axes of a recording to ground: X forward, Y up, Z right.

use std::fmt;

use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

/// An axis of the recording with its sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[allow(missing_docs)]
pub enum SignedAxis {
    #[serde(rename = "x")]
    X,
    #[serde(rename = "y")]
    Y,
    #[serde(rename = "z")]
    Z,
    #[serde(rename = "-x")]
    MinusX,
    #[serde(rename = "-y")]
    MinusY,
    #[serde(rename = "-z")]
    MinusZ,
}

impl SignedAxis {
    /// Unit vector in the recording.
    pub fn direction(self) -> Vector3<f64> {
        match self {
            SignedAxis::X => Vector3::x(),
            SignedAxis::Y => Vector3::y(),
            SignedAxis::Z => Vector3::z(),
            SignedAxis::MinusX => -Vector3::x(),
            SignedAxis::MinusY => -Vector3::y(),
            SignedAxis::MinusZ => -Vector3::z(),
        }
    }
}

impl fmt::Display for SignedAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = self.direction();
        write!(f, "{}{}", if d.sum() < 0.0 { "-" } else { "" }, ["x", "y", "z"][d.iamax()])
    }
}

/// The axis of the recording that is ground X, Y and Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Forward.
    pub x: SignedAxis,
    /// Up.
    pub y: SignedAxis,
    /// To the right.
    pub z: SignedAxis,
}

impl Default for Axes {
    /// The axes of the recording are those of ground.
    fn default() -> Self {
        Self { x: SignedAxis::X, y: SignedAxis::Y, z: SignedAxis::Z }
    }
}

impl Axes {
    /// Maps vectors of the recording to ground. A rotation where the axes are a right-handed set.
    pub fn rotation(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[self.x.direction(), self.y.direction(), self.z.direction()]).transpose()
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "x = {}, y = {}, z = {}", self.x, self.y, self.z)
    }
}
