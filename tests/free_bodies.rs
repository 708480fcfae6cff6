//! Bodies whose poses are unknowns: are they where an independent calculation puts them, and is refused what cannot be?

#![allow(non_snake_case)]

use fem::body::Wrench;
use fem::effect::State;
use fem::measure::{FreeBodyState, free_bodies, pair_forces};
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::{FreeBody, LoadedIsland, Plan};
use fem::run::{Drive, DriveFrame, Run, run};
use fem::scene::{
    BodyForceSpec, ContactMode, ContactSpec, Coordinate, FreeBodySpec, InertiaSpec, PrescribedSpec, Scene,
    StrandSpec, TieSpec,
};
use fem::solve::{Loading, Potential, Settings, SolveError};
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use support::Random;
use support::fem_scenes::derivative_orders;

/// What is asked of an equilibrium: 0.01 N and 0.1 N mm.
const FORCE: f64 = 0.01;
const MOMENT: f64 = 1e-4;

/// A strand from a body to the ground.
#[derive(Clone, Copy)]
struct Strand {
    ends: [[f64; 3]; 2],
    stiffness: f64,
    strain: f64,
}

/// A force at a point of a body, turning with it or not.
#[derive(Clone, Copy)]
struct Force {
    point: [f64; 3],
    force: [f64; 3],
    follows: bool,
}

const TOE: f64 = 0.03;
/// Loads come in so many parts, so that both calculations follow one path.
const PARTS: usize = 10;

/// Eight strands, taut in the mesh, from points within 20 mm of (0.4, -0.3, 0.2) m to points 30 to 80 mm farther out, and two forces.
fn random_body(seed: u64) -> (Vec<Strand>, [Force; 2]) {
    let mut random = Random::new(seed);
    let centre = Vector3::new(0.4, -0.3, 0.2);
    let strands = (0..8).map(|i| {
        // One per octant, so that strands pull all ways.
        let sign = |c: usize| if i >> c & 1 == 1 { 1.0 } else { -1.0 };
        let out = Vector3::from_fn(|c, _| sign(c) * random.between(0.2, 1.0));
        // On its own side, or turning the body would slacken it.
        let near = Vector3::from_fn(|c, _| sign(c) * random.between(0.0, 0.02));
        let far = near + out.normalize() * random.between(0.03, 0.08);
        Strand {
            ends: [centre + near, centre + far].map(Into::into),
            stiffness: random.power(3.0, 4.0),
            strain: random.between(0.01, 0.08),
        }
    });
    let strands = strands.collect();
    let force = |random: &mut Random, follows| Force {
        point: (centre + Vector3::from_fn(|_, _| 0.03 * random.uniform())).into(),
        // One that turns with the body is no stronger than what holds it: there the iteration, which sees the symmetric part of its
        // stiffness alone, no longer converges.
        force: std::array::from_fn(|_| if follows { 10.0 } else { 30.0 } * random.uniform()),
        follows,
    };
    (strands, [force(&mut random, false), force(&mut random, true)])
}

fn scene(strands: &[Strand], forces: &[Force]) -> (Scene, Mesh) {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for (i, strand) in strands.iter().enumerate() {
        let name = format!("strand {i}");
        let first = mesh.points.len() as u32;
        mesh.points.extend(strand.ends);
        mesh.blocks.push(CellBlock {
            name: name.clone(),
            kind: CellKind::Line2,
            nodes: vec![first, first + 1],
        });
        mesh.node_sets.entry("body".to_string()).or_default().push(first);
        mesh.node_sets.entry("ground".to_string()).or_default().push(first + 1);
        let (stiffness, reference_strain) = (strand.stiffness, strand.strain);
        scene.strands.push(StrandSpec { region: name, stiffness, toe: TOE, reference_strain });
    }
    scene.prescribed.push(held("ground"));
    scene.ties.push(TieSpec { nodes: "body".to_string(), body: "bone".to_string() });
    scene.free_bodies.push(FreeBodySpec::new("bone"));
    for (i, force) in forces.iter().enumerate() {
        let Force { point, force, follows } = *force;
        let (name, body, control) = (format!("force {i}"), "bone".to_string(), "load".to_string());
        scene.body_forces.push(BodyForceSpec { name, body, point, force, follows, control });
    }
    (scene, mesh)
}

fn held(set: &str) -> PrescribedSpec {
    PrescribedSpec { nodes: set.to_string(), components: [true; 3], displacement: vec![], control: None }
}

fn solve(scene: &Scene, mesh: &Mesh) -> (Plan, Run) {
    let plan = Plan::new(scene, mesh.clone()).unwrap_or_else(|e| panic!("{e}"));
    let load = |part: f64| {
        let controls: Vec<(&str, f64)> = plan.controls.iter().map(|c| (c.as_str(), part)).collect();
        plan.load(&controls, &[]).unwrap()
    };
    let frame = |k: usize| DriveFrame { time: k as f64, load: load(k as f64 / PARTS as f64) };
    let drive = Drive { frames: (1..=PARTS).map(frame).collect() };
    let run = run(&plan, &drive, &Settings::default(), None, &mut |_| {});
    (plan, run)
}

fn solved(scene: &Scene, mesh: &Mesh) -> (Plan, FreeBodyState, Vec<f64>) {
    let (plan, run) = solve(scene, mesh);
    assert!(run.is_solved(), "{}", run.errors[0]);
    let frame = run.last().unwrap();
    let state = free_bodies(&plan, frame.snapshot()).remove(0);
    (plan, state, frame.x.clone())
}

/// Force and moment about the place of `origin` on a rigid body in a pose, written down anew: Blankevoort's strands, and forces.
fn wrench(strands: &[Strand], forces: &[Force], origin: Point3<f64>, pose: &Isometry3<f64>) -> Vector6<f64> {
    let near: Vec<Point3<f64>> = strands.iter().map(|s| pose * Point3::from(s.ends[0])).collect();
    wrench_at(strands, &near, forces, origin, pose)
}

/// The same with the ends of the strands anywhere: a body of bone gives by some nanometres, and a strand has 1e6 N/m.
fn wrench_at(
    strands: &[Strand],
    near: &[Point3<f64>],
    forces: &[Force],
    origin: Point3<f64>,
    pose: &Isometry3<f64>,
) -> Vector6<f64> {
    let mut sum = Vector6::zeros();
    let mut add = |at: Point3<f64>, f: Vector3<f64>| {
        let moment = (at - pose * origin).cross(&f);
        sum += Vector6::new(f.x, f.y, f.z, moment.x, moment.y, moment.z);
    };
    for (strand, &at) in strands.iter().zip(near) {
        let [near, far] = strand.ends.map(Point3::from);
        let slack = (far - near).norm() / (1.0 + strand.strain);
        let strain = (far - at).norm() / slack - 1.0;
        let tension = match strain {
            e if e <= 0.0 => 0.0,
            e if e <= 2.0 * TOE => strand.stiffness * e * e / (4.0 * TOE),
            e => strand.stiffness * (e - TOE),
        };
        add(at, (far - at).normalize() * tension);
    }
    for force in forces {
        let f = Vector3::from(force.force);
        add(pose * Point3::from(force.point), if force.follows { pose.rotation * f } else { f });
    }
    sum
}

/// The pose in which nothing is left of the wrench: Newton's method on six equations with differences, loads in ten steps.
fn rigid_equilibrium(strands: &[Strand], forces: &[Force], origin: Point3<f64>) -> Isometry3<f64> {
    let moved = |pose: &Isometry3<f64>, by: &Vector6<f64>| {
        let turn = UnitQuaternion::from_scaled_axis(by.fixed_rows::<3>(3).into_owned());
        let place = pose * origin + by.fixed_rows::<3>(0);
        let rotation = turn * pose.rotation;
        Isometry3::from_parts(Translation3::from(place - rotation * origin), rotation)
    };
    let mut pose = Isometry3::identity();
    for part in 1..=PARTS {
        let load: Vec<Force> = forces
            .iter()
            .map(|f| Force { force: f.force.map(|v| v * part as f64 / PARTS as f64), ..*f })
            .collect();
        for _ in 0..50 {
            let left = wrench(strands, &load, origin, &pose);
            let column = |c: usize| {
                let h = if c < 3 { 1e-8 } else { 1e-6 };
                let step = Vector6::from_fn(|r, _| if r == c { h } else { 0.0 });
                let at = |by| wrench(strands, &load, origin, &moved(&pose, &by));
                (at(step) - at(-step)) / (2.0 * h)
            };
            let jacobian = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(column));
            let step = jacobian.lu().solve(&-left).expect("strands all round hold it");
            // At most a millimetre and 3 degrees at once.
            let size = (step.fixed_rows::<3>(0).norm() / 1e-3).max(step.fixed_rows::<3>(3).norm() / 0.05);
            pose = moved(&pose, &(step / size.max(1.0)));
            if size < 1e-9 {
                break;
            }
        }
    }
    pose
}

#[test]
fn a_hundred_random_bodies_stand_where_six_rigid_equations_put_them() {
    let mut turned: f64 = 0.0;
    for seed in 0..100 {
        let (strands, forces) = random_body(seed);
        let (scene, mesh) = scene(&strands, &forces);
        let (plan, state, x) = solved(&scene, &mesh);
        let origin = Point3::from(plan.free_bodies[0].origin);
        let near: Vec<Point3<f64>> =
            (0..strands.len()).map(|s| Point3::from_slice(&x[6 * s..6 * s + 3])).collect();
        let left = wrench_at(&strands, &near, &forces, origin, &state.pose);
        let (force, moment) = (left.fixed_rows::<3>(0).norm(), left.fixed_rows::<3>(3).norm());
        assert!(force < FORCE && moment < MOMENT, "seed {seed}: {force:.1e} N and {moment:.1e} N m are left");
        let known = rigid_equilibrium(&strands, &forces, origin);
        let apart = (known * origin - state.pose * origin).norm();
        let angle = known.rotation.angle_to(&state.pose.rotation);
        // A body of bone gives by a millionth.
        assert!(apart < 1e-6 && angle < 1e-4, "seed {seed}: {apart:.1e} m and {angle:.1e} rad apart");
        assert!(state.strain < 1e-5, "seed {seed}: strain {:.1e}", state.strain);
        turned = turned.max(state.pose.rotation.angle());
    }
    assert!(turned > 0.1, "nothing turned by more than {turned} rad: this tests no finite rotations");
}

#[test]
fn what_is_held_stays_and_the_rest_is_in_equilibrium() {
    let all = [
        Coordinate::X,
        Coordinate::Y,
        Coordinate::Z,
        Coordinate::TurnX,
        Coordinate::TurnY,
        Coordinate::TurnZ,
    ];
    let (strands, forces) = random_body(7);
    for subset in 1..63_u32 {
        let (mut scene, mesh) = scene(&strands, &forces[..1]);
        scene.free_bodies[0].held = (0..6).filter(|c| subset >> c & 1 == 1).map(|c| all[c]).collect();
        let (plan, state, _) = solved(&scene, &mesh);
        let origin = Point3::from(plan.free_bodies[0].origin);
        let shift = state.pose * origin - origin;
        let R = state.pose.rotation.to_rotation_matrix().into_inner();
        // R = Rz Rx Ry.
        let turn = [R[(2, 1)].asin(), (-R[(2, 0)]).atan2(R[(2, 2)]), (-R[(0, 1)]).atan2(R[(1, 1)])];
        let moved = [shift.x, shift.y, shift.z, turn[0], turn[1], turn[2]];
        let Wrench { force, .. } = state.residual;
        for c in 0..6 {
            if subset >> c & 1 == 1 {
                assert!(moved[c].abs() < 1e-5 && (c > 2 || moved[c].abs() < 1e-12), "{subset:b}: {moved:?}");
            } else {
                assert!(moved[c] != 0.0, "{subset:b}: {:?} did not move", all[c]);
                assert!(c > 2 || force[c].abs() < FORCE, "{subset:b}: {force:?} N are left");
            }
        }
    }
}

#[test]
fn forces_and_stiffness_are_derivatives_of_the_energy() {
    let (strands, forces) = random_body(3);
    let (mut scene, mesh) = scene(&strands, &forces[..1]);
    scene.free_bodies[0].held = vec![Coordinate::TurnX];
    // Soft, so that the frame does not drown the rest.
    scene.free_bodies[0].young = 1e6;
    let plan = Plan::new(&scene, mesh).unwrap();
    let (island, load) = (plan.islands[0].clone(), plan.load(&[("load", 1.0)], &[]).unwrap());
    let mut potential = LoadedIsland::new(island.clone(), load.clone(), load);
    let mut x = island.free_positions(&island.X);
    potential.set_load(1.0, &mut x);
    let mut random = Random::new(3);
    x.iter_mut().for_each(|x| *x += 1e-4 * random.uniform());
    let mut direction = || (0..x.len()).map(|_| random.uniform()).collect::<Vec<f64>>();
    let (mut u, mut w) = (direction(), direction());
    for (i, _) in potential.fixed().iter().enumerate().filter(|(_, fixed)| **fixed) {
        (u[i], w[i]) = (0.0, 0.0);
    }
    let [of_energy, of_forces] = derivative_orders(&potential, &x, [&u, &w], 1e-4);
    assert!(of_energy > 1.9 && of_forces > 1.9, "orders {of_energy:.2} and {of_forces:.2}");
}

#[test]
fn stiffness_of_a_force_that_turns_is_the_symmetric_part_of_its_derivative() {
    let (strands, forces) = random_body(5);
    let (scene, mesh) = scene(&strands, &forces);
    let plan = Plan::new(&scene, mesh).unwrap();
    let island = &plan.islands[0];
    let effect = island.effects.iter().find(|e| !e.has_potential()).expect("force 1 turns");
    let mut random = Random::new(5);
    let x: Vec<f64> = island.X.iter().map(|x| x + 2e-3 * random.uniform()).collect();
    let controls = [0.7];
    let forces = |x: &[f64]| {
        let mut out = vec![0.0; 12];
        effect.forces(&State { x, controls: &controls }, 0, &mut out);
        out
    };
    let mut stiffness = vec![0.0; 144];
    effect.stiffness(&State { x: &x, controls: &controls }, 0.0, 0, &mut stiffness);
    let columns = (0..12).map(|c| {
        let at = |h: f64| {
            let mut x = x.clone();
            x[3 * effect.nodes()[c / 3] as usize + c % 3] += h;
            forces(&x)
        };
        let (ahead, behind) = (at(1e-3), at(-1e-3));
        (0..12).map(|r| (ahead[r] - behind[r]) / 2e-3).collect::<Vec<f64>>()
    });
    let columns: Vec<Vec<f64>> = columns.collect();
    let largest = stiffness.iter().fold(0.0_f64, |m, k| m.max(k.abs()));
    assert!(largest > 10.0, "{largest} N/m: nothing to compare");
    for (r, c) in (0..144).map(|i| (i / 12, i % 12)) {
        let symmetric = 0.5 * (columns[c][r] + columns[r][c]);
        let found = stiffness[12 * r + c];
        assert!(
            (found - symmetric).abs() < 1e-9 * largest,
            "row {r}, column {c}: {found} and {symmetric} N/m"
        );
    }
}

#[test]
fn a_body_gives_as_a_cube_of_its_size() {
    let (strands, _) = random_body(4);
    let pulls = [1.0, -1.0].map(|sign| Force {
        point: [0.4 + sign * 0.01, -0.3, 0.2],
        force: [sign * 1e3, 0.0, 0.0],
        follows: false,
    });
    let (mut scene, mesh) = scene(&strands, &pulls);
    // Six strands would pull at it by more.
    scene.strands.iter_mut().for_each(|s| s.stiffness = 1.0);
    let (plan, state, _) = solved(&scene, &mesh);
    let FreeBody { size, .. } = plan.free_bodies[0];
    // Work of the pair on a strain e along x, 1e3 N 0.02 m e, is that of the stress E e in the cube of edge 2 size.
    let strain = 20.0 / (17e9 * (2.0 * size).powi(3));
    assert!((state.strain / strain - 1.0).abs() < 0.01, "{:.3e}, not {strain:.3e}", state.strain);
}

#[test]
fn steps_turn_a_body_and_do_not_stretch_it() {
    let (strands, forces) = random_body(6);
    let about = |axis: Vector3<f64>, held: &[Coordinate]| {
        let (mut scene, mesh) = scene(&strands, &forces[..1]);
        scene.free_bodies[0].held = held.to_vec();
        let plan = Plan::new(&scene, mesh).unwrap();
        let (island, load) = (plan.islands[0].clone(), plan.load(&[], &[]).unwrap());
        let potential = LoadedIsland::new(island.clone(), load.clone(), load);
        let x = island.free_positions(&island.X);
        let origin = Vector3::from(plan.free_bodies[0].origin);
        let rate = |x: &[f64]| axis.cross(&(Vector3::from_column_slice(x) - origin));
        let dx: Vec<f64> = x.chunks(3).flat_map(|x| <[f64; 3]>::from(rate(x))).collect();
        let mut out = x.clone();
        let off = |h: f64, out: &mut [f64]| {
            potential.go(&x, &dx, h, out);
            (0..x.len()).map(|i| (out[i] - x[i] - h * dx[i]).powi(2)).sum::<f64>().sqrt()
        };
        // It leaves the straight way as the square of the step.
        let order = (off(1e-2, &mut out) / off(5e-3, &mut out)).log2();
        assert!((order - 2.0).abs() < 0.1, "order {order} about {axis:?}");
        off(1.0, &mut out);
        let body = &plan.free_bodies[0];
        let mut places = plan.reference();
        let full = potential.expand(&out);
        for (&n, place) in island.nodes.iter().zip(full.chunks(3)) {
            places[3 * n as usize..3 * n as usize + 3].copy_from_slice(place);
        }
        (body.pose(&places), body.strain(&places))
    };
    let axis = Vector3::new(0.3, -0.2, 0.25);
    let (pose, strain) = about(axis, &[]);
    assert!(
        (pose.rotation.scaled_axis() - axis).norm() < 1e-12 && strain < 1e-12,
        "{pose}, strain {strain:e}"
    );
    // Of a held angle nothing is left, and the body is stretched no more.
    let (pose, strain) = about(Vector3::new(0.0, 0.3, 0.2), &[Coordinate::TurnX]);
    let R = pose.rotation.to_rotation_matrix();
    assert!(
        R[(2, 1)].abs() < 1e-12 && strain < 1e-12 && pose.rotation.angle() > 0.3,
        "{R}, strain {strain:e}"
    );
}

#[test]
fn a_body_that_nothing_holds_is_refused_with_its_free_directions() {
    let (strands, forces) = random_body(1);
    let refused = |strands: &[Strand], held: &[Coordinate]| {
        let (mut scene, mesh) = scene(strands, &forces[..1]);
        scene.free_bodies[0].held = held.to_vec();
        let (_, run) = solve(&scene, &mesh);
        run.errors.into_iter().next().map(|error| {
            let SolveError::Unsupported { island, parts } = error else { panic!("{error}") };
            assert_eq!(island, "bone (free body)");
            parts[0].directions.clone()
        })
    };
    // A taut strand holds its end, about which the body turns.
    let said = refused(&strands[..1], &[]).expect("one strand is no support");
    assert!(said.len() == 3 && said.iter().all(|d| d.starts_with("rotation about")), "{said:?}");
    let turns = [Coordinate::TurnX, Coordinate::TurnY, Coordinate::TurnZ];
    for (held, free) in [(&turns[..1], 2), (&turns[..2], 1), (&turns[1..], 1)] {
        assert_eq!(refused(&strands[..1], held).map(|said| said.len()), Some(free), "{held:?} held");
    }
    assert_eq!(refused(&strands[..1], &turns), None);
    // A slack one holds nothing.
    let slack = [Strand { strain: -0.1, ..strands[0] }];
    assert_eq!(refused(&slack, &[]).map(|said| said.len()), Some(6));
    let places = [Coordinate::X, Coordinate::Y, Coordinate::Z];
    for (held, of) in [(turns, "translation along"), (places, "rotation about")] {
        let said = refused(&slack, &held).expect("a slack strand is no support");
        assert!(said.len() == 3 && said.iter().all(|d| d.starts_with(of)), "{said:?}");
    }
    let said = refused(&slack, &[Coordinate::X, Coordinate::TurnX, Coordinate::TurnY, Coordinate::TurnZ]);
    assert_eq!(said.unwrap(), ["translation along y", "translation along z"]);
    assert_eq!(refused(&strands, &[]), None);
}

#[test]
fn contact_carries_a_free_body() {
    // A cube of 20 mm a micrometre deep in a plate, pressed by 10 N beside its middle.
    let mut mesh = generate::block([4, 4, 4], [0.02; 3]);
    let plate = generate::block([6, 6, 1], [0.04, 0.04, 0.01]);
    let n = mesh.points.len() as u32;
    mesh.blocks[0].name = "cube".to_string();
    mesh.node_sets = [("cube".to_string(), (0..n).collect())].into();
    mesh.surfaces.clear();
    mesh.points.extend(plate.points.iter().map(|p| [p[0] - 0.011, p[1] - 0.009, p[2] - 0.01 + 1e-6]));
    let nodes = plate.blocks[0].nodes.iter().map(|m| m + n).collect();
    mesh.blocks.push(CellBlock { name: "plate".to_string(), kind: CellKind::Hex8, nodes });
    mesh.node_sets.insert("plate".to_string(), (n..mesh.points.len() as u32).collect());
    let mut scene = Scene::default();
    scene.prescribed.push(held("plate"));
    scene.ties.push(TieSpec { nodes: "cube".to_string(), body: "bone".to_string() });
    let held = vec![Coordinate::X, Coordinate::Y, Coordinate::TurnZ];
    scene.free_bodies.push(FreeBodySpec { held, ..FreeBodySpec::new("bone") });
    let (name, body, control) = ("push".to_string(), "bone".to_string(), "load".to_string());
    let (point, force) = ([0.011, 0.01, 0.02], [0.0, 0.0, -10.0]);
    scene.body_forces.push(BodyForceSpec { name, body, point, force, follows: false, control });
    let contact = ContactSpec { mode: ContactMode::Cheap, ..ContactSpec::new(&["cube", "plate"]) };
    scene.contact = Some(contact.clone());
    let said = Plan::new(&scene, mesh.clone()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("`cube` and `plate`: both are rigid") && said.contains("stiffness"), "{said}");
    scene.contact = Some(ContactSpec { stiffness: Some(1e6), distance: 1e-4, ..contact });
    let (plan, run) = solve(&scene, &mesh);
    assert!(run.is_solved(), "{}", run.errors[0]);
    let at = run.last().unwrap().snapshot();
    let carried = pair_forces(&plan, at, [0.01, 0.01, 0.0]).remove(0);
    assert!((carried.wrench.force[2].abs() - 10.0).abs() < FORCE, "{:?} N", carried.wrench.force);
    let state = free_bodies(&plan, at).remove(0);
    assert!(state.residual.force[2].abs() < FORCE && state.residual.moment[1].abs() < MOMENT, "{state:?}");
    // Pushed at x > 10 mm it leans that way, about +y, by 12 M / (k a^4) = 7.5e-5, k = stiffness / distance; samples 5 mm apart
    // make the second moment of the face an eighth too great.
    let lean = state.pose.rotation.scaled_axis().y;
    assert!((6e-5..8e-5).contains(&lean), "{lean} rad");
}

#[test]
fn mistakes_in_free_bodies_are_named_with_their_remedy() {
    let (strands, forces) = random_body(1);
    let said = |change: &dyn Fn(&mut Scene)| {
        let (mut scene, mesh) = scene(&strands, &forces);
        change(&mut scene);
        Plan::new(&scene, mesh).err().map(|e| e.to_string()).unwrap_or_default()
    };
    type Change<'a> = &'a dyn Fn(&mut Scene);
    let cases: [(Change, &[&str]); 6] = [
        (&|s| s.free_bodies[0].body = "bonne".to_string(), &["`bonne`", "nearest: `bone`"]),
        (&|s| s.free_bodies.push(FreeBodySpec::new("bone")), &["free body `bone` is there twice"]),
        (&|s| s.inertia = Some(InertiaSpec::default()), &["`bone` has no mass", "leave out `inertia`"]),
        (&|s| s.free_bodies[0].young = -1.0, &["young [Pa] is -1, must be positive"]),
        (&|s| s.body_forces[0].body = "bnoe".to_string(), &["body force `force 0`", "nearest: `bone`"]),
        (&|s| s.body_forces[1].force[2] = f64::NAN, &["force along z [N] is NaN"]),
    ];
    for (change, needed) in cases {
        let said = said(change);
        assert!(needed.iter().all(|n| said.contains(n)), "{said}");
    }
    let (scene, mesh) = scene(&strands, &forces);
    let plan = Plan::new(&scene, mesh).unwrap();
    let said = plan.load(&[], &[("bone", Isometry3::identity())]).unwrap_err().to_string();
    assert!(said.contains("`bone` is free") && said.contains("take it out of the drive"), "{said}");
    let said = Plan::parse("[[free_bodies]]\nbody = \"bone\"\nhold = []\n", "s.toml".as_ref()).unwrap_err();
    assert!(said.to_string().contains("hold") && said.to_string().contains("line 3"), "{said}");
}
