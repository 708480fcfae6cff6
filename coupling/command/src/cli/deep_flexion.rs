//! `sartorius step deep_flexion`: a made knee, or that of a folder of data, bent to 137.5 degrees, its patella free.

use std::io::Write;
use std::path::Path;

use super::progress::Progress;
use super::{Outcome, RunArguments, tell};
use crate::error::CommandError;
use crate::output::atomic::OutputFolder;
use crate::output::deep_flexion::{Results, write_deep_flexion};
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus};
use coupling::knee::deep::{DEEPEST, DeepFlexion, KneeFiles, deviations};
use coupling::knee::flexion::{Bent, FlexionFrame, flex, flex_told};
use coupling::knee::muscles::Resolution;
use coupling::knee::rigid::Quadriceps;
use fem::plan::Warning;
use fem::scene::ContactMode;
use fem::solve::Settings;

/// A knee that can be bent.
pub struct Knee {
    /// Name of the scene.
    pub name: &'static str,
    /// What it is.
    pub what: &'static str,
    /// Forces \[N\] of the quadriceps on the way to deep flexion and along the poses that were measured without load, or its muscles.
    quadriceps: Pull,
    /// Flexion \[degrees\] of its first frame.
    first: f64,
}

enum Pull {
    Forces([f64; 2], ContactMode),
    Tissue(Resolution),
}

/// All of them, from the least to the most detailed one. With muscles the way begins where that of the study does.
pub static KNEES: [Knee; 5] = [
    Knee {
        name: "deep_flexion",
        what: "A knee bent to 137.5 degrees, its patella free under the force of the quadriceps.",
        quadriceps: Pull::Forces([200.0, 50.0], ContactMode::Cheap),
        first: 0.0,
    },
    Knee {
        name: "deep_flexion_guarded",
        what: "The same in guarded contact.",
        quadriceps: Pull::Forces([200.0, 50.0], ContactMode::Guarded),
        first: 0.0,
    },
    Knee {
        name: "deep_flexion_embedded",
        what: "A knee bent from 25 to 137.5 degrees, its quadriceps passive tissue, cells of 10 mm, the vasti in cubes of 20 mm.",
        quadriceps: Pull::Tissue(Resolution { edge: 10e-3, cell: Some(20e-3) }),
        first: 25.0,
    },
    Knee {
        name: "deep_flexion_coarse",
        what: "The same without cubes.",
        quadriceps: Pull::Tissue(Resolution { edge: 10e-3, cell: None }),
        first: 25.0,
    },
    Knee {
        name: "deep_flexion_full",
        what: "The same with cells of 4 mm.",
        quadriceps: Pull::Tissue(Resolution { edge: 4e-3, cell: None }),
        first: 25.0,
    },
];

/// The knee that a person means, and no file.
pub fn meant(scene: &Path) -> Option<&'static Knee> {
    KNEES.iter().find(|knee| scene.as_os_str() == knee.name)
}

/// Refuses a knee where a scene is wanted.
pub(super) fn refuse(scene: &Path) -> Result<(), CommandError> {
    let Some(Knee { name, .. }) = meant(scene) else { return Ok(()) };
    Err(CommandError::Option(format!(
        "`{name}` is a knee and no scene file: `sartorius step {name}` bends it, `sartorius cost deep_flexion` lays all knees beside each other"
    )))
}

/// The knee of a folder of data, or a made one; the record has its files.
pub(super) fn scene(data: Option<&Path>, record: &mut RunRecord) -> Result<DeepFlexion, CommandError> {
    let scene = match data {
        Some(data) => DeepFlexion::find(data)?,
        None => DeepFlexion::made()?,
    };
    for file in scene.files.iter().flat_map(KneeFiles::all) {
        record.inputs.push(InputFile::of(&file)?);
    }
    Ok(scene)
}

/// Runs the command.
pub fn run(meant: &Knee, arguments: &RunArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let name = meant.name;
    if arguments.resume {
        return Err(CommandError::Option(format!("`{name}` is one way; run it without --resume")));
    }
    let mut record = RunRecord::new("step");
    let mut progress = Progress::new(&["read", "knee", "bend", "measured", "write"], quiet);
    let scene = scene(arguments.data.as_deref(), &mut record)?;
    progress.lap("read");
    let build = || match meant.quadriceps {
        Pull::Forces(_, mode) => scene.knee(mode),
        Pull::Tissue(resolution) => scene.knee_with(ContactMode::Guarded, Quadriceps::Tissue(resolution)),
    };
    let forces = match meant.quadriceps {
        Pull::Forces(forces, _) => forces,
        Pull::Tissue(_) => [0.0; 2],
    };
    let (knee, short) = scene.checked(meant.first, &build)?;
    let claim = arguments.out.claim("step", name)?;
    let folder = OutputFolder::begin(claim, false)?;
    let path = folder.path().to_path_buf();
    progress.lap("knee");
    let settings = Settings::default();
    let (poses, rows) =
        (scene.poses(meant.first), scene.measured.rows.iter().map(|row| row[0]).collect::<Vec<_>>());
    // What takes minutes says how far it is.
    let mut said = |f: &FlexionFrame| match meant.quadriceps {
        Pull::Tissue(_) if !quiet => progress.pause(|| {
            coupling::say!("  {:.1} of {:.1} degrees, {} iterations", f.tibia.flexion, DEEPEST, f.iterations)
        }),
        _ => {}
    };
    let deep = flex_told(knee, &poses, forces[0], &settings, &mut said);
    progress.lap("bend");
    // A knee is bent once: its strings remember the way that they went.
    let unloaded = match rows.as_slice() {
        [] => None,
        rows => Some(flex(build()?, rows, forces[1], &settings)),
    };
    progress.lap("measured");
    let crossings = scene.crossings(&deep.patellas());
    let along_measured = |told: String| format!("along the measured poses: {told}");
    let stretched = unloaded.as_ref().map_or(Vec::new(), stretched);
    let measured = stretched.into_iter().map(along_measured);
    record.notes = short.into_iter().chain(notes(meant, &deep, &crossings)).chain(measured).collect();
    progress.pause(|| tell(&record.notes));
    let along = || unloaded.as_ref().and_then(Bent::stopped_told).map(along_measured);
    record.reason = deep.stopped_told().or_else(along);
    if record.reason.is_some() {
        record.status = RunStatus::NotConverged;
    }
    record.seconds = progress.seconds().to_vec();
    record.iterations.insert("Newton".into(), deep.run.iterations.len() as u64);
    record.again = Again::as_typed(&record.command_line);
    let all_of = unloaded.as_ref().filter(|bent| bent.stopped.is_none());
    let against = all_of.map(|bent| deviations(&bent.frames, &scene.measured));
    let n_poses = poses.len();
    let results = Results {
        scene: &scene,
        deep: &deep,
        crossings,
        unloaded: unloaded.as_ref(),
        against,
        forces,
        n_poses,
    };
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
            "{} of {n_poses} frames solved; open {}/report.html",
            deep.frames.len(),
            path.display()
        ),
    };
    Ok(if record.reason.is_none() { Outcome::Solved } else { Outcome::NotSolved })
}

/// Strands that are stretched beyond what ligaments bear, in words.
fn stretched(bent: &Bent) -> Vec<String> {
    let told = |(name, strain, flexion): (&str, f64, f64)| {
        format!(
            "strand {name} is stretched by {:.0} % at {flexion:.1} degrees; no ligament bears that",
            100.0 * strain
        )
    };
    bent.stretched().into_iter().map(told).collect()
}

/// What a person should know of the knee.
fn notes(meant: &Knee, deep: &Bent, crossings: &[usize]) -> Vec<String> {
    // Of the plan only what hangs on data: cubes that hold two pieces of a muscle.
    let divided = deep.knee.plan.warnings.iter().filter(|w| matches!(w, Warning::Divided { .. }));
    let is_cheap = matches!(meant.quadriceps, Pull::Forces(_, ContactMode::Cheap));
    let through = deep.frames.iter().zip(crossings).filter(|(_, n)| **n > 0 && !is_cheap).map(|(f, n)| {
        format!("at {:.1} degrees {n} pairs of triangles of the cartilages intersect", f.tibia.flexion)
    });
    let crossed = deep.frames.iter().filter_map(|f| {
        let [heads, femur] = f.muscles?.crossings;
        let told = format!(
            "at {:.1} degrees {heads} pairs of triangles of two heads intersect, and {femur} of a head and the femur",
            f.tibia.flexion
        );
        (heads + femur > 0).then_some(told)
    });
    let drawn_out = deep.drawn_out().map(|(name, times, flexion)| {
        format!(
            "a cell of {} is drawn out to {times:.1} times its length at {flexion:.1} degrees; no muscle bears that, and it is passive tissue without fibres here",
            name.replace('_', " ")
        )
    });
    divided
        .map(ToString::to_string)
        .chain(stretched(deep))
        .chain(drawn_out)
        .chain(crossed)
        .chain(through)
        .collect()
}
