//! The rigid leg by itself: a recorded trial, frame by frame.

#![allow(non_snake_case)]

use std::sync::{Arc, OnceLock};

use multibody::share::{SharingSettings, names};
use multibody::sharing::SharingSolver;
use multibody::trial::Status;
use nalgebra::{DVector, Vector3};
use serde::{Deserialize, Serialize};

use super::pose::{PoseNumbers, numbers};
use super::{examined, state};
use crate::comparison::Sized;
use crate::error::CouplingError;
use crate::fibres::cache::text_hash;
use crate::fibres::muscle_unit::MuscleUnit;
use crate::fibres::{WrittenCalibration, units_as_meshed};
use crate::optimize::Optimized;
use crate::scene::Fibres;
use crate::steps::rigid_step_at;
use crate::thigh::lines::lines_of_muscles;
use crate::thigh::registration::{BODIES, Registration};
use crate::two_way::capacity::{BoneTwists, MuscleCapacity, VirtualTwists};
use crate::two_way::{nominal_capacity, sharing_problem};

/// A rigid leg that can be asked: all that never changes.
pub struct RigidSide {
    done: Arc<Optimized>,
    registration: Registration,
    fibres: Fibres,
    muscles: Vec<String>,
    /// Numbers of the lines of every muscle of the thigh.
    lines: Vec<Vec<usize>>,
    units: Vec<MuscleUnit>,
    calibration: WrittenCalibration,
    frames: Vec<OnceLock<Result<FrameOfTrial, String>>>,
    key: String,
}

/// What the rigid leg says of a frame, whatever the muscles can do.
#[derive(Clone, Debug)]
struct FrameOfTrial {
    result: RigidResult,
    /// Per line of the thigh's muscles its unit vector along the belly.
    directions: Vec<Vec<Vector3<f64>>>,
}

/// What the rigid leg says at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidResult {
    /// Time of the frame \[s\].
    pub time: f64,
    /// Whether forces within their bounds carry the load; else those of least violation are told.
    pub is_feasible: bool,
    /// Poses of the bones.
    pub poses: [PoseNumbers; BODIES.len()],
    /// How the bones move with the joint coordinates that muscles of the thigh move.
    pub twists: BoneTwists,
    /// Joint angles \[rad\] ([`RigidSide::angles`]).
    pub angles: Vec<f64>,
    /// Tension of every line \[N\] ([`RigidSide::lines`]).
    pub forces: Vec<f64>,
    /// Activation of every line.
    pub activations: Vec<f64>,
    /// Length of every line, muscle and tendon, of the generic leg at these joint angles \[m\].
    pub lengths: Vec<f64>,
    /// Lever arms \[m\], per line one per coordinate ([`RigidSide::coordinates`]).
    pub lever_arms: Vec<f64>,
    /// Per muscle of the thigh its force along the belly \[N\].
    pub muscle_forces: Vec<f64>,
    /// Per muscle of the thigh the sum of the tensions of its lines \[N\].
    pub tensions: Vec<f64>,
    /// Per muscle of the thigh what drives its fibres: isometric activation of Hill fibres, contraction of thermal ones.
    pub drives: Vec<f64>,
    /// Per muscle of the thigh what force sharing counts on before the thigh has said anything.
    pub nominal: Vec<MuscleCapacity>,
}

impl RigidSide {
    /// The rigid leg of a scene. `calibration`: that of the thigh, from which contractions of thermal fibres follow.
    pub fn new(sized: Sized, calibration: WrittenCalibration) -> Result<RigidSide, CouplingError> {
        let Sized { scene, done, registration, steps, limb, .. } = sized;
        if let Some(step) = scene.steps.iter().find(|s| s.knee_flexion.is_some()) {
            return Err(CouplingError::Option(format!(
                "the scene `{}` flexes the knee at {} otherwise than the trial, which no unit of the trial can tell; take out knee_flexion_deg",
                scene.name,
                step.name.name()
            )));
        }
        let wanted = |name: &String| scene.muscles.is_empty() || scene.muscles.contains(name);
        let muscles: Vec<String> = match limb {
            Some(limb) => limb.sections.into_iter().map(|s| s.name).filter(wanted).collect(),
            None => lines_of_muscles().into_keys().collect(),
        };
        if scene.deformable && scene.fibres == Fibres::Thermal && calibration.thermal.len() != muscles.len() {
            return Err(CouplingError::Option("thermal fibres need the calibration of their muscles".into()));
        }
        let of_muscle = lines_of_muscles();
        let number =
            |name: &String| done.model.muscles.iter().position(|m| m.name == *name).expect("tables agree");
        let lines = muscles.iter().map(|m| of_muscle[m].iter().map(number).collect()).collect();
        let as_str: Vec<&str> = muscles.iter().map(String::as_str).collect();
        let units = units_as_meshed(&as_str, &done.model, &registration, &steps, scene.stress_free);
        let key =
            text_hash(format!("rigid{}{:?}{muscles:?}", scene.text, done.effort.forces.values.as_slice()));
        let frames = (0..done.effort.time.len()).map(|_| OnceLock::new()).collect();
        let fibres = if scene.deformable { scene.fibres } else { Fibres::None };
        Ok(RigidSide { done, registration, fibres, muscles, lines, units, calibration, frames, key })
    }

    /// Everything that was computed of the trial.
    pub fn optimized(&self) -> &Optimized {
        &self.done
    }

    /// Muscles of the thigh.
    pub fn muscles(&self) -> &[String] {
        &self.muscles
    }

    /// Lines of the leg.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        self.done.model.muscles.iter().map(|m| m.name.as_str())
    }

    /// Names of the joint angles.
    pub fn angles(&self) -> &[String] {
        &self.done.motion.angles.columns
    }

    /// Names of the joint coordinates of lever arms.
    pub fn coordinates(&self) -> Vec<String> {
        self.done.model.coordinate_names()
    }

    /// Times of the frames \[s\].
    pub fn times(&self) -> &[f64] {
        &self.done.effort.time
    }

    /// Says which leg a state is of.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// The frame nearest to a time \[s\]; none outside of the trial by more than half the distance of its frames.
    fn row(&self, time: f64) -> Result<usize, CouplingError> {
        let times = self.times();
        let far = |k: &usize| (times[*k] - time).abs();
        let nearest = (0..times.len()).min_by(|a, b| far(a).total_cmp(&far(b))).expect("a trial has frames");
        let (first, last) = (times[0], times[times.len() - 1]);
        let half = 0.5 * (last - first) / (times.len().max(2) - 1) as f64;
        if !(time >= first - half && time <= last + half) {
            return Err(CouplingError::Option(format!(
                "the trial has no frame at {time} s, only from {first} to {last} s"
            )));
        }
        Ok(nearest)
    }

    fn frame(&self, row: usize) -> Result<&FrameOfTrial, CouplingError> {
        let found = self.frames[row].get_or_init(|| self.frame_of(row));
        found.as_ref().map_err(|why| CouplingError::NotConverged(why.clone()))
    }

    fn frame_of(&self, row: usize) -> Result<FrameOfTrial, String> {
        let (done, model) = (&self.done, &self.done.model);
        let step = rigid_step_at(done, &self.registration, row)?;
        let frame = done.motion.report.start + row;
        let reduced =
            done.loads.reduced[row].as_ref().ok_or_else(|| format!("no loads at {} s", step.time))?;
        let twists = VirtualTwists::new(model, &self.registration, &done.motion.Q[frame], &reduced.tangent);
        let rigid = |m: usize| step.muscle(&self.muscles[m]).expect("tables agree");
        let drive = |m: usize| match self.fibres {
            Fibres::None => Ok(0.0),
            Fibres::Hill => self.units[m].drive(rigid(m)).ok_or_else(|| beyond(&self.muscles[m], step.time)),
            Fibres::Thermal => {
                let force = rigid(m).force().norm();
                self.calibration.thermal[m]
                    .contraction_for(force)
                    .ok_or_else(|| beyond(&self.muscles[m], step.time))
            }
        };
        let all = 0..self.muscles.len();
        let row_of = |values: &nalgebra::DMatrix<f64>, row: usize| {
            values.row(row).iter().copied().collect::<Vec<f64>>()
        };
        let result = RigidResult {
            time: step.time,
            is_feasible: true,
            poses: step.poses.each_ref().map(numbers),
            twists: twists.told(),
            angles: row_of(&done.motion.angles.values, frame),
            forces: row_of(&done.effort.forces.values, row),
            activations: row_of(&done.effort.activations.values, row),
            lengths: step.lengths.clone(),
            lever_arms: reduced.lever_arms.as_slice().to_vec(),
            muscle_forces: all.clone().map(|m| rigid(m).force().norm()).collect(),
            tensions: all.clone().map(|m| self.tension(m, |i| done.effort.forces.values[(row, i)])).collect(),
            drives: all.clone().map(drive).collect::<Result<_, _>>()?,
            nominal: all
                .clone()
                .map(|m| {
                    nominal_capacity(
                        model,
                        &reduced.lever_arms,
                        &self.units[m],
                        &self.lines[m],
                        Some(rigid(m)),
                    )
                })
                .collect(),
        };
        let directions = all.map(|m| rigid(m).lines.iter().map(|l| l.direction()).collect()).collect();
        Ok(FrameOfTrial { result, directions })
    }

    fn tension(&self, muscle: usize, of_line: impl Fn(usize) -> f64) -> f64 {
        self.lines[muscle].iter().map(|&i| of_line(i)).sum()
    }

    /// The same frame with forces shared among muscles of these capacities.
    fn shared(
        &self,
        row: usize,
        capacities: &[MuscleCapacity],
        solver: &mut SharingSolver,
    ) -> Result<RigidResult, CouplingError> {
        let frame = self.frame(row)?;
        let mut result = frame.result.clone();
        let problem =
            sharing_problem(&self.done.model, &self.done.loads, row, &self.units, &self.lines, capacities);
        let problem =
            problem.ok_or_else(|| CouplingError::NotConverged(format!("no loads at {} s", result.time)))?;
        let solved = solver.solve(&problem)?;
        if solved.verdict.status == Status::Failed || !solved.f.iter().all(|f| f.is_finite()) {
            let why = solved.verdict.reason.unwrap_or_default();
            return Err(CouplingError::NotConverged(format!("no muscle forces at {} s: {why}", result.time)));
        }
        let f: DVector<f64> = solved.f;
        result.is_feasible = solved.verdict.status == Status::Solved;
        for (m, capacity) in capacities.iter().enumerate() {
            let tension = self.tension(m, |i| f[i]);
            let lines = self.lines[m].iter().zip(&frame.directions[m]);
            result.tensions[m] = tension;
            result.muscle_forces[m] = lines.map(|(&i, d)| f[i] * d).sum::<Vector3<f64>>().norm();
            result.drives[m] = capacity.drive(&self.units[m], tension);
            self.lines[m].iter().for_each(|&i| result.activations[i] = result.drives[m]);
        }
        result.forces = f.as_slice().to_vec();
        result.lever_arms = problem.R.as_slice().to_vec();
        Ok(result)
    }
}

fn beyond(muscle: &str, time: f64) -> String {
    format!("{muscle}: no activation of the thigh makes its force at {time} s")
}

/// Where a session is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct State {
    time: f64,
    row: usize,
    capacities: Option<Vec<MuscleCapacity>>,
    /// The capacities with which forces were shared last.
    shared_with: Option<Vec<MuscleCapacity>>,
}

/// A rigid leg on its way through its trial.
pub struct RigidSession {
    side: Arc<RigidSide>,
    state: State,
    /// Shared forces of the present state; absent where they are those of the trial, or were not asked for yet.
    shared: Option<RigidResult>,
    solver: SharingSolver,
}

impl RigidSession {
    /// At the first frame, before the thigh has said anything.
    pub fn new(side: Arc<RigidSide>) -> RigidSession {
        let solver = SharingSolver::new(names(&side.done.model), SharingSettings::default().options);
        let state = State { time: side.times()[0], row: 0, capacities: None, shared_with: None };
        RigidSession { side, state, shared: None, solver }
    }

    /// What never changes.
    pub fn side(&self) -> &Arc<RigidSide> {
        &self.side
    }

    /// Time of the state \[s\].
    pub fn time(&self) -> f64 {
        self.state.time
    }

    /// What the muscles of the thigh can do from the next time on; `None`: what the rigid leg has of them.
    pub fn set_capacities(&mut self, capacities: Option<&[MuscleCapacity]>) -> Result<(), CouplingError> {
        if let Some(capacities) = capacities {
            let n = self.side.muscles.len();
            let of = |what: fn(&MuscleCapacity) -> f64| capacities.iter().map(what).collect::<Vec<f64>>();
            let everything = [f64::NEG_INFINITY, f64::INFINITY];
            examined("fibre elongations [m]", &of(|c| c.shift), n, everything)?;
            examined("forces of the tissue [N]", &of(|c| c.tissue), n, everything)?;
            // Tension is divided by it.
            examined(
                "fractions through the belly",
                &of(|c| c.through_belly),
                n,
                [f64::MIN_POSITIVE, f64::INFINITY],
            )?;
            let arms: Vec<f64> = capacities.iter().flat_map(|c| c.lever_arms).collect();
            examined("lever arms [m]", &arms, arms.len(), everything)?;
        }
        self.state.capacities = capacities.map(<[MuscleCapacity]>::to_vec);
        Ok(())
    }

    /// Goes to the frame nearest to a time \[s\] and shares its forces; stays where it is where there are none.
    pub fn go_to(&mut self, time: f64) -> Result<(), CouplingError> {
        examined("time [s]", &[time], 1, [f64::NEG_INFINITY, f64::INFINITY])?;
        let row = self.side.row(time)?;
        let side = self.side.clone();
        let shared = match &self.state.capacities {
            None => side.frame(row).map(|_| None)?,
            Some(capacities) => Some(side.shared(row, capacities, &mut self.solver)?),
        };
        self.state.shared_with = self.state.capacities.clone();
        (self.state.time, self.state.row, self.shared) = (time, row, shared);
        Ok(())
    }

    /// What the rigid leg says of the present state.
    pub fn result(&mut self) -> Result<&RigidResult, CouplingError> {
        if let (Some(capacities), None) = (&self.state.shared_with, &self.shared) {
            self.shared = Some(self.side.shared(self.state.row, capacities, &mut self.solver)?);
        }
        match &self.shared {
            Some(shared) => Ok(shared),
            None => Ok(&self.side.frame(self.state.row)?.result),
        }
    }

    /// The state as bytes.
    pub fn save(&self) -> Vec<u8> {
        state::to_bytes(&self.side.key, &self.state)
    }

    /// Takes over a state that a session of the same leg saved; refuses any other, and then stays as it is.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), CouplingError> {
        let state: State = state::of_bytes(&self.side.key, "rigid leg", bytes)?;
        let n = self.side.muscles.len();
        let fits = |c: &Option<Vec<MuscleCapacity>>| c.as_ref().is_none_or(|c| c.len() == n);
        if state.row >= self.side.times().len() || !fits(&state.capacities) || !fits(&state.shared_with) {
            let text = "this is no state of this rigid leg: it is damaged or incomplete";
            return Err(CouplingError::Option(text.into()));
        }
        (self.state, self.shared) = (state, None);
        Ok(())
    }
}
