//! Inertia: against closed solutions, conservation, order, and what the frame loop makes of it.

#![allow(non_snake_case)]

use fem::measure::{Snapshot, kinetic_energy};
use fem::mesh::{Mesh, generate};
use fem::output::{Restart, run_restartable};
use fem::parts::Beside;
use fem::plan::{LoadedIsland, Plan};
use fem::run::{Drive, Run, run};
use fem::scene::{ContactSpec, GravitySpec, InertiaSpec, LawSpec, PlaneSpec, Scene, SolidSpec, VelocitySpec};
use fem::solve::{BlockMatrix, Loading, Potential, Settings};
use std::f64::consts::PI;
use support::Random;
use support::contact_scenes::{add, block_mean, guarded, timed, total_energy};
use support::fem_scenes::{held, mooney_rivlin, plan, tolerance};
use support::taylor_order;

/// Frames `h` \[s\] apart, all controls at 1.
fn steps(plan: &Plan, h: f64, n: usize) -> Drive {
    timed(plan, h, n, |_| plan.controls.iter().map(|c| (c.as_str(), 1.0)).collect())
}

fn solved(plan: &Plan, drive: &Drive, tolerance_: f64) -> Run {
    let out = run(plan, drive, &tolerance(tolerance_), None, &mut |_| {});
    assert!(out.is_solved(), "{}", out.errors[0]);
    out
}

fn moving(region: &str, velocity: [f64; 3]) -> InertiaSpec {
    InertiaSpec { velocities: vec![VelocitySpec { region: region.into(), velocity }] }
}

/// Momentum \[kg m/s\] of all nodes at the velocities `v`.
fn momentum(plan: &Plan, v: &[f64]) -> [f64; 3] {
    let masses = &plan.inertia.as_ref().expect("asked for").masses;
    std::array::from_fn(|c| masses.iter().enumerate().map(|(n, m)| m * v[3 * n + c]).sum())
}

#[test]
fn masses_are_positive_and_sum_to_density_times_volume() {
    let size = [0.01, 0.02, 0.03];
    let block = generate::block([2, 3, 4], size);
    let meshes = [
        ("hex8", block.clone()),
        ("tet4", generate::tetrahedra(&block, false)),
        ("tet10", generate::tetrahedra(&block, true)),
        ("wedge6", generate::wedges(&block)),
    ];
    for (kind, mut mesh) in meshes {
        generate::distort(&mut mesh, 0.1, 3);
        let region = mesh.blocks[0].name.clone();
        let solid = SolidSpec { density: 1200.0, ..SolidSpec::new(&region, mooney_rivlin()) };
        let scene = Scene { solids: vec![solid], inertia: Some(InertiaSpec::default()), ..Scene::default() };
        let plan = plan(&scene, &mesh);
        let masses = &plan.inertia.as_ref().expect("asked for").masses;
        let volume = fem::measure::volume(
            &plan,
            Snapshot { x: &plan.reference(), load: &plan.load(&[], &[]).expect("nothing") },
            &region,
        );
        let expected = 1200.0 * volume.expect("a solid").0;
        let total: f64 = masses.iter().sum();
        assert!(
            masses.iter().all(|m| *m > 0.0),
            "{kind}: least mass {:?}",
            masses.iter().copied().reduce(f64::min)
        );
        assert!((total / expected - 1.0).abs() < 1e-12, "{kind}: {total} kg of {expected} kg");
    }
}

#[test]
fn a_block_falls_as_backward_euler_has_it() {
    falls(mooney_rivlin(), 1.0, 1e-9);
}

/// Its mass resists by a hundred-millionth of its stiffness, and that is support enough.
#[test]
fn a_stiff_block_falls_no_differently() {
    // Round-off of the positions times this stiffness is 1e-8 of the forces in play.
    falls(LawSpec::NeoHookean { young: 1e9, nu: 0.3 }, 100.0, 1e-7);
}

/// A block that flies and falls, to 1e-9 m and 1e-7 m/s times `rough`, with this tolerance of the residual.
fn falls(law: LawSpec, rough: f64, tolerance: f64) {
    let mesh = generate::block([2; 3], [0.01; 3]);
    let g = [0.0, 1.0, -9.81];
    let scene = Scene {
        solids: vec![SolidSpec::new("block", law)],
        gravity: Some(GravitySpec { acceleration: g, control: "g".into() }),
        inertia: Some(moving("block", [0.5, 0.0, 0.0])),
        ..Scene::default()
    };
    let plan = plan(&scene, &mesh);
    let (h, n) = (0.02, 10);
    // The first frame carries gravity from 0 to 1; what counts is its value at the end.
    let out = solved(&plan, &steps(&plan, h, n), tolerance);
    let (last, X) = (out.last().expect("solved"), plan.reference());
    for i in 0..X.len() {
        let a = g[i % 3];
        let start = if i % 3 == 0 { 0.5 } else { 0.0 };
        let (v, u) =
            (start + a * h * n as f64, start * h * n as f64 + a * h * h * (n * (n + 1)) as f64 / 2.0);
        assert!((last.v[i] - v).abs() < rough * 1e-7, "velocity {} for {v} m/s", last.v[i]);
        assert!((last.x[i] - X[i] - u).abs() < rough * 1e-9, "fallen {} for {u} m", last.x[i] - X[i]);
    }
}

/// Amplitude \[m\] of its swing, far above the round-off of its positions; the law is linear.
const AMPLITUDE: f64 = 1e-4;
/// Length \[m\] and cells along a bar without lateral strain, held at one end.
const BAR: (f64, usize) = (0.1, 40);

/// The tip of the bar over `n` steps of `h` periods, let go from its first mode u = A sin(πz/2L); with it what backward Euler makes
/// of that mode, (uₙ₊₁ − 2uₙ + uₙ₋₁)/h² = −ω² uₙ₊₁, where equal cells of length Δ and lumped masses give ω = (2c/Δ) sin(πΔ/4L).
fn swing(h: f64, n: usize) -> (Vec<f64>, Vec<f64>) {
    let ((length, cells), young, density) = (BAR, 1e5, 1060.0_f64);
    let mesh = generate::block([1, 1, cells], [0.01, 0.01, length]);
    let rollers =
        [held("z_min", [true; 3]), held("x_min", [true, false, false]), held("y_min", [false, true, false])];
    let scene = Scene {
        solids: vec![SolidSpec::new("block", LawSpec::LinearElastic { young, nu: 0.0 })],
        prescribed: rollers.into(),
        inertia: Some(InertiaSpec::default()),
        ..Scene::default()
    };
    let plan = plan(&scene, &mesh);
    let c = (young / density).sqrt();
    let h = h * 4.0 * length / c;
    let mut start = plan.reference();
    for p in start.chunks_exact_mut(3) {
        p[2] += AMPLITUDE * (PI * p[2] / (2.0 * length)).sin();
    }
    let out = run(&plan, &steps(&plan, h, n), &tolerance(1e-8), Some(&start), &mut |_| {});
    assert!(out.is_solved(), "{}", out.errors[0]);
    let node = 3 * plan.mesh.node_sets["z_max"][0] as usize + 2;
    let tip = out.frames.iter().map(|f| (f.x[node] - length) / AMPLITUDE).collect();
    let delta = length / cells as f64;
    let turn = h * 2.0 * c / delta * (PI * delta / (4.0 * length)).sin();
    let (mut before, mut now) = (1.0, 1.0);
    let mut expected = Vec::new();
    for _ in 0..n {
        (before, now) = (now, (2.0 * now - before) / (1.0 + turn * turn));
        expected.push(now);
    }
    (tip, expected)
}

#[test]
fn a_bar_swings_as_backward_euler_has_it() {
    let (tip, expected) = swing(1.0 / 40.0, 40);
    for (u, e) in tip.iter().zip(&expected) {
        assert!((u - e).abs() < 1e-6, "tip at {u}, expected {e}");
    }
    let (fine, _) = swing(1.0 / 1000.0, 500);
    let half = fine.last().expect("500 steps");
    assert!((half + 1.0).abs() < 0.02, "half a period later on the other side: {half}");
}

#[test]
fn the_error_falls_with_the_first_power_of_the_step() {
    let error = |n: usize| {
        let (tip, _) = swing(0.2 / n as f64, n);
        (tip[n - 1] - (0.4 * PI).cos()).abs()
    };
    let order = (error(80) / error(160)).log2();
    assert!((order - 1.0).abs() < 0.1, "order {order}");
}

/// Two blocks that fly towards each other and a little askew.
fn collision() -> (Scene, Mesh) {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for (name, n, x) in [("left", [3; 3], 0.0), ("right", [2; 3], 0.012)] {
        add(
            &mut scene,
            &mut mesh,
            name,
            generate::block(n, [0.01; 3]),
            [x, 0.1 * x, 0.2 * x],
            mooney_rivlin(),
        );
    }
    scene.inertia = Some(InertiaSpec {
        velocities: vec![
            VelocitySpec { region: "left_block".into(), velocity: [2.0, 0.1, 0.0] },
            VelocitySpec { region: "right_block".into(), velocity: [-1.0, 0.0, 0.0] },
        ],
    });
    scene.contact = Some(ContactSpec::new(&["left_block", "right_block"]));
    (scene, mesh)
}

#[test]
fn a_collision_keeps_momentum_and_makes_no_energy() {
    let (scene, mesh) = collision();
    let plan = plan(&scene, &mesh);
    let out = guarded(&plan, &steps(&plan, 5e-4, 40), &tolerance(1e-8)).unwrap_or_else(|e| panic!("{e}"));
    let at_start = &plan.inertia.as_ref().expect("asked for").velocities;
    let first = momentum(&plan, at_start);
    let mut before = kinetic_energy(&plan, at_start);
    let all = before;
    let mut least = f64::MAX;
    for frame in &out.frames {
        let now = momentum(&plan, &frame.v);
        for c in 0..3 {
            assert!((now[c] - first[c]).abs() < 1e-6 * first[0], "momentum {now:?} for {first:?} kg m/s");
        }
        least = least.min(kinetic_energy(&plan, &frame.v));
        let total = total_energy(&plan, frame);
        assert!(total <= before * (1.0 + 1e-9), "energy {total} after {before} J at {} s", frame.time);
        before = total;
    }
    assert!(least < 0.3 * all, "they met: {least} of {all} J");
    let speed = |region: &str| block_mean(&plan, region, &out.last().expect("solved").v)[0];
    assert!(speed("left_block") < speed("right_block"), "they part");
}

#[test]
fn inertia_is_the_derivative_of_its_energy() {
    let mesh = generate::block([3, 2, 2], [0.03, 0.02, 0.02]);
    let mut scene = Scene {
        solids: vec![SolidSpec::new("block", mooney_rivlin())],
        prescribed: vec![held("y_min", [false, true, false])],
        planes: vec![PlaneSpec { nodes: "x_max".into(), axis: 0.into() }],
        inertia: Some(moving("block", [1.0, 2.0, 3.0])),
        ..Scene::default()
    };
    scene.solids[0].density = 1e5;
    let plan = plan(&scene, &mesh);
    let island = plan.islands[0].clone();
    let load = plan.load(&[], &[]).expect("nothing");
    let inertia = plan.inertia.as_ref().expect("asked for");
    let masses: Vec<f64> = island.nodes.iter().map(|&n| inertia.masses[n as usize]).collect();
    let over = |h: f64| {
        let v = island.gather(&inertia.velocities);
        let mut loaded = LoadedIsland::new(island.clone(), load.clone(), load.clone());
        loaded = loaded.with(inertia.over(h, &island, &island.X, &v));
        let mut x = island.free_positions(&island.X);
        loaded.set_load(1.0, &mut x);
        (loaded, x)
    };
    let (potential, at_rest) = over(1e-3);
    let mut random = Random::new(12);
    let fixed = potential.fixed().to_vec();
    let free = |random: &mut Random| -> Vec<f64> {
        fixed.iter().map(|&f| if f { 0.0 } else { random.uniform() }).collect()
    };
    let x: Vec<f64> = at_rest.iter().zip(free(&mut random)).map(|(x, d)| x + 5e-4 * d).collect();
    let gradient = |potential: &LoadedIsland, x: &[f64]| {
        let mut g = vec![0.0; x.len()];
        potential.gradient(x, &mut g);
        g
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut k = BlockMatrix::zeros(potential.pattern().clone());
    potential.hessian(&x, 0.0, &mut k);
    let (mut worst_g, mut worst_K) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..5 {
        let (dx, dy) = (free(&mut random), free(&mut random));
        let at = |h: f64| -> Vec<f64> { x.iter().zip(&dx).map(|(x, d)| x + 1e-3 * h * d).collect() };
        let g = dot(&gradient(&potential, &x), &dx) * 1e-3;
        worst_g = worst_g.min(taylor_order(|h| potential.energy(&at(h)), g, 1e-2));
        let mut kx = vec![0.0; x.len()];
        k.multiply(&dx, &mut kx);
        let kx = 1e-3 * dot(&kx, &dy);
        worst_K = worst_K.min(taylor_order(|h| dot(&gradient(&potential, &at(h)), &dy), kx, 1e-2));
        // A step a tenth as long: a hundred times the stiffness, and the solid's fraction is as it was.
        let (shorter, _) = over(1e-4);
        let mut k_short = BlockMatrix::zeros(shorter.pattern().clone());
        shorter.hessian(&x, 0.0, &mut k_short);
        let masses: f64 = masses.iter().sum();
        // Along z all nodes are free, along x some follow one, which then bears their mass.
        for axis in [0, 2] {
            let shift: Vec<f64> =
                fixed.iter().enumerate().map(|(i, &f)| if i % 3 == axis && !f { 1.0 } else { 0.0 }).collect();
            let rigid = |k: &BlockMatrix| {
                let mut kx = vec![0.0; shift.len()];
                k.multiply(&shift, &mut kx);
                dot(&kx, &shift)
            };
            let added = rigid(&k_short) - rigid(&k);
            let expected = masses * (1e8 - 1e6);
            assert!((added / expected - 1.0).abs() < 1e-9, "axis {axis}: {added} for {expected} N/m");
        }
    }
    assert!(worst_g > 1.9 && worst_K > 1.9, "orders {worst_g:.2} and {worst_K:.2}");
}

#[test]
fn a_drive_that_stands_still_in_time_is_refused() {
    let (scene, mesh) = collision();
    let plan = plan(&scene, &mesh);
    let mut drive = steps(&plan, 1e-4, 2);
    drive.frames[1].time = drive.frames[0].time;
    let out = run(&plan, &drive, &Settings::default(), None, &mut |_| {});
    let error = out.errors.first().expect("refused").to_string();
    assert!(error.contains("no time passes") && error.contains("step 1"), "{error}");
    assert_eq!(out.frames.len(), 1);
}

#[test]
fn a_name_that_is_no_solid_is_refused() {
    let (mut scene, mesh) = collision();
    scene.inertia.as_mut().expect("there").velocities[0].region = "left".into();
    let error = Plan::new(&scene, mesh).err().expect("refused").to_string();
    assert!(error.contains("`left`") && error.contains("left_block"), "{error}");
}

#[test]
fn a_resumed_flight_has_the_same_bits() {
    let (scene, mesh) = collision();
    let plan = plan(&scene, &mesh);
    let drive = steps(&plan, 5e-4, 8);
    let settings = Settings::default();
    let whole = |frames: usize, resume: bool, folder: &std::path::Path| {
        let drive = Drive { frames: drive.frames[..frames].to_vec() };
        let restart = Restart { key: "a key", resume };
        run_restartable(
            &plan,
            &drive,
            &settings,
            folder,
            "flight",
            &Beside::default(),
            restart,
            None,
            &mut |_| {},
        )
        .expect("files are written")
    };
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let uninterrupted = whole(8, false, a.path());
    whole(5, false, b.path());
    let resumed = whole(8, true, b.path());
    assert_eq!(resumed.taken_over, 5);
    let bits = |run: &Run| -> Vec<u64> {
        let last = run.last().expect("solved");
        last.x.iter().chain(&last.v).map(|v| v.to_bits()).collect()
    };
    assert_eq!(bits(&uninterrupted), bits(&resumed));
}
