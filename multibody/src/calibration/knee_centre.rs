//! The knee centre of a functional calibration, corrected for the motion of skin.
//!
//! Skin slides along the thigh as the knee bends. A rotation by a small angle φ with a slide s φ along the thigh looks like the same rotation
//! about an axis that is s farther forward, so the residual of the calibration does not show it. On subject DM, whose knee centre is tabulated, the
//! functional axis lies 11 mm too far forward and 11 mm too far up; on JW 11 mm too far forward.
//!
//! The distance from the knee centre to a marker on the patella, along the forward axis of the thigh with the knee nearly straight, does not
//! hang on that slide. It is taken as a fraction of the length of the leg, or as measured on the subject, and the centre is moved along the forward axis.
//! A slide *across* the thigh moves the axis up or down instead; that is not corrected.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

/// Which knee centre a functional calibration takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KneeCentre {
    /// On the axis of rotation as found.
    AsFound,
    /// Moved along the forward axis of the thigh to this distance from the patella marker \[m\]; `None`: [`DISTANCE`] lengths of the leg.
    ByPatella(Option<f64>),
}

/// Distance from knee centre to patella marker along the forward axis, in lengths of the leg (thigh and shank, which do not change where the knee
/// centre is put along the leg): 70.6 mm of 822.3 mm in the three recordings of subject DM with the tabulated knee centre (72, 70 and 70 mm).
/// Two sets of bone surfaces bracket it: 50 and 65 mm of bone in front of the midpoint of the epicondyles or of the collateral ligaments'
/// attachments, and some 12 mm of skin and marker.
pub const DISTANCE: f64 = 0.0859;
/// The knee is nearly straight within this angle from its straightest frame \[rad\].
const NEARLY_STRAIGHT: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// A correction beyond this is more than skin explains \[m\]: thigh clusters slide by some 18 mm and deform by up to 16 mm (fluoroscopy,
/// PMC8631460).
pub const PLAUSIBLE: f64 = 0.034;

/// What became of a knee centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// Distance to the patella marker along the forward axis before the correction \[m\].
    pub found: f64,
    /// The distance that was asked for \[m\].
    pub distance: f64,
    /// Knee centre in the thigh after it \[m\].
    pub knee: Vector3<f64>,
}

impl Correction {
    /// How far backward the centre was moved \[m\].
    pub fn moved(&self) -> f64 {
        self.distance - self.found
    }
}

/// One frame of the calibration: shank and patella marker in the thigh \[m\].
pub struct Frame {
    /// Rotation and origin of the shank.
    pub shank: (Matrix3<f64>, Vector3<f64>),
    /// The marker on the patella.
    pub patella: Option<Vector3<f64>>,
}

/// Moves `knee`, a point of the axis `w` (to the right), backward from the patella marker; all in the thigh \[m\]. `shank`: length of the shank \[m\].
/// `None` where no nearly straight
/// frame shows the marker.
pub fn correct(
    frames: &[Frame],
    hip: &Vector3<f64>,
    knee: &Vector3<f64>,
    w: &Vector3<f64>,
    shank: f64,
    distance: Option<f64>,
) -> Option<Correction> {
    let first = frames.first()?.shank.0;
    // Flexion turns the shank about −w.
    let flexion: Vec<f64> = frames
        .iter()
        .map(|f| {
            let turn = nalgebra::Rotation3::from_matrix_unchecked(f.shank.0 * first.transpose());
            -turn.scaled_axis().dot(w)
        })
        .collect();
    let straightest = flexion.iter().copied().fold(f64::INFINITY, f64::min);
    let straight = frames.iter().zip(&flexion).filter(|(_, a)| **a <= straightest + NEARLY_STRAIGHT);
    let seen: Vec<Vector3<f64>> = straight.filter_map(|(f, _)| f.patella).collect();
    if seen.is_empty() {
        return None;
    }
    let patella = seen.iter().sum::<Vector3<f64>>() / seen.len() as f64;
    let forward = |knee: &Vector3<f64>| (hip - knee).cross(w).normalize();
    let found = (patella - knee).dot(&forward(knee));
    let mut moved = *knee;
    let mut wanted = found;
    // The forward axis turns a little as the centre moves along it.
    for _ in 0..PASSES {
        wanted = distance.unwrap_or(DISTANCE * ((hip - moved).norm() + shank));
        let x = forward(&moved);
        moved += ((patella - moved).dot(&x) - wanted) * x;
    }
    Some(Correction { found, distance: wanted, knee: moved })
}

/// Passes of moving and turning; each leaves a thousandth of the error of the one before.
const PASSES: usize = 6;

/// The centre in the shank: where the centre of the thigh is in the mean of all frames.
pub fn in_shank(frames: &[Frame], knee: &Vector3<f64>) -> Vector3<f64> {
    let sum: Vector3<f64> = frames.iter().map(|f| f.shank.0.transpose() * (knee - f.shank.1)).sum();
    sum / frames.len() as f64
}
