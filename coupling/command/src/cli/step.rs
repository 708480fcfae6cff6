//! `sartorius step SCENE`: one scene, one configuration: with contact where the scene has contact.

use std::path::PathBuf;

use clap::Args;

use super::compare::carry_out;
use super::scenes::{read_scene, scenes};
use super::{Outcome, RunArguments};
use crate::error::CommandError;
use coupling::configuration::PerConfiguration;

#[derive(Args)]
pub struct StepArguments {
    #[arg(help = scenes())]
    scene: PathBuf,
    #[command(flatten)]
    run: RunArguments,
}

/// Runs the command.
pub fn run(arguments: &StepArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let StepArguments { scene, run } = arguments;
    let scene = read_scene(scene, run.data.as_deref())?;
    let with = scene.contact.is_some();
    carry_out("step", scene, PerConfiguration { without: !with, with }, run, None, None, quiet)
}
