//! A scene carried out: the rigid leg, the mesh, the fibres, and the steps in each configuration.

#![allow(non_snake_case)]

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use fem::mesh::Mesh;
use fem::output::Restart;
use fem::plan::Plan;
use fem::run::{Drive, Frame};
use fem::solve::{Settings, Stability};

use crate::cache::{Cache, content_hash};
use crate::compare::{Configuration, beside, configuration, drive};
use crate::error::CommandError;
use crate::explain;
use crate::fibres::{Calibration, DrivenFibres, driven_fibres};
use crate::fixed_point::Scheme;
use crate::muscle_unit::Fit;
use crate::optimize::{OptimizeOptions, Optimized, optimize};
use crate::registration::{MeshFrames, Registration};
use crate::scene::{Fibres, Scene};
use crate::steps::{RigidStep, rigid_step};
use crate::subject::{factors, limb_map};
use crate::thigh::build::{Thigh, ThighEffects, ThighMuscle};
use crate::thigh::lines::lines_of_muscles;
use crate::thigh::{BuiltIn, from_limb, from_surfaces, limb};
use crate::two_way::{Pass, TwoWay};

/// Newton's method ends where the residual is below 1e-4 of the forces in play, which count at least 1000 N, or where the
/// [scene](Scene::residuals) says: forces of single muscles are compared in newtons, and 0.1 N is a tenth of that. A muscle that hangs slack has next to no force, and would take hundreds of
/// iterations to find out exactly how it hangs.
pub const SETTINGS: Settings = Settings {
    tolerance: 1e-4,
    least_force: 1000.0,
    max_iterations: 400,
    first_step: 1.0,
    least_step: 1e-4,
    double_precision_factor: false,
    stability: Stability::Never,
};

/// Folders of the configurations without and with contact.
pub const FOLDERS: [&str; 2] = ["no_contact", "contact"];
/// Stages of a study, in their order.
pub const STAGES: [&str; 5] = ["rigid leg", "mesh", "calibration", "without contact", "with contact"];

/// A scene with everything but the solution.
pub struct Prepared {
    /// The scene.
    pub scene: Scene,
    /// The rigid leg.
    pub done: Optimized,
    /// Where the bones of the mesh are.
    pub registration: Registration,
    /// What the rigid leg says of the steps.
    pub steps: Vec<RigidStep>,
    /// Mesh and bones; `None` for the rigid leg alone.
    pub made: Option<BuiltIn>,
    /// The thigh; of the rigid leg alone just the names of its muscles.
    pub thigh: Thigh,
    /// Files that were read.
    pub inputs: Vec<PathBuf>,
}

/// What came of a scene.
pub struct Study {
    /// The thigh with its fibres.
    pub thigh: Thigh,
    /// How its fibres were calibrated.
    pub calibration: Calibration,
    /// Per step the control of every muscle.
    pub controls: Vec<Vec<f64>>,
    /// Without and with contact, where asked for.
    pub configurations: [Option<(Plan, Configuration)>; 2],
}

impl Prepared {
    /// Computes the rigid leg and meshes the thigh. `data`: folder of recordings and surfaces; `lap` is called as each stage ends.
    pub fn new(
        scene: Scene,
        data: Option<&Path>,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Prepared, CommandError> {
        let options = OptimizeOptions {
            trial: scene.trial.clone(),
            data: data.map(Path::to_path_buf),
            ..OptimizeOptions::default()
        };
        let done = optimize(&options)?;
        let mut inputs = done.case.inputs.clone();
        // Surfaces of one's own are taken as they are.
        let sizes = scene.surfaces.is_none().then(|| factors(&done.model));
        let frames = MeshFrames::built_in().sized(sizes.map_or(1.0, |s| s.thigh));
        let registration = Registration::new(frames, &done.model).ok_or_else(|| {
            CommandError::Option("the patella of the rigid leg finds no place at full extension".into())
        })?;
        let mut steps = Vec::new();
        for spec in &scene.steps {
            let mut step = rigid_step(&done, &registration, spec.name).map_err(CommandError::NotConverged)?;
            if let Some(flexion) = spec.knee_flexion {
                let Q = &done.motion.Q[done.motion.report.start + step.row];
                step.poses = registration.poses_at_flexion(&done.model, Q, flexion).ok_or_else(|| {
                    let degrees = flexion.to_degrees();
                    CommandError::Option(format!(
                        "the knee of the rigid leg cannot be flexed by {degrees:.1} degrees"
                    ))
                })?;
                step.knee_flexion = flexion;
            }
            steps.push(step);
        }
        lap(STAGES[0]);
        let effects = ThighEffects { fibres: scene.fibres != Fibres::None, shells: scene.shells };
        let mut made = match (&scene.surfaces, scene.deformable) {
            (_, false) => None,
            (None, true) => {
                let limb = match &sizes {
                    Some(sizes) => limb()?.mapped(&limb_map(sizes))?,
                    None => limb()?,
                };
                Some(from_limb(limb, scene.resolution, scene.draw_in, &scene.muscles, effects)?)
            }
            (Some(folder), true) => {
                let bones = folder.join("..").join("bones");
                let (made, files) =
                    from_surfaces(folder, &bones, scene.resolution, scene.draw_in, &scene.muscles, effects)?;
                inputs.extend(files);
                Some(made)
            }
        };
        if let Some(made) = &mut made {
            scene.materials.apply(&mut made.thigh).map_err(CommandError::Option)?;
            lap(STAGES[1]);
        }
        let thigh = made.as_ref().map_or_else(names_only, |m| m.thigh.clone());
        Ok(Prepared { scene, done, registration, steps, made, thigh, inputs })
    }

    /// Elements of the muscles.
    pub fn n_elements(&self) -> usize {
        self.thigh.mesh.blocks.iter().filter(|b| b.kind.is_solid()).map(|b| b.n_cells()).sum()
    }

    /// Height of the section through the middle of the thigh \[m\].
    pub fn mid_thigh(&self) -> f64 {
        let frames = self.registration.frames();
        0.5 * (frames.hip.y + frames.knee.y)
    }

    /// Compiles the thigh with (1) or without contact (0).
    pub fn plan(&self, thigh: &Thigh, configuration: usize) -> Result<Plan, CommandError> {
        let Thigh { scene, mesh, .. } = self.configured(thigh, configuration);
        Plan::new(&scene, mesh).map_err(|e| CommandError::Option(e.to_string()))
    }

    /// The thigh with (1) or without contact (0).
    fn configured(&self, thigh: &Thigh, configuration: usize) -> Thigh {
        let mut thigh = thigh.clone();
        if let (1, Some(made), Some(mode)) = (configuration, &self.made, self.scene.contact) {
            thigh.add_contact(&made.bones, &made.attachments);
            thigh.scene.contact.as_mut().expect("just added").mode = mode;
        }
        thigh
    }

    /// Calibrates the fibres and solves the steps without and with contact, as `asked` says; frames go to the [`FOLDERS`] in `folder`.
    /// Calibrations are kept in the [`Cache`] beside it.
    /// `resume`: solved frames of a killed run of the same scene are taken over. `lap` is called as each stage ends.
    pub fn solve(
        &self,
        asked: [bool; 2],
        folder: &Path,
        resume: bool,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Study, CommandError> {
        let thigh = self.thigh.clone();
        let mut study = Study {
            thigh,
            calibration: Calibration::None,
            controls: Vec::new(),
            configurations: [None, None],
        };
        if self.made.is_none() {
            return Ok(study);
        }
        let DrivenFibres { thigh, calibration, controls } = driven_fibres(
            &self.thigh,
            &self.done.model,
            &self.registration,
            &self.steps,
            self.scene.stress_free,
            self.scene.fibres,
            &SETTINGS,
            Some(&Cache::beside(folder)),
        )?;
        (study.thigh, study.calibration, study.controls) = (thigh, calibration, controls);
        if self.scene.fibres != Fibres::None {
            lap(STAGES[2]);
        }
        let (thigh, steps) = (&study.thigh, &self.steps);
        for c in (0..2).filter(|c| asked[*c]) {
            let plan = self.plan(thigh, c)?;
            let way = drive(&plan, thigh, &study.controls, steps, self.scene.stress_free)?;
            let settings = Settings { tolerance: self.scene.residuals[c] / SETTINGS.least_force, ..SETTINGS };
            let key = run_key(&self.configured(thigh, c).scene, &plan, &way, &settings);
            let restart = Restart { key: &key, resume };
            let folder = folder.join(FOLDERS[c]);
            let bones = self.made.as_ref().map_or(&[][..], |made| &made.bones);
            let beside = beside(&way, steps, self.scene.stress_free, bones);
            let done =
                configuration(&plan, thigh, &way, steps, &settings, &folder, &beside, restart, &mut |_| ())?;
            lap(STAGES[3 + c]);
            study.configurations[c] = Some((plan, done));
        }
        Ok(study)
    }

    /// Two-way coupling from the one-way result without contact, `most` passes at most. Needs Hill fibres and all steps solved.
    pub fn two_way(&self, study: &Study, scheme: Scheme, most: usize) -> Result<Vec<Pass>, CommandError> {
        let (Calibration::Hill { muscles, units, scale }, Some((plan, alone))) =
            (&study.calibration, &study.configurations[0])
        else {
            let why = "two-way coupling needs Hill fibres and the configuration without contact";
            return Err(CommandError::Option(why.into()));
        };
        let first: Vec<&Frame> = alone.at_steps().collect();
        if first.len() < self.steps.len() {
            return Err(CommandError::NotConverged("two-way coupling needs all steps solved one-way".into()));
        }
        let way = drive(plan, &study.thigh, &study.controls, &self.steps, self.scene.stress_free)?;
        let fits: Vec<Fit> = muscles.iter().map(|m| m.fit).collect();
        let two_way = TwoWay {
            done: &self.done,
            registration: &self.registration,
            steps: &self.steps,
            thigh: &study.thigh,
            plan,
            drive: &way,
            units,
            fits: &fits,
            scale: *scale,
            settings: &SETTINGS,
        };
        two_way.passes(&first, scheme, most)
    }
}

impl Study {
    /// `explanation.csv`: a row per step, configuration and muscle.
    pub fn write_explanations(&self, w: &mut dyn Write, steps: &[RigidStep]) -> io::Result<()> {
        writeln!(w, "{}", explain::COLUMNS)?;
        for (plan, result) in self.configurations.iter().flatten() {
            let name = if plan.islands.iter().any(|i| i.contact.is_some()) { FOLDERS[1] } else { FOLDERS[0] };
            for (step, frame) in steps.iter().zip(result.at_steps()) {
                let rows = explain::explain(plan, &self.thigh, &self.calibration, step, frame);
                explain::write_rows(w, step.name.name(), name, &rows)?;
            }
        }
        Ok(())
    }
}

/// Hash of all that a run depends on: mesh, effects, loads, settings, and the program itself.
fn run_key(scene: &fem::scene::Scene, plan: &Plan, drive: &Drive, settings: &Settings) -> String {
    content_hash(&plan.mesh, &format!("{scene:?}{drive:?}{settings:?}"))
}

/// The muscles of the rigid leg that the thigh would have, without mesh.
fn names_only() -> Thigh {
    let muscle = |name: String| ThighMuscle {
        name,
        line: Vec::new(),
        s: Vec::new(),
        areas: Vec::new(),
        fibre_area: 0.0,
        fibre_length: 0.0,
        first_node: 0,
        nodes_per_layer: 0,
        tied: Default::default(),
    };
    Thigh {
        mesh: Mesh::default(),
        scene: Default::default(),
        muscles: lines_of_muscles().into_keys().map(muscle).collect(),
        tendons: Vec::new(),
    }
}
