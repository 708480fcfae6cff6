//! What a unit carries: the scene with everything that it reads, and what was found in calibration. Nothing is written to where it lies.
//!
//! | file | what it is |
//! |---|---|
//! | `unit.toml` | which side and configuration, and the token of the unit |
//! | `calibration.toml` | calibration of the fibres |
//! | `scene/NAME.toml`, `scene/surfaces/` | the scene, its surfaces where it has some |
//! | `trial/` | the trial file, its landmarks and recordings |

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use coupling::comparison::{Prepared, Sized};
use coupling::configuration::Configuration;
use coupling::fibres::WrittenCalibration;
use coupling::scene::Scene;
use coupling::session::{RigidSide, ThighSide};
use multibody::shipped::is_shipped;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::UnitError;
use crate::model::Model;
use crate::thigh::Extras;

/// Which side a unit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// The rigid leg.
    Rigid,
    /// The thigh.
    Thigh,
}

/// `unit.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct UnitFile {
    side: Which,
    /// File of the scene in `scene`.
    scene: String,
    /// Whether bodies take notice of each other.
    contact: bool,
    extras: Extras,
}

/// Files of a unit by their names below `resources`, and its token.
pub struct Resources {
    /// Name and content.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Hash of all of them and of the version of the program.
    pub token: String,
}

fn io(file: &Path) -> impl Fn(std::io::Error) -> UnitError {
    move |e| UnitError::Wrong(format!("{}: {e}", file.display()))
}

/// Puts together what a unit of a scene carries. `data`: folder of recordings and surfaces.
pub fn collect(
    which: Which,
    sized: &Sized,
    configuration: Configuration,
    extras: Extras,
    calibration: &WrittenCalibration,
    data: Option<&Path>,
) -> Result<Resources, UnitError> {
    let mut files = BTreeMap::new();
    let (scene, case) = (&sized.scene, sized.case());
    let mut trial = None;
    if let Some(path) = &scene.trial {
        for (name, text) in &case.texts {
            files.insert(format!("trial/{}", plain(name)?), text.clone().into_bytes());
        }
        trial = case.texts.first().map(|(name, _)| format!("../trial/{name}"));
        let own = path.parent().unwrap_or(Path::new(""));
        let texts: Vec<&Path> = case.texts.iter().map(|(name, _)| Path::new(name)).collect();
        for file in case.inputs.iter().filter(|f| !is_shipped(f) && !texts.iter().any(|t| f.ends_with(t))) {
            let below =
                [Some(own), data].into_iter().flatten().find_map(|folder| file.strip_prefix(folder).ok());
            let name = below.unwrap_or(Path::new(file.file_name().unwrap_or_default()));
            let name = name.to_string_lossy().replace('\\', "/");
            files.insert(format!("trial/{}", plain(&name)?), std::fs::read(file).map_err(io(file))?);
        }
    }
    let mut text = scene.resolved(trial.as_deref());
    if let Some(folder) = &scene.surfaces {
        for file in sized.inputs().iter().filter(|f| !case.inputs.contains(f)) {
            let kind = if file.parent() == Some(folder.as_path()) { "muscles" } else { "bones" };
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            files.insert(format!("scene/surfaces/{kind}/{name}"), std::fs::read(file).map_err(io(file))?);
        }
        let mut keys: toml::Table = toml::from_str(&text).expect("it was written");
        keys.insert("surfaces".into(), "surfaces/muscles".into());
        text = toml::to_string(&keys).expect("keys and values of TOML");
    }
    let scene = format!("{}.toml", scene.name);
    files.insert(format!("scene/{scene}"), text.into_bytes());
    let contact = configuration == Configuration::WithContact;
    let plain_data = "plain data";
    let unit = toml::to_string(&UnitFile { side: which, scene, contact, extras }).expect(plain_data);
    files.insert("unit.toml".into(), unit.into_bytes());
    files.insert("calibration.toml".into(), toml::to_string(calibration).expect(plain_data).into_bytes());
    let token = token_of(&files);
    Ok(Resources { files, token })
}

/// A name that stays in its folder.
fn plain(name: &str) -> Result<&str, UnitError> {
    match Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        true => Ok(name),
        false => Err(UnitError::Wrong(format!(
            "`{name}` lies outside of the folder of the trial and of --data, so that no unit can carry it; move it there"
        ))),
    }
}

fn token_of(files: &BTreeMap<String, Vec<u8>>) -> String {
    let mut digest = Sha256::new();
    digest.update(env!("CARGO_PKG_VERSION"));
    for (name, content) in files {
        digest.update(name);
        digest.update((content.len() as u64).to_le_bytes());
        digest.update(content);
    }
    digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The files of a folder of resources.
fn read(folder: &Path) -> Result<BTreeMap<String, Vec<u8>>, UnitError> {
    let mut files = BTreeMap::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(below) = folders.pop() {
        let at = folder.join(&below);
        for entry in std::fs::read_dir(&at).map_err(io(&at))? {
            let entry = entry.map_err(io(&at))?;
            let (name, path) = (below.join(entry.file_name()), entry.path());
            match path.is_dir() {
                true => folders.push(name),
                false => {
                    let content = std::fs::read(&path).map_err(io(&path))?;
                    files.insert(name.to_string_lossy().replace('\\', "/"), content);
                }
            }
        }
    }
    Ok(files)
}

/// What a unit is, from its resources; refuses those of another token.
pub fn load(folder: &Path, token: &str) -> Result<Model, UnitError> {
    if let Some(known) = kept(token) {
        return Ok(known);
    }
    let files = read(folder)?;
    let found = token_of(&files);
    if found != token {
        return Err(UnitError::Wrong(format!(
            "the resources in {} are not those of this unit: instantiation token {token}, of the resources {found}; export it anew",
            folder.display()
        )));
    }
    let text = |name: &str| {
        let bytes =
            files.get(name).ok_or_else(|| UnitError::Wrong(format!("the unit has no resource {name}")))?;
        std::str::from_utf8(bytes).map_err(|_| UnitError::Wrong(format!("{name} is no text")))
    };
    let bad = |name: &str, e: toml::de::Error| UnitError::Wrong(format!("{name}: {e}"));
    let unit: UnitFile = toml::from_str(text("unit.toml")?).map_err(|e| bad("unit.toml", e))?;
    let calibration: WrittenCalibration =
        toml::from_str(text("calibration.toml")?).map_err(|e| bad("calibration.toml", e))?;
    let file = folder.join("scene").join(&unit.scene);
    let scene = Scene::parse(&file, text(&format!("scene/{}", unit.scene))?, None)
        .map_err(|e| UnitError::Wrong(e.to_string()))?;
    let sized = Sized::new(scene, None)?;
    let model = match unit.side {
        Which::Rigid => Model::Rigid(Arc::new(RigidSide::new(sized, calibration)?)),
        Which::Thigh => {
            let prepared = Prepared::of(sized, &mut |_| ())?;
            let configuration =
                if unit.contact { Configuration::WithContact } else { Configuration::WithoutContact };
            let side = ThighSide::new(prepared, configuration, Some(calibration), Path::new(""))?;
            Model::Thigh(Arc::new(side), unit.extras)
        }
    };
    keep(token, &model);
    Ok(model)
}

/// Units of which the model is kept while the library is loaded: a study makes instances of a unit or two by the hundreds, and a mesh takes a
/// second.
const KEPT: usize = 4;
static MODELS: Mutex<Vec<(String, Model)>> = Mutex::new(Vec::new());

fn kept(token: &str) -> Option<Model> {
    let models = MODELS.lock().unwrap_or_else(PoisonError::into_inner);
    models.iter().find(|(known, _)| known == token).map(|(_, model)| model.clone())
}

fn keep(token: &str, model: &Model) {
    let mut models = MODELS.lock().unwrap_or_else(PoisonError::into_inner);
    if models.len() >= KEPT {
        models.remove(0);
    }
    models.push((token.into(), model.clone()));
}
