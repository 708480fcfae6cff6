//! `sartorius step SCENE`: one scene, one configuration: with contact where the scene has contact.

use std::path::PathBuf;

use clap::Args;

use super::compare::carry_out;
use super::{Outcome, RunArguments};
use crate::error::CommandError;
use crate::scene::Scene;

#[derive(Args)]
pub struct StepArguments {
    /// Scene file (TOML), or the name of a shipped scene such as three_muscles.
    scene: PathBuf,
    #[command(flatten)]
    run: RunArguments,
}

/// Runs the command.
pub fn run(arguments: &StepArguments) -> Result<Outcome, CommandError> {
    let StepArguments { scene, run } = arguments;
    let scene = Scene::read(scene, run.data.as_deref())?;
    let with = scene.contact.is_some();
    carry_out("step", scene, [!with, with], run, None)
}
