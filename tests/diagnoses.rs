//! Is what is wrong with a scene, a mesh or a load said, and said truly? Nothing here may end as solved or with a wrong cause.

use fem::body::Pose;
use fem::mesh::generate;
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::*;
use fem::solve::Settings;
use support::contact_scenes::two_blocks;
use support::fem_scenes::{displaced, held, laws, mooney_rivlin, plan, solid};

/// How a run of one frame ends: `None` where it is solved.
fn verdict(plan: &Plan, load: fem::plan::Load) -> Option<String> {
    let run = run(plan, &Drive::once(load), &Settings::default(), None, &mut |_| {});
    (!run.is_solved()).then(|| run.errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
}

/// A bar of 4 cells along x; those at x below `end` m have all their nodes prescribed, and cell 0 is turned inside out.
fn folded_end(law: LawSpec, end: f64) -> Plan {
    let mut mesh = generate::block([4, 1, 1], [0.04, 0.01, 0.01]);
    let nodes = (0..mesh.points.len() as u32).filter(|&n| mesh.points[n as usize][0] < end).collect();
    mesh.node_sets.insert("end".to_string(), nodes);
    let through = |p: [f64; 3]| if p[0] < 0.005 { [0.025, 0.0, 0.0] } else { [0.0; 3] };
    let scene = Scene {
        solids: vec![solid("block", law, None)],
        prescribed: vec![displaced(&mesh, "end", through)],
        ..Scene::default()
    };
    plan(&scene, &mesh)
}

#[test]
fn a_prescribed_cell_folded_through_itself_is_no_solution() {
    for (name, law) in laws() {
        for (what, end) in [("all cells prescribed", 1.0), ("one prescribed cell beside free ones", 0.015)] {
            let plan = folded_end(law.clone(), end);
            let good = plan.load(&[("load", 0.1)], &[]).expect("a control");
            assert_eq!(verdict(&plan, good), None, "{name}, {what}: shortened by a quarter");
            let load = plan.load(&[("load", 1.0)], &[]).expect("a control");
            let says = verdict(&plan, load).unwrap_or_else(|| panic!("{name}, {what}: solved"));
            assert!(says.contains("element 0 in `block`") && says.contains("det F = -1.5"), "{name}: {says}");
            println!("{name}, {what}: {says}");
        }
    }
}

/// A cube of side 20 mm of 8 cells, held at x_min.
fn cube() -> (Scene, fem::mesh::Mesh) {
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        prescribed: vec![held("x_min", [true; 3])],
        ..Scene::default()
    };
    (scene, generate::block([2; 3], [0.02; 3]))
}

/// What a plan of the changed scene says.
fn refusal(change: impl Fn(&mut Scene)) -> String {
    let (mut scene, mesh) = cube();
    change(&mut scene);
    Plan::new(&scene, mesh).err().expect("a mistake").to_string()
}

#[test]
fn what_is_not_a_number_is_refused_where_it_enters() {
    let gravity = refusal(|s| {
        s.gravity = Some(GravitySpec { acceleration: [0.0, f64::NAN, -9.81], control: "g".to_string() });
    });
    assert!(gravity.contains("gravity: acceleration along y [m/s^2] is NaN"), "{gravity}");
    let origin = refusal(|s| {
        let (surface, control) = ("x_max".to_string(), "p".to_string());
        s.pressures.push(PressureSpec { surface, control, origin: Some([0.0, f64::INFINITY, 0.0]) });
    });
    assert!(origin.contains("pressure on `x_max`: origin [m] is inf"), "{origin}");

    let (mut scene, mesh) = cube();
    scene.ties.push(TieSpec { nodes: "x_max".to_string(), body: "bone".to_string() });
    let plan = plan(&scene, &mesh);
    let mut stretched = Pose::rotation(nalgebra::Vector3::x());
    stretched.rotation.as_mut_unchecked().coords *= 1.01;
    let mut spun = Pose::identity();
    spun.rotation.as_mut_unchecked().coords[2] = f64::NAN;
    for (pose, says) in [
        (Pose::translation(0.0, 0.0, f64::NAN), "pose of body `bone`: translation along z [m] is NaN"),
        (spun, "pose of body `bone`: length of the rotation's quaternion is NaN"),
        (stretched, "length of the rotation's quaternion is 1.01"),
    ] {
        let refused = plan.load(&[], &[("bone", pose)]).expect_err("no pose").to_string();
        assert!(refused.contains(says), "{refused}");
        // A load made by hand gets no further than the session.
        let load = fem::plan::Load { controls: vec![], poses: vec![pose] };
        let refused = verdict(&plan, load).expect("no solution");
        assert!(refused.contains(says) && refused.starts_with("step 0"), "{refused}");
    }
    let short = verdict(&plan, fem::plan::Load::default()).expect("no solution");
    assert!(short.contains("poses has 0 entries, needs one per name of the plan: 1"), "{short}");
}

#[test]
fn all_mistakes_of_a_scene_are_named_at_once() {
    let all = refusal(|s| {
        s.solids[0].density = -1.0;
        s.solids.push(solid("blok", mooney_rivlin(), None));
        s.gravity = Some(GravitySpec { acceleration: [f64::NAN, 0.0, f64::NAN], control: "g".to_string() });
        s.prescribed.push(held("y_mix", [true; 3]));
        s.ties.push(TieSpec { nodes: "z_mix".to_string(), body: "bone".to_string() });
        s.forces.push(ForceSpec {
            name: "pull".to_string(),
            loads: vec![(99, [1.0; 3])],
            control: "f".to_string(),
        });
        s.inertia = Some(InertiaSpec {
            velocities: vec![VelocitySpec { region: "block".to_string(), velocity: [f64::NAN; 3] }],
        });
    });
    println!("{all}");
    for says in [
        "8 mistakes",
        "density [kg/m^3] is -1",
        "names the block of cells `blok`",
        "acceleration along x [m/s^2] is NaN",
        "acceleration along z [m/s^2] is NaN",
        "names the node set `y_mix`",
        "names the node set `z_mix`",
        "force `pull`: node is 99",
        "velocity [m/s] is NaN",
    ] {
        assert!(all.contains(says), "`{says}` is not in: {all}");
        assert_eq!(all.matches(says).count(), 1, "`{says}` once: {all}");
    }
    let (mut scene, mesh) = cube();
    scene.ties.push(TieSpec { nodes: "x_max".to_string(), body: "bone".to_string() });
    let plan = plan(&scene, &mesh);
    let drive =
        plan.load(&[("p", 1.0)], &[("bane", Pose::identity())]).expect_err("unknown names").to_string();
    assert!(drive.contains("2 mistakes") && drive.contains("`p`") && drive.contains("`bane`"), "{drive}");
}

/// A cube of side 20 mm with clamped bottom and displaced top.
fn sheared(law: LawSpec, cells: usize, at: [f64; 3]) -> (Scene, fem::mesh::Mesh) {
    let mut mesh = generate::block([cells; 3], [0.02; 3]);
    mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += at[c]));
    let top = displaced(&mesh, "z_max", |_| [0.002, 0.0, 0.0]);
    let prescribed = vec![held("z_min", [true; 3]), top];
    (Scene { solids: vec![solid("block", law, None)], prescribed, ..Scene::default() }, mesh)
}

#[test]
fn a_nearly_incompressible_body_that_is_supported_is_not_called_unsupported() {
    let mu = 3e3;
    let laws = [
        ("nu = 0.4999999", LawSpec::NeoHookean { young: 3.0 * mu, nu: 0.4999999 }),
        ("K/G = 1e8", LawSpec::NeoHookeanUncoupled { mu, bulk: 1e8 * mu }),
        ("K/G = 1e8, Mooney-Rivlin", LawSpec::MooneyRivlin { c10: 0.4 * mu, c01: 0.1 * mu, bulk: 1e8 * mu }),
    ];
    for (name, law) in laws {
        for (what, free) in [("between clamps", false), ("on one clamp", true), ("on a clamped corner", true)]
        {
            let (mut scene, mut mesh) = sheared(law.clone(), 4, [0.0; 3]);
            if free {
                let control = "g".to_string();
                scene.prescribed.pop();
                scene.gravity = Some(GravitySpec { acceleration: [0.5, 0.0, 0.0], control });
            }
            if what == "on a clamped corner" {
                // One face of one cell.
                let near = |p: [f64; 3]| p[2] == 0.0 && p[0] < 0.006 && p[1] < 0.006;
                let corner = (0..mesh.points.len() as u32).filter(|&n| near(mesh.points[n as usize]));
                mesh.node_sets.insert("z_min".to_string(), corner.collect());
            }
            let plan = plan(&scene, &mesh);
            let load = plan.load(&[(if free { "g" } else { "load" }, 1.0)], &[]).expect("a control");
            let says = verdict(&plan, load);
            println!("{name}, {what}: {says:?}");
            // Solved, or stopped by what is true of it: round-off.
            if let Some(says) = says {
                assert!(!says.contains("support") && says.contains("round-off"), "{name}, {what}: {says}");
            }
        }
    }
}

#[test]
fn a_body_that_is_not_supported_is_called_so_anywhere() {
    for (name, law) in laws() {
        for (what, at) in [("at the origin", [0.0; 3]), ("a metre away", [0.3, -0.9, 0.5])] {
            let (mut scene, mut mesh) = sheared(law.clone(), 3, at);
            mesh.node_sets.insert("hinge".to_string(), vec![0, 1, 2, 3]);
            scene.prescribed = vec![held("hinge", [true; 3])];
            let pull = vec![(60, [0.0, 0.0, 1e-3])];
            scene.forces =
                vec![ForceSpec { name: "pull".to_string(), loads: pull, control: "f".to_string() }];
            let says = |scene: &Scene| {
                let plan = plan(scene, &mesh);
                verdict(&plan, plan.load(&[("f", 1.0)], &[]).expect("a control")).expect("no solution")
            };
            let hinged = says(&scene);
            assert!(
                hinged.contains("not supported") && hinged.contains("rotation about x"),
                "{name}, {what}: {hinged}"
            );
            scene.prescribed.clear();
            let floating = says(&scene);
            assert_eq!(floating.matches("translation along").count(), 3, "{name}, {what}: {floating}");
        }
    }
}

#[test]
fn cells_inverted_at_corners_are_named() {
    let (scene, mut mesh) = cube();
    // The node in the middle, past the diagonal of a cell's face: the Gauss points of no cell mind.
    assert!(Plan::new(&scene, mesh.clone()).expect("a good mesh").warnings.is_empty());
    mesh.points[13] = [0.0138; 3];
    let plan = Plan::new(&scene, mesh).expect("positive at every Gauss point");
    let warning = &plan.warnings[0];
    println!("{warning}");
    assert_eq!(*warning, fem::plan::Warning::CornerInverted { block: "block".to_string(), cells: vec![7] });
    assert!(warning.to_string().contains("inverted at a corner") && warning.to_string().contains('7'));
}

#[test]
fn a_force_that_a_support_takes_is_told() {
    let (mut scene, mesh) = cube();
    let held_there = mesh.node_sets[&scene.prescribed[0].nodes][0];
    let force = ForceSpec {
        name: "pull".to_string(),
        loads: vec![(held_there, [1.0; 3]), (13, [1.0; 3])],
        control: "f".to_string(),
    };
    scene.forces.push(force);
    let plan = Plan::new(&scene, mesh.clone()).expect("it can be computed");
    let [warning] = &plan.warnings[..] else { panic!("{:?}", plan.warnings) };
    assert!(
        matches!(warning, fem::plan::Warning::HeldForce { node, count: 1, .. } if *node == held_there),
        "{warning}"
    );
    scene.forces[0].loads.remove(0);
    assert!(Plan::new(&scene, mesh).expect("good").warnings.is_empty());
}

#[test]
fn a_mesh_in_mm_read_as_m_is_told_from_a_body() {
    let (scene, mesh) = cube();
    let scaled = |by: f64, unit: fem::mesh::LengthUnit| {
        let mut mesh = mesh.clone();
        mesh.points.iter_mut().flatten().for_each(|x| *x *= by);
        let plan = Plan::new(&Scene { mesh_unit: unit, ..scene.clone() }, mesh).expect("it can be computed");
        plan.warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    use fem::mesh::LengthUnit::{Metre, Millimetre};
    assert_eq!(scaled(1.0, Metre), Vec::<String>::new());
    assert_eq!(scaled(1.0, Millimetre), Vec::<String>::new());
    let large = scaled(1e3, Metre);
    assert!(large[0].contains("20.000 m long") && large[0].contains("mesh_unit = \"mm\""), "{large:?}");
    let small = scaled(1e-3, Millimetre);
    assert!(small[0].contains("0.0200 mm long") && small[0].contains("remove"), "{small:?}");
}

#[test]
fn an_empty_set_is_a_mistake_where_it_is_named() {
    let (mut scene, mut mesh) = cube();
    mesh.node_sets.insert("nothing".to_string(), vec![]);
    mesh.surfaces.insert("no_face".to_string(), vec![]);
    Plan::new(&scene, mesh.clone()).expect("nobody names them");
    scene.ties.push(TieSpec { nodes: "nothing".to_string(), body: "bone".to_string() });
    let (surface, control) = ("no_face".to_string(), "p".to_string());
    scene.pressures.push(PressureSpec { surface, control, origin: None });
    let says = Plan::new(&scene, mesh).err().expect("empty").to_string();
    println!("{says}");
    assert!(says.contains("tie to `bone` names the node set `nothing`, which is empty"), "{says}");
    assert!(says.contains("pressure on `no_face`: number of faces is 0"), "{says}");
}

#[test]
fn a_contact_distance_that_nothing_has_room_for_is_named_with_the_gaps() {
    let near = |distance: f64, gap: f64| {
        let spec = ContactSpec { distance, ..ContactSpec::new(&["lower_block", "upper_block"]) };
        let (scene, mesh) = two_blocks([[2; 3]; 2], gap, spec);
        Plan::new(&scene, mesh).err().map(|e| e.to_string())
    };
    assert_eq!(near(0.3e-3, 2e-3), None);
    let says = near(1.0, 2e-3).expect("there is no room for a metre");
    println!("{says}");
    for words in ["closer than 100.000 mm", "2.000 mm apart", "lower `distance` (1000.000 mm now)"] {
        assert!(says.contains(words), "`{words}` is not in: {says}");
    }
    assert!(!says.contains("overlap"), "{says}");
    let deep = near(0.3e-3, -2e-3).expect("an overlap");
    assert!(deep.contains("overlap") && deep.contains("by 2.000 mm"), "{deep}");
}

#[test]
fn a_contact_surface_without_an_inside_is_refused_and_an_open_one_is_named() {
    let change = |change: &dyn Fn(&mut fem::mesh::Mesh)| {
        let spec = ContactSpec::new(&["lower_z_max", "upper_block"]);
        let (scene, mut mesh) = two_blocks([[2; 3]; 2], 2e-3, spec);
        change(&mut mesh);
        Plan::new(&scene, mesh)
    };
    let plan = change(&|_| {}).unwrap_or_else(|e| panic!("{e}"));
    let [warning] = &plan.warnings[..] else { panic!("{:?}", plan.warnings) };
    println!("{warning}");
    assert!(
        matches!(warning, fem::plan::Warning::Open { surface, n_edges: 8, .. } if surface == "lower_z_max")
    );
    let turned = change(&|m| m.surfaces.get_mut("lower_z_max").expect("a surface")[0].reverse());
    let says = turned.err().expect("no inside").to_string();
    assert!(says.contains("contact surface `lower_z_max`") && says.contains("turn opposite ways"), "{says}");
    let branching = change(&|m| {
        // Walls on the face: three faces at one of its edges.
        let [a, b, ..] = m.surfaces["lower_z_max"][0];
        let wall = [[b, a, 0, 0], [b, a, 1, 1]];
        m.surfaces.get_mut("lower_z_max").expect("a surface").extend(wall);
    });
    let says = branching.err().expect("no inside").to_string();
    println!("{says}");
    assert!(says.contains("contact surface `lower_z_max`") && says.contains("faces"), "{says}");
}
