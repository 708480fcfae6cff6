//! The command line. Exit codes: 0 solved, 2 bad input, 3 not converged or a verdict failed; nothing else.

mod check;
mod compare;
mod mesh;
mod optimize;
mod plan;
mod progress;
mod step;
mod template;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::error::CommandError;
use crate::output::origin::version;

/// How a command ended when it did run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything solved.
    Solved,
    /// Results were written, but a verdict failed.
    NotSolved,
}

/// What the commands that carry out a scene have in common.
#[derive(Args)]
struct RunArguments {
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the results [default: out/<command>-<scene>]; calibrations are kept beside it, in calibration-cache.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on with a run of the same scene that was killed: its solved frames are taken over, the results are the same to the last bit.
    #[arg(long)]
    resume: bool,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

impl RunArguments {
    /// Folder for the results of `command` on a scene.
    fn folder(&self, command: &str, scene: &str) -> PathBuf {
        self.out.clone().unwrap_or_else(|| Path::new("out").join(format!("{command}-{scene}")))
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
    /// What a scene would simulate, what it leaves out and why, and what it would cost.
    Plan(plan::PlanArguments),
    /// Writes a trial file for a recording, or a scene, with every key and its meaning.
    Template(template::TemplateArguments),
    /// Is this input file good; what is wrong, where, and how to mend it.
    Check(check::CheckArguments),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version are no errors; everything else is bad input.
            let code = if error.use_stderr() { 2 } else { 0 };
            let _ = error.print();
            return ExitCode::from(code);
        }
    };
    if let Some(threads) = arguments.threads {
        // Fails only where a pool exists already, which nothing before this line makes.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    // What the solver does, iteration by iteration, for `RUST_LOG=fem=debug`.
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_writer(std::io::stderr)
        .init();
    let result: Result<Outcome, CommandError> = match arguments.command {
        Command::Optimize(arguments) => optimize::run(&arguments),
        Command::Mesh(arguments) => mesh::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Step(arguments) => step::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Template(arguments) => template::run(&arguments),
        Command::Check(arguments) => Ok(check::run(&arguments)),
    };
    match result {
        Ok(Outcome::Solved) => ExitCode::SUCCESS,
        Ok(Outcome::NotSolved) => ExitCode::from(3),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
