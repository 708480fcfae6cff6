//! Does a run leave files that tell the truth: whole frames, the state before a failure with its reason, and nothing that
//! looks complete when it was killed?

#![allow(non_snake_case)]

use fem::measure::solid_field;
use fem::mesh::{LengthUnit, format::vtu, generate};
use fem::output::run_to_files;
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame};
use fem::scene::{PrescribedSpec, Scene};
use fem::solve::Settings;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use support::fem_scenes::{held, mooney_rivlin, plan, solid};

const SIDE: f64 = 0.02;

/// A block of tetrahedra whose upper plate moves down by `press` times its height at control `press`.
fn pressed(n: usize) -> Plan {
    let mesh = generate::tetrahedra(&generate::block([n; 3], [SIDE; 3]), false);
    let plate = PrescribedSpec {
        displacement: vec![[0.0, 0.0, -SIDE]],
        control: Some("press".to_string()),
        ..held("z_max", [true; 3])
    };
    let scene = Scene {
        solids: vec![solid(&mesh.blocks[0].name, mooney_rivlin(), None)],
        prescribed: vec![held("z_min", [true; 3]), plate],
        ..Scene::default()
    };
    plan(&scene, &mesh)
}

fn drive(plan: &Plan, presses: impl Iterator<Item = f64>) -> Drive {
    let frame = |(i, p)| DriveFrame {
        time: f64::from(i),
        load: plan.load(&[("press", p)], &[]).expect("the control exists"),
    };
    Drive { frames: (0..).zip(presses).map(frame).collect() }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<String> =
        entries.map(|e| e.expect("an entry").file_name().into_string().expect("text")).collect();
    names.sort();
    names
}

fn summary(folder: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(folder.join("squash.json")).expect("the run has ended");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn a_solved_run_leaves_its_frames_its_log_and_how_it_ended() {
    let (plan, folder) = (pressed(2), tempfile::tempdir().expect("a folder"));
    for stale in [
        "squash_0007.vtu",
        "squash_0007_bones.vtu",
        "squash_unsolved.pvd",
        "squash_unsolved_solids.vtu",
        "squash_0003_solids.vtu.part",
        "squash.json",
        "iterations.csv",
    ] {
        std::fs::write(folder.path().join(stale), "of an earlier run").expect("writable");
    }
    std::fs::write(folder.path().join("squash_notes.txt"), "mine").expect("writable");
    let drive = drive(&plan, [0.0, 0.1, 0.2].into_iter());
    let mut seen = Vec::new();
    let run =
        run_to_files(&plan, &drive, &Settings::default(), None, folder.path(), "squash", &mut |frame| {
            seen.push(frame.time);
            let collection = std::fs::read_to_string(folder.path().join("squash.pvd")).expect("written");
            assert_eq!(
                collection.matches("<DataSet").count(),
                seen.len(),
                "the frame is written when it is shown"
            );
            assert!(!folder.path().join("squash.json").exists(), "complete before its end");
        })
        .expect("writable");
    assert!(run.is_solved());
    assert_eq!(seen, [0.0, 1.0, 2.0]);
    let expected = [
        "iterations.csv",
        "squash.json",
        "squash.pvd",
        "squash_0000_solids.vtu",
        "squash_0001_solids.vtu",
        "squash_0002_solids.vtu",
        "squash_notes.txt",
    ];
    assert_eq!(names(folder.path()), expected);
    let rows = std::fs::read_to_string(folder.path().join("iterations.csv")).expect("written");
    assert_eq!(rows.lines().count(), 1 + run.iterations.len());
    let summary = summary(folder.path());
    assert_eq!((&summary["status"], &summary["frames_solved"]), (&"solved".into(), &3.into()));
    assert!(summary["failures"].is_null());

    let last = vtu::read(&folder.path().join("squash_0002_solids.vtu"), LengthUnit::Metre).expect("readable");
    let displacement = &last.point_data[0];
    assert_eq!((displacement.name.as_ref(), displacement.components), ("displacement_m", 3));
    for ((u, x), rest) in displacement.values.iter().zip(&run.frames[2].x).zip(plan.reference()) {
        assert!((u - (x - rest)).abs() < 1e-15);
    }
    assert_eq!(last.mesh.points.as_flattened(), &run.frames[2].x[..], "the points are where the nodes are");
    let names: Vec<_> = last.cell_data.iter().map(|f| f.name.as_ref()).collect();
    assert_eq!(names, ["von_mises_Pa", "pressure_Pa", "volume_ratio", "cauchy_Pa"]);
    let cells = solid_field(&plan, run.frames[2].snapshot(), &plan.mesh.blocks[0].name).expect("a solid");
    let ratios: Vec<f64> = cells.iter().map(|c| c.volume_ratio).collect();
    assert_eq!(*last.cell_data[2].values, ratios);
    assert!(ratios.iter().all(|r| *r < 0.999 || *r > 1.001), "{ratios:?}");
}

/// The plate is to pass through the floor: every inner node has a tetrahedron on the floor, which keeps it above, and one
/// under the plate.
#[test]
fn a_failed_run_leaves_the_last_good_state_with_element_and_reason() {
    let (plan, folder) = (pressed(2), tempfile::tempdir().expect("a folder"));
    let drive = drive(&plan, [0.3, 1.2, 0.1].into_iter());
    let run = run_to_files(&plan, &drive, &Settings::default(), None, folder.path(), "squash", &mut |_| {})
        .expect("writable");
    assert!(!run.is_solved());
    let expected = [
        "iterations.csv",
        "squash.json",
        "squash.pvd",
        "squash_0000_solids.vtu",
        "squash_unsolved.pvd",
        "squash_unsolved_solids.vtu",
    ];
    assert_eq!(names(folder.path()), expected);
    let collection = std::fs::read_to_string(folder.path().join("squash.pvd")).expect("written");
    assert!(!collection.contains("unsolved"), "what is no equilibrium is no frame of the series");

    let summary = summary(folder.path());
    println!("{summary:#}");
    assert_eq!(summary["status"], "not converged");
    assert_eq!((&summary["frames_solved"], &summary["frames_asked"]), (&1.into(), &3.into()));
    assert_eq!(
        (&summary["unsolved_time"], &summary["last_good_state"]),
        (&1.0.into(), &"squash_unsolved.pvd".into())
    );
    let failure = &summary["failures"][0];
    assert_eq!((&failure["island"], &failure["frame"]), (&"block".into(), &1.into()));
    let load = failure["load"].as_f64().expect("a number");
    assert!(load > 0.2 && load < 0.78, "the plate meets the floor at 7/9 of the way: {load}");
    assert!(
        failure["place"].as_str().is_some_and(|p| p.starts_with("element ") && p.ends_with("in `block`"))
    );
    assert!(failure["reason"].as_str().is_some_and(|r| r.len() > 10));

    // The state is good: where the plate is at that load, and nothing inverted.
    let state =
        vtu::read(&folder.path().join("squash_unsolved_solids.vtu"), LengthUnit::Metre).expect("readable");
    let top = plan.mesh.node_sets["z_max"][0] as usize;
    let plate = -SIDE * (0.3 + 0.9 * load);
    assert!((state.point_data[0].values[3 * top + 2] - plate).abs() < 1e-12);
    let ratio = &state.cell_data[2].values;
    assert!(ratio.iter().all(|r| *r > 0.0 && *r < 1.0), "{ratio:?}");
}

/// This test is its own child: with the variable set it runs until it is killed.
const CHILD: &str = "SARTORIUS_RUN_UNTIL_KILLED";

#[test]
fn a_killed_run_leaves_nothing_that_looks_complete() {
    if let Some(folder) = std::env::var_os(CHILD) {
        return run_until_killed(Path::new(&folder));
    }
    let moments = [(0, 0), (0, 700), (1, 0), (2, 1300), (3, 5000), (5, 2500)];
    for (frames, wait_us) in moments {
        let folder = tempfile::tempdir().expect("a folder");
        let mut child = start_child(folder.path());
        let patience = Instant::now();
        while frames > 0 && !folder.path().join(format!("squash_{:04}_solids.vtu", frames - 1)).exists() {
            assert!(patience.elapsed() < Duration::from_secs(60), "no frame {frames}");
            assert!(child.try_wait().expect("a child").is_none(), "the child ended by itself");
        }
        std::thread::sleep(Duration::from_micros(wait_us));
        child.kill().expect("a child to kill");
        child.wait().expect("a child");
        looks_unfinished(folder.path());

        // What was left does not disturb the next run.
        let plan = pressed(2);
        let drive = drive(&plan, [0.1].into_iter());
        run_to_files(&plan, &drive, &Settings::default(), None, folder.path(), "squash", &mut |_| {})
            .expect("writable");
        assert_eq!(
            names(folder.path()),
            ["iterations.csv", "squash.json", "squash.pvd", "squash_0000_solids.vtu"]
        );
    }
}

fn start_child(folder: &Path) -> Child {
    Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", "run_files::a_killed_run_leaves_nothing_that_looks_complete"])
        .env(CHILD, folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("a child")
}

/// Many frames, and no end after the last.
fn run_until_killed(folder: &Path) {
    let plan = pressed(4);
    let n = 400;
    let drive = drive(&plan, (1..=n).map(|i| 0.3 * f64::from(i) / f64::from(n)));
    run_to_files(&plan, &drive, &Settings::default(), None, folder, "squash", &mut |frame| {
        if frame.time + 1.5 > f64::from(n) {
            std::thread::sleep(Duration::from_secs(600));
        }
    })
    .expect("writable");
}

/// Neither the summary nor the log has its name; every frame under a final name is whole, and the collection lists
/// whole frames only.
fn looks_unfinished(folder: &Path) {
    let names = names(folder);
    for complete in ["squash.json", "iterations.csv"] {
        assert!(!names.iter().any(|n| n == complete), "{complete} among {names:?}");
    }
    for name in names.iter().filter(|n| n.ends_with(".vtu")) {
        vtu::read(&folder.join(name), LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"));
    }
    if let Ok(collection) = std::fs::read_to_string(folder.join("squash.pvd")) {
        assert!(collection.ends_with("</VTKFile>\n"), "{collection}");
        for file in collection.split("file=\"").skip(1).filter_map(|rest| rest.split('"').next()) {
            assert!(names.iter().any(|n| n == file), "{file} is not among {names:?}");
        }
    }
}

/// Every node follows one deformation gradient, so that all fields are known.
#[test]
fn fields_of_a_uniform_deformation_are_those_of_the_theory() {
    use fem::measure::nodal_forces;
    use fem::mesh::{CellBlock, CellKind};
    use fem::parts::{Beside, parts};
    use fem::run::Frame;
    use fem::scene::{
        FibreDirection, FibreLawSpec, FibreSpec, LawSpec, MembraneLawSpec, MembraneSpec, StrandSpec,
    };
    use nalgebra::{Matrix3, Vector3};

    let F = Matrix3::new(1.1, 0.2, 0.05, -0.1, 0.9, 0.15, 0.02, -0.08, 1.05);
    let side = 0.5;
    let mut mesh = generate::block([2; 3], [side; 3]);
    let solid_block = mesh.blocks[0].name.clone();
    let at = |p: [f64; 3]| mesh.points.iter().position(|q| *q == p).expect("a node") as u32;
    let diagonals = vec![at([0.0; 3]), at([0.25; 3]), at([0.25; 3]), at([0.5; 3])];
    let edge = vec![at([0.0; 3]), at([0.25, 0.0, 0.0])];
    let top = mesh.surfaces["z_max"].concat();
    let everything = (0..mesh.points.len() as u32).collect();
    mesh.blocks.push(CellBlock { name: "fibres".into(), kind: CellKind::Line2, nodes: diagonals });
    mesh.blocks.push(CellBlock { name: "ligament".into(), kind: CellKind::Line2, nodes: edge });
    mesh.blocks.push(CellBlock { name: "skin".into(), kind: CellKind::Quad4, nodes: top });
    mesh.node_sets.insert("all".into(), everything);
    let a0 = Vector3::new(1.0, 1.0, 0.5).normalize();
    let law = LawSpec::Blemker {
        g1: 5e3,
        g2: 5e3,
        bulk: 1e5,
        sigma_max: 3e5,
        lambda_ofl: 1.1,
        fibres: FibreDirection::Uniform([1.0, 1.0, 0.5]),
        activation: None,
    };
    let of_solid = Scene { solids: vec![solid(&solid_block, law, None)], ..Scene::default() };
    let membrane = MembraneSpec {
        region: "skin".into(),
        thickness: 2e-3,
        law: MembraneLawSpec::StVenantKirchhoff { young: 1e5, nu: 0.4 },
    };
    let of_skin = Scene { membranes: vec![membrane], ..Scene::default() };
    let young = FibreLawSpec::Thermal {
        young: 1e6,
        contraction: 0.0,
        strain: fem::material::line::FibreStrain::Engineering,
        toe: None,
    };
    let fibres = FibreSpec {
        name: "fibres".into(),
        course: fem::scene::Course::Region("fibres".into()),
        law: young,
        area: vec![1e-4],
        activation: None,
    };
    let strand = StrandSpec { region: "ligament".into(), stiffness: 100.0, toe: 0.03, reference_strain: 0.0 };
    let of_all = Scene {
        fibres: vec![fibres],
        strands: vec![strand],
        membranes: of_skin.membranes.clone(),
        solids: of_solid.solids.clone(),
        ..Scene::default()
    };

    let x: Vec<f64> = mesh.points.iter().flat_map(|p| <[f64; 3]>::from(F * Vector3::from(*p))).collect();
    let frame = |scene: &Scene| {
        let plan = plan(scene, &mesh);
        let load = plan.load(&[], &[]).expect("nothing is named");
        let frame = Frame { time: 1.0, load, x: x.clone(), ..Frame::default() };
        (parts(&plan, &frame, &Beside::default(), Some(0)), nodal_forces(&plan, frame.snapshot()))
    };
    let field = |parts: &[fem::mesh::format::pvd::Part], part: &str, name: &str| -> Vec<f64> {
        let part = parts.iter().find(|p| p.name == part).unwrap_or_else(|| panic!("no {part}"));
        part.cell_data.iter().find(|f| f.name == name).unwrap_or_else(|| panic!("no {name}")).values.to_vec()
    };
    let force_on = |forces: &[f64], set: &str| -> Vector3<f64> {
        mesh.node_sets[set].iter().map(|&n| Vector3::from_column_slice(&forces[3 * n as usize..][..3])).sum()
    };
    let close = |a: Vector3<f64>, b: Vector3<f64>| {
        assert!((a - b).norm() < 1e-10 * (a.norm() + b.norm()), "{a} and {b}")
    };

    // σ J F⁻ᵀ N A on every face is what holds it.
    let (of_solid, forces) = frame(&of_solid);
    let sigma = Matrix3::from_row_slice(&field(&of_solid, "solids", "cauchy_Pa")[..9]);
    assert!(sigma.norm() > 1e3 && (sigma - sigma.transpose()).norm() < 1e-9 * sigma.norm());
    for (c, face) in ["x_max", "y_max", "z_max"].into_iter().enumerate() {
        let area = F.determinant() * F.try_inverse().unwrap().transpose() * Vector3::ith(c, side * side);
        close(sigma * area, force_on(&forces, face));
    }
    assert!((field(&of_solid, "solids", "stretch")[3] - (F * a0).norm()).abs() < 1e-12);
    close(
        Vector3::from_column_slice(&field(&of_solid, "solids", "fibre_direction")[3..6]),
        (F * a0).normalize(),
    );

    // The tension of the skin times the current length of its edge, along the normal of the edge in the skin.
    let (of_skin, forces) = frame(&of_skin);
    let tension = Matrix3::from_row_slice(&field(&of_skin, "membranes", "tension_N_per_m")[..9]);
    let (u, v) = (F.column(0).into_owned(), F.column(1).into_owned());
    let normal = u.cross(&v).normalize();
    let outward = v.cross(&normal); // of the edge x = side, with its length
    close(tension * outward * side, force_on(&forces, "x_max"));
    assert!((field(&of_skin, "membranes", "area_ratio")[0] - u.cross(&v).norm()).abs() < 1e-12);

    // All kinds together are apart, every one with its own fields.
    let (all, _) = frame(&of_all);
    assert_eq!(all.iter().map(|p| p.name).collect::<Vec<_>>(), ["solids", "fibres", "membranes", "strands"]);
    let diagonal = F * Vector3::repeat(1.0 / 3_f64.sqrt());
    assert!((field(&all, "fibres", "stretch")[1] - diagonal.norm()).abs() < 1e-12);
    assert!((field(&all, "fibres", "force_N")[1] - 100.0 * (diagonal.norm() - 1.0)).abs() < 1e-9);
    close(Vector3::from_column_slice(&field(&all, "fibres", "fibre_direction")[3..6]), diagonal.normalize());
    close(
        Vector3::from_column_slice(&field(&all, "strands", "fibre_direction")[..3]),
        F.column(0).normalize(),
    );
    assert_eq!(all.iter().map(|p| p.mesh.points.len()).collect::<Vec<_>>(), [27, 3, 9, 2]);
    for part in &all {
        part.mesh.check().unwrap_or_else(|e| panic!("{}: {e}", part.name));
        let values = part.point_data.iter().chain(&part.cell_data).flat_map(|f| f.values.iter());
        assert!(values.into_iter().all(|v| v.is_finite()), "{}", part.name);
    }
}
