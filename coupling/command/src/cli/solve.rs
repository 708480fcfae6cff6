//! `sartorius solve SCENE`: bodies of one's own.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use fem::output::run_to_files;

use super::progress::Progress;
use super::{OutArguments, Outcome, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::claim::OWN_FRAMES;
use crate::output::origin::{Again, InputFile};
use crate::output::run::RunRecord;
use crate::output::solve::write_solve;
use coupling::solve::OwnScene;

#[derive(Args)]
pub struct SolveArguments {
    /// Scene file (TOML) that names a mesh (.inp, .msh, .vtu) and a table that drives it (CSV); docs/solve.md has the sections and their keys.
    scene: PathBuf,
    #[command(flatten)]
    out: OutArguments,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &SolveArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let mut record = RunRecord::new("solve");
    let mut progress = Progress::new(&["read", "solve", "write"], quiet);
    let scene = OwnScene::read(&arguments.scene)?;
    for file in &scene.files {
        record.inputs.push(InputFile::of(file)?);
    }
    let claim = arguments.out.claim("solve", &scene.name)?;
    let folder = OutputFolder::begin(claim, false)?;
    let path = folder.path().to_path_buf();
    record.notes = scene.plan.warnings.iter().map(ToString::to_string).collect();
    progress.pause(|| tell(&record.notes));
    progress.lap("read");
    let [frames, name] = OWN_FRAMES;
    let into = path.join(frames);
    let mut solved = 0;
    let run = run_to_files(&scene.plan, &scene.drive, &scene.settings, None, &into, name, &mut |frame| {
        solved += 1;
        if !quiet {
            let (all, iterations) = (scene.drive.frames.len(), frame.count(|i| i.iterations));
            progress.pause(|| {
                coupling::say!("frame {solved} of {all}, at {} s: {iterations} iterations", frame.time)
            });
        }
    })
    .map_err(|error| CommandError::Option(error.to_string()))?;
    progress.lap("solve");
    record.seconds = progress.seconds().to_vec();
    record.iterations.insert("Newton".into(), run.iterations.len() as u64);
    record.again = Again::as_typed(&record.command_line);
    let iterations = run.iterations.len();
    let files = write_solve(folder, &scene, &run, &mut record)?;
    progress.lap("write");
    drop(progress);
    for error in &run.errors {
        coupling::say!("not solved: {error}");
    }
    let (solved, asked) = (run.frames.len(), scene.drive.frames.len());
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = match arguments.json {
        true => writeln!(out, "{}", serde_json::to_string_pretty(&record).expect("plain data")),
        false => writeln!(
            out,
            "{solved} of {asked} frames solved, {iterations} iterations\n{} tables in {}; open {}/{name}.pvd in ParaView",
            files.len() - 1,
            path.display(),
            into.display()
        ),
    };
    Ok(if run.is_solved() { Outcome::Solved } else { Outcome::NotSolved })
}
