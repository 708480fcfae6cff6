//! `sartorius step SCENE`: one scene, one configuration: with contact where the scene has contact. `deep_flexion` and its like are no thigh but a knee.

use std::path::PathBuf;

use clap::Args;

use super::compare::carry_out;
use super::scenes::{read_scene, scenes};
use super::{Outcome, RunArguments, deep_flexion};
use crate::error::CommandError;
use coupling::configuration::PerConfiguration;

#[derive(Args)]
pub struct StepArguments {
    #[arg(help = format!("{}. Or a knee: {}", scenes(), deep_flexion::KNEES.each_ref().map(|k| k.name).join(", ")))]
    scene: PathBuf,
    #[command(flatten)]
    run: RunArguments,
}

/// Runs the command.
pub fn run(arguments: &StepArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let StepArguments { scene, run } = arguments;
    if let Some(knee) = deep_flexion::meant(scene) {
        return deep_flexion::run(knee, run, quiet);
    }
    let scene = read_scene(scene, run.data.as_deref())?;
    let with = scene.contact.is_some();
    carry_out("step", scene, PerConfiguration { without: !with, with }, run, None, None, quiet)
}
