//! Keys of the study file, and what it holds before it is checked.

use std::collections::BTreeMap;
use std::path::PathBuf;

use multibody::keys::Kind::{Count, File, Flag, Number, Sections, Settings, Text, Values, Word};
use multibody::keys::Need::{Default as Is, Optional, Required};
use multibody::keys::{Key, key};
use serde::Deserialize;
use toml::{Spanned, Value};

use super::vary::{Distribution, Sequence, Target};

/// One row per key of a study; a test compares them with the struct.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("run", Word(&["optimize", "compare"]), Is("\"optimize\""), "", "What one run is: the rigid leg alone, or a scene with its deformable thigh", "\"compare\""),
    key("scene", File, Is("\"walker\""), "", "Scene of `run = \"compare\"`: a file beside this one, or the name of a shipped scene; its trial is that of the subject", "\"three_muscles\""),
    key("contact", Word(&["both", "with", "without"]), Optional("both where the scene has contact"), "", "Configurations of `run = \"compare\"`", "\"without\""),
    key("samples", Count(1, 100_000_000), Is("1"), "", "Samples of what varies; all subjects and settings have the same", "500"),
    key("sequence", Word(&["sobol", "random"]), Is("\"sobol\""), "", "Scrambled Sobol points, 65536 at most in 256 dimensions, or independent ones", "\"random\""),
    key("seed", Count(0, 4_294_967_295), Is("0"), "", "Another seed, other samples", "1"),
    key("indices", Flag, Is("false"), "", "Sobol indices of every `[[vary]]`: a sample is two sets of values, and one more for each of them that is exchanged", "true"),
    key("curves", Flag, Is("true"), "", "Runs of `optimize` keep their curves over time, for the bands of the page", "false"),
    key("fields", Flag, Is("false"), "", "Runs of `compare` keep their frames for ParaView", "true"),

    key("subject", Sections, Optional("the built-in walker; with a scene the trial of the scene"), "", "Who is computed", ""),
    key("subject.name", Text, Required, "", "Name in the table", "\"S01\""),
    key("subject.trial", File, Required, "", "Trial file beside this one, the name of a shipped trial, or walker", "\"S01.toml\""),

    key("setting", Sections, Optional("one, as in the files"), "", "Runs of every sample, told apart by keys", ""),
    key("setting.name", Text, Required, "", "Name in the table", "\"activation\""),
    key("setting.keys", Settings, Optional("as in the files"), "", "Keys `trial.…`, `scene.…` and `optimize.…` with their values", "{ \"optimize.cost\" = \"activation\" }"),

    key("vary", Sections, Optional("nothing varies"), "", "What differs from sample to sample", ""),
    key("vary.key", Text, Required, "", "`trial.KEY`, `scene.KEY`, `optimize.KEY`, `landmarks` or one of them (added, mm), `strengths` or one muscle line (factor)", "\"landmarks\""),
    key("vary.distribution", Word(&["normal", "lognormal", "uniform", "choice"]), Required, "", "How it is distributed", "\"normal\""),
    key("vary.mean", Number(f64::MIN, f64::MAX), Optional("of landmarks 0, of strengths 1"), "", "Mean of normal and lognormal", "1.0"),
    key("vary.sd", Number(f64::MIN_POSITIVE, f64::MAX), Optional("needed by normal and lognormal"), "", "Standard deviation", "0.2"),
    key("vary.low", Number(f64::MIN, f64::MAX), Optional("no least value"), "", "Least value; the distribution is cut off there", "0.5"),
    key("vary.high", Number(f64::MIN, f64::MAX), Optional("no greatest value"), "", "Greatest value", "1.5"),
    key("vary.values", Values, Optional("needed by choice"), "", "Values of a choice, all as likely", "[\"force\", \"activation\"]"),
];

/// What one run is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RunKind {
    /// The rigid leg alone.
    #[default]
    Optimize,
    /// A scene.
    Compare,
}

/// `contact`.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ContactChoice {
    Both,
    With,
    Without,
}

/// What the file holds.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StudyFile {
    #[serde(default)]
    pub run: RunKind,
    pub scene: Option<Spanned<PathBuf>>,
    pub contact: Option<Spanned<ContactChoice>>,
    pub samples: Option<Spanned<usize>>,
    #[serde(default)]
    pub sequence: Sequence,
    pub seed: Option<u32>,
    pub indices: Option<Spanned<bool>>,
    pub curves: Option<bool>,
    pub fields: Option<bool>,
    #[serde(default)]
    pub subject: Vec<SubjectEntry>,
    #[serde(default)]
    pub setting: Vec<SettingEntry>,
    #[serde(default)]
    pub vary: Vec<VaryEntry>,
}

/// `[[subject]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SubjectEntry {
    pub name: Spanned<String>,
    pub trial: Spanned<PathBuf>,
}

/// `[[setting]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SettingEntry {
    pub name: Spanned<String>,
    #[serde(default)]
    pub keys: BTreeMap<Spanned<String>, Spanned<Value>>,
}

/// `distribution`.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum DistributionName {
    Normal,
    Lognormal,
    Uniform,
    Choice,
}

/// `[[vary]]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VaryEntry {
    pub key: Spanned<String>,
    pub distribution: DistributionName,
    pub mean: Option<f64>,
    pub sd: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub values: Option<Vec<Value>>,
}

impl VaryEntry {
    /// How the values of `target` are distributed, or which key is unusable and why.
    pub fn distribution(
        &self,
        target: Option<&Target>,
    ) -> Result<Distribution, (&'static str, &'static str)> {
        let bounds = [self.low.unwrap_or(f64::NEG_INFINITY), self.high.unwrap_or(f64::INFINITY)];
        // This way round it refuses NaN, too.
        if !(bounds[0] < bounds[1]) {
            return Err(("low", "`low` must be less than `high`"));
        }
        let natural = match target {
            Some(Target::Landmark(..)) => Some(0.0),
            Some(Target::Strength(_)) => Some(1.0),
            _ => None,
        };
        let mean_and_sd = self.mean.or(natural).zip(self.sd).filter(|(m, s)| m.is_finite() && s.is_finite());
        let distribution = match (&self.distribution, mean_and_sd) {
            (DistributionName::Normal, Some((mean, sd))) => Distribution::Normal { mean, sd, bounds },
            (DistributionName::Lognormal, Some((mean, sd))) if mean > 0.0 => {
                Distribution::Lognormal { mean, sd, bounds }
            }
            (DistributionName::Lognormal, Some(_)) => {
                return Err(("mean", "a log-normal number has a positive mean"));
            }
            (DistributionName::Normal | DistributionName::Lognormal, None) => {
                return Err(("distribution", "give `mean` and `sd`"));
            }
            (DistributionName::Uniform, _) if bounds.iter().all(|b| b.is_finite()) => {
                Distribution::Uniform { bounds }
            }
            (DistributionName::Uniform, _) => return Err(("distribution", "give `low` and `high`")),
            (DistributionName::Choice, _) => match &self.values {
                Some(values) => Distribution::Choice { values: values.clone() },
                None => return Err(("distribution", "give `values`")),
            },
        };
        let is_strength = matches!(target, Some(Target::Strength(_)));
        let least = if is_strength { 0.0 } else { -f64::MAX };
        let is_low = |[low, _]: [f64; 2]| low.is_finite() && low < least;
        if matches!(target, Some(Target::Landmark(..) | Target::Strength(_)))
            && distribution.bounds().is_none_or(is_low)
        {
            return Err(("low", "numbers are wanted, of strengths none below 0"));
        }
        Ok(match distribution {
            // A muscle weaker than nothing is none: the tail is cut off.
            Distribution::Normal { mean, sd, bounds: [low, high] } if is_strength => {
                Distribution::Normal { mean, sd, bounds: [low.max(0.0), high] }
            }
            other => other,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_has_a_row_and_every_row_a_field() {
        assert_eq!(multibody::keys::differences::<StudyFile>(KEYS), Vec::<String>::new());
    }
}
