//! `sartorius mesh [INPUT] --resolution MM`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fem::mesh::MeshError;
use fem::mesh::muscle::{Bone, MuscleSections, build};

use super::Outcome;
use crate::error::CommandError;
use crate::output::mesh::write_mesh;
use crate::output::run::{InputFile, RunRecord, RunStatus};
use crate::report::mesh::{MeshReport, MeshSummary};
use crate::thigh_tables;

/// Target edge lengths that are meshed \[mm\]: below, a thigh takes more than a million cells.
const RESOLUTIONS: std::ops::RangeInclusive<f64> = 1.5..=20.0;

#[derive(Args)]
pub struct MeshArguments {
    /// Table of muscle sections (CSV, columns as in gait-data/thigh/muscle_sections.csv). Default: the built-in thigh.
    input: Option<PathBuf>,
    /// Length of the edges that is aimed at, in mm.
    #[arg(long, value_name = "MM", default_value_t = 6.0, allow_negative_numbers = true)]
    resolution: f64,
    /// Table of bones to keep out of (CSV, columns as in gait-data/thigh/bone_sections.csv). Default: built-in for the
    /// built-in thigh, none for other sections.
    #[arg(long, value_name = "FILE")]
    bones: Option<PathBuf>,
    /// Only these muscles, by name.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// Folder for the results [default: out/mesh-<input>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &MeshArguments) -> Result<Outcome, CommandError> {
    if !RESOLUTIONS.contains(&arguments.resolution) {
        return Err(CommandError::Option(format!(
            "--resolution is {} mm; give {} to {} mm",
            arguments.resolution,
            RESOLUTIONS.start(),
            RESOLUTIONS.end()
        )));
    }
    let started = Instant::now();
    let mut record = RunRecord::new("mesh");
    let mut sections = match &arguments.input {
        None => MuscleSections::read_csv(thigh_tables::MUSCLE_SECTIONS, Path::new("muscle_sections.csv"))?,
        Some(file) => MuscleSections::read_csv(&text(file)?, file)?,
    };
    let bones = match (&arguments.bones, &arguments.input) {
        (Some(file), _) => Bone::read_csv(&text(file)?, file)?,
        (None, None) => Bone::read_csv(thigh_tables::BONE_SECTIONS, Path::new("bone_sections.csv"))?,
        (None, Some(_)) => Vec::new(),
    };
    if let Some(unknown) = arguments.only.iter().find(|name| sections.iter().all(|m| m.name != **name)) {
        let known: Vec<_> = sections.iter().map(|m| m.name.as_str()).collect();
        return Err(CommandError::Option(format!(
            "--only names `{unknown}`, which the sections lack; they have {}",
            known.join(", ")
        )));
    }
    if !arguments.only.is_empty() {
        sections.retain(|m| arguments.only.contains(&m.name));
    }
    for file in arguments.input.iter().chain(&arguments.bones) {
        record.inputs.push(InputFile::of(file)?);
    }
    record.stage("read", started.elapsed());

    let started = Instant::now();
    let built = build(&sections, &bones, arguments.resolution / 1000.0);
    record.stage("mesh", started.elapsed());
    record.iterations.insert("rounds of separation".into(), built.rounds as u64);

    let stem = arguments.input.as_deref().and_then(Path::file_stem);
    let name = stem.map_or("thigh".into(), |stem| stem.to_string_lossy().into_owned());
    let bone_names = if bones.is_empty() {
        "none".to_string()
    } else {
        bones.iter().map(|b| b.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let settings = [
        ("Sections".to_string(), if stem.is_some() { name.clone() } else { "built-in thigh".into() }),
        ("Resolution".to_string(), format!("{} mm", arguments.resolution)),
        ("Bones".to_string(), bone_names),
        ("Rounds of separation".to_string(), built.rounds.to_string()),
    ];
    let report = MeshReport { name: &name, built: &built, bones: &bones, settings: &settings };
    let summary = MeshSummary::of(&report);
    record.settings = settings.iter().map(|(k, v)| (k.clone(), serde_json::Value::from(v.clone()))).collect();
    record.threads = rayon::current_num_threads();
    let outcome = if summary.missed.is_empty() { Outcome::Solved } else { Outcome::NotSolved };
    if outcome == Outcome::NotSolved {
        record.status = RunStatus::NotConverged;
        record.reason = Some(summary.missed.join("; "));
    }
    let folder = match &arguments.out {
        Some(folder) => folder.clone(),
        None => Path::new("out").join(format!("mesh-{name}")),
    };
    let seconds: f64 = record.seconds.iter().map(|s| s.1).sum();
    let files = write_mesh(&folder, &report, record)?;
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let _ = writeln!(out, "{}", serde_json::to_string_pretty(&summary).expect("a summary is plain data"));
    } else {
        let _ = print(&mut out, &name, &summary, seconds, &folder, files.len());
    }
    Ok(outcome)
}

fn text(file: &Path) -> Result<String, MeshError> {
    std::fs::read_to_string(file).map_err(|source| MeshError::Io { file: file.into(), source })
}

fn print(
    out: &mut impl Write,
    name: &str,
    s: &MeshSummary,
    seconds: f64,
    folder: &Path,
    n_files: usize,
) -> std::io::Result<()> {
    writeln!(out, "{name}: {} muscles, {} elements, {} nodes", s.muscles, s.elements, s.nodes)?;
    writeln!(
        out,
        "  scaled Jacobian   least {:.2}, least mean of a muscle {:.2}",
        s.least_scaled_jacobian, s.least_mean_scaled_jacobian
    )?;
    if let Some(gap) = s.least_gap_mm {
        writeln!(out, "  least gap         {gap:.3} mm between two muscles")?;
    }
    writeln!(
        out,
        "  surface, volume   95 % of the nodes within {:.2} mm of the sections, volumes within {:.1} %",
        s.largest_p95_deviation_mm, s.largest_volume_error_percent
    )?;
    writeln!(out, "  bones             at most {:.2} mm deep, at attached ends", s.deepest_bone_crossing_mm)?;
    for missed in &s.missed {
        writeln!(out, "  missed: {missed}")?;
    }
    writeln!(
        out,
        "  computed in {seconds:.1} s; {n_files} files in {}, open report.html there",
        folder.display()
    )
}
