//! The gait steps that drive the thigh: posture of the bones, force and activation of each of its muscles.

#![allow(non_snake_case)]

use fem::body::Pose;
use multibody::kinematics::joint_angles;
use multibody::model::Model;
use multibody::muscle::hill::{self, tendon_force};
use multibody::muscle::musculotendon::{GenericPosture, MusculotendonModel};
use multibody::muscle::path::knee_angle;
use multibody::natural::Coordinates;
use nalgebra::Vector3;

use crate::optimize::Optimized;
use crate::scene::StepName;
use crate::thigh::lines::lines_of_muscles;
use crate::thigh::registration::Registration;

/// One muscle line of the rigid leg in a step, in the frame of the mesh with the thigh at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidLine {
    /// Name as in `muscles.csv`.
    pub name: String,
    /// Tension \[N\].
    pub force: f64,
    /// Activation, 0..1.
    pub activation: f64,
    /// Points of its path \[m\], origin first.
    pub path: Vec<Vector3<f64>>,
    /// Tension at full activation and optimal length \[N\].
    pub f_max: f64,
    /// Length of muscle and tendon \[m\] on the generic leg at the joint angles of the subject.
    pub length: f64,
    /// Tension \[N\] of the Hill model at the activation, fibre length and velocity of the rigid leg. It differs from `force` where the
    /// activation was clipped to 0..1: a resting muscle has its passive tension.
    pub hill_force: f64,
}

impl RigidLine {
    /// Unit vector of the longest stretch of the path, from origin to insertion: the one that passes the belly.
    pub fn direction(&self) -> Vector3<f64> {
        let stretches = self.path.windows(2).map(|p| p[1] - p[0]);
        let longest = stretches.max_by(|a, b| a.norm().total_cmp(&b.norm()));
        longest.map_or_else(Vector3::zeros, |d| d.normalize())
    }
}

/// One muscle of the thigh as the rigid leg has it.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidMuscle {
    /// Name as in the section tables.
    pub name: String,
    /// Its lines.
    pub lines: Vec<RigidLine>,
}

impl RigidMuscle {
    /// Sum of the tensions as vectors along the belly \[N\].
    pub fn force(&self) -> Vector3<f64> {
        self.lines.iter().map(|l| l.force * l.direction()).sum()
    }

    /// Sum of the tensions, as of lines that all run along the belly \[N\].
    pub fn tension(&self) -> f64 {
        self.lines.iter().map(|l| l.force).sum()
    }

    /// Mean activation of the lines, weighted with their strength.
    pub fn activation(&self) -> f64 {
        let strength: f64 = self.lines.iter().map(|l| l.f_max).sum();
        self.lines.iter().map(|l| l.activation * l.f_max).sum::<f64>() / strength
    }

    /// Force of all lines at full activation and optimal length, as vectors \[N\].
    pub fn strength(&self) -> f64 {
        self.lines.iter().map(|l| l.f_max * l.direction()).sum::<Vector3<f64>>().norm()
    }
}

/// What the rigid leg says of one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidStep {
    /// Which.
    pub name: StepName,
    /// Time \[s\].
    pub time: f64,
    /// Row among the reported frames.
    pub row: usize,
    /// Knee flexion \[rad\].
    pub knee_flexion: f64,
    /// Poses of the bones ([`crate::thigh::registration::BODIES`]) relative to the mesh.
    pub poses: [Pose; 4],
    /// The muscles of the thigh, by name.
    pub muscles: Vec<RigidMuscle>,
}

impl RigidStep {
    /// The muscle of this name; `None` where the rigid leg has no line of it.
    pub fn muscle(&self, name: &str) -> Option<&RigidMuscle> {
        self.muscles.iter().find(|m| m.name == name)
    }

    /// Activation of a muscle, zero where the rigid leg has no line of it.
    pub fn activation(&self, name: &str) -> f64 {
        self.muscle(name).map_or(0.0, RigidMuscle::activation)
    }
}

/// The step `name` of a trial; an error says why the frame cannot be used.
pub fn rigid_step(
    done: &Optimized,
    registration: &Registration,
    name: StepName,
) -> Result<RigidStep, String> {
    let row = step_row(done, name);
    let PostureAt { time, knee_flexion, poses, muscles, .. } =
        rigid_step_at(done, registration, row).map_err(|why| format!("{}: {why}", name.name()))?;
    Ok(RigidStep { name, time, row, knee_flexion, poses, muscles })
}

/// What the rigid leg says of a reported frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PostureAt {
    /// Time \[s\].
    pub time: f64,
    /// Knee flexion \[rad\].
    pub knee_flexion: f64,
    /// Poses of the bones ([`crate::thigh::registration::BODIES`]) relative to the mesh.
    pub poses: [Pose; 4],
    /// The muscles of the thigh, by name.
    pub muscles: Vec<RigidMuscle>,
    /// Length of every line of the leg, muscle and tendon, on the generic leg at the joint angles of the subject \[m\].
    pub lengths: Vec<f64>,
}

impl PostureAt {
    /// The muscle of this name; `None` where the rigid leg has no line of it.
    pub fn muscle(&self, name: &str) -> Option<&RigidMuscle> {
        self.muscles.iter().find(|m| m.name == name)
    }
}

/// Row of a step among the reported frames.
pub fn step_row(done: &Optimized, name: StepName) -> usize {
    let n = done.effort.time.len();
    ((n - 1) as f64 * name.fraction()).round() as usize
}

/// What a trial says of a reported frame, by its row; an error says why the frame cannot be used.
pub fn rigid_step_at(done: &Optimized, registration: &Registration, row: usize) -> Result<PostureAt, String> {
    let frame = done.motion.report.start + row;
    let time = done.effort.time[row];
    if let Some(why) = &done.motion.fit[frame].failure {
        return Err(format!("the frame at {time:.3} s was not fitted: {why}"));
    }
    let verdict = &done.effort.verdicts[row];
    if verdict.status != multibody::trial::Status::Solved {
        let why = verdict.reason.as_deref().unwrap_or("no reason given");
        return Err(format!("no muscle forces at {time:.3} s: {why}"));
    }
    let (model, Q) = (&done.model, &done.motion.Q[frame]);
    let (units, curves) = (&MusculotendonModel::generic().units, hill::Settings::default().curves);
    let values = |i: usize| {
        let a = done.effort.activations.values[(row, i)];
        let (L, V) = (done.hill.fibre_length[(row, i)], done.hill.fibre_velocity[(row, i)]);
        [done.effort.forces.values[(row, i)], a, tendon_force(&units[i], &curves, a, L, V)]
    };
    let muscles = rigid_muscles(model, registration, Q, values);
    let knee_flexion = -knee_angle(&model.shapes, Q);
    let lengths = lengths(model, Q);
    Ok(PostureAt { time, knee_flexion, poses: registration.poses(model, Q), muscles, lengths })
}

/// The muscles of the thigh in the posture in which the mesh stands, at rest.
pub fn rigid_muscles_standing(model: &Model, registration: &Registration) -> Vec<RigidMuscle> {
    rigid_muscles_at(model, registration, &registration.standing(model))
}

/// The muscles of the thigh in a posture, at rest.
pub fn rigid_muscles_at(model: &Model, registration: &Registration, Q: &Coordinates) -> Vec<RigidMuscle> {
    rigid_muscles(model, registration, Q, |_| [0.0; 3])
}

/// Lengths of all lines on the generic leg \[m\].
fn lengths(model: &Model, Q: &Coordinates) -> Vec<f64> {
    // No muscle of the thigh crosses the ankle, which is left at zero.
    let [hip_flexion, hip_adduction, hip_rotation, knee_flexion, ..] = joint_angles(&model.shapes, Q);
    let posture =
        GenericPosture { hip_flexion, hip_adduction, hip_rotation, knee_flexion, ..Default::default() };
    MusculotendonModel::generic().lengths(&posture).to_vec()
}

/// The muscles of the thigh in a posture; `values` gives force \[N\], activation and Hill force \[N\] of a line by its number.
fn rigid_muscles(
    model: &Model,
    registration: &Registration,
    Q: &Coordinates,
    values: impl Fn(usize) -> [f64; 3],
) -> Vec<RigidMuscle> {
    let fe = knee_angle(&model.shapes, Q);
    let lengths = lengths(model, Q);
    let line = |wanted: &String| {
        let i = model.muscles.iter().position(|m| m.name == *wanted).expect("tables agree");
        let muscle = &model.muscles[i];
        let [force, activation, hill_force] = values(i);
        let path = muscle.points(fe).map(|p| registration.point(model, Q, &p.position.at(Q))).collect();
        RigidLine {
            name: wanted.clone(),
            force,
            activation,
            path,
            f_max: muscle.f_max,
            length: lengths[i],
            hill_force,
        }
    };
    lines_of_muscles()
        .into_iter()
        .map(|(name, lines)| RigidMuscle { name, lines: lines.iter().map(line).collect() })
        .collect()
}
