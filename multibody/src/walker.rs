//! The built-in walker: marker paths and ground reaction of one gait cycle, synthesised from averaged figures
//! (`gait-data/reference_gait.csv`, `reference_subject.csv`; method in `gait-data/README.md`).

#![allow(non_snake_case)]

use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::anatomy::Anatomy;
use crate::calibration::shifts::Shifts;
use crate::calibration::table::{self, TableError, TableItem};
use crate::natural::SegmentId;
use crate::tables::{number, rows};
use crate::trial::{GroundReaction, MarkerTrack, Sex, Side, Subject, Trial};

/// Frames before and after the cycle that only feed the filters (the series is periodic, so they are exact).
const PADDING: i64 = 50;
/// Rows of one period.
const PERIOD: i64 = 100;

/// Which joint angles drive the walker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knee {
    /// Averaged angles of a hinge knee: what markers on skin look like. The default.
    Hinge,
    /// Angles and shank translation of the coupled knee of the model (`ck_*` columns): free of joint misfit at the knee.
    Coupled,
}

/// Trial and anatomy of the built-in walker; 101 reported frames, 0 to 100 % of a right gait cycle.
pub fn walker(knee: Knee) -> (Trial, Anatomy) {
    let items = items();
    let scalars = rows(include_str!("../../gait-data/reference_subject.csv"));
    let scalar = |item: &str| {
        let row = scalars.iter().find(|r| r["item"] == item).expect("built-in table");
        number(row, "x_or_value")
    };
    let tracked: Vec<&TableItem> = items.iter().filter(|i| is_tracked(i)).collect();
    let anatomy = anatomy(&items, &Shifts::none()).expect("built-in table");

    let (mass, stride) = (scalar("body mass"), scalar("stride length"));
    let gait = rows(include_str!("../../gait-data/reference_gait.csv"));
    let step = scalar("cycle duration") / PERIOD as f64;
    let frames = -PADDING..=PERIOD + PADDING;

    let mut trial = Trial {
        name: "walker".into(),
        side: Side::Right,
        subject: Subject { name: "built-in walker".into(), mass, height: scalar("height"), sex: Sex::Male },
        time: Vec::new(),
        report: PADDING as usize..(PADDING + PERIOD + 1) as usize,
        markers: tracked
            .iter()
            .map(|i| MarkerTrack { name: i.item.clone(), segment: i.segment, position: Vec::new() })
            .collect(),
        ground: GroundReaction::default(),
    };
    for frame in frames {
        let row = &gait[frame.rem_euclid(PERIOD) as usize];
        let advance = stride * frame.div_euclid(PERIOD) as f64;
        let time = step * frame as f64;
        let poses = poses(row, &anatomy, advance, knee);
        trial.time.push(time);
        for (item, track) in tracked.iter().zip(&mut trial.markers) {
            let (R, p) = poses[item.segment.index()];
            track.position.push(Some(p + R * item.position));
        }
        let get = |c: &str| number(row, c);
        let force = mass * Vector3::new(get("grf_x_N_per_kg"), get("grf_y_N_per_kg"), get("grf_z_N_per_kg"));
        // The foot keeps its path when the knee is coupled within 2 mm; the ankle of the averaged chain carries the
        // centre of pressure in both cases.
        let ankle = ankle_centre(row, &anatomy, advance);
        let cop = ankle
            + Vector3::new(get("cop_rel_ankle_x_m"), get("cop_rel_ankle_y_m"), get("cop_rel_ankle_z_m"));
        trial.ground.time.push(time);
        trial.ground.force.push(force);
        trial.ground.moment.push(cop.cross(&force));
    }
    (trial, anatomy)
}

/// Anatomy of the built-in walker with its landmarks shifted; its markers were made with those of the table.
pub fn shifted(shifts: &Shifts) -> Result<Anatomy, TableError> {
    anatomy(&items(), shifts)
}

fn items() -> Vec<TableItem> {
    table::read(include_str!("../../gait-data/reference_subject.csv")).expect("built-in table")
}

fn anatomy(items: &[TableItem], shifts: &Shifts) -> Result<Anatomy, TableError> {
    let tracked = items.iter().filter(|i| is_tracked(i));
    let recorded: HashMap<String, String> = tracked.map(|i| (i.item.clone(), i.item.clone())).collect();
    table::anatomy(items, &recorded, None, Sex::Male, shifts)
}

/// Markers of the fit: those that sit on the body, and the metatarsal heads.
fn is_tracked(item: &TableItem) -> bool {
    let beyond_the_heads = item.item.starts_with("R_Toe");
    (item.kind == "marker" && !beyond_the_heads) || item.item.starts_with("metatarsal head")
}

type Frame = (Matrix3<f64>, Vector3<f64>);

/// Rz(z) Rx(x) Ry(y), degrees.
fn zxy(z: f64, x: f64, y: f64) -> Matrix3<f64> {
    let turn = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, degrees.to_radians());
    (turn(Vector3::z_axis(), z) * turn(Vector3::x_axis(), x) * turn(Vector3::y_axis(), y)).into_inner()
}

/// Segment frames (rotation, origin) of foot, shank, patella (unused), thigh, pelvis.
fn poses(row: &HashMap<String, String>, anatomy: &Anatomy, advance: f64, knee: Knee) -> [Frame; 5] {
    let prefix = match knee {
        Knee::Hinge => "",
        Knee::Coupled => "ck_",
    };
    let get = |c: &str| number(row, c);
    let angle = |c: &str| get(&format!("{prefix}{c}_deg"));
    let origin = Vector3::new(get("pelvis_x_m") + advance, get("pelvis_y_m"), get("pelvis_z_m"));
    let pelvis = zxy(get("pelvis_tilt_deg"), get("pelvis_obliquity_deg"), get("pelvis_rotation_deg"));
    let thigh = pelvis * zxy(angle("hip_flexion"), angle("hip_adduction"), angle("hip_internal_rotation"));
    let hip = origin + pelvis * anatomy.pelvis.hip;
    let shift = match knee {
        Knee::Hinge => Vector3::zeros(),
        Knee::Coupled => crate::kinematics::coupled_knee(angle("knee_flexion").to_radians()).1,
    };
    let knee_centre = hip + thigh * (anatomy.thigh.knee + shift);
    let shank = thigh * zxy(-angle("knee_flexion"), angle("knee_adduction"), angle("knee_internal_rotation"));
    let ankle = knee_centre + shank * anatomy.shank.ankle;
    let foot =
        shank * zxy(angle("ankle_dorsiflexion"), angle("ankle_inversion"), angle("ankle_internal_rotation"));
    let unused = (Matrix3::identity(), Vector3::zeros());
    let mut frames = [unused; 5];
    frames[SegmentId::Foot.index()] = (foot, ankle);
    frames[SegmentId::Shank.index()] = (shank, knee_centre);
    frames[SegmentId::Thigh.index()] = (thigh, hip);
    frames[SegmentId::Pelvis.index()] = (pelvis, origin);
    frames
}

fn ankle_centre(row: &HashMap<String, String>, anatomy: &Anatomy, advance: f64) -> Vector3<f64> {
    poses(row, anatomy, advance, Knee::Hinge)[SegmentId::Foot.index()].1
}
