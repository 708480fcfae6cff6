//! `sartorius optimize`: the rigid side alone, from markers to activations.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use multibody::InputError;
use multibody::activation::{activate, generic_postures};
use multibody::anatomy::Anatomy;
use multibody::calibration::knee_centre::KneeCentre;
use multibody::calibration::{calibrate, functional::Quality};
use multibody::capability::{Follows, capacities};
use multibody::emg;
use multibody::informed::Informed;
use multibody::loads::{Loads, loads};
use multibody::model::{Ankle, KneeKind, Model, ModelError};
use multibody::motion::track;
use multibody::muscle::hill::{self, HillError, HillResult};
use multibody::muscle::path::knee_angle;
use multibody::passive;
use multibody::read::read_knee_forces;
use multibody::share::{SharingSettings, bands, share_each};
use multibody::sharing::Capacity;
use multibody::trial::{Effort, Filters, Motion, Side, Status, Table, Trial};
use multibody::trial_file::{self, HipRule, TrialFile};
use multibody::walker::{self, Knee, walker};

use crate::changes::Changes;
use crate::error::CouplingError;
use crate::form::{Bounds, Form};
use crate::measured::{MeasuredError, Overlay};
use crate::number::short;
use crate::scene::{TomlKind, wanted};
use crate::thigh_capacities::ThighCapacities;

/// What to optimize and how.
#[derive(Clone, Debug, Default)]
pub struct OptimizeOptions {
    /// Trial file; `None` is the built-in walker.
    pub trial: Option<PathBuf>,
    /// Folder of the recordings.
    pub data: Option<PathBuf>,
    /// Which leg of a trial that describes both; `None`: the right one, and [`Case::doubts`] say so.
    pub side: Option<Side>,
    /// Ankle in place of the trial's.
    pub ankle: Option<Ankle>,
    /// Rule for the hip centre in place of the trial's.
    pub hip_centre: Option<HipRule>,
    /// What of the leg is as published; by default everything.
    pub form: Form,
    /// Force sharing.
    pub sharing: SharingSettings,
    /// Weight with which sharing heeds electromyography, relative to the cost of forces ([`Informed`]); `None`: not at all.
    pub emg_weight: Option<f64>,
    /// Activations.
    pub hill: hill::Settings,
    /// Measured knee forces.
    pub measured: Option<PathBuf>,
    /// Capacities of the deformable thigh over the cycle ([`ThighCapacities`]): forces are shared with them, too.
    pub thigh: Option<PathBuf>,
    /// Least and greatest joint forces over all admissible sharings are wanted, too.
    pub bands: bool,
    /// How often the trial is computed with inputs that scatter ([`crate::samples`]); `None`: not at all.
    pub samples: Option<usize>,
    /// What differs from the files.
    pub changes: Changes,
}

/// A trial with its anatomy and choices, before anything is computed.
#[derive(Clone)]
pub struct Case {
    /// The trial.
    pub trial: Trial,
    /// Where its landmarks sit.
    pub anatomy: Anatomy,
    /// Which ankle.
    pub ankle: Ankle,
    /// What the knee is.
    pub knee: KneeKind,
    /// Filters.
    pub filters: Filters,
    /// Files that were read.
    pub inputs: Vec<PathBuf>,
    /// The trial file and the table of landmarks that it names: name from the folder of the trial, and text. None for the built-in walker.
    pub texts: Vec<(String, String)>,
    /// Where landmarks and hip centre come from, for the report.
    pub landmarks: String,
    /// Rule of the hip centre, for the report.
    pub hip_centre: String,
    /// Whether the reported frames are a gait cycle, and not a range of times.
    pub is_cycle: bool,
    /// Quality of a functional calibration.
    pub quality: Option<Quality>,
    /// Electromyography, where the trial names it.
    pub emg: Option<emg::Recording>,
    /// What the trial file says that rarely is so, or is left out of account.
    pub doubts: Vec<String>,
    /// How long reading took.
    pub took: Duration,
}

/// Everything that was computed.
pub struct Optimized {
    /// The case.
    pub case: Case,
    /// The leg.
    pub model: Model,
    /// Posture.
    pub motion: Motion,
    /// Loads.
    pub loads: Loads,
    /// Forces and activations.
    pub effort: Effort,
    /// What the Hill model says beside the activations.
    pub hill: HillResult,
    /// Least and greatest joint forces over all admissible sharings \[N\], where they were asked for ([`multibody::share::bands`]).
    pub bands: Option<Table>,
    /// Passive joint moments beside those of the muscles \[N·m\], where they are known.
    pub passive: Option<Table>,
    /// What electromyography said of forces, where sharing heeded it.
    pub informed: Option<Informed>,
    /// Electromyography beside muscle forces, where the trial names it.
    pub emg: Option<Vec<emg::Compared>>,
    /// Forces shared with the capacities of the deformable thigh, where they were given.
    pub with_thigh: Option<WithThigh>,
    /// Comparison with measured knee forces.
    pub measured: Option<Overlay>,
    /// Why it was left out although asked for.
    pub not_compared: Option<String>,
    /// Stage and its wall time.
    pub stages: Vec<(&'static str, Duration)>,
}

/// Forces shared with what the muscles of the deformable thigh can do.
#[derive(Clone, Debug)]
pub struct WithThigh {
    /// What they can do.
    pub capacities: ThighCapacities,
    /// Forces; activations are left at zero.
    pub effort: Effort,
}

impl WithThigh {
    /// Whether every frame is solved.
    pub fn is_solved(&self) -> bool {
        self.effort.verdicts.iter().all(|v| v.status == Status::Solved)
    }

    /// How its frames ended.
    pub fn words(&self) -> String {
        let verdicts = &self.effort.verdicts;
        let unsolved = || verdicts.iter().enumerate().filter(|(_, v)| v.status != Status::Solved);
        let n = verdicts.len();
        match unsolved().next() {
            None => format!("{n} of {n} frames solved"),
            Some((first, verdict)) => format!(
                "{} of {n} frames solved; the first without at {:.3} s: {}",
                n - unsolved().count(),
                self.effort.time[first],
                verdict.reason.as_deref().unwrap_or("no reason given")
            ),
        }
    }
}

impl OptimizeOptions {
    /// Anatomy of the built-in walker as it is to be.
    fn walker_anatomy(&self, anatomy: Anatomy) -> Result<Anatomy, CouplingError> {
        if let Some(key) = self.changes.trial.keys().next() {
            let text =
                format!("`trial.{key}`: the built-in walker has no trial file; name one as the subject");
            return Err(CouplingError::Option(text));
        }
        match self.changes.landmarks.is_empty() {
            true => Ok(anatomy),
            false => walker::shifted(&self.changes.landmarks)
                .map_err(|e| CouplingError::Option(format!("landmarks of the built-in walker: {e}"))),
        }
    }
}

impl Case {
    /// Reads the trial and its landmarks.
    pub fn load(options: &OptimizeOptions) -> Result<Case, CouplingError> {
        let clock = Instant::now();
        let Some(path) = &options.trial else {
            if options.hip_centre.is_some_and(|h| h != HipRule::Table) {
                let text = "--hip-centre needs a trial: the built-in walker was made with the hip centre of its table";
                return Err(CouplingError::Option(text.into()));
            }
            let (trial, anatomy) = walker(Knee::Hinge);
            let anatomy = options.walker_anatomy(anatomy)?;
            return Ok(Case {
                trial,
                anatomy,
                ankle: options.ankle.unwrap_or_default(),
                knee: options.form.knee.unwrap_or_default(),
                // The averaged ground reaction is smooth already.
                filters: Filters { motion_hz: 5.0, force_hz: None, contact_threshold: 20.0 },
                inputs: Vec::new(),
                texts: Vec::new(),
                landmarks: "table (built in)".into(),
                hip_centre: "table".into(),
                is_cycle: true,
                quality: None,
                emg: None,
                doubts: Vec::new(),
                took: clock.elapsed(),
            });
        };
        let both = trial_file(path, &options.changes)?;
        let file = both.leg(options.side.unwrap_or(both.subject.side));
        let trial = file.load(options.data.as_deref())?;
        let mut spec = file.landmarks(options.data.as_deref())?;
        if let Some(rule) = options.hip_centre {
            let is_table = matches!(spec.source, trial_file::Landmarks::Table { .. });
            if rule == HipRule::Table && !is_table {
                let text = format!(
                    "--hip-centre table: `{}` takes its landmarks from markers, not from a table; choose harrington or regression",
                    trial.name
                );
                return Err(CouplingError::Option(text));
            }
            spec.hip_centre = trial_file::HipCentre::By(rule);
        }
        if !options.form.corrected_knee_centre {
            spec.knee_centre = KneeCentre::AsFound;
        }
        let (anatomy, quality) = calibrate(&spec, trial.subject.sex, &options.changes.landmarks)
            .map_err(|source| CouplingError::Calibration { trial: trial.name.clone(), source })?;
        let ankle = match file.model.ankle {
            trial_file::Ankle::Universal => Ankle::Universal,
            trial_file::Ankle::Parallel => Ankle::Parallel,
        };
        let knee = options.form.knee.unwrap_or(match file.model.knee {
            trial_file::Knee::Natural => KneeKind::Natural,
            trial_file::Knee::Implant => KneeKind::Implant,
        });
        let inputs = file.inputs(options.data.as_deref())?;
        let table = file.landmarks.table.as_deref();
        // Among the inputs the table stands under the folder where it was found.
        let table = table.and_then(|given| Some((given, inputs.iter().rfind(|path| path.ends_with(given))?)));
        let text = |path: &Path| {
            let io = |source| InputError::Io { file: path.to_path_buf(), source };
            match multibody::shipped::text(path) {
                Some(text) => Ok(text.to_string()),
                None => std::fs::read_to_string(path).map_err(io),
            }
        };
        let mut texts =
            vec![(path.file_name().unwrap_or_default().to_string_lossy().into_owned(), text(path)?)];
        if let Some((given, found)) = table {
            texts.push((given.to_string_lossy().replace('\\', "/"), text(found)?));
        }
        let mut doubts = file.doubts(&trial);
        if options.side.is_none() && both.left.is_some() {
            doubts.push(format!(
                "{} describes both legs; this is of the right one, without [left]: both are solved by sartorius optimize",
                path.display()
            ));
        }
        Ok(Case {
            texts,
            ankle: options.ankle.unwrap_or(ankle),
            knee,
            filters: file.filters(),
            inputs,
            landmarks: source_name(&spec.source).into(),
            hip_centre: hip_name(&spec.hip_centre),
            is_cycle: file.range.cycle.is_some(),
            quality,
            emg: file.emg(options.data.as_deref())?,
            doubts,
            trial,
            anatomy,
            took: clock.elapsed(),
        })
    }
}

/// Legs that the trial describes, the one of its main tables first.
pub fn sides(options: &OptimizeOptions) -> Result<Vec<Side>, CouplingError> {
    options
        .trial
        .as_deref()
        .map_or(Ok(vec![Side::Right]), |path| Ok(trial_file(path, &options.changes)?.sides()))
}

fn trial_file(path: &Path, changes: &Changes) -> Result<TrialFile, CouplingError> {
    if path.is_file()
        && let Ok(text) = std::fs::read_to_string(path)
    {
        wanted(TomlKind::Trial, path, &text)?;
    }
    if changes.trial.is_empty() {
        return Ok(TrialFile::read(path)?);
    }
    let io = |source| InputError::Io { file: path.to_path_buf(), source };
    let text = match multibody::shipped::text(path) {
        Some(text) => text.to_string(),
        None => std::fs::read_to_string(path).map_err(io)?,
    };
    // What is no TOML is said of the file itself.
    let changed = changes.trial_text(&text).unwrap_or(text);
    Ok(TrialFile::parse(path, changed.as_bytes())?)
}

/// Stages of [`optimize`].
pub const STAGES: [&str; 6] = ["read", "model", "marker fit", "loads", "sharing", "activations"];

/// Stage after sharing where bands are asked for.
const BANDS: &str = "bands";

/// The stages of these options.
pub fn stages(options: &OptimizeOptions) -> Vec<&'static str> {
    let bands = |stage: &'static str| (stage == "sharing" && options.bands).then_some(BANDS);
    STAGES.into_iter().flat_map(|stage| std::iter::once(stage).chain(bands(stage))).collect()
}

/// Runs the whole rigid side.
pub fn optimize(options: &OptimizeOptions) -> Result<Optimized, CouplingError> {
    optimize_with(options, &mut |_| ())
}

/// The same; `lap` is called as each of the [`STAGES`] ends.
pub fn optimize_with(
    options: &OptimizeOptions,
    lap: &mut dyn FnMut(&str),
) -> Result<Optimized, CouplingError> {
    let case = Case::load(options)?;
    lap(STAGES[0]);
    solve(case, options, lap)
}

/// The same of a trial that was read; `lap` is called as each of the other [`STAGES`] ends.
pub fn solve(
    case: Case,
    options: &OptimizeOptions,
    lap: &mut dyn FnMut(&str),
) -> Result<Optimized, CouplingError> {
    let mut stages = vec![(STAGES[0], case.took)];
    let mut clock = Instant::now();
    let mut lap = |name: &'static str| {
        lap(name);
        stages.push((name, clock.elapsed()));
        clock = Instant::now();
    };
    let measured = options.measured.as_deref().map(read_knee_forces).transpose()?;
    let thigh = options.thigh.as_deref().map(ThighCapacities::read).transpose()?;
    let model = model_of(&case, options)?;
    lap("model");
    let motion = track(&model, &case.trial, &case.filters);
    lap("marker fit");
    let mut loads = loads(&model, &motion, &case.trial, &case.filters);
    lap("loads");
    let unrelieved = thigh.is_some().then(|| loads.clone());
    let known = Known::new(&model, &motion, &mut loads, case.is_cycle, options, None)?;
    let at = |frame: usize| known.capacity(frame);
    let (mut effort, informed) = share_known(&case, &model, &motion, &loads, &known, options)?;
    let with_thigh = (thigh.zip(unrelieved))
        .map(|(capacities, loads)| share_with_thigh(capacities, &case, &model, &motion, loads, options))
        .transpose()?;
    lap("sharing");
    let bands = options.bands.then(|| {
        let bands = bands(&model, &loads, at, &options.sharing, &effort);
        lap(BANDS);
        bands
    });
    let hill = activate(&model, &motion, &mut effort, &options.hill)?;
    lap("activations");
    let emg = case.emg.as_ref().map(|recorded| emg::compare(recorded, &effort.time, &effort.forces));
    let overlay = measured.map(|forces| Overlay::new(&forces, &effort, case.trial.subject.mass));
    let (measured, not_compared) = match overlay.transpose() {
        Ok(overlay) => (overlay, None),
        Err(why @ MeasuredError::Unsolved { .. }) => (None, Some(why.to_string())),
        Err(bad) => return Err(bad.into()),
    };
    let passive = known.passive;
    Ok(Optimized {
        case,
        model,
        motion,
        loads,
        effort,
        hill,
        bands,
        passive,
        informed,
        emg,
        with_thigh,
        measured,
        not_compared,
        stages,
    })
}

/// Shares forces with what is known of muscles, a second time where electromyography is to be heeded.
pub(crate) fn share_known(
    case: &Case,
    model: &Model,
    motion: &Motion,
    loads: &Loads,
    known: &Known,
    options: &OptimizeOptions,
) -> Result<(Effort, Option<Informed>), CouplingError> {
    let at = |frame: usize| known.capacity(frame);
    let alone = share_each(model, motion, loads, at, &options.sharing, None)?;
    let Some(weight) = options.emg_weight else { return Ok((alone, None)) };
    let none = |why: &str| CouplingError::Option(format!("emg weight: {}: {why}", case.trial.name));
    let recorded = case.emg.as_ref();
    let recorded = recorded.ok_or_else(|| {
        none("the trial has no electromyograms; add a section [emg], or leave the weight away")
    })?;
    let compared = emg::compare(recorded, &alone.time, &alone.forces);
    let informed = Informed::new(&compared, &alone, at, weight)
        .ok_or_else(|| none("no channel without defect and no solved frame is left to heed"))?;
    Ok((share_each(model, motion, loads, at, &options.sharing, Some(&informed))?, Some(informed)))
}

/// Forces shared with the capacities of the thigh. `loads`: before anything passive came off.
fn share_with_thigh(
    capacities: ThighCapacities,
    case: &Case,
    model: &Model,
    motion: &Motion,
    mut loads: Loads,
    options: &OptimizeOptions,
) -> Result<WithThigh, CouplingError> {
    let is_fitted = |k: usize| motion.fit[k].failure.is_none();
    let flexion = |k: usize| -knee_angle(&model.shapes, &motion.Q[k]).to_degrees();
    let knee: Vec<f64> =
        motion.report.clone().map(|k| if is_fitted(k) { flexion(k) } else { f64::NAN }).collect();
    capacities.check(&loads.time, &knee)?;
    let known = Known::new(model, motion, &mut loads, case.is_cycle, options, Some(&capacities))?;
    let (effort, _) = share_known(case, model, motion, &loads, &known, options)?;
    Ok(WithThigh { capacities, effort })
}

/// The leg of a case in the form of `options`, with the strengths that they change.
pub(crate) fn model_of(case: &Case, options: &OptimizeOptions) -> Result<Model, ModelError> {
    let model = Model::new(&case.trial, case.anatomy.clone(), case.ankle)?.with_knee(case.knee);
    let mut model = if options.form.wrapped { model.with_wrapped_muscles() } else { model };
    options.changes.strengthen(&mut model);
    Ok(model)
}

/// What force sharing knows of muscles and joints beside the loads.
pub(crate) struct Known {
    /// One for all frames, or one per reported frame.
    pub capacities: Vec<Capacity>,
    /// Passive moments that were taken off the loads.
    pub passive: Option<Table>,
}

impl Known {
    /// Capacities in the form of `options`, of muscles of the thigh as it says; passive moments come off the `loads`.
    pub fn new(
        model: &Model,
        motion: &Motion,
        loads: &mut Loads,
        is_cycle: bool,
        options: &OptimizeOptions,
        thigh: Option<&ThighCapacities>,
    ) -> Result<Known, HillError> {
        let form = &options.form;
        let follows = Follows { greatest: form.bounds == Bounds::State, least: form.passive.of_muscles() };
        let has_state = follows.greatest || follows.least;
        let postures =
            if has_state || form.passive.of_joints() { generic_postures(model, motion) } else { Vec::new() };
        let capacities = if has_state {
            capacities(model, motion, &postures, &options.hill, follows)?
        } else {
            vec![Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect())]
        };
        let capacities = match thigh {
            None => capacities,
            Some(thigh) => {
                let times = loads.time.iter().enumerate();
                times.map(|(k, &time)| thigh.at(time, model, of_frame(&capacities, k))).collect()
            }
        };
        let passive = form.passive.of_joints().then(|| {
            // A cycle is walked upright; otherwise the pelvis is upright where its spines are level.
            let upright = if is_cycle { passive::upright_tilt(motion) } else { 0.0 };
            let knows_least = follows.least || thigh.is_some();
            let muscles = knows_least.then_some(capacities.as_slice());
            passive::relieve(loads, &model.coordinate_names(), &postures, upright, muscles)
        });
        Ok(Known { capacities, passive })
    }

    /// Capacity of a reported frame.
    pub fn capacity(&self, frame: usize) -> &Capacity {
        of_frame(&self.capacities, frame)
    }
}

/// One capacity holds for all frames, or each has its own.
fn of_frame(capacities: &[Capacity], frame: usize) -> &Capacity {
    &capacities[if capacities.len() > 1 { frame } else { 0 }]
}

fn source_name(source: &trial_file::Landmarks) -> &'static str {
    match source {
        trial_file::Landmarks::Table { .. } => "table",
        trial_file::Landmarks::Markers { .. } => "landmark markers",
        trial_file::Landmarks::Functional { .. } => "functional calibration of knee and ankle axes",
    }
}

fn hip_name(centre: &trial_file::HipCentre) -> String {
    match centre {
        trial_file::HipCentre::By(HipRule::Table) => "table".into(),
        trial_file::HipCentre::By(HipRule::Regression) => {
            "regression on pelvis width (Dumas & Wojtusch 2018)".into()
        }
        trial_file::HipCentre::By(HipRule::Harrington) => "Harrington et al. 2007".into(),
        trial_file::HipCentre::At([x, y, z]) => {
            let [x, y, z] = [x, y, z].map(|v| short(*v));
            format!("given: {x}, {y}, {z} m from the midpoint of the ASISs")
        }
    }
}
