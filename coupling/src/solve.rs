//! Bodies of one's own: a scene of `fem` as a file beside its mesh and the table that drives it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use fem::drive::DriveError;
use fem::measure::Cut;
use fem::mesh::Mesh;
use fem::mesh::format::Format;
use fem::plan::{Motion, Plan};
use fem::run::{Drive, unsuited};
use fem::scene::{CutSpec, Scene};
use fem::solve::Settings;
use multibody::InputError;
use multibody::error::{Place, nearest};
use multibody::keys::line_of;

use crate::error::CouplingError;

/// A scene with everything but the solution.
pub struct OwnScene {
    /// Stem of the file.
    pub name: String,
    /// What is solved.
    pub plan: Plan,
    /// Its loads.
    pub drive: Drive,
    /// How it is solved.
    pub settings: Settings,
    /// What is cut.
    pub cuts: Vec<(String, Cut)>,
    /// Bodies with the nodes tied to them, and sets of nodes that are held or moved by displacements.
    pub supports: Vec<(String, Vec<u32>)>,
    /// The scene, its mesh and its drive.
    pub files: [PathBuf; 3],
}

impl OwnScene {
    /// Reads a scene with all that it names. Mistakes are named with file and place, those of a file all at once where it can be read at all.
    pub fn read(file: &Path) -> Result<OwnScene, CouplingError> {
        let text =
            std::fs::read_to_string(file).map_err(|source| InputError::Io { file: file.into(), source })?;
        let scene = parse(&text, file)?;
        let beside = |name: &Option<PathBuf>| file.with_file_name(name.clone().expect("looked for"));
        let files = [file.to_path_buf(), beside(&scene.mesh), beside(&scene.drive)];
        let plan = Plan::new(&scene, Mesh::read(&files[1], scene.mesh_unit)?)
            .map_err(|source| CouplingError::Plan { file: file.into(), source })?;
        let mistakes = wrong_cuts(&scene.cuts, &plan);
        if !mistakes.is_empty() {
            return Err(malformed(file, Place::Whole, mistakes.join("; "), "mend the [[cuts]]").into());
        }
        let mistakes = unsuited(&plan, &scene.solver.settings());
        if !mistakes.is_empty() {
            let remedy = "docs/explicit.md says which solver is for what";
            return Err(malformed(file, Place::Whole, mistakes.join("; "), remedy).into());
        }
        let mut drive = Drive::read(&files[2], &plan)?;
        if plan.inertia.is_some() && drive.frames[0].time <= 0.0 {
            let mistakes = vec![(
                2,
                format!("time_s is {}, must be above 0: inertia starts at rest there", drive.frames[0].time),
            )];
            return Err(DriveError::Mistakes { path: files[2].clone(), mistakes }.into());
        }
        if let Some(longest) = scene.solver.longest_step {
            drive = drive.refined(&plan, longest);
        }
        let tied = |(b, name): (usize, &String)| {
            let moves = |n: &u32| plan.motion[*n as usize][0] == Motion::Body(b);
            (name.clone(), (0..plan.motion.len() as u32).filter(moves).collect())
        };
        let mut supports: Vec<(String, Vec<u32>)> = plan.bodies.iter().enumerate().map(tied).collect();
        let sets = scene.prescribed.iter().map(|p| &p.nodes).chain(scene.rollers.iter().map(|r| &r.nodes));
        let sets: BTreeSet<&String> = sets.collect();
        supports.extend(sets.into_iter().map(|name| (name.clone(), plan.mesh.node_sets[name].clone())));
        let cut = |c: &CutSpec| {
            (c.name.clone(), Cut { point: c.point, normal: c.normal, effects: c.effects.clone() })
        };
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(OwnScene {
            name,
            drive,
            settings: scene.solver.settings(),
            cuts: scene.cuts.iter().map(cut).collect(),
            supports,
            files,
            plan,
        })
    }
}

fn malformed(file: &Path, at: Place, problem: String, remedy: &str) -> InputError {
    InputError::Malformed { file: file.into(), at, problem, remedy: remedy.into() }
}

fn parse(text: &str, file: &Path) -> Result<Scene, InputError> {
    let scene: Scene = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |s| line_of(text, s.start));
        malformed(
            file,
            Place::Line(line),
            error.message().replace('\n', ", "),
            "docs/solve.md has the sections and their keys",
        )
    })?;
    let mut mistakes = scene.solver.settings().mistakes();
    for (key, given, like) in [("mesh", &scene.mesh, "block.inp"), ("drive", &scene.drive, "drive.csv")] {
        let needed = format!("`{key} = \"{like}\"` names a file beside the scene");
        match given {
            None => mistakes.push(format!("`{key}` is missing: {needed}")),
            Some(name) if !file.with_file_name(name).is_file() => {
                mistakes.push(format!("{key} is `{}`, which is no file: {needed}", name.display()));
            }
            Some(_) => {}
        }
    }
    if let Some(mesh) = scene.mesh.as_ref().filter(|mesh| Format::of(mesh).is_none()) {
        mistakes.push(format!("mesh is `{}`, must end in .inp, .msh or .vtu", mesh.display()));
    }
    if let Some(longest) = scene.solver.longest_step.filter(|s| !(*s > 0.0 && s.is_finite())) {
        mistakes.push(format!("longest_step is {longest} s, must be a positive number"));
    }
    match mistakes.is_empty() {
        true => Ok(scene),
        false => Err(malformed(
            file,
            Place::Whole,
            mistakes.join("; "),
            "docs/solve.md has the sections and their keys",
        )),
    }
}

fn wrong_cuts(cuts: &[CutSpec], plan: &Plan) -> Vec<String> {
    let mut mistakes = Vec::new();
    for cut in cuts {
        let length = cut.normal.iter().map(|n| n * n).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite() && cut.point.iter().all(|p| p.is_finite())) {
            let (point, normal) = (cut.point, cut.normal);
            mistakes.push(format!("cut `{}`: point {point:?}, normal {normal:?} give no plane", cut.name));
        }
        for effect in &cut.effects {
            let known = || plan.effects.iter().map(|(name, _)| name.as_str());
            if !known().any(|name| name == effect) {
                let meant =
                    nearest(effect, known()).map_or(String::new(), |m| format!(", did you mean `{m}`?"));
                mistakes.push(format!("cut `{}`: nothing is called `{effect}`{meant}", cut.name));
            }
        }
    }
    let twice =
        |(i, cut): (usize, &CutSpec)| cuts[..i].iter().any(|c| c.name == cut.name).then(|| cut.name.clone());
    mistakes.extend(
        cuts.iter().enumerate().filter_map(twice).map(|name| format!("two cuts are called `{name}`")),
    );
    mistakes
}
