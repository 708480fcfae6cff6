//! `sartorius template trial RECORDING` and `sartorius template scene [NAME]`: files with every key and its meaning.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use multibody::InputError;
use multibody::keys::{Filled, template};
use multibody::trial::{Sex, Side};
use multibody::trial_file::{Wishes, guess};

use super::Outcome;
use crate::error::CommandError;
use coupling::scene::{self, KEYS};

#[derive(Args)]
pub struct TemplateArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// A trial file for a recording: finds markers, plates and channels, guesses their roles, and says what is left to fill in.
    Trial(TrialArguments),
    /// A scene with every key, its default and its meaning; of a shipped or own scene with its values.
    Scene(SceneArguments),
}

#[derive(Args)]
struct TrialArguments {
    /// The recording with the markers: C3D or TRC.
    recording: PathBuf,
    /// Table with the forces (STO, MOT, CSV) [default: the plates of the C3D file, or the table beside a TRC file].
    #[arg(long, value_name = "FILE")]
    force_table: Option<PathBuf>,
    /// Standing trial with markers on epicondyles and malleoli [default: one beside the recording, by its name].
    #[arg(long = "static", value_name = "FILE")]
    standing: Option<PathBuf>,
    /// Leg under study [default: the one with a whole cycle on the plates; of both the right one].
    #[arg(long, value_enum)]
    side: Option<SideChoice>,
    /// Name or code of the subject.
    #[arg(long)]
    name: Option<String>,
    /// Body mass in kg.
    #[arg(long, value_name = "KG")]
    mass: Option<f64>,
    /// Standing height in m.
    #[arg(long, value_name = "M")]
    height: Option<f64>,
    /// Sex.
    #[arg(long, value_enum)]
    sex: Option<SexChoice>,
    #[command(flatten)]
    to: To,
}

#[derive(Args)]
struct SceneArguments {
    /// Scene file, or the name of a shipped scene [default: the defaults of all keys].
    scene: Option<PathBuf>,
    #[command(flatten)]
    to: To,
}

#[derive(Args)]
struct To {
    /// File to write [default: standard output].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write over an existing file.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SideChoice {
    Right,
    Left,
}

#[derive(Clone, Copy, ValueEnum)]
enum SexChoice {
    Male,
    Female,
}

/// Runs the command.
pub fn run(arguments: &TemplateArguments) -> Result<Outcome, CommandError> {
    match &arguments.what {
        What::Trial(arguments) => {
            arguments.to.may_be_written()?;
            let folder = arguments.to.out.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
            let made = guess(&Wishes {
                motion: arguments.recording.clone(),
                folder: folder.to_path_buf(),
                force: arguments.force_table.clone(),
                standing: arguments.standing.clone(),
                side: arguments.side.map(|s| match s {
                    SideChoice::Right => Side::Right,
                    SideChoice::Left => Side::Left,
                }),
                name: arguments.name.clone(),
                mass_kg: arguments.mass,
                height_m: arguments.height,
                sex: arguments.sex.map(|s| match s {
                    SexChoice::Male => Sex::Male,
                    SexChoice::Female => Sex::Female,
                }),
            })?;
            arguments.to.write(&made.text)?;
            let data = made.data.map_or(String::new(), |f| format!(" --data {}", f.display()));
            let file = arguments.to.out.as_ref().map_or("FILE".into(), |f| f.display().to_string());
            coupling::say!(
                "{}",
                match made.open.is_empty() {
                    true => format!("nothing is left to fill in; next: sartorius check {file}{data}"),
                    false => format!(
                        "to fill in (lines with FILL IN): {}; then: sartorius check {file}{data}",
                        made.open.join(", ")
                    ),
                }
            );
        }
        What::Scene(arguments) => {
            arguments.to.may_be_written()?;
            arguments.to.write(&scene_text(arguments.scene.as_deref())?)?;
        }
    }
    Ok(Outcome::Solved)
}

/// All keys of a scene, with the values of one where it is named.
fn scene_text(given: Option<&Path>) -> Result<String, CommandError> {
    let heading = vec![
        "A scene: what `compare`, `step` and `plan` simulate. Every key may be left away; then it has the default of the page docs/keys.md.".into(),
        "What it would simulate and cost: sartorius plan THIS_FILE".into(),
        String::new(),
    ];
    let mut filled = Filled { heading, ..Filled::default() };
    if let Some(given) = given {
        let text = scene::text(given)?;
        let table: toml::Table = toml::from_str(&text).map_err(|_| unreadable(given))?;
        flatten("", &toml::Value::Table(table), &mut filled);
        filled.heading[0] = format!("The scene {}, with every key.", given.display());
    }
    Ok(template(KEYS, &filled))
}

/// A scene that was read before is TOML.
fn unreadable(given: &Path) -> InputError {
    InputError::Malformed {
        file: given.to_path_buf(),
        at: multibody::error::Place::Whole,
        problem: "not TOML".into(),
        remedy: "sartorius check tells where".into(),
    }
}

/// Dotted paths of all values; those of arrays of tables with their number.
fn flatten(path: &str, value: &toml::Value, filled: &mut Filled) {
    let below = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    match value {
        toml::Value::Table(table) => table.iter().for_each(|(name, v)| flatten(&below(name), v, filled)),
        toml::Value::Array(list) if !list.is_empty() && list.iter().all(toml::Value::is_table) => {
            list.iter().enumerate().for_each(|(n, v)| flatten(&below(&n.to_string()), v, filled));
        }
        value => filled.set(path, value.to_string()),
    }
}

impl To {
    fn may_be_written(&self) -> Result<(), CommandError> {
        match &self.out {
            Some(file) if file.exists() && !self.force => Err(CommandError::Option(format!(
                "--out: {} exists; give another name, or --force to write over it",
                file.display()
            ))),
            _ => Ok(()),
        }
    }

    fn write(&self, text: &str) -> Result<(), CommandError> {
        let Some(file) = &self.out else {
            // A reader that closes the pipe early is no error.
            let _ = std::io::stdout().lock().write_all(text.as_bytes());
            return Ok(());
        };
        std::fs::write(file, text).map_err(|e| {
            CommandError::Option(format!(
                "--out: {} cannot be written ({e}); choose another place",
                file.display()
            ))
        })
    }
}
