//! Unit of length and axes of a recording, from where the leg and the pelvis are and go.

use nalgebra::Vector3;

use crate::read::MarkerRecording;
use crate::trial_file::{Axes, LengthUnit, SignedAxis};

/// A person with or without arms spans this at least and at most \[m\].
const SPAN: std::ops::Range<f64> = 0.3..3.0;
/// A walk that is longer than this tells the direction of walking \[m\].
const LEAST_TRAVEL: f64 = 0.3;

/// Mean place of named markers in each frame.
pub(super) fn centre(recording: &MarkerRecording, names: &[&str]) -> Vec<Option<Vector3<f64>>> {
    let paths: Vec<_> = names.iter().filter_map(|n| Some(&recording.position[recording.index(n)?])).collect();
    (0..recording.time.len())
        .map(|frame| {
            let seen: Vec<_> = paths.iter().filter_map(|p| p[frame]).collect();
            (!seen.is_empty()).then(|| seen.iter().sum::<Vector3<f64>>() / seen.len() as f64)
        })
        .collect()
}

/// The unit that the numbers are in, where it is not the one that the recording claims.
pub(super) fn unit(recording: &MarkerRecording) -> Option<LengthUnit> {
    let n = recording.time.len();
    let mut spans: Vec<f64> = (0..n)
        .step_by(n.div_ceil(20).max(1))
        .map(|frame| {
            let seen: Vec<_> =
                recording.position.iter().filter_map(|p| p[frame]).filter(|p| p.norm() > 0.0).collect();
            let pairs =
                seen.iter().enumerate().flat_map(|(i, a)| seen[i + 1..].iter().map(move |b| (a - b).norm()));
            pairs.fold(0.0, f64::max)
        })
        .filter(|s| *s > 0.0)
        .collect();
    spans.sort_by(f64::total_cmp);
    let span = *spans.get(spans.len() / 2)?;
    if SPAN.contains(&span) {
        return None;
    }
    let claimed = crate::read::metres_per(&recording.file_unit).unwrap_or(1.0);
    let units = [(LengthUnit::M, 1.0), (LengthUnit::Mm, 1e-3), (LengthUnit::Cm, 1e-2)];
    units.into_iter().find(|(_, metres)| SPAN.contains(&(span / claimed * metres))).map(|u| u.0)
}

/// Axes that point forward, up and right, and why; `None` where pelvis or feet are not seen.
pub(super) fn axes(
    pelvis: &[Option<Vector3<f64>>],
    foot: &[Option<Vector3<f64>>],
    back_to_front: Option<Vector3<f64>>,
) -> Option<(Axes, String)> {
    let offsets: Vec<Vector3<f64>> =
        pelvis.iter().zip(foot).filter_map(|(p, f)| Some((*p)? - (*f)?)).collect();
    let up = along(offsets.iter().sum::<Vector3<f64>>() / offsets.len().max(1) as f64)?;
    let mut seen = pelvis.iter().flatten();
    let travel = seen.next().zip(seen.next_back()).map_or(Vector3::zeros(), |(first, last)| last - first);
    let level = |v: Vector3<f64>| v - up.direction() * v.dot(&up.direction());
    let (forward, why) = match (level(travel), back_to_front.map(level)) {
        (travel, _) if travel.norm() > LEAST_TRAVEL => {
            (travel, format!("the pelvis travels {:.2} m that way", travel.norm()))
        }
        (_, Some(front)) => (front, "from PSIS to ASIS; the subject stands".to_string()),
        _ => return None,
    };
    let x = along(forward)?;
    let z = along(x.direction().cross(&up.direction()))?;
    Some((Axes { x, y: up, z }, why))
}

/// The axis that a direction is nearest to.
fn along(direction: Vector3<f64>) -> Option<SignedAxis> {
    use SignedAxis::*;
    let all = [X, Y, Z, MinusX, MinusY, MinusZ];
    let best = all
        .into_iter()
        .max_by(|a, b| a.direction().dot(&direction).total_cmp(&b.direction().dot(&direction)))?;
    (direction.norm() > 0.0).then_some(best)
}
