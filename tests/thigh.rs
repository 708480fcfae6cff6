//! The thigh between the two models: registration of the bones, attachments, fibres, calibration curves.

#![allow(non_snake_case)]

use mesher::MusclePart;
use std::path::Path;

use coupling::comparison::SETTINGS;
use coupling::fibres::alone::alone;
use coupling::fibres::muscle_unit::MuscleUnit;
use coupling::fibres::thermal_calibration::FibreCurve;
use coupling::fibres::{FibreCalibration, FibreTask};
use coupling::optimize::{OptimizeOptions, optimize};
use coupling::scene::Fibres;
use coupling::scene::StepName;
use coupling::scene::StressFree;
use coupling::steps::rigid_step;
use coupling::steps::{rigid_muscles_at, rigid_muscles_standing};
use coupling::thigh::build::{Thigh, ThighEffects, build, reaches};
use coupling::thigh::lines::physiological_sections;
use coupling::thigh::registration::{BODIES, MeshFrames, Registration};
use coupling::thigh::tables::{ATTACHMENTS, MUSCLE_SECTIONS};
use coupling::thigh::trial::{MuscleAlone, Task};
use coupling::two_way::capacity::{MuscleAction, VirtualTwists, as_units};
use fem::body::Wrench;
use fem::geometry::{SearchSurface, Surface};
use fem::measure::{Cut, nodal_forces, section_force};
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use mesher::attachment::{Attachment, Role, Site};
use mesher::fibres::{end_stiffness, fibres, mean_section};
use mesher::grid::{SectionKind, fill, layers};
use mesher::{Loft, MuscleBlock, MuscleSections};
use multibody::kinematics::coupled_leg;
use multibody::muscle::curves::Curves;
use multibody::muscle::hill::equilibrium;
use multibody::muscle::musculotendon::MusculotendonModel;
use multibody::natural::SegmentId;
use nalgebra::{Matrix3, Vector3};

fn frames() -> MeshFrames {
    let turn = |x, y, z| nalgebra::Rotation3::from_euler_angles(x, y, z).into_inner();
    MeshFrames {
        pelvis: turn(0.01, -0.02, 0.08),
        thigh: turn(0.03, 0.09, -0.01),
        hip: Vector3::new(1e-3, -2e-3, 3e-3),
        knee: Vector3::new(-5.7e-3, -0.4122, -15.1e-3),
    }
}

fn block(name: &str) -> MuscleBlock {
    let all = MuscleSections::read_csv(MUSCLE_SECTIONS, Path::new("muscle_sections.csv")).unwrap();
    let sections = all.iter().find(|s| s.name == name).unwrap();
    let h = 8e-3;
    let grid = SectionKind::rings(sections, h).grid();
    fill(name, &Loft::new(sections), &grid, layers(sections, h, 1.0))
}

#[test]
fn a_straight_leg_leaves_the_bones_where_they_were_meshed() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let model = &done.model;
    let frames = frames();
    let registration = Registration::new(frames, model).unwrap();
    // A leg whose knee is straight and whose pelvis stands to the thigh as in the mesh.
    let mut Q = done.motion.Q[done.motion.report.start];
    let thigh = model.pose(SegmentId::Thigh, &Q);
    let knee = multibody::natural::block(&Q, SegmentId::Thigh.block(2));
    let [shank, patella] = coupled_leg(&model.shapes, 0.0).unwrap();
    for (segment, pose) in [(SegmentId::Shank, shank), (SegmentId::Patella, patella)] {
        let pose = multibody::natural::Pose { R: thigh.R * pose.R, p: knee + thigh.R * pose.p };
        model.shapes[segment.index()].write(segment, &pose, &mut Q);
    }
    let straight = registration.poses(model, &Q);
    for (name, pose) in BODIES.iter().zip(&straight).skip(1) {
        let moved = pose.translation.vector.norm() + pose.rotation.angle();
        assert!(moved < 1e-9, "{name} moved by {moved:e}");
    }
    // The pelvis turns about the hip centre only, and its axes come to lie on those of the rigid pelvis.
    let at_hip = straight[0] * nalgebra::Point3::from(frames.hip);
    assert!((at_hip.coords - frames.hip).norm() < 1e-12);
    let w = multibody::natural::block(&Q, SegmentId::Pelvis.block(3)).normalize();
    let z = straight[0].rotation * frames.pelvis.column(2);
    assert!((z - registration.direction(model, &Q, &w)).norm() < 1e-9);
}

#[test]
fn bones_move_in_the_mesh_as_they_do_on_the_ground() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let (model, frames) = (&done.model, frames());
    let registration = Registration::new(frames, model).unwrap();
    let first = done.motion.report.start;
    let Q = [done.motion.Q[first], done.motion.Q[first + 40]];
    let poses = Q.map(|q| registration.poses(model, &q));
    for (body, segment) in [(0, SegmentId::Pelvis), (2, SegmentId::Patella), (3, SegmentId::Shank)] {
        let angle = |a: Matrix3<f64>| ((a.trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
        let relative = |q| model.pose(SegmentId::Thigh, q).R.transpose() * model.pose(segment, q).R;
        let on_ground = angle(relative(&Q[0]).transpose() * relative(&Q[1]));
        let in_mesh = (poses[0][body].rotation.inverse() * poses[1][body].rotation).angle();
        assert!(on_ground > 0.05 && (on_ground - in_mesh).abs() < 1e-7, "{segment:?}: {on_ground} {in_mesh}");
    }
    // The patellar tendon keeps its length: patella and shank fit each other.
    let step = rigid_step(&done, &registration, StepName::LoadingResponse).unwrap();
    assert_eq!(step.muscles.len(), 17);
    let knee = step.knee_flexion.to_degrees();
    assert!((20.0..30.0).contains(&knee), "{knee}");
    for line in step.muscles.iter().flat_map(|m| &m.lines) {
        let i = model.muscles.iter().position(|m| m.name == line.name).unwrap();
        let q = &done.motion.Q[first + step.row];
        let length: f64 = line.path.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
        assert!((length - model.muscles[i].length(q, -step.knee_flexion)).abs() < 1e-12, "{}", line.name);
    }
}

#[test]
fn the_leg_at_a_flexion_satisfies_its_joint_equations() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let model = &done.model;
    for flexion in [0.0_f64, 15.0, 60.0, 100.0] {
        let poses = coupled_leg(&model.shapes, flexion.to_radians()).unwrap();
        let mut Q = done.motion.Q[done.motion.report.start];
        let thigh = model.pose(SegmentId::Thigh, &Q);
        let knee = multibody::natural::block(&Q, SegmentId::Thigh.block(2));
        for (segment, pose) in [SegmentId::Shank, SegmentId::Patella].into_iter().zip(poses) {
            let pose = multibody::natural::Pose { R: thigh.R * pose.R, p: knee + thigh.R * pose.p };
            model.shapes[segment.index()].write(segment, &pose, &mut Q);
        }
        // Equations of knee and patella; ankle and hip do not belong to the question.
        let mut phi = Vec::new();
        let table = multibody::tables::JointTable::built_in();
        let [shank, patella, thigh] =
            [SegmentId::Shank, SegmentId::Patella, SegmentId::Thigh].map(|s| model.shapes[s.index()]);
        let knee = multibody::joint::knee(table, &thigh, &shank);
        let patella = multibody::joint::patella(table, &thigh, &patella, &shank);
        knee.iter().chain(&patella).for_each(|e| e.residual(&Q, &mut phi));
        assert!(phi.iter().all(|r| r.abs() < 1e-10), "at {flexion} deg: {phi:?}");
    }
}

#[test]
fn attachments_name_the_right_nodes() {
    let all = Attachment::read_csv(ATTACHMENTS, Path::new("attachments.csv")).unwrap();
    assert_eq!(all.iter().filter(|a| a.role == Role::Contact).count(), 1);
    let block = block("vastus_intermedius");
    let own: Vec<_> = all.iter().filter(|a| a.muscle == block.name).collect();
    let face = own.iter().find(|a| a.role == Role::Origin && a.site == Site::EndFace).unwrap();
    assert_eq!(face.nodes(&block), (0..block.nodes_per_section as u32).collect::<Vec<_>>());
    let patch = own.iter().find(|a| matches!(a.site, Site::SidePatch { .. })).unwrap();
    let nodes = patch.nodes(&block);
    // Side 2 and both its corners, 88 % of the length: nothing of side 1, nothing inside, nothing at the ends.
    for &n in &nodes {
        let (layer, local) = (n as usize / block.nodes_per_section, n % block.nodes_per_section as u32);
        let k = block.outline.iter().position(|&o| o == local).expect("on the outline");
        assert!((5.0..=13.0).contains(&block.outline_parameter[k]), "{}", block.outline_parameter[k]);
        assert!((0.04..=0.92).contains(&block.s[layer]));
    }
    let on_side = block.outline_parameter.iter().filter(|t| (5.0..=13.0).contains(*t)).count();
    let in_range = block.s.iter().filter(|s| (0.04..=0.92).contains(*s)).count();
    assert_eq!(nodes.len(), on_side * in_range);
}

#[test]
fn a_wrong_attachment_is_refused_with_its_line() {
    for (right, wrong, says) in [
        ("gracilis,insertion,side_patch,shank", "gracilis,insertion,side_patch,calf", "segment is `calf`"),
        ("gracilis,insertion,side_patch", "gracilis,insertion,glued", "kind is `glued`"),
        (
            "gracilis,insertion,side_patch,shank,tibia,0.96,1.00",
            "gracilis,insertion,side_patch,shank,tibia,0.96,1.40",
            "0 <= s_from",
        ),
        ("side1+endA (points 12-6),13.4", "side1+endA (points 12-26),13.4", "points are numbered 0 to 13"),
        ("-413.5 -1.7; 0.1 -1.2 -9.1; 1.7 -0.9 0.2", "-413.5 -1.7; 0.1 -1.2 -9.1", "two half sides"),
        ("0.1 -1.2 -9.1; 1.7 -0.9 0.2", "0.1 -1.2 -9.1; 0.1 -1.2 -9.1", "span no area"),
    ] {
        let text = ATTACHMENTS.replacen(right, wrong, 1);
        let line = ATTACHMENTS.lines().zip(text.lines()).position(|(a, b)| a != b).expect("a line differs");
        let error = Attachment::read_csv(&text, Path::new("mine.csv")).unwrap_err().to_string();
        assert!(error.contains("mine.csv") && error.contains(says), "{error}");
        assert!(error.contains(&format!("line {}", line + 1)), "{error}");
    }
}

#[test]
fn fibres_share_the_section_and_run_from_end_to_end() {
    let block = block("rectus_femoris");
    let section = 33.6e-4;
    let fibres = fibres(&block, section, 1);
    let per_fibre = block.n_layers() - 1;
    assert_eq!(fibres.segments.len(), block.nodes_per_section * per_fibre);
    let mut total = 0.0;
    for (segments, areas) in fibres.segments.chunks(per_fibre).zip(fibres.area.chunks(per_fibre)) {
        assert!(areas.iter().all(|a| *a == areas[0] && *a > 0.0));
        total += areas[0];
        assert!(segments.windows(2).all(|s| s[0][1] == s[1][0]));
        assert_eq!(segments[per_fibre - 1][1] as usize / block.nodes_per_section, per_fibre);
    }
    assert!((total / section - 1.0).abs() < 1e-12);
    // Farther apart: fewer, with the same section, and none within the spacing of another.
    let apart = mesher::fibres::fibres(&block, section, 2);
    let kept: Vec<u32> = apart.segments.iter().step_by(per_fibre).map(|s| s[0]).collect();
    let n = block.nodes_per_section;
    assert!(kept.len() * 2 < n && kept.len() * 9 >= n, "{} of {n}", kept.len());
    assert!(block.section_cells.iter().all(|cell| cell.iter().filter(|k| kept.contains(k)).count() <= 1));
    let apart: f64 = apart.area.iter().step_by(per_fibre).sum();
    assert!((apart / section - 1.0).abs() < 1e-12);
    // Handsfield-free check: volume over length of this muscle is 331 cm³ over 451 mm.
    assert!((mean_section(&block) / (331.2e-6 / 0.451) - 1.0).abs() < 0.05);
    let stiffness = end_stiffness(&block, 40.0, 3);
    assert_eq!(stiffness.len(), block.n_cells());
    let layer = block.section_cells.len();
    assert_eq!((stiffness[0], stiffness[stiffness.len() - 1]), (40.0, 40.0));
    assert_eq!(stiffness[layer * per_fibre / 2], 1.0);
}

/// Rows of a comparison as (step, muscle, numbers).
fn comparison(path: &Path) -> Vec<(String, String, Vec<Option<f64>>)> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    assert_eq!(
        header.join(","),
        "step,muscle,activation,rigid_N,fe_no_contact_N,fe_contact_N,difference_no_contact_N,difference_contact_N,\
         fibre_N,matrix_N,shell_N"
    );
    let rows = reader.records().map(|r| r.unwrap());
    rows.map(|r| (r[0].into(), r[1].into(), r.iter().skip(2).map(|c| c.parse().ok()).collect())).collect()
}

#[test]
fn calibrated_muscles_pull_as_the_rigid_leg_says_where_the_bones_stand_still() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("compared");
    let arguments = [
        "compare",
        "--resolution",
        "14",
        "--stress-free",
        "heel-strike",
        "--contact",
        "without",
        "--only",
        "gluteus_minimus,gluteus_medius",
    ];
    let output =
        support::sartorius(&[&arguments[..], &["--out", out.to_str().unwrap()]].concat(), folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = comparison(&out.join("comparison.csv"));
    assert_eq!(rows.len(), 4);
    for (step, muscle, v) in &rows {
        let [_, rigid, fe, contact, difference, _, fibre, matrix, shell] = v[..] else { panic!("{v:?}") };
        let (rigid, fe) = (rigid.unwrap(), fe.unwrap());
        assert!(contact.is_none() && (difference.unwrap() - (fe - rigid)).abs() < 2e-3);
        let parts = fibre.unwrap() + matrix.unwrap() + shell.unwrap();
        assert!((parts - fe).abs() < 5e-3, "{step} {muscle}: parts {parts} N of {fe} N");
        // Bones stand still at heel strike: what is left is interpolation between the samples of the calibration.
        if step == "heel_strike" {
            assert!(rigid > 50.0 && (fe / rigid - 1.0).abs() < 0.02, "{muscle}: {fe} N for {rigid} N");
        }
    }
    assert!(out.join("run.json").exists() && out.join("no_contact/thigh.pvd").exists());
}

#[test]
fn a_comparison_of_an_unknown_muscle_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = support::sartorius(&["compare", "--only", "gluteus_medium"], folder.path());
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("gluteus_medium") && said.contains("gluteus_medius"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_fibre_curve_is_monotone_and_meets_its_samples() {
    let curve = FibreCurve { contraction: vec![0.0, 0.05, 0.1, 0.3], force: vec![0.0, 2.0, 40.0, 200.0] };
    for (c, f) in curve.contraction.iter().zip(&curve.force) {
        assert!((curve.contraction_for(*f).unwrap() - c).abs() < 1e-12);
    }
    let mut last = 0.0;
    for k in 1..=400 {
        let c = curve.contraction_for(0.5 * f64::from(k)).unwrap();
        assert!(c > last, "at {} N", 0.5 * f64::from(k));
        last = c;
    }
    assert_eq!(curve.contraction_for(200.1), None);
    assert_eq!(curve.contraction_for(0.0), Some(0.0));
}

#[test]
fn a_unit_pulls_as_its_lines_and_its_drive_gives_their_force_back() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let registration = Registration::new(MeshFrames::built_in(), &done.model).unwrap();
    let standing = rigid_muscles_standing(&done.model, &registration);
    let units = &MusculotendonModel::generic().units;
    let step = rigid_step(&done, &registration, StepName::LoadingResponse).unwrap();
    let mut driven = 0;
    for meshed in &standing {
        let unit = MuscleUnit::new(meshed, Curves::default());
        let at = step.muscle(&meshed.name).unwrap();
        let drive = unit.drive(at).unwrap();
        // A single line: the force of the Hill model, and of the sharing where the activation was not clipped.
        if let [line] = &at.lines[..] {
            let own = units.iter().find(|u| u.short_name == line.name).unwrap();
            let force =
                |a: f64| equilibrium(own, &Curves::default(), line.length, 0.0, a).map_or(0.0, |e| e.force);
            assert!((unit.force_at(at, 0.4) - force(0.4)).abs() < 1e-9 * own.f_max, "{}", line.name);
            assert!(
                (unit.force(line.length - meshed.lines[0].length, 0.4) - force(0.4)).abs() < 1e-9 * own.f_max
            );
            if line.activation > 1e-3 && line.activation < 0.999 {
                driven += 1;
                assert!((line.hill_force - line.force).abs() < 1e-3 * own.f_max, "{}: {line:?}", line.name);
                assert!((force(drive) - line.force).abs() < 1e-3 * own.f_max, "{}", line.name);
            } else if line.activation == 0.0 {
                assert_eq!(drive, 0.0, "{}", line.name);
            }
        }
        assert!((0.0..=1.8).contains(&drive));
        assert!((unit.drive_for(0.0, unit.force(0.0, 0.3)) - 0.3).abs() < 1e-6, "{}", meshed.name);
    }
    assert!(driven > 1);
}

#[test]
fn flexing_the_registered_leg_flexes_its_joints() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let model = &done.model;
    let registration = Registration::new(MeshFrames::built_in(), model).unwrap();
    let angles = |Q| multibody::kinematics::joint_angles(&model.shapes, &Q);
    let still = angles(registration.standing(model));
    let bent = angles(registration.posture(model, 0.3, 0.5).unwrap());
    assert!((bent[3] - still[3] - 0.5).abs() < 1e-6, "knee {} to {}", still[3], bent[3]);
    assert!((bent[0] - still[0] - 0.3).abs() < 0.02, "hip {} to {}", still[0], bent[0]);
}

/// Forces of a frame that nothing within its bounds carries are no forces to drive a thigh with.
#[test]
fn a_frame_without_a_solution_is_no_step() {
    let mut done = optimize(&OptimizeOptions::default()).unwrap();
    let registration = Registration::new(MeshFrames::built_in(), &done.model).unwrap();
    let verdict = &mut done.effort.verdicts[0];
    verdict.status = multibody::trial::Status::Infeasible;
    verdict.reason = Some("hip_flexion lacks 3 N·m".into());
    let error = rigid_step(&done, &registration, StepName::HeelStrike).unwrap_err();
    assert!(error.contains("heel_strike") && error.contains("hip_flexion lacks 3 N·m"), "{error}");
}

/// Lever arms from the virtual work of forces on the bones: of the lines of the rigid leg they are those of its equilibrium.
#[test]
fn virtual_work_on_the_bones_gives_the_lever_arms_of_the_lines() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let model = &done.model;
    let registration = Registration::new(MeshFrames::built_in(), model).unwrap();
    for row in [0, 12, 60] {
        let Q = &done.motion.Q[done.motion.report.start + row];
        let reduced = done.loads.reduced[row].as_ref().unwrap();
        let twists = VirtualTwists::new(model, &registration, Q, &reduced.tangent);
        let hip = registration.frames().hip;
        let (mut compared, mut unit, mut arms) = (0, Vec::new(), Vec::new());
        for muscle in rigid_muscles_at(model, &registration, Q) {
            for line in &muscle.lines {
                let i = model.muscles.iter().position(|m| m.name == line.name).unwrap();
                let fe = multibody::muscle::path::knee_angle(&model.shapes, Q);
                let segments: Vec<SegmentId> = model.muscles[i].points(fe).map(|p| p.segment).collect();
                let mut moments = nalgebra::DVector::zeros(reduced.moments.len());
                for (k, segment) in segments.iter().enumerate() {
                    let here = line.path[k];
                    let mut force = Vector3::zeros();
                    for other in
                        [k.checked_sub(1), (k + 1 < segments.len()).then_some(k + 1)].into_iter().flatten()
                    {
                        force += (line.path[other] - here).normalize();
                    }
                    let mut wrench = Wrench::default();
                    wrench.add((here - hip).into(), force.into());
                    let body = match segment {
                        SegmentId::Thigh => "thigh",
                        SegmentId::Patella => "patella",
                        SegmentId::Shank => "shank",
                        _ => "pelvis",
                    };
                    moments += twists.work(body, &wrench);
                }
                compared += 1;
                let away = (&moments - reduced.lever_arms.column(i)).amax();
                assert!(away < 1e-6, "{} at {row}: {away} m off", line.name);
                // Its head of the quadriceps, with a tension that is unlike that of the others.
                let force =
                    [0.0, 10.0, 300.0, 70.0][unit.len() % 4] * f64::from(muscle.name.contains("vastus"));
                if muscle.name.contains("vastus") || muscle.name == "rectus_femoris" {
                    let moments = force * &moments;
                    let lever_arms = vec![None; moments.len()];
                    arms.push(reduced.lever_arms[(3, i)]);
                    unit.push(MuscleAction {
                        force,
                        tissue: 0.0,
                        stretch: 1.0,
                        moments,
                        lever_arms,
                        resultant: Vector3::zeros(),
                    });
                }
            }
        }
        assert_eq!(compared, 25);
        // Sewn together they are one unit, and lines keep their arms, slack ones too; what seams pass from head to head does not matter.
        assert_eq!(unit.len(), 4);
        let whole: f64 = unit.iter().map(|a| a.moments[3]).sum();
        (unit[0].moments[3], unit[2].moments[3]) = (unit[0].moments[3] + 5.0, unit[2].moments[3] - 5.0);
        as_units(&mut unit, &[vec![0, 1, 2, 3]], 3, &|m| arms[m]);
        for (action, arm) in unit.iter().zip(&arms) {
            assert!((action.lever_arms[3].unwrap() - arm).abs() < 1e-6, "{action:?}: {arm}");
            assert!((action.moments[3] - arm * action.force).abs() < 1e-3, "{action:?}: {arm}");
        }
        assert!((unit.iter().map(|a| a.moments[3]).sum::<f64>() - whole).abs() < 1e-9);
    }
}

/// The calibration knows nothing of the steps, and calibrated muscles pull as their lines do at the same activation and length.
#[test]
fn hill_fibres_are_calibrated_alone_and_never_on_a_step() {
    let done = optimize(&OptimizeOptions::default()).unwrap();
    let registration = Registration::new(MeshFrames::built_in(), &done.model).unwrap();
    let only = ["gluteus_minimus".to_string(), "gluteus_medius".to_string()];
    let made =
        coupling::thigh::built_in(14e-3, &only, ThighEffects { fibres: Some(1), shells: true }).unwrap();
    let step = |name| rigid_step(&done, &registration, name).unwrap();
    let calibrate = |steps: &[coupling::steps::RigidStep], check: bool| {
        let fibres = FibreTask {
            thigh: &made.thigh,
            model: &done.model,
            registration: &registration,
            steps,
            stress_free: StressFree::Standing,
            kind: Fibres::Hill,
            check,
        };
        let fibres = fibres.calibrate(&SETTINGS, None).unwrap();
        let FibreCalibration::Hill { muscles, .. } = fibres.calibration.fibres else { panic!("Hill fibres") };
        (muscles, fibres.controls)
    };
    let (muscles, controls) = calibrate(&[step(StepName::HeelStrike), step(StepName::LoadingResponse)], true);
    // What is looked at afterwards changes nothing.
    let (again, other) = calibrate(&[step(StepName::LoadingResponse)], false);
    for (looked, not) in muscles.iter().zip(&again) {
        assert_eq!(
            (&looked.muscle, looked.fit, &looked.samples[..1]),
            (&not.muscle, not.fit, &not.samples[..])
        );
    }
    assert_eq!(controls[1], other[0]);
    for muscle in &muscles {
        assert!(
            (0.9..1.0).contains(&muscle.fit.rest) && (1.0..1.2).contains(&muscle.fit.gain),
            "{:?}",
            muscle.fit
        );
        assert_eq!(muscle.samples.len(), 5);
        for sample in &muscle.samples {
            let off = (sample.found / sample.rigid_at_length - 1.0).abs();
            assert!(off < 0.03, "{}: {sample:?}", muscle.muscle);
        }
        // Where the fit is made it is no more than the round-off of the solution and what the fit itself moves.
        let fitted = &muscle.samples[0];
        assert!((fitted.found / fitted.rigid - 1.0).abs() < 5e-3, "{}: {fitted:?}", muscle.muscle);
    }
}

/// Slack, bent and slender: what a tangent at rest throws into a zigzag. Pulled taut, the fibres lie straight between the ends, and
/// the muscle pulls as springs of that length.
#[test]
fn slender_muscles_bear_being_stretched() {
    let only = ["sartorius".to_string(), "gracilis".to_string()];
    let made =
        coupling::thigh::built_in(7e-3, &only, ThighEffects { fibres: Some(1), shells: false }).unwrap();
    for (muscle, built) in made.thigh.muscles.iter().zip(&made.built.muscles) {
        let stretched = MuscleAlone::new(&built.block, muscle.fibre_area).run(Task::Stretch(0.15)).unwrap();
        let (increments, iterations) = (stretched.increments, stretched.iterations);
        assert!(increments <= 10 && iterations <= 60, "{}: {increments}, {iterations}", muscle.name);
        assert!(stretched.least_det_f > 0.0);
        let line = &muscle.line;
        let straight = 1.15 * (line[line.len() - 1] - line[0]).norm();
        let strain = straight / muscle.fibre_length - 1.0;
        // Beyond a toe of 5 %, of which half is slack.
        let springs = 1e6 * muscle.fibre_area * (strain - 0.025);
        let off = stretched.force / springs - 1.0;
        assert!(off.abs() < 0.1, "{}: {} N, springs {springs} N", muscle.name, stretched.force);
    }
}

/// A muscle alone is the island that it is in the whole thigh, and a slack one takes up its tension in one load step.
#[test]
fn a_muscle_alone_is_its_island_and_tightens_in_one_step() {
    let only = ["sartorius".to_string(), "gracilis".to_string()];
    let made =
        coupling::thigh::built_in(14e-3, &only, ThighEffects { fibres: Some(1), shells: true }).unwrap();
    let whole = Plan::new(&made.thigh.scene, made.thigh.mesh.clone()).unwrap();
    for (i, muscle) in made.thigh.muscles.iter().enumerate() {
        let thigh = alone(&made.thigh, i);
        let plan = Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap();
        let [island] = &plan.islands[..] else { panic!("one island") };
        let there = whole.islands.iter().find(|i| i.name == muscle.name).unwrap();
        assert_eq!((island.n_unknowns(), &island.X), (there.n_unknowns(), &there.X), "{}", muscle.name);
        assert_eq!(
            thigh.fibre_stretch(0, &plan.reference()),
            made.thigh.fibre_stretch(i, &whole.reference())
        );

        // Thermal fibres that contract by their slack and 2 % more.
        let line = &muscle.line;
        let length: f64 = line.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
        let contraction = 1.02 - (line[line.len() - 1] - line[0]).norm() / length;
        let load = plan.load(&[(&muscle.name, contraction)], &[]).unwrap();
        let settings = fem::solve::Settings { tolerance: 1e-3, ..SETTINGS };
        let done = Session::new(&plan, &settings, None).unwrap().advance(&DriveFrame { time: 1.0, load });
        assert!(done.errors.is_empty(), "{:?}", done.errors);
        let way = &done.frame.islands[0];
        assert_eq!((way.load_steps, way.retries), (1, 0), "{}: {way:?}", muscle.name);
    }
}

const HEADS: [&str; 4] = ["rectus_femoris", "vastus_medialis", "vastus_intermedius", "vastus_lateralis"];

/// The quadriceps pulling at the patella, cut where no side of a head grows from the femur any more: forces through the ends of the heads \[N\] and the force on the patella.
fn pull(thigh: &Thigh) -> ([Vector3<f64>; 4], Vector3<f64>) {
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap();
    let controls = HEADS.map(|head| (head, 0.08));
    let mut session = Session::new(&plan, &SETTINGS, None).unwrap();
    let done = session.advance(&DriveFrame { time: 1.0, load: plan.load(&controls, &[]).unwrap() });
    assert!(done.errors.is_empty(), "{:?}", done.errors);
    let at = done.frame.snapshot();
    let heads = HEADS.map(|head| {
        let muscle = thigh.muscles.iter().find(|m| m.name == head).unwrap();
        let layer = muscle.line.len() - 2;
        let effects = ["", "/fibres"].map(|part| format!("{head}{part}")).to_vec();
        let cut = Cut { point: muscle.line[layer].into(), normal: muscle.tangent(layer).into(), effects };
        Vector3::from(section_force(&plan, at, &cut).total.force)
    });
    let g = nodal_forces(&plan, at);
    let ties = thigh.scene.ties.iter().filter(|t| t.body == "patella");
    let nodes = ties.flat_map(|t| &plan.mesh.node_sets[&t.nodes]);
    (
        heads,
        -nodes
            .map(|&n| Vector3::from_column_slice(&g[3 * n as usize..3 * n as usize + 3]))
            .sum::<Vector3<f64>>(),
    )
}

#[test]
fn four_heads_join_in_the_quadriceps_tendon() {
    let only = HEADS.map(String::from);
    let effects = ThighEffects { fibres: Some(1), shells: false };
    let made = coupling::thigh::built_in(9e-3, &only, effects).unwrap();
    let thigh = &made.thigh;
    assert_eq!(thigh.tendons.len(), 4);
    for tendon in &thigh.tendons {
        let block =
            thigh.mesh.blocks.iter().find(|b| b.name == MusclePart::Tendon.of(&tendon.muscle)).unwrap();
        let quality = thigh.mesh.quality(block).unwrap();
        assert!(quality.least_scaled_jacobian >= 0.3 && quality.least_gauss_det > 0.0, "{}", tendon.muscle);
    }
    // Nothing runs through anything else but where a tendon begins and ends, by the exact test of triangles.
    let surface = |name: &str, faces: Vec<[u32; 4]>| {
        let (surface, _) = Surface::from_faces(&thigh.mesh.points, &faces);
        (name.to_string(), SearchSurface::new(surface))
    };
    let muscles = HEADS.map(|head| surface(head, thigh.mesh.surfaces[&format!("{head}/surface")].clone()));
    let tendons: Vec<_> = (thigh.tendons.iter())
        .map(|t| {
            surface(
                &t.muscle,
                thigh.mesh.block(&MusclePart::Tendon.of(&t.muscle)).unwrap().boundary().unwrap(),
            )
        })
        .collect();
    for (i, (name, tendon)) in tendons.iter().enumerate() {
        assert!(tendon.self_intersections().is_empty(), "{name}");
        let other_muscles = muscles.iter().filter(|m| m.0 != *name);
        for (other, skin) in other_muscles.chain(&tendons[i + 1..]) {
            assert!(tendon.intersections(skin).is_empty(), "{name} and {other}");
        }
    }
    // One tendon: what happens to one head, the others feel.
    assert_eq!(thigh.scene.membranes.len(), 3);
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone()).unwrap();
    assert_eq!(plan.islands.iter().filter(|i| i.n_unknowns() > 0).count(), 1);
    // Strands to the same bone, a fan from each head to one point, as without footprints.
    let mut plain = made.attachments.clone();
    plain.iter_mut().for_each(|a| a.footprint = None);
    let blocks: Vec<MuscleBlock> = made.built.muscles.iter().map(|m| m.block.clone()).collect();
    let areas = physiological_sections();
    let fans = build(
        &blocks,
        &plain,
        &|m| areas.get(m).copied(),
        &reaches(&made.bones, Default::default()),
        effects,
    );
    assert!(fans.tendons.is_empty());
    // A head by itself keeps its tendon and loses the seams.
    let own = alone(thigh, 1);
    assert!(own.scene.membranes.is_empty() && own.scene.strands.len() == 2, "{:?}", own.scene.strands);
    let plan = Plan::new(&own.scene, own.mesh.clone()).unwrap();
    let load = plan.load(&[(own.muscles[0].name.as_str(), 0.08)], &[]).unwrap();
    let done = Session::new(&plan, &SETTINGS, None).unwrap().advance(&DriveFrame { time: 1.0, load });
    assert!(done.errors.is_empty(), "{:?}", done.errors);
    let (heads, patella) = pull(thigh);
    let (fan_heads, fan_patella) = pull(&fans);
    let sum: Vector3<f64> = heads.iter().sum();
    assert!((sum + patella).norm() < 1e-3 * sum.norm(), "heads {sum:?}, patella {patella:?}");
    // The heads pull as they do at fans, and in nearly the same directions.
    for (head, (here, there)) in HEADS.iter().zip(heads.iter().zip(&fan_heads)) {
        assert!((here.norm() / there.norm() - 1.0).abs() < 0.15, "{head}: {here:?}, {there:?}");
        assert!(here.angle(there).to_degrees() < 10.0, "{head}: {here:?}, {there:?}");
    }
    assert!(patella.angle(&fan_patella).to_degrees() < 3.0, "{patella:?}, {fan_patella:?}");
}

#[test]
fn the_patellar_ligament_hangs_between_patella_and_tibia() {
    let only = HEADS.map(String::from);
    let made =
        coupling::thigh::built_in(16e-3, &only, ThighEffects { fibres: Some(1), shells: false }).unwrap();
    let (scene, mesh) = (&made.thigh.scene, &made.thigh.mesh);
    let strands: Vec<_> =
        scene.strands.iter().filter(|s| s.region.starts_with("patellar_ligament")).collect();
    // In series with nothing: stiffness over length adds up to the 545 N/mm of the source.
    let stiffness: f64 = strands
        .iter()
        .map(|strand| {
            let [a, b] = mesh.block(&strand.region).unwrap().nodes[..] else { panic!("one line") };
            let place = |n: u32| Vector3::from(mesh.points[n as usize]);
            strand.stiffness / (place(b) - place(a)).norm()
        })
        .sum();
    assert_eq!(strands.len(), 3);
    assert!((stiffness - 545e3).abs() < 1.0, "{stiffness} N/m");
    let bodies: Vec<&str> = (scene.ties.iter())
        .filter(|t| t.nodes.starts_with("patellar_ligament"))
        .map(|t| t.body.as_str())
        .collect();
    assert_eq!(bodies, ["patella", "shank"]);
}
