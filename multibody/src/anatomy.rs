//! Where the landmarks of a subject sit relative to the markers, and the posture that the markers alone suggest.
//!
//! Every source of landmarks (a table, a static trial, a functional calibration) ends in the same thing: for each
//! segment a rigid [`Cluster`] of markers, and the joint centres and axes in the same local frame. Frame by frame the
//! cluster is laid over the seen markers and carries the landmarks along.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use crate::natural::{Coordinates, Pose, SegmentId, Shape};
use crate::tables::JointTable;
use crate::trial::Trial;

/// Markers of one segment in a local frame \[m\].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cluster {
    /// Marker names as in the recording.
    pub names: Vec<String>,
    /// Local positions \[m\].
    pub points: Vec<Vector3<f64>>,
}

/// Pelvis landmarks in the frame of the pelvis cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct PelvisAxes {
    /// Forward, in the plane of the ASISs and the midpoint of the PSISs, normal to the ASIS line.
    pub u: Vector3<f64>,
    /// Left to right ASIS.
    pub w: Vector3<f64>,
    /// Lumbar joint centre \[m\].
    pub lumbar: Vector3<f64>,
    /// Hip centre of the leg under study \[m\].
    pub hip: Vector3<f64>,
    /// Distance of the ASISs \[m\].
    pub width: f64,
    /// Midpoint of the ASISs \[m\].
    pub origin: Vector3<f64>,
}

/// Thigh landmarks in the frame of the thigh cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct ThighAxes {
    /// Knee centre \[m\].
    pub knee: Vector3<f64>,
    /// Medial to lateral epicondyle, or the functional knee axis (unit).
    pub w: Vector3<f64>,
}

/// Shank landmarks in the frame of the shank cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct ShankAxes {
    /// Knee centre \[m\].
    pub knee: Vector3<f64>,
    /// Ankle centre \[m\].
    pub ankle: Vector3<f64>,
    /// Forward (unit).
    pub u: Vector3<f64>,
    /// Medial to lateral malleolus, or the functional axis (unit).
    pub w: Vector3<f64>,
}

/// Foot landmarks in the frame of the foot cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct FootAxes {
    /// Ankle centre \[m\].
    pub ankle: Vector3<f64>,
    /// Midpoint of metatarsal heads 1 and 5 \[m\].
    pub toe: Vector3<f64>,
    /// Heel to the midpoint of the metatarsal heads (unit).
    pub u: Vector3<f64>,
    /// Metatarsal head 1 to 5 (unit).
    pub w: Vector3<f64>,
}

/// Markers and landmarks of one subject.
#[derive(Clone, Debug, PartialEq)]
pub struct Anatomy {
    /// Clusters in the order of [`SegmentId::ALL`]; the patella has none.
    pub clusters: [Cluster; 5],
    /// Pelvis landmarks.
    pub pelvis: PelvisAxes,
    /// Thigh landmarks.
    pub thigh: ThighAxes,
    /// Shank landmarks.
    pub shank: ShankAxes,
    /// Foot landmarks.
    pub foot: FootAxes,
}

/// u, rP, rD, w of one segment in ground.
pub type SegmentPosture = [Vector3<f64>; 4];

impl Anatomy {
    /// Posture of foot, shank, thigh and pelvis that the markers of one frame suggest, joints ignored;
    /// `None` where fewer than three markers of a segment are seen, or all on a line.
    pub fn posture(&self, trial: &Trial, frame: usize) -> Option<[SegmentPosture; 4]> {
        let pose = |segment: SegmentId| self.clusters[segment.index()].pose(trial, segment, frame);
        let (foot, shank) = (pose(SegmentId::Foot)?, pose(SegmentId::Shank)?);
        let (thigh, pelvis) = (pose(SegmentId::Thigh)?, pose(SegmentId::Pelvis)?);
        let at = |pose: &Pose, c: &Vector3<f64>| pose.p + pose.R * c;
        let hip = at(&pelvis, &self.pelvis.hip);
        let knee = at(&thigh, &self.thigh.knee);
        let thigh_w = thigh.R * self.thigh.w;
        let thigh_u = (hip - knee).cross(&thigh_w).normalize();
        // The hip centre projected on the sagittal plane of the pelvis.
        let lateral = (self.pelvis.hip - self.pelvis.origin).dot(&self.pelvis.w);
        let middle = self.pelvis.hip - lateral * self.pelvis.w;
        Some([
            [
                foot.R * self.foot.u,
                at(&foot, &self.foot.ankle),
                at(&foot, &self.foot.toe),
                foot.R * self.foot.w,
            ],
            [
                shank.R * self.shank.u,
                at(&shank, &self.shank.knee),
                at(&shank, &self.shank.ankle),
                shank.R * self.shank.w,
            ],
            [thigh_u, hip, knee, thigh_w],
            [
                pelvis.R * self.pelvis.u,
                at(&pelvis, &self.pelvis.lumbar),
                at(&pelvis, &middle),
                pelvis.R * self.pelvis.w,
            ],
        ])
    }
}

impl Cluster {
    /// Pose of the local frame that lays the cluster over the seen markers with least squared distance
    /// (Kabsch 1976); `None` with fewer than three seen markers or all on a line.
    pub fn pose(&self, trial: &Trial, segment: SegmentId, frame: usize) -> Option<Pose> {
        let mut pairs = Vec::with_capacity(self.points.len());
        for track in trial.markers.iter().filter(|t| t.segment == segment) {
            if let (Some(seen), Some(k)) =
                (track.position[frame], self.names.iter().position(|n| *n == track.name))
            {
                pairs.push((self.points[k], seen));
            }
        }
        lay_over(&pairs)
    }
}

/// Least-squares pose that maps the first points of the pairs onto the second ones.
pub fn lay_over(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Pose> {
    if pairs.len() < 3 {
        return None;
    }
    let n = pairs.len() as f64;
    let local: Vector3<f64> = pairs.iter().map(|p| p.0).sum::<Vector3<f64>>() / n;
    let seen: Vector3<f64> = pairs.iter().map(|p| p.1).sum::<Vector3<f64>>() / n;
    let H: Matrix3<f64> = pairs.iter().map(|p| (p.1 - seen) * (p.0 - local).transpose()).sum();
    let svd = H.svd(true, true);
    let (U, V_t) = (svd.u?, svd.v_t?);
    let s = svd.singular_values;
    // Two directions of spread are needed; 1 mm against the largest counts as a line.
    if s[1] < 1e-3 * s[0] || s[0] <= 0.0 {
        return None;
    }
    let mut D = Matrix3::identity();
    D[(2, 2)] = (U * V_t).determinant().signum();
    let R = U * D * V_t;
    Some(Pose { R, p: seen - R * local })
}

/// First guess of the patella from thigh and shank: in front of the femur, u between those of thigh and shank.
///
/// `Q` holds thigh and shank; the patella is written into it.
pub fn place_patella(shapes: &[Shape; 5], Q: &mut Coordinates) {
    let thigh = shapes[SegmentId::Thigh.index()];
    let X_thigh = thigh.pose(SegmentId::Thigh, Q);
    let X_shank = shapes[SegmentId::Shank.index()].pose(SegmentId::Shank, Q);
    let table = JointTable::built_in();
    let on_femur = table.point("patellofemoral", "hinge point on femur");
    let reach = -table.point("patellofemoral", "hinge point on patella").x;
    let hinge = thigh.point(SegmentId::Thigh, &on_femur, crate::natural::End::Distal).at(Q);
    let u = (X_thigh.R.column(0) + X_shank.R.column(0)).normalize();
    let y = Vector3::from(X_thigh.R.column(2)).cross(&u).normalize();
    let pose = Pose { R: Matrix3::from_columns(&[u, y, u.cross(&y)]), p: hinge + reach * u };
    shapes[SegmentId::Patella.index()].write(SegmentId::Patella, &pose, Q);
}

/// Rotation of angle |ω| about ω.
pub fn rotation(omega: &Vector3<f64>) -> Matrix3<f64> {
    match Unit::try_new_and_get(*omega, 0.0) {
        Some((axis, angle)) => Rotation3::from_axis_angle(&axis, angle).into_inner(),
        None => Matrix3::identity(),
    }
}
