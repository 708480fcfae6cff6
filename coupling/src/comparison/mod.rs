//! A scene carried out: the rigid leg, the mesh, the fibres, and the steps in each configuration.

#![allow(non_snake_case)]

pub mod compare;
pub mod estimate;
pub mod explain;
pub mod quantities;
pub mod speed;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use fem::mesh::Mesh;
use fem::nested::{CoarseRun, run_led};
use fem::output::{Restart, run_restartable, write_run};
use fem::plan::Plan;
use fem::run::{Drive, Frame, Run};
use fem::solve::{Iteration, Method, Settings, Stability, Way};
use mesher::limb::Limb;

use crate::comparison::compare::{CompareError, Solution, StepForces, beside, drive, measured};
use crate::configuration::{Configuration, PerConfiguration};
use crate::error::CouplingError;
use crate::fibres::cache::{Cache, content_hash};
use crate::fibres::muscle_unit::{Fit, MOST_ACTIVE};
use crate::fibres::{Calibration, DrivenFibres, FibreCalibration, FibreTask};
use crate::number::short;
use crate::optimize::{OptimizeOptions, Optimized, optimize};
use crate::scene::{Fibres, Scene};
use crate::steps::{RigidStep, rigid_step};
use crate::subject::{factors, limb_map};
use crate::thigh::build::{Thigh, ThighEffects, ThighMuscle};
use crate::thigh::lines::lines_of_muscles;
use crate::thigh::registration::{MeshFrames, Registration};
use crate::thigh::{BuiltIn, draft, from_limb, limb, limb_of_surfaces};
use crate::two_way::capacity::sewn;
use crate::two_way::fixed_point::Scheme;
use crate::two_way::{Coupled, Coupling, TwoWay};

/// Newton's method ends where the residual is below 1e-4 of the forces in play, which count at least 1000 N, or where the
/// [scene](Scene::residuals) says: forces of single muscles are compared in newtons, and 0.1 N is a tenth of that. A muscle that hangs slack has next to no force, and would take hundreds of
/// iterations to find out exactly how it hangs.
pub const SETTINGS: Settings = Settings {
    method: Method::Newton,
    tolerance: 1e-4,
    least_force: 1000.0,
    max_iterations: 400,
    max_work: 5000,
    max_steps: 100_000,
    time_step_factor: 1.0,
    damping: 0.0,
    first_step: 1.0,
    least_step: 1e-4,
    double_precision_factor: false,
    stability: Stability::Never,
    way: Way::Guided,
};

/// Folder of the frames of the one-way result, where there is a two-way one.
pub const ONE_WAY_FOLDER: &str = "one_way";
/// Stages, in their order.
pub const STAGES: [&str; 5] = [
    "rigid leg",
    "mesh",
    "calibration",
    Configuration::WithoutContact.name(),
    Configuration::WithContact.name(),
];

/// Names of the stages of a [coarser mesh](Scene::coarser) with edges of this length \[m\] in a configuration: it is made, and calibrated where
/// there are fibres; it is solved.
pub fn coarse_stages(configuration: Configuration, edge: f64) -> [String; 2] {
    let (name, edge) = (configuration.name(), short(1e3 * edge));
    [format!("{}, {edge} mm, {name}", STAGES[2]), format!("{name}, {edge} mm")]
}

/// A scene with everything but the solution.
pub struct Prepared {
    /// The scene.
    pub scene: Scene,
    /// The rigid leg.
    pub done: Arc<Optimized>,
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
    /// What it was meshed from, for other meshes; only where those are asked for.
    sized: Option<Sized>,
    /// Per step the isometric activation of every muscle, as the controller of the scene says.
    controlled: Option<Vec<Vec<f64>>>,
}

/// A scene that can be solved: nothing is wrong with it.
pub struct Ready {
    /// The thigh with its fibres.
    pub thigh: Thigh,
    /// How its fibres were calibrated.
    pub calibration: Calibration,
    /// Per step the control of every muscle.
    pub controls: Vec<Vec<f64>>,
    /// Those asked for.
    plans: PerConfiguration<Option<Plan>>,
}

/// What came of a scene: the thigh beside the rigid leg.
pub struct Comparison {
    /// The thigh with its fibres.
    pub thigh: Thigh,
    /// How its fibres were calibrated.
    pub calibration: Calibration,
    /// Per step the control of every muscle.
    pub controls: Vec<Vec<f64>>,
    /// What the rigid leg says of the steps; after two-way coupling the forces of its last pass.
    pub steps: Vec<RigidStep>,
    /// Those asked for; after two-way coupling that of its last pass.
    pub solutions: PerConfiguration<Option<Solution>>,
    /// What stood there before two-way coupling.
    pub one_way: Option<OneWay>,
    /// Coarser meshes that did not show the way to the end, and why.
    pub not_led: Vec<String>,
}

/// What the coarser meshes of a configuration came to.
#[derive(Default)]
struct Coarser {
    /// The last that was solved: it leads.
    last: Option<(Plan, Run)>,
    /// What went wrong, a sentence each.
    wrong: Vec<String>,
}

/// The one-way result beside a two-way one.
pub struct OneWay {
    /// Which configuration was coupled.
    pub configuration: Configuration,
    /// What the rigid leg says of the steps.
    pub steps: Vec<RigidStep>,
    /// The thigh: what was solved in it.
    pub run: Run,
    /// Forces at the steps that were solved.
    pub forces: Vec<StepForces>,
}

/// A scene with the rigid leg, before its mesh.
pub struct Sized {
    /// The scene.
    pub scene: Scene,
    pub(crate) done: Arc<Optimized>,
    pub(crate) registration: Registration,
    pub(crate) steps: Vec<RigidStep>,
    /// Muscles and bones in the size of the subject; `None` for the rigid leg alone.
    pub(crate) limb: Option<Limb>,
    inputs: Vec<PathBuf>,
}

impl Sized {
    /// Computes the rigid leg and reads the thigh. `data`: folder of recordings and surfaces.
    pub fn new(scene: Scene, data: Option<&Path>) -> Result<Sized, CouplingError> {
        let data = data.map(Path::to_path_buf);
        Sized::with(scene, OptimizeOptions { data, ..OptimizeOptions::default() })
    }

    /// The same with options of the rigid leg; the trial is that of the scene.
    pub fn with(scene: Scene, options: OptimizeOptions) -> Result<Sized, CouplingError> {
        let done = optimize(&OptimizeOptions { trial: scene.trial.clone(), ..options })?;
        let mut inputs = done.case.inputs.clone();
        // Surfaces of one's own are taken as they are.
        let sizes = scene.surfaces.is_none().then(|| factors(&done.model));
        let frames = MeshFrames::built_in().sized(sizes.map_or(1.0, |s| s.thigh));
        let registration = Registration::new(frames, &done.model).ok_or_else(|| {
            CouplingError::Option("the patella of the rigid leg finds no place at full extension".into())
        })?;
        let mut steps = Vec::new();
        for spec in &scene.steps {
            let mut step =
                rigid_step(&done, &registration, spec.name).map_err(CouplingError::NotConverged)?;
            if let Some(flexion) = spec.knee_flexion {
                let Q = &done.motion.Q[done.motion.report.start + step.row];
                step.poses = registration.poses_at_flexion(&done.model, Q, flexion).ok_or_else(|| {
                    let degrees = flexion.to_degrees();
                    CouplingError::Option(format!(
                        "the knee of the rigid leg cannot be flexed by {degrees:.1} degrees"
                    ))
                })?;
                step.knee_flexion = flexion;
            }
            steps.push(step);
        }
        let limb = match (&scene.surfaces, scene.deformable) {
            (_, false) => None,
            (None, true) => Some(match &sizes {
                Some(sizes) => limb()?.mapped(&limb_map(sizes))?,
                None => limb()?,
            }),
            (Some(folder), true) => {
                let (limb, files) =
                    limb_of_surfaces(folder, &folder.join("..").join("bones"), &scene.muscles)?;
                inputs.extend(files);
                Some(limb)
            }
        };
        Ok(Sized { scene, done: Arc::new(done), registration, steps, limb, inputs })
    }

    /// Files that were read.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    /// The trial as it was read.
    pub fn case(&self) -> &crate::optimize::Case {
        &self.done.case
    }

    /// What the trial file says that rarely is so, or is left out of account.
    pub fn doubts(&self) -> &[String] {
        &self.done.case.doubts
    }

    /// The same with edges of this length \[m\].
    pub(crate) fn at(&self, edge: f64) -> Sized {
        let scene = Scene { resolution: edge, ..self.scene.clone() };
        let (done, registration) = (self.done.clone(), self.registration.clone());
        let (steps, limb) = (self.steps.clone(), self.limb.clone());
        Sized { scene, done, registration, steps, limb, inputs: Vec::new() }
    }

    /// The thigh before its mesh is made, to be counted; without muscles where the rigid leg is alone.
    pub fn draft(&self) -> Result<Thigh, CouplingError> {
        let Some(limb) = &self.limb else { return Ok(names_only()) };
        let Scene { resolution, inset, muscles, .. } = &self.scene;
        let mut thigh = draft(limb.clone(), *resolution, *inset, muscles, effects(&self.scene))?;
        self.scene.materials.apply(&mut thigh).map_err(CouplingError::Option)?;
        self.scene.fidelity.apply(&mut thigh)?;
        Ok(thigh)
    }
}

fn effects(scene: &Scene) -> ThighEffects {
    ThighEffects {
        fibres: (scene.fibres != Fibres::None).then_some(scene.fibre_spacing),
        shells: scene.shells,
    }
}

impl Prepared {
    /// Computes the rigid leg and meshes the thigh. `data`: folder of recordings and surfaces; `lap` is called as each stage ends.
    pub fn new(
        scene: Scene,
        data: Option<&Path>,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Prepared, CouplingError> {
        let sized = Sized::new(scene, data)?;
        lap(STAGES[0]);
        Prepared::of(sized, lap)
    }

    /// Meshes the thigh. `lap` is called as that ends.
    pub fn of(sized: Sized, lap: &mut dyn FnMut(&str)) -> Result<Prepared, CouplingError> {
        let is_led = |c: Configuration| !sized.scene.coarser(c).is_empty();
        let kept = Configuration::ALL.into_iter().any(is_led).then(|| sized.at(sized.scene.resolution));
        let Sized { scene, done, registration, steps, limb, inputs } = sized;
        let mut made = limb
            .map(|limb| from_limb(limb, scene.resolution, scene.inset, &scene.muscles, effects(&scene)))
            .transpose()?;
        if let Some(made) = &mut made {
            scene.materials.apply(&mut made.thigh).map_err(CouplingError::Option)?;
            scene.fidelity.apply(&mut made.thigh)?;
            lap(STAGES[1]);
        }
        let thigh = made.as_ref().map_or_else(names_only, |m| m.thigh.clone());
        Ok(Prepared { scene, done, registration, steps, made, thigh, inputs, sized: kept, controlled: None })
    }

    /// Takes over what the [controller](Scene::controller) of the scene says: per step the isometric activation of every muscle of the thigh.
    pub fn control(&mut self, activations: Vec<Vec<f64>>) -> Result<(), CouplingError> {
        let mut wrong = Vec::new();
        for (step, of_step) in self.steps.iter_mut().zip(&activations) {
            for (muscle, a) in self.thigh.muscles.iter().zip(of_step) {
                if !(0.0..=MOST_ACTIVE).contains(a) {
                    wrong.push(format!("{} at {} is {a}", muscle.name, step.name.name()));
                }
                let lines =
                    step.muscles.iter_mut().filter(|m| m.name == muscle.name).flat_map(|m| &mut m.lines);
                lines.for_each(|line| line.activation = *a);
            }
        }
        if !wrong.is_empty() {
            let words = format!(
                "activations of the controller: {}; must be from 0 to {MOST_ACTIVE}",
                wrong.join(", ")
            );
            return Err(CouplingError::Option(words));
        }
        self.controlled = Some(activations);
        Ok(())
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

    /// Compiles the thigh.
    pub fn plan(&self, thigh: &Thigh, configuration: Configuration) -> Result<Plan, CouplingError> {
        let Thigh { scene, mesh, .. } = self.configured(thigh, configuration);
        Plan::new(&scene, mesh).map_err(|e| CouplingError::Option(e.to_string()))
    }

    /// The thigh, in contact where that is asked for.
    fn configured(&self, thigh: &Thigh, configuration: Configuration) -> Thigh {
        let mut thigh = thigh.clone();
        if let (Configuration::WithContact, Some(made), Some(mode)) =
            (configuration, &self.made, self.scene.contact)
        {
            thigh.add_contact(&made.bones, &made.attachments);
            let contact = thigh.scene.contact.as_mut().expect("just added");
            (contact.mode, contact.distance) = (mode, self.scene.contact_distance);
        }
        thigh
    }

    /// Its fibres, to be made ready.
    pub fn fibres(&self) -> FibreTask<'_> {
        FibreTask {
            thigh: &self.thigh,
            model: &self.done.model,
            registration: &self.registration,
            steps: &self.steps,
            stress_free: self.scene.stress_free,
            kind: self.scene.fibres,
            check: self.scene.check_calibration,
        }
    }

    /// Calibrates the fibres and compiles the configurations that are `asked` for. What is wrong with the
    /// scene shows here. Calibrations are kept in the [`Cache`] beside `folder`. `lap` is called as the stage ends.
    pub fn calibrate(
        &self,
        asked: PerConfiguration<bool>,
        folder: &Path,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Ready, CouplingError> {
        let thigh = self.thigh.clone();
        let calibration = Calibration::default();
        let mut ready =
            Ready { thigh, calibration, controls: Vec::new(), plans: PerConfiguration::default() };
        if self.made.is_none() {
            return Ok(ready);
        }
        let cache = Cache::beside(folder);
        let DrivenFibres { thigh, calibration, controls } =
            self.fibres().calibrate(&SETTINGS, Some(&cache))?;
        let controls = match (&self.scene.controller, &self.controlled) {
            (None, _) => controls,
            (Some(_), Some(activations)) => activations.clone(),
            (Some(unit), None) => {
                let words = format!("the controller {} has not said how hard muscles pull", unit.display());
                return Err(CouplingError::Option(words));
            }
        };
        (ready.thigh, ready.calibration, ready.controls) = (thigh, calibration, controls);
        if self.scene.fibres != Fibres::None {
            lap(STAGES[2]);
        }
        for c in Configuration::ALL.into_iter().filter(|c| asked[*c]) {
            ready.plans[c] = Some(self.plan(&ready.thigh, c)?);
        }
        Ok(ready)
    }

    /// [`Prepared::calibrate`] and [`Prepared::solve_ready`].
    pub fn solve(
        &self,
        asked: PerConfiguration<bool>,
        folder: &Path,
        resume: bool,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Comparison, CouplingError> {
        self.solve_ready(self.calibrate(asked, folder, lap)?, folder, resume, lap)
    }

    /// Solves the steps in every configuration; frames go to its [folder](Configuration::folder) in `folder`.
    /// `resume`: solved frames of a killed run of the same scene are taken over. `lap` is called as each stage ends.
    pub fn solve_ready(
        &self,
        ready: Ready,
        folder: &Path,
        resume: bool,
        lap: &mut dyn FnMut(&str),
    ) -> Result<Comparison, CouplingError> {
        let Ready { thigh, calibration, controls, plans } = ready;
        let mut comparison = Comparison {
            thigh,
            calibration,
            controls,
            steps: self.steps.clone(),
            solutions: PerConfiguration::default(),
            one_way: None,
            not_led: Vec::new(),
        };
        let PerConfiguration { without, with } = plans;
        for (c, plan) in Configuration::ALL.into_iter().zip([without, with]) {
            let Some(plan) = plan else { continue };
            let thigh = &comparison.thigh;
            let way = drive(&plan, thigh, &comparison.controls, &self.steps, self.scene.stress_free)?;
            let settings = settings_of(&self.scene, c);
            let coarser = self.scene.coarser(c);
            let key = run_key(&self.configured(thigh, c).scene, &plan, &way, &settings, &coarser);
            let restart = Restart { key: &key, resume };
            let Coarser { last, wrong } = self.coarser(c, folder, lap);
            comparison.not_led.extend(wrong);
            let led = last.as_ref().map(|(coarse, run)| CoarseRun::new(coarse, &run.frames, &plan));
            let led = led.as_ref();
            let folder = folder.join(c.folder());
            let bones = self.made.as_ref().map_or(&[][..], |made| &made.bones);
            let beside = beside(&way, &self.steps, self.scene.stress_free, bones);
            let clock = Instant::now();
            let run =
                run_restartable(&plan, &way, &settings, &folder, "thigh", &beside, restart, led, &mut |_| ())
                    .map_err(CompareError::from)?;
            let passive = way.frames.len() - self.steps.len();
            let done = measured(plan, thigh, run, &self.steps, passive, clock.elapsed());
            lap(c.name());
            comparison.solutions[c] = Some(done);
        }
        Ok(comparison)
    }

    /// The steps on the [coarser meshes](Scene::coarser), each of which is led by the one before; one that cannot be solved leads nowhere, and
    /// the others do. They are not written; a run that is resumed solves them again. Calibrations are kept beside `folder`. `lap` is called
    /// as each [stage](coarse_stages) ends.
    fn coarser(&self, configuration: Configuration, folder: &Path, lap: &mut dyn FnMut(&str)) -> Coarser {
        let mut all = Coarser::default();
        for edge in self.scene.coarser(configuration) {
            let [_, stage] = coarse_stages(configuration, edge);
            let error = match self.solve_coarse(configuration, edge, all.last.as_ref(), folder, lap) {
                Ok((plan, run)) => {
                    let error = run.errors.first().map(ToString::to_string);
                    all.last = Some((plan, run));
                    error
                }
                Err(error) => Some(error.to_string()),
            };
            lap(&stage);
            if let Some(error) = error {
                let sentence = format!("{stage}: {error}; from there on this mesh shows no way");
                crate::say!("note: {sentence}");
                all.wrong.push(sentence);
            }
        }
        all
    }

    /// The steps on a mesh with edges of `edge` \[m\], led by one that was solved before.
    fn solve_coarse(
        &self,
        configuration: Configuration,
        edge: f64,
        before: Option<&(Plan, Run)>,
        folder: &Path,
        lap: &mut dyn FnMut(&str),
    ) -> Result<(Plan, Run), CouplingError> {
        let sized = self.sized.as_ref().expect("kept where there are coarser meshes").at(edge);
        let mut coarse = Prepared::of(sized, &mut |_| ())?;
        coarse.controlled.clone_from(&self.controlled);
        coarse.steps.clone_from(&self.steps);
        let asked = PerConfiguration::of(|c| c == configuration);
        let ready = coarse.calibrate(asked, folder, &mut |_| lap(&coarse_stages(configuration, edge)[0]));
        let Ready { thigh, controls, mut plans, .. } = ready?;
        let plan = plans[configuration].take().expect("asked for");
        let way = drive(&plan, &thigh, &controls, &self.steps, self.scene.stress_free)?;
        let led = before.map(|(coarse, run)| CoarseRun::new(coarse, &run.frames, &plan));
        let run = run_led(&plan, &way, &settings_of(&coarse.scene, configuration), led.as_ref());
        Ok((plan, run))
    }

    /// Two-way coupling from the one-way result in a configuration, `most` passes at most. Needs Hill fibres and all steps solved.
    pub fn two_way(
        &self,
        comparison: &Comparison,
        configuration: Configuration,
        scheme: Scheme,
        most: usize,
    ) -> Result<Coupling, CouplingError> {
        let (FibreCalibration::Hill { muscles, units, scale }, Some(solution)) =
            (&comparison.calibration.fibres, &comparison.solutions[configuration])
        else {
            let why =
                format!("two-way coupling needs Hill fibres and the one-way result {}", configuration.name());
            return Err(CouplingError::Option(why));
        };
        let first: Vec<&Frame> = solution.at_steps().collect();
        if first.len() < self.steps.len() {
            return Err(CouplingError::NotConverged(
                "two-way coupling needs all steps solved one-way".into(),
            ));
        }
        let plan = &solution.plan;
        let way = drive(plan, &comparison.thigh, &comparison.controls, &self.steps, self.scene.stress_free)?;
        let fits: Vec<Fit> = muscles.iter().map(|m| m.fit).collect();
        let two_way = TwoWay {
            done: &self.done,
            registration: &self.registration,
            steps: &self.steps,
            thigh: &comparison.thigh,
            plan,
            sewn: &self.sewn(&comparison.thigh, plan, configuration)?,
            drive: &way,
            units,
            fits: &fits,
            scale: *scale,
            settings: &settings_of(&self.scene, configuration),
        };
        two_way.passes(&first, scheme, most)
    }

    /// Muscles that are sewn together, by number; `plan` is that of the configuration.
    pub fn sewn(
        &self,
        thigh: &Thigh,
        plan: &Plan,
        configuration: Configuration,
    ) -> Result<Vec<Vec<usize>>, CouplingError> {
        match configuration {
            Configuration::WithoutContact => Ok(sewn(plan, thigh)),
            // In contact all are in one island.
            Configuration::WithContact => Ok(sewn(&self.plan(thigh, Configuration::WithoutContact)?, thigh)),
        }
    }

    /// Makes the last pass of two-way coupling the result, with the one-way result [beside it](Comparison::one_way); its frames go
    /// to the folder of the configuration, those of the one-way result to [`ONE_WAY_FOLDER`]. `took`: the wall time of the passes.
    pub fn adopt(
        &self,
        comparison: &mut Comparison,
        configuration: Configuration,
        last: &[Coupled],
        took: Duration,
        folder: &Path,
    ) -> Result<(), CouplingError> {
        let one_way = comparison.solutions[configuration].take().expect("the passes began from it");
        let Solution { plan, run: before, steps: forces, on_the_way, .. } = one_way;
        let way = drive(&plan, &comparison.thigh, &comparison.controls, &self.steps, self.scene.stress_free)?;
        let mut run = Run {
            frames: before.frames[..on_the_way].to_vec(),
            iterations: before.iterations.iter().filter(|row| row.step < on_the_way).cloned().collect(),
            ..Run::default()
        };
        for (k, coupled) in last.iter().enumerate() {
            run.frames.push(coupled.frame.clone());
            run.iterations.extend(
                coupled.iterations.iter().cloned().map(|row| Iteration { step: on_the_way + k, ..row }),
            );
        }
        let bones = self.made.as_ref().map_or(&[][..], |made| &made.bones);
        let beside = beside(&way, &self.steps, self.scene.stress_free, bones);
        let write = |run: &Run, name: &str| write_run(&plan, &way, run, &folder.join(name), "thigh", &beside);
        write(&before, ONE_WAY_FOLDER)
            .and_then(|()| write(&run, configuration.folder()))
            .map_err(CompareError::from)?;
        let steps: Vec<RigidStep> = self
            .steps
            .iter()
            .zip(last)
            .map(|(step, coupled)| self.coupled_step(&comparison.thigh, step, coupled))
            .collect();
        comparison.solutions[configuration] =
            Some(measured(plan, &comparison.thigh, run, &steps, on_the_way, took));
        let steps = std::mem::replace(&mut comparison.steps, steps);
        comparison.one_way = Some(OneWay { configuration, steps, run: before, forces });
        Ok(())
    }

    /// A step with the forces that force sharing wants of the coupled thigh, and the activations that drive it.
    fn coupled_step(&self, thigh: &Thigh, step: &RigidStep, coupled: &Coupled) -> RigidStep {
        let mut step = step.clone();
        for muscle in &mut step.muscles {
            let meshed = thigh.muscles.iter().position(|m| m.name == muscle.name);
            for line in &mut muscle.lines {
                let i =
                    self.done.model.muscles.iter().position(|m| m.name == line.name).expect("tables agree");
                (line.force, line.hill_force) = (coupled.tensions[i], coupled.tensions[i]);
                if let Some(m) = meshed {
                    line.activation = coupled.drives[m];
                }
            }
        }
        step
    }
}

impl Comparison {
    /// Why it is not solved; empty where every step of every configuration is.
    pub fn shortcomings(&self) -> Vec<String> {
        let mut reasons: Vec<String> = Vec::new();
        let n_steps = self.steps.len();
        for (c, result) in self.solutions.present() {
            let which = c.name();
            reasons.extend(result.run.errors.iter().map(|e| format!("{which}: {e}")));
            if result.steps.len() < n_steps && result.run.errors.is_empty() {
                reasons.push(format!("{which}: {} of {} steps", result.steps.len(), n_steps));
            }
            if c == Configuration::WithContact {
                reasons.extend(result.intersections.iter().map(|i| format!("{which}: {i} intersect")));
            }
        }
        reasons
    }

    /// `explanation.csv`: a row per step, configuration and muscle.
    pub fn write_explanations(&self, w: &mut dyn Write) -> io::Result<()> {
        writeln!(w, "{}", explain::COLUMNS)?;
        for (configuration, result) in self.solutions.present() {
            for (step, frame) in self.steps.iter().zip(result.at_steps()) {
                let rows = explain::explain(&result.plan, &self.thigh, &self.calibration, step, frame);
                explain::write_rows(w, step.name.name(), configuration.folder(), &rows)?;
            }
        }
        Ok(())
    }
}

/// How the steps of a scene are solved.
pub fn settings_of(scene: &Scene, configuration: Configuration) -> Settings {
    let tolerance = scene.residuals[configuration] / SETTINGS.least_force;
    let Scene { method, max_steps, .. } = *scene;
    let mut settings = Settings { tolerance, method, max_steps, ..SETTINGS };
    if let Some(steps) = scene.strict_steps {
        (settings.way, settings.first_step) = (Way::Strict, 1.0 / steps as f64);
    }
    if scene.check_stability {
        settings.stability = Stability::Always;
    }
    settings
}

/// Hash of all that a run depends on: mesh, effects, loads, settings, and the program itself.
fn run_key(
    scene: &fem::scene::Scene,
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    coarser: &[f64],
) -> String {
    content_hash(&plan.mesh, &format!("{scene:?}{drive:?}{settings:?}{coarser:?}"))
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
