//! `sartorius step SCENE`: one scene, one configuration: with contact where the scene has contact. `deep_flexion` is no thigh but a knee.

use std::path::PathBuf;

use clap::Args;

use super::compare::carry_out;
use super::scenes::{read_scene, scenes};
use super::{Outcome, RunArguments, deep_flexion};
use crate::error::CommandError;
use coupling::configuration::PerConfiguration;

#[derive(Args)]
pub struct StepArguments {
    #[arg(help = format!("{}. Or {}: {}", scenes(), deep_flexion::NAME, deep_flexion::WHAT))]
    scene: PathBuf,
    #[command(flatten)]
    run: RunArguments,
}

/// Runs the command.
pub fn run(arguments: &StepArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let StepArguments { scene, run } = arguments;
    if deep_flexion::is_meant(scene) {
        return deep_flexion::run(run, quiet);
    }
    let scene = read_scene(scene, run.data.as_deref())?;
    let with = scene.contact.is_some();
    carry_out("step", scene, PerConfiguration { without: !with, with }, run, None, None, quiet)
}
