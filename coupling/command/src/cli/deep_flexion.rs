//! `sartorius step deep_flexion`: the knee of a folder of data bent to 137.5 degrees, its patella free.

use std::io::Write;
use std::path::Path;

use super::progress::Progress;
use super::{Outcome, RunArguments, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::deep_flexion::{Results, write_deep_flexion};
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus};
use coupling::knee::deep::{DeepFlexion, deviations};
use coupling::knee::flexion::{Bent, flex};
use fem::scene::ContactMode;
use fem::solve::Settings;

/// Name of the scene.
pub const NAME: &str = "deep_flexion";
/// What it is.
pub const WHAT: &str = "A knee bent to 137.5 degrees, its patella free under the force of the quadriceps.";
/// Force \[N\] of the quadriceps on the way to deep flexion, and where poses were measured without load.
const QUADRICEPS: [f64; 2] = [200.0, 50.0];

/// Whether a person means this scene, and no file.
pub fn is_meant(scene: &Path) -> bool {
    scene.as_os_str() == NAME
}

/// Runs the command.
pub fn run(arguments: &RunArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let data = arguments.data.as_deref().ok_or_else(|| {
        CommandError::Option(format!("`{NAME}` needs surfaces of a knee; name their folder with --data"))
    })?;
    if arguments.resume {
        return Err(CommandError::Option(format!("`{NAME}` takes seconds; run it without --resume")));
    }
    let mut record = RunRecord::new("step");
    let mut progress = Progress::new(&["read", "knee", "bend", "write"], quiet);
    let scene = DeepFlexion::find(data)?;
    for file in &scene.files {
        record.inputs.push(InputFile::of(file)?);
    }
    progress.lap("read");
    let knee = scene.knee(ContactMode::Cheap)?;
    scene.check_poses(&knee)?;
    let claim = arguments.out.claim("step", NAME)?;
    let folder = OutputFolder::begin(claim, false)?;
    let path = folder.path().to_path_buf();
    progress.lap("knee");
    let settings = Settings::default();
    let deep = flex(knee, &scene.poses(0.0), QUADRICEPS[0], &settings);
    let rows: Vec<_> = scene.measured.iter().map(|row| row[0]).collect();
    let unloaded = flex(scene.knee(ContactMode::Cheap)?, &rows, QUADRICEPS[1], &settings);
    progress.lap("bend");
    record.notes = notes(&deep);
    progress.pause(|| tell(&record.notes));
    record.reason = [&deep, &unloaded].into_iter().find_map(Bent::stopped_told);
    if record.reason.is_some() {
        record.status = RunStatus::NotConverged;
    }
    record.seconds = progress.seconds().to_vec();
    record.iterations.insert("Newton".into(), deep.run.iterations.len() as u64);
    record.again = Again::as_typed(&record.command_line);
    let against = unloaded.stopped.is_none().then(|| deviations(&unloaded.frames, &scene.measured));
    let results = Results { scene: &scene, deep: &deep, unloaded: &unloaded, against, forces: QUADRICEPS };
    write_deep_flexion(folder, &results, &mut record)?;
    progress.lap("write");
    drop(progress);
    if let Some(reason) = &record.reason {
        coupling::say!("not solved: {reason}");
    }
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = match arguments.json {
        true => writeln!(out, "{}", serde_json::to_string_pretty(&record).expect("plain data")),
        false => writeln!(
            out,
            "{} of {} frames solved; open {}/report.html",
            deep.frames.len(),
            scene.poses(0.0).len(),
            path.display()
        ),
    };
    Ok(if record.reason.is_none() { Outcome::Solved } else { Outcome::NotSolved })
}

/// What a person should know of the knee.
fn notes(deep: &Bent) -> Vec<String> {
    let stretched = deep.stretched().into_iter().map(|(name, strain, flexion)| {
        format!(
            "strand {name} is stretched by {:.0} % at {flexion:.1} degrees; no ligament bears that",
            100.0 * strain
        )
    });
    stretched.collect()
}
