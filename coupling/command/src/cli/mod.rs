//! The command line. Exit codes: 0 solved, 2 bad input, 3 not converged or a verdict failed; nothing else.

mod accuracy;
mod check;
mod compare;
mod cost;
mod deep_cost;
mod deep_flexion;
mod export_fmu;
mod interrupt;
mod mesh;
mod optimize;
mod plan;
mod progress;
mod rung;
mod scenes;
mod solve;
mod step;
mod study;
mod template;
mod workers;

pub use study::{Collected, collect};

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use multibody::error::unknown;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

use crate::error::CommandError;
use crate::output::claim::{Claim, Identity};
use crate::output::origin::version;

/// How a command ended when it did run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything solved.
    Solved,
    /// Results were written, but a verdict failed.
    NotSolved,
    /// An input is bad, as was said on standard error.
    BadInput,
}

/// What the commands that carry out a scene have in common.
#[derive(Args)]
struct RunArguments {
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    out: OutArguments,
    /// Go on with a run of the same scene that was killed: its solved frames are taken over, the results are the same to the last bit.
    #[arg(long)]
    resume: bool,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

/// Where results go.
#[derive(Args)]
struct OutArguments {
    /// Folder for the results [default: out/<command>-<name of scene, trial or input>]. It is new, or empty, or holds an earlier run of
    /// the same command on the same name, which is replaced. Calibrations are kept beside it, in calibration-cache.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace a run of another command or scene in that folder. Files that are not of sartorius are never replaced.
    #[arg(long)]
    force: bool,
}

impl OutArguments {
    /// Reserves the folder for a run of `command` on the scene or trial `name`. Nothing in it changes yet.
    fn claim(&self, command: &str, name: &str) -> Result<Claim, CommandError> {
        let default = || Path::new("out").join(format!("{command}-{name}"));
        let folder = self.out.clone().unwrap_or_else(default);
        Ok(interrupt::watched(|| Claim::new(&folder, Identity::new(command, name), self.force))?)
    }
}

/// What a person should know of the trial, also where nothing else is said.
fn tell(doubts: &[String]) {
    for doubt in doubts {
        coupling::say!("note: {doubt}");
    }
}

/// Refuses an `--only` that names what there is not, all of it. The last argument: what it is not, and the words before those that there are.
fn known_names<'a>(
    only: &[String],
    known: impl Iterator<Item = &'a str> + Clone,
    [what, they_are]: [&str; 2],
) -> Result<(), CommandError> {
    let strange = only.iter().filter(|name| !known.clone().any(|n| n == *name));
    let told = strange.map(|name| {
        format!("--only names `{name}`, which is no {what}; {}", unknown(name, they_are, known.clone()))
    });
    let told: Vec<String> = told.collect();
    match told.is_empty() {
        true => Ok(()),
        false => Err(CommandError::Option(told.join("\n"))),
    }
}

#[derive(Parser)]
#[command(name = "sartorius", version = version(), about, long_about = None)]
#[command(about = "Rigid lower limb and deformable thigh: gait steps, muscle forces, contact")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Threads to use (default: all cores). Results do not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// End when standard input closes: for processes that start this one.
    #[arg(long, global = true, hide = true)]
    with_parent: bool,
    /// No progress on standard error; warnings and errors stay.
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    /// From markers and ground reaction to muscle forces, activations and joint contact forces.
    Optimize(optimize::OptimizeArguments),
    /// Hexahedral meshes of the muscles from cross-sections, kept apart from each other and from the bones.
    Mesh(mesh::MeshArguments),
    /// Heel strike and loading response on the deformable thigh beside the rigid leg, without and with contact.
    Compare(compare::CompareArguments),
    /// One scene in one configuration: with contact where the scene has contact.
    Step(step::StepArguments),
    /// What accuracy costs in time: a ladder of settings, how far each is from the finest, and how sure every force is.
    Cost(cost::CostArguments),
    /// Many runs: subjects by settings by samples; one table, bands, and what the numbers follow.
    Study(study::StudyArguments),
    /// Bodies of your own: mesh, laws, ties, contact and a table that drives them; fields, forces and a verdict.
    Solve(solve::SolveArguments),
    /// What a scene would simulate, what it leaves out and why, and what it would cost.
    Plan(plan::PlanArguments),
    /// One side of a scene as a co-simulation unit (FMI 3.0), to be coupled in FMPy and other masters.
    ExportFmu(export_fmu::ExportArguments),
    /// Scenes and trials that the program carries; or the text of one of them.
    Scenes(scenes::ScenesArguments),
    /// Writes a trial file for a recording, or a scene, with every key and its meaning.
    Template(template::TemplateArguments),
    /// Is this input file good; what is wrong, where, and how to mend it.
    Check(check::CheckArguments),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    // What the solver does, iteration by iteration, for `RUST_LOG=fem=debug`.
    let asked = std::env::var("RUST_LOG").unwrap_or("error".into());
    let targets = asked.parse::<Targets>();
    let shown = targets.as_ref().map_or(Targets::new().with_default(LevelFilter::ERROR), Targets::clone);
    let layer = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    tracing_subscriber::registry().with(shown).with(layer).init();
    if let Err(error) = targets {
        tracing::error!("RUST_LOG is `{asked}`: {error}; it is taken as `error`");
    }
    ExitCode::from(run(std::env::args_os()))
}

/// Runs a command line, the name of the program first; returns the exit code. May be called any number of times in a process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            // Help and version are no errors; everything else is bad input.
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    if let Some(threads) = arguments.threads {
        // Fails only where a pool exists already, which nothing before this line makes.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    if arguments.with_parent {
        interrupt::end_with_parent();
    }
    let quiet = arguments.quiet;
    let result: Result<Outcome, CommandError> = match arguments.command {
        Command::Optimize(arguments) => optimize::run(&arguments, quiet),
        Command::Mesh(arguments) => mesh::run(&arguments, quiet),
        Command::Compare(arguments) => compare::run(&arguments, quiet),
        Command::Step(arguments) => step::run(&arguments, quiet),
        Command::Cost(arguments) if arguments.ladder.as_os_str() == deep_cost::NAME => {
            deep_cost::run(&arguments, quiet)
        }
        Command::Cost(arguments) => cost::run(&arguments, quiet),
        Command::Solve(arguments) => solve::run(&arguments, quiet),
        Command::Study(arguments) => study::run(&arguments, quiet),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::ExportFmu(arguments) => export_fmu::run(&arguments, quiet),
        Command::Scenes(arguments) => scenes::run(&arguments),
        Command::Template(arguments) => template::run(&arguments),
        Command::Check(arguments) => Ok(check::run(&arguments)),
    };
    match result {
        Ok(Outcome::Solved) => 0,
        Ok(Outcome::BadInput) => 2,
        Ok(Outcome::NotSolved) => 3,
        Err(error) => {
            coupling::say!("error: {error}");
            error.exit_code()
        }
    }
}
