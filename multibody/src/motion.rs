//! From markers to motion: fit, differentiate, filter, project on the joint equations.

#![allow(non_snake_case)]

use std::ops::Range;

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::filter::{LowPass, differentiate};
use crate::ik;
use crate::kinematics::{ANGLES, joint_angles, unwrap};
use crate::model::Model;
use crate::natural::{Coordinates, N_COORDINATES};
use crate::tangent::Tangent;
use crate::trial::{Filters, FitVerdict, Motion, Table, Trial};

/// Failed frames are bridged by their interpolated postures where they last no longer than this fraction of a period of the
/// cut-off. On recorded walking, with gaps of 6 to 36 frames at four places, bridging disturbs the joint forces of the fitted
/// frames less than the ends of a cut series do up to this length, and more beyond it.
const BRIDGED_FRACTION: f64 = 0.75;
/// Fitted frames in a row that a second derivative needs.
const LEAST_STRETCH: usize = 3;

/// Fits the markers and derives velocity and acceleration: Q is differentiated, low-passed after each
/// differentiation, then projected so that K Q̇ = 0 and K Q̈ = −K̇ Q̇ (Moissenet et al. 2012).
///
/// Longer gaps cut the series: postures that were not measured must not reach into the accelerations of those that were.
pub fn track(model: &Model, trial: &Trial, filters: &Filters) -> Motion {
    let frames = ik::fit(model, trial);
    let Q: Vec<Coordinates> = frames.iter().map(|f| f.Q).collect();
    let mut fit: Vec<FitVerdict> = frames.into_iter().map(|f| f.verdict).collect();
    let fitted: Vec<bool> = fit.iter().map(|f| f.failure.is_none()).collect();
    let (mut Qd, mut Qdd) = (Vec::with_capacity(Q.len()), Vec::with_capacity(Q.len()));
    for frames in stretches(&fitted, bridged(&trial.time, filters)) {
        let short = frames.len() < LEAST_STRETCH && frames.len() < Q.len();
        for verdict in fit[frames.clone()].iter_mut().filter(|f| short && f.failure.is_none()) {
            verdict.failure = Some("too few fitted frames around this one for an acceleration".into());
        }
        let rates = derivatives(model, &Q[frames.clone()], &trial.time[frames.clone()], filters);
        for (verdict, rates) in fit[frames].iter_mut().zip(rates) {
            if rates.is_none() && verdict.failure.is_none() {
                verdict.failure = Some("the joints are locked in this posture".into());
            }
            let (velocity, acceleration) = rates.unwrap_or((Coordinates::zeros(), Coordinates::zeros()));
            Qd.push(velocity);
            Qdd.push(acceleration);
        }
    }
    caution_beside_gaps(&mut fit, reach(&trial.time, filters));
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

/// Period of the cut-off \[frames\].
fn period(time: &[f64], filters: &Filters) -> f64 {
    let n = time.len();
    if n < 2 {
        return 0.0;
    }
    (n - 1) as f64 / (time[n - 1] - time[0]) / filters.motion_hz
}

/// Longest gap \[frames\] that is bridged.
fn bridged(time: &[f64], filters: &Filters) -> usize {
    (BRIDGED_FRACTION * period(time, filters)) as usize
}

/// Frames on either side of a gap whose accelerations feel it: half a period of the cut-off.
fn reach(time: &[f64], filters: &Filters) -> usize {
    (0.5 * period(time, filters)).ceil() as usize
}

/// Fitted frames beside failed ones say so: their accelerations rest on an interpolated or a cut series.
fn caution_beside_gaps(fit: &mut [FitVerdict], reach: usize) {
    let failed: Vec<usize> = (0..fit.len()).filter(|&k| fit[k].failure.is_some()).collect();
    for &gap in &failed {
        for k in gap.saturating_sub(reach)..(gap + reach + 1).min(fit.len()) {
            if fit[k].failure.is_none() && fit[k].caution.is_none() {
                fit[k].caution = Some("accelerations feel frames nearby that were not fitted".into());
            }
        }
    }
}

/// Frames that are differentiated together: runs of fitted frames with the gaps of up to `bridged` frames between them,
/// and the longer gaps. Together they are all frames, in order.
fn stretches(fitted: &[bool], bridged: usize) -> Vec<Range<usize>> {
    let mut stretches: Vec<(bool, Range<usize>)> = Vec::new();
    let mut start = 0;
    for run in fitted.chunk_by(|a, b| a == b) {
        let end = start + run.len();
        // At the ends of the trial there is nothing to interpolate to.
        let usable = run[0] || (run.len() <= bridged && start > 0 && end < fitted.len());
        match stretches.last_mut() {
            Some((last, frames)) if *last == usable => frames.end = end,
            _ => stretches.push((usable, start..end)),
        }
        start = end;
    }
    stretches.into_iter().map(|(_, frames)| frames).collect()
}

/// Consistent velocities and accelerations of a series of postures at uniform times; `None` where the joints are locked.
fn derivatives(
    model: &Model,
    Q: &[Coordinates],
    time: &[f64],
    filters: &Filters,
) -> Vec<Option<(Coordinates, Coordinates)>> {
    let n = Q.len();
    if n < 2 {
        return vec![Some((Coordinates::zeros(), Coordinates::zeros())); n];
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
            project(model, &Q[k], &Qd, &Qdd)
        })
        .collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_gaps_cut_the_series_and_short_ones_do_not() {
        let fitted = |text: &str| text.chars().map(|c| c == '+').collect::<Vec<_>>();
        assert_eq!(stretches(&fitted("++++-"), 0), [0..4, 4..5]);
        assert_eq!(stretches(&fitted("++--++---+"), 2), [0..6, 6..9, 9..10]);
        assert_eq!(stretches(&fitted("-++-"), 2), [0..1, 1..3, 3..4]);
        assert!(stretches(&fitted(""), 2).is_empty());
    }
}
