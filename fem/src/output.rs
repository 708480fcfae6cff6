//! A run as files that a person can follow: frames in [parts](crate::parts), a collection that grows, a log, and how it ended.
//!
//! | file | what | when |
//! |---|---|---|
//! | `NAME_0000_PART.vtu` … | the parts of a solved frame: solids, fibres, membranes, strands, bones | as it is solved |
//! | `NAME.pvd` | the frames so far, for ParaView | after every frame |
//! | `iterations.csv` | a row per Newton iteration | at the end (`iterations.csv.part` before) |
//! | `NAME_0000.state` … | what [`run_restartable`] goes on from | after every frame, removed by the caller |
//! | `NAME_unsolved.pvd`, `NAME_unsolved_PART.vtu` … | the last good state before a frame that has no equilibrium, bones that nothing is tied to left out | when that happens |
//! | `NAME.json` | how the run ended: island, element or node and reason of a failure | last |
//!
//! Every file appears complete or not at all. A folder without `NAME.json` holds a run that is going on or was killed.

use crate::mesh::MeshError;
use crate::mesh::format::{pvd::PvdWriter, write_whole};
use crate::nested::{CoarseRun, advance_led};
use crate::parts::{Beside, PARTS, parts};
use crate::plan::Plan;
use crate::run::{Drive, Frame, Run, Step, run_steps};
use crate::solve::{IterationLog, Motion, Settings, SolveError};
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// What could not be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OutputError {
    /// A frame or the collection.
    #[error("cannot write {0}")]
    Mesh(#[from] MeshError),
    /// Another file.
    #[error("cannot write {}: {source}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What the operating system answered.
        source: std::io::Error,
    },
}

/// [`crate::run::run`] that writes the files of the [module](self) to `folder`; those of an earlier run of this name are
/// removed first. One run per folder, because of `iterations.csv`.
///
/// A run that finds no equilibrium is `Ok`, with [`Run::errors`]; an error is a file that could not be written, which stops the
/// run. `on_frame` sees every solved frame when it is written.
pub fn run_to_files(
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    start: Option<&[f64]>,
    folder: &Path,
    name: &str,
    on_frame: &mut dyn FnMut(&Frame),
) -> Result<Run, OutputError> {
    let mut files = RunFiles::create(folder, name, Beside::default())?;
    let mut written = Ok(());
    let run = run_steps(plan, drive, settings, start, &mut |step| {
        written = files.write(plan, step);
        if written.is_err() {
            return ControlFlow::Break(());
        }
        if step.errors.is_empty() {
            on_frame(step.frame);
        }
        ControlFlow::Continue(())
    });
    written?;
    files.finish(plan, drive, &run)?;
    Ok(run)
}

/// How a run can be gone on with when it is killed.
#[derive(Clone, Copy, Debug)]
pub struct Restart<'a> {
    /// Says everything that the run depends on: states with another key are not taken over.
    pub key: &'a str,
    /// Whether to take over the states in the folder; else they are removed.
    pub resume: bool,
}

/// [`run_to_files`] that stores the state after every frame and takes over those of a killed run, if asked to. The result is the same to
/// the last bit, as every frame has new solvers. `led`: a run on a coarser mesh that shows the way. The states stay when the run is over ([`crate::restart::remove_states`]).
pub fn run_restartable(
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    folder: &Path,
    name: &str,
    beside: &Beside,
    restart: Restart,
    led: Option<&CoarseRun>,
    on_frame: &mut dyn FnMut(&Frame),
) -> Result<Run, OutputError> {
    let mut files = RunFiles::create(folder, name, beside.clone())?;
    if !restart.resume {
        crate::restart::remove_states(folder, name).map_err(|source| at(folder, source))?;
    }
    let mut run = Run::default();
    let mut resuming = restart.resume;
    for (k, to) in drive.frames.iter().enumerate() {
        let n = 3 * plan.mesh.points.len();
        let stored = resuming.then(|| crate::restart::load(folder, name, restart.key, k, n, to)).flatten();
        resuming = stored.is_some();
        run.taken_over += usize::from(resuming);
        let done = match stored {
            Some(done) => done,
            None => match advance_led(plan, settings, run.frames.last(), k, to, led) {
                Ok(done) => done,
                Err(error) => {
                    run.errors = vec![error];
                    break;
                }
            },
        };
        files
            .write(plan, &Step { frame: &done.frame, iterations: &done.iterations, errors: &done.errors })?;
        if done.errors.is_empty() && !resuming {
            crate::restart::save(folder, name, restart.key, k, &done)?;
        }
        if !run.take(done) {
            break;
        }
        run.frames.last().into_iter().for_each(&mut *on_frame);
    }
    files.finish(plan, drive, &run)?;
    Ok(run)
}

/// Writes the files of a run that is over, as [`run_to_files`] does of one that is going on. States stay.
pub fn write_run(
    plan: &Plan,
    drive: &Drive,
    run: &Run,
    folder: &Path,
    name: &str,
    beside: &Beside,
) -> Result<(), OutputError> {
    let mut files = RunFiles::create(folder, name, beside.clone())?;
    let unsolved = run.unsolved.iter().map(|frame| (frame, run.errors.as_slice()));
    let frames = run.frames.iter().map(|frame| (frame, &[][..])).chain(unsolved);
    for (k, (frame, errors)) in frames.enumerate() {
        let iterations: Vec<_> = run.iterations.iter().filter(|row| row.step == k).cloned().collect();
        files.write(plan, &Step { frame, iterations: &iterations, errors })?;
    }
    files.finish(plan, drive, run)
}

/// The files of a run that is going on.
struct RunFiles {
    series: PvdWriter,
    beside: Beside,
    /// Frames so far.
    frames: usize,
    log: IterationLog,
    log_file: PathBuf,
    /// `NAME_unsolved.pvd`.
    unsolved: PathBuf,
    /// `NAME.json`.
    summary: PathBuf,
}

impl RunFiles {
    fn create(folder: &Path, name: &str, beside: Beside) -> Result<RunFiles, OutputError> {
        let summary = folder.join(format!("{name}.json"));
        remove(&summary)?;
        let series = PvdWriter::create(folder, name)?;
        remove_frames(folder, name)?;
        let log_file = folder.join("iterations.csv");
        let log = IterationLog::create(folder).map_err(|source| at(&log_file, source))?;
        let unsolved = folder.join(format!("{name}_{UNSOLVED}.pvd"));
        Ok(RunFiles { series, beside, frames: 0, log, log_file, unsolved, summary })
    }

    fn write(&mut self, plan: &Plan, step: &Step) -> Result<(), OutputError> {
        self.log.write(step.iterations).map_err(|source| at(&self.log_file, source))?;
        let time = self.beside.time(self.frames, step.frame.time);
        if step.errors.is_empty() {
            self.series.push_parts(time, &parts(plan, step.frame, &self.beside, Some(self.frames)))?;
        } else {
            // Bones beside the plan stand in a frame, this state somewhere before it.
            self.series.write_apart(UNSOLVED, time, &parts(plan, step.frame, &self.beside, None))?;
        }
        self.frames += 1;
        Ok(())
    }

    fn finish(self, plan: &Plan, drive: &Drive, run: &Run) -> Result<(), OutputError> {
        self.log.finish().map_err(|source| at(&self.log_file, source))?;
        let file_name = |file: &Path| file.file_name().map(|n| n.to_string_lossy().into_owned());
        let mut summary = json!({
            "status": if run.is_solved() { "solved" } else { "not converged" },
            "frames_solved": run.frames.len(),
            "frames_asked": drive.frames.len(),
            "islands": plan.islands.iter().map(|i| i.name.as_str()).collect::<Vec<_>>(),
            "newton_iterations": run.iterations.len(),
        });
        if let Some(worst) = run.worst() {
            summary["worst_residual"] = json!({
                "island": plan.islands[worst.island].name, "frame": worst.frame, "residual_N": worst.advance.residual,
                "wanted_residual_N": worst.advance.wanted, "forces_in_play_N": worst.advance.force_scale,
            });
        }
        if let Some(motion) = in_time(run) {
            summary["explicit"] = motion;
        }
        summary["loose_load_steps"] = json!(run.count(|island| island.loose_steps));
        summary["frames_tested_for_stability"] = json!(run.frames_tested_for_stability());
        let overlaps = run.frames.iter().enumerate().flat_map(|(k, frame)| {
            let told = move |(pair, n): &([String; 2], usize)| json!({ "frame": k, "pair": pair, "pairs_of_triangles": n });
            frame.prescribed_overlaps.iter().map(told)
        });
        summary["prescribed_overlaps"] = overlaps.collect();
        if let Some(frame) = &run.unsolved {
            summary["unsolved_time"] = json!(self.beside.time(run.frames.len(), frame.time));
            summary["last_good_state"] = json!(file_name(&self.unsolved));
        }
        if !run.is_solved() {
            summary["failures"] = run.errors.iter().map(failure).collect();
        }
        let text = format!("{summary:#}\n");
        Ok(write_whole(&self.summary, text.as_bytes())?)
    }
}

/// What explicit dynamics says of all frames: the most that was added and missing, and what is to be said of it; `None` where nothing moved so.
fn in_time(run: &Run) -> Option<serde_json::Value> {
    let motions = || run.frames.iter().flat_map(|f| &f.islands).filter_map(|island| island.motion.as_ref());
    motions().next()?;
    let most = |of: &dyn Fn(&Motion) -> f64| motions().map(of).fold(0.0, f64::max);
    let (missing, in_play) = (most(&|m| m.missing().abs()), most(&Motion::in_play));
    let shortest = motions().map(|m| m.time_step).fold(f64::INFINITY, f64::min);
    Some(json!({
        "time_steps": motions().map(|m| m.steps).sum::<usize>(),
        "shortest_time_step_s": shortest,
        "added_mass_fraction": most(&Motion::added),
        "missing_energy_J": missing,
        "energy_in_play_J": in_play,
        "dissipated_J": motions().map(|m| m.dissipated).sum::<f64>(),
        "work_J": motions().map(|m| m.work).sum::<f64>(),
        "warnings": motions().filter_map(Motion::warning).collect::<std::collections::BTreeSet<_>>(),
    }))
}

/// Label of the last good state before a frame that has no equilibrium.
const UNSOLVED: &str = "unsolved";

/// Removes the frames of an earlier run.
fn remove_frames(folder: &Path, name: &str) -> Result<(), OutputError> {
    let old = |entry: &str| {
        let rest = entry.strip_prefix(name).and_then(|rest| rest.strip_prefix('_'));
        let whole = rest.map(|r| r.strip_suffix(".part").unwrap_or(r));
        let stem = whole.and_then(|r| r.strip_suffix(".vtu").or(r.strip_suffix(".pvd")));
        let frame = |s: &str| s == UNSOLVED || (s.len() >= 4 && s.bytes().all(|b| b.is_ascii_digit()));
        let parted = |s: &str| s.split_once('_').is_some_and(|(s, part)| frame(s) && PARTS.contains(&part));
        stem.is_some_and(|s| frame(s) || parted(s))
    };
    let entries = std::fs::read_dir(folder).map_err(|source| at(folder, source))?;
    for entry in entries {
        let entry = entry.map_err(|source| at(folder, source))?;
        if entry.file_name().to_str().is_some_and(old) {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

/// Removes all that a run of this name left in a folder, and the folder where nothing else is in it.
pub fn remove_run(folder: &Path, name: &str) -> Result<(), OutputError> {
    if !folder.exists() {
        return Ok(());
    }
    // First what says that the run is complete.
    for file in
        [format!("{name}.json"), format!("{name}.pvd"), "iterations.csv".into(), "iterations.csv.part".into()]
    {
        remove(&folder.join(file))?;
    }
    remove_frames(folder, name)?;
    crate::restart::remove_states(folder, name).map_err(|source| at(folder, source))?;
    let _ = std::fs::remove_dir(folder); // not empty: something of the user's is there
    Ok(())
}

/// Island, place and reason of a failure.
fn failure(error: &SolveError) -> Value {
    let message = error.to_string();
    match error {
        SolveError::Inadmissible { island, step, place, det_f } => json!({
            "island": island, "frame": step, "place": place, "least_det_f": det_f,
            "reason": "the start is inadmissible", "message": message,
        }),
        SolveError::WentThrough { step, pairs } => json!({
            "frame": step, "pairs": pairs, "reason": "bodies went through each other", "message": message,
        }),
        SolveError::NoRoom { step, pairs } => json!({
            "frame": step, "pairs": pairs, "reason": "prescribed faces overlap", "message": message,
        }),
        SolveError::Folded { island, step, place, det_f } => json!({
            "island": island, "frame": step, "place": place, "least_det_f": det_f,
            "reason": "what is prescribed turns an element inside out", "message": message,
        }),
        SolveError::Load { step, .. } => json!({
            "frame": step, "reason": "the load is not one of the plan, or not finite", "message": message,
        }),
        SolveError::Unsupported { island, parts } => json!({
            "island": island, "parts": parts.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "reason": "moves without resistance", "message": message,
        }),
        SolveError::Settings { mistakes } => json!({
            "reason": "bad settings", "mistakes": mistakes, "message": message,
        }),
        SolveError::Count { what, found, needed } => json!({
            "reason": "wrong length", "list": what, "found": found, "needed": needed, "message": message,
        }),
        SolveError::NoTime { step, from, to } => json!({
            "frame": step, "from_s": from, "to_s": to, "reason": "no time passes", "message": message,
        }),
        SolveError::NotConverged(e) => json!({
            "island": e.island, "frame": e.step, "load": e.load, "reason": e.reason.to_string(),
            "place": e.place, "least_det_f": e.det_f, "iterations": e.iterations,
            "residual_N": e.residual, "wanted_residual_N": e.wanted, "message": message,
        }),
    }
}

fn at(file: &Path, source: std::io::Error) -> OutputError {
    OutputError::File { file: file.into(), source }
}

/// Removes a file of an earlier run.
fn remove(file: &Path) -> Result<(), OutputError> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(at(file, e)),
        _ => Ok(()),
    }
}
