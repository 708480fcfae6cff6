//! `sartorius optimize [TRIAL]`: from the options to the output folder.

mod arguments;
mod words;

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use multibody::error::Mistakes;
use multibody::muscle::hill::Fractions;
use multibody::muscle::path::Muscle;
use multibody::trial::Side;
use serde::Serialize;

use super::Outcome;
use super::progress::Progress;
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::claim::{Claim, LEG_FOLDERS};
use crate::output::opensim;
use crate::output::origin::InputFile;
use crate::output::run::{RunRecord, RunStatus};
use crate::output::tables::Series;
use crate::output::{write_both_legs, write_optimize};
use crate::report::both::BothLegs;
use crate::report::{MuscleInfo, OptimizeReport, Summary};
use coupling::error::CouplingError;
use coupling::optimize::{Case, OptimizeOptions, Optimized, WithThigh, optimize_with, sides, solve, stages};
use coupling::samples::{self, Samples};
use coupling::subject::who;
use words::{left_out, notes, print, simulated};

pub use arguments::OptimizeArguments;
pub(super) use arguments::find_trial;

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
    ) -> Result<Leg, CouplingError> {
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
            with_thigh: self.done.with_thigh.as_ref(),
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
    Ok(outcome(&[(&leg, &summary)]))
}

/// Stages of one leg.
fn with_samples(options: &OptimizeOptions) -> Vec<&'static str> {
    stages(options).into_iter().chain(options.samples.map(|_| SAMPLES)).collect()
}

/// Stage of the samples.
const SAMPLES: &str = "samples";

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
        // The thigh of a scene is a right one.
        thigh: options.thigh.clone().filter(|_| side == Side::Right),
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
    Ok(outcome(&[(&legs[0], &verdict.right), (&legs[1], &verdict.left)]))
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

fn outcome(legs: &[(&Leg, &Summary)]) -> Outcome {
    let is_solved = |(leg, summary): &(&Leg, &Summary)| {
        summary.all_solved() && leg.done.with_thigh.as_ref().is_none_or(WithThigh::is_solved)
    };
    if legs.iter().all(is_solved) { Outcome::Solved } else { Outcome::NotSolved }
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
        if let Some(with_thigh) = done.with_thigh.as_ref().filter(|t| !t.is_solved()) {
            reasons.push(format!("with the deformable thigh {}", with_thigh.words()));
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
    for path in [&arguments.measured, &arguments.thigh].into_iter().flatten() {
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
