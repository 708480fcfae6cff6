//! From motion and ground reaction to what the joints carry.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, SVector, Vector3};
use rayon::prelude::*;

use crate::dynamics::{GroundLoad, ground_loads, leg_load};
use crate::equilibrium::{Equilibrium, equilibrium};
use crate::model::Model;
use crate::trial::{Filters, Motion, Table, Trial};

/// What the joints have to carry. Rows: reported frames only.
#[derive(Clone, Debug, PartialEq)]
pub struct Loads {
    /// Times of the reported frames \[s\].
    pub time: Vec<f64>,
    /// Generalised load G Q̈ − P − R on the 48 leg coordinates.
    pub generalised: Vec<SVector<f64, 48>>,
    /// Lever arms, required moments and joint forces per tension; `None` where the frame was not fitted or the joints are
    /// locked.
    pub reduced: Vec<Option<Equilibrium>>,
    /// Moment that the muscles must supply per joint coordinate \[N·m\]; columns named like the coordinate.
    pub moments: Table,
    /// Filtered ground force on the foot, in ground \[N\].
    pub ground_force: Vec<Vector3<f64>>,
    /// Centre of pressure, in ground \[m\]; zero where there is no contact.
    pub centre_of_pressure: Vec<Vector3<f64>>,
    /// Free moment about the centre of pressure, in ground \[N·m\].
    pub free_moment: Vec<Vector3<f64>>,
}

/// Loads of the reported frames, reduced to lever arms and required moments.
pub fn loads(model: &Model, motion: &Motion, trial: &Trial, filters: &Filters) -> Loads {
    let frames: Vec<usize> = motion.report.clone().collect();
    let time: Vec<f64> = frames.iter().map(|&k| motion.time[k]).collect();
    let ground = ground_loads(&trial.ground, &time, filters);
    let generalised: Vec<_> = frames
        .iter()
        .zip(&ground)
        .map(|(&k, ground)| leg_load(model, &motion.Q[k], &motion.Qdd[k], ground))
        .collect();
    let reduced: Vec<Option<Equilibrium>> = frames
        .par_iter()
        .zip(&generalised)
        .map(|(&k, load)| match motion.fit[k].failure {
            None => equilibrium(model, &motion.Q[k], load),
            Some(_) => None,
        })
        .collect();
    let columns = model.coordinate_names();
    let mut moments = DMatrix::from_element(frames.len(), columns.len(), f64::NAN);
    for (k, frame) in reduced.iter().enumerate() {
        if let Some(frame) = frame {
            moments.row_mut(k).copy_from(&frame.moments.transpose());
        }
    }
    Loads {
        time,
        generalised,
        reduced,
        moments: Table { columns, values: moments },
        ground_force: ground.iter().map(|g| g.force).collect(),
        centre_of_pressure: ground.iter().map(GroundLoad::centre_of_pressure).collect(),
        free_moment: ground.iter().map(GroundLoad::free_moment).collect(),
    }
}
