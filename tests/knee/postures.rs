//! Postures of the built-in leg with one joint coordinate changed, all joint equations kept.

#![allow(non_snake_case)]

use std::cell::Cell;

use multibody::anatomy::rotation;
use multibody::kinematics::coupled_leg;
use multibody::model::{Ankle, Model};
use multibody::natural::{Coordinates, End, Pose, SegmentId, block};
use multibody::walker::{Knee, walker};
use nalgebra::{Matrix3, Vector3};
use support::motion_cases::fitted;

/// A leg that can be put in any posture.
pub struct Leg {
    pub model: Model,
    /// A fitted posture in mid-stance, from which others are made.
    rest: Coordinates,
    /// The last knee angle with the poses of shank and patella that belong to it.
    last: Cell<Option<(f64, [Pose; 2])>>,
}

/// Hip flexion, adduction, rotation; knee flexion; ankle flexion and inversion, as turns from the posture at rest \[rad\]; the knee angle counts from
/// extension.
#[derive(Clone, Copy, Debug, Default)]
pub struct Turns {
    pub hip: [f64; 3],
    pub knee: f64,
    pub ankle: [f64; 2],
}

impl Leg {
    pub fn new(change: impl FnOnce(Model) -> Model) -> Leg {
        let (trial, _, frames) = fitted(Knee::Hinge, Ankle::Universal);
        let (_, anatomy) = walker(Knee::Hinge);
        let model = change(Model::new(&trial, anatomy, Ankle::Universal).unwrap());
        Leg { model, rest: frames[trial.report.start + 30].Q, last: Cell::new(None) }
    }

    fn write(&self, segment: SegmentId, pose: &Pose, Q: &mut Coordinates) {
        self.model.shapes[segment.index()].write(segment, pose, Q);
    }

    /// The posture, with the pelvis where it was at rest.
    pub fn posture(&self, turns: &Turns) -> Coordinates {
        use SegmentId::{Foot, Patella, Shank, Thigh};
        let pose = |s: SegmentId| self.model.pose(s, &self.rest);
        let mut Q = self.rest;
        let thigh = pose(Thigh);
        let axis = |k: usize| thigh.R.column(k).into_owned();
        let turn = |axis: Vector3<f64>, angle: f64| rotation(&(axis * angle));
        let [flexion, adduction, inward] = turns.hip;
        let R = turn(axis(2), flexion) * turn(axis(0), adduction) * turn(axis(1), inward) * thigh.R;
        let thigh = Pose { R, p: thigh.p };
        self.write(Thigh, &thigh, &mut Q);
        let end = block(&Q, Thigh.block(2));
        let [shank, patella] = match self.last.get() {
            Some((knee, poses)) if knee == turns.knee => poses,
            _ => coupled_leg(&self.model.shapes, turns.knee).expect("the patella has a place"),
        };
        self.last.set(Some((turns.knee, [shank, patella])));
        let placed = |local: &Pose| Pose { R: thigh.R * local.R, p: end + thigh.R * local.p };
        let new_shank = placed(&shank);
        self.write(Shank, &new_shank, &mut Q);
        self.write(Patella, &placed(&patella), &mut Q);
        // The foot goes with the shank, then turns about both axes of its joint.
        let (old_shank, old_foot) = (pose(Shank), pose(Foot));
        let carried = |R: Matrix3<f64>, p: Vector3<f64>| {
            let local = old_shank.R.transpose();
            Pose { R: new_shank.R * local * R, p: new_shank.p + new_shank.R * local * (p - old_shank.p) }
        };
        let foot = carried(old_foot.R, old_foot.p);
        let (joint, talocrural, subtalar) = self.ankle(&new_shank, &foot);
        let turned = turn(talocrural, turns.ankle[0]) * turn(subtalar, turns.ankle[1]);
        let foot = Pose { R: turned * foot.R, p: joint + turned * (foot.p - joint) };
        self.write(Foot, &foot, &mut Q);
        Q
    }

    /// Joint point and axes of the ankle in ground.
    fn ankle(&self, shank: &Pose, foot: &Pose) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let table = multibody::tables::JointTable::built_in();
        let shape = &self.model.shapes[SegmentId::Shank.index()];
        let mut Q = Coordinates::zeros();
        shape.write(SegmentId::Shank, shank, &mut Q);
        let scale = shape.L / multibody::joint::GENERIC_SHANK;
        let local = scale * table.point("ankle_universal", "joint point on shank");
        let joint = shape.point(SegmentId::Shank, &local, End::Distal).at(&Q);
        let talocrural = shank.R * table.point("ankle_universal", "talocrural axis").normalize();
        let subtalar = foot.R * table.point("ankle_universal", "subtalar axis").normalize();
        (joint, talocrural, subtalar)
    }

    /// Largest joint equation that the posture violates.
    pub fn misfit(&self, Q: &Coordinates) -> f64 {
        let mut phi = Vec::new();
        self.model.equations.iter().for_each(|e| e.residual(Q, &mut phi));
        phi.iter().fold(0.0, |m: f64, r| m.max(r.abs()))
    }
}
