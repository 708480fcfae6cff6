//! Scenes with contact: nothing passes through, forces are those of mechanics, mistakes are named.

use fem::body::Pose;
use fem::contact::Contact;
use fem::measure::{contact_tractions, nodal_forces, pair_forces, support_wrench};
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::*;
use fem::solve::Settings;
use rayon::prelude::*;
use support::contact_scenes::*;
use support::fem_scenes::{held, mooney_rivlin, plan};
use support::{Random, taylor_order};

const B06: [[usize; 3]; 2] = [[4, 4, 2], [5, 5, 3]];

fn blocks_contact() -> ContactSpec {
    ContactSpec::new(&["lower_z_max", "upper_z_min"])
}

/// Contact of the first island.
pub(super) fn contact_of(plan: &Plan) -> &Contact {
    plan.islands[0].contact.as_ref().expect("the island has contact")
}

/// Gradient and Hessian of the whole contact potential, with samples over faces, edges and corners.
#[test]
fn the_contact_potential_of_two_surfaces_has_exact_derivatives() {
    contact_has_exact_derivatives(ContactMode::Guarded, &["lower_z_max", "upper_z_min"], 2.5e-3, 0.0);
}

/// The same of softened contact, with samples of each block inside the other: corners, and all of them.
#[test]
fn softened_contact_has_exact_derivatives_in_penetrations() {
    for softness in SAMPLED_DIFFERENTLY {
        contact_has_exact_derivatives(
            ContactMode::Guarded,
            &["lower_block", "upper_block"],
            5.5e-3,
            softness,
        );
    }
}

/// Fractions of the activation distance below which softened contact is sampled at corners, and at all samples.
pub(super) const SAMPLED_DIFFERENTLY: [f64; 2] = [0.3, 0.1];

/// The same of cheap contact, with samples of open surfaces beside each other's rims.
#[test]
fn cheap_contact_has_exact_derivatives() {
    contact_has_exact_derivatives(ContactMode::Cheap, &["lower_z_max", "upper_z_min"], 5.5e-3, 0.0);
}

/// Rims that lie on each other keep their samples wherever round-off puts them: under a penetration g they press with ε g on the
/// whole area.
#[test]
fn cheap_contact_presses_up_to_rims_that_lie_on_each_other() {
    let distance = 1e-3;
    let spec = ContactSpec { distance, mode: ContactMode::Cheap, ..blocks_contact() };
    let (scene, mesh) = two_blocks([[4, 4, 2], [5, 5, 2]], 0.0, spec);
    let plan = plan(&scene, &mesh);
    let contact = contact_of(&plan);
    let young = 9.0 * 747.5e3 * 7.5e3 / (3.0 * 747.5e3 + 7.5e3);
    let (depth, mut random) = (2e-4, Random::new(5));
    for aside in [0.0, 1e-15, 1e-9] {
        let mut x = plan.reference();
        for n in mesh.points.len() - 6 * 6 * 3..mesh.points.len() {
            x[3 * n] += aside * random.uniform();
            x[3 * n + 1] += aside * random.uniform();
            x[3 * n + 2] -= depth;
        }
        let pair = &contact.pair_forces(&x, [0.0; 3])[0];
        let wanted = young * depth / distance * 4e-4;
        assert!(
            (pair.wrench.force[2].abs() / wanted - 1.0).abs() < 1e-6,
            "aside {aside}: {pair:?}, {wanted} N"
        );
    }
}

/// Two blocks 4.5 mm apart, one moved by `closer` \[m\] towards the other, and at random.
fn contact_has_exact_derivatives(mode: ContactMode, surfaces: &[&str], closer: f64, softness: f64) {
    let mut random = Random::new(2);
    let spec = ContactSpec { mode, distance: 4e-3, ..ContactSpec::new(surfaces) };
    let (scene, mut mesh) = two_blocks([[2, 2, 1], [3, 3, 1]], 4.5e-3, spec);
    mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += 4e-4 * random.uniform()));
    let plan = plan(&scene, &mesh);
    let contact = contact_of(&plan);
    let n_upper = plan.mesh.node_sets["upper_z_max"].len() * 2;
    let X = plan.reference();
    let (mut worst, mut worst_second, mut seen) = (f64::MAX, f64::MAX, 0);
    for _ in 0..20 {
        let mut x = X.clone();
        let slide = [3e-3 * random.uniform(), 3e-3 * random.uniform(), -closer];
        for n in mesh.points.len() - n_upper..mesh.points.len() {
            (0..3).for_each(|c| x[3 * n + c] += slide[c] + 2e-4 * random.uniform());
        }
        let n = x.len();
        let direction: Vec<f64> = (0..n).map(|_| random.uniform()).collect();
        let other: Vec<f64> = (0..n).map(|_| random.uniform()).collect();
        let at = |h: f64| -> Vec<f64> { x.iter().zip(&direction).map(|(x, d)| x + h * d).collect() };
        let gradient = |x: &[f64]| {
            let mut g = vec![0.0; n];
            contact.add_gradient(x, softness, &mut g);
            g
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        assert!(contact.energy(&x, softness) > 0.0, "the surfaces are within reach");
        assert!(softness > 0.0 || contact.energy(&x, softness).is_finite());
        let h = 1e-7;
        worst =
            worst.min(taylor_order(|h| contact.energy(&at(h), softness), dot(&gradient(&x), &direction), h));
        let mut product = vec![0.0; n];
        for ([i, j], block) in contact.hessian(&x, softness, 0.0) {
            for e in 0..9 {
                product[3 * i as usize + e / 3] += block[e] * direction[3 * j as usize + e % 3];
            }
        }
        // A sample that leaves a face within the step is smooth only once; there are few.
        let order = taylor_order(|h| dot(&gradient(&at(h)), &other), dot(&product, &other), h);
        if order > 1.9 {
            seen += 1;
        } else {
            worst_second = worst_second.min(order);
        }
    }
    println!(
        "gradient order {worst:.2}; Hessian exact in {seen} of 20 states (least order else {worst_second:.2})"
    );
    assert!(worst > 1.9, "gradient: order {worst}");
    assert!(seen >= 17, "Hessian exact in {seen} of 20 states, {worst_second}");
}

/// A block is dragged over the waves of another, by twelve times the gap and more than the length of its cells: in one step, for
/// which softened contact finds the guess, and in many short ones, which need none. Once its top is displaced, and once it is carried
/// along with a body.
#[test]
fn a_long_slide_ends_where_many_short_ones_do() {
    let way = [0.015, 0.002, -0.0015];
    for on_body in [false, true] {
        let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
        let parts = [
            ("lower", [8, 4, 2], [0.04, 0.02, 0.01], 0.0),
            ("upper", [4, 3, 2], [0.012, 0.01, 0.008], 0.0112),
        ];
        for (name, n, size, z) in parts {
            let law = LawSpec::NeoHookean { young: 20e3, nu: 0.45 };
            add(&mut scene, &mut mesh, name, generate::block(n, size), [0.002, 0.0, z], law);
        }
        for p in mesh.points.iter_mut().filter(|p| p[2] < 0.0105) {
            p[2] *= 1.0 + 0.05 * (400.0 * p[0]).sin();
        }
        scene.prescribed.push(held("lower_z_min", [true; 3]));
        match on_body {
            false => scene.prescribed.push(moved("upper_z_max", [true; 3], way, "slide")),
            true => scene.ties.push(TieSpec { nodes: "upper_z_max".to_string(), body: "sledge".to_string() }),
        }
        scene.contact = Some(ContactSpec::new(&["lower_block", "upper_block"]));
        let plan = plan(&scene, &mesh);
        let pose = Pose::translation(way[0], way[1], way[2]);
        let end = |steps: usize| {
            let drive = match on_body {
                false => ramp(&plan, &[("slide", 1.0)], &[], steps),
                true => ramp(&plan, &[], &[("sledge", pose)], steps),
            };
            let out = guarded(&plan, &drive, &Settings::default());
            let out = out.unwrap_or_else(|e| panic!("{steps} steps: {e}"));
            let n: usize = out.frames.iter().flat_map(|f| &f.islands).map(|i| i.iterations).sum();
            println!("on a body {on_body}, {steps} steps: {n} iterations");
            out.last().expect("a frame").x.clone()
        };
        let (one, many) = (end(1), end(30));
        let apart = one.iter().zip(&many).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-7, "nodes end {apart} m apart");
    }
}

/// A wall leans over the held corner of a blade, and both are held by the same ground: what is tied to it at one end can still meet
/// there.
#[test]
fn bodies_that_are_held_together_still_meet() {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let parts = [
        ("blade", [2, 1, 1], [0.02, 0.003, 0.01], [0.0, 0.0061, 0.0]),
        ("wall", [1, 1, 2], [0.02, 0.02, 0.036], [0.0204, 0.0, -0.004]),
    ];
    for (name, n, size, shift) in parts {
        let law = LawSpec::NeoHookean { young: 20e3, nu: 0.3 };
        add(&mut scene, &mut mesh, name, generate::block(n, size), shift, law);
        scene.prescribed.push(held(&format!("{name}_z_min"), [true; 3]));
    }
    scene.prescribed.push(moved("wall_z_max", [true, true, true], [-0.012, 0.0, -0.002], "lean"));
    let spec = ContactSpec { spacing: Some(0.02), ..ContactSpec::new(&["blade_block", "wall_block"]) };
    scene.contact = Some(spec);
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("lean", 1.0)], &[], 4), &Settings::default());
    let out = out.unwrap_or_else(|e| panic!("{e}"));
    let pair = &pair_forces(&plan, out.last().expect("a frame").snapshot(), [0.0; 3])[0];
    println!("{:?}", pair.wrench.force);
    assert!(pair.wrench.force[0].abs() > 0.1, "the wall rests on the corner: {:?} N", pair.wrench.force);
}

#[test]
fn stacked_blocks_carry_the_uniaxial_force() {
    let distance = 1e-6;
    let (mut scene, mesh) = two_blocks(B06, distance, ContactSpec { distance, ..blocks_contact() });
    scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, -1.0], "down"));
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("down", 6e-3)], &[], 1), &Settings::default()).expect("solved");
    let frame = out.last().expect("one frame");
    let top = &plan.mesh.node_sets["upper_z_max"];
    let force = -support_wrench(&plan, frame.snapshot(), top, [0.0; 3]).force[2];
    let pair = &pair_forces(&plan, frame.snapshot(), [0.0; 3])[0];
    println!("force {force:.5} N (4.3532), contact {:?}", pair);
    assert!((force / 4.3532 - 1.0).abs() < 3e-4, "{force}");
    assert!((pair.wrench.force[2].abs() - force).abs() < 1e-6 * force, "action and reaction: {pair:?}");
    // All but samples on the rim that the rim of the other block has left by more than a micrometre.
    assert!((0.9..1.001).contains(&(pair.area / 4e-4)), "nearly the whole area: {}", pair.area);
    let balance = nodal_forces(&plan, frame.snapshot());
    let free: f64 =
        plan.mesh.node_sets["upper_z_min"].iter().map(|&n| balance[3 * n as usize + 2].abs()).sum();
    assert!(free < 1e-5 * force, "free nodes are in balance: {free}");
}

#[test]
fn a_block_falls_onto_another_under_a_load_alone() {
    let (mut scene, mesh) = two_blocks(B06, 2e-3, blocks_contact());
    let top = &mesh.node_sets["upper_z_max"];
    let force = -0.2 / top.len() as f64;
    scene.forces.push(ForceSpec {
        name: "weight".to_string(),
        loads: top.iter().map(|&n| (n, [0.0, 0.0, force])).collect(),
        control: "load".to_string(),
    });
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("load", 1.0)], &[], 1), &Settings::default()).expect("solved");
    let pair = &pair_forces(&plan, out.last().expect("a frame").snapshot(), [0.0; 3])[0];
    println!("{pair:?}");
    assert!((pair.wrench.force[2].abs() - 0.2).abs() < 1e-4, "the load is 0.2 N: {:?}", pair.wrench);
}

#[test]
fn contact_out_of_reach_changes_no_bit_of_the_forces_and_absent_contact_keeps_islands_apart() {
    let (mut scene, mesh) = two_blocks(B06, 1e-3, blocks_contact());
    scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, 1.0], "up"));
    scene.prescribed.push(held("upper_z_min", [false, false, true]));
    let with = plan(&scene, &mesh);
    assert_eq!(with.islands.len(), 1);
    scene.contact = None;
    let without = plan(&scene, &mesh);
    assert_eq!(without.islands.len(), 2);
    assert!(without.absent.contains(&"contact"));
    let go = |plan: &Plan| {
        let drive = Drive::once(plan.load(&[("up", 1e-3)], &[]).expect("known"));
        run(plan, &drive, &Settings::default(), None, &mut |_| {}).frames.pop().expect("solved").x
    };
    let difference = go(&with).iter().zip(go(&without)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(difference < 1e-9, "{difference}");
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let answer = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let (scene, mesh, poses) = random_scene(4);
            let plan = plan(&scene, &mesh);
            let poses: Vec<_> = poses.iter().map(|(n, p)| (n.as_str(), *p)).collect();
            let out = run(&plan, &ramp(&plan, &[], &poses, 1), &Settings::default(), None, &mut |_| {});
            let last = out.frames.last().or(out.unsolved.as_ref()).expect("a state");
            last.x.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        })
    };
    let one = answer(1);
    assert!(one == answer(2) && one == answer(7));
}

#[test]
fn solutions_of_one_plan_at_once_are_that_of_one_alone() {
    let (scene, mesh, poses) = random_scene(4);
    let poses: Vec<_> = poses.iter().map(|(n, p)| (n.as_str(), *p)).collect();
    let answer = |plan: &Plan| {
        let out = run(plan, &ramp(plan, &[], &poses, 1), &Settings::default(), None, &mut |_| {});
        let last = out.frames.last().or(out.unsolved.as_ref()).expect("a state");
        last.x.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    let alone = answer(&plan(&scene, &mesh));
    let plan = plan(&scene, &mesh);
    // A worker that waits for its own work takes up another solution meanwhile.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
    let (done, all) = std::sync::mpsc::channel();
    std::thread::scope(|threads| {
        threads.spawn(|| {
            done.send(pool.install(|| (0..6).into_par_iter().map(|_| answer(&plan)).collect::<Vec<_>>()))
        });
        let waited = all.recv_timeout(std::time::Duration::from_secs(300));
        // A thread that waits for ever cannot be ended otherwise.
        let Ok(answers) = waited else { std::process::abort() };
        assert!(answers.iter().all(|a| *a == alone));
    });
}

#[test]
fn mistakes_are_named() {
    let compile = |change: &dyn Fn(&mut Scene, &mut Mesh)| {
        let (mut scene, mut mesh) = two_blocks(B06, 1e-3, blocks_contact());
        change(&mut scene, &mut mesh);
        Plan::new(&scene, mesh).err().expect("a mistake").to_string()
    };
    fn contact(scene: &mut Scene) -> &mut ContactSpec {
        scene.contact.as_mut().expect("there")
    }
    let cases: Vec<(String, Vec<&str>)> = vec![
        (
            compile(&|s, _| contact(s).surfaces[0] = "lower_zmax".into()),
            vec!["`lower_zmax`", "`lower_z_max`"],
        ),
        (
            compile(&|s, _| contact(s).pairs.push(["lower_z_max".into(), "uper_z_min".into()])),
            vec!["`uper_z_min`", "`upper_z_min`"],
        ),
        (compile(&|s, _| contact(s).distance = 0.0), vec!["distance [m] is 0", "positive"]),
        (compile(&|s, _| contact(s).stiffness = Some(f64::NAN)), vec!["stiffness [Pa] is NaN"]),
        (
            compile(&|s, _| contact(s).surfaces.push("lower_z_max".into())),
            vec!["`lower_z_max` is there twice"],
        ),
        (
            compile(&|s, _| {
                s.solids.pop();
            }),
            vec!["`upper_z_min`", "belongs to no solid"],
        ),
        (
            compile(&|s, m| {
                let upper = m.points.len() - 6 * 6 * 4;
                m.points[upper..].iter_mut().for_each(|p| p[2] -= 3e-3);
                contact(s).surfaces = vec!["lower_block".into(), "upper_block".into()];
            }),
            vec!["`lower_block` and `upper_block` by 2.000 mm", "repair"],
        ),
    ];
    for (message, words) in cases {
        println!("{message}");
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
    }
}

/// A shallow overlap is mended, free of stress, within the depth that is allowed.
#[test]
fn a_shallow_overlap_is_mended_without_stress() {
    let spec = ContactSpec { repair: 0.6e-3, ..ContactSpec::new(&["lower_block", "upper_block"]) };
    let (mut scene, mesh) = two_blocks(B06, -0.5e-3, spec);
    scene.prescribed.push(held("upper_z_max", [false, false, true]));
    let plan = plan(&scene, &mesh);
    println!("{:?}", plan.repair);
    assert!((plan.repair.overlaps[0].depth - 0.5e-3).abs() < 1e-6);
    assert!(plan.repair.farthest < 0.6e-3 && plan.repair.n_nodes > 0);
    let out = guarded(&plan, &ramp(&plan, &[], &[], 1), &Settings::default()).expect("solved");
    let forces = nodal_forces(&plan, out.last().expect("a frame").snapshot());
    assert!(forces.iter().all(|f| f.abs() < 1e-6), "at rest");
}

/// Every fourth of the seeds in every run of the tests; the hard case C-random runs them all.
#[test]
fn random_scenes_end_without_intersection() {
    for seed in (0..40).step_by(4) {
        let (scene, mesh, poses) = random_scene(seed);
        let plan = plan(&scene, &mesh);
        let poses: Vec<_> = poses.iter().map(|(n, p)| (n.as_str(), *p)).collect();
        let steps = 1 + (seed as usize % 3);
        if let Err(reason) = guarded(&plan, &ramp(&plan, &[], &poses, steps), &Settings::default()) {
            panic!("seed {seed}: {reason}");
        }
    }
}

/// Nodal tractions of the guarded mode under uniform pressure on unequal meshes.
#[test]
fn uniform_pressure_passes_unequal_meshes() {
    let (mut scene, mesh) = two_blocks(B06, 1e-6, ContactSpec { distance: 1e-6, ..blocks_contact() });
    scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, -1.0], "down"));
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("down", 1e-3)], &[], 1), &Settings::default()).expect("solved");
    let frame = out.last().expect("one frame");
    let force = pair_forces(&plan, frame.snapshot(), [0.0; 3])[0].wrench.force[2].abs();
    let mean = force / 4e-4;
    for surface in ["lower_z_max", "upper_z_min"] {
        let t = contact_tractions(&plan, frame.snapshot(), surface);
        let worst = t.iter().map(|(_, t)| (t[2].abs() / mean - 1.0).abs()).fold(0.0, f64::max);
        println!("{surface}: nodal pressure off by at most {:.2} %", 100.0 * worst);
        assert!(worst < 5e-3, "{surface}: {worst}");
    }
}

/// A tip whose faces are smaller than its overlap with a coarse body is mended: it does not turn over on the way.
#[test]
fn a_tip_finer_than_its_overlap_is_mended() {
    let spec = ContactSpec { repair: 2e-3, ..ContactSpec::new(&["lower_block", "upper_block"]) };
    let (scene, mut mesh) = two_blocks([[4, 4, 2], [6, 6, 8]], 0.0, spec);
    let first = mesh.points.len() - 7 * 7 * 9;
    for p in &mut mesh.points[first..] {
        // A pyramid of 0.3 mm faces at its tip, tilted, 1.2 mm into the lower block near a corner of its.
        let height = (p[2] - 10e-3) / 10e-3;
        let width = 0.09 + 0.91 * height;
        let (x, y) = (width * (p[0] - 10e-3), width * (p[1] - 10e-3));
        *p = [19e-3 + x + 2e-3 * height, 19e-3 + y + 1e-3 * height, p[2] - 1.2e-3 + 0.3 * x];
    }
    let plan = plan(&scene, &mesh);
    println!("{:?}", plan.repair);
    assert!(plan.repair.overlaps[0].depth > 0.5e-3, "there was an overlap");
    assert!(plan.repair.farthest < 2e-3 && plan.repair.n_ignored == 0);
}

/// A stiff ring that closes around a block takes it along through what would touch at once: one load step, where collision detection
/// alone would need many.
#[test]
fn a_closing_ring_squeezes_a_block_in_one_step() {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    add(
        &mut scene,
        &mut mesh,
        "soft",
        generate::block([5, 5, 4], [0.02, 0.02, 0.01]),
        [0.0; 3],
        mooney_rivlin(),
    );
    scene.prescribed.push(held("soft_z_min", [true; 3]));
    let first = mesh.points.len() as u32;
    let mut displacement = Vec::new();
    for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
        // Inner and outer, below and above; half of the height of the block, so that it can give way.
        for [half, z] in [[10.5e-3, 6e-3], [12e-3, 6e-3], [12e-3, 9e-3], [10.5e-3, 9e-3]] {
            mesh.points.push([10e-3 + half * x, 10e-3 + half * y, z]);
            displacement.push([-2e-3 * x, -2e-3 * y, 0.0]);
        }
    }
    let mut faces = Vec::new();
    for k in 0..4 {
        let (here, next) = (first + 4 * k, first + 4 * ((k + 1) % 4));
        faces.extend((0..4).map(|s| [here + s, next + s, next + (s + 1) % 4, here + (s + 1) % 4]));
    }
    let nodes = faces.iter().flatten().copied().collect();
    mesh.blocks.push(CellBlock { name: "ring/faces".into(), kind: CellKind::Quad4, nodes });
    mesh.surfaces.insert("ring".into(), faces);
    mesh.node_sets.insert("ring".into(), (first..first + 16).collect());
    scene.prescribed.push(PrescribedSpec {
        nodes: "ring".into(),
        components: [true; 3],
        displacement,
        control: Some("close".into()),
    });
    scene.contact = Some(ContactSpec { distance: 2e-4, ..ContactSpec::new(&["soft_block", "ring"]) });
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("close", 1.0)], &[], 1), &Settings::default()).expect("solved");
    let frame = out.last().expect("one frame");
    let island = &frame.islands[0];
    println!(
        "{} load steps, {} iterations, det F {:.2}",
        island.load_steps, island.iterations, island.least_det_f
    );
    let area: f64 = pair_forces(&plan, frame.snapshot(), [0.0; 3]).iter().map(|p| p.area).sum();
    assert!(area > 2e-4, "it is squeezed: {area} m2");
    assert_eq!(island.load_steps, 1);
}

/// A stiff punch that starts out of reach, so that at first nothing feels it move, does not jump into the block.
#[test]
fn a_punch_out_of_reach_does_not_jump_into_a_block() {
    let spec = ContactSpec { distance: 1e-4, ..ContactSpec::new(&["lower_block", "upper_block"]) };
    let (mut scene, mut mesh) = two_blocks(B06, 1e-3, spec);
    scene.prescribed.retain(|p| !p.nodes.starts_with("upper"));
    let upper = mesh.points.len() as u32 - 6 * 6 * 4;
    mesh.node_sets.insert("punch".into(), (upper..mesh.points.len() as u32).collect());
    scene.prescribed.push(moved("punch", [true; 3], [0.0, 0.0, -1.0], "down"));
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &ramp(&plan, &[("down", 2e-3)], &[], 1), &Settings::default()).expect("solved");
    let force =
        pair_forces(&plan, out.last().expect("one frame").snapshot(), [0.0; 3])[0].wrench.force[2].abs();
    println!("{force} N");
    assert!(force > 1.0, "the punch presses the block: {force} N");
}

/// Both flanks of a notch share the nodes of its valley; closed like a book they press on each other and do not pass through.
#[test]
fn flanks_of_a_notch_do_not_pass_through_each_other() {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    // 20 mm wide, 12 mm high at the sides and 4 mm in the valley.
    let body = generate::mapped([2, 2, 3], |s| {
        let x = 2.0 * s[0] - 1.0;
        [0.01 * x, 0.01 * s[1], s[2] * (4e-3 + 8e-3 * x.abs())]
    });
    add(&mut scene, &mut mesh, "book", body, [0.0; 3], mooney_rivlin());
    for (set, body) in [("book_x_min", "left"), ("book_x_max", "right")] {
        let low = |n: &u32| mesh.points[*n as usize][2] < 9e-3;
        let covers: Vec<u32> = mesh.node_sets[set].iter().copied().filter(low).collect();
        mesh.node_sets.insert(body.into(), covers);
        scene.ties.push(TieSpec { nodes: body.into(), body: body.into() });
    }
    let itself = ["book_block".to_string(), "book_block".to_string()];
    scene.contact = Some(ContactSpec { pairs: vec![itself], ..ContactSpec::new(&["book_block"]) });
    let plan = plan(&scene, &mesh);
    // The flanks stand 51 degrees from upright; each side is turned 55 degrees about the valley.
    let turn = |angle: f64| {
        let turn =
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), angle.to_radians());
        let valley = nalgebra::Vector3::new(0.0, 0.0, 4e-3);
        Pose::from_parts((valley - turn * valley).into(), turn)
    };
    let drive = ramp(&plan, &[], &[("left", turn(55.0)), ("right", turn(-55.0))], 4);
    let out = run(&plan, &drive, &Settings::default(), None, &mut |_| {});
    assert!(out.is_solved(), "{}", out.errors[0]);
    for frame in &out.frames {
        let (_, surface) = &fem::measure::collision_surfaces(&plan, frame.snapshot())[0];
        let pairs = fem::geometry::SearchSurface::new(surface.clone()).self_intersections();
        assert!(pairs.is_empty(), "at {}: {} pairs of triangles intersect", frame.time, pairs.len());
        let found = fem::measure::intersections(&plan, frame.snapshot());
        assert!(found.is_empty(), "at {}: {found:?}", frame.time);
    }
    let distance = pair_forces(&plan, out.last().expect("solved").snapshot(), [0.0; 3])[0].least_distance;
    assert!(distance > 0.0 && distance < 1.5e-4, "the flanks meet: {distance} m");
}

/// Of a block that is stiffer towards one end, contact is stiffer there, and nowhere stiffer than the softer side.
#[test]
fn a_layer_is_as_stiff_as_what_lies_behind_it() {
    let spec = ContactSpec { distance: 1e-3, ..ContactSpec::new(&["lower_block", "upper_block"]) };
    let (mut scene, mesh) = two_blocks([[4, 4, 2], [5, 5, 2]], 0.5e-3, spec);
    let force_at = |scene: &Scene, x_end: fn(f64) -> bool| -> f64 {
        let plan = plan(scene, &mesh);
        let first = mesh.points.len() - 6 * 6 * 3; // of the upper block
        let mut x = plan.reference();
        for n in first..mesh.points.len() {
            x[3 * n + 2] -= 0.3e-3;
        }
        let mut g = vec![0.0; x.len()];
        contact_of(&plan).add_gradient(&x, 0.0, &mut g);
        let middle = (0..mesh.points.len()).map(|n| x[3 * n]).sum::<f64>() / mesh.points.len() as f64;
        (first..mesh.points.len()).filter(|n| x_end(x[3 * n] - middle)).map(|n| g[3 * n + 2]).sum()
    };
    let both = |scene: &Scene| [force_at(scene, |x| x < -3e-3), force_at(scene, |x| x > 3e-3)];
    let soft = both(&scene);
    // Cells of both blocks beyond x = 0, ten times as stiff.
    let stiffen = |scene: &mut Scene, solid: usize| {
        let block = mesh.blocks.iter().find(|b| b.name == scene.solids[solid].region).unwrap();
        let middle = mesh.points.iter().map(|p| p[0]).sum::<f64>() / mesh.points.len() as f64;
        let centre = |cell: &[u32]| cell.iter().map(|&n| mesh.points[n as usize][0]).sum::<f64>() / 8.0;
        scene.solids[solid].scale =
            block.cells().map(|c| if centre(c) > middle + 1e-3 { 10.0 } else { 1.0 }).collect();
    };
    stiffen(&mut scene, 0);
    let one_side = both(&scene);
    stiffen(&mut scene, 1);
    let both_sides = both(&scene);
    println!("{soft:?}, one block {one_side:?}, both {both_sides:?} N");
    assert!(soft.iter().all(|gradient| *gradient < 0.0), "the upper block is pushed up: {soft:?}");
    assert_eq!(one_side, soft, "the softer side decides");
    assert_eq!(both_sides[0], soft[0]);
    let ratio = both_sides[1] / soft[1];
    assert!(ratio > 5.0 && ratio < 10.0 + 1e-9, "{ratio}");
}
