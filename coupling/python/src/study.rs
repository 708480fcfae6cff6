//! A study, run by run: what Dask carries out.

use std::path::PathBuf;
use std::time::Duration;

use command::cli::collect;
use command::output::atomic::OutputFolder;
use command::output::claim::{Claim, Identity};
use coupling::study::Study as CoreStudy;
use coupling::study::run::forget;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::errors::{InputError, NotConverged, bad, of_input};

/// What `sartorius.Study` documents.
#[pyclass(frozen, module = "sartorius._core")]
pub(crate) struct Study {
    study: CoreStudy,
    file: PathBuf,
}

#[pymethods]
impl Study {
    /// `text`: where the file itself is not at hand; its path tells the folder.
    #[new]
    #[pyo3(signature = (file, data, text))]
    fn new(file: PathBuf, data: Option<PathBuf>, text: Option<String>) -> PyResult<Study> {
        let study = match text {
            Some(text) => CoreStudy::parse(&file, &text, data.as_deref()),
            None => CoreStudy::read(&file, data.as_deref()),
        };
        Ok(Study { study: study.map_err(of_input)?, file })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.study.name
    }

    #[getter]
    fn text(&self) -> &str {
        &self.study.text
    }

    #[getter]
    fn n_runs(&self) -> usize {
        self.study.n_runs()
    }

    /// Hash of all that the runs depend on, this program included.
    fn key(&self, py: Python<'_>) -> String {
        py.detach(|| self.study.key())
    }

    /// Runs that are not done below `out`.
    fn missing(&self, py: Python<'_>, key: &str, out: PathBuf) -> Vec<usize> {
        py.detach(|| {
            (0..self.study.n_runs()).filter(|run| CoreStudy::done(&out, key, *run).is_none()).collect()
        })
    }

    /// Carries out one run; returns how it ended and how long it took \[s\].
    fn carry_out(
        &self,
        py: Python<'_>,
        key: &str,
        run: usize,
        out: PathBuf,
    ) -> PyResult<(&'static str, f64)> {
        if run >= self.study.n_runs() {
            return Err(bad(format!(
                "run {run}: the study has {} runs, counted from 0",
                self.study.n_runs()
            )));
        }
        let done = py.detach(|| self.study.carry_out(key, run, &out));
        let done = done.map_err(|e| PyOSError::new_err(format!("run {run} in {}: {e}", out.display())))?;
        Ok((done.status.name(), done.seconds))
    }

    /// Notes that a run has no results because its worker ended.
    fn note_killed(&self, key: &str, run: usize, out: PathBuf, reason: String) -> PyResult<()> {
        self.study.note_killed(key, run, &out, reason).map_err(|e| PyOSError::new_err(e.to_string()))
    }

    /// Reserves the folder; nobody else writes a study to it as long as the result lives.
    fn claim(&self, out: PathBuf, resume: bool, force: bool) -> PyResult<Claimed> {
        let refused = |e: command::output::OutputError| InputError::new_err(e.to_string());
        let claim = Claim::new(&out, Identity::new("study", &self.study.name), force).map_err(refused)?;
        let folder = OutputFolder::begin(claim, true).map_err(refused)?;
        if !resume {
            forget(&out).map_err(|e| PyOSError::new_err(format!("{}: {e}", out.display())))?;
        }
        Ok(Claimed { folder: std::sync::Mutex::new(Some(folder)) })
    }

    /// Writes tables and page; returns how many runs the study has, how many are done, and how many solved.
    fn collect(
        &self,
        py: Python<'_>,
        key: &str,
        claimed: &Claimed,
        seconds: f64,
    ) -> PyResult<(usize, usize, usize)> {
        let folder = claimed.folder.lock().ok().and_then(|mut folder| folder.take());
        let folder = folder.ok_or_else(|| bad("the folder of the study was collected already"))?;
        let took = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let collected = py.detach(|| collect(&self.study, key, folder, &self.file, took));
        let [all, done, solved] = collected
            .map_err(|e| match e.exit_code() {
                3 => NotConverged::new_err(e.to_string()),
                _ => InputError::new_err(e.to_string()),
            })?
            .runs;
        Ok((all, done, solved))
    }
}

/// The folder of a study, reserved.
#[pyclass(frozen, module = "sartorius._core")]
pub(crate) struct Claimed {
    folder: std::sync::Mutex<Option<OutputFolder>>,
}
