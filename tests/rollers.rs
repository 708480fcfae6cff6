//! Rollers and planes of any direction: is a turned block the block, turned; are reactions normal to their planes; is the constrained
//! potential the sum of its derivatives; are contradictions told?

#![allow(non_snake_case)]

use fem::measure::{nodal_forces, support_wrench};
use fem::mesh::{Mesh, generate};
use fem::plan::{LoadedIsland, Motion, Plan};
use fem::run::Frame;
use fem::scene::*;
use fem::solve::{BlockMatrix, Loading, Potential};
use nalgebra::{Rotation3, Vector3};
use support::fem_scenes::{held, mooney_rivlin, plan, solid, solve, tolerance};
use support::{Random, taylor_order};

fn roller(nodes: &str, normal: Vector3<f64>) -> RollerSpec {
    RollerSpec { nodes: nodes.into(), normal: normal.into(), displacement: 0.0, control: None }
}

/// A block on rollers at x = 0, y = 0 and z = 0 whose far end in x moves as one plane, pressed down by a plate on rollers under gravity; all
/// of it turned, its directions given as vectors.
fn turned_block(R: &Rotation3<f64>) -> (Scene, Mesh) {
    let mut mesh = generate::block([3, 2, 3], [0.03, 0.02, 0.03]);
    generate::distort(&mut mesh, 0.1, 3);
    mesh.points.iter_mut().for_each(|p| *p = (R * Vector3::from(*p)).into());
    let [x, y, z] = [0, 1, 2].map(|c| R * Vector3::ith(c, 1.0));
    let plate = RollerSpec { displacement: -0.004, control: Some("press".into()), ..roller("z_max", z) };
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        gravity: Some(GravitySpec {
            acceleration: (R * Vector3::new(3.0, 5.0, -9.0)).into(),
            control: "g".into(),
        }),
        // Normals need no unit length, nor a sign.
        rollers: vec![roller("x_min", x * 2.0), roller("y_min", -y), roller("z_min", z), plate],
        planes: vec![PlaneSpec { nodes: "x_max".into(), axis: Direction::Vector((x * 0.3).into()) }],
        ..Scene::default()
    };
    (scene, mesh)
}

const LOADS: [(&str, f64); 2] = [("press", 1.0), ("g", 20.0)];

fn equilibrium(R: &Rotation3<f64>) -> (Plan, Frame) {
    let (scene, mesh) = turned_block(R);
    let plan = plan(&scene, &mesh);
    let frame = solve(&plan, &LOADS, &tolerance(1e-11));
    (plan, frame)
}

#[test]
fn a_turned_block_on_oblique_rollers_is_the_block_turned() {
    let (straight, at_rest) = equilibrium(&Rotation3::identity());
    assert!(straight.slides.is_empty(), "along axes nothing is oblique");
    let R = Rotation3::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
    let (plan, frame) = equilibrium(&R);
    assert!(plan.slides.len() > 20, "{} nodes slide", plan.slides.len());
    let apart = at_rest.x.chunks_exact(3).zip(frame.x.chunks_exact(3));
    let apart = apart.map(|(a, b)| (R * Vector3::from_row_slice(a) - Vector3::from_row_slice(b)).norm());
    let apart = apart.fold(0.0, f64::max);
    assert!(apart < 1e-11, "{apart:.1e} m apart");
    // So are the forces in play, where supports alone exert them and where weight does.
    let scale = |plan: &Plan, loads| solve(plan, loads, &tolerance(1e-11)).islands[0].force_scale;
    for loads in [&[("press", 1.0)][..], &[("g", 20.0)], &LOADS] {
        let (wanted, found) = (scale(&straight, loads), scale(&plan, loads));
        assert!((found / wanted - 1.0).abs() < 1e-8, "{loads:?}: {found} N, should be {wanted} N");
    }
    // Their reactions are turned with them.
    for set in ["x_min", "y_min", "z_min", "z_max"] {
        let of = |plan: &Plan, frame: &Frame| {
            Vector3::from(support_wrench(plan, frame.snapshot(), &plan.mesh.node_sets[set], [0.0; 3]).force)
        };
        let (wanted, found) = (R * of(&straight, &at_rest), of(&plan, &frame));
        assert!((wanted - found).norm() < 1e-7 * wanted.norm(), "{set}: {found:?} N, should be {wanted:?} N");
    }
    // Inside a face a roller pushes along its normal only, and what it takes is all that is left.
    let g = nodal_forces(&plan, frame.snapshot());
    let edges = ["x_min", "y_min", "y_max", "z_min", "z_max"].map(|s| &plan.mesh.node_sets[s]);
    let normal = R * Vector3::x();
    let mut n_inside = 0;
    for &n in edges[0].iter().filter(|n| edges[1..].iter().all(|e| !e.contains(n))) {
        let f = Vector3::from_row_slice(&g[3 * n as usize..3 * n as usize + 3]);
        assert!(f.cross(&normal).norm() < 1e-6 * f.norm(), "node {n}: {f:?}");
        n_inside += 1;
    }
    assert!(n_inside > 0);
    // The plane has moved as one, and stayed where its own face was.
    let along = |n: &u32| {
        let i = 3 * *n as usize;
        (Vector3::from_row_slice(&frame.x[i..i + 3]) - Vector3::from(plan.mesh.points[*n as usize]))
            .dot(&normal)
    };
    let moved: Vec<f64> = plan.mesh.node_sets["x_max"].iter().map(along).collect();
    assert!(moved[0].abs() > 1e-4 && moved.iter().all(|u| (u - moved[0]).abs() < 1e-15), "{moved:?}");
}

#[test]
fn rollers_along_axes_are_prescribed_components_to_the_bit() {
    let mesh = generate::block([2; 3], [0.01; 3]);
    let solved = |rollers: Vec<RollerSpec>, prescribed: Vec<PrescribedSpec>| {
        let solids = vec![solid("block", mooney_rivlin(), None)];
        let scene = Scene { solids, rollers, prescribed, ..Scene::default() };
        solve(&plan(&scene, &mesh), &[("press", 1.0)], &tolerance(1e-8)).x
    };
    let pressed = PrescribedSpec {
        displacement: vec![[0.0, 0.0, -0.002]],
        control: Some("press".into()),
        ..held("z_max", [false, false, true])
    };
    let faces =
        [("x_min", [true, false, false]), ("y_min", [false, true, false]), ("z_min", [false, false, true])];
    let mut prescribed: Vec<_> = faces.iter().map(|(set, c)| held(set, *c)).collect();
    prescribed.push(pressed);
    let mut rollers: Vec<_> = (0..3).map(|c| roller(faces[c].0, Vector3::ith(c, -3.0))).collect();
    rollers.push(RollerSpec {
        displacement: 0.002,
        control: Some("press".into()),
        ..roller("z_max", -Vector3::z())
    });
    assert_eq!(solved(rollers, Vec::new()), solved(Vec::new(), prescribed));
}

/// Where two planes meet a node slides along their line, with each where its control takes it; three planes hold it.
#[test]
fn planes_that_meet_leave_a_line_and_then_a_point() {
    let mut mesh = generate::block([2, 1, 1], [0.02, 0.01, 0.01]);
    mesh.node_sets.insert("tip".into(), vec![mesh.node_sets["x_max"][0]]);
    let tip = 3 * mesh.node_sets["tip"][0] as usize;
    let normals = [Vector3::new(1.0, 1.0, 0.2), Vector3::new(0.1, 1.0, 0.5), Vector3::new(-0.3, 0.2, 1.0)];
    let lengths = [0.002, -0.001, 0.0015];
    for n in 1..=3 {
        let moved = |k: usize| RollerSpec {
            displacement: lengths[k],
            control: Some(format!("c{k}")),
            ..roller("tip", normals[k])
        };
        let scene = Scene {
            solids: vec![solid("block", mooney_rivlin(), None)],
            prescribed: vec![held("x_min", [true; 3])],
            rollers: (0..n).map(moved).collect(),
            ..Scene::default()
        };
        let plan = plan(&scene, &mesh);
        let controls: Vec<(String, f64)> = (0..n).map(|k| (format!("c{k}"), 1.0 + 0.1 * k as f64)).collect();
        let controls: Vec<(&str, f64)> = controls.iter().map(|(c, v)| (c.as_str(), *v)).collect();
        let frame = solve(&plan, &controls, &tolerance(1e-10));
        let u = Vector3::from_row_slice(&frame.x[tip..tip + 3]) - Vector3::from(plan.mesh.points[tip / 3]);
        for k in 0..n {
            let wanted = lengths[k] * controls[k].1;
            assert!((u.dot(&normals[k].normalize()) - wanted).abs() < 1e-15, "{n} planes, plane {k}: {u:?}");
        }
        let g = nodal_forces(&plan, frame.snapshot());
        let f = Vector3::from_row_slice(&g[tip..tip + 3]);
        let free = plan.slides[0].free;
        assert_eq!(plan.slides.len(), 1);
        assert!((free.trace() - (3.0 - n as f64)).abs() < 1e-12, "{n} planes leave {free}");
        assert!(f.norm() > 1e-3 && (free * f).norm() < 1e-8 * f.norm(), "{n} planes: {f:?} N");
    }
}

#[test]
fn gradient_and_hessian_of_the_constrained_potential_are_derivatives() {
    let R = Rotation3::from_scaled_axis(Vector3::new(0.4, -0.7, 1.1));
    let (mut scene, mesh) = turned_block(&R);
    // A corner held along an axis besides.
    let mut mesh = mesh;
    mesh.node_sets.insert("corner".into(), vec![mesh.node_sets["x_max"][1]]);
    scene.prescribed.push(held("corner", [true, false, false]));
    let plan = plan(&scene, &mesh);
    let island = plan.islands[0].clone();
    assert_eq!(plan.islands.len(), 1);
    let load = plan.load(&LOADS, &[]).expect("names of the scene");
    let mut potential = LoadedIsland::new(island.clone(), plan.load(&[], &[]).expect("nothing"), load);
    let mut random = Random::new(17);
    let local: Vec<f64> = island.X.iter().map(|x| 1.02 * x + 4e-4 * random.uniform()).collect();
    let mut x = island.free_positions(&local);
    potential.set_load(1.0, &mut x);
    assert!(potential.fixed().iter().all(|f| !f), "what is prescribed is so obliquely");
    // Directions in which the nodes are free.
    let motion: Vec<[Motion; 3]> =
        island.motion.iter().copied().filter(|m| m.iter().any(Motion::is_unknown)).collect();
    let mut direction = || -> Vec<f64> {
        let mut d: Vec<f64> = x.iter().map(|_| 0.01 * random.uniform()).collect();
        for (d, motion) in d.chunks_exact_mut(3).zip(&motion) {
            if let Motion::Slides(of) = motion[0] {
                d.copy_from_slice((plan.slides[of as usize].free * Vector3::from_row_slice(d)).as_slice());
            }
        }
        d
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let gradient = |x: &[f64]| {
        let mut g = vec![0.0; x.len()];
        potential.gradient(x, &mut g);
        g
    };
    let mut k = BlockMatrix::zeros(potential.pattern().clone());
    potential.hessian(&x, 0.0, &mut k);
    let (mut worst_g, mut worst_K) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..10 {
        let (dx, dy) = (direction(), direction());
        let at = |h: f64| -> Vec<f64> { x.iter().zip(&dx).map(|(x, d)| x + h * d).collect() };
        worst_g = worst_g.min(taylor_order(|h| potential.energy(&at(h)), dot(&gradient(&x), &dx), 1e-3));
        let mut kx = vec![0.0; x.len()];
        k.multiply(&dx, &mut kx);
        worst_K = worst_K.min(taylor_order(|h| dot(&gradient(&at(h)), &dy), dot(&kx, &dy), 1e-3));
    }
    println!("gradient order {worst_g:.2}, Hessian order {worst_K:.2}");
    assert!(worst_g > 1.9 && worst_K > 1.9, "orders {worst_g:.2} and {worst_K:.2}");
    // Forces and blocks along what is prescribed are none.
    let g = gradient(&x);
    for ((g, motion), i) in g.chunks_exact(3).zip(&motion).zip(0..) {
        if let Motion::Slides(of) = motion[0] {
            let f = Vector3::from_row_slice(g);
            assert!((plan.slides[of as usize].free * f - f).norm() <= 1e-12 * f.norm(), "free node {i}");
        }
    }
}

#[test]
fn contradictions_are_told() {
    let mesh = generate::block([1; 3], [0.01; 3]);
    let n = Vector3::new(1.0, 1.0, 0.0);
    let refused = |change: &dyn Fn(&mut Scene)| {
        let mut scene = Scene { solids: vec![solid("block", mooney_rivlin(), None)], ..Scene::default() };
        change(&mut scene);
        Plan::new(&scene, mesh.clone()).map(|_| ()).expect_err("a mistake").to_string()
    };
    let moved =
        |set: &str, u: f64| RollerSpec { displacement: u, control: Some("c".into()), ..roller(set, n) };
    let cases: Vec<(String, Vec<&str>)> = vec![
        // Both on the edge x = 0, z = 0: node 0 is the first.
        (
            refused(&|s| s.rollers = vec![roller("x_min", n), moved("z_min", 1e-3)]),
            vec!["node 0", "`x_min`", "`z_min`", "keep one"],
        ),
        (
            refused(&|s| {
                s.rollers = vec![
                    moved("x_min", 2e-3),
                    RollerSpec { normal: [-1.0, -1.0, 0.0], ..moved("z_min", 2e-3) },
                ]
            }),
            vec!["node 0", "`x_min`", "`z_min`"],
        ),
        (
            refused(&|s| {
                s.rollers = vec![roller("z_min", n)];
                s.ties = vec![TieSpec { nodes: "x_min".into(), body: "bone".into() }];
            }),
            vec!["node 0", "`x_min`", "`z_min`"],
        ),
        (
            refused(&|s| s.rollers = vec![roller("z_min", Vector3::zeros())]),
            vec!["roller `z_min`", "length of a direction"],
        ),
        (
            refused(&|s| s.rollers = vec![RollerSpec { displacement: 1e-3, ..roller("z_min", n) }]),
            vec!["roller `z_min`", "control"],
        ),
        (refused(&|s| s.rollers = vec![roller("z_mim", n)]), vec!["roller `z_mim`", "`z_min`"]),
        (
            refused(&|s| {
                s.prescribed = vec![held("x_max", [true, false, false])];
                s.planes = vec![PlaneSpec { nodes: "x_max".into(), axis: Direction::Vector(n.into()) }];
            }),
            vec!["plane `x_max`", "free"],
        ),
    ];
    for (message, words) in &cases {
        for word in words {
            assert!(message.contains(word), "`{word}` is missing: {message}");
        }
    }
    // The same twice, from either side, is no contradiction.
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        rollers: vec![
            moved("x_min", 2e-3),
            RollerSpec { normal: [-0.5, -0.5, 0.0], ..moved("z_min", -2e-3) },
        ],
        ..Scene::default()
    };
    assert!(Plan::new(&scene, mesh).is_ok());
    // And in a file.
    let text = "[[rollers]]\nnodes = \"a\"\nnormal = [1, 1, 0]\n[[planes]]\nnodes = \"b\"\naxis = 2\n[[planes]]\nnodes = \"c\"\naxis = [0, 1, 1]\n";
    let scene = Plan::parse(text, std::path::Path::new("s.toml")).expect("good");
    assert_eq!(scene.planes[0].axis, 2.into());
    assert_eq!(scene.planes[1].axis, Direction::Vector([0.0, 1.0, 1.0]));
}
