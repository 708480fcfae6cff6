//! `sartorius check FILE...`

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process;

use clap::Args;

use multibody::InputError;

use super::Outcome;
use crate::scene::{Scene, TomlKind};

#[derive(Args)]
pub struct CheckArguments {
    /// Files to check: C3D, TRC, STO, MOT, CSV, trial files and scenes (TOML).
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder of the recordings that a trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// Prints one paragraph per file; ends the process with exit code 2 when a file is bad.
pub fn run(arguments: &CheckArguments) -> Outcome {
    let mut bad = 0;
    for file in &arguments.files {
        match check(file, arguments.data.as_deref()) {
            Ok(summary) => {
                let _ = writeln!(std::io::stdout(), "{}: good. {summary}", file.display());
            }
            Err(error) => {
                bad += 1;
                eprintln!("error: {error}");
            }
        }
    }
    if bad > 0 {
        process::exit(2);
    }
    Outcome::Solved
}

/// A scene is told from a trial file by its keys; its trial is examined, too.
fn check(file: &Path, data: Option<&Path>) -> Result<String, InputError> {
    let is_toml = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let is_scene = |text: String| TomlKind::of(&text) == TomlKind::Scene;
    if !(is_toml && file.is_file() && std::fs::read_to_string(file).is_ok_and(is_scene)) {
        return multibody::read::check(file, data);
    }
    let scene = Scene::read(file, data)?;
    let mut text = "Scene.".to_string();
    for (label, value) in scene.settings() {
        text += &format!(" {label}: {value}.");
    }
    if let Some(trial) = &scene.trial {
        text += &format!(" {}", multibody::read::check(trial, data)?);
    }
    Ok(text)
}
