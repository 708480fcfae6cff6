//! Nested iteration: does a coarse run show the way, and is the fine equilibrium the same whatever the guess?

#![allow(non_snake_case)]

use fem::body::Pose;
use fem::mesh::quality::gauss_dets;
use fem::mesh::{CellBlock, CellKind, Mesh, Prolongation, generate};
use fem::nested::CoarseRun;
use fem::plan::{Load, Motion, Plan};
use fem::run::{Advanced, DriveFrame, Frame, Session};
use fem::scene::{ContactSpec, LawSpec, Scene, SolidSpec, TieSpec};
use fem::solve::{Advance, Settings, Stability};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use support::Random;
use support::contact_scenes::add;
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

/// Cells that are cubes, stretched and turned, turn by the rotation in F = R U.
#[test]
fn cells_turn_by_the_rotation_of_their_deformation() {
    let coarse = generate::block([2, 3, 2], [0.02, 0.03, 0.02]);
    let fine = generate::block([5, 4, 5], [0.02, 0.03, 0.02]);
    let R = Rotation3::from_euler_angles(0.4, -1.1, 2.0).into_inner();
    let U = Matrix3::new(1.3, 0.1, 0.0, 0.1, 0.8, -0.2, 0.0, -0.2, 1.1);
    let moved = |F: &Matrix3<f64>| -> Vec<f64> {
        coarse.points.iter().flat_map(|X| <[f64; 3]>::from(F * Vector3::from(*X) + Vector3::x())).collect()
    };
    let turned = Prolongation::new(&coarse, &fine).rotations(&moved(&Matrix3::identity()), &moved(&(R * U)));
    assert_eq!(turned.len(), fine.points.len());
    let off = turned.iter().map(|of| (of.expect("a node of the block") - R).norm()).fold(0.0, f64::max);
    assert!(off < 1e-12, "off by {off:.1e}");
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

/// Solves the frames, each along a way that `way` says of the frame before and the number.
fn frames(
    plan: &Plan,
    loads: impl IntoIterator<Item = Load>,
    way: impl Fn(Option<&Frame>, usize, &Load) -> Vec<Option<[f64; 3]>>,
) -> Vec<Frame> {
    let mut session = Session::new(plan, &settings(), None).expect("settings that can be");
    let mut frames: Vec<Frame> = Vec::new();
    for (k, load) in loads.into_iter().enumerate() {
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

/// The frames without a guess, and the iterations without one and led by a coarse run, both of which end in the same places.
fn beside(fine: &Plan, loads: impl Fn(&Plan) -> [Load; 2], coarse: &CoarseRun) -> (Vec<Frame>, [usize; 2]) {
    let plain = frames(fine, loads(fine), |_, _, _| UNKNOWN.to_vec());
    let led = frames(fine, loads(fine), |before, k, load| coarse.way(fine, before, k, load));
    let (takes, apart) = ([&plain, &led].map(|frames| iterations(frames)), apart(&plain, &led));
    println!("{takes:?} iterations without a guess and led; {apart:.1e} m apart");
    assert!(apart < 1e-8, "another place: {apart:.1e} m");
    (plain, takes)
}

#[test]
fn a_coarse_run_shows_the_way() {
    let (coarse, fine) = (bar(3, 0.021), bar(6, 0.021));
    let led_by = frames(&coarse, loads(&coarse), |_, _, _| UNKNOWN.to_vec());
    let onto = CoarseRun::new(&coarse, &led_by, &fine);
    let (plain, [plain_takes, led_takes]) = beside(&fine, loads, &onto);
    assert!(led_takes < plain_takes, "{led_takes} iterations, {plain_takes} without a coarse run");
    // A coarse run that ended early leads as far as it came.
    let short = CoarseRun::new(&coarse, &led_by[..1], &fine);
    assert!(short.way(&fine, plain.first(), 1, &loads(&fine)[1]).is_empty());
}

#[test]
fn cells_at_the_edge_of_a_support_are_given_shape() {
    // The body holds a cell of the coarse mesh and all the top of the fine one, so cells of the coarse mesh take nodes that are held elsewhere.
    let (coarse, fine) = (bar(3, 0.011), bar(6, 0.031));
    let led_by = frames(&coarse, loads(&coarse), |_, _, _| UNKNOWN.to_vec());
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
    let plain = frames(&fine, loads(&fine), |_, _, _| UNKNOWN.to_vec());
    let led = frames(&fine, loads(&fine), |before, k, load| onto.way(&fine, before, k, load));
    assert!(apart(&plain, &led) < 1e-8);
}

#[test]
fn a_bad_guess_costs_iterations_and_nothing_else() {
    let fine = bar(4, 0.016);
    let plain = frames(&fine, loads(&fine), |_, _, _| UNKNOWN.to_vec());
    let mut random = Random::new(7);
    // Up to 2 mm are a bad guess that folds little, up to 30 mm one that folds everything.
    for most in [2e-3, 3e-2] {
        let bad: Vec<_> =
            (0..fine.mesh.points.len()).map(|_| Some([0; 3].map(|_| random.between(-most, most)))).collect();
        let led = frames(&fine, loads(&fine), |_, _, _| bad.clone());
        let apart = apart(&plain, &led);
        println!("up to {most} m: {} iterations for {}", iterations(&led), iterations(&plain));
        assert!(apart < 1e-8, "a guess off by {most} m leads elsewhere: {apart:.1e} m");
    }
}

/// Two bars of 10 × 10 × 60 mm side by side, 1 mm apart, kept apart by guarded contact; one body holds both below, another one of them above.
fn two_bars(n: usize) -> Plan {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for (name, y) in [("pushed", 0.011), ("held", 0.0)] {
        let law = LawSpec::NeoHookean { young: 1e4, nu: 0.45 };
        // Aside, so that no sides are flush.
        let at = [0.1 * y, y, 0.0];
        add(&mut scene, &mut mesh, name, generate::block([n, n, 6 * n], [0.01, 0.01, 0.06]), at, law);
        scene.ties.push(TieSpec { nodes: format!("{name}_z_min"), body: "below".into() });
    }
    scene.ties.push(TieSpec { nodes: "held_z_max".into(), body: "above".into() });
    scene.contact = Some(ContactSpec { distance: 4e-4, ..ContactSpec::new(&["pushed_block", "held_block"]) });
    plan(&scene, &mesh)
}

/// Both bodies turned together, and the upper one moved by `push` \[m\] towards the bar that it does not hold before that.
fn turned(plan: &Plan, angle: f64, push: f64) -> (Load, Isometry3<f64>) {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    let turn = Isometry3::from_parts(Translation3::new(0.01 * angle, 0.0, 0.02 * angle), turn);
    let above = turn * Translation3::new(0.0, push, 0.0);
    (plan.load(&[], &[("below", turn), ("above", above)]).expect("bodies of the plan"), turn)
}

/// Where a coarse run only turns, the fine one is turned as it is, whatever it is off by: as far apart as before.
#[test]
fn what_a_fine_mesh_in_contact_is_off_by_turns_with_the_coarse_one() {
    let (coarse, fine) = (two_bars(1), two_bars(2));
    // Pressed a little, so that there is a residual to be measured by.
    let together = |plan: &Plan| [0.4, 1.3].map(|angle| turned(plan, angle, 0.8e-3).0);
    let led_by = frames(&coarse, together(&coarse), |_, _, _| UNKNOWN.to_vec());
    let mut before = frames(&fine, together(&fine), |_, _, _| UNKNOWN.to_vec()).swap_remove(0);
    let mut random = Random::new(4);
    let is_held = |n: usize| fine.motion[n] != [Motion::Free; 3];
    let free = (0..fine.mesh.points.len()).filter(|&n| !is_held(n));
    free.for_each(|n| (0..3).for_each(|c| before.x[3 * n + c] += random.between(-4e-4, 4e-4)));
    let ([_, load], onto) = (together(&fine), CoarseRun::new(&coarse, &led_by, &fine));
    let way = onto.way(&fine, Some(&before), 1, &load);
    let turn = turned(&fine, 1.3, 0.0).1 * turned(&fine, 0.4, 0.0).1.inverse();
    let mut off = 0.0_f64;
    for (n, x) in before.x.as_chunks::<3>().0.iter().enumerate() {
        let led = Vector3::from(*x) + Vector3::from(way[n].expect("a node of a bar"));
        off = off.max((led - (turn * Point3::from(*x)).coords).norm());
    }
    println!("off by {off:.1e} m");
    assert!(off < 1e-9, "off by {off:.1e} m");
}

#[test]
fn a_coarse_run_shows_the_way_in_contact() {
    let (coarse, fine) = (two_bars(2), two_bars(4));
    let pressed = |plan: &Plan| [(0.3, 6e-3), (1.2, 12e-3)].map(|(angle, by)| turned(plan, angle, by).0);
    let led_by = frames(&coarse, pressed(&coarse), |_, _, _| UNKNOWN.to_vec());
    let onto = CoarseRun::new(&coarse, &led_by, &fine);
    let (_, [plain_takes, led_takes]) = beside(&fine, pressed, &onto);
    assert!(3 * led_takes < 2 * plain_takes, "{led_takes} iterations, {plain_takes} without a coarse run");
}
