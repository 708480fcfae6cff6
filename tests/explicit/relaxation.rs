//! Dynamic relaxation: does it come to rest where Newton's method does, with every effect, and does it call nothing solved that is not?

use super::judge::judged_run;
use fem::material::line::FibreStrain;
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame, Run, run};
use fem::scene::*;
use fem::solve::{Method, Reason, Settings, SolveError};
use support::contact_scenes::{moved, ramp, two_blocks};
use support::fem_scenes::{held, mooney_rivlin};
use support::random_scenes::random_scene;

/// Residual relative to the forces in play.
const TOLERANCE: f64 = 1e-7;

fn with(method: Method) -> Settings {
    Settings { method, tolerance: TOLERANCE, ..Settings::default() }
}

fn solved(plan: &Plan, drive: &Drive, method: Method) -> Run {
    let out = run(plan, drive, &with(method), None, &mut |_| {});
    assert!(out.is_solved(), "{method:?}: {}", out.errors[0]);
    out
}

/// Greatest distance \[m\] between nodes at the end of both ways, and the farthest that a node went.
fn apart(plan: &Plan, drive: &Drive) -> (f64, f64) {
    let [newton, relaxed] = [Method::Newton, Method::Relaxation].map(|method| solved(plan, drive, method));
    let [a, b] = [&newton, &relaxed].map(|run| &run.last().expect("solved").x);
    let farthest = |a: &[f64], b: &[f64]| {
        let nodes = a.chunks_exact(3).zip(b.chunks_exact(3));
        let length = |(a, b): (&[f64], &[f64])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
        nodes.map(length).fold(0.0, f64::max)
    };
    (farthest(a, b), farthest(a, &plan.reference()))
}

/// Nodes end within a hundredth of a per cent of the way of the farthest.
fn agrees(what: &str, scene: &Scene, mesh: Mesh, controls: &[(&str, f64)]) {
    let plan = Plan::new(scene, mesh).unwrap_or_else(|e| panic!("{what}: {e}"));
    let (off, way) = apart(&plan, &ramp(&plan, controls, &[], 1));
    assert!(way > 1e-4, "{what}: nothing moves");
    assert!(off < 1e-4 * way, "{what}: {off:.1e} m apart after a way of {way:.1e} m");
}

/// A bar of 10 mm and 40 mm held at both ends, or at one.
fn bar(both: bool) -> (Scene, Mesh) {
    let mesh = generate::block([2, 2, 6], [0.01, 0.01, 0.04]);
    let mut scene = Scene { solids: vec![SolidSpec::new("block", mooney_rivlin())], ..Scene::default() };
    scene.prescribed.push(held("z_min", [true; 3]));
    if both {
        scene.prescribed.push(held("z_max", [true; 3]));
    }
    (scene, mesh)
}

#[test]
fn solids_come_to_rest_where_newton_has_them() {
    let (mut scene, mesh) = bar(false);
    scene.prescribed.push(moved("z_max", [true; 3], [2e-3, 0.0, -6e-3], "press"));
    agrees("pressed and sheared", &scene, mesh, &[("press", 1.0)]);
    let (mut scene, mesh) = bar(false);
    scene.gravity = Some(GravitySpec { acceleration: [3.0, 0.0, -9.81], control: "g".into() });
    agrees("under its weight", &scene, mesh, &[("g", 1.0)]);
}

#[test]
fn fibres_pull_as_newton_has_it() {
    let table = FibreLawSpec::ForceLength {
        stretch: vec![0.5, 0.8, 1.0, 1.2, 1.5],
        activation: vec![0.0, 1.0],
        stress: vec![vec![0.0; 5], [0.0, 0.6, 1.0, 0.8, 0.9].map(|s| 2e4 * s).to_vec()],
    };
    let thermal = FibreLawSpec::Thermal {
        young: 1e6,
        contraction: 0.1,
        strain: FibreStrain::Logarithmic,
        toe: Some(0.01),
    };
    for (what, law) in [("one tension per fibre", table), ("contracting fibres", thermal)] {
        let (mut scene, mut mesh) = bar(true);
        generate::add_fibres(&mut mesh, "lines", [2, 2, 6], &[[0, 0], [0, 1], [1, 1]]);
        scene.fibres.push(FibreSpec {
            name: "fibres".into(),
            course: Course::Region("lines".into()),
            law,
            area: vec![1e-5],
            activation: Some("a".into()),
        });
        agrees(what, &scene, mesh, &[("a", 1.0)]);
    }
}

#[test]
fn membranes_strands_and_pressure_are_as_newton_has_them() {
    let (mut scene, mut mesh) = bar(false);
    let nodes = mesh.surfaces["x_max"].concat();
    mesh.blocks.push(CellBlock { name: "skin".into(), kind: CellKind::Quad4, nodes });
    scene.membranes.push(MembraneSpec {
        region: "skin".into(),
        thickness: 5e-4,
        law: MembraneLawSpec::NeoHookean { mu: 5e4 },
    });
    let corner = |set: &str| mesh.node_sets[set].clone();
    let (low, high) = (corner("z_min"), corner("z_max"));
    mesh.blocks.push(CellBlock {
        name: "ligament".into(),
        kind: CellKind::Line2,
        nodes: vec![low[0], high[high.len() - 1]],
    });
    scene.strands.push(StrandSpec {
        region: "ligament".into(),
        stiffness: 50.0,
        toe: 0.03,
        reference_strain: 0.02,
    });
    scene.patch_pressures.push(PatchPressureSpec { surface: "x_min".into(), control: "p".into() });
    agrees("skin, strand and pressure", &scene, mesh, &[("p", 100.0)]);
}

#[test]
fn followers_and_supports_aslant_are_as_newton_has_them() {
    let (mut scene, mesh) = bar(false);
    scene.planes.push(PlaneSpec { nodes: "z_max".into(), axis: Direction::Axis(2) });
    scene.gravity = Some(GravitySpec { acceleration: [0.0, 0.0, -20.0], control: "g".into() });
    agrees("a plane that sinks", &scene, mesh, &[("g", 1.0)]);
}

/// Both modes of contact, 10 mm blocks pressed into each other by 2 mm.
#[test]
fn contact_is_as_newton_has_it() {
    for (mode, distance) in [(ContactMode::Cheap, 3e-4), (ContactMode::Guarded, 1e-3)] {
        let contact = ContactSpec { mode, distance, ..ContactSpec::new(&["lower_z_max", "upper_z_min"]) };
        let (mut scene, mesh) = two_blocks([[3, 3, 2], [2, 2, 2]], 1.2e-3, contact);
        scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, -3.2e-3], "press"));
        let plan = Plan::new(&scene, mesh).unwrap_or_else(|e| panic!("{e}"));
        let (off, way) = apart(&plan, &ramp(&plan, &[("press", 1.0)], &[], 4));
        assert!(off < 1e-3 * way, "{mode:?}: {off:.1e} m apart after a way of {way:.1e} m");
    }
}

#[test]
fn what_does_not_come_to_rest_in_time_is_not_called_solved() {
    let (mut scene, mesh) = bar(false);
    scene.prescribed.push(moved("z_max", [true; 3], [2e-3, 0.0, -6e-3], "press"));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let settings = Settings { max_steps: 20, ..with(Method::Relaxation) };
    let out = run(&plan, &ramp(&plan, &[("press", 1.0)], &[], 1), &settings, None, &mut |_| {});
    match &out.errors[..] {
        [SolveError::NotConverged(stop)] => {
            assert_eq!(stop.reason, Reason::NotSettled { steps: 20 });
            assert!(stop.residual > stop.wanted, "{stop}");
            assert!(out.errors[0].to_string().contains("`max_steps` allows for more"), "{}", out.errors[0]);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_same_bits_come_of_one_thread_and_of_two() {
    // More nodes than one piece of a sum.
    let mesh = generate::block([9; 3], [0.02; 3]);
    let mut scene = Scene { solids: vec![SolidSpec::new("block", mooney_rivlin())], ..Scene::default() };
    scene.prescribed.push(held("z_min", [true; 3]));
    scene.prescribed.push(moved("z_max", [true; 3], [2e-3, 0.0, -3e-3], "press"));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let drive = ramp(&plan, &[("press", 1.0)], &[], 1);
    let settings = Settings { tolerance: 1e-3, ..with(Method::Relaxation) };
    let places = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let out = pool.install(|| run(&plan, &drive, &settings, None, &mut |_| {}));
        assert!(out.is_solved(), "{}", out.errors[0]);
        out.frames[0].x.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
    };
    assert!(places(1) == places(2));
}

/// Scenes with wild inputs, judged by code that shares nothing with solver and elements.
#[test]
fn nothing_is_called_solved_that_is_not() {
    let (mut solved, mut mistakes) = (0, Vec::new());
    for seed in 0..60 {
        let random = random_scene(seed);
        if random.scene.inertia.is_some() || !random.scene.free_bodies.is_empty() {
            continue;
        }
        let Ok(plan) = Plan::new(&random.scene, random.mesh.clone()) else { continue };
        let frame = |t: &support::random_scenes::Target| {
            Some(DriveFrame { time: t.time, load: plan.load(&t.controls, &t.poses).ok()? })
        };
        let Some(frames) = random.frames.iter().map(frame).collect::<Option<Vec<_>>>() else { continue };
        let settings = Settings { method: Method::Relaxation, max_steps: 3000, ..random.settings };
        let (out, judge) = judged_run(&random.scene, &plan, &Drive { frames }, &settings);
        solved += usize::from(out.is_solved());
        mistakes.extend(judge.mistakes.iter().map(|m| format!("seed {seed} [{}]: {m}", random.what)));
    }
    assert_eq!(mistakes, Vec::<String>::new());
    assert!(solved >= 10, "{solved} solved: too few to say anything");
}
