//! A prosthesis: its tray has the resultant of everything that the natural knee carries.

#![allow(non_snake_case)]

use multibody::dynamics::LegForce;
use multibody::equilibrium::equilibrium;
use multibody::model::{KneeKind, Model};
use multibody::natural::{End, SegmentId};
use multibody::tables::JointTable;
use nalgebra::Vector3;
use support::Random;

use super::postures::{Leg, Turns};

/// Force and moment about the shank's origin of forces on the femur, in axes of the shank.
type Wrench = (Vector3<f64>, Vector3<f64>);

fn sum(forces: &[(Vector3<f64>, Vector3<f64>)]) -> Wrench {
    let force = forces.iter().map(|(_, f)| *f).sum();
    (force, forces.iter().map(|(at, f)| at.cross(f)).sum())
}

#[test]
fn the_tray_carries_the_resultant_of_contact_and_ligaments() {
    let (natural, tray) = (Leg::new(|m| m), Leg::new(|m: Model| m.with_knee(KneeKind::Implant)));
    let mut random = Random::new(8);
    let item = |name: &str| JointTable::built_in().point("tibiofemoral", name);
    for _ in 0..30 {
        let turns = Turns { knee: random.between(0.02, 2.0), ..Turns::default() };
        let Q = natural.posture(&turns);
        let load = LegForce::from_fn(|_, _| 100.0 * random.uniform());
        let x = |leg: &Leg| equilibrium(&leg.model, &Q, &load).unwrap().reaction_without;
        let (a, b) = (x(&natural), x(&tray));
        let of = |leg: &Leg, x: &nalgebra::DVector<f64>, name: &str| {
            x[leg.model.reaction_names().iter().position(|n| n == name).unwrap()]
        };
        let shank = natural.model.pose(SegmentId::Shank, &Q);
        let local = |ground: Vector3<f64>| shank.R.transpose() * (ground - shank.p);
        let shape = |s: SegmentId| natural.model.shapes[s.index()];
        let femur = |name: &str| {
            local(shape(SegmentId::Thigh).point(SegmentId::Thigh, &item(name), End::Distal).at(&Q))
        };
        let tibia = |name: &str| {
            local(shape(SegmentId::Shank).point(SegmentId::Shank, &item(name), End::Proximal).at(&Q))
        };
        let plateau = item("medial contact plane point").y;
        let centres = ["medial", "lateral"].map(|side| {
            let c = femur(&format!("{side} sphere centre"));
            Vector3::new(c.x, plateau, c.z)
        });
        let up = Vector3::y();
        let mut forces: Vec<(Vector3<f64>, Vector3<f64>)> = vec![
            (centres[0], of(&natural, &a, "knee_medial") * up),
            (centres[1], of(&natural, &a, "knee_lateral") * up),
        ];
        for (name, row) in [("ACL", "acl"), ("PCL", "pcl"), ("MCL", "mcl")] {
            let (from, to) = (femur(&format!("{name} origin")), tibia(&format!("{name} insertion")));
            forces.push((from, of(&natural, &a, row) * (to - from).normalize()));
        }
        let (force, moment) = sum(&forces);
        let middle = 0.5 * (centres[0] + centres[1]);
        let shear = |row: &str| of(&tray, &b, row);
        let on_tray = sum(&[
            (centres[0], Vector3::new(shear("knee_shear_medial"), of(&tray, &b, "knee_medial"), 0.0)),
            (centres[1], Vector3::new(shear("knee_shear_lateral"), of(&tray, &b, "knee_lateral"), 0.0)),
            (Vector3::new(middle.x, plateau, 0.0), shear("knee_shear_z") * Vector3::z()),
        ]);
        let scale = forces.iter().map(|f| f.1.norm()).fold(1.0, f64::max);
        assert!((force - on_tray.0).norm() < 1e-9 * scale, "{force} {}", on_tray.0);
        // The moment about the flexion axis is where the tray bears, forward or backward.
        let missing = moment - on_tray.1;
        assert!(missing.xy().norm() < 1e-9 * scale && missing.z.is_finite(), "{missing}");
        // What is not of the knee is the same.
        for name in ["hip_y", "ankle_x", "patellar_tendon", "tibia_axial", "femur_axial"] {
            assert_eq!(of(&natural, &a, name), of(&tray, &b, name), "{name}");
        }
    }
}
