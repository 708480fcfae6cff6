//! Hard cases of finding equilibrium: E6, E7, E15, T4, T5, T6.

use crate::{Case, Outcome, Tier};
use fem::material::line::FibreStrain;
use fem::measure::support_wrench;
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, DriveFrame, Run, run};
use fem::scene::{Course, FibreLawSpec, FibreSpec, LawSpec, PrescribedSpec, Scene, SolidSpec, StrandSpec};
use fem::solve::{Settings, SolveError, Stability};

pub const CASES: &[Case] = &[
    Case { id: "E6", title: "sliver sweep, tet4 pressed", tier: Tier::Quick, run: slivers },
    Case {
        id: "E7",
        title: "same cube at 1e-4 to 1e3 m, in N and m, N and mm",
        tier: Tier::Quick,
        run: units,
    },
    Case { id: "E15", title: "tendon in muscle, stiffness 1e5 : 1", tier: Tier::Quick, run: soft_and_stiff },
    Case { id: "T4", title: "buckling strip", tier: Tier::Quick, run: buckling },
    Case { id: "T4", title: "fibre bundle slack to tight", tier: Tier::Quick, run: slack_to_tight },
    Case { id: "T5", title: "missing supports", tier: Tier::Quick, run: missing_supports },
    Case { id: "T6", title: "penalty 1e12 in tissue of nu 0.4999", tier: Tier::Quick, run: badly_scaled },
];

/// Soft tissue of the table: E = 30 kPa, ν = 0.49 by default.
pub(super) fn tissue(young: f64, nu: f64) -> LawSpec {
    LawSpec::NeoHookeanUncoupled { mu: young / (2.0 * (1.0 + nu)), bulk: young / (3.0 * (1.0 - 2.0 * nu)) }
}

pub(super) fn solid(region: &str, law: LawSpec) -> SolidSpec {
    SolidSpec::new(region, law)
}

pub(super) fn held(nodes: &str) -> PrescribedSpec {
    PrescribedSpec { nodes: nodes.into(), components: [true; 3], displacement: Vec::new(), control: None }
}

/// Moves by `u` \[m\] at control `load` = 1.
pub(super) fn moved(nodes: &str, u: [f64; 3]) -> PrescribedSpec {
    PrescribedSpec { displacement: vec![u], control: Some("load".into()), ..held(nodes) }
}

/// The box `mesh` between bonded plates, the upper moved along z by `uz` \[m\] at load 1.
fn bonded(mesh: Mesh, law: LawSpec, uz: f64) -> Plan {
    let solids = mesh.blocks.iter().map(|b| solid(&b.name, law.clone())).collect();
    let prescribed = vec![held("z_min"), moved("z_max", [0.0, 0.0, uz])];
    Plan::new(&Scene { solids, prescribed, ..Scene::default() }, mesh).expect("the scene is sound")
}

pub(super) fn steps(plan: &Plan, count: usize) -> Drive {
    let frame = |i: usize| {
        let fraction = i as f64 / count as f64;
        DriveFrame {
            time: fraction,
            load: plan.load(&[("load", fraction)], &[]).expect("the control exists"),
        }
    };
    Drive { frames: (1..=count).map(frame).collect() }
}

pub(super) fn go(plan: &Plan, count: usize, settings: &Settings) -> Run {
    run(plan, &steps(plan, count), settings, None, &mut |_| {})
}

/// Force \[N\] of the support `set` along an axis.
pub(super) fn force(plan: &Plan, run: &Run, set: &str, axis: usize) -> f64 {
    let frame = run.last().expect("solved");
    support_wrench(plan, frame.snapshot(), &plan.mesh.node_sets[set], [0.0; 3]).force[axis]
}

pub(super) fn solved(what: &str, run: &Run) -> Result<(), String> {
    match run.errors.first() {
        None => Ok(()),
        Some(error) => Err(format!("{what}: {error}")),
    }
}

pub(super) fn check(good: bool, text: String) -> Outcome {
    if good { Ok(text) } else { Err(text) }
}

/// One interior node is drawn towards a neighbour until the tetrahedra at that edge are slivers.
fn slivers() -> Outcome {
    let mut forces = Vec::new();
    let mut refused = Vec::new();
    for exponent in 1..=8 {
        let mut mesh = generate::tetrahedra(&generate::block([4; 3], [0.02; 3]), false);
        let node = |i: usize, j: usize, k: usize| i + 5 * (j + 5 * k);
        let (p, q) = (node(2, 2, 2), node(3, 2, 2));
        let [from, to] = [mesh.points[p], mesh.points[q]];
        let fraction = 10f64.powi(-exponent);
        mesh.points[p] = std::array::from_fn(|c| to[c] + fraction * (from[c] - to[c]));
        let plan = bonded(mesh, tissue(30e3, 0.49), -0.2 * 0.02);
        let run = go(&plan, 1, &Settings::default());
        match run.errors.first() {
            None => forces.push((exponent, force(&plan, &run, "z_max", 2))),
            Some(error) if error.to_string().contains("element") => refused.push(exponent),
            Some(error) => return Err(format!("refused without an element at 1e-{exponent}: {error}")),
        }
    }
    let first = forces.first().map_or(f64::NAN, |f| f.1);
    let change = |f: &&(i32, f64)| (f.1 / first - 1.0).abs();
    let worst = forces.iter().filter(|f| f.0 <= 4).map(|f| change(&f)).fold(0.0, f64::max);
    let all = forces.iter().map(|f| change(&f)).fold(0.0, f64::max);
    let done = forces.iter().filter(|f| f.0 <= 4).count();
    check(
        done == 4 && worst < 0.01,
        format!(
            "force changes by {:.2} % down to 1e-4, {:.2} % over all solved; refused with element: {refused:?}",
            100.0 * worst,
            100.0 * all
        ),
    )
}

/// Dimensionless positions and force must not know the units.
fn units() -> Outcome {
    let shape = |size: f64, young: f64| {
        let mut mesh = generate::block([4; 3], [1.0; 3]);
        generate::distort(&mut mesh, 0.2, 7);
        mesh.points.iter_mut().flatten().for_each(|x| *x *= size);
        let plan = bonded(mesh, tissue(young, 0.49), -0.25 * size);
        let run = go(&plan, 1, &Settings { tolerance: 1e-12, ..Settings::default() });
        solved(&format!("size {size:e}, E {young:e}"), &run)?;
        let x: Vec<f64> = run.last().expect("solved").x.iter().map(|x| x / size).collect();
        Ok::<_, String>((x, force(&plan, &run, "z_max", 2) / (young * size * size)))
    };
    let (x, f) = shape(1.0, 30e3)?;
    let mut worst = 0.0_f64;
    // metres and Pa at four sizes; millimetres and MPa; a stiff and a soft extreme
    for (size, young) in [(1e-4, 30e3), (1e-2, 30e3), (1e3, 30e3), (100.0, 0.03), (1e-4, 1e9), (1e3, 1e-3)] {
        let (y, g) = shape(size, young)?;
        let away = x.iter().zip(&y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        worst = worst.max(away).max((g / f - 1.0).abs());
    }
    check(worst < 1e-9, format!("largest change of a dimensionless position or force {worst:.1e}"))
}

/// A tendon along the middle of a muscle, sharing its nodes; iterations at stiffness 1e5 : 1 and 10 : 1.
fn soft_and_stiff() -> Outcome {
    let iterations = |ratio: f64| {
        let mut mesh = generate::block([6, 6, 12], [0.03, 0.03, 0.1]);
        let block = mesh.blocks.remove(0);
        let (mut muscle, mut tendon) = (Vec::new(), Vec::new());
        for cell in block.nodes.chunks_exact(8) {
            let centre = |c: usize| cell.iter().map(|&n| mesh.points[n as usize][c]).sum::<f64>() / 8.0;
            let inside =
                (centre(0) - 0.015).abs() < 0.006 && (centre(1) - 0.015).abs() < 0.006 && centre(2) > 0.04;
            if inside { tendon.extend(cell) } else { muscle.extend(cell) }
        }
        for (name, nodes) in [("muscle", muscle), ("tendon", tendon)] {
            mesh.blocks.push(CellBlock { name: name.into(), kind: CellKind::Hex8, nodes });
        }
        let scene = Scene {
            solids: vec![solid("muscle", tissue(1e4, 0.49)), solid("tendon", tissue(1e4 * ratio, 0.49))],
            prescribed: vec![held("z_min"), moved("z_max", [0.004, 0.0, 0.004])],
            ..Scene::default()
        };
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let run = go(&plan, 1, &Settings::default());
        solved(&format!("ratio {ratio:e}"), &run)?;
        let advance = &run.last().expect("solved").islands[0];
        Ok::<_, String>((advance.iterations, advance.linear_iterations))
    };
    let (soft, soft_cg) = iterations(10.0)?;
    let (stiff, stiff_cg) = iterations(1e5)?;
    check(
        stiff <= 3 * soft && stiff_cg <= 3 * soft_cg.max(10),
        format!("Newton {soft} at 10, {stiff} at 1e5; conjugate gradients {soft_cg} and {stiff_cg}"),
    )
}

/// A strip pressed along its length buckles; its deflection is that of the clamped elastica.
fn buckling() -> Outcome {
    let (length, width, thickness, press) = (0.1, 0.01, 0.0025, 0.05);
    let mesh = generate::block([4, 2, 40], [thickness, width, length]);
    let plan = bonded(mesh, tissue(30e3, 0.3), -press * length);
    let run = go(&plan, 1, &Settings { stability: Stability::Always, ..Settings::default() });
    solved("strip", &run)?;
    let frame = run.last().expect("solved");
    let side = frame
        .x
        .chunks_exact(3)
        .zip(&plan.mesh.points)
        .map(|(x, rest)| (x[0] - rest[0]).abs())
        .fold(0.0, f64::max);
    // Clamped elastica, amplitude small against the length: w = (2/π) √(L (Δ − Δ_cr)), Δ_cr/L = π² t²/(3 L²) (plane stress).
    let critical = (std::f64::consts::PI * thickness / length).powi(2) / 3.0;
    let expected = 2.0 / std::f64::consts::PI * length * (press - critical).sqrt();
    let advance = &frame.islands[0];
    check(
        !advance.indefinite_at.is_empty() && (side / expected - 1.0).abs() < 0.05,
        format!(
            "instability reported at loads {:?}, deflection {:.2} mm, elastica {:.2} mm",
            advance.indefinite_at,
            1e3 * side,
            1e3 * expected
        ),
    )
}

/// Strands with 5 % slack in a soft bar stretched by 10 % at once.
fn slack_to_tight() -> Outcome {
    let n = [2, 2, 8];
    let stretched = |slack: f64, steps: usize| {
        let mut mesh = generate::block([n[2], n[0], n[1]], [0.08, 0.02, 0.02]);
        generate::add_fibres(
            &mut mesh,
            "bundle",
            [n[2], n[0], n[1]],
            &[[0, 0], [2, 0], [1, 1], [0, 2], [2, 2]],
        );
        let name = mesh.blocks[0].name.clone();
        let strand =
            StrandSpec { region: "bundle".into(), stiffness: 500.0, toe: 0.03, reference_strain: -slack };
        let scene = Scene {
            solids: vec![solid(&name, tissue(30e3, 0.49))],
            strands: vec![strand],
            prescribed: vec![held("x_min"), moved("x_max", [0.008, 0.0, 0.0])],
            ..Scene::default()
        };
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let run = go(&plan, steps, &Settings::default());
        solved("bundle", &run)?;
        let iterations = run.frames.iter().map(|f| f.islands[0].iterations).sum::<usize>();
        Ok::<_, String>((force(&plan, &run, "x_max", 0), iterations))
    };
    let (once, iterations) = stretched(0.05, 1)?;
    let (slowly, _) = stretched(0.05, 20)?;
    let (always_slack, _) = stretched(0.2, 1)?;
    check(
        (once / slowly - 1.0).abs() < 1e-5 && once > always_slack + 10.0,
        format!(
            "{once:.3} N at once in {iterations} iterations, {slowly:.3} N in 20 steps, {always_slack:.3} N all slack"
        ),
    )
}

fn missing_supports() -> Outcome {
    let law = || tissue(30e3, 0.49);
    let refused = |scene: Scene, mesh: Mesh| {
        let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
        let frame = DriveFrame { time: 1.0, load: plan.load(&[], &[]).expect("nothing is named") };
        let run = run(&plan, &Drive { frames: vec![frame] }, &Settings::default(), None, &mut |_| {});
        match run.errors.first() {
            Some(SolveError::Unsupported { parts, .. }) => Ok(parts[0].directions.join(", ")),
            other => Err(format!("not refused as unsupported: {other:?}")),
        }
    };
    let block = || generate::block([3; 3], [0.02; 3]);
    let solids = || block().blocks.iter().map(|b| solid(&b.name, law())).collect::<Vec<_>>();
    let floating = refused(Scene { solids: solids(), ..Scene::default() }, block())?;
    let rollers = PrescribedSpec { components: [false, false, true], ..held("z_min") };
    let sliding =
        refused(Scene { solids: solids(), prescribed: vec![rollers], ..Scene::default() }, block())?;
    let good = floating.matches("translation").count() == 3
        && floating.matches("rotation").count() == 3
        && sliding.starts_with("translation along x, translation along y, rotation about z");
    check(good, format!("floating: six motions; on a plane: {sliding}"))
}

/// Strands a hundred million times stiffer than the tissue pull at it.
fn badly_scaled() -> Outcome {
    let mut mesh = generate::block([5, 3, 3], [0.05, 0.03, 0.03]);
    generate::add_fibres(&mut mesh, "rods", [5, 3, 3], &[[1, 1], [2, 2]]);
    mesh.blocks[1].nodes.truncate(2 * 8); // from end to end the first, the second ends inside
    mesh.blocks[1].nodes.drain(..2 * 2); // the first begins inside
    let name = mesh.blocks[0].name.clone();
    let rods = FibreSpec {
        name: "rods".into(),
        course: Course::Region("rods".into()),
        law: FibreLawSpec::Thermal {
            young: 1e12,
            contraction: 0.0,
            strain: FibreStrain::Logarithmic,
            toe: None,
        },
        area: vec![1.0],
        activation: None,
    };
    let scene = Scene {
        solids: vec![solid(&name, tissue(30e3, 0.4999))],
        fibres: vec![rods],
        prescribed: vec![held("x_min"), moved("x_max", [0.005, 0.002, 0.0])],
        ..Scene::default()
    };
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let run = go(&plan, 1, &Settings { tolerance: 1e-8, ..Settings::default() });
    match run.errors.first() {
        Some(error) => check(error.to_string().contains("round-off"), format!("diagnosis: {error}")),
        None => {
            let advance = &run.last().expect("solved").islands[0];
            let relative = advance.residual / advance.force_scale;
            check(
                relative <= 1e-8,
                format!("relative residual {relative:.1e}, {} iterations", advance.iterations),
            )
        }
    }
}
