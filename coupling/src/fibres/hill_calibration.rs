//! Calibration of Hill fibres: which rest length and which tension make a deformable muscle pull as its lines on the rigid leg do.
//!
//! Every muscle is solved alone in the posture of the mesh, never in a posture that it is later compared in. Its fibres are curved and
//! partly lie askew, so they are shorter when taut than in the mesh and pull harder than what comes through the belly: two numbers,
//! [`Fit`], found with the force of half activation. Activations and lengths looked at then only show how good the fit is, and are left out
//! unless asked for: a slack muscle takes many times the iterations of a taut one.

use fem::body::Pose;
use fem::plan::Plan;
use fem::run::{DriveFrame, Frame, Session};
use fem::scene::FibreLawSpec;
use fem::solve::Settings;

use crate::fibres::alone::calibrate_each;
use crate::fibres::cache::Cache;
use crate::fibres::muscle_unit::{Fit, MuscleUnit};
use crate::fibres::thermal_calibration::CalibrationError;
use crate::steps::RigidMuscle;
use crate::thigh::build::Thigh;
use crate::thigh::registration::BODIES;
use crate::thigh::section::belly_force;

/// Activation at which the fit is made.
const FITTED_AT: f64 = 0.5;
/// Further activations in the posture of the mesh.
const ACTIVATIONS: [f64; 2] = [1.0, 0.1];
/// Newton's method ends at this residual relative to the forces in play: a residual of 1 N, spread over all nodes of a muscle, was seen
/// to be 0.06 N at most in the force through the belly of four muscles, and slender muscles creep for most of their iterations below it.
pub const TOLERANCE: f64 = 1e-3;

/// A posture in which calibrated muscles are looked at.
pub struct Posture {
    /// How it is called in the report.
    pub name: String,
    /// Poses of the bones relative to the mesh.
    pub poses: [Pose; 4],
    /// The rigid leg's muscles there.
    pub muscles: Vec<RigidMuscle>,
}

impl Posture {
    fn muscle(&self, name: &str) -> Option<&RigidMuscle> {
        self.muscles.iter().find(|m| m.name == name)
    }
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

/// Calibrates all muscles of a thigh, each alone. `units`: its muscles in the posture of the mesh; `scale`: how many times longer than the
/// generic leg that of the mesh is. `check`: other activations are looked at afterwards, and these postures at half activation; `None`: nothing
/// is but the fit itself. What `cache` has is not computed.
pub fn calibrate_hill(
    thigh: &Thigh,
    units: &[MuscleUnit],
    scale: f64,
    check: Option<&[Posture]>,
    settings: &Settings,
    cache: Option<&Cache>,
) -> Result<Vec<Calibrated>, CalibrationError> {
    let settings = Settings { tolerance: TOLERANCE, ..*settings };
    let depends = |i: usize| {
        let there = check.map(|postures| {
            let of = |p: &Posture| format!("{:?}", (&p.name, p.poses, p.muscle(&thigh.muscles[i].name)));
            postures.iter().map(of).collect::<Vec<_>>()
        });
        format!("Hill {scale:?}{:?}{there:?}{settings:?}", units[i])
    };
    let all: Vec<usize> = (0..thigh.muscles.len()).collect();
    calibrate_each(thigh, &all, cache, depends, |i, muscle| {
        calibrate_one(muscle, &units[i], scale, check, &settings)
    })
}

/// Calibrates the only muscle of `thigh`.
fn calibrate_one(
    thigh: &Thigh,
    unit: &MuscleUnit,
    scale: f64,
    check: Option<&[Posture]>,
    settings: &Settings,
) -> Result<Calibrated, CalibrationError> {
    let muscle = &thigh.muscles[0];
    let length = muscle.fibre_length / scale;
    let wanted = unit.force(0.0, FITTED_AT);
    // Pulled taut by the wanted force whatever the length of the fibres: where they are as long as the lines is found only here.
    let mut pulled = thigh.clone();
    pulled.set_fibre_law(0, constant_tension(wanted / muscle.fibre_area));
    let plan = Plan::new(&pulled.scene, pulled.mesh.clone())?;
    let taut = look(&pulled, &plan, Session::new(&plan, settings, None)?, FITTED_AT, None)?;
    let fit = Fit { rest: taut.stretch, gain: wanted / taut.force };
    if !(0.2..5.0).contains(&fit.gain) {
        return Err(CalibrationError::Gain { muscle: muscle.name.clone(), gain: fit.gain });
    }
    let thigh = with_laws(thigh, std::slice::from_ref(unit), scale, &[fit]);
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
    let fitted = look(&thigh, &plan, Session::from_frame(&plan, settings, &taut.frame, 0)?, FITTED_AT, None)?;
    let sample = |seen: &Seen, activation: f64, posture: Option<&Posture>| {
        let there = posture.and_then(|p| p.muscle(&muscle.name));
        Sample {
            posture: posture.map_or("as meshed".into(), |p| p.name.clone()),
            activation,
            stretch: seen.stretch,
            rigid: there.map_or_else(|| unit.force(0.0, activation), |m| unit.force_at(m, activation)),
            rigid_at_length: unit.force((seen.stretch - fit.rest) * length, activation),
            found: seen.force,
        }
    };
    let mut samples = vec![sample(&fitted, FITTED_AT, None)];
    let others = check.map(|postures| {
        let others = ACTIVATIONS.map(|a| (a, None)).into_iter();
        others.chain(postures.iter().map(|p| (FITTED_AT, Some(p))))
    });
    for (activation, posture) in others.into_iter().flatten() {
        // All from the fit, which is taut and not far.
        let session = Session::from_frame(&plan, settings, &fitted.frame, 1)?;
        let seen = look(&thigh, &plan, session, activation, posture)?;
        samples.push(sample(&seen, activation, posture));
    }
    Ok(Calibrated { muscle: muscle.name.clone(), fit, samples })
}

/// The same stress \[Pa\] at every length, from the activation of the fit on.
fn constant_tension(stress: f64) -> FibreLawSpec {
    FibreLawSpec::ForceLength {
        stretch: vec![0.1, 3.0],
        activation: vec![0.0, FITTED_AT],
        stress: vec![vec![0.0; 2], vec![stress; 2]],
    }
}

/// A muscle in equilibrium.
struct Seen {
    stretch: f64,
    force: f64,
    frame: Frame,
}

/// The only muscle of `thigh` at an activation and in a posture, that of the mesh where there is none.
fn look(
    thigh: &Thigh,
    plan: &Plan,
    mut session: Session,
    activation: f64,
    posture: Option<&Posture>,
) -> Result<Seen, CalibrationError> {
    let muscle = &thigh.muscles[0];
    let poses: Vec<(&str, Pose)> = posture.map_or(Vec::new(), |p| {
        let of_plan = |(name, _): &(&&str, _)| plan.bodies.iter().any(|b| b == **name);
        BODIES.iter().zip(p.poses).filter(of_plan).map(|(name, pose)| (*name, pose)).collect()
    });
    let load = plan.load(&[(&muscle.name, activation)], &poses)?;
    let done = session.advance(&DriveFrame { time: 1.0, load });
    if let Some(error) = done.errors.into_iter().next() {
        return Err(CalibrationError::Solve(error));
    }
    let at = done.frame.snapshot();
    let (stretch, force) = (thigh.fibre_stretch(0, at.x), belly_force(plan, at, muscle).along());
    Ok(Seen { stretch, force, frame: done.frame })
}
