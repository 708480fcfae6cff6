//! `sartorius optimize [TRIAL]`: arguments, output folder, words on the terminal.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use multibody::model::Ankle;
use multibody::muscle::curves::{Curves, DeGroote2016};
use multibody::muscle::hill::{self, Tendon};
use multibody::share::SharingSettings;
use multibody::sharing::{KKT_TOLERANCE, MuscleCost, ReactionCost, SharingOptions};
use multibody::trial_file::HipRule;

use super::Outcome;
use crate::error::CommandError;
use crate::number::{plain, short};
use crate::optimize::{OptimizeOptions, Optimized, optimize};
use crate::output::opensim;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus};
use crate::output::write_optimize;
use crate::report::{MuscleInfo, OptimizeReport, Summary};
use crate::subject::words;

#[derive(Args)]
pub struct OptimizeArguments {
    /// Trial file (TOML), or the name of a shipped trial such as DM_ngait_og3. Default: the built-in walker.
    trial: Option<PathBuf>,
    /// Folder of the recordings that the trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the results [default: out/optimize-<trial>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
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
    /// Measured knee forces to compare with: `time_s, medial_N, lateral_N`, or four load cells in pounds-force.
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
            trial: self.trial.as_deref().map(find_trial),
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

/// A path as it is, or the name of a trial shipped in `gait-data/trials`.
pub(super) fn find_trial(given: &Path) -> PathBuf {
    if given.exists() || given.extension().is_some() || given.components().count() > 1 {
        return given.to_path_buf();
    }
    let shipped = Path::new("gait-data/trials").join(given).with_extension("toml");
    if shipped.exists() { shipped } else { given.to_path_buf() }
}

/// Runs the command.
pub fn run(arguments: &OptimizeArguments) -> Result<Outcome, CommandError> {
    let options = arguments.options()?;
    let done = optimize(&options)?;
    let settings = arguments.settings(&done);
    let muscles: Vec<MuscleInfo> = done
        .model
        .muscles
        .iter()
        .zip(&done.hill.shares)
        .map(|(muscle, shares)| MuscleInfo {
            full_name: muscle.full_name.clone(),
            f_max: muscle.f_max,
            clipped: Some(shares.below_zero + shares.above_one),
        })
        .collect();
    let time = &done.effort.time;
    let cycle = (done.case.is_cycle && time.len() > 1).then(|| [time[0], time[time.len() - 1]]);
    let report = OptimizeReport {
        trial: &done.case.trial,
        motion: &done.motion,
        loads: &done.loads,
        effort: &done.effort,
        muscles: &muscles,
        cycle,
        settings: &settings,
        simulated: &simulated(&done),
        left_out: &left_out(arguments),
        notes: &notes(&done),
        measured: done.measured.as_ref(),
        gait2392: Some(&opensim::motion(&done.model, &done.motion, done.case.trial.side)),
    };
    let folder = match &arguments.out {
        Some(folder) => folder.clone(),
        None => Path::new("out").join(format!("optimize-{}", done.case.trial.name)),
    };
    let summary = Summary::of(&report);
    let outcome = if summary.all_solved() { Outcome::Solved } else { Outcome::NotSolved };
    let record = record(arguments, &done, &settings, &summary)?;
    let files = write_optimize(&folder, &report, record)?;
    let mut out = std::io::stdout().lock();
    if arguments.json {
        let json = serde_json::to_string_pretty(&summary).expect("a summary is plain data");
        let _ = writeln!(out, "{json}");
    } else {
        let _ = print(&mut out, &done, &summary, &folder, files.len());
    }
    Ok(outcome)
}

fn record(
    arguments: &OptimizeArguments,
    done: &Optimized,
    settings: &[(String, String)],
    summary: &Summary,
) -> Result<RunRecord, CommandError> {
    let mut record = RunRecord::new("optimize");
    if !summary.all_solved() {
        record.status = RunStatus::NotConverged;
        let unsolved = summary.frames - summary.solved;
        record.reason =
            Some(format!("{unsolved} of {} frames are not solved; see verdicts.csv", summary.frames));
    }
    record.settings = settings.iter().map(|(k, v)| (k.clone(), serde_json::Value::from(v.clone()))).collect();
    for path in done.case.inputs.iter().chain(&arguments.measured) {
        record.inputs.push(InputFile::of(path)?);
    }
    for (name, took) in &done.stages {
        record.stage(name, *took);
    }
    record.of_trial(&done.case.trial);
    record.again = arguments.again(done);
    let fit: usize = done.motion.fit.iter().map(|f| f.iterations).sum();
    let sharing: u64 = done.effort.verdicts.iter().map(|v| u64::from(v.iterations)).sum();
    record.iterations = [("marker fit".to_string(), fit as u64), ("sharing".to_string(), sharing)].into();
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

fn left_out(arguments: &OptimizeArguments) -> Vec<(String, String)> {
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
    let mut notes = Vec::new();
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
/// Unsolved frames that are spelt out on the terminal.
const REASONS_SHOWN: usize = 8;

/// The summary in words. A reader that closes the pipe early is no error.
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
                100.0 * r.share,
                r.needed_Nm,
                100.0 * r.share_of_peak,
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
    let reasons: Vec<(usize, &String)> = done
        .effort
        .verdicts
        .iter()
        .enumerate()
        .filter_map(|(k, verdict)| Some((k, verdict.reason.as_ref()?)))
        .collect();
    for (k, reason) in reasons.iter().take(REASONS_SHOWN) {
        writeln!(out, "  frame {k} at {:.3} s: {reason}", done.effort.time[*k])?;
    }
    if reasons.len() > REASONS_SHOWN {
        writeln!(out, "  … and {} more frames; see verdicts.csv", reasons.len() - REASONS_SHOWN)?;
    }
    let seconds: f64 = done.stages.iter().map(|s| s.1.as_secs_f64()).sum();
    writeln!(
        out,
        "  computed in {seconds:.3} s; {n_files} files in {}, open report.html there",
        folder.display()
    )
}
