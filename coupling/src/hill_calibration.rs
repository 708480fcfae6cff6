//! Calibration of Hill fibres: which rest length and which tension make a deformable muscle pull as its lines on the rigid leg do.
//!
//! Every muscle is solved alone in the posture of the mesh, never in a posture that it is later compared in. Its fibres are curved and
//! partly lie askew, so they are shorter when taut than in the mesh and pull harder than what comes through the belly: two numbers,
//! [`Fit`], found at half activation. Other activations and lengths only show how good the fit is.

use fem::body::Pose;
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::solve::Settings;

use crate::calibration::CalibrationError;
use crate::muscle_unit::{Fit, MuscleUnit};
use crate::registration::BODIES;
use crate::section::belly_force;
use crate::steps::RigidMuscle;
use crate::thigh::build::Thigh;

/// Activation at which the fit is made.
const FITTED_AT: f64 = 0.5;
/// Further activations in the posture of the mesh.
const ACTIVATIONS: [f64; 2] = [1.0, 0.1];

/// A posture in which calibrated muscles are looked at.
pub struct Posture {
    /// How it is called in the report.
    pub name: String,
    /// Poses of the bones relative to the mesh.
    pub poses: [Pose; 4],
    /// The rigid leg's muscles there.
    pub muscles: Vec<RigidMuscle>,
}

/// Force of a calibrated muscle beside that of its lines.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sample {
    /// Posture.
    pub posture: String,
    /// Isometric activation.
    pub activation: f64,
    /// Mean stretch of the fibres.
    pub stretch: f64,
    /// Isometric force of the lines at the same activation, at their own length in the posture \[N\].
    pub rigid: f64,
    /// The same at the length that the fibres of the mesh have \[N\].
    pub rigid_at_length: f64,
    /// Force through the belly \[N\].
    pub found: f64,
}

/// A calibrated muscle.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Calibrated {
    /// Its name.
    pub muscle: String,
    /// The fit.
    pub fit: Fit,
    /// How good it is.
    pub samples: Vec<Sample>,
}

impl Calibrated {
    /// Largest difference between the force through the belly and that of the lines at the same activation and length \[N\], over the
    /// samples.
    pub fn error(&self) -> f64 {
        self.samples.iter().map(|s| (s.found - s.rigid_at_length).abs()).fold(0.0, f64::max)
    }
}

/// The thigh with the laws that fits give its muscles; `units` and `fits` in the order of its muscles.
pub fn with_laws(thigh: &Thigh, units: &[MuscleUnit], scale: f64, fits: &[Fit]) -> Thigh {
    let mut thigh = thigh.clone();
    for (i, (unit, fit)) in units.iter().zip(fits).enumerate() {
        let muscle = &thigh.muscles[i];
        let law = unit.law(muscle.fibre_area, muscle.fibre_length, scale, fit);
        thigh.set_fibre_law(i, law);
    }
    thigh
}

/// Calibrates all muscles of a thigh without contact, so that all are alone. `units`: its muscles in the posture of the mesh; `scale`: how
/// many times longer than the generic leg that of the mesh is. `postures` are looked at afterwards, at half activation.
pub fn calibrate_hill(
    thigh: &Thigh,
    units: &[MuscleUnit],
    scale: f64,
    postures: &[Posture],
    settings: &Settings,
) -> Result<Vec<Calibrated>, CalibrationError> {
    let n = thigh.muscles.len();
    let raw = vec![Fit::default(); n];
    let (fits, taut): (Vec<Fit>, Vec<f64>) = {
        let thigh = with_laws(thigh, units, scale, &raw);
        let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
        let mut looks = Looks::from(&thigh, &plan, settings, None);
        let taut = looks.at(FITTED_AT, None)?;
        let fits = taut
            .iter()
            .zip(units)
            .zip(&thigh.muscles)
            .map(|((seen, unit), muscle)| {
                let pulled = unit.force((seen.stretch - 1.0) * muscle.fibre_length / scale, FITTED_AT);
                Fit { rest: seen.stretch, gain: pulled / seen.force }
            })
            .collect();
        (fits, looks.x)
    };
    for (muscle, fit) in thigh.muscles.iter().zip(&fits) {
        if !(0.2..5.0).contains(&fit.gain) {
            return Err(CalibrationError::Gain { muscle: muscle.name.clone(), gain: fit.gain });
        }
    }
    let thigh = with_laws(thigh, units, scale, &fits);
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
    let mut looks = Looks::from(&thigh, &plan, settings, Some(&taut));
    let mut all: Vec<Calibrated> = (thigh.muscles.iter().zip(&fits))
        .map(|(m, fit)| Calibrated { muscle: m.name.clone(), fit: *fit, samples: Vec::new() })
        .collect();
    let still = [FITTED_AT].into_iter().chain(ACTIVATIONS).map(|a| (a, None));
    let moved = postures.iter().map(|p| (FITTED_AT, Some(p)));
    for (activation, posture) in still.chain(moved) {
        let seen = looks.at(activation, posture)?;
        for (i, seen) in seen.iter().enumerate() {
            let (muscle, unit) = (&thigh.muscles[i], &units[i]);
            let shift = (seen.stretch - fits[i].rest) * muscle.fibre_length / scale;
            let there = posture.and_then(|p| p.muscles.iter().find(|m| m.name == muscle.name));
            all[i].samples.push(Sample {
                posture: posture.map_or("as meshed".into(), |p| p.name.clone()),
                activation,
                stretch: seen.stretch,
                rigid: there.map_or_else(|| unit.force(0.0, activation), |m| unit.force_at(m, activation)),
                rigid_at_length: unit.force(shift, activation),
                found: seen.force,
            });
        }
    }
    Ok(all)
}

/// A muscle in equilibrium.
struct Seen {
    stretch: f64,
    force: f64,
}

struct Looks<'a> {
    thigh: &'a Thigh,
    plan: &'a Plan,
    session: Session<'a>,
    time: f64,
    /// Where the nodes were at last \[m\].
    x: Vec<f64>,
}

impl<'a> Looks<'a> {
    /// `start`: where to start in place of the mesh as it is.
    fn from(thigh: &'a Thigh, plan: &'a Plan, settings: &Settings, start: Option<&[f64]>) -> Looks<'a> {
        Looks { thigh, plan, session: Session::new(plan, settings, start), time: 0.0, x: Vec::new() }
    }

    /// All muscles at an activation and in a posture, that of the mesh where there is none.
    fn at(&mut self, activation: f64, posture: Option<&Posture>) -> Result<Vec<Seen>, CalibrationError> {
        self.time += 1.0;
        let controls: Vec<(&str, f64)> =
            self.thigh.muscles.iter().map(|m| (m.name.as_str(), activation)).collect();
        let poses: Vec<(&str, Pose)> = posture.map_or(Vec::new(), |p| {
            let of_plan = |(name, _): &(&&str, _)| self.plan.bodies.iter().any(|b| b == **name);
            BODIES.iter().zip(p.poses).filter(of_plan).map(|(name, pose)| (*name, pose)).collect()
        });
        let frame = DriveFrame { time: self.time, load: self.plan.load(&controls, &poses)? };
        let done = self.session.advance(&frame);
        if let Some(error) = done.errors.into_iter().next() {
            return Err(CalibrationError::Solve(error));
        }
        self.x.clone_from(&done.frame.x);
        let at = done.frame.snapshot();
        let see = |(i, muscle)| Seen {
            stretch: self.thigh.fibre_stretch(i, at.x),
            force: belly_force(self.plan, at, muscle).along(),
        };
        Ok(self.thigh.muscles.iter().enumerate().map(see).collect())
    }
}
