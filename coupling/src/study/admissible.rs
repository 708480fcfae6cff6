//! Whether a run could take a value, asked before any run begins.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use multibody::InputError;
use multibody::shipped;
use multibody::trial_file::TrialFile;
use toml::Value;

use super::vary::Target;
use crate::changes::{Changes, number, scene_with};
use crate::optimize::OptimizeOptions;
use crate::options::set_option;
use crate::scene::Scene;

/// Files that values are tried on.
pub(super) struct Base<'a> {
    /// Trials of the subjects; `None`: the built-in walker.
    pub trials: Vec<Option<&'a PathBuf>>,
    /// Scene of the runs, where they have one.
    pub scene: Option<&'a Scene>,
    /// Folder of recordings and surfaces.
    pub data: Option<&'a Path>,
}

impl Base<'_> {
    /// Whether a target takes a value, by itself; an error says what it takes.
    pub(super) fn takes(&self, target: &Target, value: &Value) -> Result<(), String> {
        match target {
            Target::Trial(key) => {
                for trial in &self.trials {
                    let Some(trial) = trial else {
                        return Err("the built-in walker has no trial file; name one as the subject".into());
                    };
                    let trial_keys = BTreeMap::from([(key.clone(), value.clone())]);
                    let changes = Changes { trial: trial_keys, ..Changes::default() };
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
                let Some(scene) = self.scene else { return Ok(()) };
                let keys = BTreeMap::from([(key.clone(), value.clone())]);
                scene_with(scene, &keys, self.data).map(|_| ()).map_err(|e| said(&e))
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
