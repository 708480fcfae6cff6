//! Who carries what the joints have to: the sharing problem of every frame, and its solution ([`share`]).

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::loads::Loads;
use crate::model::{Ankle, KneeKind, Model};
use crate::sharing::{
    Capacity, MuscleCost, Names, Reaction, ReactionCost, SHEAR, Sharing, SharingError, SharingOptions,
    SharingProblem, extremes, muscle_weights, reactions, share_frames,
};
use crate::trial::{Effort, Motion, Status, Table, Verdict};

/// How forces are shared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharingSettings {
    /// What tensions cost.
    pub muscle_cost: MuscleCost,
    /// What joint forces cost: nothing (condition 1) or the published weights (condition 2).
    pub reaction_cost: ReactionCost,
    /// Whether the capacity bounds the tensions from above. The published form has no upper bounds.
    pub bounded: bool,
    /// Reserve moments on every coordinate: weight of their squares \[1/(N·m)²\]. `None`: no reserves.
    pub reserves: Option<f64>,
    /// Further options of the solver.
    pub options: SharingOptions,
}

impl Default for SharingSettings {
    /// Condition 2 bounded by strength.
    fn default() -> Self {
        SharingSettings {
            muscle_cost: MuscleCost::Force,
            reaction_cost: ReactionCost::Table,
            bounded: true,
            reserves: None,
            options: SharingOptions::default(),
        }
    }
}

/// Names of rows and columns of the sharing problem of a model.
pub fn names(model: &Model) -> Names {
    Names {
        coordinates: model.coordinate_names(),
        muscles: model.muscles.iter().map(|m| m.name.clone()).collect(),
        reactions: model.reaction_names(),
    }
}

/// Weights and bounds of the joint forces of a model, in the order of their rows.
pub fn reactions_of(model: &Model) -> Vec<Reaction> {
    let mut table = reactions(model.ankle == Ankle::Parallel);
    if model.knee == KneeKind::Implant {
        for reaction in &mut table {
            match reaction.name {
                "acl" => *reaction = SHEAR[0],
                "pcl" => *reaction = SHEAR[1],
                "mcl" => *reaction = SHEAR[2],
                _ => {}
            }
        }
    }
    table
}

/// The sharing problem of one reported frame, in which the muscles have this `capacity`; `None` where the loads are unknown.
pub fn problem(
    model: &Model,
    loads: &Loads,
    frame: usize,
    capacity: &Capacity,
    settings: &SharingSettings,
) -> Option<SharingProblem> {
    let reduced = loads.reduced[frame].as_ref()?;
    let n = model.muscles.len();
    let l_opt: Vec<f64> = model.muscles.iter().map(|m| m.l_opt).collect();
    let table = reactions_of(model);
    let mut R = reduced.lever_arms.clone();
    for given in &capacity.lever_arms {
        R[(given.coordinate, given.muscle)] = given.arm;
    }
    let most = |i: usize| if settings.bounded { capacity.bounds[i][1] } else { f64::INFINITY };
    Some(SharingProblem {
        R,
        tau: reduced.moments.clone(),
        x0: reduced.reaction_without.clone(),
        X: reduced.reaction_per_force.clone(),
        lower_f: DVector::from_fn(n, |i, _| capacity.bounds[i][0]),
        upper_f: DVector::from_fn(n, |i, _| most(i)),
        lower_x: DVector::from_iterator(table.len(), table.iter().map(|r| r.lower)),
        upper_x: DVector::from_element(table.len(), f64::INFINITY),
        w_f: muscle_weights(settings.muscle_cost, capacity, &l_opt),
        w_x: DVector::from_iterator(
            table.len(),
            table.iter().map(|r| match settings.reaction_cost {
                ReactionCost::None => 0.0,
                ReactionCost::Table => r.weight,
            }),
        ),
        w_s: settings.reserves.map(|w| DVector::from_element(reduced.moments.len(), w)),
    })
}

/// Shares the loads of every reported frame, in all of which the muscles have this `capacity`; activations are left at zero (`muscle::hill` fills them).
pub fn share(
    model: &Model,
    motion: &Motion,
    loads: &Loads,
    capacity: &Capacity,
    settings: &SharingSettings,
) -> Result<Effort, SharingError> {
    share_each(model, motion, loads, |_| capacity, settings)
}

/// The same with the capacity of each reported frame.
pub fn share_each<'a>(
    model: &Model,
    motion: &Motion,
    loads: &Loads,
    capacity: impl Fn(usize) -> &'a Capacity + Sync,
    settings: &SharingSettings,
) -> Result<Effort, SharingError> {
    let names = names(model);
    let known: Vec<usize> = (0..loads.time.len()).filter(|&k| loads.reduced[k].is_some()).collect();
    let solved = share_frames(known.len(), &names, settings.options, |k| {
        Ok::<_, SharingError>(
            problem(model, loads, known[k], capacity(known[k]), settings).expect("loads are known"),
        )
    })?;
    let n = loads.time.len();
    let mut frames: Vec<Option<Sharing>> = vec![None; n];
    for (k, sharing) in known.into_iter().zip(solved) {
        frames[k] = Some(sharing);
    }
    let table_of = |status: Status, columns: &[String], row: &dyn Fn(&Sharing) -> Vec<f64>| {
        let mut values = DMatrix::from_element(n, columns.len(), f64::NAN);
        for (k, frame) in frames.iter().enumerate() {
            if let Some(frame) = frame.as_ref().filter(|f| f.verdict.status == status) {
                values.row_mut(k).copy_from_slice(&row(frame));
            }
        }
        Table { columns: columns.to_vec(), values }
    };
    let table = |columns: &[String], row: fn(&Sharing) -> &DVector<f64>| {
        table_of(Status::Solved, columns, &|s| row(s).as_slice().to_vec())
    };
    let all = [names.muscles.as_slice(), names.reactions.as_slice()].concat();
    let least_violation = table_of(Status::Infeasible, &all, &|s| [s.f.as_slice(), s.x.as_slice()].concat());
    let reserve_columns = if settings.reserves.is_some() { names.coordinates.as_slice() } else { &[] };
    let reserves = match settings.reserves {
        Some(_) => table(reserve_columns, |s| &s.s),
        None => Table { columns: Vec::new(), values: DMatrix::zeros(n, 0) },
    };
    let verdicts = frames
        .iter()
        .enumerate()
        .map(|(k, frame)| match frame {
            Some(frame) => frame.verdict.clone(),
            None => unknown_loads(motion, motion.report.start + k),
        })
        .collect();
    let forces = table(&names.muscles, |s| &s.f);
    let activations =
        Table { columns: names.muscles.clone(), values: DMatrix::zeros(n, names.muscles.len()) };
    Ok(Effort {
        time: loads.time.clone(),
        reactions: table(&names.reactions, |s| &s.x),
        forces,
        activations,
        reserves,
        least_violation,
        verdicts,
    })
}

/// What [`bands`] are about, in the order of their columns: each has a `_least` and a `_greatest`.
pub const BAND_NAMES: [&str; 5] = ["knee_medial", "knee_lateral", "knee_total", "hip", "ankle"];

/// Least and greatest joint forces \[N\] over all tensions that carry the moments within all bounds, whatever they cost: columns
/// `knee_medial_least`, `knee_medial_greatest` and so on ([`BAND_NAMES`]), a row per reported frame; NaN in frames that are not solved.
///
/// Hip and ankle forces are vectors, and the length of a vector is no linear function: their bands are of the component along the force
/// that was found. Reserves stay as they were found.
pub fn bands<'a>(
    model: &Model,
    loads: &Loads,
    capacity: impl Fn(usize) -> &'a Capacity + Sync,
    settings: &SharingSettings,
    effort: &Effort,
) -> Table {
    let names = model.reaction_names();
    let at = |name: &str| names.iter().position(|n| n == name).expect("a reaction of every leg");
    let (medial, lateral) = (at("knee_medial"), at("knee_lateral"));
    let vectors = ["hip", "ankle"].map(|joint| ["x", "y", "z"].map(|axis| at(&format!("{joint}_{axis}"))));
    let columns =
        BAND_NAMES.iter().flat_map(|name| ["least", "greatest"].map(|end| format!("{name}_{end}"))).collect();
    let frames: Vec<usize> = (0..loads.time.len()).collect();
    let rows: Vec<Vec<f64>> = frames
        .par_iter()
        .map(|&frame| {
            let unknown = vec![f64::NAN; 2 * BAND_NAMES.len()];
            let is_solved = effort.verdicts[frame].status == Status::Solved;
            let posed = is_solved.then(|| problem(model, loads, frame, capacity(frame), settings)).flatten();
            let Some(posed) = posed else { return unknown };
            let row = |table: &Table| table.values.row(frame).transpose();
            let (f, x) = (row(&effort.forces), row(&effort.reactions));
            let s = if effort.reserves.columns.is_empty() {
                DVector::zeros(posed.n_coordinates())
            } else {
                row(&effort.reserves)
            };
            let one = |parts: &[(usize, f64)]| {
                let mut w = DVector::zeros(x.len());
                parts.iter().for_each(|&(j, part)| w[j] = part);
                w
            };
            let along = |axes: &[usize; 3]| {
                let length = axes.map(|j| x[j] * x[j]).iter().sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
                one(&axes.map(|j| (j, x[j] / length)))
            };
            let objectives = [
                one(&[(medial, 1.0)]),
                one(&[(lateral, 1.0)]),
                one(&[(medial, 1.0), (lateral, 1.0)]),
                along(&vectors[0]),
                along(&vectors[1]),
            ];
            extremes(&posed, &f, &s, &objectives).concat()
        })
        .collect();
    let values = DMatrix::from_fn(rows.len(), 2 * BAND_NAMES.len(), |k, j| rows[k][j]);
    Table { columns, values }
}

fn unknown_loads(motion: &Motion, frame: usize) -> Verdict {
    let reason = motion.fit[frame].failure.clone();
    Verdict {
        status: Status::Failed,
        reason: Some(reason.unwrap_or_else(|| "the joints are locked in this posture".into())),
        kkt_residual: f64::NAN,
        equality_residual: f64::NAN,
        iterations: 0,
        active_bounds: 0,
        reserve_share: f64::NAN,
        shortfall: Vec::new(),
        saturated: Vec::new(),
    }
}
