//! A run as files that a person can follow: a `.vtu` per frame, a collection that grows, a log, and how it ended.
//!
//! | file | what | when |
//! |---|---|---|
//! | `NAME_0000.vtu` … | a solved frame | as it is solved |
//! | `NAME.pvd` | the frames so far, for ParaView | after every frame |
//! | `iterations.csv` | a row per Newton iteration | at the end (`iterations.csv.part` before) |
//! | `NAME_0000.state` … | what [`run_restartable`] goes on from | after every frame, removed by the caller |
//! | `NAME_unsolved.vtu` | the last good state before a frame that has no equilibrium | when that happens |
//! | `NAME.json` | how the run ended: island, element or node and reason of a failure | last |
//!
//! Every file appears complete or not at all. A folder without `NAME.json` holds a run that is going on or was killed.

#![allow(non_snake_case)]

use crate::measure::{contact_tractions, fibre_states, solid_field};
use crate::mesh::format::{pvd::PvdWriter, vtu, write_whole};
use crate::mesh::{CellKind, MeshError};
use crate::plan::Plan;
use crate::run::{Advanced, Drive, Frame, Run, Session, Step, run_steps};
use crate::solve::{IterationLog, Settings, SolveError};
use serde_json::{Value, json};
use std::collections::BTreeSet;
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
    let mut files = RunFiles::create(folder, name)?;
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
/// the last bit, as every frame has new solvers. The states stay when the run is over ([`crate::restart::remove_states`]).
pub fn run_restartable(
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    folder: &Path,
    name: &str,
    restart: Restart,
    on_frame: &mut dyn FnMut(&Frame),
) -> Result<Run, OutputError> {
    let mut files = RunFiles::create(folder, name)?;
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
            None => {
                let session = match run.frames.last() {
                    None => Session::new(plan, settings, None),
                    Some(frame) => Session::from_frame(plan, settings, frame, k - 1),
                };
                match session {
                    Ok(mut session) => session.advance(to),
                    Err(error) => {
                        run.errors = vec![error];
                        break;
                    }
                }
            }
        };
        files
            .write(plan, &Step { frame: &done.frame, iterations: &done.iterations, errors: &done.errors })?;
        if done.errors.is_empty() && !resuming {
            crate::restart::save(folder, name, restart.key, k, &done)?;
        }
        let Advanced { frame, errors, iterations } = done;
        run.iterations.extend(iterations);
        if !errors.is_empty() {
            run.errors = errors;
            run.unsolved = Some(frame);
            break;
        }
        on_frame(&frame);
        run.frames.push(frame);
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
) -> Result<(), OutputError> {
    let mut files = RunFiles::create(folder, name)?;
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
    log: IterationLog,
    log_file: PathBuf,
    /// `NAME_unsolved.vtu`.
    unsolved: PathBuf,
    /// `NAME.json`.
    summary: PathBuf,
}

impl RunFiles {
    fn create(folder: &Path, name: &str) -> Result<RunFiles, OutputError> {
        let summary = folder.join(format!("{name}.json"));
        remove(&summary)?;
        let series = PvdWriter::create(folder, name)?;
        remove_frames(folder, name)?;
        let log_file = folder.join("iterations.csv");
        let log = IterationLog::create(folder).map_err(|source| at(&log_file, source))?;
        Ok(RunFiles { series, log, log_file, unsolved: folder.join(format!("{name}_unsolved.vtu")), summary })
    }

    fn write(&mut self, plan: &Plan, step: &Step) -> Result<(), OutputError> {
        self.log.write(step.iterations).map_err(|source| at(&self.log_file, source))?;
        let (points, cells) = fields(plan, step.frame);
        if step.errors.is_empty() {
            self.series.push(step.frame.time, &plan.mesh, &points, &cells)?;
        } else {
            vtu::write(&self.unsolved, &plan.mesh, &points, &cells)?;
        }
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
        summary["loose_load_steps"] = json!(run.count(|island| island.loose_steps));
        summary["frames_tested_for_stability"] =
            json!(run.frames.iter().filter(|f| f.islands.iter().all(|i| i.tested_stable)).count());
        if let Some(frame) = &run.unsolved {
            summary["unsolved_time"] = json!(frame.time);
            summary["last_good_state"] = json!(file_name(&self.unsolved));
        }
        if !run.is_solved() {
            summary["failures"] = run.errors.iter().map(failure).collect();
        }
        let text = format!("{summary:#}\n");
        Ok(write_whole(&self.summary, text.as_bytes())?)
    }
}

/// Removes the frames of an earlier run.
fn remove_frames(folder: &Path, name: &str) -> Result<(), OutputError> {
    let old = |entry: &str| {
        let rest = entry.strip_prefix(name).and_then(|rest| rest.strip_prefix('_'));
        let stem = rest.and_then(|r| r.strip_suffix(".part").unwrap_or(r).strip_suffix(".vtu"));
        stem.is_some_and(|s| s == "unsolved" || (s.len() >= 4 && s.bytes().all(|b| b.is_ascii_digit())))
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

/// What a frame shows: at the nodes `displacement_m`, with inertia `velocity_m_per_s`, and `contact_pressure_Pa` (force per reference area) on surfaces in contact; in solid cells `von_mises_Pa`, `pressure_Pa` and `volume_ratio`; in lines
/// that carry fibres or strands under the name of their block `stretch` and `force_N`; not a number elsewhere.
pub fn fields(plan: &Plan, frame: &Frame) -> (Vec<vtu::Field<'static>>, Vec<vtu::Field<'static>>) {
    let displacement: Vec<f64> = frame.x.iter().zip(plan.reference()).map(|(x, X)| x - X).collect();
    let n = plan.mesh.n_cells();
    let mut columns = ["von_mises_Pa", "pressure_Pa", "volume_ratio", "stretch", "force_N"]
        .map(|name| (name, vec![f64::NAN; n]));
    let mut first = 0;
    for block in &plan.mesh.blocks {
        if let Some(cells) = solid_field(plan, frame.snapshot(), &block.name) {
            for (cell, state) in (first..).zip(cells) {
                let [a, b, c] = state.principal;
                columns[0].1[cell] = (((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2)) / 2.0).sqrt();
                columns[1].1[cell] = -(a + b + c) / 3.0;
                columns[2].1[cell] = state.volume_ratio;
            }
        } else if block.kind == CellKind::Line2
            && let Some(lines) = fibre_states(plan, frame.snapshot(), &block.name)
            && lines.len() == block.n_cells()
        {
            for (cell, state) in (first..).zip(lines) {
                columns[3].1[cell] = state.stretch;
                columns[4].1[cell] = state.force;
            }
        }
        first += block.n_cells();
    }
    let field = |(name, values): (&'static str, Vec<f64>), components| vtu::Field {
        name: name.into(),
        components,
        values: values.into(),
    };
    let mut points = vec![field(("displacement_m", displacement), 3)];
    if !frame.v.is_empty() {
        points.push(field(("velocity_m_per_s", frame.v.clone()), 3));
    }
    let surfaces: BTreeSet<&str> = plan
        .islands
        .iter()
        .filter_map(|island| island.contact.as_ref())
        .flat_map(|contact| contact.surfaces.list.iter().map(|s| s.name.as_str()))
        .collect();
    if !surfaces.is_empty() {
        let mut pressure = vec![f64::NAN; plan.mesh.points.len()];
        for (node, t) in surfaces.iter().flat_map(|s| contact_tractions(plan, frame.snapshot(), s)) {
            pressure[node as usize] = t.iter().map(|c| c * c).sum::<f64>().sqrt();
        }
        points.push(field(("contact_pressure_Pa", pressure), 1));
    }
    let filled = columns.into_iter().filter(|(_, values)| values.iter().any(|v| !v.is_nan()));
    (points, filled.map(|column| field(column, 1)).collect())
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
