//! Scenes: what `compare`, `step` and `plan` simulate, written by a person (TOML).
//!
//! Every key, with its default and meaning, is a row of [`KEYS`]; `sartorius template scene` writes them all, and docs/keys.md is their page.
//! Files are looked for beside the scene, then in `--data`.

pub mod fidelity;
mod keys;
pub mod materials;
mod resolved;
mod words;

use std::io::Read;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use fem::scene::ContactMode;
use fem::solve::{Method, Settings};
use multibody::InputError;
use multibody::error::{Mistakes, Place, unknown};
use multibody::keys::examine;
use multibody::shipped::{self, Kind};
use serde::Deserialize;
use toml::Spanned;

pub use keys::{KEYS, TomlKind, wanted};

use crate::configuration::{Configuration, PerConfiguration};
use crate::source::Source;
use crate::thigh::lines::lines_of_muscles;
use fidelity::{Fidelity, FidelityEntry};
use materials::{Materials, MaterialsEntry};

/// Target edge lengths that are meshed \[mm\].
pub const RESOLUTIONS: RangeInclusive<f64> = 2.5..=20.0;
/// How far muscles can be inset \[mm\]; at least a third of the thickness and width of every muscle is left.
const INSETS: RangeInclusive<f64> = 0.0..=5.0;
/// Activation distances of contact \[mm\]: the least is ten times the round-off of collision detection on the thigh, the greatest a fifth of the
/// thinnest muscle.
const DISTANCES: RangeInclusive<f64> = 0.01..=2.0;
/// Knee flexion that can be prescribed \[degrees\].
const FLEXIONS: RangeInclusive<f64> = 0.0..=120.0;
/// Residuals that can be asked for \[N\]: the least is above round-off, the greatest below the forces of most muscles.
const RESIDUALS: RangeInclusive<f64> = 1e-3..=100.0;
/// Residuals without and with contact \[N\] where the scene says nothing. Sections of single muscles are compared in newtons. With contact
/// the last 10 N cost as much time as all before and move sections by a newton (`docs/results.md`).
const NATURAL_RESIDUALS: PerConfiguration<f64> = PerConfiguration { without: 0.1, with: 10.0 };
/// A scene is a page of text \[bytes\].
const LARGEST: u64 = 1 << 20;

/// Law of the fibres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fibres {
    /// Force from activation and length.
    Hill,
    /// Force from contraction, as in the publication.
    Thermal,
    /// No fibres: passive tissue.
    None,
}

/// Which instant of the gait cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(into = "&'static str", try_from = "String")]
pub enum StepName {
    /// Heel strike: start of the cycle.
    HeelStrike,
    /// Loading response: 12 % of the cycle of the reference gait in `gait-data/reference_gait.csv`.
    LoadingResponse,
    /// That many twentieths of the cycle, 1 to 20.
    Twentieth(u8),
}

/// Names of all steps, by their time.
pub const STEPS: [&str; 22] = [
    "heel_strike",
    "cycle_5",
    "cycle_10",
    "loading_response",
    "cycle_15",
    "cycle_20",
    "cycle_25",
    "cycle_30",
    "cycle_35",
    "cycle_40",
    "cycle_45",
    "cycle_50",
    "cycle_55",
    "cycle_60",
    "cycle_65",
    "cycle_70",
    "cycle_75",
    "cycle_80",
    "cycle_85",
    "cycle_90",
    "cycle_95",
    "cycle_100",
];

impl StepName {
    /// Both that are solved where a scene says nothing, in the order of time.
    pub const DEFAULT: [StepName; 2] = [StepName::HeelStrike, StepName::LoadingResponse];

    /// Name as in `comparison.csv`.
    pub fn name(self) -> &'static str {
        match self {
            StepName::HeelStrike => STEPS[0],
            StepName::LoadingResponse => STEPS[3],
            StepName::Twentieth(n @ ..3) => STEPS[usize::from(n)],
            StepName::Twentieth(n) => STEPS[usize::from(n) + 1],
        }
    }

    /// The step of this name.
    pub fn of(name: &str) -> Option<StepName> {
        let all = StepName::DEFAULT.into_iter().chain((1..=20).map(StepName::Twentieth));
        all.into_iter().find(|step| step.name() == name)
    }

    /// Fraction of the reported frames.
    pub fn fraction(self) -> f64 {
        match self {
            StepName::HeelStrike => 0.0,
            StepName::LoadingResponse => 0.12,
            StepName::Twentieth(n) => f64::from(n) / 20.0,
        }
    }
}

impl From<StepName> for &'static str {
    fn from(step: StepName) -> &'static str {
        step.name()
    }
}

impl TryFrom<String> for StepName {
    type Error = String;

    fn try_from(name: String) -> Result<StepName, String> {
        StepName::of(&name).ok_or_else(|| unknown(&name, "steps are", STEPS.iter().copied()))
    }
}

/// In which posture the mesh is free of stress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StressFree {
    /// Standing, as it was meshed: the bones move to the posture of heel strike first.
    #[default]
    Standing,
    /// At heel strike, as in the publication: the mesh is taken as it is for that posture.
    HeelStrike,
}

/// One step of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSpec {
    /// Which.
    pub name: StepName,
    /// Knee flexion in place of the trial's \[rad\].
    pub knee_flexion: Option<f64>,
}

/// Edge \[m\] up to which coarser meshes are solved first where nothing else is asked for: that of the shipped scenes, which are known to be
/// solved. After it guarded contact at 6 mm takes a third of the time, and no contact about as long as at once.
pub const NESTED_FROM: f64 = 12e-3;

/// A scene with every value checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name: that of the file without ending.
    pub name: String,
    /// Text, as read.
    pub text: String,
    /// Folder of the file.
    pub folder: Option<PathBuf>,
    /// Trial file; `None` is the built-in walker.
    pub trial: Option<PathBuf>,
    /// Co-simulation unit that says the activations of the thigh; `None`: the static optimization does.
    pub controller: Option<PathBuf>,
    /// Whether there is a thigh beside the rigid leg.
    pub deformable: bool,
    /// Which muscles; empty: all.
    pub muscles: Vec<String>,
    /// Folder of muscle surfaces; `None`: the built-in thigh.
    pub surfaces: Option<PathBuf>,
    /// Edge length of the mesh that is aimed at \[m\].
    pub resolution: f64,
    /// How far the surfaces of the muscles are inset at most \[m\].
    pub inset: f64,
    /// Forces out of balance at which a step counts as solved: norm over all nodes \[N\], more where muscles pull
    /// with more than 1000 N.
    pub residuals: PerConfiguration<f64>,
    /// Smaller steps in which every step with contact goes, by collision detection alone; `None`: softened contact says where to go.
    pub strict_steps: Option<usize>,
    /// Every state is shown to be a minimum of the energy.
    pub check_stability: bool,
    /// Calibrated muscles are looked at in other states too.
    pub check_calibration: bool,
    /// Which solver.
    pub method: Method,
    /// Time steps that a step may take per body where there are no matrices.
    pub max_steps: usize,
    /// Edge \[m\] up to which coarser meshes are solved first, where the scene says one; see [`Scene::coarser`].
    pub nested_from: Option<f64>,
    /// Where the mesh is free of stress.
    pub stress_free: StressFree,
    /// Fibres.
    pub fibres: Fibres,
    /// Nodes of a section from fibre to fibre.
    pub fibre_spacing: usize,
    /// Shells around the muscles.
    pub shells: bool,
    /// Contact; `None`: surfaces do not see each other.
    pub contact: Option<ContactMode>,
    /// Guarded: distance \[m\] below which surfaces repel each other. Cheap: depth at which a layer of that thickness would be pressed flat.
    pub contact_distance: f64,
    /// Muscles that are in grids, or lines alone.
    pub fidelity: Fidelity,
    /// Material constants that the scene gives.
    pub materials: Materials,
    /// Steps, in the order of time.
    pub steps: Vec<StepSpec>,
}

/// The file as written: every key here and in the entries below has a row in [`KEYS`] (tested).
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    trial: Option<Spanned<PathBuf>>,
    controller: Option<Spanned<PathBuf>>,
    muscles: Option<Spanned<Muscles>>,
    resolution_mm: Option<f64>,
    inset_mm: Option<f64>,
    #[serde(default)]
    stress_free: Option<Spanned<StressFree>>,
    surfaces: Option<Spanned<PathBuf>>,
    #[serde(default)]
    accuracy: AccuracyEntry,
    #[serde(default)]
    solver: SolverEntry,
    #[serde(default)]
    effects: EffectsEntry,
    #[serde(default)]
    materials: MaterialsEntry,
    #[serde(default)]
    fidelity: Vec<FidelityEntry>,
    step: Option<Vec<StepEntry>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "\"all\", \"none\" or a list of names is wanted")]
enum Muscles {
    Word(String),
    List(Vec<String>),
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AccuracyEntry {
    residual_n: Option<f64>,
    contact_residual_n: Option<f64>,
    strict_steps: Option<usize>,
    check_stability: Option<bool>,
    check_calibration: Option<bool>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct SolverEntry {
    method: Option<Spanned<Method>>,
    max_steps: Option<usize>,
    nested_from_mm: Option<Spanned<f64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectsEntry {
    fibres: Option<Fibres>,
    fibre_spacing: Option<usize>,
    shells: Option<bool>,
    contact: Option<ContactChoice>,
    contact_distance_mm: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ContactChoice {
    Guarded,
    Cheap,
    None,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StepEntry {
    name: Spanned<StepName>,
    knee_flexion_deg: Option<f64>,
}

impl Scene {
    /// The built-in scene: the walker on the built-in thigh.
    pub fn walker() -> Scene {
        Scene::read(Path::new("walker"), None).expect("the built-in scene is tested")
    }

    /// Reads a scene file, or a shipped scene by its name. `data`: where else to look for its files.
    pub fn read(given: &Path, data: Option<&Path>) -> Result<Scene, InputError> {
        let (file, text) = source(given)?;
        Scene::parse(&file, &text, data)
    }

    /// Edges \[m\] of the coarser meshes that are solved first in a configuration, from coarse to fine: 2, 4, ... times that of the scene, up
    /// to [`nested_from`](Scene::nested_from), or to [`NESTED_FROM`]. None with cheap contact, which has no softened way that goes on from a
    /// guess, and none without being asked for where it would be refused.
    pub fn coarser(&self, configuration: Configuration) -> Vec<f64> {
        let is_cheap =
            configuration == Configuration::WithContact && self.contact == Some(ContactMode::Cheap);
        let may_be_led = self.method == Method::Newton
            && self.strict_steps.is_none()
            && self.fidelity.embedded.is_empty()
            && !is_cheap;
        let most = self.nested_from.unwrap_or(NESTED_FROM);
        let most = if may_be_led { most * (1.0 + 1e-9) } else { 0.0 };
        let mut edges: Vec<f64> = std::iter::successors(Some(2.0 * self.resolution), |edge| Some(2.0 * edge))
            .take_while(|edge| *edge <= most)
            .collect();
        edges.reverse();
        edges
    }

    /// Reads the text of a scene; every mistake is named. `file` tells the folder and is named in errors.
    pub fn parse(file: &Path, text: &str, data: Option<&Path>) -> Result<Scene, InputError> {
        wanted(TomlKind::Scene, file, text)?;
        let mut wrong = Mistakes::default();
        let scene = examine(file, text, KEYS, &mut wrong).and_then(|d| d.fill(file, text, &mut wrong));
        let made = scene.and_then(|scene: SceneFile| scene.check(&Source { file, text }, data, &mut wrong));
        wrong.finish()?;
        made.ok_or_else(|| InputError::Malformed {
            file: file.to_path_buf(),
            at: Place::Whole,
            problem: "no scene".into(),
            remedy: "see docs/keys.md".into(),
        })
    }
}

impl SceneFile {
    /// What hangs on other files, on names and on more than one key; each value by itself was held against the table of keys.
    fn check(&self, at: &Source, data: Option<&Path>, wrong: &mut Mistakes) -> Option<Scene> {
        let folder = at.file.parent().unwrap_or(Path::new(""));
        let folders = [Some(folder), data];
        let trial = self.trial.as_ref().filter(|name| name.get_ref() != Path::new("walker"));
        let trial = trial.map(|name| wrong.keep(at.existing("trial", name, &folders, Some(Kind::Trial))));
        let controller = self.controller.as_ref();
        let controller = controller.map(|unit| wrong.keep(at.existing("controller", unit, &folders, None)));
        let surfaces = self.surfaces.as_ref();
        let surfaces = surfaces.map(|s| wrong.keep(at.existing("surfaces", s, &folders, None)));
        let mut muscles = self.muscles.as_ref().map_or(Some((true, Vec::new())), |m| at.muscles(m, wrong));
        let stress_free = self.stress_free.as_ref().map_or(StressFree::default(), |s| *s.get_ref());
        let mut steps = at.steps(self.step.as_deref(), wrong);
        steps.sort_by(|a, b| a.name.fraction().total_cmp(&b.name.fraction()));
        let at_heel_strike = stress_free == StressFree::HeelStrike;
        if at_heel_strike && steps.first().is_some_and(|s| s.name != StepName::HeelStrike) {
            let line = self.stress_free.as_ref().map_or(1, |s| at.line(s.span().start));
            let remedy = "add the step heel_strike, or take the mesh as stress-free in standing";
            wrong.note(at.bad(line, "stress_free", "heel_strike without that step", remedy));
        }
        let shells = self.effects.shells.unwrap_or(true);
        let mut all = (true, Vec::new());
        let of_entry = muscles.as_mut().unwrap_or(&mut all);
        let resolution = self.resolution_mm.unwrap_or(12.0) * 1e-3;
        let fidelity =
            Fidelity::check(&self.fidelity, of_entry, resolution, at, &mut |byte, key, value, remedy| {
                wrong.note(at.bad_at(byte, key, value, remedy));
            });
        let simulated = muscles.as_ref().map_or(&[][..], |m| m.1.as_slice());
        let materials = self.materials.check(simulated, shells, &mut |byte, key, value, remedy| {
            wrong.note(at.bad(at.line(byte), key, value, remedy));
        });
        let natural = if at_heel_strike { Fibres::Thermal } else { Fibres::Hill };
        let fibres = self.effects.fibres.unwrap_or(natural);
        if let Some(unit) = self.controller.as_ref().filter(|_| fibres != Fibres::Hill) {
            let remedy =
                "only Hill fibres have activations: set effects.fibres = \"hill\", or take controller out";
            let line = at.line(unit.span().start);
            wrong.note(at.bad(line, "controller", format!("`{}`", unit.get_ref().display()), remedy));
        }
        let PerConfiguration { without, with } = NATURAL_RESIDUALS;
        let accuracy = &self.accuracy;
        let nested = self.solver.nested_from_mm.as_ref();
        if let Some(edge) = nested.filter(|_| !fidelity.embedded.is_empty()) {
            let remedy =
                "muscles in grids are not led by a coarser mesh: take that out, or level = \"embedded\"";
            let line = at.line(edge.span().start);
            let value = format!("{} with level = \"embedded\"", edge.get_ref());
            wrong.note(at.bad(line, "solver.nested_from_mm", value, remedy));
        }
        if let (Some(edge), Some(_)) = (nested, accuracy.strict_steps) {
            let remedy =
                "steps by collision detection alone take no way from elsewhere: take one of the two out";
            let value = format!("{} with accuracy.strict_steps", edge.get_ref());
            wrong.note(at.bad(at.line(edge.span().start), "solver.nested_from_mm", value, remedy));
        }
        let newton_only = [
            ("solver.nested_from_mm", nested.is_some()),
            ("accuracy.check_stability", accuracy.check_stability == Some(true)),
            ("accuracy.strict_steps", accuracy.strict_steps.is_some()),
            ("level = \"embedded\"", !fidelity.embedded.is_empty()),
        ];
        let method = self.solver.method.as_ref().filter(|m| *m.get_ref() != Method::Newton);
        for (key, _) in newton_only.into_iter().filter(|(_, asked)| method.is_some() && *asked) {
            let line = method.map_or(1, |m| at.line(m.span().start));
            let remedy = format!("only newton does what {key} asks for: take that out, or the method");
            wrong.note(at.bad(line, "solver.method", format!("relaxation with {key}"), remedy));
        }
        let (deformable, muscles) = muscles?;
        Some(Scene {
            name: at.file.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned()),
            text: at.text.to_string(),
            folder: Some(folder.to_path_buf()),
            trial: trial.flatten(),
            controller: controller.flatten(),
            deformable,
            muscles,
            surfaces: surfaces.flatten(),
            resolution,
            inset: self.inset_mm.unwrap_or(0.0) * 1e-3,
            residuals: PerConfiguration {
                without: accuracy.residual_n.unwrap_or(without),
                with: accuracy.contact_residual_n.unwrap_or(with),
            },
            strict_steps: accuracy.strict_steps,
            check_stability: accuracy.check_stability.unwrap_or(false),
            check_calibration: accuracy.check_calibration.unwrap_or(false),
            method: self.solver.method.as_ref().map_or(Method::Newton, |m| *m.get_ref()),
            max_steps: self.solver.max_steps.unwrap_or(Settings::default().max_steps),
            nested_from: nested.map(|mm| mm.get_ref() * 1e-3),
            stress_free,
            fibres,
            fibre_spacing: self.effects.fibre_spacing.unwrap_or(1),
            shells,
            contact_distance: self.effects.contact_distance_mm.unwrap_or(0.3) * 1e-3,
            contact: match self.effects.contact.unwrap_or(ContactChoice::Guarded) {
                ContactChoice::Guarded => Some(ContactMode::Guarded),
                ContactChoice::Cheap => Some(ContactMode::Cheap),
                ContactChoice::None => None,
            },
            fidelity,
            materials,
            steps,
        })
    }
}

/// The text of a scene file, or of a shipped scene by its name.
pub fn text(given: &Path) -> Result<String, InputError> {
    Ok(source(given)?.1)
}

/// File and text of a scene.
fn source(given: &Path) -> Result<(PathBuf, String), InputError> {
    let file = shipped::find(given, Kind::Scene)?;
    if let Some(text) = shipped::text(&file) {
        return Ok((file, text.to_string()));
    }
    let io = |source| InputError::Io { file: file.clone(), source };
    let mut text = String::new();
    std::fs::File::open(&file).map_err(io)?.take(LARGEST).read_to_string(&mut text).map_err(io)?;
    Ok((file, text))
}

impl Source<'_> {
    /// A file or folder in one of `folders`, or a shipped file by its name.
    fn existing(
        &self,
        key: &str,
        given: &Spanned<PathBuf>,
        folders: &[Option<&Path>],
        shipped: Option<Kind>,
    ) -> Result<PathBuf, InputError> {
        let path = given.get_ref();
        let line = self.line(given.span().start);
        let named = shipped.map(|kind| shipped::find(path, kind));
        if let Some(Ok(found)) = &named
            && shipped::is_shipped(found)
        {
            return Ok(found.clone());
        }
        let found = folders.iter().flatten().map(|folder| folder.join(path)).find(|p| p.exists());
        match (found, named) {
            (Some(found), _) => Ok(found),
            (None, Some(Ok(found))) if found.exists() => Ok(found),
            (None, Some(Err(InputError::Malformed { remedy, .. }))) => {
                Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
            }
            (None, Some(_)) => {
                let remedy = "no such file beside the scene or in the data folder";
                Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
            }
            (None, None) => {
                let remedy = "nothing of that name beside the scene or in the data folder; give --data DIR";
                Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
            }
        }
    }

    /// Whether there are muscles, and which; none named: all.
    fn muscles(&self, given: &Spanned<Muscles>, wrong: &mut Mistakes) -> Option<(bool, Vec<String>)> {
        let list = match given.get_ref() {
            Muscles::Word(word) => return Some((word != "none", Vec::new())),
            Muscles::List(list) => list,
        };
        if list.is_empty() {
            let line = self.line(given.span().start);
            wrong.note(self.bad(line, "muscles", "an empty list", "name muscles, or give \"none\""));
            return None;
        }
        // Places inside the list are not told by the reader.
        let place = |name: &str| {
            let span = given.span();
            let text = self.text.get(span.clone()).unwrap_or("");
            self.line(span.start + text.rfind(&format!("{name:?}")).unwrap_or(0))
        };
        for (i, name) in list.iter().enumerate() {
            if let Err(remedy) = known_muscle(name) {
                wrong.note(self.bad(place(name), "muscles", format!("`{name}`"), remedy));
            }
            if list[..i].contains(name) {
                wrong.note(self.bad(place(name), "muscles", format!("`{name}` twice"), "name it once"));
            }
        }
        Some((true, list.clone()))
    }

    fn steps(&self, given: Option<&[StepEntry]>, wrong: &mut Mistakes) -> Vec<StepSpec> {
        let Some(given) = given else {
            return StepName::DEFAULT.iter().map(|&name| StepSpec { name, knee_flexion: None }).collect();
        };
        if given.is_empty() {
            wrong.note(self.bad(1, "step", "an empty list", "leave it away for both steps"));
        }
        let mut steps: Vec<StepSpec> = Vec::new();
        for entry in given {
            let name = *entry.name.get_ref();
            if steps.iter().any(|s| s.name == name) {
                let line = self.line(entry.name.span().start);
                wrong.note(self.bad(line, "name", format!("`{}` again", name.name()), "every step once"));
            }
            steps.push(StepSpec { name, knee_flexion: entry.knee_flexion_deg.map(f64::to_radians) });
        }
        steps
    }
}

/// An error names what may be meant.
pub fn known_muscle(name: &str) -> Result<(), String> {
    let known = lines_of_muscles();
    if known.contains_key(name) {
        return Ok(());
    }
    Err(unknown(name, "the muscles of the thigh are", known.keys().map(String::as_str)))
}
