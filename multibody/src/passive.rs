//! Passive moments of hip, knee and ankle: what joints and slack muscles resist by themselves.
//!
//! Riener & Edrich, J Biomech 1999;32:539: moments of ten subjects at rest, as functions of the angles of the joint and its neighbours.
//! They hold everything that is passive, muscles included. Angles in degrees, moments in N·m, both positive in flexion of hip and knee
//! and in dorsiflexion (plantarflexion in the publication):
//!
//! ```text
//! M_hip   = exp(1.4655 − 0.0034 k − 0.0750 h) − exp(1.3403 − 0.0226 k + 0.0305 h) + 8.072
//! M_knee  = exp(1.800 + 0.0460 a − 0.0352 k + 0.0217 h) − exp(−3.971 + 0.0004 a + 0.0495 k − 0.0128 h) − 4.820 + exp(2.220 − 0.150 k)
//! M_ankle = exp(−7.9763 − 0.1949 a + 0.0008 k) − exp(2.1016 + 0.0843 a − 0.0176 k) + 1.792
//! ```
//!
//! The publication itself could not be read. Three open implementations of different authors agree in every coefficient of the three formulas, but for one that
//! has 1.50 in place of 0.150 in the last exponential of the knee, a slip: it would make that term vanish within 5 degrees.
//! Exponentials run away: angles outside [`RANGES`] count as those at their ends.
//!
//! Zero is upright standing. The pelvis of a trial is upright in the mean of a gait cycle; its own markers do not say where (in the shipped
//! recordings they read 5 degrees backwards of one subject and 10 degrees forwards of the other).

use nalgebra::DMatrix;

use crate::loads::Loads;
use crate::muscle::musculotendon::GenericPosture;
use crate::sharing::Capacity;
use crate::trial::{Motion, Table};

/// Range of hip flexion, knee flexion and dorsiflexion in which the moments are taken as they stand \[deg\]: that of walking and squatting.
pub const RANGES: [(f64, f64); 3] = [(-25.0, 100.0), (-5.0, 120.0), (-40.0, 30.0)];

/// Coordinates that have a passive moment, as the rigid leg names them.
pub const COORDINATES: [&str; 3] = ["hip_flexion", "knee_flexion", "ankle_flexion"];

/// Passive moments on the [`COORDINATES`] \[N·m\], positive in flexion and dorsiflexion.
pub fn moments(posture: &GenericPosture) -> [f64; 3] {
    let degrees =
        [posture.hip_flexion, posture.knee_flexion, posture.ankle_dorsiflexion].map(f64::to_degrees);
    let [h, k, a] = std::array::from_fn(|j| degrees[j].clamp(RANGES[j].0, RANGES[j].1));
    let e = f64::exp;
    [
        e(1.4655 - 0.0034 * k - 0.0750 * h) - e(1.3403 - 0.0226 * k + 0.0305 * h) + 8.072,
        e(1.800 + 0.0460 * a - 0.0352 * k + 0.0217 * h)
            - e(-3.971 + 0.0004 * a + 0.0495 * k - 0.0128 * h)
            - 4.820
            + e(2.220 - 0.150 * k),
        e(-7.9763 - 0.1949 * a + 0.0008 * k) - e(2.1016 + 0.0843 * a - 0.0176 * k) + 1.792,
    ]
}

/// Mean pelvis tilt of the reported frames \[rad\]: where the pelvis is upright in a gait cycle.
pub fn upright_tilt(motion: &Motion) -> f64 {
    let tilt =
        motion.angles.columns.iter().position(|c| c == "pelvis_tilt").expect("kinematics names its angles");
    let frames = motion.report.clone().filter(|&k| motion.fit[k].failure.is_none());
    let values: Vec<f64> = frames.map(|k| motion.angles.values[(k, tilt)]).collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Takes the passive moments off what the muscles must supply in every reported frame; returns them \[N·m\], a column per coordinate
/// with a passive moment.
///
/// `upright`: pelvis tilt in which the pelvis is upright \[rad\]. `muscles`: tensions that sharing knows to be passive (the lower bounds of
/// its capacities): their moments are part of the measured ones and stay with the muscles, so that nothing counts twice.
pub fn relieve(
    loads: &mut Loads,
    coordinates: &[String],
    postures: &[GenericPosture],
    upright: f64,
    muscles: Option<&[Capacity]>,
) -> Table {
    let columns: Vec<(usize, usize)> = COORDINATES
        .iter()
        .enumerate()
        .filter_map(|(j, name)| Some((j, coordinates.iter().position(|c| c == name)?)))
        .collect();
    let mut values = DMatrix::from_element(postures.len(), columns.len(), f64::NAN);
    for (k, posture) in postures.iter().enumerate() {
        let Some(reduced) = &mut loads.reduced[k] else { continue };
        let from_upright = GenericPosture { hip_flexion: posture.hip_flexion + upright, ..*posture };
        let all = moments(&from_upright);
        for (column, &(j, row)) in columns.iter().enumerate() {
            let arms = reduced.lever_arms.row(row);
            let of_muscles: f64 = muscles.map_or(0.0, |capacity| {
                arms.iter().zip(&capacity[k].bounds).map(|(arm, bounds)| arm * bounds[0]).sum()
            });
            values[(k, column)] = all[j] - of_muscles;
            reduced.moments[row] -= values[(k, column)];
            loads.moments.values[(k, row)] = reduced.moments[row];
        }
    }
    Table { columns: columns.iter().map(|(j, _)| COORDINATES[*j].to_string()).collect(), values }
}
