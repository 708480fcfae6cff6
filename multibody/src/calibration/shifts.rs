//! Landmarks that sit elsewhere than their source says: how uncertain palpation enters a study.

use std::collections::BTreeMap;

use nalgebra::Vector3;

/// Landmarks that can be shifted, as the trial file names them, and the hip centre.
pub const LANDMARKS: [&str; 12] = [
    "right_asis",
    "left_asis",
    "right_psis",
    "left_psis",
    "hip_centre",
    "lateral_epicondyle",
    "medial_epicondyle",
    "lateral_malleolus",
    "medial_malleolus",
    "heel",
    "metatarsal_1",
    "metatarsal_5",
];

/// Shifts of landmarks in the local frame of the markers of their segment \[m\]. What follows from a landmark (an axis, the middle between two) moves
/// along; markers of the fit stay where they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shifts(BTreeMap<&'static str, Vector3<f64>>);

impl Shifts {
    /// No landmark is shifted.
    pub fn none() -> Shifts {
        Shifts::default()
    }

    /// Adds to the shift of a landmark; `false` where there is none of that name.
    pub fn add(&mut self, landmark: &str, shift: Vector3<f64>) -> bool {
        let known = LANDMARKS.iter().find(|name| **name == landmark);
        known.map(|name| *self.0.entry(name).or_default() += shift).is_some()
    }

    /// Whether no landmark is shifted.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Shift of a landmark \[m\].
    pub fn of(&self, landmark: &str) -> Vector3<f64> {
        self.0.get(landmark).copied().unwrap_or_default()
    }

    /// Shift of the middle between two landmarks \[m\].
    pub fn between(&self, a: &str, b: &str) -> Vector3<f64> {
        0.5 * (self.of(a) + self.of(b))
    }
}
