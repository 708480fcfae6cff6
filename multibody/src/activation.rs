//! From shared forces to Hill-type activations: lengths of the full muscle-tendon paths from the joint angles, then the
//! inverse of the Hill model.

#![allow(non_snake_case)]

use nalgebra::DMatrix;

use crate::model::{FLAT_FOOT, Model};
use crate::muscle::MuscleTendon;
use crate::muscle::hill::{self, FibreVelocity, HillError, HillResult, Settings};
use crate::muscle::musculotendon::{GenericPosture, MusculotendonModel};
use crate::natural::SegmentId;
use crate::trial::{Effort, Motion};

/// Joint coordinates of the generic leg (gait2392) in every reported frame.
///
/// Lengths come from the generic leg at the subject's joint angles, with the fibre and tendon lengths of the generic leg
/// (as OpenSim takes them from gait2392). Hip and knee frames of the two models agree within a degree. A foot frame from shoe markers does
/// not say where the ankle is neutral, so its level is set where the foot is flat (15 to 45 % of the reported
/// frames): there dorsiflexion is the forward lean of the shank and the subtalar joint is neutral, in the mean.
pub fn generic_postures(model: &Model, motion: &Motion) -> Vec<GenericPosture> {
    let frames: Vec<usize> = motion.report.clone().collect();
    let column = |name: &str| {
        let c = motion.angles.columns.iter().position(|c| c == name).expect("kinematics names its angles");
        frames.iter().map(|&k| motion.angles.values[(k, c)]).collect::<Vec<f64>>()
    };
    let n = frames.len() as f64;
    let flat: Vec<usize> = (0..frames.len()).filter(|&k| FLAT_FOOT.contains(&(k as f64 / n))).collect();
    let mean = |values: &[f64]| {
        if flat.is_empty() {
            return 0.0;
        }
        flat.iter().map(|&k| values[k]).sum::<f64>() / flat.len() as f64
    };
    let lean: Vec<f64> = frames
        .iter()
        .map(|&k| {
            let long_axis = model.pose(SegmentId::Shank, &motion.Q[k]).R.column(1).into_owned();
            long_axis.x.atan2(long_axis.y)
        })
        .collect();
    let (ankle, inversion) = (column("ankle_flexion"), column("ankle_inversion"));
    let ankle_level = mean(&lean) - mean(&ankle);
    let subtalar_level = -mean(&inversion);
    let (flexion, adduction) = (column("hip_flexion"), column("hip_adduction"));
    let (rotation, knee) = (column("hip_rotation"), column("knee_flexion"));
    (0..frames.len())
        .map(|k| GenericPosture {
            hip_flexion: flexion[k],
            hip_adduction: adduction[k],
            hip_rotation: rotation[k],
            knee_flexion: knee[k],
            ankle_dorsiflexion: ankle[k] + ankle_level,
            subtalar: inversion[k] + subtalar_level,
        })
        .collect()
}

/// Lengths of the muscles with their tendons \[m\] in the generic leg, a row per posture.
pub fn musculotendon_lengths(postures: &[GenericPosture]) -> DMatrix<f64> {
    let generic = MusculotendonModel::generic();
    let mut lengths = DMatrix::zeros(postures.len(), generic.units.len());
    for (k, posture) in postures.iter().enumerate() {
        for (m, length) in generic.lengths(posture).into_iter().enumerate() {
            lengths[(k, m)] = length;
        }
    }
    lengths
}

/// Frames per second; 1 where there is one frame alone.
pub fn frame_rate(time: &[f64]) -> f64 {
    let n = time.len();
    if n > 1 { (n - 1) as f64 / (time[n - 1] - time[0]) } else { 1.0 }
}

/// Parameters of the generic muscles with the strengths of `model`.
pub fn units(model: &Model) -> Vec<MuscleTendon> {
    let generic = &MusculotendonModel::generic().units;
    generic
        .iter()
        .zip(&model.muscles)
        .map(|(unit, m)| MuscleTendon { f_max: m.f_max, ..unit.clone() })
        .collect()
}

/// Fills the activations of `effort` and returns what the Hill model says beside them.
pub fn activate(
    model: &Model,
    motion: &Motion,
    effort: &mut Effort,
    settings: &Settings,
) -> Result<HillResult, HillError> {
    let lengths = musculotendon_lengths(&generic_postures(model, motion));
    let rate = frame_rate(&effort.time);
    let mut settings = *settings;
    if let FibreVelocity::LowPass { cutoff_hz } = settings.velocity
        && cutoff_hz >= 0.5 * rate
    {
        // The frames are too slow to hold anything that the filter would remove.
        settings.velocity = FibreVelocity::Differences;
    }
    let result = hill::activations(&units(model), &lengths, &effort.forces.values, rate, &settings)?;
    effort.activations.values.copy_from(&result.activation);
    Ok(result)
}
