//! `sartorius mesh [INPUT] --resolution MM`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fem::mesh::muscle::from_surface::{Anatomy, MuscleEnds, Settings};
use fem::mesh::muscle::{Bone, MuscleSections, build};
use fem::mesh::{LengthUnit, MeshError};

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
    /// Table of muscle sections (CSV, columns as in gait-data/thigh/muscle_sections.csv), or a folder of closed muscle surfaces
    /// (<muscle>.stl, .obj or .ply). Default: the built-in thigh.
    input: Option<PathBuf>,
    /// Length of the edges that is aimed at, in mm.
    #[arg(long, value_name = "MM", default_value_t = 6.0, allow_negative_numbers = true)]
    resolution: f64,
    /// Table of bones to keep out of (CSV, columns as in gait-data/thigh/bone_sections.csv), or for muscle surfaces a folder of
    /// bone surfaces. Default: built-in for the built-in thigh, none for other sections, the folder `bones` beside that of
    /// muscle surfaces.
    #[arg(long, value_name = "PATH")]
    bones: Option<PathBuf>,
    /// For muscle surfaces: which muscles to mesh and which bones they join (CSV with the columns muscle, end, bone). Default:
    /// those of the built-in thigh.
    #[arg(long, value_name = "FILE")]
    ends: Option<PathBuf>,
    /// For surfaces: length unit of the files.
    #[arg(long, value_name = "m|mm", default_value = "m", value_parser = ["m", "mm"])]
    unit: String,
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
    let (sections, bones, files) = match &arguments.input {
        Some(folder) if folder.is_dir() => from_surfaces(folder, arguments)?,
        _ if arguments.ends.is_some() => {
            return Err(CommandError::Option("--ends needs a folder of muscle surfaces as input".into()));
        }
        _ => from_tables(arguments)?,
    };
    for file in &files {
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

/// Sections, bones to keep out of, and the files read.
type Inputs = (Vec<MuscleSections>, Vec<Bone>, Vec<PathBuf>);

/// From tables of sections and bones.
fn from_tables(arguments: &MeshArguments) -> Result<Inputs, CommandError> {
    let mut sections = match &arguments.input {
        None => MuscleSections::read_csv(thigh_tables::MUSCLE_SECTIONS, Path::new("muscle_sections.csv"))?,
        Some(file) => MuscleSections::read_csv(&text(file)?, file)?,
    };
    let bones = match (&arguments.bones, &arguments.input) {
        (Some(file), _) => Bone::read_csv(&text(file)?, file)?,
        (None, None) => Bone::read_csv(thigh_tables::BONE_SECTIONS, Path::new("bone_sections.csv"))?,
        (None, Some(_)) => Vec::new(),
    };
    let known: Vec<String> = sections.iter().map(|m| m.name.clone()).collect();
    only_known(&arguments.only, &known)?;
    sections.retain(|m| arguments.only.is_empty() || arguments.only.contains(&m.name));
    Ok((sections, bones, arguments.input.iter().chain(&arguments.bones).cloned().collect()))
}

/// From a folder of muscle surfaces and a folder of bone surfaces.
fn from_surfaces(folder: &Path, arguments: &MeshArguments) -> Result<Inputs, CommandError> {
    let mut ends = match &arguments.ends {
        None => MuscleEnds::read_csv(thigh_tables::ATTACHMENTS, Path::new("attachments.csv"))?,
        Some(file) => MuscleEnds::read_csv(&text(file)?, file)?,
    };
    let known: Vec<String> = ends.iter().map(|m| m.muscle.clone()).collect();
    only_known(&arguments.only, &known)?;
    ends.retain(|m| arguments.only.is_empty() || arguments.only.contains(&m.muscle));
    let bones = arguments.bones.clone().unwrap_or_else(|| folder.join("..").join("bones"));
    let unit = if arguments.unit == "mm" { LengthUnit::Millimetre } else { LengthUnit::Metre };
    let anatomy = Anatomy::read(folder, &bones, &ends, unit, &Settings::default())?;
    for (muscle, fit) in anatomy.muscles.iter().zip(&anatomy.fits).filter(|(_, fit)| !fit.is_good()) {
        eprintln!(
            "warning: {} is not mapped well: 95 % of its loft within {:.2} mm of the surface, {:.0} % of the volume",
            muscle.name,
            fit.p95 * 1e3,
            fit.coverage() * 100.0
        );
    }
    let left_out: Vec<_> = anatomy.left_out.iter().filter_map(|file| file.file_name()?.to_str()).collect();
    if arguments.only.is_empty() && !left_out.is_empty() {
        eprintln!("note: not meshed, as --ends does not name them: {}", left_out.join(", "));
    }
    Ok((anatomy.muscles, anatomy.bones, arguments.ends.iter().cloned().chain(anatomy.files).collect()))
}

/// Refuses names of `--only` that are not known.
fn only_known(only: &[String], known: &[String]) -> Result<(), CommandError> {
    match only.iter().find(|name| !known.contains(name)) {
        Some(unknown) => Err(CommandError::Option(format!(
            "--only names `{unknown}`, which the sections lack; they have {}",
            known.join(", ")
        ))),
        None => Ok(()),
    }
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
