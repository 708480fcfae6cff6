//! Small scenes with contact, shared by its tests, and the independent look at their states.

use super::Random;
use super::fem_scenes::{held, mooney_rivlin};
use fem::body::Pose;
use fem::geometry::SearchSurface;
use fem::measure::{Snapshot, collision_surfaces, contact_energy, energies, kinetic_energy};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame, Frame, Run, run};
use fem::scene::{ContactSpec, LawSpec, PrescribedSpec, Scene, SolidSpec, TieSpec};
use fem::solve::Settings;

/// Pairs of contact surfaces whose triangles have a point in common, by an exact test that shares nothing with contact,
/// apart from pairs in `apart_from`.
pub fn intersections(plan: &Plan, at: Snapshot, apart_from: &[[&str; 2]]) -> Vec<String> {
    let surfaces: Vec<(String, SearchSurface)> =
        collision_surfaces(plan, at).into_iter().map(|(n, s)| (n, SearchSurface::new(s))).collect();
    let mut found = Vec::new();
    for (i, (a, sa)) in surfaces.iter().enumerate() {
        for (b, sb) in &surfaces[..i] {
            if apart_from.iter().any(|[p, q]| (p == a && q == b) || (p == b && q == a)) {
                continue;
            }
            let n = sa.intersections(sb).len();
            if n > 0 {
                found.push(format!("`{a}` and `{b}`: {n} pairs of triangles"));
            }
        }
    }
    found
}

/// Adds a mesh as `name`, moved by `shift` \[m\], with its block as a solid of muscle matrix.
pub fn add(scene: &mut Scene, mesh: &mut Mesh, name: &str, mut part: Mesh, shift: [f64; 3], law: LawSpec) {
    part.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += shift[c]));
    scene.solids.push(SolidSpec::new(&format!("{name}_{}", part.blocks[0].name), law));
    generate::append(mesh, part, name);
}

/// Displaces a set by `u` \[m\] at unit value of `control`, the components that are flagged.
pub fn moved(nodes: &str, components: [bool; 3], u: [f64; 3], control: &str) -> PrescribedSpec {
    let (nodes, control) = (nodes.to_string(), Some(control.to_string()));
    PrescribedSpec { nodes, components, displacement: vec![u], control }
}

/// Two blocks 20 × 20 × 10 mm of muscle matrix on each other, `gap` \[m\] apart, with `n` cells: symmetry rollers on two sides,
/// the bottom on a roller. Surfaces `lower_z_max` and `upper_z_min`.
pub fn two_blocks(n: [[usize; 3]; 2], gap: f64, contact: ContactSpec) -> (Scene, Mesh) {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let size = [0.02, 0.02, 0.01];
    for (name, n, z) in [("lower", n[0], 0.0), ("upper", n[1], size[2] + gap)] {
        add(&mut scene, &mut mesh, name, generate::block(n, size), [0.0, 0.0, z], mooney_rivlin());
        scene.prescribed.push(held(&format!("{name}_x_min"), [true, false, false]));
        scene.prescribed.push(held(&format!("{name}_y_min"), [false, true, false]));
    }
    scene.prescribed.push(held("lower_z_min", [false, false, true]));
    scene.contact = Some(contact);
    (scene, mesh)
}

/// A drive to one load in `steps` equal frames.
pub fn ramp(plan: &Plan, controls: &[(&str, f64)], poses: &[(&str, Pose)], steps: usize) -> Drive {
    let end = plan.load(controls, poses).unwrap_or_else(|e| panic!("{e}"));
    let start = plan.load(&[], &[]).unwrap_or_else(|e| panic!("{e}"));
    let pivots = vec![[0.0; 3]; plan.bodies.len()];
    let frame = |i: usize| {
        let t = i as f64 / steps as f64;
        DriveFrame { time: t, load: start.towards(&end, &pivots, t) }
    };
    Drive { frames: (1..=steps).map(frame).collect() }
}

/// A drive of `n` frames `h` \[s\] apart, under the controls that each time has.
pub fn timed<'c>(plan: &Plan, h: f64, n: usize, controls: impl Fn(f64) -> Vec<(&'c str, f64)>) -> Drive {
    let frame = |i: usize| {
        let time = h * i as f64;
        DriveFrame { time, load: plan.load(&controls(time), &[]).unwrap_or_else(|e| panic!("{e}")) }
    };
    Drive { frames: (1..=n).map(frame).collect() }
}

/// Mean over the corners of the cells of a block of what all nodes have, 3 values per node.
pub fn block_mean(plan: &Plan, block: &str, values: &[f64]) -> [f64; 3] {
    let nodes = &plan.mesh.blocks.iter().find(|b| b.name == block).expect("a block of the mesh").nodes;
    let sum = |c: usize| nodes.iter().map(|&n| values[3 * n as usize + c]).sum::<f64>();
    std::array::from_fn(|c| sum(c) / nodes.len() as f64)
}

/// Kinetic energy, that of all effects (loads too) and that of contact \[J\].
pub fn total_energy(plan: &Plan, frame: &Frame) -> f64 {
    let at = frame.snapshot();
    let stored: f64 = energies(plan, at).iter().map(|e| e.energy).sum();
    kinetic_energy(plan, &frame.v) + stored + contact_energy(plan, at)
}

/// Runs and looks at every frame: solved, no intersection, no inverted element. The error says what is wrong.
pub fn guarded(plan: &Plan, drive: &Drive, settings: &Settings) -> Result<Run, String> {
    let out = run(plan, drive, settings, None, &mut |_| {});
    for frame in out.frames.iter().chain(&out.unsolved) {
        let bad = intersections(plan, frame.snapshot(), &[]);
        if !bad.is_empty() {
            return Err(format!("at time {}: {}", frame.time, bad.join("; ")));
        }
        if let Some(island) = frame
            .islands
            .iter()
            .find(|i| i.load_steps > 0 && (i.least_det_f.is_nan() || i.least_det_f <= 0.0))
        {
            return Err(format!("at time {}: det F = {}", frame.time, island.least_det_f));
        }
    }
    match out.errors.first() {
        Some(error) => Err(error.to_string()),
        None => Ok(out),
    }
}

/// Body of a random small scene: a block or cylinder.
fn random_part(random: &mut Random) -> Mesh {
    let size = |random: &mut Random| 0.01 + 0.005 * random.uniform();
    let mut mesh = match random.bits() % 3 {
        0 => generate::cylinder(size(random), 2.0 * size(random), 2, 1, 3),
        _ => {
            let n = std::array::from_fn(|_| 2 + (random.bits() % 3) as usize);
            let size = std::array::from_fn(|_| 2.0 * size(random));
            generate::block(n, size)
        }
    };
    let axis = random.vector(1.0).normalize() * (std::f64::consts::PI * random.uniform());
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(axis);
    let n = mesh.points.len() as f64;
    let centre = mesh.points.iter().map(|p| nalgebra::Vector3::from(*p)).sum::<nalgebra::Vector3<f64>>() / n;
    mesh.points.iter_mut().for_each(|p| *p = (turn * (nalgebra::Vector3::from(*p) - centre)).into());
    mesh
}

/// A scene of 2 to 4 bodies of random shape and stuff, turned at random, side by side with random gaps; one face of each is
/// tied to a body that moves towards the others and sideways and turns.
pub fn random_scene(seed: u64) -> (Scene, Mesh, Vec<(String, Pose)>) {
    let mut random = Random::new(seed);
    let (mut scene, mut mesh, mut poses) = (Scene::default(), Mesh::default(), Vec::new());
    let count = 2 + (random.bits() % 3) as usize;
    let mut names = Vec::new();
    let mut x = 0.0;
    for i in 0..count {
        let part = random_part(&mut random);
        let (lo, hi) =
            part.points.iter().fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p[0]), hi.max(p[0])));
        // Side by side along x: boxes do not overlap.
        x += -lo + 1e-4 + 5e-4 * (1.0 + random.uniform());
        let shift = [x, 2e-3 * random.uniform(), 2e-3 * random.uniform()];
        x += hi;
        let name = format!("part{i}");
        let law = match random.bits() % 3 {
            0 => mooney_rivlin(),
            1 => LawSpec::NeoHookean { young: 20e3 * 10f64.powf(random.uniform()), nu: 0.3 },
            _ => LawSpec::NeoHookeanUncoupled { mu: 10e3, bulk: 200e3 },
        };
        let block = part.blocks[0].name.clone();
        let sets: Vec<String> = part.node_sets.keys().filter(|k| *k != "side").cloned().collect();
        add(&mut scene, &mut mesh, &name, part, shift, law);
        // Held by the face that looks away from the others: prescribed faces must not be driven into each other.
        let away = if i == 0 {
            [-1.0, 0.0]
        } else if i + 1 == count {
            [1.0, 0.0]
        } else {
            [0.0, 1.0]
        };
        let along = |set: &&String| {
            let nodes = &mesh.node_sets[&format!("{name}_{set}")];
            let sum = |c: usize| nodes.iter().map(|&n| mesh.points[n as usize][c]).sum::<f64>();
            (away[0] * sum(0) + away[1] * sum(2)) / nodes.len() as f64
        };
        let set = sets.iter().max_by(|a, b| along(a).total_cmp(&along(b))).expect("every part has flat ends");
        scene.ties.push(TieSpec { nodes: format!("{name}_{set}"), body: name.clone() });
        names.push(format!("{name}_{block}"));
        // Towards the middle of the row by up to 6 mm, sideways by up to 4 mm, turned by up to 20 degrees.
        let towards = if i == 0 {
            1.0
        } else if i + 1 == count {
            -1.0
        } else {
            random.uniform()
        };
        let way =
            [towards * 3e-3 * (1.0 + random.uniform()), 4e-3 * random.uniform(), 4e-3 * random.uniform()];
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(random.vector(0.2));
        let about = nalgebra::Vector3::from(shift);
        let translation = nalgebra::Vector3::from(way) + about - turn * about;
        poses.push((name, Pose::from_parts(translation.into(), turn)));
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let distance = [0.1e-3, 0.3e-3, 1e-3][(random.bits() % 3) as usize];
    scene.contact = Some(ContactSpec { distance, ..ContactSpec::new(&names) });
    (scene, mesh, poses)
}
