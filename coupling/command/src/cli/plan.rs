//! `sartorius plan SCENE`: what would be simulated, what is left out and why, and what it would cost.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::scenes::{read_scene, scenes};
use super::{Outcome, tell};
use crate::error::CommandError;
use coupling::comparison::estimate::{Expected, Stage, Work};
use coupling::comparison::speed::iteration_seconds;
use coupling::comparison::{Prepared, Sized};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::Scene;

#[derive(Args)]
pub struct PlanArguments {
    #[arg(help = scenes())]
    scene: Option<PathBuf>,
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Make the mesh and compile it, which takes as long as that does: all numbers of the work are exact, and surfaces that overlap are named.
    #[arg(long)]
    exact: bool,
    /// Print the plan as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &PlanArguments) -> Result<Outcome, CommandError> {
    let scene = match &arguments.scene {
        None => Scene::walker(),
        Some(file) => read_scene(file, arguments.data.as_deref())?,
    };
    let asked = PerConfiguration { without: true, with: scene.contact.is_some() };
    let data = arguments.data.as_deref();
    let sized = Sized::new(scene, data)?;
    tell(sized.doubts());
    // A second that the rigid leg alone has no use for.
    let iteration = sized.scene.deformable.then(iteration_seconds);
    let (mut thigh, mut expected) = sized.expected(asked, iteration)?;
    let (scene, demand) = (sized.scene.clone(), sized.demand());
    if arguments.exact {
        let prepared = Prepared::of(sized, &mut |_| ())?;
        let work = |c: Configuration| -> Result<Option<Work>, CommandError> {
            let wanted = asked[c] && prepared.made.is_some();
            wanted.then(|| Ok(Work::of_plan(&prepared.plan(&prepared.thigh, c)?))).transpose()
        };
        let works = PerConfiguration {
            without: work(Configuration::WithoutContact)?,
            with: work(Configuration::WithContact)?,
        };
        expected = expected.counted(&scene, &prepared.thigh, works, demand, iteration);
        thigh = prepared.thigh;
    }
    let (simulated, left_out) = scene.effects(&thigh, asked);
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = if arguments.json {
        let stages: Vec<_> = expected
            .stages
            .iter()
            .map(|s| {
                json!({
                    "stage": s.name, "unknowns": s.work.unknowns, "islands": s.work.islands,
                    "factor_entries": s.work.factors, "expected_memory_mib": s.memory_mib, "expected_seconds": s.seconds,
                })
            })
            .collect();
        let plan = json!({
            "scene": scene.name, "settings": scene.settings(), "simulated": simulated, "left_out": left_out,
            "counted_on": if arguments.exact { "mesh" } else { "draft" },
            "elements": expected.elements, "nodes": expected.nodes, "stages": stages,
            "expected_meshing_seconds": expected.meshing, "expected_memory_mib": expected.memory_mib,
            "expected_seconds": expected.seconds(),
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&plan).expect("plain data"))
    } else {
        print(&mut out, &scene, &simulated, &left_out, &expected, arguments.exact)
    };
    Ok(Outcome::Solved)
}

fn print(
    w: &mut impl Write,
    scene: &Scene,
    simulated: &[String],
    left_out: &[(String, String)],
    expected: &Expected,
    exact: bool,
) -> std::io::Result<()> {
    writeln!(w, "scene {}", scene.name)?;
    let settings = scene.settings();
    let width = settings.iter().map(|(label, _)| label.chars().count() + 2).fold(22, usize::max);
    for (label, value) in settings {
        writeln!(w, "  {label:<width$}{value}")?;
    }
    writeln!(w, "\nsimulated")?;
    for sentence in simulated {
        writeln!(w, "  {sentence}")?;
    }
    writeln!(w, "\nleft out")?;
    for (what, why) in left_out {
        writeln!(w, "  {what}: {why}")?;
    }
    let Expected { elements, nodes, meshing, memory_mib, .. } = expected;
    writeln!(w, "\nwork: {elements} elements, {nodes} nodes, meshed in about {meshing:.0} s")?;
    let width = expected.stages.iter().map(|stage| stage.name.chars().count()).fold(18, usize::max);
    for Stage { name, work, seconds, .. } in &expected.stages {
        writeln!(
            w,
            "  {name:<width$}{:>9} unknowns in {:>2} islands, {:>6.1} million entries of factors, about {seconds:.0} s",
            work.unknowns,
            work.islands,
            work.factors as f64 * 1e-6,
        )?;
    }
    if !exact && *elements > 0 {
        writeln!(
            w,
            "estimated: counted on a draft of the mesh, right to 4 %; --exact makes the mesh, counts on it and finds surfaces that overlap"
        )?;
    }
    writeln!(
        w,
        "expected: {memory_mib:.0} MiB and {:.0} s on {} threads; the time was right to a factor of 1.5 on all shipped scenes",
        expected.seconds(),
        rayon::current_num_threads()
    )
}
