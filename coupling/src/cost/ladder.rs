//! Ladders (TOML): a scene, and axes along each of which one of its keys goes from coarse to fine.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::error::{Mistakes, Place, hint, nearest};
use multibody::keys::Kind::{File, Sections, Settings, Text, Values, Word};
use multibody::keys::Need::{Default, Optional, Required};
use multibody::keys::{Key, examine, key};
use multibody::shipped::{self, Kind};
use serde::Deserialize;
use toml::{Spanned, Table, Value};

use crate::configuration::Configuration;
use crate::scene::{KEYS as SCENE_KEYS, Scene, TomlKind, wanted};
use crate::source::Source;

/// One row per key of a ladder; a test compares them with the struct.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("scene", File, Default("\"walker\""), "", "Scene whose settings are the base: a file beside this one, or the name of a shipped scene", "\"DM_og3\""),
    key("axis", Sections, Required, "", "One key of the scene goes from coarse to fine, everything else stays as in the base", ""),
    key("axis.name", Text, Required, "", "Short name, which begins the names of its rungs", "\"mesh\""),
    key("axis.key", Text, Required, "", "Key of the scene, sections with dots", "\"resolution_mm\""),
    key("axis.values", Values, Required, "", "Its values, from coarse to fine; the last one is what the others are measured against", "[20.0, 12.0, 9.0, 6.0]"),
    key("axis.error", Word(&["discretisation", "regularisation", "tolerance", "path", "modelling"]), Required, "", "Which error shrinks along it", "\"discretisation\""),
    key("axis.with", Settings, Optional("the base"), "", "Keys of the scene that differ from the base all along the axis", "{ \"effects.contact\" = \"none\" }"),
];

/// Which error shrinks along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Owner {
    /// Elements are too large.
    Discretisation,
    /// Contact begins at a distance.
    Regularisation,
    /// The solver ends too early.
    Tolerance,
    /// There are several equilibria, and the way decides.
    Path,
    /// An effect is left out.
    Modelling,
}

impl Owner {
    /// Whether it is an error of computing the scene, not of what is in it, nor of where its way leads.
    pub fn is_numerical(self) -> bool {
        !matches!(self, Owner::Modelling | Owner::Path)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LadderFile {
    scene: Option<Spanned<PathBuf>>,
    axis: Vec<AxisEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisEntry {
    name: Spanned<String>,
    key: Spanned<String>,
    values: Vec<Spanned<Value>>,
    error: Owner,
    #[serde(default)]
    with: BTreeMap<Spanned<String>, Spanned<Value>>,
}

/// A ladder with every value checked.
#[derive(Clone, Debug)]
pub struct Ladder {
    /// Short name: that of the file without ending, or of the scene that was put in the place of its own.
    pub name: String,
    /// Text, as read.
    pub text: String,
    /// Name of the scene of the base.
    pub scene: String,
    /// The base, first, and what differs from it; no two are the same.
    pub rungs: Vec<Rung>,
    /// Axes.
    pub axes: Vec<Axis>,
}

/// A scene of the ladder.
#[derive(Clone, Debug)]
pub struct Rung {
    /// `base`, or axis and value.
    pub name: String,
    /// Keys that differ from the base, dotted.
    pub differs: BTreeMap<String, Value>,
    /// The scene.
    pub scene: Scene,
}

/// Rungs from coarse to fine.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Name.
    pub name: String,
    /// Key of the scene.
    pub key: String,
    /// Which error shrinks along it.
    pub owner: Owner,
    /// Places in [`Ladder::rungs`].
    pub rungs: Vec<usize>,
    /// What differs from the base all along it: an axis of another model, where this is not empty.
    pub with: BTreeMap<String, Value>,
}

impl Axis {
    /// Whether element sizes change along it.
    pub fn is_mesh(&self) -> bool {
        self.key == "resolution_mm"
    }

    /// Its last rung.
    pub fn finest(&self) -> usize {
        *self.rungs.last().expect("two at least")
    }
}

/// Name of the rung that everything but the axis is taken from.
pub const BASE: &str = "base";

impl Ladder {
    /// Reads a ladder, or the shipped one by its name. `scene`: in place of its own; `data`: where else its files are.
    pub fn read(given: &Path, scene: Option<&Path>, data: Option<&Path>) -> Result<Ladder, InputError> {
        let file = shipped::find(given, Kind::Ladder)?;
        let text = match shipped::text(&file) {
            Some(text) => text.to_string(),
            None => std::fs::read_to_string(&file)
                .map_err(|source| InputError::Io { file: file.clone(), source })?,
        };
        Ladder::parse(&file, &text, scene, data)
    }

    /// Reads the text of a ladder; every mistake is named.
    pub fn parse(
        file: &Path,
        text: &str,
        scene: Option<&Path>,
        data: Option<&Path>,
    ) -> Result<Ladder, InputError> {
        wanted(TomlKind::Ladder, file, text)?;
        let mut wrong = Mistakes::default();
        let read = examine(file, text, KEYS, &mut wrong).and_then(|d| d.fill(file, text, &mut wrong));
        let made = read.and_then(|entry: LadderFile| {
            Reader { source: Source { file, text }, data }.ladder(&entry, scene, &mut wrong)
        });
        wrong.finish()?;
        made.ok_or_else(|| InputError::Malformed {
            file: file.to_path_buf(),
            at: Place::Whole,
            problem: "no ladder".into(),
            remedy: "see docs/keys.md".into(),
        })
    }

    /// The rung of this name.
    pub fn rung(&self, name: &str) -> Option<&Rung> {
        self.rungs.iter().find(|rung| rung.name == name)
    }

    /// The first axis along which elements become smaller and nothing else differs from the base.
    pub fn mesh_axis(&self) -> Option<&Axis> {
        self.axes.iter().find(|axis| axis.with.is_empty() && axis.is_mesh())
    }

    /// Keys of the finest setting: the last value of every axis of the base that says how exactly the scene is computed.
    pub fn finest(&self) -> BTreeMap<String, Value> {
        let exact = self.axes.iter().filter(|axis| axis.with.is_empty() && axis.owner.is_numerical());
        exact.flat_map(|axis| self.rungs[axis.finest()].differs.clone()).collect()
    }

    /// Leaves out the other axes, and rungs that are on none that is left.
    pub fn keep_axes(&mut self, keep: impl Fn(&Axis) -> bool) {
        self.axes.retain(keep);
        let on: BTreeSet<usize> =
            self.axes.iter().flat_map(|axis| axis.rungs.iter().copied()).chain([0]).collect();
        let place: BTreeMap<usize, usize> = on.iter().enumerate().map(|(new, old)| (*old, new)).collect();
        self.axes.iter_mut().flat_map(|axis| &mut axis.rungs).for_each(|rung| *rung = place[rung]);
        let mut old = 0..;
        self.rungs.retain(|_| old.next().is_some_and(|rung| on.contains(&rung)));
    }

    /// Adds the base with these keys in place of its own, unless a rung is the same already; returns its place.
    pub fn add(
        &mut self,
        name: &str,
        differs: BTreeMap<String, Value>,
        data: Option<&Path>,
    ) -> Result<usize, InputError> {
        let base = &self.rungs[0].scene;
        let scene = changed(base, &differs, name, data)?;
        if let Some(same) = self.rungs.iter().position(|rung| is_same(&rung.scene, &scene)) {
            return Ok(same);
        }
        // Each has a folder of its own.
        let names = (2..).map(|n| format!("{name}_{n}"));
        let free = std::iter::once(name.to_string()).chain(names).find(|name| self.rung(name).is_none());
        self.rungs.push(Rung { name: free.expect("names do not end"), differs, scene });
        Ok(self.rungs.len() - 1)
    }
}

/// What is read, and where recordings and surfaces are looked for.
struct Reader<'a> {
    source: Source<'a>,
    data: Option<&'a Path>,
}

impl Reader<'_> {
    fn ladder(&self, entry: &LadderFile, scene: Option<&Path>, wrong: &mut Mistakes) -> Option<Ladder> {
        let own = entry.scene.as_ref().map_or(PathBuf::from("walker"), |s| s.get_ref().clone());
        let stem =
            |path: &Path| path.file_stem().map_or("ladder".into(), |s| s.to_string_lossy().into_owned());
        let (given, name) = match scene {
            Some(scene) => (scene.to_path_buf(), stem(scene)),
            None => {
                let beside = self.source.file.with_file_name(&own);
                (if beside.is_file() { beside } else { own }, stem(self.source.file))
            }
        };
        if let (None, Some(named)) = (scene, &entry.scene) {
            let remedy = match shipped::find(&given, Kind::Scene) {
                Ok(found) if shipped::is_shipped(&found) || found.is_file() => None,
                Ok(_) => Some("no such file beside the ladder".to_string()),
                Err(error) => Some(said(&error)),
            };
            if let Some(remedy) = remedy {
                let value = format!("`{}`", given.display());
                wrong.note(self.source.bad_at(named.span().start, "scene", value, remedy));
                return None;
            }
        }
        let base = wrong.keep(Scene::read(&given, self.data))?;
        let of_base = base.name.clone();
        let base = wrong.keep(changed(&base, &BTreeMap::new(), BASE, self.data))?;
        let rung = Rung { name: BASE.into(), differs: BTreeMap::new(), scene: base };
        let mut ladder = Ladder {
            name,
            text: self.source.text.to_string(),
            scene: of_base,
            rungs: vec![rung],
            axes: Vec::new(),
        };
        let mut names = BTreeSet::new();
        for axis in &entry.axis {
            if !names.insert(file_name(axis.name.get_ref())) {
                let remedy = "every axis has a name of its own";
                wrong.note(self.source.bad_at(
                    axis.name.span().start,
                    "name",
                    format!("`{}` again", axis.name.get_ref()),
                    remedy,
                ));
            }
            self.axis(axis, &mut ladder, wrong);
        }
        Some(ladder)
    }

    /// Adds an axis with its rungs.
    fn axis(&self, entry: &AxisEntry, ladder: &mut Ladder, wrong: &mut Mistakes) {
        let mut known = true;
        for key in std::iter::once(&entry.key).chain(entry.with.keys()) {
            if let Err(remedy) = known_key(key.get_ref()) {
                wrong.note(self.source.bad_at(
                    key.span().start,
                    "key",
                    format!("`{}`", key.get_ref()),
                    remedy,
                ));
                known = false;
            }
        }
        if !known {
            return;
        }
        let with: BTreeMap<String, Value> =
            entry.with.iter().map(|(key, value)| (key.get_ref().clone(), value.get_ref().clone())).collect();
        let mut rungs = Vec::new();
        for value in &entry.values {
            let mut differs = with.clone();
            differs.insert(entry.key.get_ref().clone(), value.get_ref().clone());
            let name = file_name(&format!("{} {}", entry.name.get_ref(), words(value.get_ref())));
            match ladder.add(&name, differs, self.data) {
                Ok(rung) if rungs.contains(&rung) => {
                    let remedy = "every value once";
                    wrong.note(self.source.bad_at(
                        value.span().start,
                        "values",
                        words(value.get_ref()),
                        remedy,
                    ));
                }
                Ok(rung) => rungs.push(rung),
                Err(error) => wrong.note(self.source.bad_at(
                    value.span().start,
                    entry.key.get_ref(),
                    words(value.get_ref()),
                    said(&error),
                )),
            }
        }
        if entry.values.len() < 2 {
            let remedy = "give two values at least, from coarse to fine";
            wrong.note(self.source.bad_at(
                entry.key.span().start,
                "values",
                format!("{} of them", entry.values.len()),
                remedy,
            ));
        }
        let (name, key) = (entry.name.get_ref().clone(), entry.key.get_ref().clone());
        ladder.axes.push(Axis { name, key, owner: entry.error, rungs, with });
    }
}

/// What an error of a scene says, without the place in a text that nobody wrote.
fn said(error: &InputError) -> String {
    match error {
        InputError::BadValue { remedy, .. } | InputError::Malformed { remedy, .. } => remedy.clone(),
        InputError::Several(all) => all.iter().map(said).collect::<Vec<_>>().join("; "),
        other => other.to_string(),
    }
}

/// An error names what may be meant.
fn known_key(key: &str) -> Result<(), String> {
    let keys = || {
        // Entries of a list have no value of their own.
        let is_of_a_list =
            |k: &Key| ["materials.muscle.", "step.", "fidelity."].iter().any(|s| k.path.starts_with(s));
        SCENE_KEYS.iter().filter(move |k| (!k.is_section() || k.path == "fidelity") && !is_of_a_list(k))
    };
    if keys().any(|k| k.path == key) {
        return Ok(());
    }
    let meant = nearest(key, keys().map(|k| k.path))
        .or_else(|| keys().find(|k| k.name() == key).map(|k| k.path.to_string()));
    let meant = hint(meant);
    let all: Vec<&str> = keys().map(|k| k.path).collect();
    Err(format!("{meant}keys of a scene are {}", all.join(", ")))
}

/// A scene with keys, dotted, in place of its own; `name`: what it is called.
pub fn changed(
    base: &Scene,
    keys: &BTreeMap<String, Value>,
    name: &str,
    data: Option<&Path>,
) -> Result<Scene, InputError> {
    let absolute = |path: &Path| match shipped::is_shipped(path) {
        true => path.to_path_buf(),
        false => std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()),
    };
    let trial = base.trial.as_ref().map(|t| absolute(t).to_string_lossy().into_owned());
    let mut table: Table = toml::from_str(&base.resolved(trial.as_deref())).expect("just written");
    if let Some(surfaces) = &base.surfaces {
        table.insert("surfaces".into(), absolute(surfaces).to_string_lossy().into_owned().into());
    }
    for (path, value) in keys {
        let (sections, last) = path.rsplit_once('.').map_or((None, path.as_str()), |(s, l)| (Some(s), l));
        let mut at = &mut table;
        for section in sections.into_iter().flat_map(|s| s.split('.')) {
            let inner = at.entry(section).or_insert(Value::Table(Table::new()));
            at = inner.as_table_mut().expect("a section of the keys");
        }
        at.insert(last.into(), value.clone());
    }
    let text = toml::to_string(&table).expect("keys and values of TOML");
    Scene::parse(Path::new(&format!("{name}.toml")), &text, data)
}

/// Whether two scenes are carried out to the same bytes.
fn is_same(a: &Scene, b: &Scene) -> bool {
    let plain = |scene: &Scene| Scene {
        name: String::new(),
        text: String::new(),
        folder: None,
        nested_from: None,
        ..scene.clone()
    };
    let coarser = |scene: &Scene| Configuration::ALL.map(|c| scene.coarser(c));
    plain(a) == plain(b) && coarser(a) == coarser(b)
}

/// A value as a person would say it.
fn words(value: &Value) -> String {
    match value {
        Value::String(word) => word.clone(),
        Value::Float(number) => crate::number::short(*number),
        Value::Array(list) if list.is_empty() => "none".into(),
        Value::Array(list) if list.iter().all(Value::is_table) => {
            list.iter().map(words).collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(" ")
        }
        Value::Array(list) => list.len().to_string(),
        // Which muscles have it is in the scene.
        Value::Table(entry) => {
            let what = entry.iter().filter(|(key, _)| *key != "muscle").map(|(_, value)| words(value));
            what.collect::<Vec<_>>().join(" ")
        }
        other => other.to_string(),
    }
}

/// A name for a file or folder.
fn file_name(words: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' || c == '-' { c } else { '_' };
    words.chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_has_a_row_and_every_row_a_field() {
        assert_eq!(multibody::keys::differences::<LadderFile>(KEYS), Vec::<String>::new());
    }

    const TEXT: &str = "scene = \"walker\"\n\n[[axis]]\nname = \"mesh\"\nkey = \"resolution_mm\"\nvalues = [20, 12, 9.0]\nerror = \"discretisation\"\n\n[[axis]]\nname = \"alone\"\nkey = \"resolution_mm\"\nvalues = [20.0, 9.0]\nerror = \"discretisation\"\nwith = { \"effects.contact\" = \"none\" }\n";

    fn parse(text: &str) -> Result<Ladder, InputError> {
        Ladder::parse(Path::new("my.toml"), text, None, None)
    }

    #[test]
    fn rungs_are_scenes_and_none_is_there_twice() {
        let ladder = parse(TEXT).unwrap();
        let names: Vec<&str> = ladder.rungs.iter().map(|r| r.name.as_str()).collect();
        assert_eq!(names, ["base", "mesh_20", "mesh_9", "alone_20", "alone_9"]);
        assert_eq!(ladder.axes[0].rungs, [1, 0, 2]);
        assert_eq!(ladder.rungs[1].scene.resolution, 20e-3);
        assert!(ladder.rungs[1].scene.contact.is_some() && ladder.rungs[3].scene.contact.is_none());
        assert_eq!((ladder.name.as_str(), ladder.scene.as_str()), ("my", "walker"));
        assert_eq!(ladder.rungs[0].scene.steps, Scene::walker().steps);
    }

    #[test]
    fn rungs_of_lists_have_folders_of_their_own() {
        let alone = |level: &str| format!("[{{ muscle = \"gracilis\", {level} }}]");
        let levels = ["level = \"line\"", "level = \"embedded\", cell_mm = 60.0"].map(alone).join(", ");
        let axis = |name: &str, key: &str, values: &str| {
            format!(
                "\n[[axis]]\nname = \"{name}\"\nkey = \"{key}\"\nvalues = [{values}]\nerror = \"modelling\"\n"
            )
        };
        let muscles = axis("muscles", "muscles", "[\"gracilis\"], [\"sartorius\"]");
        let ladder = parse(&format!("{TEXT}{muscles}{}", axis("fidelity", "fidelity", &levels))).unwrap();
        let names: Vec<&str> = ladder.rungs[5..].iter().map(|r| r.name.as_str()).collect();
        assert_eq!(names, ["muscles_1", "muscles_1_2", "fidelity_line", "fidelity_60_embedded"]);
    }

    #[test]
    fn all_mistakes_are_named_with_their_lines() {
        let text = TEXT
            .replace("values = [20, 12, 9.0]", "values = [20, 12, 90.0]")
            .replace("\"alone\"\nkey = \"resolution_mm\"", "\"alone\"\nkey = \"resolution\"")
            .replace("effects.contact\" =", "effects.contract\" =");
        let missing = parse(&TEXT.replace("\"walker\"", "\"wolker\"")).unwrap_err().to_string();
        let wanted = ["my.toml", "line 1", "`wolker`", "did you mean `walker`"];
        assert!(wanted.iter().all(|w| missing.contains(w)), "{missing}");
        let InputError::Several(all) = parse(&text).unwrap_err() else { panic!("three are wrong") };
        let all: Vec<String> = all.iter().map(InputError::to_string).collect();
        assert_eq!(all.len(), 3, "{all:#?}");
        for (said, words) in all.iter().zip([
            ["line 6", "`resolution_mm` is 90", "2.5 to 20 mm"],
            ["line 11", "`resolution`", "did you mean `resolution_mm`"],
            ["line 14", "`effects.contract`", "did you mean `effects.contact`"],
        ]) {
            assert!(words.iter().all(|w| said.contains(w)), "{words:?} in {said}");
        }
    }
}
