//! Do internal forces have no resultant and no moment, and does every cut carry what the ends carry?

#![allow(non_snake_case)]

use fem::effect::{EffectKind, NO_NODE, State};
use fem::measure::{Cut, body_wrenches, nodal_forces, section_force, support_wrench};
use fem::mesh::generate;
use fem::scene::*;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use support::Random;
use support::fem_scenes::{
    distorted_box, held, laws, mooney_rivlin, plan, solid, solve, symmetry_planes, tolerance,
};

/// A bar of 100 × 30 × 30 mm with nine embedded fibres (benchmark b04).
fn fibre_bar() -> (fem::mesh::Mesh, Scene) {
    let mesh = generate::block([20, 6, 6], [0.1, 0.03, 0.03]);
    let lines = [5e-3, 15e-3, 25e-3].into_iter().flat_map(|y| {
        [5e-3, 15e-3, 25e-3].map(|z| (0..=20).map(|i| [5e-3 * f64::from(i), y, z]).collect::<Vec<[f64; 3]>>())
    });
    let fibres = FibreSpec {
        name: "fibres".to_string(),
        course: Course::Embedded(lines.collect()),
        law: FibreLawSpec::Thermal {
            young: 1e6,
            contraction: 0.3,
            strain: fem::material::line::FibreStrain::Engineering,
            toe: None,
        },
        area: vec![4e-6],
        activation: Some("a".to_string()),
    };
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        fibres: vec![fibres],
        prescribed: symmetry_planes(),
        ..Scene::default()
    };
    (mesh, scene)
}

#[test]
fn internal_forces_have_no_resultant_and_no_moment() {
    let mut mesh = distorted_box(2);
    // Trusses along x and a membrane on the top.
    generate::add_fibres(&mut mesh, "trusses", [2; 3], &[[0, 0], [1, 1], [2, 1]]);
    let top = mesh.surfaces["z_max"].concat();
    mesh.blocks.push(fem::mesh::CellBlock {
        name: "skin".to_string(),
        kind: fem::mesh::CellKind::Quad4,
        nodes: top,
    });
    let mut random = Random::new(3);
    for (name, law) in laws() {
        if matches!(law, LawSpec::LinearElastic { .. }) {
            continue; // not invariant under rotation, so it has a moment at finite strain
        }
        let scene = Scene {
            solids: vec![solid("block", law, None)],
            fibres: vec![FibreSpec {
                name: "fibres".to_string(),
                course: Course::Region("trusses".to_string()),
                law: FibreLawSpec::Hill { sigma_max: 3e5, lambda_opt: 1.0 },
                area: vec![1e-2],
                activation: Some("a".to_string()),
            }],
            membranes: vec![MembraneSpec {
                region: "skin".to_string(),
                thickness: 1e-2,
                law: MembraneLawSpec::StVenantKirchhoff { young: 1e6, nu: 0.3 },
            }],
            ..Scene::default()
        };
        let plan = plan(&scene, &mesh);
        let x: Vec<f64> = plan.reference().iter().map(|x| 1.05 * x + 0.03 * random.uniform()).collect();
        let island = &plan.islands[0];
        for effect in &island.effects {
            let s = State { x: &x, controls: &[0.7] };
            let m = effect.nodes_per_group();
            let (mut force, mut moment, mut size) = (Vector3::zeros(), Vector3::zeros(), 0.0);
            for (group, nodes) in effect.nodes().chunks_exact(m).enumerate() {
                let mut f = vec![0.0; 3 * m];
                effect.forces(&s, group, &mut f);
                for (&n, f) in nodes.iter().zip(f.chunks_exact(3)).filter(|(n, _)| **n != NO_NODE) {
                    let (p, f) = (3 * n as usize, Vector3::from_column_slice(f));
                    force += f;
                    moment += Vector3::from_column_slice(&x[p..p + 3]).cross(&f);
                    size += f.norm();
                }
            }
            let (force, moment) = (force.norm() / size, moment.norm() / size);
            println!(
                "{name:<24} {:<8} resultant {force:.1e}, moment {moment:.1e} of the forces",
                effect.name()
            );
            assert!(
                size > 0.0 && force < 1e-13 && moment < 1e-13,
                "{name}, {}: {force:e} {moment:e}",
                effect.name()
            );
        }
    }
}

#[test]
fn every_cut_of_a_contracting_bar_carries_its_end_force() {
    let (mesh, mut scene) = fibre_bar();
    scene.prescribed.push(held("x_max", [true, false, false]));
    let plan = plan(&scene, &mesh);
    let frame = solve(&plan, &[("a", 0.5)], &tolerance(1e-10));
    // Matrix unstrained: 9 E A 0.3 a.
    let exact = 9.0 * 1e6 * 4e-6 * 0.3 * 0.5;
    let end = support_wrench(&plan, frame.snapshot(), &mesh.node_sets["x_max"], [0.0; 3]).force[0];
    println!("end force {end:.9} N, exact {exact} N");
    assert!((end - exact).abs() < 1e-8 * exact, "end force {end} N instead of {exact} N");
    for x in [12e-3, 30e-3, 48e-3, 61e-3, 97e-3] {
        let cut = Cut { point: [x, 0.0, 0.0], normal: [1.0, 0.0, 0.0], effects: vec![] };
        let section = section_force(&plan, frame.snapshot(), &cut);
        let (total, fibre) =
            (section.along([1.0, 0.0, 0.0]), section.along_of(EffectKind::Fibre, [1.0, 0.0, 0.0]));
        println!("cut at {x} m: total {total:.9} N, fibre {fibre:.9} N, {} nodes", section.n_nodes);
        assert!((total - exact).abs() < 1e-4 * exact, "cut at {x} m: {total} N instead of {exact} N");
        assert!((fibre - exact).abs() < 1e-4 * exact, "cut at {x} m: the fibres carry {fibre} N");
    }
}

#[test]
fn wrenches_on_the_bodies_balance() {
    let mesh = generate::block([8, 3, 3], [0.08, 0.03, 0.03]);
    let tie = |nodes: &str, body: &str| TieSpec { nodes: nodes.to_string(), body: body.to_string() };
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        ties: vec![tie("x_min", "pelvis"), tie("x_max", "tibia")],
        ..Scene::default()
    };
    let plan = plan(&scene, &mesh);
    let pose = Isometry3::from_parts(
        Vector3::new(0.01, 0.004, -0.003).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.1, -0.2)),
    );
    let load = plan.load(&[], &[("tibia", pose)]).expect("a body of the scene");
    let drive = fem::run::Drive::once(load);
    let run = fem::run::run(&plan, &drive, &tolerance(1e-9), None, &mut |_| {});
    assert!(run.is_solved(), "{}", run.errors[0]);
    let frame = &run.frames[0];
    let moved =
        pose * nalgebra::Point3::from(mesh.points[*mesh.node_sets["x_max"].last().expect("nodes") as usize]);
    let n = 3 * *mesh.node_sets["x_max"].last().expect("nodes") as usize;
    assert!((moved.coords - Vector3::from_column_slice(&frame.x[n..n + 3])).norm() < 1e-15);
    // About one common place in space.
    let centre = [0.0; 3];
    let back = pose.inverse() * nalgebra::Point3::origin();
    let [a, b] = body_wrenches(&plan, frame.snapshot(), &[centre, back.into()])[..] else {
        panic!("two bodies")
    };
    let size = Vector3::from(a.force).norm();
    for i in 0..3 {
        assert!((a.force[i] + b.force[i]).abs() < 1e-8 * size, "forces {:?} and {:?}", a.force, b.force);
        assert!((a.moment[i] + b.moment[i]).abs() < 1e-8 * size, "moments {:?} and {:?}", a.moment, b.moment);
    }
    let largest = nodal_forces(&plan, frame.snapshot()).iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(largest > 1e-3 && size > 0.01, "the bar must be loaded: {size} N");
}

#[test]
fn a_face_that_moves_as_a_plane_carries_no_net_force() {
    // Benchmark b04, free end: its nodes keep equal x displacements and their axial forces add up to nothing.
    let (mesh, mut scene) = fibre_bar();
    scene.planes.push(PlaneSpec { nodes: "x_max".to_string(), axis: 0.into() });
    let plan = plan(&scene, &mesh);
    let frame = solve(&plan, &[("a", 0.5)], &tolerance(1e-9));
    let end: Vec<f64> = mesh.node_sets["x_max"].iter().map(|&n| frame.x[3 * n as usize]).collect();
    assert!(end.iter().all(|x| (x - end[0]).abs() < 1e-15), "the face is no plane: {end:?}");
    let g = nodal_forces(&plan, frame.snapshot());
    let net: f64 = mesh.node_sets["x_max"].iter().map(|&n| g[3 * n as usize]).sum();
    let stretch = end[0] / 0.1;
    println!("free stretch {stretch:.8}, net axial force {net:.1e} N");
    assert!(net.abs() < 1e-7, "net axial force {net} N");
    // `b04_fibre_bar.csv`, activation 0.5, engineering law; tolerance of the benchmark.
    assert!((stretch - 0.90808337).abs() < 0.005 * 0.09, "free stretch {stretch}");
}
