//! `sartorius optimize [TRIAL]`: arguments, output folder, words on the terminal.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use multibody::error::Mistakes;
use multibody::model::Ankle;
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
use coupling::error::CouplingError;
use coupling::number::{plain, short};
use coupling::optimize::{Case, OptimizeOptions, Optimized, STAGES, optimize_with, sides, solve};
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
    /// What muscle forces cost: squared forces, squared activations, or squared activations weighted by volume.
    #[arg(long, value_enum, default_value = "force")]
    cost: CostChoice,
    /// What joint contact, ligament and bone forces cost: the published weights (condition 2) or nothing (condition 1).
    #[arg(long, value_enum, default_value = "table")]
    joint_weights: JointWeights,
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
            sharing: SharingSettings {
                muscle_cost: match self.cost {
                    CostChoice::Force => MuscleCost::Force,
                    CostChoice::Activation => MuscleCost::Activation,
                    CostChoice::Volume => MuscleCost::Volume,
                },
                reaction_cost: match self.joint_weights {
                    JointWeights::Table => ReactionCost::Table,
                    JointWeights::None => ReactionCost::None,
                },
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
            changes: Default::default(),
        })
    }

    /// What computes the same again, every option named.
    fn again(&self, done: &Optimized) -> Again {
        let mut again = Again::default();
        let name = |value: &dyn Fn() -> Option<PossibleValue>| {
            value().expect("none is hidden").get_name().to_string()
        };
        let mut options: Vec<(&str, String)> = vec![
            ("cost", name(&|| self.cost.to_possible_value())),
            ("joint-weights", name(&|| self.joint_weights.to_possible_value())),
            ("curves", name(&|| self.curves.to_possible_value())),
            ("tendon", name(&|| self.tendon.to_possible_value())),
            ("ankle", word(done.case.ankle).into()),
        ];
        let number = |v: f64| format!("{v:?}");
        options.extend(self.hip_centre.map(|h| ("hip-centre", name(&|| h.to_possible_value()))));
        options.extend(self.reserves.map(|w| ("reserves", number(w))));
        options.extend(self.raise_bounds.map(|f| ("raise-bounds", number(f))));
        options.extend(self.measured.as_ref().map(|file| ("measured", file.to_string_lossy().into_owned())));
        let trial = again.trial(&done.case.texts);
        again.arguments.push("optimize".into());
        again.arguments.extend(trial);
        again.arguments.extend(options.into_iter().map(|(option, value)| format!("--{option}={value}")));
        again.arguments.extend(self.unbounded.then(|| "--unbounded".into()));
        again
    }

    /// Settings as shown in the report and kept in `run.json`.
    fn settings(&self, done: &Optimized) -> Vec<(String, String)> {
        let case = &done.case;
        let ankle = match case.ankle {
            Ankle::Universal => "universal (2 degrees of freedom)",
            Ankle::Parallel => "parallel (1 degree of freedom)",
        };
        let cost = match self.cost {
            CostChoice::Force => "squared forces",
            CostChoice::Activation => "squared activations",
            CostChoice::Volume => "squared activations, weighted by volume",
        };
        let joints = match self.joint_weights {
            JointWeights::Table => "published weights (condition 2)",
            JointWeights::None => "none (condition 1)",
        };
        let bounds =
            if self.unbounded { "none (published form)" } else { "maximal isometric forces of gait2392" };
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
            ("Ankle", ankle.into()),
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
    settings: Vec<(String, String)>,
    muscles: Vec<MuscleInfo>,
    cycle: Option<[f64; 2]>,
    simulated: Vec<String>,
    left_out: Vec<(String, String)>,
    notes: Vec<String>,
    gait2392: Series,
}

impl Leg {
    fn of(done: Optimized, arguments: &OptimizeArguments) -> Leg {
        let info = |(muscle, fractions): (&Muscle, &Fractions)| MuscleInfo {
            full_name: muscle.full_name.clone(),
            f_max: muscle.f_max,
            clipped: Some(fractions.below_zero + fractions.above_one),
        };
        let time = &done.effort.time;
        Leg {
            settings: arguments.settings(&done),
            muscles: done.model.muscles.iter().zip(&done.hill.fractions).map(info).collect(),
            cycle: (done.case.is_cycle && time.len() > 1).then(|| [time[0], time[time.len() - 1]]),
            simulated: simulated(&done),
            left_out: left_out(arguments, &done),
            notes: notes(&done),
            gait2392: opensim::motion(&done.model, &done.motion, done.case.trial.side),
            done,
        }
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
    let stages: Vec<&str> = STAGES.into_iter().chain(["write"]).collect();
    let mut progress = Progress::new(&stages, quiet);
    let leg = Leg::of(optimize_with(&options, &mut |stage| progress.lap(stage))?, arguments);
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
    let mut stages = vec![STAGES[0].to_string()];
    stages.extend(SIDES.iter().flat_map(|side| STAGES[1..].iter().map(|stage| of_leg(*side, stage))));
    stages.push("write".into());
    let mut progress = Progress::new(&stages, quiet);
    let cases = both_cases(SIDES.map(|side| Case::load(&of_side(side))))?;
    progress.lap(STAGES[0]);
    let mut legs = Vec::new();
    for (case, side) in cases.into_iter().zip(SIDES) {
        let done = solve(case, &of_side(side), &mut |stage| progress.lap(&of_leg(side, stage)));
        legs.push(Leg::of(done.map_err(|error| stopped(side, error))?, arguments));
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
fn both_cases(read: [Result<Case, CouplingError>; 2]) -> Result<[Case; 2], CommandError> {
    match read {
        [Ok(right), Ok(left)] => Ok([right, left]),
        [Err(CouplingError::Input(right)), Err(CouplingError::Input(left))] => {
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
fn stopped(side: Side, error: CouplingError) -> CommandError {
    match error {
        CouplingError::Input(error) => error.of_leg(side.name()).into(),
        // What the command line says holds for both.
        CouplingError::Option(text) => CommandError::Option(text),
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
    let mut list = vec![
        ("Deformable thigh".to_string(), "optimize is the rigid side alone".to_string()),
        (
            "Passive muscle force in force sharing".to_string(),
            "muscles are lines of tension; passive force enters with the activations".to_string(),
        ),
    ];
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
