//! The knee centre of a functional calibration, corrected for the motion of skin.
//!
//! Skin slides on the thigh as the knee bends. A rotation by a small angle φ with a slide s φ looks like the same rotation about another axis: a slide along
//! the thigh moves it forward by s, one across the thigh moves it along the thigh. So the residual of the calibration does not show it. On subject DM,
//! whose knee centre is tabulated, the functional axis lies 11 mm too far forward and 11 mm too far up.
//!
//! A marker on the patella with the knee straight does not hang on that slide. The centre is put where it is from that marker in a
//! subject whose knee centre is known: backward along the forward axis of the thigh, and up along the thigh, in lengths of the thigh. The direction of the
//! axis, and the place along it, stay those of the motion.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

/// Which knee centre a functional calibration takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KneeCentre {
    /// On the axis of rotation as found.
    AsFound,
    /// Moved in the sagittal plane of the thigh to its place behind the patella marker: this distance along the forward axis \[m\], `None`:
    /// [`DISTANCE`] lengths of the thigh; and [`HEIGHT`].
    ByPatella(Option<f64>),
}

/// Distance from knee centre to patella marker along the forward axis in the straight knee, in lengths of the thigh (hip to knee): 74.4 mm of 418.9 mm,
/// the mean of three recordings of subject DM with the tabulated knee centre. The shank does not count: its length hangs on a functional ankle axis, which the
/// built-in walker shows to be off by 34 mm. Two sets of bone surfaces say a little less: 50 and 61 mm of bone in front of the midpoint of the epicondyles or
/// of the collateral ligaments' attachments, and some 12 mm of skin and marker.
pub const DISTANCE: f64 = 0.1776;
/// Height of the knee centre above the patella marker in the straight knee, in lengths of the thigh: 3.8 mm, from the same recordings. Of one set of
/// bone surfaces it is 5 mm, between the centroid of the patella and the collateral ligaments' attachments.
pub const HEIGHT: f64 = 0.0091;
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
    /// How far the centre was moved backward and down \[m\].
    pub moved: [f64; 2],
    /// Knee centre in the thigh after it \[m\].
    pub knee: Vector3<f64>,
}

impl Correction {
    /// Whether skin explains it.
    pub fn is_plausible(&self) -> bool {
        self.moved[0].hypot(self.moved[1]) <= PLAUSIBLE
    }
}

/// One frame of the calibration: shank and patella marker in the thigh \[m\].
pub struct Frame {
    /// Rotation and origin of the shank.
    pub shank: (Matrix3<f64>, Vector3<f64>),
    /// The marker on the patella.
    pub patella: Option<Vector3<f64>>,
}

/// Place of the patella marker in the thigh with the knee as straight as it gets \[m\]: a straight line over flexion through the nearly straight frames,
/// where it ends. Over so few degrees both the slide of the skin and the way of the patella are in proportion to flexion, so neither is left at
/// that end; their mean would hold half of what they do in [`NEARLY_STRAIGHT`]. `None` where no nearly straight frame shows the marker.
fn patella_of_straight_knee(frames: &[Frame], w: &Vector3<f64>) -> Option<Vector3<f64>> {
    let first = frames.first()?.shank.0;
    // Flexion turns the shank about −w.
    let flexion = |f: &Frame| {
        let turn = nalgebra::Rotation3::from_matrix_unchecked(f.shank.0 * first.transpose());
        -turn.scaled_axis().dot(w)
    };
    let all: Vec<f64> = frames.iter().map(flexion).collect();
    let straightest = all.iter().copied().fold(f64::INFINITY, f64::min);
    let seen: Vec<(f64, Vector3<f64>)> = (frames.iter().zip(&all))
        .map(|(f, angle)| (angle - straightest, f.patella))
        .filter(|(angle, _)| *angle <= NEARLY_STRAIGHT)
        .filter_map(|(angle, patella)| Some((angle, patella?)))
        .collect();
    if seen.is_empty() {
        return None;
    }
    let n = seen.len() as f64;
    let angle = seen.iter().map(|s| s.0).sum::<f64>() / n;
    let place = seen.iter().map(|s| s.1).sum::<Vector3<f64>>() / n;
    let spread: f64 = seen.iter().map(|s| (s.0 - angle).powi(2)).sum();
    let along: Vector3<f64> = seen.iter().map(|s| (s.0 - angle) * s.1).sum();
    // Frames of a single angle are at the end of their line.
    Some(if spread > 0.0 { place - angle * along / spread } else { place })
}

/// Moves `knee`, a point of the axis `w` (to the right), to its place behind the patella marker; all in the thigh \[m\].
/// `None` where no nearly straight frame shows the marker.
pub fn correct(
    frames: &[Frame],
    hip: &Vector3<f64>,
    knee: &Vector3<f64>,
    w: &Vector3<f64>,
    distance: Option<f64>,
) -> Option<Correction> {
    let patella = patella_of_straight_knee(frames, w)?;
    // Forward, and up along the thigh, both normal to the axis.
    let axes = |knee: &Vector3<f64>| {
        let forward = (hip - knee).cross(w).normalize();
        [forward, w.cross(&forward).normalize()]
    };
    let [forward, up] = axes(knee);
    let found = (patella - knee).dot(&forward);
    let mut moved = *knee;
    let mut wanted = found;
    // The axes turn a little as the centre moves.
    for _ in 0..PASSES {
        let thigh = (hip - moved).norm();
        wanted = distance.unwrap_or(DISTANCE * thigh);
        let [x, y] = axes(&moved);
        let gap = patella - moved;
        moved += (gap.dot(&x) - wanted) * x + (gap.dot(&y) + HEIGHT * thigh) * y;
    }
    let way = moved - knee;
    Some(Correction { found, distance: wanted, moved: [-way.dot(&forward), -way.dot(&up)], knee: moved })
}

/// Passes of moving and turning; each leaves a thousandth of the error of the one before.
const PASSES: usize = 6;

/// The centre in the shank: where the centre of the thigh is in the mean of all frames.
pub fn in_shank(frames: &[Frame], knee: &Vector3<f64>) -> Vector3<f64> {
    let sum: Vector3<f64> = frames.iter().map(|f| f.shank.0.transpose() * (knee - f.shank.1)).sum();
    sum / frames.len() as f64
}
