//! Do motion and muscle files open in OpenSim on its gait2392 model, and do its bodies stand there as ours do?
//!
//! Needs Python with OpenSim 4.6 (`pip install opensim==4.6`): `SARTORIUS_PYTHON=venv/bin/python`, or `python3`. Skipped with a notice where it is
//! absent.

#![allow(non_snake_case)]

use std::path::{Path, PathBuf};
use std::process::Command;

use command::output::{opensim, sto, tables};
use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use multibody::natural::{self, SegmentId};
use multibody::trial::Side;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;
use support::shared;

/// Python that has OpenSim.
fn python() -> Option<PathBuf> {
    let python = PathBuf::from(std::env::var_os("SARTORIUS_PYTHON").unwrap_or("python3".into()));
    // In a folder of its own: OpenSim leaves a log where it runs.
    let folder = tempfile::tempdir().unwrap();
    let asked = Command::new(&python).args(["-c", "import opensim"]).current_dir(folder.path()).output();
    if asked.as_ref().is_ok_and(|answer| answer.status.success()) {
        return Some(python);
    }
    eprintln!(
        "notice: {} has no OpenSim (pip install opensim==4.6, or set SARTORIUS_PYTHON); whether OpenSim reads our files is NOT checked",
        python.display()
    );
    None
}

/// What OpenSim says of motions (one per side) and of storage files in `folder`.
fn ask(python: &Path, folder: &Path, motions: &[&str], tables: &[&str]) -> Option<Value> {
    let model = shared("gait/gait2392")?.join("gait2392_thelen2003muscle.osim");
    let output = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("read_in_opensim.py"))
        .arg(model.canonicalize().unwrap())
        .args(motions)
        .arg("--")
        .args(tables)
        .current_dir(folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let answer = said.split_once("JSON").map(|(_, json)| json);
    assert!(output.status.success() && answer.is_some(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_str(answer.unwrap()).unwrap())
}

/// Rotation and origin \[m\] of a body in a frame.
fn body(frame: &Value, name: &str) -> (Matrix3<f64>, Vector3<f64>) {
    let row = |i: usize| -> Vec<f64> {
        frame["bodies"][name][i].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let R = Matrix3::from_row_slice(&[row(0), row(1), row(2)].concat());
    (R, Vector3::from_vec(row(3)))
}

/// Axes of our pelvis: Z along the ASISs, X forward.
fn pelvis_axes(done: &Optimized, k: usize) -> Matrix3<f64> {
    let Q = &done.motion.Q[k];
    let z = natural::block(Q, SegmentId::Pelvis.block(3)).normalize();
    let y = z.cross(&natural::block(Q, SegmentId::Pelvis.block(0))).normalize();
    Matrix3::from_columns(&[y.cross(&z), y, z])
}

/// Angle of the turn from one to the other \[deg\].
fn angle(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    // By the distance, which a cosine does not resolve.
    2.0 * ((a - b).norm() / 8_f64.sqrt()).asin().to_degrees()
}

fn write(file: &Path, series: &tables::Series, degrees: bool) {
    sto::write(&mut std::fs::File::create(file).unwrap(), "a walk", series, degrees).unwrap();
}

#[test]
fn bodies_of_gait2392_stand_in_opensim_as_ours_do() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let done = optimize(&OptimizeOptions::default()).unwrap();
    for (name, side) in [("right.mot", Side::Right), ("left.mot", Side::Left)] {
        write(&folder.path().join(name), &opensim::motion(&done.model, &done.motion, side), true);
    }
    let forces = opensim::renamed(&tables::muscle_forces(&done.effort).without_units(), Side::Right);
    write(&folder.path().join("forces.sto"), &forces, false);
    let left = opensim::renamed(&tables::activations(&done.effort), Side::Left);
    write(&folder.path().join("left.sto"), &left, false);
    let Some(answer) = ask(&python, folder.path(), &["right.mot", "left.mot"], &["forces.sto", "left.sto"])
    else {
        return;
    };
    println!("OpenSim {}", answer["version"]);
    assert_eq!(
        answer["motions"][0]["names"], answer["coordinates"],
        "every coordinate, in the order of the model"
    );
    for table in answer["tables"].as_array().unwrap() {
        assert_eq!((&table["rows"], table["unknown"].as_array().unwrap().len()), (&101.into(), 0), "{table}");
        assert_eq!(table["names"].as_array().unwrap().len(), 43);
    }

    let [right, left] = [0, 1].map(|m| answer["motions"][m]["frames"].as_array().unwrap());
    assert_eq!((right.len(), left.len()), (101, 101));
    let column = |name: &str| done.motion.angles.columns.iter().position(|c| c == name).unwrap();
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let asis = |k: usize, name: &str| {
        done.case.trial.markers.iter().find(|m| m.name == name).unwrap().position[k].unwrap()
    };
    let (mut axis, mut knees, mut off_asis) = (0.0_f64, Vec::new(), 0.0_f64);
    let mut pitches = Vec::new();
    for (frame, (row, mirrored)) in done.motion.report.clone().zip(right.iter().zip(left)) {
        let Q = &done.motion.Q[frame];
        let at = |s| done.model.pose(s, Q);
        assert!((row["time"].as_f64().unwrap() - done.motion.time[frame]).abs() < 1e-9);
        // Pelvis and thigh stand as ours do, by other code and another library.
        let (pelvis, origin) = body(row, "pelvis");
        let (femur, hip) = body(row, "femur_r");
        assert!(angle(&pelvis, &pelvis_axes(&done, frame)) < 1e-6);
        assert!(angle(&femur, &at(SegmentId::Thigh).R) < 1e-6);
        off_asis =
            off_asis.max((origin - 0.5 * (asis(frame, "right ASIS") + asis(frame, "left ASIS"))).norm());
        // The hip lies where gait2392 has it: 70.7 mm behind, 66.1 below and 83.5 to the right of the ASISs' midpoint.
        assert!((pelvis.transpose() * (hip - origin) - Vector3::new(-0.0707, -0.0661, 0.0835)).norm() < 1e-9);
        // The knee bends about one axis there; ours adds adduction and rotation.
        let (tibia, knee) = body(row, "tibia_r");
        let bend = (femur.transpose() * tibia).column(0).into_owned();
        let flexion = done.motion.angles.values[(frame, column("knee_flexion"))];
        assert!((bend.y.atan2(bend.x) + flexion).abs() < 1e-6, "extension is positive in gait2392");
        let off = tibia.column(1).angle(&at(SegmentId::Shank).R.column(1));
        let adduction = done.motion.angles.values[(frame, column("knee_adduction"))];
        assert!(
            (off - adduction.abs()).abs() < 1e-6,
            "the long axes of the shanks differ by {off}, by the adduction of the knee"
        );
        axis = axis.max(off.to_degrees());
        knees.push((flexion, (pelvis.transpose() * (body(row, "talus_r").1 - knee)).x));
        // Pitch of the foot: of gait2392, and of ours.
        let pitch = |R: &Matrix3<f64>| R.column(0).y.asin().to_degrees();
        pitches.push([pitch(&body(row, "calcn_r").0), pitch(&at(SegmentId::Foot).R)]);
        // The other leg as the mirror image.
        for name in ["pelvis", "femur", "tibia", "calcn"] {
            let (r, l) = if name == "pelvis" {
                (name.into(), name.into())
            } else {
                (format!("{name}_r"), format!("{name}_l"))
            };
            let ((R, p), (Rl, pl)) = (body(row, &r), body(mirrored, &l));
            assert!((mirror * p - pl).norm() < 1e-6, "{name}: {p} and {pl}");
            assert!(angle(&(mirror * R * mirror), &Rl) < 1e-4, "{name}");
        }
    }
    println!(
        "ASIS midpoint within {:.1} mm of the markers, long axis of the shank within {axis:.1} degrees",
        1e3 * off_asis
    );
    assert!(off_asis < 0.01);
    // Most bent in swing, the foot behind the knee then.
    let most = knees.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    assert!(most.0.to_degrees() > 45.0 && most.1 < -0.2, "{most:?}");
    // Flat in mid-stance, heel up before toe off, and in between as much as our foot turns.
    let flat: Vec<&[f64; 2]> = pitches[20..40].iter().collect();
    let mean = |i: usize| flat.iter().map(|p| p[i]).sum::<f64>() / flat.len() as f64;
    let level = [mean(0), mean(1)];
    println!(
        "the foot of gait2392 is pitched by {:.1} degrees in mid-stance, by {:.1} at toe off",
        level[0], pitches[62][0]
    );
    assert!(level[0].abs() < 5.0, "{level:?}");
    assert!(pitches[62][0] - level[0] < -30.0, "the heel is up at toe off: {:?}", pitches[62]);
    for [generic, own] in &pitches {
        let turned = (generic - level[0]) - (own - level[1]);
        assert!(turned.abs() < 10.0, "{generic} and {own}");
    }
}

#[test]
fn frames_that_were_not_fitted_are_absent_and_nothing_is_not_a_number() {
    let mut done = optimize(&OptimizeOptions::default()).unwrap();
    let first = done.motion.report.start;
    done.motion.fit[first + 3].failure = Some("no markers".into());
    let series = opensim::motion(&done.model, &done.motion, Side::Right);
    assert_eq!(series.time.len(), 100);
    assert!(!series.time.contains(&done.motion.time[first + 3]));
    assert_eq!(series.columns.len(), 23);
    assert!(
        series.columns.iter().all(|(_, values)| values.len() == 100 && values.iter().all(|v| v.is_finite()))
    );
    // The heel strikes with the hip bent, the knee never beyond straight by more than a few degrees.
    let of = |name: &str| &series.columns.iter().find(|(n, _)| n == name).unwrap().1;
    assert!(of("hip_flexion_r")[0] > 15.0);
    assert!(of("knee_angle_r").iter().all(|v| (-75.0..10.0).contains(v)));
    assert!(of("hip_flexion_l").iter().all(|v| *v == 0.0));
}
