//! `sartorius cost deep_flexion`: the knees of `step` beside each other, how far each is from the most detailed one, and what it took.

use std::io::Write;
use std::path::Path;

use super::cost::CostArguments;
use super::deep_flexion::{KNEES, scene};
use super::progress::Progress;
use super::rung::Rung;
use super::{Outcome, known_names};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::deep_flexion::Read;
use crate::output::origin::Again;
use crate::output::run::{RunRecord, RunStatus, peak_memory_mib};
use crate::report::deep_cost::{Ending, Rungs, write_cost};
use coupling::fibres::cache::program_hash;

/// What a person calls them all.
pub(super) const NAME: &str = "deep_flexion";

/// Runs the command.
pub(super) fn run(arguments: &CostArguments, quiet: bool) -> Result<Outcome, CommandError> {
    if arguments.scene.is_some() {
        return Err(CommandError::Option(format!("`cost {NAME}` bends knees; run it without --scene")));
    }
    let known = KNEES.iter().map(|knee| knee.name);
    known_names(&arguments.only, known.clone(), ["knee", "they are"])?;
    let chosen: Vec<&str> =
        known.filter(|name| arguments.only.is_empty() || arguments.only.iter().any(|n| n == name)).collect();
    let mut record = RunRecord::new("cost");
    scene(arguments.data.as_deref(), &mut record)?;
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
        let read = |run: &serde_json::Value, folder: &Path| {
            Some((run["verdict"]["nrmsd_sum"].as_f64(), Read::of(folder).ok()?))
        };
        endings.push(Ending { name, solved: rung.run(&mut out, read)? });
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
