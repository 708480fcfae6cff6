//! Who is on which side of whom: the look at it is silent on what moves and fires on what was swapped.

use coupling::thigh::build::ThighEffects;
use fem::geometry::linking::{crossings, passages};
use fem::measure::{Sides, pair_forces};
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::scene::ContactMode;
use fem::solve::{Settings, SolveError, Way};
use nalgebra::Vector3;
use support::contact_scenes::intersections;
use support::side_scenes::{
    FAMILIES, Variant, pressed_block, random_side_scene, strap_over_cylinder, two_straps_over_cylinder,
};

/// The thigh of some muscles, with contact among them and with the bones.
fn thigh(muscles: &[&str]) -> Plan {
    let only: Vec<String> = muscles.iter().map(ToString::to_string).collect();
    let effects = ThighEffects { fibres: None, shells: false };
    let made = coupling::thigh::built_in(14e-3, &only, effects).expect("meshes");
    let mut thigh = made.thigh.clone();
    thigh.add_contact(&made.bones, &made.attachments);
    Plan::new(&thigh.scene, thigh.mesh.clone()).expect("a plan")
}

/// The state in which the inside of a muscle is `by` \[m\] before (x) where it is in the mesh, its ends where they are.
fn bulged(plan: &Plan, muscle: &str, by: f64) -> Vec<f64> {
    let mut x = plan.reference();
    let block =
        plan.mesh.blocks.iter().find(|b| b.name.starts_with(muscle) && b.kind.is_solid()).expect("its block");
    let y = |n: &u32| plan.mesh.points[*n as usize][1];
    let (lo, hi) = block.nodes.iter().map(y).fold((f64::MAX, f64::MIN), |(lo, hi), y| (lo.min(y), hi.max(y)));
    let mut nodes = block.nodes.clone();
    nodes.sort_unstable();
    nodes.dedup();
    for n in nodes {
        let s = ((y(&n) - lo) / (hi - lo)).clamp(0.0, 1.0);
        x[3 * n as usize] += by * (4.0 * s * (1.0 - s)).powf(0.25);
    }
    x
}

#[test]
fn sartorius_behind_rectus_femoris_is_told() {
    let plan = thigh(&["sartorius", "rectus_femoris", "vastus_lateralis"]);
    let sides = Sides::new(&plan).expect("with contact");
    let rest = plan.reference();
    assert!(sides.changed(&rest, &rest).is_empty());
    // Sartorius lies before rectus femoris: farther to the front it may go, to the back it goes through it.
    assert!(sides.changed(&rest, &bulged(&plan, "sartorius", 0.03)).is_empty());
    let told = sides.changed(&rest, &bulged(&plan, "sartorius", -0.08));
    let pair = |[a, b]: &[String; 2]| {
        (a.starts_with("sartorius") && b.starts_with("rectus"))
            || (a.starts_with("rectus") && b.starts_with("sartorius"))
    };
    assert!(told.iter().any(pair), "{told:?}");
}

#[test]
fn the_same_frame_comes_out_guided_and_strict() {
    let scene = strap_over_cylinder(20e-3, 5.0, Variant::Plain);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    let sides = Sides::new(&plan).unwrap();
    let end = |way: Way| {
        let settings = Settings { way, ..Settings::default() };
        let out = fem::run::run(&plan, &scene.drive(&plan, 1), &settings, None, &mut |_| {});
        assert!(out.is_solved(), "{:?}", out.errors);
        assert_eq!(out.count(|i| i.crossed_pairs), 0);
        out.last().unwrap().x.clone()
    };
    let (guided, strict) = (end(Way::Guided), end(Way::Strict));
    assert!(sides.changed(&strict, &guided).is_empty());
    let off = guided.iter().zip(&strict).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 3e-5, "{off} m apart");
}

#[test]
fn what_goes_through_in_the_cheap_mode_leaves_the_last_good_state() {
    let scene = strap_over_cylinder(20e-3, 15.0, Variant::Plain).cheap();
    assert_eq!(scene.scene.contact.as_ref().unwrap().mode, ContactMode::Cheap);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    let drive = scene.drive(&plan, 1);
    let mut session = Session::new(&plan, &Settings::default(), None).unwrap();
    let first = session.advance(&drive.frames[0]);
    assert!(first.errors.is_empty());
    let DriveFrame { time, load } = &drive.frames[1];
    let second = session.advance(&DriveFrame { time: *time, load: load.clone() });
    let [SolveError::WentThrough { step: 1, pairs }] = &second.errors[..] else {
        panic!("{:?}", second.errors)
    };
    assert_eq!(pairs[0], ["strap_block", "cylinder_block"]);
    assert_eq!(second.frame.x, first.frame.x);
}

#[test]
fn the_inside_of_a_rigid_block_moves_with_it() {
    let scene = strap_over_cylinder(5e-3, 1.0, Variant::CylinderMoves);
    let mut mesh = scene.mesh.clone();
    // Its boundary alone is tied.
    let cylinder = mesh.blocks.iter().find(|b| b.name == "cylinder_block").unwrap();
    let mut boundary: Vec<u32> = cylinder.boundary().unwrap().into_iter().flatten().collect();
    boundary.sort_unstable();
    boundary.dedup();
    let inner: Vec<u32> = cylinder.nodes.iter().copied().filter(|n| !boundary.contains(n)).collect();
    assert!(inner.len() > 100);
    mesh.node_sets.insert("cylinder_all".into(), boundary);
    let plan = Plan::new(&scene.scene, mesh).unwrap();
    let out = fem::run::run(&plan, &scene.drive(&plan, 1), &Settings::default(), None, &mut |_| {});
    assert!(out.is_solved(), "{:?}", out.errors);
    for n in inner {
        let (now, then) = (out.last().unwrap().x[3 * n as usize + 2], plan.mesh.points[n as usize][2]);
        assert!((now - then - 2e-3).abs() < 1e-12, "node {n} has moved by {}", now - then);
    }
}

#[test]
fn a_frame_without_solution_says_that_prescribed_faces_overlap() {
    // The plates are 11 mm apart.
    let scene = pressed_block(12e-3);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    // It need not be tried long.
    let settings = Settings { max_iterations: 5, least_step: 0.5, way: Way::Strict, ..Settings::default() };
    let out = fem::run::run(&plan, &scene.drive(&plan, 1), &settings, None, &mut |_| {});
    let [SolveError::NotConverged(_), SolveError::NoRoom { pairs, .. }] = &out.errors[..] else {
        panic!("{:?}", out.errors)
    };
    assert_eq!(pairs[0].0, ["lower_block", "upper_block"]);
    assert!(out.errors[1].to_string().contains("what is between them has no room"), "{}", out.errors[1]);
}

#[test]
fn two_surfaces_press_on_one_area_whoever_is_named_first() {
    let scene = pressed_block(3e-3);
    let measure = |turned: bool| {
        let mut scene_file = scene.scene.clone();
        if turned {
            scene_file.contact.as_mut().unwrap().surfaces.reverse();
        }
        let plan = Plan::new(&scene_file, scene.mesh.clone()).unwrap();
        let out = fem::run::run(&plan, &scene.drive(&plan, 1), &Settings::default(), None, &mut |_| {});
        assert!(out.is_solved(), "{:?}", out.errors);
        let pairs = pair_forces(&plan, out.last().unwrap().snapshot(), [0.0; 3]);
        let lower = pairs.into_iter().find(|p| p.names.contains(&"lower_block".to_string())).unwrap();
        (lower.area, lower.standoff)
    };
    let ((area, standoff), (turned, _)) = (measure(false), measure(true));
    assert!((area / turned - 1.0).abs() < 1e-3, "{area} and {turned} m2");
    // The layer of 0.3 mm is squeezed, and not to nothing.
    assert!((2e-5..3e-4).contains(&standoff), "{standoff} m");
}

/// A ball between two pegs snaps in between them in the last of four steps, on the softened way and by collision detection: its line crosses
/// that of a peg on the straight way from frame to frame.
#[test]
fn a_guess_that_changes_sides_is_thrown_away() {
    let blobs = FAMILIES.iter().position(|f| *f == "blobs and pegs").unwrap();
    let scene = random_side_scene(blobs, 38);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    let out = fem::run::run(&plan, &scene.drive(&plan, 4), &Settings::default(), None, &mut |_| {});
    assert!(out.is_solved(), "{:?}", out.errors);
    let wrong: Vec<usize> = out.frames.iter().map(|f| f.count(|i| i.wrong_ways)).collect();
    assert_eq!(wrong, [0, 0, 0, 1]);
    // From the frame before it ends where collision detection alone does, to the bit, and it is told.
    let [.., before, end] = &out.frames[..] else { panic!("four frames") };
    let strict = Settings { way: Way::Strict, ..Settings::default() };
    let mut session = Session::from_frame(&plan, &strict, before, 3).unwrap();
    let alone = session.advance(&DriveFrame { time: end.time, load: end.load.clone() });
    assert!(alone.errors.is_empty(), "{:?}", alone.errors);
    assert_eq!(alone.frame.x, end.x);
    assert_eq!(end.islands.iter().map(|i| i.crossed_pairs).sum::<usize>(), 1);
}

/// Two straps that may not touch lie over a cylinder that comes up under both: each sees it come up through where the other was.
#[test]
fn what_one_island_does_is_no_business_of_another() {
    let scene = two_straps_over_cylinder(20e-3, 2.0);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    assert_eq!(plan.islands.iter().filter(|island| !island.free_positions(&island.X).is_empty()).count(), 2);
    let out = fem::run::run(&plan, &scene.drive(&plan, 1), &Settings::default(), None, &mut |_| {});
    assert!(out.is_solved(), "{:?}", out.errors);
    assert!(out.count(|i| i.soft_ways) > 1);
    assert_eq!((out.count(|i| i.wrong_ways), out.count(|i| i.crossed_pairs)), (0, 0));
}

/// A guess below the cylinder, for a strap that comes from above, is dropped: the frame ends where it does without, to the bit.
#[test]
fn a_guess_that_leads_through_is_dropped() {
    let scene = strap_over_cylinder(20e-3, 2.0, Variant::OneFrame);
    let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
    let [to] = &scene.drive(&plan, 1).frames[..] else { panic!("one frame") };
    let led_by = |way: &[Option<[f64; 3]>]| {
        let mut session = Session::new(&plan, &Settings::default(), None).unwrap();
        let advanced = session.advance_along(to, way);
        assert!(advanced.errors.is_empty(), "{:?}", advanced.errors);
        advanced.frame
    };
    let plain = led_by(&[]);
    assert!(plain.islands.iter().all(|island| island.soft_ways > 0 && island.wrong_ways == 0));
    // The ends go down by 23.6 mm, the middle on to below the cylinder, whose lowest line is at -26 mm.
    let thrown_away = [4.2e-3, 4.4e-3, 4.6e-3, 4.8e-3].map(|deeper| {
        let below = |p: &[f64; 3]| Some([0.0, 0.0, -23.6e-3 - deeper * (1.0 - (p[0] / 0.02).powi(2))]);
        let led = led_by(&plan.mesh.points.iter().map(below).collect::<Vec<_>>());
        assert!(plain.x == led.x, "{deeper} m");
        assert!(led.islands.iter().all(|island| island.crossed_pairs == 0));
        led.count(|island| island.wrong_ways)
    });
    // Some do not settle in softened contact; those that do are told by their sides.
    assert!(thrown_away.iter().sum::<usize>() > 0, "{thrown_away:?}");
}

/// Two rods that the drive sends through each other, with a strap between them: the frame may be in equilibrium, but it is no good one.
#[test]
fn a_solved_frame_names_what_the_drive_sends_into_each_other() {
    let between = FAMILIES.iter().position(|f| *f == "strap between").unwrap();
    let rods = ["above_block", "below_block"];
    for seed in [29, 32, 42, 49] {
        let scene = random_side_scene(between, seed);
        let plan = Plan::new(&scene.scene, scene.mesh.clone()).unwrap();
        let drive = scene.drive(&plan, 1);
        let out = fem::run::run(&plan, &drive, &Settings::default(), None, &mut |_| {});
        assert!(out.is_solved(), "seed {seed}: {:?}", out.errors);
        for frame in &out.frames {
            // The exact test of all pairs finds the rods where the frame names them, and nothing else.
            let told = frame.prescribed_overlaps.iter().any(|(pair, n)| *pair == rods && *n > 0);
            assert_eq!(told, !intersections(&plan, frame.snapshot(), &[]).is_empty(), "seed {seed}");
            assert!(intersections(&plan, frame.snapshot(), &[rods]).is_empty(), "seed {seed}");
        }
        assert!(!out.last().unwrap().prescribed_overlaps.is_empty(), "seed {seed}");
        // The summary of the run says it.
        let folder = tempfile::tempdir().unwrap();
        let beside = fem::parts::Beside::default();
        fem::output::write_run(&plan, &drive, &out, folder.path(), "rods", &beside).unwrap();
        let text = std::fs::read_to_string(folder.path().join("rods.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(summary["prescribed_overlaps"][0]["pair"], serde_json::json!(rods));
    }
}

fn line(n: usize, of: impl Fn(f64) -> [f64; 3]) -> Vec<Vector3<f64>> {
    (0..=n).map(|i| of(2.0 * i as f64 / n as f64 - 1.0).into()).collect()
}

#[test]
fn lines_cross_where_one_goes_through_the_other() {
    let below = line(7, |s| [0.1, s, 0.0]);
    let up = |z: f64| line(10, move |s| [s, 0.05, z + 0.1 * s]);
    // Through it, back, and to where it was.
    assert_eq!(crossings([&up(1.0), &up(-1.0)], [&below, &below]).abs(), 1);
    let (there, back) = (
        crossings([&up(1.0), &up(-1.0)], [&below, &below]),
        crossings([&up(-1.0), &up(1.0)], [&below, &below]),
    );
    assert_eq!(there + back, 0);
    // Both move: what counts is how they move against each other.
    let carried: Vec<_> = below.iter().map(|p| p + Vector3::new(0.0, 0.0, -2.0)).collect();
    assert_eq!(crossings([&up(1.0), &up(-1.0)], [&below, &carried]), 0);
    // Beside its end.
    let beside = |z: f64| line(10, move |s| [s, 1.2, z]);
    assert_eq!(crossings([&beside(1.0), &beside(-1.0)], [&below, &below]), 0);
    // With its ends gone down on both sides and its middle still on top.
    let bent = line(10, |s| [s, 0.05, if s.abs() < 0.5 { 0.1 } else { -1.0 }]);
    assert_eq!(crossings([&up(1.0), &bent], [&below, &below]), 0);
}

#[test]
fn points_pass_through_sheets() {
    // Two triangles of a square of side 2 in the plane z = 0.
    let corners: Vec<Vector3<f64>> =
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vector3::new(x, y, 0.0)).to_vec();
    let (sheet, rim) = ([[0, 1, 2], [0, 2, 3]], [[0, 1], [1, 2], [2, 3], [3, 0]]);
    let goes = |from: [f64; 3], to: [f64; 3], carried: f64| {
        let moved: Vec<_> = corners.iter().map(|c| c + Vector3::new(0.0, 0.0, carried)).collect();
        passages([from.into(), to.into()], &sheet, &rim, [&corners, &moved])
    };
    assert_eq!(goes([0.3, 0.2, 1.0], [0.1, -0.5, -2.0], 0.0).abs(), 1);
    assert_eq!(goes([0.3, 0.2, 1.0], [0.1, -0.5, -2.0], -5.0), 0);
    assert_eq!(goes([1.3, 0.2, 1.0], [1.1, -0.5, -2.0], 0.0), 0);
    assert_eq!(goes([0.3, 0.2, 1.0], [0.1, -0.5, 2.0], 4.0).abs(), 1);
}
