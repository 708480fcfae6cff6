//! The study file (TOML): which runs, of whom, with which settings, and what varies.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::error::{Mistakes, Place, nearest};
use multibody::keys::Kind::{Count, File, Flag, Number, Sections, Settings, Text, Values, Word};
use multibody::keys::Need::{Default as Is, Optional, Required};
use multibody::keys::{Key, Kind, examine, key, line_of};
use multibody::shipped;
use multibody::trial_file::{self, TrialFile};
use serde::Deserialize;
use sha2::{Digest, Sha256};
use toml::{Spanned, Value};

use super::vary::{Dimension, Distribution, SOBOL, Sequence, Target, number, targets};
use crate::changes::{OPTIONS, scene_with, set_option};
use crate::configuration::PerConfiguration;
use crate::fibres::cache::content_hash;
use crate::optimize::OptimizeOptions;
use crate::scene::{KEYS as SCENE_KEYS, Scene, TomlKind, wanted};

/// One row per key of a study; a test compares them with the struct.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("run", Word(&["optimize", "compare"]), Is("\"optimize\""), "", "What one run is: the rigid leg alone, or a scene with its deformable thigh", "\"compare\""),
    key("scene", File, Is("\"walker\""), "", "Scene of `run = \"compare\"`: a file beside this one, or the name of a shipped scene; its trial is that of the subject", "\"three_muscles\""),
    key("contact", Word(&["both", "with", "without"]), Optional("both where the scene has contact"), "", "Configurations of `run = \"compare\"`", "\"without\""),
    key("samples", Count(1, 100_000_000), Is("1"), "", "Samples of what varies; all subjects and settings have the same", "500"),
    key("sequence", Word(&["sobol", "random"]), Is("\"sobol\""), "", "Scrambled Sobol points, 65536 at most in 256 dimensions, or independent ones", "\"random\""),
    key("seed", Count(0, 4_294_967_295), Is("0"), "", "Another seed, other samples", "1"),
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

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ContactChoice {
    Both,
    With,
    Without,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyFile {
    #[serde(default)]
    run: RunKind,
    scene: Option<Spanned<PathBuf>>,
    contact: Option<Spanned<ContactChoice>>,
    samples: Option<Spanned<usize>>,
    #[serde(default)]
    sequence: Sequence,
    seed: Option<u32>,
    curves: Option<bool>,
    fields: Option<bool>,
    #[serde(default)]
    subject: Vec<SubjectEntry>,
    #[serde(default)]
    setting: Vec<SettingEntry>,
    #[serde(default)]
    vary: Vec<VaryEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SubjectEntry {
    name: Spanned<String>,
    trial: Spanned<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SettingEntry {
    name: Spanned<String>,
    #[serde(default)]
    keys: BTreeMap<Spanned<String>, Spanned<Value>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum DistributionName {
    Normal,
    Lognormal,
    Uniform,
    Choice,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VaryEntry {
    key: Spanned<String>,
    distribution: DistributionName,
    mean: Option<f64>,
    sd: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    values: Option<Vec<Value>>,
}

/// Who is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// Name in the table.
    pub name: String,
    /// Trial file; `None`: the built-in walker.
    pub trial: Option<PathBuf>,
}

/// Runs of every sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Name in the table.
    pub name: String,
    /// What is set.
    pub keys: Vec<(Target, Value)>,
}

/// A study with every value checked.
#[derive(Clone, Debug)]
pub struct Study {
    /// Short name: that of the file without ending.
    pub name: String,
    /// Text, as read.
    pub text: String,
    /// What one run is.
    pub kind: RunKind,
    /// Scene of its runs, where they have one.
    pub scene: Option<Scene>,
    /// Configurations of a scene.
    pub asked: PerConfiguration<bool>,
    /// Samples.
    pub samples: usize,
    /// How they fill the space.
    pub sequence: Sequence,
    /// Seed of the sequence.
    pub seed: u32,
    /// Whether curves over time are kept.
    pub curves: bool,
    /// Whether frames for ParaView are kept.
    pub fields: bool,
    /// Subjects.
    pub subjects: Vec<Subject>,
    /// Settings.
    pub settings: Vec<Setting>,
    /// What varies.
    pub dimensions: Vec<Dimension>,
    /// Folder of recordings and surfaces.
    pub data: Option<PathBuf>,
}

impl Study {
    /// Reads a study file. `data`: where else its files are.
    pub fn read(file: &Path, data: Option<&Path>) -> Result<Study, InputError> {
        let text = std::fs::read_to_string(file)
            .map_err(|source| InputError::Io { file: file.to_path_buf(), source })?;
        Study::parse(file, &text, data)
    }

    /// Reads the text of a study; every mistake is named, before anything runs.
    pub fn parse(file: &Path, text: &str, data: Option<&Path>) -> Result<Study, InputError> {
        wanted(TomlKind::Study, file, text)?;
        let mut wrong = Mistakes::default();
        let read = examine(file, text, KEYS, &mut wrong).and_then(|d| d.fill(file, text, &mut wrong));
        let made = read.and_then(|entry: StudyFile| Reader { file, text, data }.study(entry, &mut wrong));
        wrong.finish()?;
        made.ok_or_else(|| InputError::Malformed {
            file: file.to_path_buf(),
            at: Place::Whole,
            problem: "no study".into(),
            remedy: "see docs/keys.md".into(),
        })
    }

    /// Number of runs: subjects by settings by samples.
    pub fn n_runs(&self) -> usize {
        self.samples * self.subjects.len() * self.settings.len()
    }

    /// Hash of all that its runs depend on: the file, trials and recordings, scene, and the program itself. What cannot be read counts as absent.
    pub fn key(&self) -> String {
        let mut files: BTreeSet<PathBuf> = BTreeSet::new();
        for path in self.subjects.iter().filter_map(|s| s.trial.as_ref()) {
            files.insert(path.clone());
            let trial = TrialFile::read(path);
            files.extend(trial.and_then(|t| t.inputs(self.data.as_deref())).unwrap_or_default());
        }
        if let Some(surfaces) = self.scene.as_ref().and_then(|s| s.surfaces.as_ref()) {
            for folder in [surfaces.clone(), surfaces.join("..").join("bones")] {
                let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
                files.extend(entries.map(|e| e.path()));
            }
        }
        let mut hashes = String::new();
        for file in files {
            let bytes = match shipped::text(&file) {
                Some(text) => Some(text.as_bytes().to_vec()),
                None => std::fs::read(&file).ok(),
            };
            hashes += &bytes.map_or("absent".into(), |bytes| format!("{:x?}", Sha256::digest(bytes)));
        }
        let scene = self.scene.as_ref().map_or("", |s| &s.text);
        content_hash(&fem::mesh::Mesh::default(), &format!("{}{scene}{hashes}", self.text))
    }
}

/// The text that errors point into.
struct Reader<'a> {
    file: &'a Path,
    text: &'a str,
    data: Option<&'a Path>,
}

impl Reader<'_> {
    fn bad(&self, byte: usize, key: &str, value: impl ToString, remedy: impl ToString) -> InputError {
        InputError::BadValue {
            file: self.file.to_path_buf(),
            line: line_of(self.text, byte),
            key: key.into(),
            value: value.to_string(),
            remedy: remedy.to_string(),
        }
    }

    fn study(&self, entry: StudyFile, wrong: &mut Mistakes) -> Option<Study> {
        let scene = match entry.run {
            RunKind::Compare => Some(self.scene(entry.scene.as_ref(), wrong)),
            RunKind::Optimize => {
                if let Some(scene) = &entry.scene {
                    let remedy = "runs of `optimize` have no scene; give run = \"compare\"";
                    wrong.note(self.bad(scene.span().start, "scene", "given", remedy));
                }
                None
            }
        };
        let subjects = self.subjects(&entry.subject, scene.as_ref().and_then(|s| s.as_ref()), wrong);
        let mut dimensions = Vec::new();
        let muscles = muscle_lines();
        for vary in &entry.vary {
            dimensions.extend(self.vary(vary, &muscles, wrong));
        }
        let mut seen = BTreeSet::new();
        for dimension in &dimensions {
            let column = dimension.target.column();
            if !seen.insert(column.clone()) {
                wrong.note(self.bad(0, "vary", format!("`{column}` twice"), "let every key vary once"));
            }
        }
        if let Some(samples) = &entry.samples {
            let [most, most_dimensions] = SOBOL;
            let sobol = entry.sequence == Sequence::Sobol;
            if sobol && (*samples.get_ref() > most || dimensions.len() > most_dimensions) {
                let value = format!("{} in {} dimensions", samples.get_ref(), dimensions.len());
                let remedy = format!(
                    "the Sobol sequence has {most} samples in {most_dimensions} dimensions; give sequence = \"random\""
                );
                wrong.note(self.bad(samples.span().start, "samples", value, remedy));
            }
        }
        let settings = self.settings(&entry.setting, wrong);
        for vary in entry.vary.iter().filter(|v| v.key.get_ref().starts_with("scene.")) {
            self.of_a_scene(entry.run, vary.key.get_ref(), vary.key.span().start, wrong);
        }
        for (key, _) in entry.setting.iter().flat_map(|s| &s.keys) {
            self.of_a_scene(entry.run, key.get_ref(), key.span().start, wrong);
        }
        let scene = scene.map_or(Some(None), |scene| scene.map(Some))?;
        let has_contact = scene.as_ref().is_some_and(|s| s.contact.is_some());
        let asked = match entry.contact.as_ref().map(|c| *c.get_ref()) {
            None => PerConfiguration { without: true, with: has_contact },
            Some(ContactChoice::Both) => PerConfiguration { without: true, with: true },
            Some(ContactChoice::With) => PerConfiguration { without: false, with: true },
            Some(ContactChoice::Without) => PerConfiguration { without: true, with: false },
        };
        if let Some(contact) =
            entry.contact.as_ref().filter(|_| scene.is_some() && asked.with && !has_contact)
        {
            let remedy = "the scene has no contact; leave this key away";
            wrong.note(self.bad(contact.span().start, "contact", "asked for", remedy));
        }
        let study = Study {
            name: self.file.file_stem().map_or("study".into(), |s| s.to_string_lossy().into_owned()),
            text: self.text.to_string(),
            kind: entry.run,
            scene,
            asked,
            samples: entry.samples.as_ref().map_or(1, |s| *s.get_ref()),
            sequence: entry.sequence,
            seed: entry.seed.unwrap_or(0),
            curves: entry.curves.unwrap_or(true),
            fields: entry.fields.unwrap_or(false),
            subjects: subjects?,
            settings,
            dimensions,
            data: self.data.map(Path::to_path_buf),
        };
        self.check_values(&study, &entry, wrong);
        Some(study)
    }

    fn of_a_scene(&self, kind: RunKind, key: &str, byte: usize, wrong: &mut Mistakes) {
        if kind == RunKind::Optimize && key.starts_with("scene.") {
            let remedy = "runs of `optimize` have no scene; give run = \"compare\"";
            wrong.note(self.bad(byte, "key", format!("`{key}`"), remedy));
        }
    }

    fn scene(&self, given: Option<&Spanned<PathBuf>>, wrong: &mut Mistakes) -> Option<Scene> {
        let name = given.map_or(PathBuf::from("walker"), |s| s.get_ref().clone());
        let beside = self.file.with_file_name(&name);
        let file = if beside.is_file() { beside } else { name };
        let scene = Scene::read(&file, self.data).and_then(|s| scene_with(&s, &BTreeMap::new(), self.data));
        match (scene, given) {
            (Err(InputError::Io { file, .. }), Some(given)) => {
                let value = format!("`{}`", file.display());
                wrong.note(self.bad(given.span().start, "scene", value, "no such file beside the study"));
                None
            }
            (scene, _) => wrong.keep(scene),
        }
    }

    fn subjects(
        &self,
        given: &[SubjectEntry],
        scene: Option<&Scene>,
        wrong: &mut Mistakes,
    ) -> Option<Vec<Subject>> {
        if given.is_empty() {
            let trial = scene.and_then(|s| s.trial.clone());
            let stem = trial.as_ref().and_then(|t| t.file_stem()).map(|s| s.to_string_lossy().into_owned());
            return Some(vec![Subject { name: stem.unwrap_or("walker".into()), trial }]);
        }
        let mut names = BTreeSet::new();
        let mut subjects = Vec::new();
        for entry in given {
            let name = entry.name.get_ref();
            if !names.insert(name) {
                let remedy = "every subject has a name of its own";
                wrong.note(self.bad(entry.name.span().start, "name", format!("`{name}` again"), remedy));
            }
            let path = entry.trial.get_ref();
            let trial =
                if path == Path::new("walker") { Some(None) } else { self.trial(&entry.trial, wrong) };
            subjects.push(trial.map(|trial| Subject { name: name.clone(), trial }));
        }
        subjects.into_iter().collect()
    }

    /// A trial file that can be read; its recordings are looked for by the runs.
    fn trial(&self, given: &Spanned<PathBuf>, wrong: &mut Mistakes) -> Option<Option<PathBuf>> {
        let beside = self.file.with_file_name(given.get_ref());
        let found = match beside.is_file() {
            true => Ok(std::path::absolute(&beside).unwrap_or(beside)),
            false => shipped::find(given.get_ref(), shipped::Kind::Trial),
        };
        let value = format!("`{}`", given.get_ref().display());
        match found {
            Ok(path) if shipped::is_shipped(&path) || path.is_file() => {
                wrong.keep(TrialFile::read(&path)).map(|_| Some(path))
            }
            found => {
                let remedy = match found {
                    Err(InputError::Malformed { remedy, .. }) => remedy,
                    _ => "no such file beside the study".into(),
                };
                wrong.note(self.bad(given.span().start, "trial", value, remedy));
                None
            }
        }
    }

    fn settings(&self, given: &[SettingEntry], wrong: &mut Mistakes) -> Vec<Setting> {
        if given.is_empty() {
            return vec![Setting { name: "base".into(), keys: Vec::new() }];
        }
        let mut names = BTreeSet::new();
        let mut settings = Vec::new();
        for entry in given {
            let name = entry.name.get_ref();
            if !names.insert(name) {
                let remedy = "every setting has a name of its own";
                wrong.note(self.bad(entry.name.span().start, "name", format!("`{name}` again"), remedy));
            }
            let mut keys = Vec::new();
            for (key, value) in &entry.keys {
                match known_key(key.get_ref()) {
                    Ok(target) => keys.push((target, value.get_ref().clone())),
                    Err(remedy) => {
                        let value = format!("`{}`", key.get_ref());
                        wrong.note(self.bad(key.span().start, "keys", value, remedy));
                    }
                }
            }
            settings.push(Setting { name: name.clone(), keys });
        }
        settings
    }

    fn vary(&self, entry: &VaryEntry, muscles: &[String], wrong: &mut Mistakes) -> Vec<Dimension> {
        let (byte, key) = (entry.key.span().start, entry.key.get_ref());
        let targets = targets(key, muscles).unwrap_or_else(|remedy| {
            wrong.note(self.bad(byte, "key", format!("`{key}`"), remedy));
            Vec::new()
        });
        let natural = match targets.first() {
            Some(Target::Landmark(..)) => Some(0.0),
            Some(Target::Strength(_)) => Some(1.0),
            _ => None,
        };
        let bounds = [entry.low.unwrap_or(f64::NEG_INFINITY), entry.high.unwrap_or(f64::INFINITY)];
        let mut need = |what: &str, why: String| wrong.note(self.bad(byte, what, "unusable", why));
        if bounds[0] >= bounds[1] || entry.low.is_some_and(f64::is_nan) || entry.high.is_some_and(f64::is_nan)
        {
            need("low", format!("of `{key}`: `low` must be less than `high`"));
            return Vec::new();
        }
        let mean_and_sd =
            entry.mean.or(natural).zip(entry.sd).filter(|(m, s)| m.is_finite() && s.is_finite());
        let distribution = match (&entry.distribution, mean_and_sd) {
            (DistributionName::Normal, Some((mean, sd))) => Distribution::Normal { mean, sd, bounds },
            (DistributionName::Lognormal, Some((mean, sd))) if mean > 0.0 => {
                Distribution::Lognormal { mean, sd, bounds }
            }
            (DistributionName::Lognormal, Some(_)) => {
                need("mean", format!("of `{key}`: a log-normal number has a positive mean"));
                return Vec::new();
            }
            (DistributionName::Normal | DistributionName::Lognormal, None) => {
                need("distribution", format!("of `{key}`: give `mean` and `sd`"));
                return Vec::new();
            }
            (DistributionName::Uniform, _) if bounds.iter().all(|b| b.is_finite()) => {
                Distribution::Uniform { bounds }
            }
            (DistributionName::Uniform, _) => {
                need("distribution", format!("of `{key}`: give `low` and `high`"));
                return Vec::new();
            }
            (DistributionName::Choice, _) => match &entry.values {
                Some(values) => Distribution::Choice { values: values.clone() },
                None => {
                    need("distribution", format!("of `{key}`: give `values`"));
                    return Vec::new();
                }
            },
        };
        let is_group = matches!(targets.first(), Some(Target::Landmark(..) | Target::Strength(_)));
        let least = if matches!(targets.first(), Some(Target::Strength(_))) { 0.0 } else { -f64::MAX };
        if is_group && distribution.bounds().is_none_or(|[low, _]| low.is_finite() && low < least) {
            need("low", format!("of `{key}`: numbers are wanted, of strengths none below 0"));
            return Vec::new();
        }
        let distribution = match (targets.first(), distribution) {
            // A muscle weaker than nothing is none: the tail is cut off.
            (Some(Target::Strength(_)), Distribution::Normal { mean, sd, bounds: [low, high] }) => {
                Distribution::Normal { mean, sd, bounds: [low.max(0.0), high] }
            }
            (_, other) => other,
        };
        targets.into_iter().map(|target| Dimension { target, distribution: distribution.clone() }).collect()
    }

    /// Values of all settings, and the middle and the bounds of what varies, each by itself on the first subject: what no run could take is named now.
    fn check_values(&self, study: &Study, entry: &StudyFile, wrong: &mut Mistakes) {
        let places = study.settings.iter().zip(&entry.setting);
        for (setting, given) in places {
            for (target, value) in &setting.keys {
                if let Err(remedy) = study.takes(target, value) {
                    let byte = given.name.span().start;
                    wrong.note(self.bad(byte, &target.column(), value, remedy));
                }
            }
        }
        for dimension in &study.dimensions {
            let mut tried = vec![dimension.distribution.value(0.5)];
            match &dimension.distribution {
                Distribution::Choice { values } => tried.clone_from(values),
                other => {
                    let bounds = other.bounds().into_iter().flatten();
                    tried.extend(bounds.filter(|b| b.is_finite()).map(Value::from));
                }
            }
            for value in tried {
                if let Err(remedy) = study.takes(&dimension.target, &value) {
                    let named = |v: &&VaryEntry| *v.key.get_ref() == dimension.target.column();
                    let byte = entry.vary.iter().find(named).map_or(0, |v| v.key.span().start);
                    wrong.note(self.bad(byte, &dimension.target.column(), value, remedy));
                    break;
                }
            }
        }
    }
}

impl Study {
    /// Whether a target takes a value, by itself.
    fn takes(&self, target: &Target, value: &Value) -> Result<(), String> {
        match target {
            Target::Trial(key) => {
                for subject in &self.subjects {
                    let Some(trial) = &subject.trial else {
                        return Err("the built-in walker has no trial file; name one as the subject".into());
                    };
                    let changes = crate::changes::Changes {
                        trial: BTreeMap::from([(key.clone(), value.clone())]),
                        ..Default::default()
                    };
                    let text = match shipped::text(trial) {
                        Some(text) => text.to_string(),
                        None => std::fs::read_to_string(trial).map_err(|e| e.to_string())?,
                    };
                    let changed = changes.trial_text(&text).map_err(|e| e.to_string())?;
                    TrialFile::parse(trial, changed.as_bytes()).map_err(|e| said(&e))?;
                }
                Ok(())
            }
            Target::Scene(key) => {
                let Some(scene) = &self.scene else { return Ok(()) };
                let keys = BTreeMap::from([(key.clone(), value.clone())]);
                scene_with(scene, &keys, self.data.as_deref()).map(|_| ()).map_err(|e| said(&e))
            }
            Target::Option(key) => set_option(&mut OptimizeOptions::default(), key, value),
            Target::Landmark(..) | Target::Strength(_) => {
                number(value).map(|_| ()).ok_or("give numbers".into())
            }
        }
    }
}

/// What an error of a scene or trial says, without the place in a text that nobody wrote.
pub(super) fn said(error: &InputError) -> String {
    match error {
        InputError::BadValue { remedy, .. } | InputError::Malformed { remedy, .. } => remedy.clone(),
        InputError::Several(all) => all.iter().map(said).collect::<Vec<_>>().join("; "),
        other => other.to_string(),
    }
}

/// Names of the muscle lines, in the order of the model.
pub fn muscle_lines() -> Vec<String> {
    let mut table = csv::Reader::from_reader(include_str!("../../../gait-data/muscles.csv").as_bytes());
    let column = table.headers().ok().and_then(|names| names.iter().position(|n| n == "name"));
    let column = column.expect("built-in table");
    table.records().map(|row| row.expect("built-in table")[column].to_string()).collect()
}

/// Kinds of keys that a run can take a value of.
fn settable(keys: &'static [Key]) -> impl Iterator<Item = &'static Key> {
    let in_list = |k: &Key| {
        keys.iter().any(|s| matches!(s.kind, Kind::Sections) && k.path.starts_with(&format!("{}.", s.path)))
    };
    keys.iter().filter(move |k| !k.is_section() && !in_list(k))
}

/// What a key means; an error names what may be meant.
pub(super) fn known_key(key: &str) -> Result<Target, String> {
    /// Begin of a key, what may follow it, and what it sets.
    type Space = (&'static str, &'static [Key], fn(String) -> Target);
    let spaces: [Space; 3] = [
        ("trial", trial_file::KEYS, Target::Trial),
        ("scene", SCENE_KEYS, Target::Scene),
        ("optimize", OPTIONS, Target::Option),
    ];
    let all = || {
        spaces.iter().flat_map(|(space, keys, _)| settable(keys).map(move |k| format!("{space}.{}", k.path)))
    };
    for (space, keys, target) in spaces {
        let Some(path) = key.strip_prefix(space).and_then(|rest| rest.strip_prefix('.')) else { continue };
        if settable(keys).any(|k| k.path == path) || (space == "scene" && is_in_named_element(path)) {
            return Ok(target(path.to_string()));
        }
    }
    let groups = ["landmarks", "strengths"].map(String::from);
    let candidates: Vec<String> = all().chain(groups).collect();
    let ends_alike = || candidates.iter().find(|c| c.rsplit('.').next() == key.rsplit('.').next()).cloned();
    let meant = nearest(key, candidates.iter().map(String::as_str)).or_else(ends_alike);
    let meant = meant.map_or(String::new(), |m| format!("did you mean `{m}`? "));
    let space = key.split('.').next().unwrap_or("");
    let known: Vec<String> = all().filter(|c| c.split('.').next() == Some(space)).collect();
    Err(match known.is_empty() {
        true => format!("{meant}keys begin with trial, scene or optimize, or are landmarks or strengths"),
        false => format!("{meant}known are {}", known.join(", ")),
    })
}

/// Whether a key of the scene is one of a named element of a list: `step.heel_strike.knee_flexion_deg`.
fn is_in_named_element(path: &str) -> bool {
    ["step", "materials.muscle"].iter().any(|list| {
        let rest = path.strip_prefix(list).and_then(|rest| rest.strip_prefix('.'));
        let key = rest.and_then(|rest| rest.split_once('.')).map(|(_, key)| format!("{list}.{key}"));
        key.is_some_and(|key| !key.ends_with(".name") && SCENE_KEYS.iter().any(|k| k.path == key))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_has_a_row_and_every_row_a_field() {
        assert_eq!(multibody::keys::differences::<StudyFile>(KEYS), Vec::<String>::new());
    }

    const TEXT: &str = "samples = 8\n\n[[setting]]\nname = \"force\"\n\n[[setting]]\nname = \"activation\"\nkeys = { \"optimize.cost\" = \"activation\" }\n\n[[vary]]\nkey = \"landmarks\"\ndistribution = \"normal\"\nsd = 5.0\n\n[[vary]]\nkey = \"strengths\"\ndistribution = \"normal\"\nsd = 0.2\n";

    fn parse(text: &str) -> Result<Study, InputError> {
        Study::parse(Path::new("my.toml"), text, None)
    }

    #[test]
    fn groups_are_a_dimension_per_coordinate_and_muscle() {
        let study = parse(TEXT).unwrap();
        assert_eq!((study.n_runs(), study.dimensions.len()), (16, 36 + 43));
        assert_eq!(study.dimensions[0].target.column(), "landmarks.right_asis.x_mm");
        assert_eq!(study.subjects, [Subject { name: "walker".into(), trial: None }]);
        assert_eq!(study.key(), parse(TEXT).unwrap().key());
        assert_ne!(study.key(), parse(&TEXT.replace("5.0", "6.0")).unwrap().key());
    }

    #[test]
    fn all_mistakes_are_named_with_line_and_nearest_name() {
        let text = TEXT
            .replace("optimize.cost", "optimize.costs")
            .replace("\"landmarks\"", "\"landmark\"")
            .replace("sd = 0.2", "mean = 1.0")
            + "\n[[vary]]\nkey = \"scene.resolution\"\ndistribution = \"uniform\"\nlow = 3.0\nhigh = 2.0\n";
        let InputError::Several(all) = parse(&text).unwrap_err() else { panic!("several are wrong") };
        let all: Vec<String> = all.iter().map(InputError::to_string).collect();
        for words in [
            ["line 8", "optimize.costs", "did you mean `optimize.cost`"],
            ["line 11", "`landmark`", "did you mean `landmarks`"],
            ["line 16", "`strengths`", "give `mean` and `sd`"],
            ["line 21", "`scene.resolution`", "did you mean `scene.resolution_mm`"],
        ] {
            assert!(all.iter().any(|said| words.iter().all(|w| said.contains(w))), "{words:?} in {all:#?}");
        }
    }

    #[test]
    fn values_that_no_run_could_take_are_refused_before_anything_runs() {
        let scene = "run = \"compare\"\nscene = \"three_muscles\"\n\n[[vary]]\nkey = \"scene.resolution_mm\"\ndistribution = \"uniform\"\nlow = 1.0\nhigh = 12.0\n";
        let said = parse(scene).unwrap_err().to_string();
        assert!(said.contains("3 to 20 mm") && said.contains("line 5"), "{said}");
        let said = parse(&TEXT.replace("\"activation\" }", "\"activations\" }")).unwrap_err().to_string();
        assert!(said.contains("\"force\" or \"activation\""), "{said}");
        let said = parse(
            "samples = 3\n\n[[vary]]\nkey = \"trial.filter.motion_hz\"\ndistribution = \"uniform\"\nlow = 4\nhigh = 6\n",
        );
        assert!(said.unwrap_err().to_string().contains("no trial file"));
        let many = parse(&TEXT.replace("samples = 8", "samples = 70000")).unwrap_err().to_string();
        assert!(many.contains("sequence = \"random\""), "{many}");
    }
}
