//! `sartorius scenes [NAME]`: what is shipped; and how a scene is named on the command line.

use std::io::Write;
use std::path::Path;

use clap::Args;
use multibody::error::{hint, nearest};
use multibody::shipped::{self, Kind};

use super::{Outcome, deep_flexion};
use crate::error::CommandError;
use coupling::scene::Scene;

#[derive(Args)]
pub struct ScenesArguments {
    /// Print the file of this scene or trial: to look at, or as the start of one of your own.
    name: Option<String>,
}

/// Runs the command.
pub fn run(arguments: &ScenesArguments) -> Result<Outcome, CommandError> {
    let all = || [Kind::Scene, Kind::Trial].into_iter().flat_map(Kind::all);
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = match &arguments.name {
        None => list(&mut out),
        Some(name) => match all().find(|(known, _)| known == name) {
            Some((_, text)) => write!(out, "{text}"),
            None => {
                deep_flexion::refuse(Path::new(name))?;
                let meant = hint(nearest(name, all().map(|(known, _)| known)));
                return Err(CommandError::Option(format!(
                    "no shipped scene or trial is named `{name}`; {meant}`sartorius scenes` lists them"
                )));
            }
        },
    };
    Ok(Outcome::Solved)
}

fn list(w: &mut impl Write) -> std::io::Result<()> {
    for (title, kind) in [
        ("scenes (compare, step, plan)", Kind::Scene),
        ("trials (optimize, and in scenes; recordings are found with --data)", Kind::Trial),
    ] {
        writeln!(w, "{title}")?;
        for (name, text) in kind.all() {
            writeln!(w, "  {name:<20}{}", first_sentence(text))?;
        }
    }
    writeln!(w, "knees (step, and `cost deep_flexion`; made by the program, or read with --data)")?;
    for knee in &deep_flexion::KNEES {
        // As far as the longest name.
        writeln!(w, "  {:<24}{}", knee.name, knee.what)?;
    }
    Ok(())
}

/// What a file says of itself first.
fn first_sentence(text: &str) -> String {
    let lines = text.lines().map_while(|line| line.strip_prefix("# "));
    let words = lines.collect::<Vec<_>>().join(" ");
    words.split_once(". ").map_or(words.clone(), |(first, _)| format!("{first}."))
}

/// Help on the argument.
pub(super) fn scenes() -> String {
    let names: Vec<&str> = Kind::Scene.all().map(|(name, _)| name).collect();
    format!(
        "Scene file (TOML), or the name of a shipped scene: {}. A word alone is a name, ./word a file. Default of compare and plan: walker",
        names.join(", ")
    )
}

/// The scene that a person names.
pub(super) fn read_scene(given: &Path, data: Option<&Path>) -> Result<Scene, CommandError> {
    deep_flexion::refuse(given)?;
    if let Some(said) = shipped::ambiguity(given, &shipped::find(given, Kind::Scene)?) {
        coupling::say!("note: {said}");
    }
    Ok(Scene::read(given, data)?)
}
