//! Results in the words of OpenSim's gait2392 model: a motion of its coordinates, and forces and activations under its muscle names.
//!
//! A motion file names coordinates only, so it opens on gait2392 of any size. Hip angles are those of its ball joint, the knee bends about one
//! axis there (extension positive) and adduction and rotation of ours are left out, the ankle is levelled as for muscle lengths
//! ([`generic_postures`]). `pelvis_tx` to `pelvis_tz` are the place of its pelvis origin, the midpoint of the ASISs. A left leg, which is
//! mirrored everywhere else, is given back its own side.

#![allow(non_snake_case)]

use std::io::{self, Write};

use multibody::activation::generic_postures;
use multibody::model::Model;
use multibody::muscle::musculotendon::MusculotendonModel;
use multibody::natural::{self, Coordinates, SegmentId};
use multibody::trial::{Motion, Side};
use nalgebra::{Matrix3, Vector3};

use super::tables::Series;
use coupling::thigh::lines::lines_of_muscles;

/// Coordinates of gait2392 in the order of the model; `?` is the letter of the side.
const COORDINATES: [&str; 23] = [
    "pelvis_tilt",
    "pelvis_list",
    "pelvis_rotation",
    "pelvis_tx",
    "pelvis_ty",
    "pelvis_tz",
    "hip_flexion_r",
    "hip_adduction_r",
    "hip_rotation_r",
    "knee_angle_r",
    "ankle_angle_r",
    "subtalar_angle_r",
    "mtp_angle_r",
    "hip_flexion_l",
    "hip_adduction_l",
    "hip_rotation_l",
    "knee_angle_l",
    "ankle_angle_l",
    "subtalar_angle_l",
    "mtp_angle_l",
    "lumbar_extension",
    "lumbar_bending",
    "lumbar_rotation",
];

/// The motion \[deg, m\] of the frames that were fitted; coordinates that were not computed (other leg, toes, trunk) are zero.
pub fn motion(model: &Model, motion: &Motion, side: Side) -> Series {
    let frames: Vec<usize> = motion.report.clone().collect();
    let postures = generic_postures(model, motion);
    let fitted: Vec<usize> = (0..frames.len()).filter(|&k| motion.fit[frames[k]].failure.is_none()).collect();
    let mut columns: Vec<(String, Vec<f64>)> =
        COORDINATES.iter().map(|name| (name.to_string(), vec![0.0; fitted.len()])).collect();
    let (leg, mirrored) = match side {
        Side::Right => ("r", 1.0),
        Side::Left => ("l", -1.0),
    };
    let angle = |name: &str| {
        motion.angles.columns.iter().position(|c| c == name).expect("kinematics names its angles")
    };
    let trunk = ["pelvis_tilt", "pelvis_obliquity", "pelvis_rotation"].map(angle);
    for (row, &k) in fitted.iter().enumerate() {
        let [tilt, list, rotation] = trunk.map(|c| motion.angles.values[(frames[k], c)]);
        let origin = pelvis_origin(model, &motion.Q[frames[k]]);
        let at = &postures[k];
        let mut set = |name: &str, value: f64| {
            let column = columns.iter_mut().find(|(c, _)| c == name).expect("a coordinate of gait2392");
            column.1[row] = value;
        };
        set("pelvis_tilt", tilt.to_degrees());
        set("pelvis_list", mirrored * list.to_degrees());
        set("pelvis_rotation", mirrored * rotation.to_degrees());
        set("pelvis_tx", origin.x);
        set("pelvis_ty", origin.y);
        set("pelvis_tz", mirrored * origin.z);
        for (name, radians) in [
            ("hip_flexion", at.hip_flexion),
            ("hip_adduction", at.hip_adduction),
            ("hip_rotation", at.hip_rotation),
            ("knee_angle", -at.knee_flexion),
            ("ankle_angle", at.ankle_dorsiflexion),
            ("subtalar_angle", at.subtalar),
        ] {
            set(&format!("{name}_{leg}"), radians.to_degrees());
        }
    }
    Series { time: fitted.iter().map(|&k| motion.time[frames[k]]).collect(), columns }
}

/// Midpoint of the ASISs in ground \[m\].
fn pelvis_origin(model: &Model, Q: &Coordinates) -> Vector3<f64> {
    let block = |i| natural::block(Q, SegmentId::Pelvis.block(i));
    let body = &model.anatomy.pelvis;
    let lateral = (body.hip - body.origin).dot(&body.w);
    let middle = body.hip - lateral * body.w; // the pelvis' rD
    block(2) + axes(&block(0), &block(3)) * axes(&body.u, &body.w).transpose() * (body.origin - middle)
}

/// Axes of the pelvis: Z along the line of the ASISs, X as nearly along u as that lets it.
fn axes(u: &Vector3<f64>, w: &Vector3<f64>) -> Matrix3<f64> {
    let z = w.normalize();
    let y = z.cross(u).normalize();
    Matrix3::from_columns(&[y.cross(&z), y, z])
}

/// Columns of muscles under the names of gait2392.
pub fn renamed(series: &Series, side: Side) -> Series {
    let columns = series.columns.iter().map(|(name, values)| (muscle_name(name, side), values.clone()));
    Series { time: series.time.clone(), columns: columns.collect() }
}

/// The name of gait2392 of a muscle line; its own where gait2392 has none.
fn muscle_name(ours: &str, side: Side) -> String {
    let unit = MusculotendonModel::generic().units.iter().find(|unit| unit.short_name == ours);
    unit.map_or(ours.to_string(), |unit| of_side(&unit.name, side))
}

fn of_side(right: &str, side: Side) -> String {
    match (side, right.strip_suffix("_r")) {
        (Side::Left, Some(stem)) => format!("{stem}_l"),
        _ => right.to_string(),
    }
}

/// `gait2392_names.csv`: what every muscle line (name here, full name) is called in gait2392 and in the deformable thigh, where it is there.
pub fn write_names(w: &mut dyn Write, names: &[(&str, &str)], side: Side) -> io::Result<()> {
    let thigh = lines_of_muscles();
    let mut csv = csv::Writer::from_writer(w);
    csv.write_record(["muscle", "full_name", "gait2392", "thigh"])?;
    for (ours, full_name) in names {
        let muscle = thigh.iter().find(|(_, lines)| lines.iter().any(|line| line == ours));
        let muscle = muscle.map_or("", |(name, _)| name.as_str());
        csv.write_record([*ours, *full_name, &muscle_name(ours, side), muscle])?;
    }
    csv.flush()
}
