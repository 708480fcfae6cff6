//! What the solver did, a line per iteration: through `tracing` and as `iterations.csv`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// One Newton iteration; without matrices what a stretch of time steps came to.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Iteration {
    /// Name of the island.
    pub island: String,
    /// Step of the run (a frame), as the caller counts.
    pub step: usize,
    /// Load parameter within the step, 0..=1.
    pub load: f64,
    /// Count within the load step; 0 is the state before the first iteration.
    pub iteration: usize,
    /// ‖g‖ \[N\] after the iteration.
    pub residual: f64,
    /// Forces in play \[N\], the scale of the residual.
    pub force_scale: f64,
    /// Potential Π \[J\].
    pub energy: f64,
    /// Fraction of the Newton step taken; in softened contact single nodes may have gone less. Of dynamic relaxation its damping.
    pub step_length: f64,
    /// Least det F.
    pub least_det_f: f64,
    /// Conjugate gradient iterations.
    pub linear_iterations: usize,
    /// Factorizations done for it.
    pub factorizations: usize,
    /// Whether the true Hessian was indefinite and a positive definite one took its place.
    pub projected: bool,
    /// Seconds it took.
    pub seconds: f64,
}

impl Iteration {
    pub(crate) fn trace(&self) {
        tracing::debug!(
            island = %self.island,
            step = self.step,
            load = self.load,
            iteration = self.iteration,
            residual_n = self.residual,
            energy_j = self.energy,
            step_length = self.step_length,
            least_det_f = self.least_det_f,
            linear_iterations = self.linear_iterations,
            factorizations = self.factorizations,
            projected = self.projected,
            seconds = self.seconds,
            "iteration"
        );
    }
}

/// Writes `iterations.csv`: rows go to `iterations.csv.part`, which gets its final name by
/// [`finish`](IterationLog::finish). A run that is killed leaves no `iterations.csv`.
#[derive(Debug)]
pub struct IterationLog {
    path: PathBuf,
    part: PathBuf,
    file: BufWriter<File>,
}

impl IterationLog {
    /// Starts the log in `folder`, which exists; a finished log of an earlier run there is removed.
    pub fn create(folder: &Path) -> std::io::Result<IterationLog> {
        let path = folder.join("iterations.csv");
        let part = folder.join("iterations.csv.part");
        if path.exists() {
            std::fs::remove_file(&path)?;
        }
        let mut file = BufWriter::new(File::create(&part)?);
        writeln!(
            file,
            "island,step,load,iteration,residual_N,force_scale_N,energy_J,step_length,least_det_F,\
             linear_iterations,factorizations,projected,seconds"
        )?;
        Ok(IterationLog { path, part, file })
    }

    /// Appends rows, and puts them on the disk's queue.
    pub fn write(&mut self, rows: &[Iteration]) -> std::io::Result<()> {
        for r in rows {
            let island = r.island.replace([',', '"', '\n'], "_");
            writeln!(
                self.file,
                "{island},{},{},{},{:e},{:e},{:e},{},{},{},{},{},{:.4}",
                r.step,
                r.load,
                r.iteration,
                r.residual,
                r.force_scale,
                r.energy,
                r.step_length,
                r.least_det_f,
                r.linear_iterations,
                r.factorizations,
                r.projected,
                r.seconds
            )?;
        }
        self.file.flush()
    }

    /// Closes the log under its final name.
    pub fn finish(self) -> std::io::Result<PathBuf> {
        let file = self.file.into_inner().map_err(|e| e.into_error())?;
        file.sync_all()?;
        std::fs::rename(&self.part, &self.path)?;
        Ok(self.path)
    }
}
