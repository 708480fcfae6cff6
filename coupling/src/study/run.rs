//! One run of a study: what it takes, how it is carried out, and the files that say what came of it.
//!
//! A run writes into a folder of its own: `curves.csv`, then `run.json`, each under a name of its process first. It is done where `run.json` is there and of this
//! study; whoever carries it out once more, or at the same time, writes the same.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use multibody::trial::{Effort, Status};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use toml::Value;

use super::file::Study;
use super::vary::Target;
use crate::changes::{Changes, number, scene_with};
use crate::comparison::{Prepared, Sized};
use crate::configuration::Configuration;
use crate::error::CouplingError;
use crate::optimize::{OptimizeOptions, Optimized, optimize};
use crate::options::{FORM, set_option};
use crate::scene::Scene;

/// Folder of the runs.
pub const RUNS: &str = "runs";
/// Runs whose folders lie together: file systems are slow with very many entries.
const TOGETHER: usize = 1000;
/// What came of a run; written last.
const RUN_FILE: &str = "run.json";
/// Forces over time.
const CURVES: &str = "curves.csv";

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// Everything solved.
    Solved,
    /// Something found no solution.
    NotConverged,
    /// An input is bad.
    Refused,
    /// The process that carried it out ended twice.
    Killed,
}

impl RunStatus {
    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            RunStatus::Solved => "solved",
            RunStatus::NotConverged => "not_converged",
            RunStatus::Refused => "refused",
            RunStatus::Killed => "killed",
        }
    }
}

/// What `run.json` says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Hash of all that the study depends on.
    pub study: String,
    /// Number of the run.
    pub run: usize,
    /// Whose.
    pub subject: String,
    /// With which setting.
    pub setting: String,
    /// Which sample.
    pub sample: usize,
    /// Whose values of the sample, where it has several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set: Option<String>,
    /// How it ended.
    pub status: RunStatus,
    /// Why, when it is not solved.
    pub reason: Option<String>,
    /// Values of what varies, by column.
    pub values: BTreeMap<String, serde_json::Value>,
    /// Numbers of a solved run, by name; none of any other.
    pub numbers: BTreeMap<String, f64>,
    /// Wall time \[s\].
    pub seconds: f64,
}

/// Whose values of a sample a run takes. Without [indices](Study::indices) there is the first set alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// One draw of everything that varies.
    First,
    /// Another, independent of it.
    Second,
    /// The first one with a group of the second, by its place in [`Study::groups`].
    Exchanged(usize),
}

impl Set {
    /// Place among the sets of a sample.
    fn place(self) -> usize {
        match self {
            Set::First => 0,
            Set::Second => 1,
            Set::Exchanged(group) => 2 + group,
        }
    }

    fn at(place: usize) -> Set {
        match place {
            0 => Set::First,
            1 => Set::Second,
            _ => Set::Exchanged(place - 2),
        }
    }

    /// Whether it takes values of a group from the second draw.
    fn is_second(self, group: usize) -> bool {
        match self {
            Set::First => false,
            Set::Second => true,
            Set::Exchanged(exchanged) => exchanged == group,
        }
    }
}

/// What a run takes.
pub struct Task {
    /// Place in [`Study::subjects`].
    pub subject: usize,
    /// Place in [`Study::settings`].
    pub setting: usize,
    /// Sample.
    pub sample: usize,
    /// Whose values of it.
    pub set: Set,
    /// Value of every dimension.
    pub values: Vec<Value>,
}

impl Study {
    /// What a run takes: runs of a sample lie together, so that a study that was broken off has whole samples.
    pub fn task(&self, run: usize) -> Task {
        let (subjects, settings, sets) = (self.subjects.len(), self.settings.len(), self.n_sets());
        let sample = run / (sets * subjects * settings);
        let set = Set::at(run / (subjects * settings) % sets);
        let value = |(k, d): (usize, &super::vary::Dimension)| {
            // The second draw has coordinates of its own.
            let coordinate = if set.is_second(d.group) { self.dimensions.len() + k } else { k };
            d.distribution.value(self.sequence.point(self.seed, sample, coordinate))
        };
        Task {
            subject: run / settings % subjects,
            setting: run % settings,
            sample,
            set,
            values: self.dimensions.iter().enumerate().map(value).collect(),
        }
    }

    /// Number of the run that takes these; the places are those in the lists of the study.
    pub fn run(&self, sample: usize, set: Set, subject: usize, setting: usize) -> usize {
        ((sample * self.n_sets() + set.place()) * self.subjects.len() + subject) * self.settings.len()
            + setting
    }

    /// Sets of every sample, in the order of the runs.
    pub fn sets(&self) -> impl Iterator<Item = Set> + use<> {
        (0..self.n_sets()).map(Set::at)
    }

    /// Name of a set in the table.
    pub fn set_name(&self, set: Set) -> &str {
        match set {
            Set::First => "first",
            Set::Second => "second",
            Set::Exchanged(group) => &self.groups[group],
        }
    }

    /// Folder of a run below that of the study.
    pub fn folder(run: usize) -> PathBuf {
        Path::new(RUNS).join(format!("{:03}", run / TOGETHER)).join(format!("{run:06}"))
    }

    /// What came of a run, where it is done; `key`: that of [`Study::key`].
    pub fn done(out: &Path, key: &str, run: usize) -> Option<Done> {
        let text = fs::read_to_string(out.join(Study::folder(run)).join(RUN_FILE)).ok()?;
        let done: Done = serde_json::from_str(&text).ok()?;
        (done.study == key && done.run == run).then_some(done)
    }

    /// Carries out a run and writes its folder below `out`; an error is of the file system alone, everything else is a status.
    pub fn carry_out(&self, key: &str, run: usize, out: &Path) -> io::Result<Done> {
        let clock = Instant::now();
        let task = self.task(run);
        let folder = out.join(Study::folder(run));
        fs::create_dir_all(&folder)?;
        let ended = self.inputs(&task).and_then(|(options, scene)| match scene {
            None => optimized(&optimize(&options)?, &folder, self.curves),
            Some(scene) => self.compared(scene, options, out, &folder),
        });
        let (status, reason, numbers) = match ended {
            Ok(numbers) => (RunStatus::Solved, None, numbers),
            Err(error) => {
                let status = match error.exit_code() {
                    3 => RunStatus::NotConverged,
                    _ => RunStatus::Refused,
                };
                (status, Some(error.to_string()), BTreeMap::new())
            }
        };
        let done = Done {
            status,
            reason,
            numbers,
            seconds: clock.elapsed().as_secs_f64(),
            ..self.blank(key, run, &task)
        };
        write_done(&folder, &done)?;
        Ok(done)
    }

    /// Notes that a run has no results because its process ended.
    pub fn note_killed(&self, key: &str, run: usize, out: &Path, reason: String) -> io::Result<()> {
        let folder = out.join(Study::folder(run));
        fs::create_dir_all(&folder)?;
        let blank = self.blank(key, run, &self.task(run));
        write_done(&folder, &Done { status: RunStatus::Killed, reason: Some(reason), ..blank })
    }

    fn blank(&self, key: &str, run: usize, task: &Task) -> Done {
        let plain = |value: &Value| match number(value) {
            Some(number) => number.into(),
            None => serde_json::Value::from(value.as_str().map_or(value.to_string(), str::to_string)),
        };
        let values = self.dimensions.iter().zip(&task.values).map(|(d, v)| (d.target.column(), plain(v)));
        Done {
            study: key.to_string(),
            run,
            subject: self.subjects[task.subject].name.clone(),
            setting: self.settings[task.setting].name.clone(),
            sample: task.sample,
            set: self.indices.then(|| self.set_name(task.set).to_string()),
            status: RunStatus::Solved,
            reason: None,
            values: values.collect(),
            numbers: BTreeMap::new(),
            seconds: 0.0,
        }
    }

    /// Options and scene of a run.
    fn inputs(&self, task: &Task) -> Result<(OptimizeOptions, Option<Scene>), CouplingError> {
        let trial = self.subjects[task.subject].trial.clone();
        let base = if self.scene.is_some() { OptimizeOptions::default() } else { OptimizeOptions::revised() };
        let mut options = OptimizeOptions { trial, data: self.data.clone(), ..base };
        let mut of_scene = BTreeMap::new();
        let drawn = self.dimensions.iter().zip(&task.values).map(|(d, v)| (&d.target, v));
        // A setting goes before the base, what varies before a setting.
        let set = self.settings[task.setting].keys.iter().map(|(t, v)| (t, v));
        let is_form = |target: &Target| matches!(target, Target::Option(key) if key == FORM);
        let (form, others): (Vec<_>, Vec<_>) = set.chain(drawn).partition(|(target, _)| is_form(target));
        for (target, value) in form.into_iter().chain(others) {
            let Changes { trial, landmarks, strengths } = &mut options.changes;
            let refused =
                |remedy: String| CouplingError::Option(format!("{} = {value}: {remedy}", target.column()));
            let of_number = || number(value).ok_or_else(|| refused("give a number".into()));
            match target {
                Target::Trial(key) => drop(trial.insert(key.clone(), value.clone())),
                Target::Scene(key) => drop(of_scene.insert(key.clone(), value.clone())),
                Target::Option(key) => set_option(&mut options, key, value).map_err(refused)?,
                Target::Strength(name) => drop(strengths.insert(name.clone(), of_number()?)),
                Target::Landmark(name, axis) => {
                    let mut shift = Vector3::zeros();
                    shift[*axis] = 1e-3 * of_number()?;
                    landmarks.add(name, shift);
                }
            }
        }
        let Some(base) = &self.scene else { return Ok((options, None)) };
        let scene = scene_with(base, &of_scene, self.data.as_deref());
        let mut scene = scene.map_err(|e| CouplingError::Option(super::admissible::said(&e)))?;
        scene.trial.clone_from(&options.trial);
        Ok((options, Some(scene)))
    }

    /// Solves a scene; frames of a run that was killed are taken over.
    fn compared(
        &self,
        scene: Scene,
        options: OptimizeOptions,
        out: &Path,
        folder: &Path,
    ) -> Result<BTreeMap<String, f64>, CouplingError> {
        let prepared = Prepared::of(Sized::with(scene, options)?, &mut |_| ())?;
        let ready = prepared.calibrate(self.asked, out, &mut |_| ())?;
        let comparison = prepared.solve_ready(ready, folder, true, &mut |_| ())?;
        let shortcomings = comparison.shortcomings();
        if !shortcomings.is_empty() {
            return Err(CouplingError::NotConverged(shortcomings.join("; ")));
        }
        if !self.fields {
            for c in Configuration::ALL {
                let frames = folder.join(c.folder());
                let removed = fem::output::remove_run(&frames, "thigh");
                removed.map_err(|e| CouplingError::Option(format!("{}: {e}", frames.display())))?;
                let _ = fs::remove_dir(&frames); // what is not empty stays
            }
        }
        let named = |q: crate::comparison::quantities::Quantity| {
            let name = [q.step.name(), q.configuration.folder(), q.kind.name(), &q.of].join(".");
            (name.replace(' ', "_"), q.value)
        };
        Ok(comparison.quantities().into_iter().map(named).collect())
    }
}

/// Forces of the leg over time: every muscle line, every force of a joint (of a contact of three components its magnitude), and the whole knee \[N\].
pub fn curves(effort: &Effort) -> Vec<(String, Vec<f64>)> {
    let column = |table: &multibody::trial::Table, j: usize| table.values.column(j).iter().copied().collect();
    let mut curves: Vec<(String, Vec<f64>)> = Vec::new();
    let reactions = &effort.reactions;
    let of = |name: &str| reactions.columns.iter().position(|c| c == name).map(|j| column(reactions, j));
    let sum = |parts: Vec<Vec<f64>>, of: fn(&[f64]) -> f64| {
        let row = |i: usize| of(&parts.iter().map(|p: &Vec<f64>| p[i]).collect::<Vec<f64>>());
        (0..effort.time.len()).map(row).collect::<Vec<f64>>()
    };
    if let (Some(medial), Some(lateral)) = (of("knee_medial"), of("knee_lateral")) {
        curves.push(("knee".into(), sum(vec![medial, lateral], |parts| parts.iter().sum())));
    }
    for (j, name) in reactions.columns.iter().enumerate() {
        match name.strip_suffix("_x") {
            Some(joint) => {
                let parts = ["x", "y", "z"].map(|axis| of(&format!("{joint}_{axis}")));
                let parts: Vec<Vec<f64>> = parts.into_iter().flatten().collect();
                let norm = |parts: &[f64]| parts.iter().map(|p| p * p).sum::<f64>().sqrt();
                curves.push((joint.to_string(), sum(parts, norm)));
            }
            None if name.ends_with("_y") || name.ends_with("_z") => {}
            None => curves.push((name.clone(), column(reactions, j))),
        }
    }
    let muscles = effort.forces.columns.iter().enumerate();
    curves.extend(muscles.map(|(j, name)| (name.clone(), column(&effort.forces, j))));
    curves
}

/// Writes the curves and returns the numbers of a leg that is solved in every frame.
fn optimized(done: &Optimized, folder: &Path, keep: bool) -> Result<BTreeMap<String, f64>, CouplingError> {
    let curves = curves(&done.effort);
    if keep {
        let unwritten =
            |e: io::Error| CouplingError::Option(format!("cannot write {}: {e}", folder.display()));
        write(&folder.join(CURVES), |w| write_curves(w, &done.effort.time, &curves)).map_err(unwritten)?;
    }
    let verdicts = &done.effort.verdicts;
    let fits = &done.motion.fit[done.motion.report.clone()];
    let failed = |i: &usize| verdicts[*i].status != Status::Solved || fits[*i].failure.is_some();
    let unsolved: Vec<usize> = (0..verdicts.len()).filter(failed).collect();
    if let Some(&first) = unsolved.first() {
        let why = fits[first].failure.clone().or(verdicts[first].reason.clone()).unwrap_or_default();
        return Err(CouplingError::NotConverged(format!(
            "{} of {} frames are not solved; the first: {why}",
            unsolved.len(),
            verdicts.len()
        )));
    }
    let peak = |values: &[f64]| values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
    let mut numbers: BTreeMap<String, f64> =
        curves.iter().map(|(name, values)| (format!("peak_{name}_N"), peak(values))).collect();
    numbers.insert("marker_rms_mm".into(), 1e3 * done.motion.marker_rms());
    Ok(numbers)
}

fn write_curves(w: &mut dyn Write, time: &[f64], curves: &[(String, Vec<f64>)]) -> io::Result<()> {
    write!(w, "time_s")?;
    curves.iter().try_for_each(|(name, _)| write!(w, ",{name}_N"))?;
    writeln!(w)?;
    for (i, t) in time.iter().enumerate() {
        write!(w, "{t:?}")?;
        for (_, values) in curves {
            // A thousandth of a newton is far below what force sharing is solved to.
            match values[i] {
                v if v.is_finite() => write!(w, ",{v:.3}")?,
                _ => write!(w, ",")?,
            }
        }
        writeln!(w)?;
    }
    Ok(())
}

fn write_done(folder: &Path, done: &Done) -> io::Result<()> {
    write(&folder.join(RUN_FILE), |w| Ok(serde_json::to_writer(w, done)?))
}

/// Writes a file under a name of this process, then renames it.
fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
    let mut file = io::BufWriter::new(fs::File::create(&partial)?);
    fill(&mut file)?;
    file.flush()?;
    fs::rename(&partial, path)
}

/// Curves of a run, by name without unit; each as long as `time`. What is no number is a gap.
pub struct Curves {
    /// Times \[s\].
    pub time: Vec<f64>,
    /// Names and forces \[N\].
    pub columns: Vec<(String, Vec<f64>)>,
}

impl Curves {
    /// Reads the curves of a run, where it has kept them.
    pub fn read(out: &Path, run: usize) -> Option<Curves> {
        let text = fs::read_to_string(out.join(Study::folder(run)).join(CURVES)).ok()?;
        let mut lines = text.lines();
        let names = lines.next()?.split(',').skip(1);
        let mut columns: Vec<(String, Vec<f64>)> =
            names.map(|name| (name.strip_suffix("_N").unwrap_or(name).to_string(), Vec::new())).collect();
        let mut time = Vec::new();
        for line in lines {
            let mut cells = line.split(',');
            time.push(cells.next()?.parse().ok()?);
            for (_, values) in &mut columns {
                values.push(cells.next()?.parse().unwrap_or(f64::NAN));
            }
        }
        Some(Curves { time, columns })
    }
}

/// Takes back every run below `out`, so that none is taken over. Folders and files that are not of a study stay.
pub fn forget(out: &Path) -> io::Result<()> {
    let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    for folder in entries(&out.join(RUNS)).flat_map(|shard| entries(&shard).collect::<Vec<_>>()) {
        for file in entries(&folder) {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if [RUN_FILE, CURVES].contains(&name.as_str()) || name.ends_with(".partial") {
                fs::remove_file(file)?;
            }
        }
        for c in Configuration::ALL {
            let frames = folder.join(c.folder());
            fem::output::remove_run(&frames, "thigh").map_err(io::Error::other)?;
            let _ = fs::remove_dir(&frames);
        }
        let _ = fs::remove_dir(&folder); // what is not empty stays
    }
    Ok(())
}
