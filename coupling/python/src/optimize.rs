//! `optimize`: the rigid leg of a trial.

use std::collections::BTreeMap;
use std::path::PathBuf;

use command::output::tables;
use coupling::optimize::{OptimizeOptions, Optimized, optimize_with};
use coupling::options::set_option;
use multibody::error::unknown;
use multibody::shipped::{self, Kind};
use multibody::trial::{Side, Status};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::column;
use crate::errors::{bad, of_core, of_input};
use crate::patience::wait;
use crate::tables::{of_series, to_toml};

/// What `sartorius.optimize` documents; `options` are those of the command line by name.
#[pyfunction]
#[pyo3(signature = (trial, data, side, options, landmarks, strengths, trial_keys, progress))]
#[allow(clippy::too_many_arguments)] // named on the Python side
pub(crate) fn optimize<'py>(
    py: Python<'py>,
    trial: Option<PathBuf>,
    data: Option<PathBuf>,
    side: Option<String>,
    options: &Bound<'py, PyDict>,
    landmarks: Option<BTreeMap<String, [f64; 3]>>,
    strengths: Option<BTreeMap<String, f64>>,
    trial_keys: Option<&Bound<'py, PyDict>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let options = given(trial, data, side, options, landmarks, strengths, trial_keys)?;
    let done = wait(py, progress, move |lap| optimize_with(&options, lap))?.map_err(of_core)?;
    told(py, &done)
}

/// The options of a computation.
fn given(
    trial: Option<PathBuf>,
    data: Option<PathBuf>,
    side: Option<String>,
    named: &Bound<'_, PyDict>,
    landmarks: Option<BTreeMap<String, [f64; 3]>>,
    strengths: Option<BTreeMap<String, f64>>,
    trial_keys: Option<&Bound<'_, PyDict>>,
) -> PyResult<OptimizeOptions> {
    let trial = trial.filter(|t| t.as_os_str() != "walker");
    let trial = trial.map(|t| shipped::find(&t, Kind::Trial)).transpose().map_err(of_input)?;
    let side = match side.as_deref() {
        None => None,
        Some("right") => Some(Side::Right),
        Some("left") => Some(Side::Left),
        Some(other) => return Err(bad(format!("side is `{other}`; give right or left"))),
    };
    let mut options = OptimizeOptions { trial, data, side, ..OptimizeOptions::revised() };
    let mut wrong = Vec::new();
    for (name, value) in named {
        let name: String = name.extract()?;
        if value.is_none() {
            continue;
        }
        let value = to_toml(&value)?;
        if let Err(remedy) = set_option(&mut options, &name, &value) {
            wrong.push(format!("{name} is {value}; {remedy}"));
        }
    }
    for (name, shift) in landmarks.unwrap_or_default() {
        let shift = Vector3::from(shift) * 1e-3;
        if !shift.iter().all(|v| v.is_finite()) {
            wrong.push(format!("landmarks: the shift of `{name}` is no number"));
        } else if !options.changes.landmarks.add(&name, shift) {
            let known = multibody::calibration::shifts::LANDMARKS;
            let remedy = unknown(&name, "known are", known.iter().copied());
            wrong.push(format!("landmarks: there is no `{name}`; {remedy}"));
        }
    }
    let lines = coupling::study::names::muscle_lines();
    for (name, factor) in strengths.unwrap_or_default() {
        if !lines.contains(&name) {
            let remedy = unknown(&name, "known are", lines.iter().map(String::as_str));
            wrong.push(format!("strengths: there is no `{name}`; {remedy}"));
        } else if !(factor.is_finite() && factor >= 0.0) {
            wrong.push(format!("strengths: the factor of `{name}` is {factor}; give a number of at least 0"));
        }
        options.changes.strengths.insert(name, factor);
    }
    for (key, value) in trial_keys.into_iter().flatten() {
        options.changes.trial.insert(key.extract()?, to_toml(&value)?);
    }
    if wrong.is_empty() { Ok(options) } else { Err(bad(wrong.join("\n"))) }
}

/// Everything that was computed, as tables of arrays.
fn told<'py>(py: Python<'py>, done: &Optimized) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    let mut series = vec![
        ("kinematics", tables::kinematics(&done.motion)),
        ("muscle_forces", tables::muscle_forces(&done.effort)),
        ("activations", tables::activations(&done.effort)),
        ("joint_forces", tables::joint_forces(&done.effort)),
        ("joint_moments", tables::joint_moments(&done.loads)),
        ("ground_reaction", tables::ground_reaction(&done.loads)),
    ];
    series.extend(tables::reserves(&done.effort).map(|s| ("reserves", s)));
    series.extend(tables::least_violation(&done.effort).map(|s| ("least_violation", s)));
    for (name, series) in &series {
        told.set_item(name, of_series(py, series)?)?;
    }
    told.set_item("verdicts", verdicts(py, done)?)?;
    let solved = |k: usize| {
        let fit = &done.motion.fit[done.motion.report.start + k];
        done.effort.verdicts[k].status == Status::Solved && fit.failure.is_none()
    };
    let n = done.effort.time.len();
    told.set_item("frames", n)?;
    told.set_item("solved_frames", (0..n).filter(|&k| solved(k)).count())?;
    told.set_item("trial", &done.case.trial.name)?;
    told.set_item("side", done.case.trial.side.name())?;
    told.set_item("mass_kg", done.case.trial.subject.mass)?;
    told.set_item("marker_rms_mm", 1e3 * done.motion.marker_rms())?;
    told.set_item("notes", &done.case.doubts)?;
    let seconds = PyDict::new(py);
    for (stage, took) in &done.stages {
        seconds.set_item(stage, took.as_secs_f64())?;
    }
    told.set_item("seconds", seconds)?;
    Ok(told)
}

/// How every frame ended.
fn verdicts<'py>(py: Python<'py>, done: &Optimized) -> PyResult<Bound<'py, PyDict>> {
    let verdicts = &done.effort.verdicts;
    let fits = &done.motion.fit[done.motion.report.clone()];
    let status = |s: Status| match s {
        Status::Solved => "solved",
        Status::Infeasible => "infeasible",
        Status::Failed => "failed",
    };
    let table = PyDict::new(py);
    table.set_item("time_s", column(py, &done.effort.time)?)?;
    table.set_item("status", verdicts.iter().map(|v| status(v.status)).collect::<Vec<_>>())?;
    table.set_item("reason", verdicts.iter().map(|v| v.reason.clone()).collect::<Vec<_>>())?;
    let numbers = |of: &dyn Fn(usize) -> f64| column(py, &(0..verdicts.len()).map(of).collect::<Vec<f64>>());
    table.set_item("kkt_residual", numbers(&|k| verdicts[k].kkt_residual)?)?;
    table.set_item("equality_residual", numbers(&|k| verdicts[k].equality_residual)?)?;
    table.set_item("reserve_share", numbers(&|k| verdicts[k].reserve_share)?)?;
    table.set_item("active_bounds", verdicts.iter().map(|v| v.active_bounds).collect::<Vec<_>>())?;
    table.set_item("marker_rms_mm", numbers(&|k| 1e3 * fits[k].marker_rms)?)?;
    table.set_item(
        "fit",
        fits.iter().map(|f| f.failure.clone().unwrap_or("fitted".into())).collect::<Vec<_>>(),
    )?;
    Ok(table)
}
