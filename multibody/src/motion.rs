//! From markers to motion: fit, differentiate, filter, project on the joint equations.

#![allow(non_snake_case)]

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::filter::{LowPass, differentiate};
use crate::ik;
use crate::kinematics::{ANGLES, joint_angles, unwrap};
use crate::model::Model;
use crate::natural::{Coordinates, N_COORDINATES};
use crate::tangent::Tangent;
use crate::trial::{Filters, Motion, Table, Trial};

/// Fits the markers and derives velocity and acceleration: Q is differentiated, low-passed after each
/// differentiation, then projected so that K Q̇ = 0 and K Q̈ = −K̇ Q̇ (Moissenet et al. 2012).
pub fn track(model: &Model, trial: &Trial, filters: &Filters) -> Motion {
    let frames = ik::fit(model, trial);
    let Q: Vec<Coordinates> = frames.iter().map(|f| f.Q).collect();
    let fit = frames.into_iter().map(|f| f.verdict).collect();
    let (Qd, Qdd) = derivatives(model, &Q, &trial.time, filters);
    let mut angles = DMatrix::zeros(Q.len(), ANGLES.len());
    for (k, q) in Q.iter().enumerate() {
        for (c, angle) in joint_angles(&model.shapes, q).into_iter().enumerate() {
            angles[(k, c)] = angle;
        }
    }
    unwrap(&mut angles);
    let columns = ANGLES.iter().map(|s| s.to_string()).collect();
    Motion {
        time: trial.time.clone(),
        report: trial.report.clone(),
        Q,
        Qd,
        Qdd,
        angles: Table { columns, values: angles },
        fit,
    }
}

/// Consistent velocities and accelerations of a series of postures at uniform times.
fn derivatives(
    model: &Model,
    Q: &[Coordinates],
    time: &[f64],
    filters: &Filters,
) -> (Vec<Coordinates>, Vec<Coordinates>) {
    let n = Q.len();
    if n < 2 {
        return (vec![Coordinates::zeros(); n], vec![Coordinates::zeros(); n]);
    }
    let step = (time[n - 1] - time[0]) / (n - 1) as f64;
    let low_pass = LowPass::new(filters.motion_hz, 1.0 / step);
    let filtered = |values: Vec<f64>| low_pass.as_ref().map_or_else(|| values.clone(), |f| f.apply(&values));
    let columns: Vec<(Vec<f64>, Vec<f64>)> = (0..N_COORDINATES)
        .into_par_iter()
        .map(|c| {
            let values: Vec<f64> = Q.iter().map(|q| q[c]).collect();
            let first = filtered(differentiate(&values, step));
            let second = filtered(differentiate(&first, step));
            (first, second)
        })
        .collect();
    (0..n)
        .into_par_iter()
        .map(|k| {
            let Qd = Coordinates::from_fn(|c, _| columns[c].0[k]);
            let Qdd = Coordinates::from_fn(|c, _| columns[c].1[k]);
            project(model, &Q[k], &Qd, &Qdd).unwrap_or((Qd, Qdd))
        })
        .unzip()
}

fn project(
    model: &Model,
    Q: &Coordinates,
    Qd: &Coordinates,
    Qdd: &Coordinates,
) -> Option<(Coordinates, Coordinates)> {
    let tangent = Tangent::new(model, Q);
    let (velocity, twists) = tangent.project_velocity(Qd)?;
    Some((velocity, tangent.project_acceleration(Qdd, &twists)?))
}
