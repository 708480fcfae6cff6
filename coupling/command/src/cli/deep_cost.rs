//! `sartorius cost deep_flexion`: the knees of `step` beside each other, how far each is from the most detailed one, and what it took.

use std::io::Write;

use multibody::error::unknown;

use super::Outcome;
use super::cost::CostArguments;
use super::deep_flexion::KNEES;
use super::progress::Progress;
use super::rung::Rung;
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::deep_flexion::Read;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus, peak_memory_mib};
use crate::report::deep_cost::{Ending, Rungs, write_cost};
use coupling::fibres::cache::program_hash;
use coupling::knee::deep::DeepFlexion;

/// What a person calls them all.
pub(super) const NAME: &str = "deep_flexion";

/// Runs the command.
pub(super) fn run(arguments: &CostArguments, quiet: bool) -> Result<Outcome, CommandError> {
    if arguments.scene.is_some() {
        return Err(CommandError::Option(format!("`cost {NAME}` bends knees; run it without --scene")));
    }
    let known = || KNEES.iter().map(|knee| knee.name);
    if let Some(name) = arguments.only.iter().find(|name| !known().any(|n| n == *name)) {
        return Err(CommandError::Option(format!(
            "--only names `{name}`, which is no knee; {}",
            unknown(name, "they are", known())
        )));
    }
    let chosen: Vec<&str> = known()
        .filter(|name| arguments.only.is_empty() || arguments.only.iter().any(|n| n == name))
        .collect();
    let mut record = RunRecord::new("cost");
    let scene = match arguments.data.as_deref() {
        Some(data) => DeepFlexion::find(data)?,
        None => DeepFlexion::made()?,
    };
    for file in &scene.files {
        record.inputs.push(InputFile::of(file)?);
    }
    let files: String = record.inputs.iter().map(|file| file.sha256.as_str()).collect();
    let claim = arguments.out.claim("cost", NAME)?;
    let folder = claim.path();
    let mut progress = Progress::new(&chosen, quiet);
    let mut out = OutputFolder::begin(claim, arguments.resume)?;
    let mut endings = Vec::new();
    for name in chosen {
        let text = format!("# {name} of `cost {NAME}`; {}\n", program_hash(&format!("{name}{files}")));
        let rung = Rung {
            name,
            text: &text,
            known: Some(name),
            needed_mib: None,
            data: arguments.data.as_deref(),
            resume: arguments.resume,
        };
        let run = rung.run(&mut out)?;
        let solved = run.and_then(|run| Ok((run, Read::of(&rung.folder(&out))?)));
        endings.push(Ending { name, solved });
        progress.lap(name);
    }
    record.seconds = progress.seconds().to_vec();
    drop(progress);

    let rungs = Rungs::new(endings);
    out.write("cost.csv", |w| write_cost(w, &rungs))?;
    if let Some(picture) = rungs.picture() {
        out.write("cost.svg", |w| w.write_all(picture.as_bytes()))?;
    }
    out.write("report.html", |w| w.write_all(rungs.page().as_bytes()))?;
    record.reason = rungs.missing();
    if record.reason.is_some() {
        record.status = RunStatus::NotConverged;
    }
    record.again = Again::as_typed(&record.command_line);
    record.verdict = Some(rungs.verdict());
    record.peak_memory_mib = peak_memory_mib();
    record.files = out.files().to_vec();
    out.finish(&record)?;
    let mut terminal = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = match arguments.json {
        true => writeln!(terminal, "{}", serde_json::to_string_pretty(&record.verdict).expect("plain data")),
        false => rungs
            .print(&mut terminal)
            .and_then(|()| writeln!(terminal, "files in {}, open report.html there", folder.display())),
    };
    Ok(if record.reason.is_none() { Outcome::Solved } else { Outcome::NotSolved })
}
