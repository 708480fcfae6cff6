//! Nested iteration: does a coarse run show the way, and is the fine equilibrium the same whatever the guess?

#![allow(non_snake_case)]

use fem::body::Pose;
use fem::mesh::quality::gauss_dets;
use fem::mesh::{CellBlock, CellKind, Mesh, Prolongation, generate};
use fem::nested::CoarseRun;
use fem::plan::{Load, Plan};
use fem::run::{Advanced, DriveFrame, Frame, Session};
use fem::scene::{LawSpec, Scene, SolidSpec, TieSpec};
use fem::solve::{Advance, Settings, Stability};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use support::Random;
use support::fem_scenes::{plan, tolerance};
use support::grid_cases::linear;

/// A way of which nothing is known.
const UNKNOWN: &[Option<[f64; 3]>] = &[];

#[test]
fn a_linear_field_is_carried_over_as_it_is() {
    // Faces of the finer cylinder stand out beyond those of the coarse one.
    let coarse = generate::cylinder(0.02, 0.1, 2, 1, 4);
    let mut fine = generate::cylinder(0.02, 0.1, 5, 3, 11);
    let beside = fine.points.len();
    fine.points.push([0.0; 3]);
    let line = CellBlock { name: "line".into(), kind: CellKind::Line2, nodes: vec![0, beside as u32] };
    fine.blocks.push(line);
    let values: Vec<f64> = coarse.points.iter().flat_map(|&X| linear(X)).collect();
    let carried = Prolongation::new(&coarse, &fine).vectors(&values);
    assert_eq!(carried.len(), fine.points.len());
    assert_eq!(carried[beside], None, "a node of no solid");
    let mut most = 0.0_f64;
    for (&X, u) in fine.points.iter().zip(&carried[..beside]) {
        let u = u.expect("a node of the cylinder");
        most = linear(X).iter().zip(u).map(|(want, u)| (want - u).abs()).fold(most, f64::max);
    }
    println!("off by {most:.1e} m");
    assert!(most < 1e-12, "off by {most:.1e} m");
}

/// A bar of 30 × 30 × 120 mm, held below, in cells of 30 mm over `n`; above it a body holds a corner of so many cells' width.
fn bar(n: usize, corner: f64) -> Plan {
    let mut mesh = generate::block([n, n, 4 * n], [0.03, 0.03, 0.12]);
    let is_held = |p: &[f64; 3]| p[2] > 0.1199 && p[0] < corner && p[1] < corner;
    let held = (0..mesh.points.len() as u32).filter(|&i| is_held(&mesh.points[i as usize])).collect();
    mesh.node_sets.insert("corner".into(), held);
    let tie = |nodes: &str, body: &str| TieSpec { nodes: nodes.into(), body: body.into() };
    let scene = Scene {
        solids: vec![SolidSpec::new("block", LawSpec::NeoHookean { young: 1e4, nu: 0.45 })],
        ties: vec![tie("z_min", "below"), tie("corner", "above")],
        ..Scene::default()
    };
    plan(&scene, &mesh)
}

/// The upper body turned and moved, in two frames.
fn loads(plan: &Plan) -> [Load; 2] {
    [0.5, 1.0].map(|part| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.2 * part);
        let pose = Pose::from_parts(Translation3::new(0.01 * part, 0.04 * part, 0.0), turn);
        plan.load(&[], &[("above", pose)]).expect("a body of the plan")
    })
}

fn settings() -> Settings {
    Settings { stability: Stability::Never, ..tolerance(1e-9) }
}

/// Solves both frames, each along a way that `way` says of the frame before and the number.
fn frames(plan: &Plan, way: impl Fn(Option<&Frame>, usize, &Load) -> Vec<Option<[f64; 3]>>) -> Vec<Frame> {
    let mut session = Session::new(plan, &settings(), None).expect("settings that can be");
    let mut frames: Vec<Frame> = Vec::new();
    for (k, load) in loads(plan).into_iter().enumerate() {
        let way = way(frames.last(), k, &load);
        let Advanced { frame, errors, .. } =
            session.advance_along(&DriveFrame { time: k as f64, load }, &way);
        assert!(errors.is_empty(), "{}", errors[0]);
        frames.push(frame);
    }
    frames
}

fn iterations(frames: &[Frame]) -> usize {
    frames.iter().map(|frame| frame.count(|island: &Advance| island.iterations)).sum()
}

/// Largest distance of a coordinate of any node \[m\].
fn apart(a: &[Frame], b: &[Frame]) -> f64 {
    let of = |(a, b): (&Frame, &Frame)| a.x.iter().zip(&b.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    a.iter().zip(b).map(of).fold(0.0, f64::max)
}

#[test]
fn a_coarse_run_shows_the_way() {
    let (coarse, fine) = (bar(3, 0.021), bar(6, 0.021));
    let led_by = frames(&coarse, |_, _, _| UNKNOWN.to_vec());
    let plain = frames(&fine, |_, _, _| UNKNOWN.to_vec());
    let onto = CoarseRun::new(&coarse, &led_by, &fine);
    let led = frames(&fine, |before, k, load| onto.way(&fine, before, k, load));
    let (plain_takes, led_takes, apart) = (iterations(&plain), iterations(&led), apart(&plain, &led));
    println!("{plain_takes} iterations, led {led_takes}; {apart:.1e} m apart");
    assert!(apart < 1e-8, "another place: {apart:.1e} m");
    assert!(led_takes < plain_takes, "{led_takes} iterations, {plain_takes} without a coarse run");
    // A coarse run that ended early leads as far as it came.
    let short = CoarseRun::new(&coarse, &led_by[..1], &fine);
    assert!(short.way(&fine, plain.first(), 1, &loads(&fine)[1]).is_empty());
}

#[test]
fn cells_at_the_edge_of_a_support_are_given_shape() {
    // The body holds a cell of the coarse mesh and all the top of the fine one, so cells of the coarse mesh take nodes that are held elsewhere.
    let (coarse, fine) = (bar(3, 0.011), bar(6, 0.031));
    let led_by = frames(&coarse, |_, _, _| UNKNOWN.to_vec());
    let onto = CoarseRun::new(&coarse, &led_by, &fine);
    let [_, load] = loads(&fine);
    // Both frames at once.
    let once = CoarseRun::new(&coarse, &led_by[1..], &fine);
    let least = |mesh: &Mesh, way: &[Option<[f64; 3]>]| {
        let pose = load.poses[fine.bodies.iter().position(|b| b == "above").expect("a body")];
        let is_in = |set: &str, n: u32| mesh.node_sets[set].contains(&n);
        let place = |n: u32| -> Vector3<f64> {
            let X = Vector3::from(mesh.points[n as usize]);
            match n {
                n if is_in("corner", n) => (pose * nalgebra::Point3::from(X)).coords,
                n if is_in("z_min", n) => X,
                n => X + Vector3::from(way[n as usize].expect("a node of the bar")),
            }
        };
        let of_cell = |cell: &[u32]| {
            let corners: Vec<_> = cell.iter().map(|&n| place(n)).collect();
            gauss_dets(CellKind::Hex8, &corners).iter().map(|d| d.0).fold(f64::INFINITY, f64::min)
        };
        mesh.blocks[0].cells().map(of_cell).fold(f64::INFINITY, f64::min)
    };
    let values: Vec<f64> = led_by[1].x.iter().zip(coarse.reference()).map(|(x, X)| x - X).collect();
    let raw = Prolongation::new(&coarse.mesh, &fine.mesh).vectors(&values);
    let way = once.way(&fine, None, 0, &load);
    let (raw, shaped) = (least(&fine.mesh, &raw), least(&fine.mesh, &way));
    println!("least volume at a point {raw:.1e} as carried over, {shaped:.1e} m³ shaped");
    assert!(raw < 0.0, "the case folds no cell: {raw:.1e}");
    assert!(shaped > 0.0, "still folded: {shaped:.1e}");
    let plain = frames(&fine, |_, _, _| UNKNOWN.to_vec());
    let led = frames(&fine, |before, k, load| onto.way(&fine, before, k, load));
    assert!(apart(&plain, &led) < 1e-8);
}

#[test]
fn a_bad_guess_costs_iterations_and_nothing_else() {
    let fine = bar(4, 0.016);
    let plain = frames(&fine, |_, _, _| UNKNOWN.to_vec());
    let mut random = Random::new(7);
    // Up to 2 mm are a bad guess that folds little, up to 30 mm one that folds everything.
    for most in [2e-3, 3e-2] {
        let bad: Vec<_> =
            (0..fine.mesh.points.len()).map(|_| Some([0; 3].map(|_| random.between(-most, most)))).collect();
        let led = frames(&fine, |_, _, _| bad.clone());
        let apart = apart(&plain, &led);
        println!("up to {most} m: {} iterations for {}", iterations(&led), iterations(&plain));
        assert!(apart < 1e-8, "a guess off by {most} m leads elsewhere: {apart:.1e} m");
    }
}
