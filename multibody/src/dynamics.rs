//! Generalised loads of the leg: G Q̈ − P − R on the 48 coordinates of foot, shank, patella and thigh.

#![allow(non_snake_case)]

use nalgebra::{SVector, Vector3};

use crate::filter::LowPass;
use crate::model::Model;
use crate::natural::{Coordinates, SegmentId, block};
use crate::trial::{Filters, GroundReaction};

/// Leg coordinates: 4 segments × 12.
pub const N_LEG: usize = 48;
/// A generalised force on the leg coordinates.
pub type LegForce = SVector<f64, N_LEG>;
/// Gravity in ground \[m/s²\].
pub const GRAVITY: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

/// Force and moment of the ground on the foot at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundLoad {
    /// Force \[N\].
    pub force: Vector3<f64>,
    /// Moment about the origin of ground \[N·m\].
    pub moment: Vector3<f64>,
}

impl GroundLoad {
    /// Centre of pressure on the floor Y = 0 \[m\]; zero without contact.
    pub fn centre_of_pressure(&self) -> Vector3<f64> {
        if self.force.y == 0.0 {
            return Vector3::zeros();
        }
        Vector3::new(self.moment.z / self.force.y, 0.0, -self.moment.x / self.force.y)
    }

    /// Moment about the centre of pressure \[N·m\]: its Y component; what is below round-off of the moment is zero.
    pub fn free_moment(&self) -> Vector3<f64> {
        let free = self.moment - self.centre_of_pressure().cross(&self.force);
        let y = if free.y.abs() > 1e-12 * self.moment.norm() { free.y } else { 0.0 };
        if self.force.y == 0.0 { Vector3::zeros() } else { Vector3::new(0.0, y, 0.0) }
    }
}

/// Ground loads at `times`: force and moment about the fixed origin are low-passed at their own rate, then interpolated;
/// below the contact threshold they are zero.
pub fn ground_loads(ground: &GroundReaction, times: &[f64], filters: &Filters) -> Vec<GroundLoad> {
    let n = ground.time.len();
    if n < 2 {
        return vec![GroundLoad::default(); times.len()];
    }
    let rate = (n - 1) as f64 / (ground.time[n - 1] - ground.time[0]);
    let low_pass = filters.force_hz.and_then(|hz| LowPass::new(hz, rate));
    let smooth = |series: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        let Some(filter) = &low_pass else { return series.to_vec() };
        let parts: Vec<Vec<f64>> =
            (0..3).map(|c| filter.apply(&series.iter().map(|v| v[c]).collect::<Vec<_>>())).collect();
        (0..n).map(|k| Vector3::new(parts[0][k], parts[1][k], parts[2][k])).collect()
    };
    let (force, moment) = (smooth(&ground.force), smooth(&ground.moment));
    times
        .iter()
        .map(|&t| {
            let after = ground.time.partition_point(|&s| s <= t).clamp(1, n - 1);
            let (t0, t1) = (ground.time[after - 1], ground.time[after]);
            let fraction = ((t - t0) / (t1 - t0)).clamp(0.0, 1.0);
            let at = |series: &[Vector3<f64>]| series[after - 1].lerp(&series[after], fraction);
            let load = GroundLoad { force: at(&force), moment: at(&moment) };
            if load.force.y.abs() < filters.contact_threshold { GroundLoad::default() } else { load }
        })
        .collect()
}

/// G Q̈ − P − R.
pub fn leg_load(model: &Model, Q: &Coordinates, Qdd: &Coordinates, ground: &GroundLoad) -> LegForce {
    let mut load = LegForce::zeros();
    for (segment, inertia) in SegmentId::ALL.iter().zip(&model.inertia) {
        for a in 0..4 {
            let row = segment.block(a);
            let force: Vector3<f64> = (0..4).map(|b| inertia.G[(a, b)] * block(Qdd, segment.block(b))).sum();
            add(&mut load, row, &force);
        }
        for &(b, k) in &inertia.centre.terms {
            add(&mut load, b, &(-k * inertia.mass * GRAVITY));
        }
    }
    let ankle = block(Q, SegmentId::Foot.block(1));
    let moment = ground.moment - ankle.cross(&ground.force);
    add_wrench(&mut load, Q, SegmentId::Foot, &-ground.force, &-moment);
    load
}

fn add(load: &mut LegForce, block: usize, force: &Vector3<f64>) {
    let mut part = load.fixed_rows_mut::<3>(3 * block);
    part += force;
}

/// Adds a force at rP and a moment as generalised forces: N_Pᵀ F + N*ᵀ M (README of the model, section 3). How a moment splits
/// over the blocks decides which part the bone carries axially.
pub fn add_wrench(
    load: &mut LegForce,
    Q: &Coordinates,
    segment: SegmentId,
    force: &Vector3<f64>,
    moment: &Vector3<f64>,
) {
    let [u, rP, rD, w] = [0, 1, 2, 3].map(|k| block(Q, segment.block(k)));
    let v = rP - rD;
    let B = nalgebra::Matrix3::from_columns(&[w.cross(&u), u.cross(&v), -v.cross(&w)]);
    add(load, segment.block(1), force);
    if let Some(k) = B.lu().solve(moment) {
        add(load, segment.block(0), &(k[1] * v));
        add(load, segment.block(1), &(-k[2] * w));
        add(load, segment.block(2), &(k[2] * w));
        add(load, segment.block(3), &(k[0] * u));
    }
}
