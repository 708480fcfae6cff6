//! `sartorius compare`: the gait steps on the deformable thigh beside the rigid leg, without and with contact.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use fem::plan::Plan;
use fem::solve::Settings;

use super::Outcome;
use crate::calibration::calibrate;
use crate::compare::{CompareError, Configuration, StressFree, configuration, drive, wanted};
use crate::error::CommandError;
use crate::optimize::{OptimizeOptions, optimize};
use crate::output::atomic::OutputFolder;
use crate::output::run::{self, RunRecord, RunStatus};
use crate::registration::{MeshFrames, Registration};
use crate::steps::{RigidStep, StepName, rigid_step};
use crate::thigh::build::{Thigh, ThighEffects};
use crate::thigh::built_in;
use crate::thigh::lines::lines_of_muscles;

/// Target edge lengths that are meshed \[mm\].
const RESOLUTIONS: std::ops::RangeInclusive<f64> = 3.0..=20.0;

/// Newton's method ends where the residual is below 1e-4 of the forces in play, which count at least 100 N: forces of single muscles
/// are compared in newtons. Muscles that hang slack take many iterations, and more when they are approached in small steps.
const SETTINGS: Settings = Settings {
    tolerance: 1e-4,
    least_force: 100.0,
    max_iterations: 400,
    first_step: 1.0,
    least_step: 1e-4,
    double_precision_factor: false,
    check_stability: false,
};

#[derive(Args)]
pub struct CompareArguments {
    /// Length of the edges of the mesh that is aimed at, in mm.
    #[arg(long, value_name = "MM", default_value_t = 12.0, allow_negative_numbers = true)]
    resolution: f64,
    /// Posture in which the mesh is free of stress: standing, or at heel strike as in the publication.
    #[arg(long, value_enum, default_value = "standing")]
    stress_free: StressFreeChoice,
    /// Which configurations are computed. Contact of all muscles at once still takes very long.
    #[arg(long, value_enum, default_value = "without")]
    contact: ContactChoice,
    /// Only these muscles, by name.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// Folder for the results [default: out/compare-walker]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum StressFreeChoice {
    Standing,
    HeelStrike,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ContactChoice {
    Both,
    With,
    Without,
}

/// Runs the command.
pub fn run(arguments: &CompareArguments) -> Result<Outcome, CommandError> {
    if !RESOLUTIONS.contains(&arguments.resolution) {
        let (least, most) = (RESOLUTIONS.start(), RESOLUTIONS.end());
        return Err(CommandError::Option(format!(
            "--resolution is {} mm; give {least} to {most} mm",
            arguments.resolution
        )));
    }
    let mut record = RunRecord::new("compare");
    let mut clock = Instant::now();
    let mut lap = |record: &mut RunRecord, stage: &str| {
        record.stage(stage, clock.elapsed());
        clock = Instant::now();
    };
    let known = lines_of_muscles();
    if let Some(unknown) = arguments.only.iter().find(|name| !known.contains_key(*name)) {
        let names: Vec<&str> = known.keys().map(String::as_str).collect();
        return Err(CommandError::Option(format!(
            "--only names `{unknown}`, which is no muscle of the thigh; they are {}",
            names.join(", ")
        )));
    }
    let done = optimize(&OptimizeOptions::default())?;
    lap(&mut record, "rigid leg");

    let made =
        built_in(arguments.resolution * 1e-3, &arguments.only, ThighEffects { fibres: true, shells: true })?;
    let thigh = &made.thigh;
    lap(&mut record, "mesh");

    let registration = Registration::new(MeshFrames::built_in(), &done.model).ok_or_else(|| {
        CommandError::Option("the patella of the rigid leg finds no place at full extension".into())
    })?;
    let steps: Vec<RigidStep> = StepName::ALL
        .iter()
        .map(|name| rigid_step(&done, &registration, *name).map_err(CommandError::NotConverged))
        .collect::<Result<_, _>>()?;
    let plan =
        Plan::new(&thigh.scene, thigh.mesh.clone()).map_err(|e| CommandError::Option(e.to_string()))?;
    let forces: Vec<Vec<f64>> = steps.iter().map(|s| wanted(thigh, s)).collect();
    let failed = |e: &dyn std::fmt::Display| CommandError::Option(e.to_string());
    let curves = calibrate(thigh, &plan, &forces, &SETTINGS).map_err(CompareError::from)?;
    lap(&mut record, "calibration");

    let folder = arguments.out.clone().unwrap_or_else(|| PathBuf::from("out/compare-walker"));
    let mut out = OutputFolder::open(&folder)?;
    let stress_free = match arguments.stress_free {
        StressFreeChoice::Standing => StressFree::Standing,
        StressFreeChoice::HeelStrike => StressFree::HeelStrike,
    };
    let compute = |plan: &Plan, name: &str| {
        let drive = drive(plan, thigh, &curves, &steps, stress_free)?;
        let done = configuration(plan, thigh, &drive, &steps, &SETTINGS, &folder.join(name))?;
        Ok::<_, CommandError>(done)
    };
    let mut results: [Option<Configuration>; 2] = [None, None];
    if arguments.contact != ContactChoice::With {
        results[0] = Some(compute(&plan, "no_contact")?);
        lap(&mut record, "without contact");
    }
    if arguments.contact != ContactChoice::Without {
        let mut touching = thigh.clone();
        touching.add_contact(&made.bones, &made.attachments);
        let plan = Plan::new(&touching.scene, touching.mesh).map_err(|e| failed(&e))?;
        results[1] = Some(compute(&plan, "contact")?);
        lap(&mut record, "with contact");
    }

    let outcome = verdict(&results, &steps, &mut record);
    out.write("comparison.csv", |w| write_comparison(w, thigh, &steps, &results))?;
    record.threads = rayon::current_num_threads();
    record.files = out.files().to_vec();
    record.peak_memory_mib = run::peak_memory_mib();
    out.finish(&record)?;
    let _ = print(&mut std::io::stdout().lock(), thigh, &steps, &results, &record, &folder);
    Ok(outcome)
}

/// Solved only if every step of every configuration is, and no muscles intersect where contact forbids it.
fn verdict(results: &[Option<Configuration>; 2], steps: &[RigidStep], record: &mut RunRecord) -> Outcome {
    let mut reasons: Vec<String> = Vec::new();
    for (with, result) in results.iter().enumerate() {
        let Some(result) = result else { continue };
        let which = ["without contact", "with contact"][with];
        reasons.extend(result.run.errors.iter().map(|e| format!("{which}: {e}")));
        if result.steps.len() < steps.len() && result.run.errors.is_empty() {
            reasons.push(format!("{which}: {} of {} steps", result.steps.len(), steps.len()));
        }
        if with == 1 {
            reasons.extend(result.intersections.iter().map(|i| format!("{which}: {i} intersect")));
        }
    }
    if reasons.is_empty() {
        return Outcome::Solved;
    }
    record.status = RunStatus::NotConverged;
    record.reason = Some(reasons.join("; "));
    Outcome::NotSolved
}

/// Forces of a muscle at a step in both configurations.
fn cells(
    results: &[Option<Configuration>; 2],
    step: usize,
    muscle: usize,
) -> [Option<crate::compare::MuscleForce>; 2] {
    [0, 1].map(|c| results[c].as_ref().and_then(|r| r.steps.get(step)).map(|s| s.muscles[muscle]))
}

fn write_comparison(
    w: &mut dyn Write,
    thigh: &Thigh,
    steps: &[RigidStep],
    results: &[Option<Configuration>; 2],
) -> std::io::Result<()> {
    writeln!(
        w,
        "step,muscle,activation,rigid_N,fe_no_contact_N,fe_contact_N,difference_no_contact_N,difference_contact_N,\
         fibre_N,matrix_N,shell_N"
    )?;
    for (k, step) in steps.iter().enumerate() {
        let rigid = wanted(thigh, step);
        for (i, muscle) in thigh.muscles.iter().enumerate() {
            let activation = step.activation(&muscle.name);
            let fe = cells(results, k, i);
            let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.3}"));
            let parts = fe[1].or(fe[0]);
            let columns = [
                number(Some(rigid[i])),
                number(fe[0].map(|f| f.total)),
                number(fe[1].map(|f| f.total)),
                number(fe[0].map(|f| f.total - rigid[i])),
                number(fe[1].map(|f| f.total - rigid[i])),
                number(parts.map(|f| f.fibre)),
                number(parts.map(|f| f.matrix)),
                number(parts.map(|f| f.shell)),
            ];
            writeln!(w, "{},{},{activation:.4},{}", step.name.name(), muscle.name, columns.join(","))?;
        }
    }
    Ok(())
}

fn print(
    w: &mut impl Write,
    thigh: &Thigh,
    steps: &[RigidStep],
    results: &[Option<Configuration>; 2],
    record: &RunRecord,
    folder: &Path,
) -> std::io::Result<()> {
    let elements: usize = thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
    writeln!(w, "{} muscles, {elements} elements, {} nodes", thigh.muscles.len(), thigh.mesh.points.len())?;
    for (k, step) in steps.iter().enumerate() {
        writeln!(
            w,
            "\n{} ({:.3} s, knee {:.0} degrees)",
            step.name.name(),
            step.time,
            step.knee_flexion.to_degrees()
        )?;
        writeln!(
            w,
            "  {:<28}{:>10}{:>10}{:>14}{:>14}",
            "muscle", "activation", "rigid N", "FE no contact", "FE contact"
        )?;
        let rigid = wanted(thigh, step);
        for (i, muscle) in thigh.muscles.iter().enumerate() {
            let activation = step.activation(&muscle.name);
            let show =
                |f: Option<crate::compare::MuscleForce>| f.map_or("-".into(), |f| format!("{:.1}", f.total));
            let [without, with] = cells(results, k, i).map(show);
            writeln!(w, "  {:<28}{activation:>10.3}{:>10.1}{without:>14}{with:>14}", muscle.name, rigid[i])?;
        }
        for (c, name) in ["without contact", "with contact"].iter().enumerate() {
            let away: Vec<f64> = (0..rigid.len())
                .filter_map(|i| Some((cells(results, k, i)[c]?.total - rigid[i]).abs()))
                .collect();
            if !away.is_empty() {
                let mean = away.iter().sum::<f64>() / away.len() as f64;
                let most = away.iter().fold(0.0_f64, |m, v| m.max(*v));
                let shared = results[c].as_ref().and_then(|r| r.overlaps.get(k)).copied().unwrap_or(0.0);
                writeln!(
                    w,
                    "  {name}: mean difference {mean:.1} N, largest {most:.1} N; muscles share {:.1} cm3",
                    shared * 1e6
                )?;
            }
        }
    }
    writeln!(w)?;
    for (stage, seconds) in &record.seconds {
        writeln!(w, "  {stage:<18}{seconds:>8.1} s")?;
    }
    if let Some(reason) = &record.reason {
        writeln!(w, "not converged: {reason}")?;
    }
    writeln!(w, "files in {}", folder.display())
}
