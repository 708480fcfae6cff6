//! The study file (TOML): which runs, of whom, with which settings, and what varies.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::error::{Mistakes, Place};
use multibody::keys::examine;
use multibody::shipped;
use multibody::trial_file::TrialFile;
use toml::{Spanned, Value};

use super::admissible::Base;
use super::indices::LEAST;
use super::keys::{ContactChoice, KEYS, RunKind, SettingEntry, StudyFile, SubjectEntry, VaryEntry};
use super::names::{known_key, muscle_lines, targets};
use super::vary::{Dimension, Distribution, SOBOL, Sequence, Target};
use crate::changes::scene_with;
use crate::configuration::PerConfiguration;
use crate::fibres::cache::{program_hash, text_hash};
use crate::scene::{Scene, TomlKind, wanted};
use crate::source::Source;

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
    /// Keys of what varies together, as written: [`Dimension::group`] is a place here.
    pub groups: Vec<String>,
    /// Whether the Sobol indices of the groups are asked for.
    pub indices: bool,
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
        let made = read.and_then(|entry: StudyFile| {
            Reader { source: Source { file, text }, data }.study(entry, &mut wrong)
        });
        wrong.finish()?;
        made.ok_or_else(|| InputError::Malformed {
            file: file.to_path_buf(),
            at: Place::Whole,
            problem: "no study".into(),
            remedy: "see docs/keys.md".into(),
        })
    }

    /// Number of runs: subjects by settings by samples, of which each has so many [sets](super::run::Set) of values.
    pub fn n_runs(&self) -> usize {
        self.samples * self.n_sets() * self.subjects.len() * self.settings.len()
    }

    /// Sets of values of a sample.
    pub fn n_sets(&self) -> usize {
        if self.indices { 2 + self.groups.len() } else { 1 }
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
            hashes += &bytes.map_or("absent".into(), text_hash);
        }
        let scene = self.scene.as_ref().map_or("", |s| &s.text);
        program_hash(&format!("{}{scene}{hashes}", self.text))
    }
}

/// What is read, and where recordings and surfaces are looked for.
struct Reader<'a> {
    source: Source<'a>,
    data: Option<&'a Path>,
}

impl Reader<'_> {
    fn study(&self, entry: StudyFile, wrong: &mut Mistakes) -> Option<Study> {
        let scene = match entry.run {
            RunKind::Compare => Some(self.scene(entry.scene.as_ref(), wrong)),
            RunKind::Optimize => {
                if let Some(scene) = &entry.scene {
                    let remedy = "runs of `optimize` have no scene; give run = \"compare\"";
                    wrong.note(self.source.bad_at(scene.span().start, "scene", "given", remedy));
                }
                None
            }
        };
        let subjects = self.subjects(&entry.subject, scene.as_ref().and_then(|s| s.as_ref()), wrong);
        let mut dimensions = Vec::new();
        let muscles = muscle_lines();
        for (group, vary) in entry.vary.iter().enumerate() {
            dimensions.extend(self.vary(vary, group, &muscles, wrong));
        }
        let mut seen = BTreeSet::new();
        for dimension in &dimensions {
            let column = dimension.target.column();
            if !seen.insert(column.clone()) {
                wrong.note(self.source.bad_at(
                    0,
                    "vary",
                    format!("`{column}` twice"),
                    "let every key vary once",
                ));
            }
        }
        let indices = entry.indices.as_ref().is_some_and(|i| *i.get_ref());
        if let Some(asked) = entry.indices.as_ref().filter(|i| *i.get_ref() && entry.vary.is_empty()) {
            let remedy = "nothing varies; give [[vary]], or leave this key away";
            wrong.note(self.source.bad_at(asked.span().start, "indices", true, remedy));
        }
        let n_samples = entry.samples.as_ref().map_or(1, |s| *s.get_ref());
        let byte = entry.samples.as_ref().map_or(0, |s| s.span().start);
        // A sample of indices has two points side by side.
        let n_dimensions = dimensions.len() * if indices { 2 } else { 1 };
        let [most, most_dimensions] = SOBOL;
        if entry.sequence == Sequence::Sobol && (n_samples > most || n_dimensions > most_dimensions) {
            let value = format!("{n_samples} in {n_dimensions} dimensions");
            let remedy = format!(
                "the Sobol sequence has {most} samples in {most_dimensions} dimensions; give sequence = \"random\""
            );
            wrong.note(self.source.bad_at(byte, "samples", value, remedy));
        }
        if indices && n_samples < LEAST {
            let remedy = format!("indices and how sure they are need {LEAST} samples at least");
            wrong.note(self.source.bad_at(byte, "samples", n_samples, remedy));
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
            wrong.note(self.source.bad_at(contact.span().start, "contact", "asked for", remedy));
        }
        let study = Study {
            name: self.source.file.file_stem().map_or("study".into(), |s| s.to_string_lossy().into_owned()),
            text: self.source.text.to_string(),
            kind: entry.run,
            scene,
            asked,
            samples: n_samples,
            sequence: entry.sequence,
            seed: entry.seed.unwrap_or(0),
            curves: entry.curves.unwrap_or(true),
            fields: entry.fields.unwrap_or(false),
            subjects: subjects?,
            settings,
            dimensions,
            groups: entry.vary.iter().map(|v| v.key.get_ref().clone()).collect(),
            indices,
            data: self.data.map(Path::to_path_buf),
        };
        self.check_values(&study, &entry, wrong);
        Some(study)
    }

    fn of_a_scene(&self, kind: RunKind, key: &str, byte: usize, wrong: &mut Mistakes) {
        if kind == RunKind::Optimize && key.starts_with("scene.") {
            let remedy = "runs of `optimize` have no scene; give run = \"compare\"";
            wrong.note(self.source.bad_at(byte, "key", format!("`{key}`"), remedy));
        }
    }

    fn scene(&self, given: Option<&Spanned<PathBuf>>, wrong: &mut Mistakes) -> Option<Scene> {
        let name = given.map_or(PathBuf::from("walker"), |s| s.get_ref().clone());
        let beside = self.source.file.with_file_name(&name);
        let file = if beside.is_file() { beside } else { name };
        let scene = Scene::read(&file, self.data).and_then(|s| scene_with(&s, &BTreeMap::new(), self.data));
        match (scene, given) {
            (Err(InputError::Io { file, .. }), Some(given)) => {
                let value = format!("`{}`", file.display());
                wrong.note(self.source.bad_at(
                    given.span().start,
                    "scene",
                    value,
                    "no such file beside the study",
                ));
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
                wrong.note(self.source.bad_at(
                    entry.name.span().start,
                    "name",
                    format!("`{name}` again"),
                    remedy,
                ));
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
        let beside = self.source.file.with_file_name(given.get_ref());
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
                wrong.note(self.source.bad_at(given.span().start, "trial", value, remedy));
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
                wrong.note(self.source.bad_at(
                    entry.name.span().start,
                    "name",
                    format!("`{name}` again"),
                    remedy,
                ));
            }
            let mut keys = Vec::new();
            for (key, value) in &entry.keys {
                match known_key(key.get_ref()) {
                    Ok(target) => keys.push((target, value.get_ref().clone())),
                    Err(remedy) => {
                        let value = format!("`{}`", key.get_ref());
                        wrong.note(self.source.bad_at(key.span().start, "keys", value, remedy));
                    }
                }
            }
            settings.push(Setting { name: name.clone(), keys });
        }
        settings
    }

    fn vary(
        &self,
        entry: &VaryEntry,
        group: usize,
        muscles: &[String],
        wrong: &mut Mistakes,
    ) -> Vec<Dimension> {
        let (byte, key) = (entry.key.span().start, entry.key.get_ref());
        let targets = targets(key, muscles).unwrap_or_else(|remedy| {
            wrong.note(self.source.bad_at(byte, "key", format!("`{key}`"), remedy));
            Vec::new()
        });
        match entry.distribution(targets.first()) {
            Ok(distribution) => {
                let dimension = |target| Dimension { target, distribution: distribution.clone(), group };
                targets.into_iter().map(dimension).collect()
            }
            Err((what, why)) => {
                wrong.note(self.source.bad_at(byte, what, "unusable", format!("of `{key}`: {why}")));
                Vec::new()
            }
        }
    }

    /// Values of all settings, and the middle and the bounds of what varies, each by itself on the first subject: what no run could take is named now.
    fn check_values(&self, study: &Study, entry: &StudyFile, wrong: &mut Mistakes) {
        let base = Base {
            trials: study.subjects.iter().map(|s| s.trial.as_ref()).collect(),
            scene: study.scene.as_ref(),
            data: study.data.as_deref(),
        };
        let places = study.settings.iter().zip(&entry.setting);
        for (setting, given) in places {
            for (target, value) in &setting.keys {
                if let Err(remedy) = base.takes(target, value) {
                    let byte = given.name.span().start;
                    wrong.note(self.source.bad_at(byte, &target.column(), value, remedy));
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
                if let Err(remedy) = base.takes(&dimension.target, &value) {
                    let named = |v: &&VaryEntry| *v.key.get_ref() == dimension.target.column();
                    let byte = entry.vary.iter().find(named).map_or(0, |v| v.key.span().start);
                    wrong.note(self.source.bad_at(byte, &dimension.target.column(), value, remedy));
                    break;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert!(said.contains("2.5 to 20 mm") && said.contains("line 5"), "{said}");
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
