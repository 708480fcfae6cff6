//! A scene computed by a process of its own: its memory is its own, its end ends nothing else, and it does not outlive this one.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;
use sysinfo::System;

use crate::error::CommandError;
use crate::output::OutputError;
use crate::output::atomic::OutputFolder;
use crate::output::claim::RUN_FILE;
use crate::program;
use coupling::comparison::STAGES;
use coupling::cost::rung::Taken;

/// Folder of the rungs.
pub(super) const RUNGS: &str = "rungs";

/// What is to be computed.
pub(super) struct Rung<'a> {
    pub name: &'a str,
    /// All that its numbers hang on: what was computed under another text is of another program, scene or recording.
    pub text: &'a str,
    /// A scene that the program knows by this name; where there is none, the text is one.
    pub known: Option<&'a str>,
    /// Memory that it will take \[MiB\], where that is known.
    pub needed_mib: Option<f64>,
    pub data: Option<&'a Path>,
    pub resume: bool,
}

impl Rung<'_> {
    /// Computes it, or takes over what a run left that was killed: what it took and what `read` finds in its `run.json` and folder, or why it has
    /// no numbers. What cannot be read is not there.
    pub fn run<T>(
        &self,
        out: &mut OutputFolder,
        read: impl Fn(&Value, &Path) -> Option<T>,
    ) -> Result<Result<(Taken, T), String>, CommandError> {
        let folder = out.path().join(RUNGS).join(self.name);
        let name = format!("{RUNGS}/{}.toml", self.name);
        let file = out.path().join(&name);
        let is_same = fs::read_to_string(&file).is_ok_and(|text| text == self.text);
        if !(self.resume && is_same) {
            let old = folder.join(RUN_FILE);
            if old.exists() {
                fs::remove_file(&old).map_err(|e| OutputError::at("remove the old", &old, e))?;
            }
        }
        out.write(&name, |w| w.write_all(self.text.as_bytes()))?;
        if let Some(ending) = found(&folder, &read) {
            return Ok(ending);
        }
        if let Some((needed, free)) =
            self.needed_mib.zip(free_memory_mib()).filter(|(needed, free)| needed > free)
        {
            return Ok(Err(format!("not run: it needs about {needed:.0} MiB, {free:.0} MiB are free")));
        }
        // A knee is one way, which no killed run has left half of.
        let resume = self.resume && self.known.is_none();
        let scene = self.known.map_or(file, PathBuf::from);
        let output = step(&scene, &folder, self.data, resume)
            .map_err(|e| CommandError::Option(format!("cannot start a rung: {e}")))?;
        Ok(found(&folder, &read).unwrap_or_else(|| {
            let said = String::from_utf8_lossy(&output.stderr);
            Err(match output.status.code() {
                Some(_) => said.trim().trim_start_matches("error: ").to_string(),
                None => "it was killed, as systems do that run out of memory".into(),
            })
        }))
    }
}

/// What a complete folder of a rung says.
fn found<T>(folder: &Path, read: impl Fn(&Value, &Path) -> Option<T>) -> Option<Result<(Taken, T), String>> {
    let text = fs::read_to_string(folder.join(RUN_FILE)).ok()?;
    let run: Value = serde_json::from_str(&text).ok()?;
    Some(match run["status"] == "solved" {
        true => Ok((taken(&run)?, read(&run, folder)?)),
        false => Err(run["reason"].as_str().unwrap_or("not solved").to_string()),
    })
}

/// What a run took, as its `run.json` says.
fn taken(run: &Value) -> Option<Taken> {
    let stages: BTreeMap<String, f64> = serde_json::from_value(run["seconds"].clone()).ok()?;
    // Those of coarser meshes are named after it.
    let calibrations = stages.iter().filter(|(name, _)| name.starts_with(STAGES[2]));
    let calibration: f64 = calibrations.map(|(_, seconds)| seconds).sum();
    let count = |key: &str| run["size"][key].as_u64().unwrap_or(0) as usize;
    Some(Taken {
        elements: count("elements"),
        unknowns: count("unknowns"),
        seconds: stages.values().sum::<f64>() - calibration,
        calibration_seconds: calibration,
        peak_mib: run["peak_memory_mib"].as_f64(),
        stages,
    })
}

/// Memory that programs can have \[MiB\]; `None` where the system does not tell.
fn free_memory_mib() -> Option<f64> {
    let mut system = System::new();
    system.refresh_memory();
    Some(system.available_memory()).filter(|bytes| *bytes > 0).map(|bytes| bytes as f64 / f64::from(1 << 20))
}

/// Carries out `step` for a scene file, with the threads of this process. `resume`: goes on with what a killed run left in `out`.
pub(super) fn step(scene: &Path, out: &Path, data: Option<&Path>, resume: bool) -> io::Result<Output> {
    let mut command = program::command()?;
    let threads = rayon::current_num_threads().to_string();
    command.args(["--quiet", "--with-parent", "--threads", &threads, "step"]).arg(scene);
    command.arg("--out").arg(out).arg("--force");
    if let Some(data) = data {
        command.arg("--data").arg(data);
    }
    if resume {
        command.arg("--resume");
    }
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    // The pipe stays open as long as this process lives and the child runs: what waits for it must not close it before.
    let open = child.stdin.take();
    let output = child.wait_with_output();
    drop(open);
    output
}
