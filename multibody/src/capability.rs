//! What the muscles can do in every reported frame: the greatest force at the length and velocity of the moment, and the force of a muscle
//! at rest, from the Hill model.

#![allow(non_snake_case)]

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::activation::{frame_rate, musculotendon_lengths, units};
use crate::filter::{LowPass, differentiate};
use crate::model::Model;
use crate::muscle::MuscleTendon;
use crate::muscle::hill::{self, EquilibriumError, FibreVelocity, HillError, Settings, Tendon};
use crate::muscle::musculotendon::GenericPosture;
use crate::sharing::Capacity;
use crate::trial::Motion;

/// Which bounds of the tensions follow the state of the muscle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Follows {
    /// The greatest tension is that of full activation at the length and velocity of the moment, not the isometric strength.
    pub greatest: bool,
    /// The least tension is that of the resting muscle, not zero.
    pub least: bool,
}

/// Capacities of the muscles of `model`, one per reported frame. `postures`: of the generic leg, from which lengths come.
pub fn capacities(
    model: &Model,
    motion: &Motion,
    postures: &[GenericPosture],
    settings: &Settings,
    follows: Follows,
) -> Result<Vec<Capacity>, HillError> {
    let units = units(model);
    let lengths = musculotendon_lengths(postures);
    let time: Vec<f64> = motion.report.clone().map(|k| motion.time[k]).collect();
    let velocities = velocities(&lengths, frame_rate(&time), settings.velocity)?;
    let strengths: Vec<f64> = model.muscles.iter().map(|m| m.f_max).collect();
    (0..postures.len())
        .into_par_iter()
        .map(|k| {
            let mut capacity = Capacity::nominal(strengths.clone());
            for (i, unit) in units.iter().enumerate() {
                let force = |v: f64, a: f64| tension(unit, settings, lengths[(k, i)], v, a);
                let bounds = &mut capacity.bounds[i];
                if follows.greatest {
                    bounds[1] = force(velocities[(k, i)], 1.0)?;
                }
                if follows.least {
                    // A muscle that rests stronger than its bound is at its bound.
                    bounds[0] = force(0.0, 0.0)?.min(bounds[1]);
                }
            }
            Ok(capacity)
        })
        .collect()
}

/// Force of a muscle with its tendon \[N\]; none where the path is too short for a taut tendon.
fn tension(unit: &MuscleTendon, settings: &Settings, l: f64, v: f64, a: f64) -> Result<f64, HillError> {
    match settings.tendon {
        Tendon::Rigid => Ok(hill::rigid_tendon_force(unit, &settings.curves, l, v, a)),
        Tendon::Elastic => match hill::equilibrium(unit, &settings.curves, l, v, a) {
            Ok(found) => Ok(found.force.max(0.0)),
            Err(EquilibriumError::Slack { .. }) => Ok(0.0),
            // As activations have it: the fibre is not shorter than they count it.
            Err(EquilibriumError::FibreTooShort { .. }) => {
                Ok(hill::shortest_fibre_force(unit, &settings.curves, v, a))
            }
            Err(other) => Err(other.into()),
        },
    }
}

/// Velocities of the muscles with their tendons \[m/s\], lengthening positive.
fn velocities(lengths: &DMatrix<f64>, rate: f64, velocity: FibreVelocity) -> Result<DMatrix<f64>, HillError> {
    let mut out = DMatrix::zeros(lengths.nrows(), lengths.ncols());
    let filter = match velocity {
        FibreVelocity::Isometric => return Ok(out),
        FibreVelocity::Differences => None,
        // Frames too slow to hold anything that the filter would remove.
        FibreVelocity::LowPass { cutoff_hz } if cutoff_hz >= 0.5 * rate => None,
        FibreVelocity::LowPass { cutoff_hz } => {
            Some(LowPass::new(cutoff_hz, rate).ok_or(HillError::Cutoff { cutoff_hz, rate })?)
        }
    };
    for (i, column) in lengths.column_iter().enumerate() {
        let l: Vec<f64> = column.iter().copied().collect();
        let smooth = filter.as_ref().map_or_else(|| l.clone(), |filter| filter.apply(&l));
        out.column_mut(i).copy_from_slice(&differentiate(&smooth, 1.0 / rate));
    }
    Ok(out)
}
