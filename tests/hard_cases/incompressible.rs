//! Hard cases of nearly incompressible tissue: locking (E9) and extreme compression (E11).

use super::equilibrium::{check, force, go, held, moved, solid, solved, tissue};
use crate::{Case, Outcome, Tier};
use fem::body::Pose;
use fem::measure::{body_wrenches, support_wrench, volume};
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame, Run, run};
use fem::scene::{
    ContactSpec, ForceSpec, FormulationSpec, LawSpec, PrescribedSpec, Scene, SolidSpec, TieSpec,
};
use fem::solve::{Settings, Stability};

pub const CASES: &[Case] = &[
    Case { id: "E9", title: "volumetric locking, Cook's membrane", tier: Tier::Full, run: cooks_membrane },
    Case { id: "E9", title: "volumetric locking, indentation", tier: Tier::Full, run: indentation },
    Case { id: "E11", title: "to a tenth between bonded plates, contact", tier: Tier::Full, run: to_a_tenth },
    Case {
        id: "E11",
        title: "smooth plates without contact, as far as one equilibrium",
        tier: Tier::Full,
        run: smooth_plates,
    },
    Case {
        id: "E11",
        title: "bonded plates without contact, as far as one equilibrium",
        tier: Tier::Full,
        run: bonded_plates,
    },
];

/// Tip of Cook's membrane in plane strain against a fine quadratic mesh.
fn cooks_membrane() -> Outcome {
    let tip = |mesh: Mesh, formulation: FormulationSpec, nu: f64| {
        let far = |p: &[f64; 3]| p[0] + p[1];
        let points = mesh.points.clone();
        let corner =
            (0..points.len()).max_by(|&a, &b| far(&points[a]).total_cmp(&far(&points[b]))).expect("nodes");
        let mu = 80.1938e6;
        let bulk = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
        let name = mesh.blocks[0].name.clone();
        let law = LawSpec::NeoHookeanUncoupled { mu, bulk };
        let spec = SolidSpec { formulation: Some(formulation), ..solid(&name, law) };
        let edge = &mesh.node_sets["x_max"];
        let force = [0.0, 20.0 / edge.len() as f64, 0.0]; // 20 N: moderate bending on every mesh
        let loads = edge.iter().map(|&n| (n, force)).collect();
        let flat = |set: &str| PrescribedSpec { components: [false, false, true], ..held(set) };
        let all: Vec<u32> = (0..mesh.points.len() as u32).collect();
        let mut mesh = mesh;
        mesh.node_sets.insert("all".into(), all);
        let scene = Scene {
            solids: vec![spec],
            forces: vec![ForceSpec { name: "edge".into(), loads, control: "load".into() }],
            prescribed: vec![held("x_min"), flat("all")],
            ..Scene::default()
        };
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let run = go(&plan, 1, &Settings::default());
        solved(&format!("nu {nu}"), &run)?;
        let frame = run.last().expect("solved");
        let (now, before) = volume(&plan, frame.snapshot(), &name).expect("the region exists");
        Ok::<_, String>((frame.x[3 * corner + 1] - points[corner][1], (now / before - 1.0).abs()))
    };
    use FormulationSpec::{MeanDilatation, Plain};
    let mut text = Vec::new();
    let mut good = true;
    for nu in [0.3, 0.45, 0.49, 0.499, 0.4999] {
        let (fine, _) = tip(generate::tetrahedra(&generate::cook(24), true), Plain, nu)?;
        let (hex, drift) = tip(generate::cook(16), MeanDilatation, nu)?;
        let (tet10, _) = tip(generate::tetrahedra(&generate::cook(12), true), Plain, nu)?;
        let (tet4, _) = tip(generate::tetrahedra(&generate::cook(16), false), Plain, nu)?;
        let off = |u: f64| 100.0 * (u / fine - 1.0);
        good &= off(hex).abs() < 3.0 && off(tet10).abs() < 3.0 && (nu < 0.49 || drift < 0.005);
        text.push(format!(
            "nu {nu}: hex8 {:+.1} %, tet10 {:+.1} %, tet4 {:+.1} % (not offered for such tissue), volume {:.2} %",
            off(hex),
            off(tet10),
            off(tet4),
            100.0 * drift
        ));
    }
    check(good, text.join("; "))
}

/// A soft layer (20 mm) bonded to a rigid base, pressed by 3 mm with a rigid smooth cylinder (radius 20 mm): plane strain, one
/// half, `n` cells per 5 mm of depth. The cylinder is a parabola over the patch of 8 mm, which is about what it touches, so
/// that its rim is no singularity.
fn indented(mesh: Mesh, formulation: FormulationSpec, nu: f64) -> Result<(f64, f64), String> {
    let (height, patch, depth, radius) = (0.02, 0.008, 0.003, 0.02);
    let mut mesh = mesh;
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
    let touched: Vec<u32> = (0..mesh.points.len() as u32)
        .filter(|&n| near(mesh.points[n as usize][2], height) && mesh.points[n as usize][0] < patch + 1e-9)
        .collect();
    let profile = |&n: &u32| [0.0, 0.0, -depth + mesh.points[n as usize][0].powi(2) / (2.0 * radius)];
    let displacement = touched.iter().map(profile).collect();
    let base = mesh.node_sets["z_min"].clone();
    let middle = mesh.node_sets["x_min"].iter().filter(|n| !base.contains(n)).copied().collect();
    let all = (0..mesh.points.len() as u32).collect();
    let sets = [("touched", touched.clone()), ("middle", middle), ("all", all)];
    mesh.node_sets.extend(sets.map(|(name, nodes)| (name.to_string(), nodes)));
    let along = |set: &str, components| PrescribedSpec { components, ..held(set) };
    let name = mesh.blocks[0].name.clone();
    let scene = Scene {
        solids: vec![SolidSpec { formulation: Some(formulation), ..solid(&name, tissue(30e3, nu)) }],
        prescribed: vec![
            along("z_min", [true, false, true]),
            along("middle", [true, false, false]),
            along("all", [false, true, false]),
            PrescribedSpec { components: [false, false, true], displacement, ..moved("touched", [0.0; 3]) },
        ],
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let run = go(&plan, 1, &Settings::default());
    solved(&format!("nu {nu}"), &run)?;
    let frame = run.last().expect("solved");
    let (before, now) = volume(&plan, frame.snapshot(), &name).expect("the region exists");
    Ok((support_wrench(&plan, frame.snapshot(), &touched, [0.0; 3]).force[2], (now / before - 1.0).abs()))
}

/// Judged for the elements that the library chooses by itself and recommends (hex8 with mean dilatation, tet10); plain tet4, wedge
/// and hex8 lock, and the row says how much.
fn indentation() -> Outcome {
    use FormulationSpec::{MeanDilatation, Plain};
    // Even columns under the patch of 8 mm, wider ones out to 40 mm.
    let side = |s: f64| if s <= 0.4 { 0.02 * s } else { 0.008 + 0.02 * (s - 0.4) + (s - 0.4).powi(2) / 18.0 };
    let grid = |n: usize| generate::mapped([5 * n, 1, 4 * n], |[x, y, z]| [side(x), 1e-3 * y, 0.02 * z]);
    let (mut text, mut good) = (Vec::new(), true);
    for nu in [0.3, 0.45, 0.49, 0.499, 0.4999] {
        let (fine, _) = indented(generate::tetrahedra(&grid(6), true), MeanDilatation, nu)?;
        let (hex, drift) = indented(grid(4), MeanDilatation, nu)?;
        let (tet10, tet_drift) = indented(generate::tetrahedra(&grid(4), true), Plain, nu)?;
        let off = |f: f64| 100.0 * (f / fine - 1.0);
        good &= off(hex).abs() < 3.0 && off(tet10).abs() < 3.0;
        good &= nu < 0.49 || drift.max(tet_drift) < 0.005;
        let locked = [
            ("tet4", generate::tetrahedra(&grid(4), false)),
            ("wedge", generate::wedges(&grid(4))),
            ("plain hex8", grid(4)),
        ];
        let mut locking = Vec::new();
        for (name, mesh) in locked {
            locking.push(format!("{name} {:+.0} %", off(indented(mesh, Plain, nu)?.0)));
        }
        text.push(format!(
            "nu {nu}: hex8 {:+.1} %, tet10 {:+.1} %, volume {:.2} %; not judged: {}",
            off(hex),
            off(tet10),
            100.0 * drift.max(tet_drift),
            locking.join(", ")
        ));
    }
    check(good, text.join("; "))
}

/// Side of the block that is pressed, or half of it \[m\].
const SIDE: f64 = 0.01;

/// The case as it is meant: a cube between two wide plates to which it is bonded, its sides in guarded contact with the plates
/// and with themselves (a quarter of it, two planes of symmetry).
fn to_a_tenth() -> Outcome {
    let (n, height) = (4, 2.0 * SIDE);
    let mut mesh = generate::block([n, n, 2 * n], [SIDE, SIDE, height]);
    let n_block = mesh.points.len();
    let ends: Vec<u32> = ["z_min", "z_max"].iter().flat_map(|s| mesh.node_sets[*s].clone()).collect();
    for plane in ["x_min", "y_min"] {
        mesh.node_sets.get_mut(plane).expect("a set of the block").retain(|node| !ends.contains(node));
    }
    add_plate(&mut mesh, "lower", 0.0, true);
    add_plate(&mut mesh, "upper", height, false);
    let tie = |nodes: &str, body: &str| TieSpec { nodes: nodes.into(), body: body.into() };
    let mut contact = ContactSpec::new(&["block", "lower", "upper"]);
    contact.pairs =
        ["block", "lower", "upper"].map(|other| ["block".to_string(), other.to_string()]).to_vec();
    let along = |set: &str, axis: usize| PrescribedSpec {
        components: std::array::from_fn(|c| c == axis),
        ..held(set)
    };
    let scene = Scene {
        solids: vec![solid("block", tissue(30e3, 0.49))],
        prescribed: vec![along("x_min", 0), along("y_min", 1)],
        ties: vec![
            tie("lower", "lower"),
            tie("z_min", "lower"),
            tie("upper", "upper"),
            tie("z_max", "upper"),
        ],
        contact: Some(contact),
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let (mut forces, mut least) = ([0.0; 2], f64::INFINITY);
    for (force, steps) in forces.iter_mut().zip([10, 1]) {
        let frame = |i: usize| {
            let time = i as f64 / steps as f64;
            let pose = Pose::translation(0.0, 0.0, -0.9 * height * time);
            DriveFrame { time, load: plan.load(&[], &[("upper", pose)]).expect("the body exists") }
        };
        let drive = Drive { frames: (1..=steps).map(frame).collect() };
        let run = run(&plan, &drive, &Settings::default(), None, &mut |_| {});
        solved(&format!("{steps} steps"), &run)?;
        for frame in &run.frames {
            let plate = height * (1.0 - 0.9 * frame.time);
            let through = |p: &[f64]| p[2] < -1e-12 || p[2] > plate + 1e-12;
            if frame.x.chunks_exact(3).take(n_block).any(through) {
                return Err(format!("the block has gone through a plate at {}", frame.time));
            }
        }
        let upper = plan.bodies.iter().position(|b| b == "upper").expect("the body exists");
        let at = run.last().expect("solved").snapshot();
        *force = body_wrenches(&plan, at, &vec![[0.0; 3]; plan.bodies.len()])[upper].force[2];
        least = run.iterations.iter().map(|i| i.least_det_f).fold(least, f64::min);
    }
    let [many, one] = forces;
    check(
        (many / one - 1.0).abs() < 0.02 && least > 0.0,
        format!(
            "{many:.2} N in 10 steps, {one:.2} N in 1; least det F {least:.3}; nothing through the plates"
        ),
    )
}

/// Adds a rigid plate of 70 × 70 mm at the height `z` \[m\] as a block and a node set, its normal up or down.
fn add_plate(mesh: &mut Mesh, name: &str, z: f64, up: bool) {
    let (k, first) = (6, mesh.points.len() as u32);
    let place = |i: u32| -0.01 + 0.07 * f64::from(i) / f64::from(k);
    let mut nodes = Vec::new();
    for j in 0..=k {
        for i in 0..=k {
            mesh.points.push([place(i), place(j), z]);
            if i < k && j < k {
                let corner = first + i + (k + 1) * j;
                let mut face = [corner, corner + 1, corner + k + 2, corner + k + 1];
                if !up {
                    face.reverse();
                }
                nodes.extend(face);
            }
        }
    }
    mesh.node_sets.insert(name.to_string(), (first..mesh.points.len() as u32).collect());
    mesh.blocks.push(CellBlock { name: name.to_string(), kind: CellKind::Quad4, nodes });
}

/// One octant of a block of `n`³ cells under a plate that moves by `press` of the height at load 1; `bonded`: the plate holds
/// the nodes sideways too.
fn octant(n: usize, bonded: bool, press: f64) -> Result<Plan, String> {
    let mesh = generate::block([n; 3], [SIDE; 3]);
    let roller = |set: &str, axis: usize| PrescribedSpec {
        components: std::array::from_fn(|c| c == axis),
        ..held(set)
    };
    let plate =
        PrescribedSpec { components: [bonded, bonded, true], ..moved("z_max", [0.0, 0.0, -press * SIDE]) };
    let solids = vec![solid(&mesh.blocks[0].name, tissue(30e3, 0.49))];
    let prescribed = vec![plate, roller("z_min", 2), roller("x_min", 0), roller("y_min", 1)];
    Plan::new(&Scene { solids, prescribed, ..Scene::default() }, mesh).map_err(|e| e.to_string())
}

/// Force on the plate \[N\] at the end, least det F on the way.
fn pressed(plan: &Plan, count: usize, settings: &Settings) -> Result<(Run, f64, f64), String> {
    let run = go(plan, count, settings);
    solved(&format!("{count} steps"), &run)?;
    let least = run.iterations.iter().map(|i| i.least_det_f).fold(f64::INFINITY, f64::min);
    let force = force(plan, &run, "z_max", 2);
    Ok((run, force, least))
}

/// Compression in ten steps and in one, as far as there is one equilibrium: up to the first indefinite Hessian on the way in steps
/// of 2.5 % of the height. Returns that compression, the force \[N\] there and the least det F.
fn unique(n: usize, bonded: bool) -> Result<(f64, [f64; 2], f64), String> {
    let settings = Settings { stability: Stability::Always, ..Settings::default() };
    let slow = go(&octant(n, bonded, 0.9)?, 36, &settings);
    let buckled = slow.frames.iter().position(|f| !f.islands[0].indefinite_at.is_empty());
    let frame = buckled.or(slow.unsolved.as_ref().map(|_| slow.frames.len())).unwrap_or(36);
    let press = 0.025 * frame as f64;
    let plan = octant(n, bonded, press)?;
    let (_, many, least_many) = pressed(&plan, 10, &settings)?;
    let (_, one, least_one) = pressed(&plan, 1, &settings)?;
    Ok((press, [many, one], least_many.min(least_one)))
}

/// What becomes of the block at a tenth of its height, in words: force, energy, and how far it has gone past the plate.
fn at_a_tenth(bonded: bool) -> Result<String, String> {
    let plan = octant(4, bonded, 0.9)?;
    let mut ends = Vec::new();
    for count in [10, 1] {
        let (run, force, least) = pressed(&plan, count, &Settings::default())?;
        let frame = run.last().expect("solved");
        let past = frame.x.chunks_exact(3).map(|p| (p[2] / SIDE - 0.1).max(-p[2] / SIDE)).fold(0.0, f64::max);
        ends.push(format!(
            "{force:.2} N, {:.2} mJ, det F {least:.2}, {:.0} % of the height through the plates ({count} steps)",
            1e3 * frame.islands[0].energy,
            100.0 * past
        ));
    }
    Ok(format!("4³ cells on to a tenth, not judged: {}", ends.join(", ")))
}

/// Until its free sides buckle (by 57.5 % on 4³ cells, 47.5 % on 8³; a half-space does so by 56 %: Biot, Appl. Sci. Res. A 12
/// (1963) 168) the block is homogeneous, with a force in closed form. What the folded sides do then against the plates is contact:
/// without it they go through the plates.
fn smooth_plates() -> Outcome {
    let LawSpec::NeoHookeanUncoupled { mu, bulk } = tissue(30e3, 0.49) else { unreachable!() };
    let (mut text, mut good) = (Vec::new(), true);
    for n in [4, 8] {
        let (press, [many, one], least) = unique(n, false)?;
        let exact = SIDE * SIDE * homogeneous(mu, bulk, 1.0 - press);
        let off = (many / exact - 1.0).abs().max((one / exact - 1.0).abs());
        good &= off < 1e-5 && least > 0.0 && press > 0.4;
        text.push(format!(
            "{n}³ cells by {:.1} %: {many:.4} N in 10 steps, {one:.4} N in 1, {exact:.4} N in closed form, det F {least:.2}",
            100.0 * press
        ));
    }
    text.push(at_a_tenth(false)?);
    check(good, text.join("; "))
}

/// Nominal stress \[Pa\] of ψ = μ/2 (J^(−2/3) I₁ − 3) + K/2 (J − 1)² in uniaxial stress at the stretch `a`: with the lateral
/// stretch b, J = a b², ∂ψ/∂a at ∂ψ/∂b = 0 (bisection).
fn homogeneous(mu: f64, bulk: f64, a: f64) -> f64 {
    let slopes = |b: f64| {
        let (j, i1) = (a * b * b, a * a + 2.0 * b * b);
        let (iso, vol) = (mu * j.powf(-2.0 / 3.0), bulk * (j - 1.0));
        [iso * (a - i1 / (3.0 * a)) + vol * b * b, iso * (2.0 * b - 2.0 * i1 / (3.0 * b)) + vol * 2.0 * a * b]
    };
    let (mut low, mut high) = (0.5, 2.0 / a.sqrt());
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if slopes(middle)[1] < 0.0 { low = middle } else { high = middle }
    }
    slopes(low)[0]
}

/// The bulging side turns past the edge of the plate (from 36 % of the height on 4³ cells, 28 % on 8³) and buckles there (by 67.5
/// and 45 %): from then on there are many stable equilibria, which without contact go on through the plane of the plate.
fn bonded_plates() -> Outcome {
    let (mut text, mut good) = (Vec::new(), true);
    for n in [4, 8] {
        let (press, [many, one], least) = unique(n, true)?;
        good &= (many / one - 1.0).abs() < 0.02 && least > 0.0 && press > 0.4;
        text.push(format!(
            "{n}³ cells by {:.1} %: {many:.4} N in 10 steps, {one:.4} N in 1, det F {least:.2}",
            100.0 * press
        ));
    }
    text.push(at_a_tenth(true)?);
    check(good, text.join("; "))
}
