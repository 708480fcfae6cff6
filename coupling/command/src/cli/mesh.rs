//! `sartorius mesh [INPUT] --resolution MM`.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use fem::mesh::{LengthUnit, MeshError, Place};
use mesher::attachment::{Attachment, Role, Site};
use mesher::from_surface::{Anatomy, MuscleEnds, Settings};
use mesher::{Bone, MuscleSections, build};
use multibody::model::Model;

use super::optimize::find_trial;
use super::progress::Progress;
use super::{OutArguments, Outcome, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::mesh::write_mesh;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus};
use crate::report::mesh::{MeshReport, MeshSummary};
use coupling::number::short;
use coupling::optimize::{Case, OptimizeOptions};
use coupling::steps::{RigidMuscle, rigid_muscles_standing};
use coupling::subject::{factors, limb_map};
use coupling::thigh::build::{ThighEffects, build as build_thigh, reaches, segment_of};
use coupling::thigh::inventory::inventory;
use coupling::thigh::lines::physiological_sections;
use coupling::thigh::registration::{MeshFrames, Registration};
use coupling::thigh::{self, tables};

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
    /// For the built-in thigh: make it as large as the subject of this trial: a trial file, the name of a shipped trial, or `walker`.
    #[arg(long, value_name = "TRIAL")]
    subject: Option<PathBuf>,
    /// Folder of the recordings that the trial file of --subject names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Only these muscles, by name.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    #[command(flatten)]
    out: OutArguments,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &MeshArguments, quiet: bool) -> Result<Outcome, CommandError> {
    if !RESOLUTIONS.contains(&arguments.resolution) {
        return Err(CommandError::Option(format!(
            "--resolution is {} mm; give {} to {} mm",
            arguments.resolution,
            RESOLUTIONS.start(),
            RESOLUTIONS.end()
        )));
    }
    let stem = arguments.input.as_deref().and_then(Path::file_stem);
    let name = stem.map_or("thigh".into(), |stem| stem.to_string_lossy().into_owned());
    let claim = arguments.out.claim("mesh", &name)?;
    let mut progress = Progress::new(&["read", "mesh", "write"], quiet);
    let mut record = RunRecord::new("mesh");
    let input = match &arguments.input {
        Some(_) if arguments.subject.is_some() => {
            return Err(CommandError::Option(
                "--subject scales the built-in thigh; give no input with it".into(),
            ));
        }
        Some(folder) if folder.is_dir() => from_surfaces(folder, arguments)?,
        _ if arguments.ends.is_some() => {
            return Err(CommandError::Option("--ends needs a folder of muscle surfaces as input".into()));
        }
        Some(file) => from_table(file, arguments)?,
        None => built_in(arguments)?,
    };
    let Input { sections, bones, attachments, rigid, subject, files } = input;
    for file in &files {
        record.inputs.push(InputFile::of(file)?);
    }
    progress.lap("read");
    let built = build(&sections, &bones, arguments.resolution / 1000.0);
    progress.lap("mesh");
    record.seconds = progress.seconds().to_vec();
    record.iterations.insert("rounds of separation".into(), built.rounds as u64);

    let bone_names = if bones.is_empty() {
        "none".to_string()
    } else {
        bones.iter().map(|b| b.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let areas = physiological_sections();
    let blocks: Vec<_> = built.muscles.iter().map(|m| &m.block).collect();
    let known = |muscle: &str| if rigid.is_empty() { None } else { areas.get(muscle).copied() };
    let grows = reaches(&bones, BTreeMap::new());
    let stock = inventory(&blocks, &attachments, &known, &grows, &rigid);
    let owned: Vec<_> = blocks.iter().map(|block| (*block).clone()).collect();
    let effects = ThighEffects { fibres: Some(1), shells: true };
    let thigh = build_thigh(&owned, &attachments, &known, &grows, effects);
    let settings = [
        ("Sections".to_string(), if stem.is_some() { name.clone() } else { "built-in thigh".into() }),
        ("Subject".to_string(), subject),
        ("Resolution".to_string(), format!("{} mm", short(arguments.resolution))),
        ("Bones".to_string(), bone_names),
        ("Rounds of separation".to_string(), built.rounds.to_string()),
    ];
    let report = MeshReport {
        name: &name,
        built: &built,
        bones: &bones,
        thigh: &thigh,
        inventory: &stock,
        settings: &settings,
    };
    let summary = MeshSummary::of(&report);
    record.settings = settings.iter().map(|(k, v)| (k.clone(), serde_json::Value::from(v.clone()))).collect();
    record.subject = Some(settings[1].1.clone());
    record.again = Again::as_typed(&record.command_line);
    let outcome = if summary.missed.is_empty() { Outcome::Solved } else { Outcome::NotSolved };
    if outcome == Outcome::NotSolved {
        record.status = RunStatus::NotConverged;
        record.reason = Some(summary.missed.join("; "));
    }
    let folder = claim.path();
    let seconds: f64 = record.seconds.iter().map(|s| s.1).sum();
    let files = write_mesh(OutputFolder::begin(claim, false)?, &report, record)?;
    progress.lap("write");
    drop(progress);
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let _ = writeln!(out, "{}", serde_json::to_string_pretty(&summary).expect("a summary is plain data"));
    } else {
        let _ = print(&mut out, &report, &summary, seconds, &folder, files.len());
    }
    Ok(outcome)
}

/// What is meshed.
struct Input {
    sections: Vec<MuscleSections>,
    /// To keep out of.
    bones: Vec<Bone>,
    attachments: Vec<Attachment>,
    /// The lines of the rigid leg in the posture of the mesh; none where it is unknown how that stands.
    rigid: Vec<RigidMuscle>,
    /// Whose size it has.
    subject: String,
    /// The files read.
    files: Vec<PathBuf>,
}

/// The built-in thigh, in the size of a subject if one is named.
fn built_in(arguments: &MeshArguments) -> Result<Input, CommandError> {
    let mut limb = thigh::limb()?;
    let mut files: Vec<PathBuf> = arguments.bones.iter().cloned().collect();
    if let Some(file) = &arguments.bones {
        limb.bones = Bone::read_csv(&text(file)?, file)?;
    }
    let known: Vec<String> = limb.sections.iter().map(|m| m.name.clone()).collect();
    only_known(&arguments.only, &known)?;
    let trial =
        arguments.subject.as_deref().filter(|s| *s != Path::new("walker")).map(find_trial).transpose()?;
    let case =
        Case::load(&OptimizeOptions { trial, data: arguments.data.clone(), ..OptimizeOptions::default() })?;
    tell(&case.doubts);
    let model = Model::new(&case.trial, case.anatomy.clone(), case.ankle)?;
    let mut subject = "as measured".to_string();
    if arguments.subject.is_some() {
        let f = factors(&model);
        limb = limb.mapped(&limb_map(&f))?;
        subject = format!(
            "{}: pelvis x {:.3}, thigh x {:.3}, shank x {:.3}",
            case.trial.name, f.pelvis, f.thigh, f.shank
        );
        files.extend(case.inputs);
    }
    limb.sections.retain(|m| arguments.only.is_empty() || arguments.only.contains(&m.name));
    // Without a place for the patella there is no posture to compare in.
    let rigid = Registration::new(MeshFrames::built_in(), &model)
        .map(|registration| rigid_muscles_standing(&model, &registration))
        .unwrap_or_default();
    let (sections, bones, attachments) = (limb.sections, limb.bones, limb.attachments);
    Ok(Input { sections, bones, attachments, rigid, subject, files })
}

/// From tables of sections and bones of one's own.
fn from_table(file: &Path, arguments: &MeshArguments) -> Result<Input, CommandError> {
    let mut sections = MuscleSections::read_csv(&text(file)?, file)?;
    let bones = match &arguments.bones {
        Some(file) => Bone::read_csv(&text(file)?, file)?,
        None => Vec::new(),
    };
    let known: Vec<String> = sections.iter().map(|m| m.name.clone()).collect();
    only_known(&arguments.only, &known)?;
    sections.retain(|m| arguments.only.is_empty() || arguments.only.contains(&m.name));
    let files = [file.to_path_buf()].into_iter().chain(arguments.bones.clone()).collect();
    let subject = "as given".to_string();
    Ok(Input { sections, bones, attachments: Vec::new(), rigid: Vec::new(), subject, files })
}

/// From a folder of muscle surfaces and a folder of bone surfaces.
fn from_surfaces(folder: &Path, arguments: &MeshArguments) -> Result<Input, CommandError> {
    let mut ends = match &arguments.ends {
        None => MuscleEnds::read_csv(tables::ATTACHMENTS, Path::new("attachments.csv"))?,
        Some(file) => MuscleEnds::read_csv(&text(file)?, file)?,
    };
    let known: Vec<String> = ends.iter().map(|m| m.muscle.clone()).collect();
    only_known(&arguments.only, &known)?;
    ends.retain(|m| arguments.only.is_empty() || arguments.only.contains(&m.muscle));
    let bones = arguments.bones.clone().unwrap_or_else(|| folder.join("..").join("bones"));
    let unit = if arguments.unit == "mm" { LengthUnit::Millimetre } else { LengthUnit::Metre };
    let anatomy = Anatomy::read(folder, &bones, &ends, unit, &Settings::default())?;
    for (muscle, fit) in anatomy.muscles.iter().zip(&anatomy.fits).filter(|(_, fit)| !fit.is_good()) {
        coupling::say!(
            "warning: {} is not mapped well: 95 % of its loft within {:.2} mm of the surface, {:.0} % of the volume",
            muscle.name,
            fit.p95 * 1e3,
            fit.coverage() * 100.0
        );
    }
    let left_out: Vec<_> = anatomy.left_out.iter().filter_map(|file| file.file_name()?.to_str()).collect();
    if arguments.only.is_empty() && !left_out.is_empty() {
        coupling::say!("note: not meshed, as --ends does not name them: {}", left_out.join(", "));
    }
    Ok(Input {
        sections: anatomy.muscles,
        bones: anatomy.bones,
        attachments: ends.iter().flat_map(end_faces).collect(),
        rigid: Vec::new(),
        subject: "as given".into(),
        files: arguments.ends.iter().cloned().chain(anatomy.files).collect(),
    })
}

/// The end faces of a muscle, where they are known to lie on a bone; of a bone that belongs to no segment of the leg, on a body of
/// its name.
fn end_faces(ends: &MuscleEnds) -> Vec<Attachment> {
    let face = |(role, bone): (Role, &Option<String>)| {
        Some(Attachment {
            muscle: ends.muscle.clone(),
            role,
            site: Site::EndFace,
            segment: segment_of(bone.as_ref()?).unwrap_or(bone.as_ref()?).to_string(),
            bone: bone.clone()?,
            tendon: Vec::new(),
            reference_point: None,
            footprint: None,
        })
    };
    [Role::Origin, Role::Insertion].into_iter().zip(&ends.bones).filter_map(face).collect()
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
    let bytes = std::fs::read(file).map_err(|source| MeshError::Io { file: file.into(), source })?;
    String::from_utf8(bytes).map_err(|error| MeshError::Format {
        file: file.into(),
        place: Place::Byte(error.utf8_error().valid_up_to()),
        reason: "not UTF-8 text; save the table as UTF-8".into(),
    })
}

fn print(
    out: &mut impl Write,
    report: &MeshReport,
    s: &MeshSummary,
    seconds: f64,
    folder: &Path,
    n_files: usize,
) -> std::io::Result<()> {
    writeln!(out, "{}: {} muscles, {} elements, {} nodes", report.name, s.muscles, s.elements, s.nodes)?;
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
    if !report.thigh.tendons.is_empty() {
        let least = report.thigh.tendons.iter().map(|t| t.least_scaled_jacobian).fold(1.0, f64::min);
        writeln!(
            out,
            "  tendons           solid at {}, least scaled Jacobian {least:.2}",
            report.thigh.tendons.iter().map(|t| t.muscle.replace('_', " ")).collect::<Vec<_>>().join(", ")
        )?;
    }
    writeln!(out, "  bones             at most {:.2} mm deep, at attached ends", s.deepest_bone_crossing_mm)?;
    writeln!(
        out,
        "  moved apart       surfaces by {:.2} mm in the mean of a muscle, {:.2} mm at most; volumes by {:.1} %",
        s.largest_mean_move_mm, s.largest_move_mm, s.largest_volume_change_percent
    )?;
    for (muscle, line) in report.inventory.iter().filter_map(|m| Some((m, m.line.as_ref()?))) {
        if !line.explanation.is_empty() {
            writeln!(
                out,
                "  {}: {:.0} degrees off the rigid line; {}",
                muscle.name.replace('_', " "),
                line.angle_deg,
                line.explanation
            )?;
        }
    }
    for missed in &s.missed {
        writeln!(out, "  missed: {missed}")?;
    }
    writeln!(
        out,
        "  computed in {seconds:.1} s; {n_files} files in {}, open report.html there",
        folder.display()
    )
}
