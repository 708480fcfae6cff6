//! `run.json`: verdict, what computed it when and where, from what, how to compute it again, and what it cost.

use std::collections::BTreeMap;
use std::time::Duration;

use multibody::trial::Trial;
use serde::Serialize;

use super::origin::{Again, InputFile, Machine, Program, now};
use coupling::comparison::Comparison;
use coupling::subject::words;
use fem::plan::Plan;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// Every frame solved; exit code 0.
    Solved,
    /// Something did not converge or a verdict failed; exit code 3.
    NotConverged,
}

/// The content of `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunRecord {
    /// The command, e.g. `optimize`.
    pub command: String,
    /// How it ended.
    pub status: RunStatus,
    /// Why, when it is not solved.
    pub reason: Option<String>,
    /// The numbers that decide: the summary that heads the report.
    pub verdict: Option<serde_json::Value>,
    /// How closely the forces of deformable bodies balance; absent where there are none.
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    pub settled: serde_json::Value,
    /// What the reader must know: doubts about the input, warnings about the mesh.
    pub notes: Vec<String>,
    /// Name of the trial.
    pub trial: Option<String>,
    /// Who was recorded.
    pub subject: Option<String>,
    /// What computed this.
    pub program: Program,
    /// When it began, in UTC.
    pub date: String,
    /// Where it was computed.
    pub machine: Machine,
    /// The command line as it was typed.
    pub command_line: Vec<String>,
    /// What computes the same again.
    pub again: Again,
    /// Every setting that was in force, as the command line understood it.
    pub settings: serde_json::Value,
    /// Files that were read.
    pub inputs: Vec<InputFile>,
    /// Stage and wall seconds, in the order of the run.
    #[serde(serialize_with = "as_map")]
    pub seconds: Vec<(String, f64)>,
    /// How much was simulated; absent where nothing deforms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<Size>,
    /// Threads that were used.
    pub threads: usize,
    /// Iterations per stage, e.g. of the marker fit and of force sharing, summed over frames.
    pub iterations: BTreeMap<String, u64>,
    /// Largest resident memory of the process \[MiB\]; absent where the system does not tell.
    pub peak_memory_mib: Option<f64>,
    /// Files that were written beside this one.
    pub files: Vec<String>,
}

/// How much was simulated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Size {
    /// Solid elements.
    pub elements: usize,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Unknowns of the configuration that has the most.
    pub unknowns: usize,
}

impl Size {
    /// Of the thigh of a comparison.
    pub fn of(comparison: &Comparison) -> Size {
        let mesh = &comparison.thigh.mesh;
        let unknowns = |plan: &Plan| plan.islands.iter().map(|island| island.n_unknowns()).sum();
        Size {
            elements: mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum(),
            nodes: mesh.points.len(),
            unknowns: comparison.solutions.present().map(|(_, s)| unknowns(&s.plan)).max().unwrap_or(0),
        }
    }
}

impl RunRecord {
    /// An empty record of a solved run of `command` by this version of the program.
    pub fn new(command: &str) -> RunRecord {
        RunRecord {
            command: command.to_string(),
            status: RunStatus::Solved,
            reason: None,
            verdict: None,
            settled: serde_json::Value::Null,
            notes: Vec::new(),
            trial: None,
            subject: None,
            program: Program::this(),
            date: now(),
            machine: Machine::this(),
            command_line: std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect(),
            again: Again::default(),
            settings: serde_json::Value::Null,
            inputs: Vec::new(),
            seconds: Vec::new(),
            size: None,
            threads: rayon::current_num_threads(),
            iterations: BTreeMap::new(),
            peak_memory_mib: None,
            files: Vec::new(),
        }
    }

    /// Names the trial and its subject.
    pub fn of_trial(&mut self, trial: &Trial) {
        self.trial = Some(trial.name.clone());
        self.subject = Some(words(trial));
    }

    /// Notes the wall time of a stage.
    pub fn stage(&mut self, name: &str, took: Duration) {
        self.seconds.push((name.to_string(), took.as_secs_f64()));
    }
}

/// Stages as an object in the order of the run, which a sorted map would lose.
fn as_map<S: serde::Serializer>(stages: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().map(|(name, seconds)| (name, seconds)))
}

/// Largest resident memory of this process so far \[MiB\]. Linux only: `VmHWM` of `/proc/self/status`.
pub fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}
