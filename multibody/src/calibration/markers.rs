//! Landmarks from landmark markers, in a static trial or in the trial itself.

#![allow(non_snake_case)]

use nalgebra::Vector3;

use super::clusters::{mean_cluster, mean_local, pose};
use super::shifts::Shifts;
use super::{CalibrationError, HipCentre, Path, Spines, apart, pelvis};
use crate::anatomy::{Anatomy, Cluster, FootAxes, ShankAxes, ThighAxes};
use crate::natural::{Pose, SegmentId};
use crate::trial::{MarkerTrack, Sex};

/// Landmark markers of the leg under study, in ground \[m\].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LandmarkPaths {
    /// Pelvis.
    pub spines: Spines,
    /// Lateral epicondyle of the femur.
    pub lateral_epicondyle: Path,
    /// Medial epicondyle of the femur.
    pub medial_epicondyle: Path,
    /// Lateral malleolus.
    pub lateral_malleolus: Path,
    /// Medial malleolus.
    pub medial_malleolus: Path,
    /// Heel.
    pub heel: Path,
    /// Head of metatarsal 1.
    pub metatarsal_1: Path,
    /// Head of metatarsal 5.
    pub metatarsal_5: Path,
}

/// Anatomy from landmark markers.
///
/// `tracks`: the tracking markers in the same recording. The shank's forward axis is normal to its long axis and to the
/// epicondyle axis in the frames where the knee is most extended (all frames of a standing trial), so that thigh
/// and shank frames agree at extension, which the knee model expects.
pub fn anatomy(
    tracks: &[MarkerTrack],
    landmarks: &LandmarkPaths,
    hip: HipCentre,
    sex: Sex,
    shifts: &Shifts,
) -> Result<Anatomy, CalibrationError> {
    use SegmentId::{Foot, Pelvis, Shank, Thigh};
    let mut clusters: [Cluster; 5] = Default::default();
    for segment in [Foot, Shank, Thigh, Pelvis] {
        clusters[segment.index()] =
            mean_cluster(&[tracks], segment).ok_or(CalibrationError::Cluster { segment: segment.name() })?;
    }
    let n = tracks.iter().map(|t| t.position.len()).min().unwrap_or(0);
    let local = |segment: SegmentId, path: &Path, landmark, frames: &[usize]| {
        mean_local(&clusters[segment.index()], tracks, segment, path, frames.iter().copied())
            .map(|mean| mean + shifts.of(landmark))
            .ok_or(CalibrationError::Landmark { landmark, segment: segment.name() })
    };
    let all: Vec<usize> = (0..n).collect();
    let pelvis_axes = pelvis(&clusters[Pelvis.index()], tracks, &landmarks.spines, hip, sex, shifts)?;
    let lateral = local(Thigh, &landmarks.lateral_epicondyle, "lateral_epicondyle", &all)?;
    let medial = local(Thigh, &landmarks.medial_epicondyle, "medial_epicondyle", &all)?;
    apart(("lateral_epicondyle", &lateral), ("medial_epicondyle", &medial), 0.03)?;
    let thigh = ThighAxes { knee: 0.5 * (lateral + medial), w: (lateral - medial).normalize() };

    let lateral_malleolus = local(Shank, &landmarks.lateral_malleolus, "lateral_malleolus", &all)?;
    let medial_malleolus = local(Shank, &landmarks.medial_malleolus, "medial_malleolus", &all)?;
    apart(("lateral_malleolus", &lateral_malleolus), ("medial_malleolus", &medial_malleolus), 0.03)?;
    let ankle = 0.5 * (lateral_malleolus + medial_malleolus);
    let straight = most_extended(tracks, &clusters, &pelvis_axes.hip, &thigh.knee, &ankle, n);
    let carried_lateral = local(Shank, &landmarks.lateral_epicondyle, "lateral_epicondyle", &straight)?;
    let carried_medial = local(Shank, &landmarks.medial_epicondyle, "medial_epicondyle", &straight)?;
    let knee = 0.5 * (carried_lateral + carried_medial);
    let shank = ShankAxes {
        knee,
        ankle,
        u: (knee - ankle).cross(&(carried_lateral - carried_medial)).normalize(),
        w: (lateral_malleolus - medial_malleolus).normalize(),
    };

    let ankle_path: Path =
        (0..n).map(|k| pose(&clusters[Shank.index()], tracks, Shank, k).map(|s| s.p + s.R * ankle)).collect();
    let foot = foot(
        local(Foot, &ankle_path, "ankle centre", &all)?,
        local(Foot, &landmarks.heel, "heel", &all)?,
        local(Foot, &landmarks.metatarsal_1, "metatarsal_1", &all)?,
        local(Foot, &landmarks.metatarsal_5, "metatarsal_5", &all)?,
    )?;
    Ok(Anatomy { clusters, pelvis: pelvis_axes, thigh, shank, foot })
}

/// Foot landmarks from local positions.
pub(crate) fn foot(
    ankle: Vector3<f64>,
    heel: Vector3<f64>,
    metatarsal_1: Vector3<f64>,
    metatarsal_5: Vector3<f64>,
) -> Result<FootAxes, CalibrationError> {
    let toe = 0.5 * (metatarsal_1 + metatarsal_5);
    apart(("metatarsal_1", &metatarsal_1), ("metatarsal_5", &metatarsal_5), 0.02)?;
    apart(("heel", &heel), ("the midpoint of the metatarsal heads", &toe), 0.05)?;
    Ok(FootAxes { ankle, toe, u: (toe - heel).normalize(), w: (metatarsal_5 - metatarsal_1).normalize() })
}

/// Frames within 5 degrees of the straightest knee (angle hip - knee - ankle).
fn most_extended(
    tracks: &[MarkerTrack],
    clusters: &[Cluster; 5],
    hip: &Vector3<f64>,
    knee: &Vector3<f64>,
    ankle: &Vector3<f64>,
    n: usize,
) -> Vec<usize> {
    let at = |segment: SegmentId, point: &Vector3<f64>, frame: usize| {
        let Pose { R, p } = pose(&clusters[segment.index()], tracks, segment, frame)?;
        Some(p + R * point)
    };
    let bend: Vec<Option<f64>> = (0..n)
        .map(|k| {
            let (hip, knee) = (at(SegmentId::Pelvis, hip, k)?, at(SegmentId::Thigh, knee, k)?);
            Some((hip - knee).angle(&(knee - at(SegmentId::Shank, ankle, k)?)))
        })
        .collect();
    let least = bend.iter().flatten().fold(f64::INFINITY, |m, v| m.min(*v));
    (0..n).filter(|&k| bend[k].is_some_and(|b| b <= least + 5f64.to_radians())).collect()
}
