//! Mean shape of a marker cluster over recorded frames.

use nalgebra::{Matrix3, Vector3};

use crate::anatomy::{Cluster, lay_over};
use crate::natural::{Pose, SegmentId};
use crate::trial::MarkerTrack;

/// Passes of align-and-average; the mean moves by less than a micrometre after the second.
const PASSES: usize = 4;

/// Mean cluster of the markers of `segment` over all frames of several recordings (generalised Procrustes): every frame is laid
/// over the current mean, then positions are averaged. The local frame is that of ground in the frame that started it.
///
/// `None` where no frame shows three markers off a line.
pub fn mean_cluster(recordings: &[&[MarkerTrack]], segment: SegmentId) -> Option<Cluster> {
    let mut names: Vec<String> = Vec::new();
    for track in recordings.iter().flat_map(|r| r.iter()).filter(|t| t.segment == segment) {
        if !names.contains(&track.name) {
            names.push(track.name.clone());
        }
    }
    let frames: Vec<Vec<Option<Vector3<f64>>>> = recordings
        .iter()
        .flat_map(|tracks| {
            let n = tracks.iter().map(|t| t.position.len()).min().unwrap_or(0);
            let names = &names;
            (0..n).map(move |k| {
                let seen = |name: &String| {
                    tracks.iter().find(|t| t.segment == segment && t.name == *name)?.position[k]
                };
                names.iter().map(seen).collect()
            })
        })
        .collect();
    let start = frames.iter().max_by_key(|f: &&Vec<_>| f.iter().flatten().count())?;
    let centre: Vector3<f64> =
        start.iter().flatten().sum::<Vector3<f64>>() / start.iter().flatten().count().max(1) as f64;
    let mut mean: Vec<Option<Vector3<f64>>> = start.iter().map(|p| p.map(|p| p - centre)).collect();
    for _ in 0..PASSES {
        let mut sums = vec![(Vector3::zeros(), 0.0); names.len()];
        for frame in &frames {
            let pairs: Vec<_> = mean.iter().zip(frame).filter_map(|(m, f)| Some(((*m)?, (*f)?))).collect();
            let Some(Pose { R, p }) = lay_over(&pairs) else { continue };
            for (sum, seen) in sums.iter_mut().zip(frame) {
                if let Some(seen) = seen {
                    sum.0 += R.transpose() * (seen - p);
                    sum.1 += 1.0;
                }
            }
        }
        let updated: Vec<_> = sums.iter().map(|(sum, count)| (*count > 0.0).then(|| sum / *count)).collect();
        if updated.iter().flatten().count() < 3 {
            return None;
        }
        mean = updated;
    }
    let (names, points) = names.into_iter().zip(mean).filter_map(|(n, p)| Some((n, p?))).unzip();
    Some(Cluster { names, points })
}

/// Pose of a cluster in one frame of a recording.
pub fn pose(cluster: &Cluster, tracks: &[MarkerTrack], segment: SegmentId, frame: usize) -> Option<Pose> {
    let pairs: Vec<_> = cluster
        .names
        .iter()
        .zip(&cluster.points)
        .filter_map(|(name, local)| {
            let track = tracks.iter().find(|t| t.segment == segment && t.name == *name)?;
            Some((*local, track.position.get(frame).copied().flatten()?))
        })
        .collect();
    lay_over(&pairs)
}

/// Mean of a landmark in the frame of a cluster over the frames that show both.
pub fn mean_local(
    cluster: &Cluster,
    tracks: &[MarkerTrack],
    segment: SegmentId,
    landmark: &[Option<Vector3<f64>>],
    frames: impl Iterator<Item = usize>,
) -> Option<Vector3<f64>> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for frame in frames {
        let Some(seen) = landmark.get(frame).copied().flatten() else { continue };
        let Some(Pose { R, p }) = pose(cluster, tracks, segment, frame) else { continue };
        sum += R.transpose() * (seen - p);
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}

/// Pelvis axes (columns X, Y, Z) and the midpoint of the ASISs from the four spines, in whatever frame they are given.
pub fn pelvis_axes(
    asis_right: &Vector3<f64>,
    asis_left: &Vector3<f64>,
    psis_right: &Vector3<f64>,
    psis_left: &Vector3<f64>,
) -> (Matrix3<f64>, Vector3<f64>) {
    let origin = 0.5 * (asis_right + asis_left);
    let z = (asis_right - asis_left).normalize();
    let back = 0.5 * (psis_right + psis_left) - origin;
    let x = (-(back - z * back.dot(&z))).normalize();
    (Matrix3::from_columns(&[x, z.cross(&x), z]), origin)
}
