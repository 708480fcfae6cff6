//! The deformable thigh by itself.

use std::path::Path;
use std::sync::Arc;

use fem::measure::body_wrenches;
use fem::plan::{Load, Plan};
use fem::run::{Advanced, DriveFrame, Frame, Session};
use fem::solve::Settings;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::pose::{PoseNumbers, as_pose, numbers};
use super::{examined, state};
use crate::comparison::compare::{MuscleForce, has_passive_way, load, moves, muscle_force};
use crate::comparison::{Prepared, settings_of};
use crate::configuration::{Configuration, PerConfiguration};
use crate::error::CouplingError;
use crate::fibres::cache::lasting_hash;
use crate::fibres::muscle_unit::MOST_ACTIVE;
use crate::fibres::{Calibration, DrivenFibres, FibreCalibration, WrittenCalibration};
use crate::scene::Fibres;
use crate::thigh::build::Thigh;
use crate::thigh::registration::BODIES;
use crate::two_way::capacity::{BoneTwists, MOVED, VirtualTwists, actions, as_units};
use crate::two_way::{KNEE, seen_capacity};

/// A thigh that can be driven: all that never changes.
pub struct ThighSide {
    prepared: Prepared,
    thigh: Thigh,
    calibration: Calibration,
    plan: Plan,
    settings: Settings,
    /// Muscles that are sewn together.
    units: Vec<Vec<usize>>,
    key: String,
}

/// What is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Inputs {
    poses: [PoseNumbers; BODIES.len()],
    activations: Vec<f64>,
    twists: BoneTwists,
    knee_arms: Vec<f64>,
}

/// Where a session is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct State {
    time: f64,
    /// Equilibria so far; 0: the mesh as it was made.
    solved: usize,
    inputs: Inputs,
    controls: Vec<f64>,
    /// Per body of the plan.
    poses: Vec<PoseNumbers>,
    /// Positions of all nodes \[m\].
    x: Vec<f64>,
}

/// What a muscle does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MuscleResult {
    /// Force through the belly and its parts \[N\].
    pub section: MuscleForce,
    /// Force of matrix and shell together \[N\].
    pub tissue: f64,
    /// Mean length of the fibres over that in the mesh.
    pub stretch: f64,
    /// Change of length against the posture in which the fibres are as long as the lines of the rigid leg \[m\]; 0 without Hill fibres.
    pub elongation: f64,
    /// How much of the tension of the fibres comes through the belly; `None` where they hardly pull, and without Hill fibres.
    pub through_belly: Option<f64>,
    /// Moment per joint coordinate ([`COORDINATES`](crate::two_way::capacity::COORDINATES)) \[N·m\].
    pub moments: [f64; MOVED],
    /// Lever arms \[m\]; `None` where there is hardly any force to say them. Heads that are sewn together have that at the knee in common.
    pub lever_arms: [Option<f64>; MOVED],
}

/// What is measured on an equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct ThighResult {
    /// Per muscle.
    pub muscles: Vec<MuscleResult>,
    /// Force \[N\] and moment about the hip centre of the mesh \[N·m\] of the tissue on each bone.
    pub wrenches: [[f64; 6]; BODIES.len()],
}

impl ThighSide {
    /// The thigh of a scene in a configuration. `calibration`: what was written of it; computed where there is none, and kept in the
    /// [cache](crate::fibres::cache::Cache) beside `folder`.
    pub fn new(
        prepared: Prepared,
        configuration: Configuration,
        calibration: Option<WrittenCalibration>,
        folder: &Path,
    ) -> Result<ThighSide, CouplingError> {
        let scene = &prepared.scene;
        if prepared.made.is_none() {
            return Err(CouplingError::Option(format!(
                "the scene `{}` has no muscles that deform",
                scene.name
            )));
        }
        if configuration == Configuration::WithContact && scene.contact.is_none() {
            return Err(CouplingError::Option(format!("the scene `{}` has no contact", scene.name)));
        }
        let (thigh, calibration) = match calibration {
            Some(written) => {
                let fibres = prepared.fibres().as_written(written);
                let why = "the calibration that was written down is not one of these muscles";
                let DrivenFibres { thigh, calibration, .. } =
                    fibres.ok_or_else(|| CouplingError::Option(why.into()))??;
                (thigh, calibration)
            }
            None => {
                let ready = prepared.calibrate(PerConfiguration::default(), folder, &mut |_| ())?;
                (ready.thigh, ready.calibration)
            }
        };
        let plan = prepared.plan(&thigh, configuration)?;
        let units = prepared.sewn(&thigh, &plan, configuration)?;
        let settings = settings_of(scene, configuration);
        let key = lasting_hash(&plan.mesh, &format!("{:?}{settings:?}", thigh.scene));
        Ok(ThighSide { prepared, thigh, calibration, plan, settings, units, key })
    }

    /// What was found when the fibres were calibrated.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// The scene with its rigid leg.
    pub fn prepared(&self) -> &Prepared {
        &self.prepared
    }

    /// Mesh and muscles.
    pub fn thigh(&self) -> &Thigh {
        &self.thigh
    }

    /// Names of the muscles.
    pub fn muscles(&self) -> impl Iterator<Item = &str> {
        self.thigh.muscles.iter().map(|m| m.name.as_str())
    }

    /// Nodes of the mesh, those of bones in contact included.
    pub fn n_nodes(&self) -> usize {
        self.plan.mesh.points.len()
    }

    /// Activations that can be given: isometric ones of Hill fibres (lengthening fibres pull harder than isometric ones, so they go beyond 1),
    /// contractions of thermal ones; nothing but 0 without fibres.
    pub fn activation_range(&self) -> [f64; 2] {
        match self.prepared.scene.fibres {
            Fibres::Hill => [0.0, MOST_ACTIVE],
            // A fibre that contracts by all its length is gone.
            Fibres::Thermal => [0.0, 1.0_f64.next_down()],
            Fibres::None => [0.0, 0.0],
        }
    }

    /// Says which thigh a state is of.
    pub fn key(&self) -> &str {
        &self.key
    }
}

/// A thigh on its way.
pub struct ThighSession {
    side: Arc<ThighSide>,
    state: State,
    /// Of the present state and inputs; absent until asked for.
    result: Option<ThighResult>,
}

impl ThighSession {
    /// The mesh as it was made: bones in place, muscles at rest, at time 0.
    pub fn new(side: Arc<ThighSide>) -> ThighSession {
        let rest = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let n = side.thigh.muscles.len();
        let state = State {
            time: 0.0,
            solved: 0,
            inputs: Inputs {
                poses: [rest; BODIES.len()],
                activations: vec![0.0; n],
                twists: Default::default(),
                knee_arms: vec![0.0; n],
            },
            controls: vec![0.0; side.plan.controls.len()],
            poses: vec![rest; side.plan.bodies.len()],
            x: side.plan.reference(),
        };
        ThighSession { side, state, result: None }
    }

    /// What never changes.
    pub fn side(&self) -> &Arc<ThighSide> {
        &self.side
    }

    /// Time of the state \[s\].
    pub fn time(&self) -> f64 {
        self.state.time
    }

    /// Sets the time of the state \[s\]; an equilibrium does not hang on it.
    pub fn set_time(&mut self, time: f64) -> Result<(), CouplingError> {
        examined("time [s]", &[time], 1, [f64::NEG_INFINITY, f64::INFINITY])?;
        self.state.time = time;
        Ok(())
    }

    /// Poses of all bones from the next solution on.
    pub fn set_poses(&mut self, poses: &[PoseNumbers]) -> Result<(), CouplingError> {
        let poses: [PoseNumbers; BODIES.len()] = poses.try_into().map_err(|_| {
            CouplingError::Option(format!(
                "poses of {} bones, must be {} ({})",
                poses.len(),
                BODIES.len(),
                BODIES.join(", ")
            ))
        })?;
        let wrong: Vec<String> = BODIES
            .iter()
            .zip(&poses)
            .filter_map(|(body, pose)| as_pose(pose).err().map(|why| format!("pose of {body}: {why}")))
            .collect();
        if !wrong.is_empty() {
            return Err(CouplingError::Option(wrong.join("; ")));
        }
        self.state.inputs.poses = poses;
        Ok(())
    }

    /// Activations of all muscles from the next solution on ([`ThighSide::activation_range`]).
    pub fn set_activations(&mut self, activations: &[f64]) -> Result<(), CouplingError> {
        let n = self.side.thigh.muscles.len();
        examined("activations", activations, n, self.side.activation_range())?;
        self.state.inputs.activations = activations.to_vec();
        Ok(())
    }

    /// How the bones move with the joint coordinates; moments and lever arms are nothing until this is known.
    pub fn set_twists(&mut self, twists: &BoneTwists) -> Result<(), CouplingError> {
        let all = twists.as_flattened().as_flattened();
        examined("twists of the bones", all, all.len(), [f64::NEG_INFINITY, f64::INFINITY])?;
        self.state.inputs.twists = *twists;
        self.result = None;
        Ok(())
    }

    /// Lever arms at the knee that the rigid leg has of the muscles \[m\]: by them the moment of heads that are sewn together is shared out.
    pub fn set_rigid_knee_arms(&mut self, arms: &[f64]) -> Result<(), CouplingError> {
        let n = self.side.thigh.muscles.len();
        examined("lever arms at the knee [m]", arms, n, [f64::NEG_INFINITY, f64::INFINITY])?;
        self.state.inputs.knee_arms = arms.to_vec();
        self.result = None;
        Ok(())
    }

    /// Goes to the equilibrium under the poses and activations that were set. Where there is none the session stays where it is, and the
    /// error says why.
    pub fn solve(&mut self) -> Result<(), CouplingError> {
        let side = self.side.clone();
        let (scene, steps) = (&side.prepared.scene, &side.prepared.steps);
        let poses = self.state.inputs.poses.map(|p| as_pose(&p).expect("poses were examined"));
        let moved = moves(steps, scene.stress_free, &poses);
        let wrong = |e: fem::plan::SceneError| CouplingError::Option(e.to_string());
        let to = load(&side.plan, &side.thigh, &self.state.inputs.activations, moved).map_err(wrong)?;
        let mut from = (self.state.solved > 0).then(|| self.frame());
        let mut solved = self.state.solved;
        if solved == 0 && has_passive_way(&side.thigh, scene.stress_free) {
            let passive = vec![0.0; side.thigh.muscles.len()];
            let load = load(&side.plan, &side.thigh, &passive, moved).map_err(wrong)?;
            from = Some(advanced(&side, from.as_ref(), solved, load)?);
            solved += 1;
        }
        let frame = advanced(&side, from.as_ref(), solved, to)?;
        self.state.solved = solved + 1;
        self.state.controls = frame.load.controls;
        self.state.poses = frame.load.poses.iter().map(numbers).collect();
        self.state.x = frame.x;
        self.result = None;
        Ok(())
    }

    /// What is measured on the present state.
    pub fn result(&mut self) -> &ThighResult {
        if self.result.is_none() {
            self.result = Some(self.measure());
        }
        self.result.as_ref().expect("just measured")
    }

    /// Displacements of all nodes from where the mesh has them \[m\], three per node.
    pub fn displacements(&self) -> Vec<f64> {
        self.state.x.iter().zip(self.side.plan.reference()).map(|(x, start)| x - start).collect()
    }

    /// Positions of all nodes \[m\], three per node.
    pub fn positions(&self) -> &[f64] {
        &self.state.x
    }

    /// Wrench of the tissue on each bone by its own twist, all other bones held and all muscles in equilibrium: rows force \[N\] and moment
    /// about the hip centre of the mesh \[N·m\], columns translation \[m\] and rotation about the hip centre \[rad\].
    pub fn stiffness(&self) -> Result<[[[f64; 6]; 6]; BODIES.len()], CouplingError> {
        let frame = self.frame();
        let hip = self.side.prepared.registration.frames().hip;
        let mut all = [[[0.0; 6]; 6]; BODIES.len()];
        for (body, all) in BODIES.iter().zip(&mut all) {
            let Some(number) = self.side.plan.bodies.iter().position(|b| b == body) else { continue };
            *all = fem::measure::condensed_stiffness(&self.side.plan, frame.snapshot(), number, hip.into())
                .map_err(|why| CouplingError::NotConverged(format!("stiffness of {body}: {why}")))?;
        }
        Ok(all)
    }

    /// The state as bytes: inputs, time and where all nodes are.
    pub fn save(&self) -> Vec<u8> {
        state::to_bytes(&self.side.key, &self.state)
    }

    /// Takes over a state that a session of the same thigh saved; refuses any other, and then stays as it is.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), CouplingError> {
        let state: State = state::of_bytes(&self.side.key, "thigh", bytes)?;
        let side = &self.side;
        let n = side.thigh.muscles.len();
        let counts = [
            (state.x.len(), 3 * side.n_nodes()),
            (state.controls.len(), side.plan.controls.len()),
            (state.poses.len(), side.plan.bodies.len()),
            (state.inputs.activations.len(), n),
            (state.inputs.knee_arms.len(), n),
        ];
        let poses = || state.poses.iter().chain(&state.inputs.poses).all(|p| as_pose(p).is_ok());
        let finite = || state.x.iter().chain(&state.controls).all(|v| v.is_finite());
        if counts.iter().any(|(found, wanted)| found != wanted) || !poses() || !finite() {
            return Err(CouplingError::Option(
                "this is no state of this thigh: it is damaged or incomplete".into(),
            ));
        }
        (self.state, self.result) = (state, None);
        Ok(())
    }

    /// The state as the solver knows it.
    fn frame(&self) -> Frame {
        let State { time, controls, poses, x, .. } = &self.state;
        let poses = poses.iter().map(|p| as_pose(p).expect("poses were examined")).collect();
        Frame {
            time: *time,
            load: Load { controls: controls.clone(), poses },
            x: x.clone(),
            ..Frame::default()
        }
    }

    fn measure(&self) -> ThighResult {
        let (side, frame, inputs) = (&self.side, self.frame(), &self.state.inputs);
        let hip = side.prepared.registration.frames().hip;
        let twists = VirtualTwists::given(&inputs.twists, hip);
        let has_fibres = side.prepared.scene.fibres != Fibres::None;
        let mut seen = actions(&side.plan, &side.thigh, frame.snapshot(), &twists);
        as_units(&mut seen, &side.units, KNEE, &|m| inputs.knee_arms[m]);
        let one = |(m, action): (usize, &crate::two_way::capacity::MuscleAction)| {
            let muscle = &side.thigh.muscles[m];
            let (mut elongation, mut through_belly) = (0.0, None);
            if let (FibreCalibration::Hill { muscles, units, scale }, true) =
                (&side.calibration.fibres, has_fibres)
            {
                elongation = (action.stretch - muscles[m].fit.rest) * muscle.fibre_length / scale;
                let (capacity, says) = seen_capacity(action, &units[m], elongation, self.drive(m));
                through_belly = says[2].then_some(capacity.through_belly);
            }
            MuscleResult {
                section: muscle_force(&side.plan, &frame, muscle),
                tissue: action.tissue,
                stretch: action.stretch,
                elongation,
                through_belly,
                moments: std::array::from_fn(|c| action.moments[c]),
                lever_arms: std::array::from_fn(|c| action.lever_arms[c]),
            }
        };
        let muscles = seen.iter().enumerate().map(one).collect();
        let about: Vec<[f64; 3]> =
            frame.load.poses.iter().map(|p| (p.inverse() * Point3::from(hip)).into()).collect();
        let of_plan = body_wrenches(&side.plan, frame.snapshot(), &about);
        let wrench = |body: &str| {
            let at = side.plan.bodies.iter().position(|b| b == body);
            let wrench = at.map(|b| of_plan[b]).unwrap_or_default();
            std::array::from_fn(|i| if i < 3 { wrench.force[i] } else { wrench.moment[i - 3] })
        };
        ThighResult { muscles, wrenches: BODIES.map(wrench) }
    }

    /// Activation of a muscle in the present state.
    fn drive(&self, muscle: usize) -> f64 {
        let name = &self.side.thigh.muscles[muscle].name;
        let control = self.side.plan.controls.iter().position(|c| c == name);
        control.map_or(0.0, |c| self.state.controls[c])
    }
}

/// The equilibrium under a load, from the mesh or from an equilibrium, the `solved`-th, by solvers of its own.
fn advanced(
    side: &ThighSide,
    from: Option<&Frame>,
    solved: usize,
    load: Load,
) -> Result<Frame, CouplingError> {
    let session = match from {
        None => Session::new(&side.plan, &side.settings, None),
        Some(frame) => Session::from_frame(&side.plan, &side.settings, frame, solved - 1),
    };
    let mut session = session.map_err(|e| CouplingError::NotConverged(e.to_string()))?;
    let Advanced { frame, errors, .. } = session.advance(&DriveFrame { time: (solved + 1) as f64, load });
    match errors.is_empty() {
        true => Ok(frame),
        false => {
            let all: Vec<String> = errors.iter().map(ToString::to_string).collect();
            Err(CouplingError::NotConverged(all.join("; ")))
        }
    }
}
