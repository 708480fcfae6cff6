//! Landmarks from motion: the knee axis is the mean axis of rotation of the shank in the thigh, the ankle axis that of the
//! foot in the shank (symmetrical axis of rotation, Ehrig et al. 2007, J Biomech 40:2150). For recordings without epicondyle and
//! malleolus markers.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::clusters::{mean_cluster, mean_local, pose};
use super::knee_centre::{Correction, Frame, KneeCentre, correct, in_shank};
use super::markers::foot;
use super::shifts::Shifts;
use super::{CalibrationError, HipCentre, Path, Spines, apart, into_local, pelvis, relative};
use crate::anatomy::{Anatomy, Cluster, ShankAxes, ThighAxes};
use crate::natural::{Pose, SegmentId};
use crate::trial::{MarkerTrack, Sex};

/// Least range of motion of a functional axis \[deg\].
const NEEDED_RANGE: f64 = 15.0;

/// One recording of the calibration: tracking markers and the landmarks that do have markers, all in ground \[m\].
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Tracking markers.
    pub tracks: Vec<MarkerTrack>,
    /// Pelvis.
    pub spines: Spines,
    /// Marker on the patella: places the knee centre along its axis. Empty when there is none.
    pub patella: Path,
    /// Heel.
    pub heel: Path,
    /// Head of metatarsal 1.
    pub metatarsal_1: Path,
    /// Head of metatarsal 5.
    pub metatarsal_5: Path,
}

/// Quality of a functional calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Root mean square distance of the knee axis points of thigh and shank \[m\].
    pub knee_rms: f64,
    /// Range of knee angles \[rad\].
    pub knee_range: f64,
    /// The same for the ankle axis \[m\].
    pub ankle_rms: f64,
    /// Range of ankle angles \[rad\].
    pub ankle_range: f64,
    /// How the knee centre was corrected for the motion of skin; `None` where it was not asked for, or there is no patella marker.
    pub knee_centre: Option<Correction>,
}

/// Anatomy from the motion in all recordings together.
pub fn anatomy(
    recordings: &[Recording],
    hip: HipCentre,
    knee_centre: KneeCentre,
    sex: Sex,
    shifts: &Shifts,
) -> Result<(Anatomy, Quality), CalibrationError> {
    use SegmentId::{Foot, Pelvis, Shank, Thigh};
    let tracks: Vec<&[MarkerTrack]> = recordings.iter().map(|r| r.tracks.as_slice()).collect();
    let mut clusters: [Cluster; 5] = Default::default();
    for segment in [Foot, Shank, Thigh, Pelvis] {
        clusters[segment.index()] =
            mean_cluster(&tracks, segment).ok_or(CalibrationError::Cluster { segment: segment.name() })?;
    }
    let local = |segment: SegmentId, path: fn(&Recording) -> &Path, landmark| {
        let means: Vec<Vector3<f64>> = recordings
            .iter()
            .filter_map(|r| {
                let path = path(r);
                mean_local(&clusters[segment.index()], &r.tracks, segment, path, 0..path.len())
            })
            .collect();
        let n = means.len() as f64;
        (n > 0.0)
            .then(|| means.iter().sum::<Vector3<f64>>() / n + shifts.of(landmark))
            .ok_or(CalibrationError::Landmark { landmark, segment: segment.name() })
    };
    let first = &recordings[0];
    let pelvis_axes = pelvis(&clusters[Pelvis.index()], &first.tracks, &first.spines, hip, sex, shifts)?;

    let knee = Axis::fit(recordings, &clusters, Thigh, Shank, "knee")?;
    let ankle = Axis::fit(recordings, &clusters, Shank, Foot, "ankle")?;
    let heel = local(Foot, |r| &r.heel, "heel")?;
    let metatarsals = (
        local(Foot, |r| &r.metatarsal_1, "metatarsal_1")?,
        local(Foot, |r| &r.metatarsal_5, "metatarsal_5")?,
    );
    apart(("metatarsal_1", &metatarsals.0), ("metatarsal_5", &metatarsals.1), 0.02)?;
    // To the right of the walker: along the line from metatarsal head 1 to 5, and of the pelvis.
    let lateral_in_foot = (metatarsals.1 - metatarsals.0).normalize();
    let ankle = ankle.pointing(&lateral_in_foot, false);
    // The ankle centre lies in the sagittal plane of the foot through heel and metatarsals.
    let toe = 0.5 * (metatarsals.0 + metatarsals.1);
    let along = (toe - heel).normalize();
    let normal = (lateral_in_foot - along * lateral_in_foot.dot(&along)).normalize();
    let shift = (heel - ankle.distal_point).dot(&normal) / ankle.distal.dot(&normal);
    let on_talocrural = ankle.proximal_point + shift * ankle.proximal;

    let pelvis_right = mean_direction(recordings, &clusters, Pelvis, Thigh, &pelvis_axes.w);
    let knee = knee.pointing(&pelvis_right, true);
    let on_axis = match local(Thigh, |r| &r.patella, "patella") {
        Ok(patella) => (patella - knee.proximal_point).dot(&knee.proximal),
        // Without a patella marker: the point nearest to the line from hip to ankle.
        Err(_) => nearest_to_leg_line(recordings, &clusters, &knee, &pelvis_axes.hip, &on_talocrural),
    };
    // The model counts the shank to the midpoint of the malleoli; its talocrural axis lies farther down (`joints.csv`).
    let below = crate::tables::JointTable::built_in().point("ankle_universal", "joint point on shank");
    let stretch = 1.0 - below.y / crate::joint::GENERIC_SHANK;
    let mut knee_in_thigh = knee.proximal_point + on_axis * knee.proximal;
    let mut knee_in_shank = knee.distal_point + on_axis * knee.distal;
    let mut correction = None;
    if let KneeCentre::ByPatella(distance) = knee_centre {
        let seen = knee_frames(recordings, &clusters);
        let hip = mean_point(recordings, &clusters, &pelvis_axes.hip);
        correction = correct(&seen, &hip, &knee_in_thigh, &knee.proximal, distance);
        if let Some(correction) = &correction {
            knee_in_thigh = correction.knee;
            knee_in_shank = in_shank(&seen, &knee_in_thigh);
        }
    }
    let ankle_in_shank = knee_in_shank + (on_talocrural - knee_in_shank) / stretch;
    let carried: Vec<Vector3<f64>> = frames(recordings, &clusters, Foot, Shank)
        .map(|(foot, shank)| relative(&foot, &shank))
        .map(|(R, t)| R * ankle_in_shank + t)
        .collect();
    let ankle_in_foot = carried.iter().sum::<Vector3<f64>>() / carried.len() as f64;
    let thigh = ThighAxes { knee: knee_in_thigh, w: knee.proximal };
    let shank = ShankAxes {
        knee: knee_in_shank,
        ankle: ankle_in_shank,
        u: (knee_in_shank - ankle_in_shank).cross(&knee.distal).normalize(),
        w: ankle.proximal,
    };
    let foot = foot(ankle_in_foot, heel, metatarsals.0, metatarsals.1)?;
    let quality = Quality {
        knee_rms: knee.rms,
        knee_range: knee.range,
        ankle_rms: ankle.rms,
        ankle_range: ankle.range,
        knee_centre: correction,
    };
    Ok((Anatomy { clusters, pelvis: pelvis_axes, thigh, shank, foot }, quality))
}

/// A common axis of two segments: a point and a direction in each.
struct Axis {
    proximal_point: Vector3<f64>,
    proximal: Vector3<f64>,
    distal_point: Vector3<f64>,
    distal: Vector3<f64>,
    rms: f64,
    range: f64,
}

impl Axis {
    /// min Σ |R c_d + t − c_p|² over the points c_d, c_p; the direction that leaves the sum unchanged most is the axis.
    fn fit(
        recordings: &[Recording],
        clusters: &[Cluster; 5],
        proximal: SegmentId,
        distal: SegmentId,
        joint: &'static str,
    ) -> Result<Axis, CalibrationError> {
        let poses: Vec<(Matrix3<f64>, Vector3<f64>)> =
            frames(recordings, clusters, proximal, distal).map(|(a, b)| relative(&a, &b)).collect();
        let range = range_of(&poses);
        if range < NEEDED_RANGE.to_radians() {
            let range_deg = range.to_degrees();
            return Err(CalibrationError::Range { joint, range_deg, needed_deg: NEEDED_RANGE });
        }
        let mut A = DMatrix::zeros(3 * poses.len(), 6);
        let mut b = DVector::zeros(3 * poses.len());
        for (k, (R, t)) in poses.iter().enumerate() {
            A.fixed_view_mut::<3, 3>(3 * k, 0).copy_from(R);
            A.fixed_view_mut::<3, 3>(3 * k, 3).copy_from(&-Matrix3::identity());
            b.fixed_rows_mut::<3>(3 * k).copy_from(&-t);
        }
        let svd = A.clone().svd(true, true);
        let smallest = svd.singular_values.imin();
        let v_t = svd.v_t.as_ref().expect("computed");
        let direction = v_t.row(smallest).transpose();
        let points = svd.solve(&b, 1e-12).expect("both factors computed");
        let rms = ((&A * &points - &b).norm_squared() / poses.len() as f64).sqrt();
        Ok(Axis {
            distal_point: points.fixed_rows::<3>(0).into(),
            proximal_point: points.fixed_rows::<3>(3).into(),
            distal: Vector3::from(direction.fixed_rows::<3>(0)).normalize(),
            proximal: Vector3::from(direction.fixed_rows::<3>(3)).normalize(),
            rms,
            range,
        })
    }

    /// The axis with the sense of `lateral`, given in the proximal or the distal segment.
    fn pointing(mut self, lateral: &Vector3<f64>, in_proximal: bool) -> Axis {
        let along = if in_proximal { self.proximal } else { self.distal };
        if along.dot(lateral) < 0.0 {
            self.proximal = -self.proximal;
            self.distal = -self.distal;
        }
        self
    }
}

/// Poses of two segments in every frame that shows both.
fn frames<'a>(
    recordings: &'a [Recording],
    clusters: &'a [Cluster; 5],
    a: SegmentId,
    b: SegmentId,
) -> impl Iterator<Item = (Pose, Pose)> + 'a {
    recordings.iter().flat_map(move |r| {
        let n = r.tracks.iter().map(|t| t.position.len()).min().unwrap_or(0);
        (0..n).filter_map(move |k| {
            let pose = |s: SegmentId| pose(&clusters[s.index()], &r.tracks, s, k);
            Some((pose(a)?, pose(b)?))
        })
    })
}

/// Shank and patella marker in the thigh, in every frame that shows both segments.
fn knee_frames(recordings: &[Recording], clusters: &[Cluster; 5]) -> Vec<Frame> {
    let mut seen = Vec::new();
    for r in recordings {
        let n = r.tracks.iter().map(|t| t.position.len()).min().unwrap_or(0);
        for k in 0..n {
            let pose = |s: SegmentId| pose(&clusters[s.index()], &r.tracks, s, k);
            let (Some(thigh), Some(shank)) = (pose(SegmentId::Thigh), pose(SegmentId::Shank)) else {
                continue;
            };
            let patella = r.patella.get(k).copied().flatten();
            seen.push(Frame {
                shank: relative(&thigh, &shank),
                patella: patella.map(|p| into_local(&thigh, &p)),
            });
        }
    }
    seen
}

/// Mean over the frames of a point of the pelvis, seen in the thigh.
fn mean_point(recordings: &[Recording], clusters: &[Cluster; 5], point: &Vector3<f64>) -> Vector3<f64> {
    let points: Vec<Vector3<f64>> = frames(recordings, clusters, SegmentId::Pelvis, SegmentId::Thigh)
        .map(|(pelvis, thigh)| relative(&thigh, &pelvis))
        .map(|(R, t)| R * point + t)
        .collect();
    points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
}

/// Largest turn between any pose and the first one, and so on from the farthest: the range of motion \[rad\].
fn range_of(poses: &[(Matrix3<f64>, Vector3<f64>)]) -> f64 {
    let angle = |a: &Matrix3<f64>, b: &Matrix3<f64>| {
        (((a.transpose() * b).trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
    };
    let farthest = |from: usize| {
        (0..poses.len())
            .map(|k| (k, angle(&poses[from].0, &poses[k].0)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, 0.0))
    };
    if poses.is_empty() { 0.0 } else { farthest(farthest(0).0).1 }
}

/// Mean over the frames of a direction of segment `a`, seen in segment `b`.
fn mean_direction(
    recordings: &[Recording],
    clusters: &[Cluster; 5],
    a: SegmentId,
    b: SegmentId,
    direction: &Vector3<f64>,
) -> Vector3<f64> {
    frames(recordings, clusters, a, b).map(|(a, b)| b.R.transpose() * a.R * direction).sum()
}

/// Mean parameter along the knee axis of its point nearest to the line from hip to ankle.
fn nearest_to_leg_line(
    recordings: &[Recording],
    clusters: &[Cluster; 5],
    knee: &Axis,
    hip: &Vector3<f64>,
    ankle: &Vector3<f64>,
) -> f64 {
    let hips: Vec<Vector3<f64>> = frames(recordings, clusters, SegmentId::Pelvis, SegmentId::Thigh)
        .map(|(pelvis, thigh)| relative(&thigh, &pelvis))
        .map(|(R, t)| R * hip + t)
        .collect();
    let ankles: Vec<Vector3<f64>> = frames(recordings, clusters, SegmentId::Thigh, SegmentId::Shank)
        .map(|(thigh, shank)| relative(&thigh, &shank))
        .map(|(R, t)| R * ankle + t)
        .collect();
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    let (hip, ankle) = (mean(&hips), mean(&ankles));
    let line = (ankle - hip).normalize();
    let across = knee.proximal - line * knee.proximal.dot(&line);
    let gap = hip - knee.proximal_point;
    gap.dot(&across) / across.norm_squared()
}
