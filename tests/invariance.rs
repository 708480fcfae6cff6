//! Does the answer not depend on what it must not depend on: place, rotation, numbering, threads?

#![allow(non_snake_case)]

use fem::effect::State;
use fem::mesh::{Mesh, generate};
use fem::run::{Drive, run};
use fem::scene::*;
use nalgebra::{Isometry3, Point3, UnitQuaternion};
use support::Random;
use support::fem_scenes::{displaced, distorted_box, laws, mooney_rivlin, plan, solid, tolerance};

/// A box with trusses inside and a membrane on top.
fn everything(law: LawSpec) -> (Mesh, Scene) {
    let mut mesh = distorted_box(2);
    generate::add_fibres(&mut mesh, "trusses", [2; 3], &[[0, 0], [1, 1], [2, 1]]);
    let nodes = mesh.surfaces["z_max"].concat();
    let kind = fem::mesh::CellKind::Quad4;
    mesh.blocks.push(fem::mesh::CellBlock { name: "skin".to_string(), kind, nodes });
    let scene = Scene {
        solids: vec![solid("block", law, None)],
        fibres: vec![FibreSpec {
            name: "fibres".to_string(),
            course: Course::Region("trusses".to_string()),
            law: FibreLawSpec::Thermal {
                young: 1e6,
                contraction: 0.3,
                strain: fem::material::line::FibreStrain::Logarithmic,
                toe: None,
            },
            area: vec![1e-3],
            activation: Some("a".to_string()),
        }],
        membranes: vec![MembraneSpec {
            region: "skin".to_string(),
            thickness: 1e-3,
            law: MembraneLawSpec::NeoHookean { mu: 1e5 },
        }],
        ..Scene::default()
    };
    (mesh, scene)
}

fn random_pose(random: &mut Random) -> Isometry3<f64> {
    let axis = random.vector(1.0).normalize() * (std::f64::consts::PI * random.uniform());
    Isometry3::from_parts(random.vector(0.5).into(), UnitQuaternion::from_scaled_axis(axis))
}

fn moved(pose: &Isometry3<f64>, x: &[f64]) -> Vec<f64> {
    x.chunks_exact(3)
        .flat_map(|p| (pose * Point3::from_slice(p)).coords.iter().copied().collect::<Vec<_>>())
        .collect()
}

#[test]
fn rotated_rest_is_at_rest_and_rotated_states_have_rotated_forces() {
    let mut random = Random::new(11);
    for (name, law) in laws() {
        if matches!(law, LawSpec::LinearElastic { .. }) {
            continue; // of small strain: not invariant under rotation, as stated at the law
        }
        let (mesh, scene) = everything(law);
        let plan = plan(&scene, &mesh);
        let island = &plan.islands[0];
        let X = plan.reference();
        let x: Vec<f64> = X.iter().map(|x| 1.04 * x + 0.02 * random.uniform()).collect();
        let (mut at_rest, mut energy_change, mut force_change) = (0.0_f64, 0.0_f64, 0.0_f64);
        for _ in 0..20 {
            let pose = random_pose(&mut random);
            for e in 0..island.effects.len() {
                let effect = &island.effects[e];
                let rest = moved(&pose, &X);
                let g = island.effect_gradient(e, &State { x: &rest, controls: &[0.0] });
                let deformed = State { x: &x, controls: &[0.6] };
                let turned_x = moved(&pose, &x);
                let turned = State { x: &turned_x, controls: &[0.6] };
                let f = island.effect_gradient(e, &deformed);
                let expected = moved(&Isometry3::from_parts(Default::default(), pose.rotation), &f);
                let size = f.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                let difference = island
                    .effect_gradient(e, &turned)
                    .iter()
                    .zip(&expected)
                    .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                force_change = force_change.max(difference / size);
                let (a, b) = (effect.energy(&deformed), effect.energy(&turned));
                energy_change = energy_change.max((a - b).abs() / a.abs());
                // Forces on a cube of side 1 m against the modulus, 22 kPa or more: E A.
                at_rest = at_rest.max(g.iter().fold(0.0_f64, |m, v| m.max(v.abs())) / 22e3);
            }
        }
        println!("{name:<24} at rest {at_rest:.1e} E, energy {energy_change:.1e}, forces {force_change:.1e}");
        assert!(at_rest < 1e-10, "{name}: a rigid motion makes forces of {at_rest:.1e} E");
        assert!(energy_change < 1e-11, "{name}: energy changes by {energy_change:.1e} under rotation");
        assert!(force_change < 1e-11, "{name}: forces do not rotate with the state ({force_change:.1e})");
    }
}

/// A scene to solve: the box sheared and pressed, fibres active.
fn driven(mesh: &Mesh, mut scene: Scene) -> Scene {
    scene.prescribed = vec![
        displaced(mesh, "x_min", |_| [0.0; 3]),
        displaced(mesh, "x_max", |X| [-0.1, 0.1 * X[2], 0.05 * X[1]]),
    ];
    scene.prescribed[0].control = None;
    scene
}

#[test]
fn numbering_does_not_change_the_answer() {
    let (mesh, scene) = everything(mooney_rivlin());
    let mut random = Random::new(12);
    let mut shuffled = |n: usize| {
        let mut order: Vec<u32> = (0..n as u32).collect();
        for i in (1..n).rev() {
            order.swap(i, (random.bits() % (i as u64 + 1)) as usize);
        }
        order
    };
    let solve = |mesh: &Mesh| {
        let plan = plan(&driven(mesh, scene.clone()), mesh);
        let load = plan.load(&[("load", 1.0), ("a", 0.5)], &[]).expect("names of the scene");
        let mut run = run(&plan, &Drive::once(load), &tolerance(1e-11), None, &mut |_| {});
        assert!(run.is_solved(), "{}", run.errors[0]);
        run.frames.remove(0).x
    };
    let reference = solve(&mesh);
    for _ in 0..3 {
        let new = shuffled(mesh.points.len()); // old node → new node
        let mut other = mesh.clone();
        for (old, &n) in new.iter().enumerate() {
            other.points[n as usize] = mesh.points[old];
        }
        for block in &mut other.blocks {
            let m = block.kind.n_nodes();
            let order = shuffled(block.nodes.len() / m);
            let cells: Vec<u32> = order
                .iter()
                .flat_map(|&c| {
                    block.nodes[m * c as usize..m * (c as usize + 1)].iter().map(|&n| new[n as usize])
                })
                .collect();
            block.nodes = cells;
        }
        for set in other.node_sets.values_mut() {
            set.iter_mut().for_each(|n| *n = new[*n as usize]);
            set.sort_unstable();
        }
        other.surfaces.clear();
        let x = solve(&other);
        let worst = (0..mesh.points.len())
            .flat_map(|old| (0..3).map(move |c| (old, c)))
            .map(|(old, c)| (x[3 * new[old] as usize + c] - reference[3 * old + c]).abs())
            .fold(0.0, f64::max);
        println!("renumbered: largest change {worst:.1e} m on a box of 1 m");
        assert!(worst < 1e-10, "renumbering moves a node by {worst:.1e} m");
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let mesh = {
        let mut mesh = generate::block([6, 6, 6], [1.0; 3]);
        generate::distort(&mut mesh, 0.15, 3);
        mesh
    };
    let scene = Scene { solids: vec![solid("block", mooney_rivlin(), None)], ..Scene::default() };
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let plan = plan(&driven(&mesh, scene.clone()), &mesh);
            let load = plan.load(&[("load", 1.0)], &[]).expect("names of the scene");
            let run = run(&plan, &Drive::once(load), &tolerance(1e-8), None, &mut |_| {});
            assert!(run.is_solved(), "{}", run.errors[0]);
            run.frames[0].x.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        })
    };
    let one = solve(1);
    for threads in [2, 7] {
        assert!(solve(threads) == one, "{threads} threads give other bits than one");
    }
}

#[test]
fn what_is_absent_changes_nothing() {
    // An island of its own beside the box: bits of the box stay.
    let (mesh, scene) = everything(mooney_rivlin());
    let solve = |mesh: &Mesh, scene: Scene| {
        let plan = plan(&driven(mesh, scene), mesh);
        let load = plan.load(&[("load", 1.0), ("a", 0.5)], &[]).expect("names of the scene");
        let mut run = run(&plan, &Drive::once(load), &tolerance(1e-7), None, &mut |_| {});
        assert!(run.is_solved(), "{}", run.errors[0]);
        (plan.islands.len(), run.frames.remove(0).x)
    };
    let (n, alone) = solve(&mesh, scene.clone());
    assert_eq!(n, 1);
    let mut both = mesh.clone();
    let first = both.points.len() as u32;
    let other = generate::block([2, 2, 2], [1.0; 3]);
    both.points.extend(other.points.iter().map(|p| [p[0] + 3.0, p[1], p[2]]));
    let nodes = other.blocks[0].nodes.iter().map(|n| n + first).collect();
    both.blocks.push(fem::mesh::CellBlock {
        name: "other".to_string(),
        kind: fem::mesh::CellKind::Hex8,
        nodes,
    });
    both.node_sets
        .insert("other_end".to_string(), other.node_sets["x_min"].iter().map(|n| n + first).collect());
    let mut with_other = scene.clone();
    with_other.solids.push(solid("other", mooney_rivlin(), None));
    let plan_of_both = {
        let mut s = driven(&both, with_other);
        s.prescribed.push(support::fem_scenes::held("other_end", [true; 3]));
        plan(&s, &both)
    };
    assert_eq!(plan_of_both.islands.len(), 2);
    let load = plan_of_both.load(&[("load", 1.0), ("a", 0.5)], &[]).expect("names of the scene");
    let run = run(&plan_of_both, &Drive::once(load), &tolerance(1e-7), None, &mut |_| {});
    assert!(run.is_solved(), "{}", run.errors[0]);
    let same = alone.iter().zip(&run.frames[0].x).all(|(a, b)| a.to_bits() == b.to_bits());
    assert!(same, "an island that touches nothing changes the bits of the other");
}
