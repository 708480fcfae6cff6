//! Explicit dynamics: against closed solutions, what it keeps, and what mass does that is added.

#![allow(non_snake_case)]

use fem::material::line::FibreStrain;
use fem::measure::support_wrench;
use fem::mesh::{Mesh, generate};
use fem::plan::{LoadedIsland, Plan};
use fem::run::{Drive, Run, run};
use fem::scene::*;
use fem::solve::{BlockMatrix, HEAVY, Method, Motion, Potential, Reason, Settings, SolveError};
use std::f64::consts::PI;
use support::contact_scenes::{add, block_mean, moved, timed, two_blocks};
use support::fem_scenes::{held, mooney_rivlin};

const EXPLICIT: Method = Method::Explicit;

fn settings() -> Settings {
    Settings { method: EXPLICIT, ..Settings::default() }
}

fn go(plan: &Plan, drive: &Drive, settings: &Settings) -> Run {
    let out = run(plan, drive, settings, None, &mut |_| {});
    assert!(out.is_solved(), "{}", out.errors[0]);
    out
}

fn motions(out: &Run) -> Vec<Motion> {
    out.frames.iter().flat_map(|f| &f.islands).filter_map(|i| i.motion).collect()
}

/// Energies balance to 1 % in every frame; where next to nothing is in play, as at rest, beside the frame with most.
fn balances(motions: &[Motion]) {
    let most = motions.iter().map(Motion::in_play).fold(0.0, f64::max);
    assert!(most > 0.0, "nothing moves");
    for motion in motions {
        let scale = motion.in_play().max(1e-6 * most);
        assert!(motion.missing().abs() <= 0.01 * scale, "{motion:?}");
    }
}

/// x = ½ g t², v = g t: central differences are exact there.
#[test]
fn a_block_falls_as_galilei_has_it() {
    let mesh = generate::block([2; 3], [0.01; 3]);
    let g = [0.0, 1.0, -9.81];
    let velocity = VelocitySpec { region: "block".into(), velocity: [0.5, 0.0, 0.0] };
    let scene = Scene {
        solids: vec![SolidSpec::new("block", mooney_rivlin())],
        gravity: Some(GravitySpec { acceleration: g, control: "g".into() }),
        inertia: Some(InertiaSpec { velocities: vec![velocity] }),
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let (T, n) = (0.02, 5);
    // Gravity comes at once: the first frame is too short for anything to move.
    let mut drive = timed(&plan, T, n, |_| vec![("g", 1.0)]);
    let mut at_once = drive.frames[0].clone();
    at_once.time = 1e-9;
    drive.frames.insert(0, at_once);
    let out = go(&plan, &drive, &settings());
    let (last, X) = (out.last().expect("solved"), plan.reference());
    let t = T * n as f64;
    for i in 0..X.len() {
        let start = if i % 3 == 0 { 0.5 } else { 0.0 };
        let (v, u) = (start + g[i % 3] * t, start * t + 0.5 * g[i % 3] * t * t);
        assert!((last.v[i] - v).abs() < 1e-6, "velocity {} for {v} m/s", last.v[i]);
        assert!((last.x[i] - X[i] - u).abs() < 1e-7, "fallen {} for {u} m", last.x[i] - X[i]);
    }
}

/// Length \[m\] and cells of a bar without lateral strain, its modulus \[Pa\] and density \[kg/m³\].
const BAR: (f64, usize, f64, f64) = (0.1, 40, 1e5, 1060.0);

fn rod() -> (Scene, Mesh) {
    let (length, cells, young, density) = BAR;
    let mesh = generate::block([1, 1, cells], [0.01, 0.01, length]);
    let law = LawSpec::LinearElastic { young, nu: 0.0 };
    let sides = [held("x_min", [true, false, false]), held("y_min", [false, true, false])];
    let scene = Scene {
        solids: vec![SolidSpec { density, ..SolidSpec::new("block", law) }],
        prescribed: sides.into(),
        inertia: Some(InertiaSpec::default()),
        ..Scene::default()
    };
    (scene, mesh)
}

/// ω of the first mode of a bar of equal cells Δ and lumped masses held at one end is (2c/Δ) sin(πΔ/4L); central differences with the step h make
/// it (2/h) asin(ωh/2).
#[test]
fn a_bar_swings_with_its_natural_frequency() {
    let (length, cells, young, density) = BAR;
    let (mut scene, mesh) = rod();
    scene.prescribed.push(held("z_min", [true; 3]));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let (c, amplitude) = ((young / density).sqrt(), 1e-4);
    let period = 4.0 * length / c;
    let mut start = plan.reference();
    for p in start.chunks_exact_mut(3) {
        p[2] += amplitude * (PI * p[2] / (2.0 * length)).sin();
    }
    let drive = timed(&plan, period / 20.0, 60, |_| vec![]);
    let out = run(&plan, &drive, &settings(), Some(&start), &mut |_| {});
    assert!(out.is_solved(), "{}", out.errors[0]);
    let delta = length / cells as f64;
    let omega = 2.0 * c / delta * (PI * delta / (4.0 * length)).sin();
    let node = 3 * plan.mesh.node_sets["z_max"][0] as usize + 2;
    for frame in &out.frames {
        let h = frame.islands.iter().find_map(|i| i.motion).expect("it moves").time_step;
        let expected = ((2.0 / h) * (0.5 * omega * h).asin() * frame.time).cos();
        let tip = (frame.x[node] - length) / amplitude;
        assert!((tip - expected).abs() < 2e-3, "tip at {tip}, expected {expected} at {} s", frame.time);
    }
}

/// A free bar pushed at one end: the other end hears of it after L/c.
#[test]
fn a_push_travels_with_the_speed_of_sound() {
    let (length, _, young, density) = BAR;
    let (mut scene, mesh) = rod();
    scene.prescribed.push(moved("z_min", [false, false, true], [0.0, 0.0, 1e-4], "push"));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let c = (young / density).sqrt();
    let arrival = length / c;
    // Pushed on at a steady speed V: a step of velocity V runs along, and doubles where it is thrown back.
    let drive = timed(&plan, arrival / 40.0, 60, |t| vec![("push", t / arrival)]);
    let out = go(&plan, &drive, &settings());
    let node = 3 * plan.mesh.node_sets["z_max"][0] as usize + 2;
    let speed = 1e-4 / arrival;
    let heard = out.frames.iter().find(|f| f.v[node] > speed).expect("it arrives").time;
    assert!((heard / arrival - 1.0).abs() < 0.03, "heard after {heard} s, L/c = {arrival} s");
    balances(&motions(&out));
}

#[test]
fn energies_balance_and_momentum_is_kept_in_a_collision() {
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for (name, n, x) in [("left", [3; 3], 0.0), ("right", [2; 3], 0.012)] {
        let block = generate::block(n, [0.01; 3]);
        add(&mut scene, &mut mesh, name, block, [x, 0.1 * x, 0.2 * x], mooney_rivlin());
    }
    let velocity = |region: &str, velocity| VelocitySpec { region: region.into(), velocity };
    let velocities = vec![velocity("left_block", [1.0, 0.1, 0.0]), velocity("right_block", [-1.0, 0.0, 0.0])];
    scene.inertia = Some(InertiaSpec { velocities });
    scene.contact = Some(ContactSpec {
        mode: ContactMode::Cheap,
        distance: 1e-3,
        ..ContactSpec::new(&["left_block", "right_block"])
    });
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let out = go(&plan, &timed(&plan, 5e-4, 20, |_| vec![]), &settings());
    let inertia = plan.inertia.as_ref().expect("asked for");
    let momentum =
        |v: &[f64], c: usize| inertia.masses.iter().enumerate().map(|(n, m)| m * v[3 * n + c]).sum::<f64>();
    let (before, last) = (&inertia.velocities, out.last().expect("solved"));
    let scale: f64 = inertia.masses.iter().sum();
    for c in 0..3 {
        let (a, b) = (momentum(before, c), momentum(&last.v, c));
        assert!((a - b).abs() < 1e-9 * scale, "momentum {a} and then {b} kg m/s");
    }
    let back = block_mean(&plan, "left_block", &last.v)[0];
    assert!(back < 0.0, "thrown back at {back} m/s");
    balances(&motions(&out));
}

/// Two blocks pressed onto each other with the guarded mode: nothing passes through, and energies balance.
#[test]
fn guarded_contact_is_carried_in_time() {
    let contact = ContactSpec { distance: 1e-3, ..ContactSpec::new(&["lower_z_max", "upper_z_min"]) };
    let (mut scene, mesh) = two_blocks([[3, 3, 2], [2, 2, 2]], 1.2e-3, contact);
    scene.prescribed.push(moved("upper_z_max", [false, false, true], [0.0, 0.0, -3.2e-3], "press"));
    scene.inertia = Some(InertiaSpec::default());
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let drive = timed(&plan, 0.02, 10, |t| vec![("press", t / 0.2)]);
    let out = support::contact_scenes::guarded(&plan, &drive, &settings()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(out.frames.len(), 10);
    balances(&motions(&out));
}

/// A bar of tissue that passes into a tendon a hundred times as stiff, with fibres that contract, as a muscle has it.
fn muscle() -> (Scene, Mesh) {
    let mut mesh = generate::block([10, 2, 2], [0.1, 0.01, 0.01]);
    generate::add_fibres(&mut mesh, "lines", [10, 2, 2], &[[0, 0], [1, 1], [2, 2], [0, 2]]);
    let cells = mesh.blocks[0].n_cells();
    // Cells of the last tenth along x.
    let top = |c: usize| {
        mesh.blocks[0].cells().nth(c).expect("a cell").iter().all(|&n| mesh.points[n as usize][0] > 0.089)
    };
    let scale = (0..cells).map(|c| if top(c) { 100.0 } else { 1.0 }).collect();
    let mut scene = Scene {
        solids: vec![SolidSpec { scale, ..SolidSpec::new("block", mooney_rivlin()) }],
        prescribed: vec![held("x_min", [true; 3]), held("x_max", [true; 3])],
        inertia: Some(InertiaSpec::default()),
        ..Scene::default()
    };
    scene.fibres.push(FibreSpec {
        name: "fibres".into(),
        course: Course::Region("lines".into()),
        law: FibreLawSpec::Thermal {
            young: 1e5,
            contraction: 0.1,
            strain: FibreStrain::Logarithmic,
            toe: Some(0.01),
        },
        area: vec![5e-6],
        activation: Some("a".into()),
    });
    (scene, mesh)
}

/// Force at the far end, which goes aside while the fibres contract, after a ramp of 0.1 s and a damped hold of 0.4 s, with time steps `factor` times
/// as long as the masses bear.
fn settled(factor: f64) -> (f64, Motion) {
    let (mut scene, mesh) = muscle();
    let end = &mut scene.prescribed[1];
    (end.displacement, end.control) = (vec![[0.0, 0.0, 0.02]], Some("a".into()));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let drive = timed(&plan, 0.1, 5, |_| vec![("a", 1.0)]);
    let settings = Settings { time_step_factor: factor, damping: 60.0, max_steps: 10_000_000, ..settings() };
    let out = go(&plan, &drive, &settings);
    let motions = motions(&out);
    balances(&motions);
    let last = out.last().expect("solved");
    let force = support_wrench(&plan, last.snapshot(), &plan.mesh.node_sets["x_max"], [0.0; 3]).force;
    (force.iter().map(|f| f * f).sum::<f64>().sqrt(), motions[0])
}

#[test]
fn ten_times_the_time_step_changes_settled_forces_little_and_a_hundred_times_is_warned_of() {
    let (plain, motion) = settled(1.0);
    assert_eq!((motion.added_mass, motion.warning()), (0.0, None));
    let (ten, motion) = settled(10.0);
    println!("x1 {plain} N, x10 {ten} N, {:.3} of the mass added", motion.added());
    assert!(motion.added_mass > 0.0 && motion.time_step > 5.0 * motion.natural_step, "{motion:?}");
    assert!((ten / plain - 1.0).abs() < 0.02, "{plain} N and {ten} N");
    let (hundred, motion) = settled(100.0);
    println!("x100 {hundred} N, {:.3} of the mass added", motion.added());
    assert!(motion.added_kinetic > HEAVY * motion.largest_kinetic, "{motion:?}");
    let warning = motion.warning().expect("heavy");
    assert!(warning.contains("time_step_factor"), "{warning}");
}

/// A bar whose fibres pull with `stress(λ)` \[Pa\] at a stretch of λ is drawn by a fifth within `time` \[s\], with time steps ten times as long as it bears.
fn drawn(time: f64, stress: impl Fn(f64) -> f64) -> Run {
    let (mut scene, mesh) = muscle();
    let stretch = [0.5, 1.0, 1.05, 1.08, 1.1, 1.15, 1.2, 1.5];
    scene.fibres[0].law = FibreLawSpec::ForceLength {
        stretch: stretch.to_vec(),
        activation: vec![0.0],
        stress: vec![stretch.map(stress).to_vec()],
    };
    scene.fibres[0].activation = None;
    let end = &mut scene.prescribed[1];
    (end.displacement, end.control) = (vec![[0.02, 0.0, 0.0]], Some("a".into()));
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let settings = Settings { time_step_factor: 10.0, damping: 60.0, ..settings() };
    run(&plan, &timed(&plan, time, 1, |_| vec![("a", 1.0)]), &settings, None, &mut |_| {})
}

#[test]
fn added_mass_keeps_up_with_what_gets_stiffer() {
    let out = drawn(0.2, |l| 2e7 * (l - 1.0).max(0.0).powi(2));
    let motions = motions(&out);
    println!("{motions:?} {:?}", out.errors);
    assert!(out.is_solved() && motions[0].added_mass > 0.0);
    balances(&motions);
}

/// Fibres that are slack up to a stretch of 1.08, and a hundred times as stiff as the tissue beyond: masses cannot keep up with that, so that steps are
/// taken back.
#[test]
fn what_is_slack_and_then_taut_at_once_is_carried_through() {
    let [one, two] = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| drawn(0.05, |l| 1e8 * (l - 1.08).max(0.0)))
    });
    let motions = motions(&one);
    println!("{motions:?} {:?}", one.errors);
    assert!(one.is_solved() && motions[0].repeated > 0);
    balances(&motions);
    let bits = |run: &Run| run.frames[0].x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert!(bits(&one) == bits(&two), "on one and on two threads");
}

/// Nodes are measured by what pulls at them where it is taut: strands that are slack add as much to their blocks as stiff ones, and nothing to the stiffness.
#[test]
fn what_is_slack_weighs_as_if_it_were_taut() {
    let (length, stiffness) = (0.1, 40.0);
    let blocks_and_stiffness = |has_strands: bool| {
        let (mut scene, mesh) = muscle();
        scene.fibres.clear();
        if has_strands {
            let strand = StrandSpec { region: "lines".into(), stiffness, toe: 0.03, reference_strain: -0.05 };
            scene.strands.push(strand);
        }
        let plan = Plan::new(&scene, mesh).expect("a scene");
        let island = plan.islands[0].clone();
        let x = island.free_positions(&island.gather(&plan.reference()));
        let load = timed(&plan, 1.0, 1, |_| vec![]).frames[0].load.clone();
        let potential = LoadedIsland::new(island, load.clone(), load);
        let mut blocks = vec![0.0; 3 * x.len()];
        potential.diagonal_blocks(&x, &mut blocks);
        let mut k = BlockMatrix::zeros(potential.pattern().clone());
        potential.hessian(&x, 1.0, &mut k);
        let diagonal: Vec<f64> = (0..x.len() / 3).flat_map(|n| *k.diagonal_block(n)).collect();
        (blocks, diagonal)
    };
    let [(with, k_with), (without, k_without)] = [true, false].map(blocks_and_stiffness);
    assert_eq!(k_with, k_without, "what is slack resists nothing");
    let more: Vec<f64> = with.iter().zip(&without).map(|(a, b)| a - b).collect();
    let scale = with.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    // Four lines of ten segments, whose 36 inner ends between two of them are free.
    let segment = stiffness / (0.95f64.recip() * length / 10.0);
    let (along, other): (Vec<_>, Vec<_>) = more.iter().enumerate().partition(|(i, _)| i % 9 == 0);
    let sum: f64 = along.iter().map(|(_, v)| **v).sum();
    assert!((sum / (36.0 * 2.0 * segment) - 1.0).abs() < 1e-9, "{sum} N/m in all");
    assert!(other.iter().all(|(_, v)| v.abs() < 1e-12 * scale), "along the bar alone");
}

/// Where nothing can keep up, what blows up ends in words.
#[test]
fn a_motion_that_blows_up_ends_in_words() {
    match &drawn(1e-3, |l| 2e7 * (l - 1.0).max(0.0).powi(2)).errors[..] {
        [SolveError::NotConverged(stop)] => {
            println!("{stop:?}");
            assert!(matches!(stop.reason, Reason::BlowsUp | Reason::Inverted | Reason::Imbalance { .. }));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn rest_without_inertia_is_refused_in_words() {
    let (mut scene, mesh) = muscle();
    scene.inertia = None;
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let out = run(&plan, &timed(&plan, 0.1, 1, |_| vec![("a", 1.0)]), &settings(), None, &mut |_| {});
    match &out.errors[..] {
        [SolveError::Settings { mistakes }] => assert!(mistakes[0].contains("no `inertia`"), "{mistakes:?}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_frame_that_takes_too_many_steps_is_refused_in_words() {
    let (scene, mesh) = muscle();
    let plan = Plan::new(&scene, mesh).expect("a scene");
    let settings = Settings { max_steps: 10, ..settings() };
    let out = run(&plan, &timed(&plan, 0.1, 1, |_| vec![("a", 1.0)]), &settings, None, &mut |_| {});
    match &out.errors[..] {
        [SolveError::NotConverged(stop)] => assert_eq!(stop.reason, Reason::NotSettled { steps: 10 }),
        other => panic!("{other:?}"),
    }
}
