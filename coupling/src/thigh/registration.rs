//! Thigh and skeleton brought together: where the bones of the mesh are in a posture of the rigid leg.
//!
//! Everything is told in the frame of the mesh, and the thigh is at rest in it: the femur never moves, and no digit is
//! lost to the way the subject walks. The mesh stands with straight knee; so does the rigid leg at zero knee flexion, and
//! shank and patella move from there as the rigid ones do. The pelvis turns about the hip centre, axes laid upon axes.

#![allow(non_snake_case)]

use std::path::Path;

use fem::body::Pose;
use mesher::scale::SegmentFrame;
use multibody::kinematics::coupled_leg;
use multibody::model::Model;
use multibody::natural::{self, Coordinates, SegmentId};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::thigh::tables::LIMB_FRAMES;

/// The bones as bodies of a scene, in the order of [`Registration::poses`].
pub const BODIES: [&str; 4] = ["pelvis", "thigh", "patella", "shank"];

/// Axes and joint centres of the mesh \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshFrames {
    /// Axes of the pelvis (columns; Z along the line of the ASISs, X in the plane of ASISs and PSISs).
    pub pelvis: Matrix3<f64>,
    /// Axes of the thigh (columns; X = u, Y in the plane of u and the line from knee to hip centre).
    pub thigh: Matrix3<f64>,
    /// Hip centre.
    pub hip: Vector3<f64>,
    /// Knee centre, midpoint of the epicondyles.
    pub knee: Vector3<f64>,
}

impl MeshFrames {
    /// The frames of the built-in thigh (`gait-data/thigh/limb_frames.csv`).
    pub fn built_in() -> MeshFrames {
        let frames = SegmentFrame::read_csv(LIMB_FRAMES, Path::new("limb_frames.csv"));
        let frames = frames.expect("built-in tables are well formed");
        let frame = |segment: &str| {
            frames.iter().find(|f| f.segment == segment).expect("the table lists pelvis and thigh")
        };
        let (pelvis, thigh) = (frame("pelvis"), frame("thigh"));
        MeshFrames {
            pelvis: pelvis.axes,
            thigh: thigh.axes,
            hip: thigh.origin,
            knee: thigh.distal.expect("the table has the knee centre"),
        }
    }
}

impl MeshFrames {
    /// The frames of the same limb with a thigh `factor` times as long, about the hip centre.
    pub fn sized(self, factor: f64) -> MeshFrames {
        MeshFrames { knee: self.hip + factor * (self.knee - self.hip), ..self }
    }
}

/// A mesh laid over the rigid leg of a subject.
#[derive(Clone, Debug)]
pub struct Registration {
    frames: MeshFrames,
    /// Shank and patella of the rigid leg at zero knee flexion, in the thigh-distal frame.
    extended: [Isometry3<f64>; 2],
}

fn isometry(R: Matrix3<f64>, p: Vector3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(R));
    Isometry3::from_parts(Translation3::from(p), rotation)
}

impl Registration {
    /// `None` where the patella of the rigid leg finds no place with straight knee.
    pub fn new(frames: MeshFrames, model: &Model) -> Option<Registration> {
        let extended = coupled_leg(&model.shapes, 0.0)?.map(|pose| isometry(pose.R, pose.p));
        Some(Registration { frames, extended })
    }

    /// Axes and joint centres of the mesh.
    pub fn frames(&self) -> MeshFrames {
        self.frames
    }

    /// Length of the thigh of the mesh \[m\].
    pub fn thigh_length(&self) -> f64 {
        (self.frames.hip - self.frames.knee).norm()
    }

    /// Poses of [`BODIES`] in the posture Q.
    pub fn poses(&self, model: &Model, Q: &Coordinates) -> [Pose; 4] {
        let thigh = model.pose(SegmentId::Thigh, Q);
        let knee = natural::block(Q, SegmentId::Thigh.block(2));
        let below = [SegmentId::Shank, SegmentId::Patella].map(|s| {
            let pose = model.pose(s, Q);
            isometry(thigh.R.transpose() * pose.R, thigh.R.transpose() * (pose.p - knee))
        });
        self.assemble(thigh.R.transpose() * pelvis_axes(Q), below)
    }

    /// The posture Q with the knee of the rigid leg at `flexion` \[rad\] instead of its own.
    pub fn poses_at_flexion(&self, model: &Model, Q: &Coordinates, flexion: f64) -> Option<[Pose; 4]> {
        let thigh = model.pose(SegmentId::Thigh, Q).R;
        let below = coupled_leg(&model.shapes, flexion)?.map(|pose| isometry(pose.R, pose.p));
        Some(self.assemble(thigh.transpose() * pelvis_axes(Q), below))
    }

    /// `pelvis`: axes of the pelvis in those of the thigh; `below`: shank and patella in the thigh-distal frame.
    fn assemble(&self, pelvis: Matrix3<f64>, below: [Isometry3<f64>; 2]) -> [Pose; 4] {
        let MeshFrames { pelvis: pelvis_0, thigh, hip, knee } = self.frames;
        let about_hip = isometry(thigh * pelvis * pelvis_0.transpose(), Vector3::zeros());
        let to_hip = Isometry3::translation(hip.x, hip.y, hip.z);
        let to_knee = isometry(thigh, knee);
        let [shank, patella] =
            [0, 1].map(|i| to_knee * below[i] * self.extended[i].inverse() * to_knee.inverse());
        [to_hip * about_hip * to_hip.inverse(), Isometry3::identity(), patella, shank]
    }

    /// The posture of the mesh as natural coordinates of the leg, with the thigh axes of the mesh in ground; the foot is left at zero.
    pub fn standing(&self, model: &Model) -> Coordinates {
        self.posture(model, 0.0, 0.0).expect("a registered leg has its knee straight")
    }

    /// The posture of the mesh with hip and knee flexed by these angles \[rad\]; `None` where the patella finds no place.
    pub fn posture(&self, model: &Model, hip_flexion: f64, knee_flexion: f64) -> Option<Coordinates> {
        let MeshFrames { pelvis, thigh, hip, .. } = self.frames;
        // The thigh stays: the pelvis turns the other way about its transverse axis.
        let axis = nalgebra::Unit::new_normalize(thigh.column(2).into_owned());
        let pelvis = Rotation3::from_axis_angle(&axis, -hip_flexion).into_inner() * pelvis;
        let below = match knee_flexion {
            0.0 => self.extended,
            flexion => coupled_leg(&model.shapes, flexion)?.map(|pose| isometry(pose.R, pose.p)),
        };
        let mut Q = Coordinates::zeros();
        let mut write = |segment: SegmentId, R: Matrix3<f64>, p: Vector3<f64>| {
            model.shapes[segment.index()].write(segment, &natural::Pose { R, p }, &mut Q);
        };
        write(SegmentId::Thigh, thigh, hip);
        // The frame of the rigid pelvis has X = u, the mesh Z along the ASISs: both turned so that the latter agree.
        let mut scs = Coordinates::zeros();
        let upright = natural::Pose { R: Matrix3::identity(), p: Vector3::zeros() };
        model.shapes[SegmentId::Pelvis.index()].write(SegmentId::Pelvis, &upright, &mut scs);
        let R = pelvis * pelvis_axes(&scs).transpose();
        write(SegmentId::Pelvis, R, hip - R * model.hip);
        let knee = natural::block(&Q, SegmentId::Thigh.block(2));
        for (segment, pose) in [SegmentId::Shank, SegmentId::Patella].into_iter().zip(&below) {
            let R = thigh * pose.rotation.to_rotation_matrix().into_inner();
            let place = natural::Pose { R, p: knee + thigh * pose.translation.vector };
            model.shapes[segment.index()].write(segment, &place, &mut Q);
        }
        Some(Q)
    }

    /// A direction in ground as one in the mesh with the thigh at rest.
    pub fn direction(&self, model: &Model, Q: &Coordinates, ground: &Vector3<f64>) -> Vector3<f64> {
        self.frames.thigh * model.pose(SegmentId::Thigh, Q).R.transpose() * ground
    }

    /// A point in ground \[m\] as one of the mesh with the thigh at rest: hip centre upon hip centre, no scaling.
    pub fn point(&self, model: &Model, Q: &Coordinates, ground: &Vector3<f64>) -> Vector3<f64> {
        let hip = model.pose(SegmentId::Thigh, Q).p;
        self.frames.hip + self.direction(model, Q, &(ground - hip))
    }
}

/// Axes of the pelvis with Z along the line of the ASISs.
fn pelvis_axes(Q: &Coordinates) -> Matrix3<f64> {
    let w = natural::block(Q, SegmentId::Pelvis.block(3)).normalize();
    let u = natural::block(Q, SegmentId::Pelvis.block(0));
    let y = w.cross(&u).normalize();
    Matrix3::from_columns(&[y.cross(&w), y, w])
}
