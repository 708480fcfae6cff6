//! `sartorius check FILE...`

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::Outcome;
use crate::error::CommandError;
use coupling::cost::ladder::Ladder;
use coupling::scene::{Scene, TomlKind};
use coupling::solve::OwnScene;
use coupling::study::Study;

#[derive(Args)]
pub struct CheckArguments {
    /// Files to check: C3D, TRC, STO, MOT, CSV, trial files and scenes (TOML).
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder of the recordings that a trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// Prints one paragraph per file.
pub fn run(arguments: &CheckArguments) -> Outcome {
    let mut bad = 0;
    for file in &arguments.files {
        match check(file, arguments.data.as_deref()) {
            Ok(summary) => {
                let _ = writeln!(std::io::stdout(), "{}: good. {summary}", file.display());
            }
            Err(error) => {
                bad += 1;
                coupling::say!("error: {error}");
            }
        }
    }
    if bad > 0 { Outcome::BadInput } else { Outcome::Solved }
}

/// A scene is told from a trial file by its keys; its trial is examined, too, and so are mesh and drive of a scene of bodies of one's own.
fn check(file: &Path, data: Option<&Path>) -> Result<String, CommandError> {
    let is_toml = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let text = is_toml.then(|| std::fs::read_to_string(file).ok()).flatten();
    match text.as_deref().map(TomlKind::of) {
        Some(TomlKind::Scene) => {}
        Some(TomlKind::Ladder) => {
            let ladder = Ladder::read(file, None, data)?;
            let names: Vec<&str> = ladder.axes.iter().map(|axis| axis.name.as_str()).collect();
            return Ok(format!(
                "Ladder: {} rungs, {} axes ({}).",
                ladder.rungs.len(),
                names.len(),
                names.join(", ")
            ));
        }
        Some(TomlKind::Study) => {
            let study = Study::read(file, data)?;
            return Ok(format!(
                "Study: {} runs; {} subjects, {} settings, {} samples of {} dimensions.",
                study.n_runs(),
                study.subjects.len(),
                study.settings.len(),
                study.samples,
                study.dimensions.len()
            ));
        }
        Some(TomlKind::OwnScene) => return Ok(of_own(&OwnScene::read(file)?)),
        Some(TomlKind::Trial) | None => return Ok(multibody::read::check(file, data)?),
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

fn of_own(scene: &OwnScene) -> String {
    let plan = &scene.plan;
    format!(
        "Scene of `solve`: {} nodes, {} islands that are solved apart, {} frames. Left out: {}.",
        plan.mesh.points.len(),
        plan.islands.len(),
        scene.drive.frames.len(),
        plan.absent.join(", ")
    )
}
