//! `sartorius export-fmu SCENE`: one side of a scene as a co-simulation unit (FMI 3.0).

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use sartorius_fmi::description::Description;
use sartorius_fmi::error::UnitError;
use sartorius_fmi::export::{find_library, unit};
use sartorius_fmi::model::Model;
use sartorius_fmi::resources::{Which, collect};
use sartorius_fmi::thigh::Extras;
use sartorius_fmi::variable::Causality;

use super::progress::Progress;
use super::scenes::{read_scene, scenes};
use super::{Outcome, tell};
use crate::error::CommandError;
use coupling::comparison::{Prepared, STAGES, Sized};
use coupling::configuration::Configuration;
use coupling::error::CouplingError;
use coupling::fibres::WrittenCalibration;
use coupling::scene::Fibres;
use coupling::session::{RigidSide, ThighSide};

#[derive(Args)]
pub struct ExportArguments {
    #[arg(help = scenes())]
    scene: PathBuf,
    /// Which side the unit is.
    #[arg(long, value_enum)]
    side: SideChoice,
    /// Thigh: whether its bodies take notice of each other [default: with, where the scene has contact].
    #[arg(long, value_enum)]
    contact: Option<ContactChoice>,
    /// Thigh: what it says beyond the rest; computed when it is read.
    #[arg(long, value_enum, value_delimiter = ',')]
    also: Vec<Extra>,
    /// Folder of the recordings and surfaces that the scene names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// The unit [default: out/<scene>-<side>.fmu]. Calibrations are kept beside it, in calibration-cache.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum SideChoice {
    /// Time in; poses, forces, activations, lever arms out.
    Rigid,
    /// Poses and activations in; forces, lever arms, wrenches out.
    Thigh,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ContactChoice {
    /// They press on each other.
    With,
    /// They go through each other.
    Without,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Extra {
    /// Displacement of every node.
    Displacements,
    /// Stiffness of the tissue against every bone, `BONE.dwrench_dtwist`.
    Stiffness,
}

/// Runs the command.
pub fn run(arguments: &ExportArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let data = arguments.data.as_deref();
    let scene = read_scene(&arguments.scene, data)?;
    let is_thigh = arguments.side == SideChoice::Thigh;
    let configuration = match arguments.contact {
        Some(_) if !is_thigh => return Err(said("--contact is for --side thigh; the rigid leg has none")),
        Some(ContactChoice::With) if scene.contact.is_none() => {
            return Err(said(&format!("--contact: the scene `{}` has none; choose without", scene.name)));
        }
        Some(ContactChoice::Without) => Configuration::WithoutContact,
        _ if is_thigh && scene.contact.is_some() => Configuration::WithContact,
        _ => Configuration::WithoutContact,
    };
    if !is_thigh && !arguments.also.is_empty() {
        return Err(said("--also is for --side thigh"));
    }
    if is_thigh && !scene.deformable {
        return Err(said(&format!("the scene `{}` has no muscles that deform, and so no thigh", scene.name)));
    }
    if let Some(unit) = &scene.controller {
        return Err(said(&format!(
            "the scene `{}` names a controller, {}, which a master couples by itself; take controller out of the scene",
            scene.name,
            unit.display()
        )));
    }
    let has = |extra: Extra| arguments.also.contains(&extra);
    let extras = Extras { displacements: has(Extra::Displacements), stiffness: has(Extra::Stiffness) };
    // Before anything is computed.
    let library = find_library().map_err(bad)?;
    let side = if is_thigh { "thigh" } else { "rigid" };
    let default = || Path::new("out").join(format!("{}-{side}.fmu", scene.name));
    let file = arguments.out.clone().unwrap_or_else(default);

    let name = scene.name.clone();
    let needs_mesh = is_thigh || (scene.deformable && scene.fibres == Fibres::Thermal);
    let stages: &[&str] =
        if needs_mesh { &[STAGES[0], STAGES[1], STAGES[2], "write"] } else { &[STAGES[0], "write"] };
    let mut progress = Progress::new(stages, quiet);
    let again = scene.clone();
    let sized = Sized::new(scene, data)?;
    progress.lap(STAGES[0]);
    progress.pause(|| tell(sized.doubts()));
    let (which, model, written) = if needs_mesh {
        let prepared = Prepared::of(sized, &mut |stage| progress.lap(stage))?;
        let thigh = ThighSide::new(prepared, configuration, None, &file)?;
        progress.lap(STAGES[2]);
        let written = thigh.calibration().written();
        match is_thigh {
            true => (Which::Thigh, Model::Thigh(Arc::new(thigh), extras), written),
            false => {
                let rigid = RigidSide::new(Sized::new(again.clone(), data)?, written.clone())?;
                (Which::Rigid, Model::Rigid(Arc::new(rigid)), written)
            }
        }
    } else {
        let written = WrittenCalibration::default();
        (Which::Rigid, Model::Rigid(Arc::new(RigidSide::new(sized, written.clone())?)), written)
    };
    let sized = Sized::new(again, data)?;
    let resources = collect(which, &sized, configuration, extras, &written, data).map_err(bad)?;
    let contact = if is_thigh { format!(", {}", configuration.name()) } else { String::new() };
    let what = format!(
        "{side} side of the scene {name}{contact}: {}",
        coupling::subject::words(&sized.case().trial)
    );
    let unit_name = format!("{name}-{side}");
    let description = Description { name: &unit_name, description: &what, token: &resources.token };
    let io = |e: std::io::Error, path: &Path| said(&format!("{}: {e}", path.display()));
    let library_bytes = std::fs::read(&library).map_err(|e| io(e, &library))?;
    let bytes = unit(&description, &model, &library_bytes, &resources).map_err(bad)?;
    let folder = file.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| io(e, folder))?;
    // Under a name of its own first, so that it appears whole or not at all.
    let mut partial = tempfile::NamedTempFile::new_in(folder).map_err(|e| io(e, folder))?;
    partial.write_all(&bytes).map_err(|e| io(e, &file))?;
    partial.persist(&file).map_err(|e| io(e.error, &file))?;
    progress.lap("write");
    drop(progress);
    let variables = model.side().variables().clone();
    let count = |c: Causality| variables.iter().filter(|v| v.causality == c).count();
    let (inputs, outputs) = (count(Causality::Input), count(Causality::Output));
    let mib = bytes.len() as f64 / 1048576.0;
    // A reader that closes the pipe early is no error.
    let _ = writeln!(
        std::io::stdout(),
        "{what}\n{inputs} inputs, {outputs} outputs\n{}, {mib:.1} MiB",
        file.display()
    );
    Ok(Outcome::Solved)
}

fn said(words: &str) -> CommandError {
    CommandError::Option(words.into())
}

fn bad(error: UnitError) -> CommandError {
    match error {
        UnitError::Wrong(words) => CommandError::Option(words),
        UnitError::NoSolution(words) => CommandError::Coupling(CouplingError::NotConverged(words)),
    }
}
