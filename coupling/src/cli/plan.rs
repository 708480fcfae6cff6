//! `sartorius plan SCENE`: what would be simulated, what is left out and why, and what it would cost.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use fem::plan::{LoadedIsland, Plan};
use fem::solve::{Analysis, Potential};
use serde_json::json;

use super::Outcome;
use crate::error::CommandError;
use crate::report::compare::CONFIGURATIONS;
use crate::scene::{Fibres, Scene};
use crate::study::Prepared;

/// Newton iterations of a muscle in one frame, and of the whole thigh in contact: measured with the built-in walker at 12 and 6 mm, muscles spread fivefold.
const ITERATIONS: [f64; 2] = [35.0, 22.0];
/// Newton iterations of a muscle in its calibration, all solutions together; the Hessian is often indefinite there, and counts twice.
const CALIBRATION: f64 = 75.0;
/// Floating-point operations of a factorization per second and core, as measured.
const FLOPS: f64 = 2e10;
/// Seconds of one core per element and iteration for assembly and line search, as measured; contact looks at surfaces too.
const ASSEMBLY: [f64; 2] = [2.5e-5, 1e-4];
/// Seconds of the rigid leg, and of one core per element for meshing, as measured.
const RIGID_LEG: f64 = 0.05;
const MESHING: f64 = 7.5e-4;
/// Memory beside matrix and factors of the bodies alone, as measured \[bytes per element\]: without contact, and with it, whose pairs
/// join the factors.
const MEMORY: [f64; 2] = [6e3, 2.8e4];
/// Memory of the program in any case \[bytes\].
const PROGRAM: f64 = 4e7;

#[derive(Args)]
pub struct PlanArguments {
    /// Scene file (TOML), or the name of a shipped scene such as three_muscles. Default: the built-in walker.
    scene: Option<PathBuf>,
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Print the plan as JSON.
    #[arg(long)]
    json: bool,
}

/// What one configuration is and costs.
struct Cost {
    unknowns: usize,
    islands: usize,
    /// Entries of all factors.
    factors: usize,
    memory_mib: f64,
    seconds: f64,
}

impl Cost {
    fn of(plan: &Plan, configuration: usize, elements: usize, iterations: f64) -> Cost {
        let threads = rayon::current_num_threads() as f64;
        let (mut factors, mut blocks, mut work, mut unknowns) = (0, 0, 0.0, 0);
        let rest = plan.load(&[], &[]).expect("nothing is named");
        for island in &plan.islands {
            let loaded = LoadedIsland::new(island.clone(), rest.clone(), rest.clone());
            let pattern = loaded.pattern();
            let x = island.free_positions(
                &island.nodes.iter().flat_map(|&n| plan.mesh.points[n as usize]).collect::<Vec<f64>>(),
            );
            let analysis = Analysis::new(pattern, &x);
            factors += analysis.n_values();
            work += analysis.work();
            blocks += pattern.n_blocks();
            unknowns += island.n_unknowns();
        }
        let per_iteration = work / FLOPS + ASSEMBLY[configuration] * elements as f64;
        Cost {
            unknowns,
            islands: plan.islands.len(),
            factors,
            // Factors in single precision; the matrix twice, in double.
            memory_mib: (PROGRAM
                + MEMORY[configuration] * elements as f64
                + 4.0 * factors as f64
                + 2.0 * 72.0 * blocks as f64)
                / f64::from(1 << 20),
            seconds: per_iteration * iterations / threads,
        }
    }
}

/// Runs the command.
pub fn run(arguments: &PlanArguments) -> Result<Outcome, CommandError> {
    let scene = match &arguments.scene {
        None => Scene::walker(),
        Some(file) => Scene::read(file, arguments.data.as_deref())?,
    };
    let asked = [true, scene.contact.is_some()];
    let prepared = Prepared::new(scene, arguments.data.as_deref(), &mut |_| ())?;
    let scene = &prepared.scene;
    let (simulated, left_out) = scene.effects(&prepared.thigh, asked);
    let elements = prepared.n_elements();
    let mut costs: Vec<(&str, Cost)> = Vec::new();
    if prepared.made.is_some() {
        let steps = scene.steps.len() as f64;
        if scene.fibres != Fibres::None {
            let alone = prepared.plan(&prepared.thigh, 0)?;
            costs.push(("calibration", Cost::of(&alone, 0, elements, CALIBRATION)));
        }
        for c in (0..2).filter(|c| asked[*c]) {
            let plan = prepared.plan(&prepared.thigh, c)?;
            costs.push((CONFIGURATIONS[c], Cost::of(&plan, c, elements, ITERATIONS[c] * steps)));
        }
    }
    let meshing = MESHING * elements as f64 / rayon::current_num_threads() as f64;
    let seconds = costs.iter().map(|c| c.1.seconds).fold(RIGID_LEG + meshing, |sum, s| sum + s);
    let memory = costs.iter().map(|c| c.1.memory_mib).fold(PROGRAM / f64::from(1 << 20), f64::max);
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = if arguments.json {
        let stages: Vec<_> = costs
            .iter()
            .map(|(name, c)| {
                json!({
                    "stage": name, "unknowns": c.unknowns, "islands": c.islands, "factor_entries": c.factors,
                    "expected_memory_mib": c.memory_mib, "expected_seconds": c.seconds,
                })
            })
            .collect();
        let plan = json!({
            "scene": scene.name, "settings": scene.settings(), "simulated": simulated, "left_out": left_out,
            "elements": elements, "nodes": prepared.thigh.mesh.points.len(), "stages": stages,
            "expected_meshing_seconds": meshing, "expected_memory_mib": memory, "expected_seconds": seconds,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&plan).expect("plain data"))
    } else {
        print(&mut out, &prepared, &simulated, &left_out, &costs, memory, [meshing, seconds])
    };
    Ok(Outcome::Solved)
}

fn print(
    w: &mut impl Write,
    prepared: &Prepared,
    simulated: &[String],
    left_out: &[(String, String)],
    costs: &[(&str, Cost)],
    memory: f64,
    [meshing, seconds]: [f64; 2],
) -> std::io::Result<()> {
    let scene = &prepared.scene;
    writeln!(w, "scene {}", scene.name)?;
    for (label, value) in scene.settings() {
        writeln!(w, "  {label:<22}{value}")?;
    }
    writeln!(w, "\nsimulated")?;
    for sentence in simulated {
        writeln!(w, "  {sentence}")?;
    }
    writeln!(w, "\nleft out")?;
    for (what, why) in left_out {
        writeln!(w, "  {what}: {why}")?;
    }
    let nodes = prepared.thigh.mesh.points.len();
    writeln!(w, "\nwork: {} elements, {nodes} nodes, meshed in about {meshing:.0} s", prepared.n_elements())?;
    for (name, c) in costs {
        writeln!(
            w,
            "  {name:<18}{:>9} unknowns in {:>2} islands, {:>6.1} million entries of factors, about {:.0} s",
            c.unknowns,
            c.islands,
            c.factors as f64 * 1e-6,
            c.seconds
        )?;
    }
    writeln!(
        w,
        "expected: {memory:.0} MiB and {seconds:.0} s on {} threads; the time is right to a factor of three",
        rayon::current_num_threads()
    )
}
