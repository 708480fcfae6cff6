//! A prescribed motion as a table: does a block that is turned by one stay free of stress, is the way between its rows the right one, and are
//! all mistakes of a file told with their lines?

#![allow(non_snake_case)]

use fem::measure::solid_field;
use fem::mesh::generate;
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::*;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use support::fem_scenes::{mooney_rivlin, plan, solid, tolerance};

/// A block tied to the body `bone` at its lower face, with a pressure on its upper one.
fn block() -> Plan {
    let mesh = generate::block([2; 3], [0.02; 3]);
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        patch_pressures: vec![PatchPressureSpec { surface: "z_max".into(), control: "p".into() }],
        ties: vec![TieSpec { nodes: "z_min".into(), body: "bone".into() }],
        ..Scene::default()
    };
    plan(&scene, &mesh)
}

fn written(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), text).expect("written");
    file
}

#[test]
fn a_block_turned_through_400_degrees_by_a_table_stays_free_of_stress() {
    let mut text = "# turned about (1, 2, 2)/3 while it goes along\ntime_s,p_kPa,bone_x_mm,bone_y_mm,bone_z_mm,bone_rx_deg,bone_ry_deg,bone_rz_deg\n".to_string();
    for i in 0..=4 {
        let angle = 100.0 * f64::from(i);
        text += &format!(
            "{},0,{},0,5,{},{},{}\n",
            0.5 * f64::from(i + 1),
            10 * i,
            angle / 3.0,
            angle * 2.0 / 3.0,
            angle * 2.0 / 3.0
        );
    }
    let plan = block();
    let drive = Drive::read(written(&text).path(), &plan).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(drive.frames.iter().map(|f| f.time).collect::<Vec<_>>(), [0.5, 1.0, 1.5, 2.0, 2.5]);
    let done = run(&plan, &drive.refined(&plan, 0.25), &tolerance(1e-7), None, &mut |_| {});
    assert!(done.is_solved(), "{}", done.errors[0]);
    assert_eq!(done.frames.len(), 9);
    for frame in &done.frames {
        let worst = solid_field(&plan, frame.snapshot(), "block")
            .expect("a solid")
            .iter()
            .map(|c| c.cauchy.amax())
            .fold(0.0, f64::max);
        assert!(worst < 1e-3, "{worst:.1e} Pa at {} s", frame.time);
    }
    // Half way between rows: half the angle, and every node where that takes it.
    let axis = Vector3::new(1.0, 2.0, 2.0) / 3.0;
    for (frame, angle) in [(1, 50.0_f64), (7, 350.0), (8, 400.0)] {
        let R = UnitQuaternion::from_scaled_axis(axis * angle.to_radians());
        let pose = done.frames[frame].load.poses[0];
        assert!(pose.rotation.angle_to(&R) < 1e-9, "frame {frame}: {pose}");
        for (X, x) in plan.mesh.points.iter().zip(done.frames[frame].x.chunks_exact(3)) {
            let apart = (pose * Point3::from(*X)).coords - Vector3::from_row_slice(x);
            assert!(apart.norm() < 1e-9, "{:.1e} m off", apart.norm());
        }
    }
}

#[test]
fn quaternions_units_and_times_between_rows() {
    let plan = block();
    let text = "bone_qw, bone_qx, bone_qy, bone_qz, time_s, p\n1,0,0,0, 1, 100\n0,0,0,1, 3, 300\n";
    let drive = Drive::read(written(text).path(), &plan).unwrap_or_else(|e| panic!("{e}"));
    let load = drive.at(&plan, 1.5).expect("between");
    assert!((load.controls[0] - 150.0).abs() < 1e-12);
    assert!((load.poses[0].rotation.angle() - 45f64.to_radians()).abs() < 1e-12);
    // The centre of the tied face goes straight: it turns to the other side of the z axis.
    let centre = Point3::new(0.01, 0.01, 0.0);
    assert!((load.poses[0] * centre - Point3::new(0.005, 0.005, 0.0)).norm() < 1e-15);
    assert_eq!(drive.at(&plan, 3.0), Some(drive.frames[1].load.clone()));
    assert!(drive.at(&plan, 0.9).is_none() && drive.at(&plan, 3.1).is_none());
    let kilo = Drive::read(written("time_s,p_kPa\n1,2.5\n").path(), &plan).expect("good");
    assert_eq!(kilo.frames[0].load.controls, [2500.0]);
    assert_eq!(kilo.frames[0].load.poses[0], Default::default());
}

#[test]
fn all_mistakes_of_a_table_are_told_with_their_lines() {
    let plan = block();
    let told = |text: &str| {
        let file = written(text);
        let error = Drive::read(file.path(), &plan).expect_err("mistakes").to_string();
        assert!(error.contains(&file.path().display().to_string()), "{error}");
        error
    };
    let text = "time_s,p_psi,bone_x_m,bone_rx_deg,bone_ry_deg,bone_rz_deg,bone_qw\n\
                1,0,0,0,0,0,1\n0.5,0,0,190,0,0,1\n2,0,zero,0,0,inf,1\n3,0,0\n";
    // As saved by a spreadsheet, too.
    let [error, windows] = [told(text), told(&text.replace('\n', "\r\n"))];
    for words in [
        "line 1: column `p_psi`",
        "(p)",
        "(bone",
        "line 1: body `bone` needs all columns of x, y and z",
        "line 1: body `bone` needs all columns of qw",
        "line 1: body `bone` has a rotation vector and a quaternion",
        "line 3: time_s is 0.5, must be above 1",
        "line 3: the rotation vector of `bone` changes by 190 degrees",
        "line 4: `bone_x_m` is `zero`",
        "line 4: `bone_rz_deg` is `inf`",
        "line 5: 3 fields, must be 7 as in the header",
    ] {
        assert!(error.contains(words), "`{words}` is missing: {error}");
        assert!(windows.contains(words), "`{words}` is missing: {windows}");
    }
    assert!(told("p\n1\n").contains("`time_s` is missing"));
    assert!(told("time_s,p,p_kPa\n1,1,1\n").contains("column `p_kPa` gives once more"));
    assert!(told("time_s,p\n").contains("no rows"));
    assert!(told("time_s,bone_qw,bone_qx,bone_qy,bone_qz\n1,1,1,0,0\n").contains("length 1.4142"));
    let absent = Drive::read(std::path::Path::new("absent.csv"), &plan).expect_err("no file").to_string();
    assert!(absent.contains("absent.csv"), "{absent}");
}
