//! Fibres of a comparison: which law they have, how they are calibrated, and which controls drive them at the steps.

#![allow(non_snake_case)]

pub mod alone;
pub mod cache;
pub mod hill_calibration;
pub mod matrix_factor;
pub mod muscle_unit;
pub mod thermal_calibration;

use fem::solve::Settings;
use multibody::model::Model;
use multibody::muscle::hill;

use crate::comparison::compare::{CompareError, wanted};
use crate::fibres::cache::Cache;
use crate::fibres::hill_calibration::{Calibrated, Posture, calibrate_hill, with_laws};
use crate::fibres::matrix_factor::{MatrixFactor, matrix_factors, soften};
use crate::fibres::muscle_unit::{Fit, MuscleUnit};
use crate::fibres::thermal_calibration::{CalibrationError, FibreCurve, calibrate};
use crate::number::short;
use crate::scene::{Fibres, StressFree};
use crate::steps::{RigidStep, rigid_muscles_at, rigid_muscles_standing};
use crate::thigh::build::Thigh;
use crate::thigh::registration::Registration;

/// Hip and knee flexion \[degrees\] in which calibrated muscles are looked at; no gait step has them.
const POSTURES: [[f64; 2]; 2] = [[-10.0, 10.0], [15.0, 40.0]];

/// What a calibration found.
#[derive(Default)]
pub struct Calibration {
    /// Of embedded muscles.
    pub matrix: Vec<MatrixFactor>,
    /// Of the fibres.
    pub fibres: FibreCalibration,
}

/// What a calibration found of the fibres.
#[derive(Default)]
pub enum FibreCalibration {
    /// There are none.
    #[default]
    None,
    /// Thermal fibres: force over contraction, per muscle.
    Thermal(Vec<FibreCurve>),
    /// Hill fibres.
    Hill {
        /// Per muscle.
        muscles: Vec<Calibrated>,
        /// The units in the posture of the mesh, per muscle.
        units: Vec<MuscleUnit>,
        /// How many times longer than the generic leg that of the mesh is.
        scale: f64,
    },
}

/// What a calibration found, as it is written down: read back, nothing is computed.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WrittenCalibration {
    /// Of embedded muscles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub matrix: Vec<MatrixFactor>,
    /// Of Hill fibres, per muscle.
    pub hill: Vec<Calibrated>,
    /// Of thermal fibres, per muscle.
    pub thermal: Vec<FibreCurve>,
}

impl Calibration {
    /// What has to be written down of it.
    pub fn written(&self) -> WrittenCalibration {
        let matrix = self.matrix.clone();
        match &self.fibres {
            FibreCalibration::None => WrittenCalibration { matrix, ..Default::default() },
            FibreCalibration::Thermal(curves) => {
                WrittenCalibration { matrix, thermal: curves.clone(), ..Default::default() }
            }
            FibreCalibration::Hill { muscles, .. } => {
                WrittenCalibration { matrix, hill: muscles.clone(), ..Default::default() }
            }
        }
    }
}

/// A thigh whose fibres are ready for the steps.
pub struct DrivenFibres {
    /// The thigh with the laws of its fibres.
    pub thigh: Thigh,
    /// What was found on the way.
    pub calibration: Calibration,
    /// Per step the control of every muscle: contraction of thermal fibres, isometric activation of Hill fibres.
    pub controls: Vec<Vec<f64>>,
}

/// A thigh without contact whose fibres are to be made ready for steps.
#[derive(Clone, Copy)]
pub struct FibreTask<'a> {
    /// The thigh.
    pub thigh: &'a Thigh,
    /// The rigid leg.
    pub model: &'a Model,
    /// Where the bones of the mesh are.
    pub registration: &'a Registration,
    /// What the rigid leg says of the steps.
    pub steps: &'a [RigidStep],
    /// Posture in which the mesh is free of stress.
    pub stress_free: StressFree,
    /// Law of the fibres.
    pub kind: Fibres,
    /// Calibrated muscles with Hill fibres are looked at in other states too; the calibration does not need it.
    pub check: bool,
}

impl FibreTask<'_> {
    /// Calibrates the matrix of embedded muscles and the fibres, and finds the controls of the steps. What `cache` has is not computed.
    pub fn calibrate(
        &self,
        settings: &Settings,
        cache: Option<&Cache>,
    ) -> Result<DrivenFibres, CompareError> {
        let matrix = matrix_factors(self.thigh, settings, cache)?;
        let mut thigh = self.thigh.clone();
        soften(&mut thigh, &matrix);
        let softened = FibreTask { thigh: &thigh, ..*self };
        let mut driven = match self.kind {
            Fibres::None => Ok(without_fibres(&thigh, self.steps)),
            Fibres::Thermal => thermal(&thigh, self.steps, settings, cache),
            Fibres::Hill => softened.hill(settings, cache),
        }?;
        driven.calibration.matrix = matrix;
        Ok(driven)
    }

    /// [`FibreTask::calibrate`] of a calibration that was written down; `None` where it is not one of these muscles and this kind.
    pub fn as_written(&self, written: WrittenCalibration) -> Option<Result<DrivenFibres, CompareError>> {
        let WrittenCalibration { matrix, hill, thermal: curves } = written;
        let in_grids = self.thigh.scene.embedded.iter().map(|e| (&e.region, e.cell));
        if !in_grids.eq(matrix.iter().map(|m| (&m.muscle, m.cell))) {
            return None;
        }
        let (mut thigh, steps) = (self.thigh.clone(), self.steps);
        soften(&mut thigh, &matrix);
        let driven = match self.kind {
            Fibres::None => Some(Ok(without_fibres(&thigh, steps))),
            Fibres::Thermal => {
                (curves.len() == thigh.muscles.len()).then(|| driven_thermal(&thigh, curves, steps))
            }
            Fibres::Hill => {
                let same = hill.iter().map(|m| &m.muscle).eq(thigh.muscles.iter().map(|m| &m.name));
                let scale = scale(self.registration);
                same.then(|| driven_hill(&thigh, self.units(), scale, hill, steps))
            }
        };
        driven.map(|driven| {
            driven.map(|of| DrivenFibres { calibration: Calibration { matrix, ..of.calibration }, ..of })
        })
    }

    /// The units of its muscles in the posture for which the mesh is taken.
    fn units(&self) -> Vec<MuscleUnit> {
        let names: Vec<&str> = self.thigh.muscles.iter().map(|m| m.name.as_str()).collect();
        units_as_meshed(&names, self.model, self.registration, self.steps, self.stress_free)
    }

    fn hill(&self, settings: &Settings, cache: Option<&Cache>) -> Result<DrivenFibres, CompareError> {
        let FibreTask { thigh, model, registration, .. } = *self;
        let (units, scale) = (self.units(), scale(registration));
        let posture = |[hip, knee]: [f64; 2]| {
            let Q = registration.posture(model, hip.to_radians(), knee.to_radians())?;
            Some(Posture {
                name: format!("hip {}, knee {} degrees", short(hip), short(knee)),
                poses: registration.poses(model, &Q),
                muscles: rigid_muscles_at(model, registration, &Q),
            })
        };
        let look = self.check.then(|| match self.stress_free {
            StressFree::Standing => POSTURES.into_iter().filter_map(posture).collect::<Vec<_>>(),
            StressFree::HeelStrike => Vec::new(),
        });
        let muscles = calibrate_hill(thigh, &units, scale, look.as_deref(), settings, cache)?;
        driven_hill(thigh, units, scale, muscles, self.steps)
    }
}

fn without_fibres(thigh: &Thigh, steps: &[RigidStep]) -> DrivenFibres {
    let controls = vec![vec![0.0; thigh.muscles.len()]; steps.len()];
    DrivenFibres { thigh: thigh.clone(), calibration: Calibration::default(), controls }
}

/// The units of muscles in the posture for which the mesh is taken.
pub fn units_as_meshed(
    muscles: &[&str],
    model: &Model,
    registration: &Registration,
    steps: &[RigidStep],
    stress_free: StressFree,
) -> Vec<MuscleUnit> {
    let meshed = match stress_free {
        StressFree::Standing => rigid_muscles_standing(model, registration),
        StressFree::HeelStrike => steps[0].muscles.clone(),
    };
    let rigid =
        |name: &&str| meshed.iter().find(|r| r.name == **name).expect("every muscle of the thigh has lines");
    muscles.iter().map(|name| MuscleUnit::new(rigid(name), hill::Settings::default().curves)).collect()
}

/// How many times longer than the generic leg that of the mesh is.
pub fn scale(registration: &Registration) -> f64 {
    registration.thigh_length() / multibody::muscle::path::GENERIC_THIGH
}

fn thermal(
    thigh: &Thigh,
    steps: &[RigidStep],
    settings: &Settings,
    cache: Option<&Cache>,
) -> Result<DrivenFibres, CompareError> {
    let forces: Vec<Vec<f64>> = steps.iter().map(|s| wanted(thigh, s)).collect();
    driven_thermal(thigh, calibrate(thigh, &forces, settings, cache)?, steps)
}

fn driven_thermal(
    thigh: &Thigh,
    curves: Vec<FibreCurve>,
    steps: &[RigidStep],
) -> Result<DrivenFibres, CompareError> {
    let forces: Vec<Vec<f64>> = steps.iter().map(|s| wanted(thigh, s)).collect();
    let contraction = |(i, force): (usize, &f64)| {
        curves[i].contraction_for(*force).ok_or_else(|| CalibrationError::TooWeak {
            muscle: thigh.muscles[i].name.clone(),
            wanted: *force,
            reached: curves[i].force.last().copied().unwrap_or(0.0),
            contraction: curves[i].contraction.last().copied().unwrap_or(0.0),
        })
    };
    let of_step = |forces: &Vec<f64>| forces.iter().enumerate().map(contraction).collect::<Result<_, _>>();
    let controls = forces.iter().map(of_step).collect::<Result<_, _>>()?;
    let calibration = Calibration { fibres: FibreCalibration::Thermal(curves), ..Calibration::default() };
    Ok(DrivenFibres { thigh: thigh.clone(), calibration, controls })
}

fn driven_hill(
    thigh: &Thigh,
    units: Vec<MuscleUnit>,
    scale: f64,
    muscles: Vec<Calibrated>,
    steps: &[RigidStep],
) -> Result<DrivenFibres, CompareError> {
    let fits: Vec<Fit> = muscles.iter().map(|m| m.fit).collect();
    let thigh = with_laws(thigh, &units, scale, &fits);
    let mut controls = Vec::new();
    for step in steps {
        let drive = |(muscle, unit): (&crate::thigh::build::ThighMuscle, &MuscleUnit)| {
            let rigid = step.muscle(&muscle.name).expect("every muscle of the thigh has lines");
            unit.drive(rigid).ok_or_else(|| CalibrationError::BeyondHill {
                muscle: muscle.name.clone(),
                wanted: rigid.lines.iter().map(|l| l.hill_force).sum(),
            })
        };
        controls.push(thigh.muscles.iter().zip(&units).map(drive).collect::<Result<Vec<f64>, _>>()?);
    }
    let fibres = FibreCalibration::Hill { muscles, units, scale };
    Ok(DrivenFibres { thigh, calibration: Calibration { fibres, ..Calibration::default() }, controls })
}
