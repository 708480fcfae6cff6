//! `sartorius step SCENE`: one scene, one configuration: with contact where the scene has contact.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Outcome;
use super::compare::{Ways, carry_out};
use crate::error::CommandError;
use crate::scene::Scene;

#[derive(Args)]
pub struct StepArguments {
    /// Scene file (TOML), or the name of a shipped scene such as three_muscles.
    scene: PathBuf,
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the results [default: out/step-<scene>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on with a run of the same scene that was killed.
    #[arg(long)]
    resume: bool,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &StepArguments) -> Result<Outcome, CommandError> {
    let scene = Scene::read(&arguments.scene, arguments.data.as_deref())?;
    let with = scene.contact.is_some();
    let folder = arguments.out.clone();
    let folder = folder.unwrap_or_else(|| Path::new("out").join(format!("step-{}", scene.name)));
    let ways = Ways { resume: arguments.resume, json: arguments.json, two_way: None };
    carry_out("step", scene, [!with, with], arguments.data.as_deref(), &folder, ways)
}
