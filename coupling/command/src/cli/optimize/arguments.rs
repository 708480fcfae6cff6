//! The options of `sartorius optimize`: what they ask for, in words, and as the command that computes the same again.

use std::path::{Path, PathBuf};

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use multibody::informed::Informed;
use multibody::model::{Ankle, KneeKind};
use multibody::muscle::curves::{Curves, DeGroote2016};
use multibody::muscle::hill::{self, Tendon};
use multibody::share::SharingSettings;
use multibody::sharing::{MuscleCost, ReactionCost, SharingOptions};
use multibody::shipped;
use multibody::trial_file::HipRule;

use crate::cli::OutArguments;
use crate::error::CommandError;
use crate::output::origin::Again;
use coupling::form::{Bounds, Form, Passive};
use coupling::number::short;
use coupling::optimize::{OptimizeOptions, Optimized};
use coupling::options::EMG_WEIGHTS;
use coupling::samples;

#[derive(Args)]
pub struct OptimizeArguments {
    #[arg(help = trials())]
    pub(super) trial: Option<PathBuf>,
    /// Folder of the recordings that the trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    pub(super) out: OutArguments,
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
    pub(super) bands: bool,
    /// How sure the knee forces are: compute the trial at least this often with landmarks, strengths, masses, markers and costs that scatter;
    /// joint_force_samples.csv, samples.csv, sobol.csv and a section of the page. Every other frame is computed.
    #[arg(long, value_name = "N")]
    pub(super) samples: Option<usize>,
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
    pub(super) reserves: Option<f64>,
    /// Where a frame is infeasible, raise all strengths together by up to this factor: what forces would do, in least_violation.csv. The frame stays unsolved.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    raise_bounds: Option<f64>,
    /// Heed the electromyograms of the trial: what it costs to be off them, relative to what forces cost. Moments and bounds hold as without.
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
    pub(super) emg_weight: Option<f64>,
    /// Muscle curves for activations.
    #[arg(long, value_enum, default_value = "thelen")]
    curves: CurveChoice,
    /// Tendons for activations.
    #[arg(long, value_enum, default_value = "elastic")]
    tendon: TendonChoice,
    /// Measured knee forces to compare with: `time_s, medial_N, lateral_N`, or four load cells in pounds-force. Of a trial of both legs:
    /// those of the right knee.
    #[arg(long, value_name = "FILE")]
    pub(super) measured: Option<PathBuf>,
    /// capacities.csv of `compare --two-way` on a scene of this trial with steps over the whole cycle: forces are shared a second time with what
    /// the muscles of the deformable thigh can do; muscle_forces_with_thigh.csv, joint_forces_with_thigh.csv and a section of the page. Of a
    /// trial of both legs: the right one.
    #[arg(long, value_name = "FILE")]
    pub(super) thigh: Option<PathBuf>,
    /// Print the verdict as JSON.
    #[arg(long)]
    pub(super) json: bool,
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
pub(in crate::cli) fn trials() -> String {
    let names: Vec<&str> = shipped::Kind::Trial.all().map(|(name, _)| name).collect();
    format!(
        "Trial file (TOML), or the name of a shipped trial: {}; their recordings are found with --data. A word alone is a name, ./word a \
         file. Default: the built-in walker",
        names.join(", ")
    )
}

impl OptimizeArguments {
    pub(super) fn options(&self) -> Result<OptimizeOptions, CommandError> {
        let positive = |name: &str, value: Option<f64>, least: f64| match value {
            Some(v) if !(v.is_finite() && v >= least) => {
                Err(CommandError::Option(format!("--{name} is {v}; give a number of at least {least:?}")))
            }
            _ => Ok(()),
        };
        positive("reserves", self.reserves, f64::MIN_POSITIVE)?;
        positive("raise-bounds", self.raise_bounds, 1.0)?;
        if let Some(w) = self.emg_weight.filter(|w| !EMG_WEIGHTS.contains(w)) {
            let (least, most) = (EMG_WEIGHTS.start(), EMG_WEIGHTS.end());
            return Err(CommandError::Option(format!("--emg-weight is {w}; give {least} to {most}")));
        }
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
            emg_weight: self.emg_weight,
            measured: self.measured.clone(),
            thigh: self.thigh.clone(),
            side: None,
            changes: Default::default(),
        })
    }

    /// The leg that the options ask for.
    pub(super) fn form(&self) -> Form {
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
    pub(super) fn again(&self, done: &Optimized) -> Again {
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
        options.extend(self.emg_weight.map(|w| ("emg-weight", number(w))));
        options.extend(self.thigh.as_ref().map(|file| ("thigh", file.to_string_lossy().into_owned())));
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
    pub(super) fn settings(&self, done: &Optimized) -> Vec<(String, String)> {
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
        let heeded = done.informed.as_ref().map_or("no".into(), heeded);
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
            ("Electromyograms heeded", heeded),
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

/// More samples would take hours.
const MOST_SAMPLES: usize = 1_000_000;

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

/// How electromyograms are heeded, in words.
pub(super) fn heeded(informed: &Informed) -> String {
    let Informed { weight, activation, .. } = informed;
    format!("weight {}; every channel is taken to reach an activation of {activation:.2}", short(*weight))
}

/// The ankle as its option names it.
pub(super) fn word(ankle: Ankle) -> &'static str {
    match ankle {
        Ankle::Universal => "universal",
        Ankle::Parallel => "parallel",
    }
}

/// A trial file, or a shipped trial by its name.
pub(in crate::cli) fn find_trial(given: &Path) -> Result<PathBuf, CommandError> {
    let found = shipped::find(given, shipped::Kind::Trial)?;
    if let Some(said) = shipped::ambiguity(given, &found) {
        coupling::say!("note: {said}");
    }
    Ok(found)
}
