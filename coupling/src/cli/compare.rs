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
use crate::output::compare::write_compare;
use crate::output::run::{RunRecord, RunStatus};
use crate::registration::{MeshFrames, Registration};
use crate::report::compare::{CompareReport, Computed};
use crate::steps::{RigidStep, StepName, rigid_step};
use crate::thigh::build::ThighEffects;
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
    let out = OutputFolder::open(&folder)?;
    let stress_free = match arguments.stress_free {
        StressFreeChoice::Standing => StressFree::Standing,
        StressFreeChoice::HeelStrike => StressFree::HeelStrike,
    };
    let compute = |plan: &Plan, name: &str| {
        let drive = drive(plan, thigh, &curves, &steps, stress_free)?;
        let done = configuration(plan, thigh, &drive, &steps, &SETTINGS, &folder.join(name))?;
        Ok::<_, CommandError>(done)
    };
    let mut alone: Option<Configuration> = None;
    let mut touching: Option<(Plan, Configuration)> = None;
    if arguments.contact != ContactChoice::With {
        alone = Some(compute(&plan, "no_contact")?);
        lap(&mut record, "without contact");
    }
    if arguments.contact != ContactChoice::Without {
        let mut with = thigh.clone();
        with.add_contact(&made.bones, &made.attachments);
        let plan = Plan::new(&with.scene, with.mesh).map_err(|e| failed(&e))?;
        let done = compute(&plan, "contact")?;
        touching = Some((plan, done));
        lap(&mut record, "with contact");
    }

    let touching = touching.as_ref().map(|(plan, result)| Computed { plan, result });
    let alone = alone.as_ref().map(|result| Computed { plan: &plan, result });
    let settings = [("Resolution".to_string(), format!("{} mm", arguments.resolution))];
    let frames = MeshFrames::built_in();
    let report = CompareReport {
        name: "walker",
        thigh,
        bones: &made.bones,
        mid_thigh: 0.5 * (frames.hip.y + frames.knee.y),
        steps: &steps,
        configurations: [alone, touching],
        settings: &settings,
        simulated: &[],
        left_out: &[],
        seconds: &record.seconds.clone(),
    };
    let shortcomings = report.shortcomings();
    if !shortcomings.is_empty() {
        record.status = RunStatus::NotConverged;
        record.reason = Some(shortcomings.join("; "));
    }
    let record = write_compare(out, &report, record)?;
    let _ = print(&mut std::io::stdout().lock(), &report, &record, &folder);
    Ok(if shortcomings.is_empty() { Outcome::Solved } else { Outcome::NotSolved })
}

fn print(
    w: &mut impl Write,
    report: &CompareReport,
    record: &RunRecord,
    folder: &Path,
) -> std::io::Result<()> {
    let thigh = report.thigh;
    let elements: usize = thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum();
    writeln!(w, "{} muscles, {elements} elements, {} nodes", thigh.muscles.len(), thigh.mesh.points.len())?;
    let differences = report.differences();
    for (k, step) in report.steps.iter().enumerate() {
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
        for row in report.rows(k) {
            let [without, with] = row.fe.map(|f| f.map_or("-".into(), |f| format!("{:.1}", f.total)));
            writeln!(
                w,
                "  {:<28}{:>10.3}{:>10.1}{without:>14}{with:>14}",
                row.muscle, row.activation, row.rigid
            )?;
        }
        for d in differences.iter().filter(|d| d.step == step.name) {
            writeln!(
                w,
                "  {}: mean difference {:.1} N ({:.1} N of all), largest {:.1} N ({}); muscles share {:.1} cm3",
                d.configuration, d.mean, d.mean_of_all, d.largest, d.largest_muscle, d.shared_volume
            )?;
        }
    }
    writeln!(w)?;
    for (stage, seconds) in &record.seconds {
        writeln!(w, "  {stage:<18}{seconds:>8.1} s")?;
    }
    if let Some(reason) = &record.reason {
        writeln!(w, "not converged: {reason}")?;
    }
    writeln!(w, "files in {}, open report.html there", folder.display())
}
