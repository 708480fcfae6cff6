//! `sartorius optimize [TRIAL]`: arguments, output folder, words on the terminal.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use multibody::emg;
use multibody::error::Mistakes;
use multibody::model::{Ankle, KneeKind};
use multibody::muscle::curves::{Curves, DeGroote2016};
use multibody::muscle::hill::{self, Fractions, Tendon};
use multibody::muscle::path::Muscle;
use multibody::share::SharingSettings;
use multibody::sharing::{KKT_TOLERANCE, MuscleCost, ReactionCost, SharingOptions};
use multibody::shipped;
use multibody::trial::Side;
use multibody::trial_file::HipRule;
use serde::Serialize;

use super::progress::Progress;
use super::{OutArguments, Outcome};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::claim::{Claim, LEG_FOLDERS};
use crate::output::opensim;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus};
use crate::output::tables::Series;
use crate::output::{write_both_legs, write_optimize};
use crate::report::both::BothLegs;
use crate::report::problems::{Mark, Run, runs};
use crate::report::{MuscleInfo, OptimizeReport, Summary};
use coupling::error::StudyError;
use coupling::form::{Bounds, Form, Passive};
use coupling::number::{plain, short};
use coupling::optimize::{Case, OptimizeOptions, Optimized, optimize_with, sides, solve, stages};
use coupling::samples::{self, Samples};
use coupling::subject::{who, words};

#[derive(Args)]
pub struct OptimizeArguments {
    #[arg(help = trials())]
    trial: Option<PathBuf>,
    /// Folder of the recordings that the trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    out: OutArguments,
    /// Ankle, in place of the trial's.
    #[arg(long, value_enum)]
    ankle: Option<AnkleChoice>,
    /// Hip centre, in place of the trial's.
    #[arg(long, value_enum, value_name = "RULE")]
    hip_centre: Option<HipChoice>,
    /// The rigid leg: `revised` (knee centre corrected for skin motion, the trial's kind of knee, muscle paths without jumps, passive forces,
    /// bounds by the state of the muscle), or `published`, which is what `compare` goes by. The next three options change single parts.
    #[arg(long, value_enum, default_value = "revised")]
    form: FormChoice,
    /// Kind of knee, in place of the trial's.
    #[arg(long, value_enum)]
    knee: Option<KneeChoice>,
    /// Passive forces that sharing knows: measured moments of the joints, tensions of resting muscles, or both (nothing counts twice).
    #[arg(long, value_enum)]
    passive: Option<PassiveChoice>,
    /// What bounds muscle forces: the maximal isometric force, or the force at full activation at the length and velocity of the moment.
    #[arg(long, value_enum)]
    bounds: Option<BoundsChoice>,
    /// Least and greatest joint forces over all admissible sharings, whatever they cost: joint_force_bounds.csv, and bands in the figures.
    #[arg(long)]
    bands: bool,
    /// How sure the knee forces are: compute the trial at least this often with landmarks, strengths, masses, markers and costs that scatter;
    /// joint_force_samples.csv, samples.csv, sobol.csv and a section of the page. Every other frame is computed.
    #[arg(long, value_name = "N")]
    samples: Option<usize>,
    /// What muscle forces cost: squared forces, squared activations, or squared activations weighted by volume
    /// [default: volume; force with --form published].
    #[arg(long, value_enum)]
    cost: Option<CostChoice>,
    /// What joint contact, ligament and bone forces cost: the published weights (condition 2) or nothing (condition 1)
    /// [default: none; table with --form published].
    #[arg(long, value_enum)]
    joint_weights: Option<JointWeights>,
    /// No upper bounds on muscle forces: the published form.
    #[arg(long)]
    unbounded: bool,
    /// Reserve moments on every joint coordinate, with this weight of their squares in 1/(N·m)². They are reported.
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
    reserves: Option<f64>,
    /// Where a frame is infeasible, raise all strengths together by up to this factor: what forces would do, in least_violation.csv. The frame stays unsolved.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    raise_bounds: Option<f64>,
    /// Muscle curves for activations.
    #[arg(long, value_enum, default_value = "thelen")]
    curves: CurveChoice,
    /// Tendons for activations.
    #[arg(long, value_enum, default_value = "elastic")]
    tendon: TendonChoice,
    /// Measured knee forces to compare with: `time_s, medial_N, lateral_N`, or four load cells in pounds-force. Of a trial of both legs:
    /// those of the right knee.
    #[arg(long, value_name = "FILE")]
    measured: Option<PathBuf>,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum AnkleChoice {
    Universal,
    Parallel,
}

#[derive(Clone, Copy, ValueEnum)]
enum HipChoice {
    Table,
    Regression,
    Harrington,
}

#[derive(Clone, Copy, ValueEnum)]
enum FormChoice {
    Revised,
    Published,
}

#[derive(Clone, Copy, ValueEnum)]
enum KneeChoice {
    Natural,
    Implant,
}

#[derive(Clone, Copy, ValueEnum)]
enum PassiveChoice {
    None,
    Joints,
    Muscles,
    Both,
}

#[derive(Clone, Copy, ValueEnum)]
enum BoundsChoice {
    Strength,
    State,
}

#[derive(Clone, Copy, ValueEnum)]
enum CostChoice {
    Force,
    Activation,
    Volume,
}

#[derive(Clone, Copy, ValueEnum)]
enum JointWeights {
    Table,
    None,
}

#[derive(Clone, Copy, ValueEnum)]
enum CurveChoice {
    Thelen,
    Degroote,
}

#[derive(Clone, Copy, ValueEnum)]
enum TendonChoice {
    Elastic,
    Rigid,
}

/// Help on the argument.
pub(super) fn trials() -> String {
    let names: Vec<&str> = shipped::Kind::Trial.all().map(|(name, _)| name).collect();
    format!(
        "Trial file (TOML), or the name of a shipped trial: {}; their recordings are found with --data. A word alone is a name, ./word a \
         file. Default: the built-in walker",
        names.join(", ")
    )
}

impl OptimizeArguments {
    fn options(&self) -> Result<OptimizeOptions, CommandError> {
        let positive = |name: &str, value: Option<f64>, least: f64| match value {
            Some(v) if !(v.is_finite() && v >= least) => {
                Err(CommandError::Option(format!("--{name} is {v}; give a number of at least {least:?}")))
            }
            _ => Ok(()),
        };
        positive("reserves", self.reserves, f64::MIN_POSITIVE)?;
        positive("raise-bounds", self.raise_bounds, 1.0)?;
        if let Some(n) = self.samples.filter(|n| !(samples::LEAST..=MOST_SAMPLES).contains(n)) {
            let least = samples::LEAST;
            return Err(CommandError::Option(format!("--samples is {n}; give {least} to {MOST_SAMPLES}")));
        }
        Ok(OptimizeOptions {
            trial: self.trial.as_deref().map(find_trial).transpose()?,
            data: self.data.clone(),
            ankle: self.ankle.map(|a| match a {
                AnkleChoice::Universal => Ankle::Universal,
                AnkleChoice::Parallel => Ankle::Parallel,
            }),
            hip_centre: self.hip_centre.map(|h| match h {
                HipChoice::Table => HipRule::Table,
                HipChoice::Regression => HipRule::Regression,
                HipChoice::Harrington => HipRule::Harrington,
            }),
            form: self.form(),
            bands: self.bands,
            samples: self.samples,
            sharing: SharingSettings {
                muscle_cost: self.form().muscle_cost,
                reaction_cost: self.form().reaction_cost,
                bounded: !self.unbounded,
                reserves: self.reserves,
                options: SharingOptions { raise_bounds: self.raise_bounds },
            },
            hill: hill::Settings {
                curves: match self.curves {
                    CurveChoice::Thelen => Curves::default(),
                    CurveChoice::Degroote => Curves::DeGroote(DeGroote2016::OPENSIM),
                },
                tendon: match self.tendon {
                    TendonChoice::Elastic => Tendon::Elastic,
                    TendonChoice::Rigid => Tendon::Rigid,
                },
                ..hill::Settings::default()
            },
            measured: self.measured.clone(),
            side: None,
        })
    }

    /// The leg that the options ask for.
    fn form(&self) -> Form {
        let base = match self.form {
            FormChoice::Revised => Form::REVISED,
            FormChoice::Published => Form::PUBLISHED,
        };
        Form {
            knee: match self.knee {
                Some(KneeChoice::Natural) => Some(KneeKind::Natural),
                Some(KneeChoice::Implant) => Some(KneeKind::Implant),
                None => base.knee,
            },
            passive: match self.passive {
                Some(PassiveChoice::None) => Passive::None,
                Some(PassiveChoice::Joints) => Passive::Joints,
                Some(PassiveChoice::Muscles) => Passive::Muscles,
                Some(PassiveChoice::Both) => Passive::Both,
                None => base.passive,
            },
            bounds: match self.bounds {
                Some(BoundsChoice::Strength) => Bounds::Strength,
                Some(BoundsChoice::State) => Bounds::State,
                None => base.bounds,
            },
            muscle_cost: match self.cost {
                Some(CostChoice::Force) => MuscleCost::Force,
                Some(CostChoice::Activation) => MuscleCost::Activation,
                Some(CostChoice::Volume) => MuscleCost::Volume,
                None => base.muscle_cost,
            },
            reaction_cost: match self.joint_weights {
                Some(JointWeights::Table) => ReactionCost::Table,
                Some(JointWeights::None) => ReactionCost::None,
                None => base.reaction_cost,
            },
            ..base
        }
    }

    /// What computes the same again, every option named.
    fn again(&self, done: &Optimized) -> Again {
        let mut again = Again::default();
        let name = |value: &dyn Fn() -> Option<PossibleValue>| {
            value().expect("none is hidden").get_name().to_string()
        };
        let form = self.form();
        let cost = match form.muscle_cost {
            MuscleCost::Force => "force",
            MuscleCost::Activation => "activation",
            MuscleCost::Volume => "volume",
        };
        let weights = match form.reaction_cost {
            ReactionCost::Table => "table",
            ReactionCost::None => "none",
        };
        let mut options: Vec<(&str, String)> = vec![
            ("cost", cost.into()),
            ("joint-weights", weights.into()),
            ("curves", name(&|| self.curves.to_possible_value())),
            ("tendon", name(&|| self.tendon.to_possible_value())),
            ("ankle", word(done.case.ankle).into()),
        ];
        let number = |v: f64| format!("{v:?}");
        options.push(("form", name(&|| self.form.to_possible_value())));
        options.extend(self.knee.map(|k| ("knee", name(&|| k.to_possible_value()))));
        options.extend(self.passive.map(|p| ("passive", name(&|| p.to_possible_value()))));
        options.extend(self.bounds.map(|b| ("bounds", name(&|| b.to_possible_value()))));
        options.extend(self.hip_centre.map(|h| ("hip-centre", name(&|| h.to_possible_value()))));
        options.extend(self.reserves.map(|w| ("reserves", number(w))));
        options.extend(self.raise_bounds.map(|f| ("raise-bounds", number(f))));
        options.extend(self.measured.as_ref().map(|file| ("measured", file.to_string_lossy().into_owned())));
        let trial = again.trial(&done.case.texts);
        again.arguments.push("optimize".into());
        again.arguments.extend(trial);
        again.arguments.extend(options.into_iter().map(|(option, value)| format!("--{option}={value}")));
        again.arguments.extend(self.unbounded.then(|| "--unbounded".into()));
        again.arguments.extend(self.bands.then(|| "--bands".into()));
        again.arguments.extend(self.samples.map(|n| format!("--samples={n}")));
        again
    }

    /// Settings as shown in the report and kept in `run.json`.
    fn settings(&self, done: &Optimized) -> Vec<(String, String)> {
        let case = &done.case;
        let ankle = match case.ankle {
            Ankle::Universal => "universal (2 degrees of freedom)",
            Ankle::Parallel => "parallel (1 degree of freedom)",
        };
        let form = self.form();
        let cost = match form.muscle_cost {
            MuscleCost::Force => "squared forces",
            MuscleCost::Activation => "squared activations",
            MuscleCost::Volume => "squared activations, weighted by volume",
        };
        let joints = match form.reaction_cost {
            ReactionCost::Table => "published weights (condition 2)",
            ReactionCost::None => "none (condition 1)",
        };
        let bounds = match form.bounds {
            _ if self.unbounded => "none (published form)",
            Bounds::Strength => "maximal isometric forces of gait2392",
            Bounds::State => "forces at full activation at the length and velocity of the moment",
        };
        let knee = match case.knee {
            KneeKind::Natural => "natural",
            KneeKind::Implant => "prosthesis",
        };
        let paths = if form.wrapped { "quadriceps and gastrocnemii over cylinders" } else { "as published" };
        let passive = match form.passive {
            Passive::None => "none",
            Passive::Joints => "measured moments of hip, knee and ankle",
            Passive::Muscles => "of resting muscles",
            Passive::Both => "of resting muscles, and what measured moments have beyond them",
        };
        let raised = self
            .raise_bounds
            .map_or("never".into(), |limit| format!("by up to {} where a frame is infeasible", short(limit)));
        let reserves = self.reserves.map_or("none".into(), |w| format!("weight {} 1/(N·m)²", short(w)));
        let force_hz = case.filters.force_hz.map_or("none".into(), |hz| format!("{} Hz", short(hz)));
        let curves = match self.curves {
            CurveChoice::Thelen => "Thelen 2003, gait2392 parameters",
            CurveChoice::Degroote => "De Groote et al. 2016",
        };
        let tendon = match self.tendon {
            TendonChoice::Elastic => "elastic",
            TendonChoice::Rigid => "rigid",
        };
        [
            ("Landmarks", case.landmarks.clone()),
            ("Hip centre", case.hip_centre.clone()),
            ("Knee centre", knee_centre(done)),
            ("Ankle", ankle.into()),
            ("Knee", knee.into()),
            ("Muscle paths", paths.into()),
            ("Passive forces in force sharing", passive.into()),
            ("Cost of muscle forces", cost.into()),
            ("Cost of joint forces", joints.into()),
            ("Bounds of muscle forces", bounds.into()),
            ("Bounds raised", raised),
            ("Reserves", reserves),
            ("Low-pass of velocities and accelerations", format!("{} Hz", short(case.filters.motion_hz))),
            ("Low-pass of ground reaction", force_hz),
            ("Contact threshold", format!("{} N", short(case.filters.contact_threshold))),
            ("Muscle curves", curves.into()),
            ("Tendons", tendon.into()),
        ]
        .into_iter()
        .map(|(label, value)| (label.to_string(), value))
        .collect()
    }
}

/// Where the knee centre is, in words.
fn knee_centre(done: &Optimized) -> String {
    let mm = |v: f64| format!("{:.1}", 1e3 * v);
    match done.case.quality.map(|q| q.knee_centre) {
        None => "as the landmarks have it".into(),
        Some(None) => "on the functional axis".into(),
        Some(Some(c)) => format!(
            "{} mm behind the patella marker; {} mm backward and {} mm down from the functional axis",
            mm(c.distance),
            mm(c.moved[0]),
            mm(c.moved[1])
        ),
    }
}

/// A trial file, or a shipped trial by its name.
pub(super) fn find_trial(given: &Path) -> Result<PathBuf, CommandError> {
    let found = shipped::find(given, shipped::Kind::Trial)?;
    if let Some(said) = shipped::ambiguity(given, &found) {
        coupling::say!("note: {said}");
    }
    Ok(found)
}

/// A leg that was computed, with everything that its report borrows.
struct Leg {
    done: Optimized,
    samples: Option<(Samples, Duration)>,
    settings: Vec<(String, String)>,
    muscles: Vec<MuscleInfo>,
    cycle: Option<[f64; 2]>,
    simulated: Vec<String>,
    left_out: Vec<(String, String)>,
    notes: Vec<String>,
    gait2392: Series,
}

impl Leg {
    fn of(
        done: Optimized,
        options: &OptimizeOptions,
        arguments: &OptimizeArguments,
    ) -> Result<Leg, StudyError> {
        let info = |(muscle, fractions): (&Muscle, &Fractions)| MuscleInfo {
            full_name: muscle.full_name.clone(),
            f_max: muscle.f_max,
            clipped: Some(fractions.below_zero + fractions.above_one),
        };
        let time = &done.effort.time;
        let clock = Instant::now();
        let sampled = options.samples.map(|n| samples::samples(&done.case, options, n)).transpose()?;
        Ok(Leg {
            samples: sampled.map(|samples| (samples, clock.elapsed())),
            settings: arguments.settings(&done),
            muscles: done.model.muscles.iter().zip(&done.hill.fractions).map(info).collect(),
            cycle: (done.case.is_cycle && time.len() > 1).then(|| [time[0], time[time.len() - 1]]),
            simulated: simulated(&done),
            left_out: left_out(arguments, &done),
            notes: notes(&done),
            gait2392: opensim::motion(&done.model, &done.motion, done.case.trial.side),
            done,
        })
    }

    fn report(&self) -> OptimizeReport<'_> {
        OptimizeReport {
            trial: &self.done.case.trial,
            motion: &self.done.motion,
            loads: &self.done.loads,
            effort: &self.done.effort,
            muscles: &self.muscles,
            cycle: self.cycle,
            settings: &self.settings,
            simulated: &self.simulated,
            left_out: &self.left_out,
            notes: &self.notes,
            measured: self.done.measured.as_ref(),
            bands: self.done.bands.as_ref(),
            passive: self.done.passive.as_ref(),
            emg: self.done.emg.as_deref(),
            samples: self.samples.as_ref().map(|(samples, _)| samples),
            gait2392: Some(&self.gait2392),
        }
    }
}

/// Runs the command.
pub fn run(arguments: &OptimizeArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let options = arguments.options()?;
    let stem = options.trial.as_deref().and_then(Path::file_stem);
    let name = stem.map_or("walker".into(), |stem| stem.to_string_lossy());
    let claim = arguments.out.claim("optimize", &name)?;
    if sides(&options)?.len() > 1 {
        return run_both(arguments, &options, claim, quiet);
    }
    let stages: Vec<&str> = with_samples(&options).into_iter().chain(["write"]).collect();
    let mut progress = Progress::new(&stages, quiet);
    let done = optimize_with(&options, &mut |stage| progress.lap(stage))?;
    let leg = Leg::of(done, &options, arguments)?;
    if options.samples.is_some() {
        progress.lap(SAMPLES);
    }
    let report = leg.report();
    let folder = claim.path();
    let summary = Summary::of(&report);
    let record = record(arguments, &[(&leg, &summary)])?;
    let files = write_optimize(OutputFolder::begin(claim, false)?, &report, record)?;
    progress.lap("write");
    drop(progress);
    say(arguments.json, &summary, |out| print(out, &leg.done, &summary, &folder, files.len()));
    Ok(outcome(&[&summary]))
}

/// Stages of one leg.
fn with_samples(options: &OptimizeOptions) -> Vec<&'static str> {
    stages(options).into_iter().chain(options.samples.map(|_| SAMPLES)).collect()
}

/// Stage of the samples.
const SAMPLES: &str = "samples";
/// More samples would take hours.
const MOST_SAMPLES: usize = 1_000_000;

/// Both legs of a trial: a folder for each, and a page of both.
fn run_both(
    arguments: &OptimizeArguments,
    options: &OptimizeOptions,
    claim: Claim,
    quiet: bool,
) -> Result<Outcome, CommandError> {
    let of_side = |side| OptimizeOptions {
        side: Some(side),
        // One knee is instrumented: that of the main tables.
        measured: options.measured.clone().filter(|_| side == Side::Right),
        ..options.clone()
    };
    let of_leg = |side: Side, stage: &str| format!("{} {stage}", side.name());
    let of_one = with_samples(options);
    let mut stages = vec![of_one[0].to_string()];
    stages.extend(SIDES.iter().flat_map(|side| of_one[1..].iter().map(|stage| of_leg(*side, stage))));
    stages.push("write".into());
    let mut progress = Progress::new(&stages, quiet);
    let cases = both_cases(SIDES.map(|side| Case::load(&of_side(side))))?;
    progress.lap(of_one[0]);
    let mut legs = Vec::new();
    for (case, side) in cases.into_iter().zip(SIDES) {
        let done = solve(case, &of_side(side), &mut |stage| progress.lap(&of_leg(side, stage)));
        let done = done.map_err(|error| stopped(side, error))?;
        let leg = Leg::of(done, &of_side(side), arguments).map_err(|error| stopped(side, error))?;
        if options.samples.is_some() {
            progress.lap(&of_leg(side, SAMPLES));
        }
        legs.push(leg);
    }
    let reports = [legs[0].report(), legs[1].report()];
    let verdict = BothLegs::of(&reports);
    let folder = claim.path();
    let record = record(arguments, &[(&legs[0], &verdict.right), (&legs[1], &verdict.left)])?;
    let files = write_both_legs(OutputFolder::begin(claim, false)?, &reports, record)?;
    progress.lap("write");
    drop(progress);
    say(arguments.json, &verdict, |out| {
        for ((leg, summary), name) in legs.iter().zip([&verdict.right, &verdict.left]).zip(LEG_FOLDERS) {
            let own = files.iter().filter(|file| Path::new(file).starts_with(name)).count();
            print(out, &leg.done, summary, &folder.join(name), own)?;
            writeln!(out)?;
        }
        writeln!(out, "both legs side by side: {}", folder.join("report.html").display())
    });
    Ok(outcome(&[&verdict.right, &verdict.left]))
}

/// Legs in the order of their results.
const SIDES: [Side; 2] = [Side::Right, Side::Left];

/// The cases of both legs, or what is wrong with either.
fn both_cases(read: [Result<Case, StudyError>; 2]) -> Result<[Case; 2], CommandError> {
    match read {
        [Ok(right), Ok(left)] => Ok([right, left]),
        [Err(StudyError::Input(right)), Err(StudyError::Input(left))] => {
            let mut wrong = Mistakes::default();
            let [mut of_right, mut of_left] = [Mistakes::default(), Mistakes::default()];
            of_right.note(right);
            of_left.note(left);
            wrong.note_legs(vec![(Side::Right.name(), of_right), (Side::Left.name(), of_left)]);
            Err(wrong.finish().expect_err("two mistakes").into())
        }
        [Err(error), _] => Err(stopped(Side::Right, error)),
        [_, Err(error)] => Err(stopped(Side::Left, error)),
    }
}

/// What stopped one of both legs.
fn stopped(side: Side, error: StudyError) -> CommandError {
    match error {
        StudyError::Input(error) => error.of_leg(side.name()).into(),
        // What the command line says holds for both.
        StudyError::Option(text) => CommandError::Option(text),
        error => CommandError::OfLeg { side: side.name(), source: Box::new(error) },
    }
}

fn outcome(summaries: &[&Summary]) -> Outcome {
    if summaries.iter().all(|s| s.all_solved()) { Outcome::Solved } else { Outcome::NotSolved }
}

/// The verdict as JSON, or in words. A reader that closes the pipe early is no error.
fn say(
    json: bool,
    verdict: &impl Serialize,
    words: impl FnOnce(&mut std::io::StdoutLock) -> std::io::Result<()>,
) {
    let mut out = std::io::stdout().lock();
    let _ = match json {
        true => {
            writeln!(out, "{}", serde_json::to_string_pretty(verdict).expect("a summary is plain data"))
        }
        false => words(&mut out),
    };
}

/// What `run.json` says of one leg or of both.
fn record(arguments: &OptimizeArguments, legs: &[(&Leg, &Summary)]) -> Result<RunRecord, CommandError> {
    let mut record = RunRecord::new("optimize");
    let is_one = legs.len() == 1;
    let mut reasons = Vec::new();
    for (leg, summary) in legs {
        let done = &leg.done;
        let side = done.case.trial.side.name();
        let of_leg = |what: &str| if is_one { what.to_string() } else { format!("{side} {what}") };
        if !summary.all_solved() {
            let (whose, folder) =
                if is_one { Default::default() } else { (format!("{side} leg: "), format!("{side}/")) };
            reasons.push(format!(
                "{whose}{} of {} frames are not solved; see {folder}verdicts.csv",
                summary.frames - summary.solved,
                summary.frames
            ));
        }
        for path in &done.case.inputs {
            let file = InputFile::of(path)?;
            if !record.inputs.contains(&file) {
                record.inputs.push(file);
            }
        }
        for (name, took) in &done.stages {
            record.stage(&of_leg(name), *took);
        }
        if let Some((_, took)) = &leg.samples {
            record.stage(&of_leg(SAMPLES), *took);
        }
        let fit: usize = done.motion.fit.iter().map(|f| f.iterations).sum();
        let sharing: u64 = done.effort.verdicts.iter().map(|v| u64::from(v.iterations)).sum();
        record.iterations.insert(of_leg("marker fit"), fit as u64);
        record.iterations.insert(of_leg("sharing"), sharing);
    }
    if let Some(path) = &arguments.measured {
        record.inputs.push(InputFile::of(path)?);
    }
    if !reasons.is_empty() {
        record.status = RunStatus::NotConverged;
        record.reason = Some(reasons.join("; "));
    }
    // Both legs have the same settings, and the same command computes both again.
    let Leg { done, settings, .. } = legs[0].0;
    record.settings = settings.iter().map(|(k, v)| (k.clone(), serde_json::Value::from(v.clone()))).collect();
    record.of_trial(&done.case.trial);
    if !is_one {
        record.subject = Some(format!("{}, both legs", who(&done.case.trial)));
    }
    record.again = arguments.again(done);
    Ok(record)
}

fn simulated(done: &Optimized) -> Vec<String> {
    let model = &done.model;
    vec![
        format!("Five segments, spherical hip, sphere-on-plane knee with isometric ACL, PCL and MCL, patella on a hinge with isometric tendon; {} markers.", model.markers.len()),
        format!("{} muscle lines of action with conditional points on {} joint coordinates.", model.muscles.len(), model.coordinate_names().len()),
        "Gravity, inertia of foot, shank, patella and thigh, and the ground reaction on the foot.".to_string(),
        "One convex force-sharing problem per frame for muscle, contact, ligament and bone forces, then Hill-type activations.".to_string(),
    ]
}

fn left_out(arguments: &OptimizeArguments, done: &Optimized) -> Vec<(String, String)> {
    let mut list = vec![("Deformable thigh".to_string(), "optimize is the rigid side alone".to_string())];
    let form = arguments.form();
    if !form.passive.of_muscles() {
        list.push((
            "Passive muscle force in force sharing".to_string(),
            "muscles are lines of tension; passive force enters with the activations".to_string(),
        ));
    }
    if !form.passive.of_joints() {
        list.push(("Passive joint moments".to_string(), "not asked for (--passive)".to_string()));
    }
    if arguments.samples.is_none() {
        list.push(("Scatter of the inputs".to_string(), "not asked for (--samples)".to_string()));
    }
    if !arguments.bands {
        list.push(("Bands of joint forces".to_string(), "not asked for (--bands)".to_string()));
    }
    if arguments.reserves.is_none() {
        list.push(("Reserve moments".to_string(), "not asked for (--reserves)".to_string()));
    }
    if arguments.measured.is_some() && done.measured.is_none() && done.not_compared.is_none() {
        list.push(("Measured knee forces".to_string(), "compared with the right leg".to_string()));
    }
    list
}

/// What the reader of the page must know: the warnings, and what became of the activations.
fn notes(done: &Optimized) -> Vec<String> {
    let mut notes = warnings(done);
    let overall = &done.hill.overall;
    notes.push(format!(
        "Activations clipped at 0 in {:.1} % of samples (mostly resting muscles with passive force, which force sharing does not know), at 1 in {:.1} %; fibre length limited in {:.1} %.",
        100.0 * overall.below_zero,
        100.0 * overall.above_one,
        100.0 * overall.length_limited
    ));
    notes
}

/// The ankle as its option names it.
fn word(ankle: Ankle) -> &'static str {
    match ankle {
        Ankle::Universal => "universal",
        Ankle::Parallel => "parallel",
    }
}

/// What makes these results less certain than others.
fn warnings(done: &Optimized) -> Vec<String> {
    let mut notes = done.case.doubts.clone();
    notes.extend(done.not_compared.clone());
    let mm = |v: f64| format!("{:.1}", 1e3 * v);
    if let Some(q) = &done.case.quality {
        notes.push(format!(
            "Knee and ankle axes come from motion: residual {} mm over {:.0} degrees at the knee, {} mm over {:.0} degrees at the ankle. A standing trial with landmark markers would be more certain.",
            mm(q.knee_rms),
            q.knee_range.to_degrees(),
            mm(q.ankle_rms),
            q.ankle_range.to_degrees()
        ));
        if let Some(c) = &q.knee_centre {
            let word = if c.is_plausible() {
                ""
            } else {
                " That is more than skin explains: check which marker is the patella's, and the distance."
            };
            let [back, down] = c.moved.map(mm);
            notes.push(format!(
                "The knee centre was moved {back} mm backward and {down} mm down from the functional axis, to {} mm behind the patella marker, because skin that slides moves a functional axis.{word}",
                mm(c.distance)
            ));
        }
    }
    let fits = &done.motion.fit[done.motion.report.clone()];
    let cautions: std::collections::BTreeSet<&String> =
        fits.iter().filter(|f| f.failure.is_none()).filter_map(|f| f.caution.as_ref()).collect();
    if !cautions.is_empty() {
        let list: Vec<&str> = cautions.iter().map(|c| c.as_str()).take(4).collect();
        notes.push(format!(
            "Some frames are fitted with less certainty ({}); column caution of verdicts.csv.",
            list.join("; ")
        ));
    }
    let rms = done.motion.marker_rms();
    if rms > DOUBTFUL_RESIDUAL {
        notes.push(format!(
            "The marker residual of {} mm is far above what soft tissue explains (5 to 10 mm in walking): check which marker is which, the landmarks and the hip centre.",
            mm(rms)
        ));
    }
    let unused: Vec<&str> = done
        .case
        .trial
        .markers
        .iter()
        .filter(|t| done.model.markers.iter().all(|m| m.name != t.name))
        .map(|t| t.name.as_str())
        .collect();
    if !unused.is_empty() {
        notes.push(format!(
            "Markers without a place on the model, not used in the fit: {}.",
            unused.join(", ")
        ));
    }
    notes
}

/// Marker residual that no soft tissue explains \[m\].
const DOUBTFUL_RESIDUAL: f64 = 0.025;
/// Runs of unsolved frames that are spelt out on the terminal.
const PROBLEMS_SHOWN: usize = 8;

/// The summary in words.
fn print(
    out: &mut impl Write,
    done: &Optimized,
    summary: &Summary,
    folder: &Path,
    n_files: usize,
) -> std::io::Result<()> {
    writeln!(
        out,
        "{}: {} of {} frames solved ({}, {} ankle)",
        done.case.trial.name,
        summary.solved,
        summary.frames,
        words(&done.case.trial),
        word(done.case.ankle)
    )?;
    if let (Some(over), true) = (summary.over(), summary.solved > 0) {
        writeln!(out, "  forces and activations are over {over}, the others have no solution")?;
    }
    let show = |value: Option<f64>, unit: &str, digits: usize| {
        value.map_or("-".to_string(), |v| format!("{} {unit}", plain(v, digits)))
    };
    writeln!(out, "  marker residual        {} RMS", show(summary.marker_rms_mm, "mm", 2))?;
    writeln!(
        out,
        "  peak knee force        {} = {} at {}",
        show(summary.peak_knee_force_N, "N", 0),
        show(summary.peak_knee_force_bw, "body weights", 2),
        show(summary.peak_knee_force_time_s, "s", 3)
    )?;
    writeln!(
        out,
        "  largest force/strength {} ({})",
        show(summary.largest_load, "", 2).trim_end(),
        summary.largest_load_muscle.as_deref().unwrap_or("-")
    )?;
    writeln!(
        out,
        "  largest KKT residual   {} (tolerance {KKT_TOLERANCE:.0e})",
        summary.largest_kkt_residual.map_or("-".into(), |v| format!("{v:.1e}"))
    )?;
    writeln!(
        out,
        "  activations clipped    {}",
        show(summary.clipped_share.map(|s| 100.0 * s), "% of samples", 1)
    )?;
    if let Some(when) = summary.largest_reserve_share_time_s {
        writeln!(
            out,
            "  reserves carry         up to {:.0} % of the joint moments of a frame (at {when:.3} s); muscle and joint forces lack it:",
            100.0 * summary.largest_reserve_share
        )?;
        for r in &summary.reserves {
            writeln!(
                out,
                "    {:<20} {:>8.2} N·m at {:.3} s, {:.0} % of {:.2} N·m needed there, {:.0} % of the largest moment needed{}",
                r.coordinate,
                r.largest_Nm,
                r.time_s,
                100.0 * r.fraction,
                r.needed_Nm,
                100.0 * r.fraction_of_peak,
                if r.is_much() { ": much" } else { "" }
            )?;
        }
    }
    if let (Some(curves), Some(compared)) = (&summary.measured, summary.compared_frames) {
        writeln!(out, "  against measured knee force, over {compared} of {} frames:", summary.frames)?;
        for (name, a) in curves {
            writeln!(
                out,
                "    {name:<8} RMSE {:.0} N = {:.2} BW, 1 - SSE/SST {}, squared correlation {}, peak error {:+.0} N = {:+.2} BW",
                a.rmse_N,
                a.rmse_bw,
                a.determination.map_or("-".into(), |r| plain(r, 2)),
                a.squared_correlation.map_or("-".into(), |r| plain(r, 2)),
                a.peak_error_N,
                a.peak_error_bw
            )?;
        }
    }
    if let Some(compared) = &done.emg {
        if let Some(overall) = emg::overall(compared) {
            let n = compared.iter().filter(|c| c.defect.is_none()).count();
            writeln!(
                out,
                "  concordance with EMG   {:.0} % of frames, mean of {n} of {} channels",
                100.0 * overall,
                compared.len()
            )?;
        }
        for c in compared {
            let said = match (c.defect, c.concordance) {
                (Some(defect), _) => defect.words().to_string(),
                (None, Some(part)) => format!("{:.0} %", 100.0 * part),
                (None, None) => "-".into(),
            };
            writeln!(out, "    {:<20} {said} ({})", c.channel, c.muscles.join(" "))?;
        }
    }
    for note in warnings(done) {
        writeln!(out, "  note: {note}")?;
    }
    let runs = runs(&done.motion, &done.effort);
    let problems: Vec<&Run> = runs.iter().filter(|r| r.mark != Mark::Solved).collect();
    for problem in problems.iter().take(PROBLEMS_SHOWN) {
        let time = &done.effort.time;
        let (first, last) = (time[problem.frames.start], time[problem.frames.end - 1]);
        let (frames, when) = match problem.frames.len() {
            1 => ("frame", format!("{first:.3} s")),
            _ => ("frames", format!("{first:.3} to {last:.3} s")),
        };
        let (numbers, how) = (problem.numbers(), problem.mark.words());
        writeln!(out, "  {frames} {numbers} ({when}): {how}, {}", problem.why)?;
    }
    if problems.len() > PROBLEMS_SHOWN {
        let more = problems.len() - PROBLEMS_SHOWN;
        writeln!(out, "  … and {more} more such runs of frames; see verdicts.csv")?;
    }
    let seconds: f64 = done.stages.iter().map(|s| s.1.as_secs_f64()).sum();
    writeln!(
        out,
        "  computed in {seconds:.3} s; {n_files} files in {}, open report.html there",
        folder.display()
    )
}
