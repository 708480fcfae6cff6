//! Scenes: what `compare`, `step` and `plan` simulate, written by a person (TOML).
//!
//! ```toml
//! trial = "walker"            # the built-in walker, a trial file beside this one, or the name of a shipped trial
//! muscles = "all"             # of the thigh: "all", a list of names, or "none" for the rigid leg alone
//! resolution_mm = 12.0        # edges of the mesh
//! draw_in_mm = 0.0            # surfaces of the muscles drawn in by up to this: gaps between them grow by up to twice as much
//! stress_free = "standing"    # posture of the mesh without stress: "standing" or "heel_strike"
//! surfaces = "muscles_fit"    # folder of closed muscle surfaces [m] beside a folder `bones`; absent: the built-in thigh
//!
//! [accuracy]                  # forces out of balance at which a step counts as solved, norm over all nodes
//! residual_n = 0.1            # without contact
//! contact_residual_n = 10.0   # with contact
//!
//! [effects]
//! fibres = "hill"             # "hill", "thermal" or "none"; absent: thermal where stress-free at heel strike, Hill elsewhere
//! shells = true
//! contact = "guarded"         # "guarded", "cheap" or "none"
//!
//! [materials]                 # constants of all muscles and of single ones: see [`materials`]
//! aponeurosis_thickness_mm = 0.5
//!
//! [[step]]
//! name = "heel_strike"
//! [[step]]
//! name = "loading_response"
//! knee_flexion_deg = 15.0     # in place of the trial's
//! ```
//!
//! Every key has the default shown, `surfaces` and `knee_flexion_deg` none. Files are looked for beside the scene, then in `--data`.

pub mod materials;
mod resolved;
mod words;

use std::io::Read;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use fem::scene::ContactMode;
use multibody::InputError;
use multibody::error::{Place, nearest};
use serde::Deserialize;
use toml::Spanned;

use crate::compare::StressFree;
use crate::steps::StepName;
use crate::thigh::lines::lines_of_muscles;
use materials::{Materials, MaterialsEntry};

/// The scene of a run without one.
const WALKER: &str = include_str!("../../../gait-data/scenes/walker.toml");
/// Where shipped scenes lie, seen from the root of the repository.
const SHIPPED: &str = "gait-data/scenes";
/// Target edge lengths that are meshed \[mm\].
pub const RESOLUTIONS: RangeInclusive<f64> = 3.0..=20.0;
/// How far muscles can be drawn in \[mm\]; at least a third of the thickness and width of every muscle is left.
const DRAWN_IN: RangeInclusive<f64> = 0.0..=5.0;
/// Knee flexion that can be prescribed \[degrees\].
const FLEXIONS: RangeInclusive<f64> = 0.0..=120.0;
/// Residuals that can be asked for \[N\]: the least is above round-off, the greatest below the forces of most muscles.
const RESIDUALS: RangeInclusive<f64> = 1e-3..=100.0;
/// Residuals without and with contact \[N\] where the scene says nothing. Sections of single muscles are compared in newtons. With contact
/// the last 10 N cost as much time as all before and move sections by a newton (`docs/results.md`).
const NATURAL_RESIDUALS: [f64; 2] = [0.1, 10.0];
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

/// One step of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSpec {
    /// Which.
    pub name: StepName,
    /// Knee flexion in place of the trial's \[rad\].
    pub knee_flexion: Option<f64>,
}

/// A scene with every value checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name: that of the file without ending.
    pub name: String,
    /// Text, as read.
    pub text: String,
    /// Folder of the file; `None` for the built-in one.
    pub folder: Option<PathBuf>,
    /// Trial file; `None` is the built-in walker.
    pub trial: Option<PathBuf>,
    /// Whether there is a thigh beside the rigid leg.
    pub deformable: bool,
    /// Which muscles; empty: all.
    pub muscles: Vec<String>,
    /// Folder of muscle surfaces; `None`: the built-in thigh.
    pub surfaces: Option<PathBuf>,
    /// Edge length of the mesh that is aimed at \[m\].
    pub resolution: f64,
    /// How far the surfaces of the muscles are drawn in at most \[m\].
    pub draw_in: f64,
    /// Forces out of balance at which a step counts as solved, without and with contact: norm over all nodes \[N\], more where muscles pull
    /// with more than 1000 N.
    pub residuals: [f64; 2],
    /// Where the mesh is free of stress.
    pub stress_free: StressFree,
    /// Fibres.
    pub fibres: Fibres,
    /// Shells around the muscles.
    pub shells: bool,
    /// Contact; `None`: surfaces do not see each other.
    pub contact: Option<ContactMode>,
    /// Material constants that the scene gives.
    pub materials: Materials,
    /// Steps, in the order of time.
    pub steps: Vec<StepSpec>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    trial: Option<Spanned<PathBuf>>,
    muscles: Option<Spanned<Muscles>>,
    resolution_mm: Option<Spanned<f64>>,
    draw_in_mm: Option<Spanned<f64>>,
    #[serde(default)]
    stress_free: Option<Spanned<StressFree>>,
    surfaces: Option<Spanned<PathBuf>>,
    #[serde(default)]
    accuracy: AccuracyEntry,
    #[serde(default)]
    effects: EffectsEntry,
    #[serde(default)]
    materials: MaterialsEntry,
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
    residual_n: Option<Spanned<f64>>,
    contact_residual_n: Option<Spanned<f64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectsEntry {
    fibres: Option<Fibres>,
    shells: Option<bool>,
    contact: Option<ContactChoice>,
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
    knee_flexion_deg: Option<Spanned<f64>>,
}

impl Scene {
    /// The built-in scene: the walker on the built-in thigh.
    pub fn walker() -> Scene {
        Scene::parse(Path::new("walker.toml"), WALKER, None).expect("the built-in scene is tested")
    }

    /// Reads a scene file, or a shipped scene by its name. `data`: where else to look for its files.
    pub fn read(given: &Path, data: Option<&Path>) -> Result<Scene, InputError> {
        if given == Path::new("walker") && !given.exists() {
            return Ok(Scene::walker());
        }
        let file = find(given, SHIPPED)?;
        let io = |source| InputError::Io { file: file.clone(), source };
        let mut text = String::new();
        std::fs::File::open(&file).map_err(io)?.take(LARGEST).read_to_string(&mut text).map_err(io)?;
        Scene::parse(&file, &text, data)
    }

    /// Reads the text of a scene; `file` tells the folder and is named in errors.
    pub fn parse(file: &Path, text: &str, data: Option<&Path>) -> Result<Scene, InputError> {
        let at = Source { file, text };
        let scene: SceneFile = toml::from_str(text).map_err(|e| at.translate(&e))?;
        let folder = file.parent().unwrap_or(Path::new(""));
        let trial = match &scene.trial {
            None => None,
            Some(name) if name.get_ref() == Path::new("walker") => None,
            Some(name) => {
                Some(at.existing("trial", name, &[Some(folder), data], Some("gait-data/trials"))?)
            }
        };
        let surfaces = scene.surfaces.as_ref();
        let surfaces =
            surfaces.map(|s| at.existing("surfaces", s, &[Some(folder), data], None)).transpose()?;
        let (deformable, muscles) = match &scene.muscles {
            None => (true, Vec::new()),
            Some(given) => at.muscles(given)?,
        };
        let resolution = match &scene.resolution_mm {
            None => 12.0,
            Some(mm) => at.within("resolution_mm", mm, &RESOLUTIONS, "mm")?,
        };
        let draw_in = match &scene.draw_in_mm {
            None => 0.0,
            Some(mm) => at.within("draw_in_mm", mm, &DRAWN_IN, "mm")?,
        };
        let accuracy = &scene.accuracy;
        let mut residuals = NATURAL_RESIDUALS;
        let given =
            [("residual_n", &accuracy.residual_n), ("contact_residual_n", &accuracy.contact_residual_n)];
        for (residual, (key, given)) in residuals.iter_mut().zip(given) {
            if let Some(newtons) = given {
                *residual = at.within(key, newtons, &RESIDUALS, "N")?;
            }
        }
        let stress_free = scene.stress_free.as_ref().map_or(StressFree::default(), |s| *s.get_ref());
        let mut steps = at.steps(scene.step.as_deref())?;
        steps.sort_by_key(|s| StepName::ALL.iter().position(|n| *n == s.name));
        let at_heel_strike = stress_free == StressFree::HeelStrike;
        if at_heel_strike && steps[0].name != StepName::HeelStrike {
            let line = scene.stress_free.as_ref().map_or(1, |s| at.line(s.span().start));
            let remedy = "add the step heel_strike, or take the mesh as stress-free in standing";
            return Err(at.bad(line, "stress_free", "heel_strike without that step", remedy));
        }
        let shells = scene.effects.shells.unwrap_or(true);
        let mut wrong = Vec::new();
        let materials = scene.materials.check(&muscles, shells, &mut |byte, key, value, remedy| {
            wrong.push(at.bad(at.line(byte), key, value, remedy));
        });
        if let Some(first) = wrong.into_iter().next() {
            return Err(first);
        }
        let natural = if at_heel_strike { Fibres::Thermal } else { Fibres::Hill };
        Ok(Scene {
            name: file.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned()),
            text: text.to_string(),
            folder: Some(folder.to_path_buf()),
            trial,
            deformable,
            muscles,
            surfaces,
            resolution: resolution * 1e-3,
            draw_in: draw_in * 1e-3,
            residuals,
            stress_free,
            fibres: scene.effects.fibres.unwrap_or(natural),
            shells,
            contact: match scene.effects.contact.unwrap_or(ContactChoice::Guarded) {
                ContactChoice::Guarded => Some(ContactMode::Guarded),
                ContactChoice::Cheap => Some(ContactMode::Cheap),
                ContactChoice::None => None,
            },
            materials,
            steps,
        })
    }
}

/// A path as it is, or a shipped file by its name.
pub fn find(given: &Path, shipped: &str) -> Result<PathBuf, InputError> {
    if given.exists() || given.extension().is_some() || given.components().count() > 1 {
        return Ok(given.to_path_buf());
    }
    let file = Path::new(shipped).join(given).with_extension("toml");
    if file.exists() {
        return Ok(file);
    }
    let entries = std::fs::read_dir(shipped).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.filter_map(|e| Some(e.path().file_stem()?.to_str()?.to_string())).collect();
    names.sort();
    let word = given.to_string_lossy();
    let meant = nearest(&word, names.iter().map(String::as_str));
    let remedy = match meant {
        Some(name) => format!("did you mean `{name}`?"),
        None if names.is_empty() => format!("give a file; shipped ones are in {shipped} of the repository"),
        None => format!("give a file, or one of {}", names.join(", ")),
    };
    let problem = "there is no such file, and nothing of that name is shipped".to_string();
    Err(InputError::Malformed { file: given.to_path_buf(), at: Place::Whole, problem, remedy })
}

/// The text that errors point into.
struct Source<'a> {
    file: &'a Path,
    text: &'a str,
}

impl Source<'_> {
    fn line(&self, byte: usize) -> usize {
        1 + self.text.get(..byte).unwrap_or(self.text).matches('\n').count()
    }

    fn bad(&self, line: usize, key: &str, value: impl ToString, remedy: impl ToString) -> InputError {
        InputError::BadValue {
            file: self.file.to_path_buf(),
            line,
            key: key.into(),
            value: value.to_string(),
            remedy: remedy.to_string(),
        }
    }

    /// An unknown key or word becomes one with the most similar known one; all others keep the words of the reader.
    fn translate(&self, error: &toml::de::Error) -> InputError {
        let line = error.span().map_or(1, |span| self.line(span.start));
        let message = error.message().to_string();
        // unknown field `resolution`, expected one of `trial`, `resolution_mm`, …
        let mut quoted = message.split('`').skip(1).step_by(2);
        let word = quoted.next().unwrap_or("").to_string();
        let known: Vec<&str> = quoted.collect();
        let meant = nearest(&word, known.iter().copied());
        if message.starts_with("unknown field") {
            return InputError::UnknownKey { file: self.file.to_path_buf(), line, key: word, nearest: meant };
        }
        if message.starts_with("unknown variant") {
            let meant = meant.map_or(String::new(), |m| format!("did you mean `{m}`? "));
            let key = self.text.lines().nth(line - 1).and_then(|l| l.split('=').next()).unwrap_or("").trim();
            return self.bad(
                line,
                key,
                format!("`{word}`"),
                format!("{meant}known are {}", known.join(", ")),
            );
        }
        let remedy = format!("see the scenes in {SHIPPED}");
        InputError::Malformed {
            file: self.file.to_path_buf(),
            at: Place::Line(line),
            problem: message,
            remedy,
        }
    }

    fn within(
        &self,
        key: &str,
        value: &Spanned<f64>,
        range: &RangeInclusive<f64>,
        unit: &str,
    ) -> Result<f64, InputError> {
        if range.contains(value.get_ref()) {
            return Ok(*value.get_ref());
        }
        let remedy = format!("give {} to {} {unit}", range.start(), range.end());
        Err(self.bad(self.line(value.span().start), key, value.get_ref(), remedy))
    }

    /// A file or folder in one of `folders`, or a shipped file by its name.
    fn existing(
        &self,
        key: &str,
        given: &Spanned<PathBuf>,
        folders: &[Option<&Path>],
        shipped: Option<&str>,
    ) -> Result<PathBuf, InputError> {
        let path = given.get_ref();
        let found = folders.iter().flatten().map(|folder| folder.join(path)).find(|p| p.exists());
        let line = self.line(given.span().start);
        match (found, shipped) {
            (Some(found), _) => Ok(found),
            (None, Some(shipped)) => match find(path, shipped) {
                Ok(found) if found.exists() => Ok(found),
                Ok(_) => {
                    let remedy = "no such file beside the scene or in the data folder";
                    Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
                }
                Err(InputError::Malformed { remedy, .. }) => {
                    Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
                }
                Err(other) => Err(other),
            },
            (None, None) => {
                let remedy = "no such folder beside the scene or in the data folder; give --data DIR";
                Err(self.bad(line, key, format!("`{}`", path.display()), remedy))
            }
        }
    }

    /// Whether there are muscles, and which; none named: all.
    fn muscles(&self, given: &Spanned<Muscles>) -> Result<(bool, Vec<String>), InputError> {
        let line = self.line(given.span().start);
        let list = match given.get_ref() {
            Muscles::Word(word) if word == "all" => return Ok((true, Vec::new())),
            Muscles::Word(word) if word == "none" => return Ok((false, Vec::new())),
            Muscles::Word(word) => {
                let remedy = "give \"all\", \"none\" or a list of names";
                return Err(self.bad(line, "muscles", format!("`{word}`"), remedy));
            }
            Muscles::List(list) if list.is_empty() => {
                return Err(self.bad(line, "muscles", "an empty list", "name muscles, or give \"none\""));
            }
            Muscles::List(list) => list,
        };
        // Places inside the list are not told by the reader.
        let place = |name: &str| {
            let span = given.span();
            let text = self.text.get(span.clone()).unwrap_or("");
            self.line(span.start + text.rfind(&format!("{name:?}")).unwrap_or(0))
        };
        for (i, name) in list.iter().enumerate() {
            if let Err(remedy) = known_muscle(name) {
                return Err(self.bad(place(name), "muscles", format!("`{name}`"), remedy));
            }
            if list[..i].contains(name) {
                return Err(self.bad(place(name), "muscles", format!("`{name}` twice"), "name it once"));
            }
        }
        Ok((true, list.clone()))
    }

    fn steps(&self, given: Option<&[StepEntry]>) -> Result<Vec<StepSpec>, InputError> {
        let Some(given) = given else {
            return Ok(StepName::ALL.iter().map(|&name| StepSpec { name, knee_flexion: None }).collect());
        };
        let mut steps: Vec<StepSpec> = Vec::new();
        for entry in given {
            let name = *entry.name.get_ref();
            if steps.iter().any(|s| s.name == name) {
                let line = self.line(entry.name.span().start);
                return Err(self.bad(line, "name", format!("`{}` again", name.name()), "every step once"));
            }
            let flexion = entry.knee_flexion_deg.as_ref();
            let flexion =
                flexion.map(|f| self.within("knee_flexion_deg", f, &FLEXIONS, "degrees")).transpose()?;
            steps.push(StepSpec { name, knee_flexion: flexion.map(f64::to_radians) });
        }
        if steps.is_empty() {
            return Err(self.bad(1, "step", "an empty list", "leave it away for both steps"));
        }
        Ok(steps)
    }
}

/// An error names what may be meant.
pub fn known_muscle(name: &str) -> Result<(), String> {
    let known = lines_of_muscles();
    if known.contains_key(name) {
        return Ok(());
    }
    let meant = nearest(name, known.keys().map(String::as_str));
    let meant = meant.map_or(String::new(), |m| format!("did you mean `{m}`? "));
    let names: Vec<&str> = known.keys().map(String::as_str).collect();
    Err(format!("{meant}the muscles of the thigh are {}", names.join(", ")))
}
