//! What a run writes: tables, files for OpenSim users, the report page and, last of all, `run.json`.

pub mod atomic;
pub mod claim;
pub mod compare;
pub mod cost;
pub mod deep_flexion;
pub mod mesh;
pub mod opensim;
pub mod origin;
pub mod run;
pub mod solve;
pub mod sto;
pub mod study;
pub mod tables;

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use thiserror::Error;

use crate::report::OptimizeReport;
use crate::report::both::{BothLegs, both_page};
use atomic::OutputFolder;
use claim::LEG_FOLDERS;
use coupling::subject::words;
use run::RunRecord;
use tables::Series;

/// Why results could not be written or an input could not be described.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The file system refused.
    #[error("cannot {action} {path}: {source}{remedy}")]
    Io {
        /// What was attempted, e.g. `write`.
        action: &'static str,
        /// File or folder.
        path: PathBuf,
        /// The word of the operating system.
        source: io::Error,
        /// What may help, with a leading separator; empty where nothing is known.
        remedy: &'static str,
    },
    /// The folder holds something that is not ours.
    #[error(
        "{path} holds `{entry}` and no run of sartorius: results go to a new or an empty folder; choose another with --out"
    )]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// Something in it.
        entry: String,
    },
    /// The folder holds a run of another command or scene.
    #[error(
        "{path} holds `{found}`, not `{wanted}`: choose another folder with --out, or replace what is there with --force"
    )]
    OtherRun {
        /// The folder.
        path: PathBuf,
        /// Command and scene of the run there.
        found: String,
        /// Those of this run.
        wanted: String,
    },
    /// Another process fills the folder.
    #[error(
        "another run of sartorius{holder} writes to {path}: wait until it ends, or choose another folder with --out"
    )]
    Busy {
        /// The folder.
        path: PathBuf,
        /// Which process, with a leading space; empty where that is unknown.
        holder: String,
    },
}

impl OutputError {
    pub(crate) fn at(action: &'static str, path: &Path, source: io::Error) -> OutputError {
        use io::ErrorKind::*;
        let remedy = match source.kind() {
            StorageFull | QuotaExceeded => {
                "; the disk is full: free some space or choose another folder with --out"
            }
            PermissionDenied | ReadOnlyFilesystem => "; choose a folder that may be written to with --out",
            NotADirectory | AlreadyExists => "; a file is in the way: choose another folder with --out",
            _ => "",
        };
        OutputError::Io { action, path: path.to_path_buf(), source, remedy }
    }
}

/// Names of the files of a folder, sorted; none where it is absent.
fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Writes everything that `optimize` promises into `out` and returns the names of the files, `run.json` last.
///
/// `record` comes with the stages timed so far; the time for writing is added here. All files but `run.json`
/// hold the same bytes for the same results.
pub fn write_optimize(
    mut out: OutputFolder,
    report: &OptimizeReport,
    mut record: RunRecord,
) -> Result<Vec<String>, OutputError> {
    let started = Instant::now();
    write_leg(&mut out, "", report)?;
    record.notes = report.notes.to_vec();
    record.verdict = serde_json::to_value(crate::report::Summary::of(report)).ok();
    finish(out, &mut record, started)
}

/// The same for the right and the left leg of a trial, each in a [folder of its own](claim::LEG_FOLDERS), with a page of both beside them.
/// `record` speaks for both.
pub fn write_both_legs(
    mut out: OutputFolder,
    legs: &[OptimizeReport; 2],
    mut record: RunRecord,
) -> Result<Vec<String>, OutputError> {
    let started = Instant::now();
    for (folder, report) in LEG_FOLDERS.iter().zip(legs) {
        write_leg(&mut out, &format!("{folder}/"), report)?;
    }
    let page = both_page([&legs[0], &legs[1]]);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    for (side, leg) in LEG_FOLDERS.iter().zip(legs) {
        record.notes.extend(leg.notes.iter().map(|note| format!("{side} leg: {note}")));
    }
    record.verdict = serde_json::to_value(BothLegs::of(legs)).ok();
    finish(out, &mut record, started)
}

/// Tables, files for OpenSim users and the page of one leg. `within`: what comes before their names, empty or a folder with its slash.
fn write_leg(out: &mut OutputFolder, within: &str, report: &OptimizeReport) -> Result<(), OutputError> {
    let name = &report.trial.name;
    let who = words(report.trial);
    let at = |file: &str| format!("{within}{file}");

    let kinematics = tables::kinematics(report.motion);
    let forces = tables::muscle_forces(report.effort);
    let activations = tables::activations(report.effort);
    write_csv(out, &at("kinematics"), &kinematics)?;
    write_csv(out, &at("muscle_forces"), &forces)?;
    write_csv(out, &at("activations"), &activations)?;
    write_csv(out, &at("joint_forces"), &tables::joint_forces(report.effort))?;
    let with_thigh = report.with_thigh.map(|with| &with.effort);
    write_if_any(out, &at("muscle_forces_with_thigh"), with_thigh.map(tables::muscle_forces))?;
    write_if_any(out, &at("joint_forces_with_thigh"), with_thigh.map(tables::joint_forces))?;
    write_csv(out, &at("joint_moments"), &tables::joint_moments(report.loads))?;
    write_csv(out, &at("ground_reaction"), &tables::ground_reaction(report.loads))?;
    out.write(&at("verdicts.csv"), |w| tables::write_verdicts(w, report.motion, report.effort))?;
    write_if_any(out, &at("reserves"), tables::reserves(report.effort))?;
    write_if_any(out, &at("least_violation"), tables::least_violation(report.effort))?;
    let time = &report.effort.time;
    let bands = report.bands.map(|bands| tables::joint_force_bounds(time, bands));
    write_if_any(out, &at("joint_force_bounds"), bands)?;
    let passive = report.passive.map(|passive| tables::passive_moments(time, passive));
    write_if_any(out, &at("passive_moments"), passive)?;
    write_if_any(out, &at("emg"), report.emg.map(|compared| tables::emg(time, compared)))?;
    match report.emg {
        Some(compared) => {
            out.write(&at("emg_concordance.csv"), |w| tables::write_concordance(w, compared))?;
        }
        None => out.remove(&at("emg_concordance.csv"))?,
    }
    write_if_any(out, &at("joint_force_samples"), report.samples.map(tables::sampled_forces))?;
    match report.samples {
        Some(samples) => {
            out.write(&at("samples.csv"), |w| tables::write_samples(w, samples))?;
            out.write(&at("sobol.csv"), |w| tables::write_sobol(w, samples))?;
        }
        None => {
            out.remove(&at("samples.csv"))?;
            out.remove(&at("sobol.csv"))?;
        }
    }
    write_if_any(out, &at("measured_knee"), report.measured.map(tables::measured_knee))?;

    let side = report.trial.side;
    let forces = forces.without_units();
    let generic_forces = opensim::renamed(&forces, side);
    let generic_activations = opensim::renamed(&activations, side);
    let angles = tables::angles(report.motion);
    let mut storage = vec![
        ("kinematics.sto", &angles, true),
        ("muscle_forces.sto", &forces, false),
        ("activations.sto", &activations, false),
        ("gait2392_muscle_forces.sto", &generic_forces, false),
        ("gait2392_activations.sto", &generic_activations, false),
    ];
    storage.extend(report.gait2392.map(|motion| ("gait2392_motion.mot", motion, true)));
    for (file, series, degrees) in storage {
        let stem = file.split('.').next().unwrap_or(file);
        out.write(&at(file), |w| sto::write(w, &format!("{name} {stem} ({who})"), series, degrees))?;
    }
    let names = std::iter::zip(&report.effort.forces.columns, report.muscles);
    let names: Vec<(&str, &str)> = names.map(|(name, m)| (name.as_str(), m.full_name.as_str())).collect();
    out.write(&at("gait2392_names.csv"), |w| opensim::write_names(w, &names, side))?;
    let page = crate::report::optimize_page(report);
    out.write(&at("report.html"), |w| w.write_all(page.as_bytes()))?;
    Ok(())
}

/// Completes the record and the folder.
fn finish(out: OutputFolder, record: &mut RunRecord, started: Instant) -> Result<Vec<String>, OutputError> {
    finish_with(out, record, started, Vec::new())
}

/// The same with files that were written past `out`.
fn finish_with(
    out: OutputFolder,
    record: &mut RunRecord,
    started: Instant,
    files: Vec<String>,
) -> Result<Vec<String>, OutputError> {
    record.files = out.files().to_vec();
    record.files.extend(files);
    record.stage("write", started.elapsed());
    record.peak_memory_mib = run::peak_memory_mib();
    out.finish(record)
}

fn write_csv(out: &mut OutputFolder, stem: &str, series: &Series) -> Result<(), OutputError> {
    out.write(&format!("{stem}.csv"), |w| tables::write_csv(w, series))
}

/// Writes an optional table, or removes the one that an earlier run left.
fn write_if_any(out: &mut OutputFolder, stem: &str, series: Option<Series>) -> Result<(), OutputError> {
    match series {
        Some(series) => write_csv(out, stem, &series),
        None => out.remove(&format!("{stem}.csv")),
    }
}
