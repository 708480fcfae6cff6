//! Equilibrium of one frame, reduced to what force sharing asks: lever arms and required moments per joint coordinate,
//! and joint contact, ligament and bone forces as affine functions of the muscle forces.
//!
//! Virtual motions of the leg are a turn, a shift and a stretch along v of each of its four segments (28 in all): the motions
//! that leave all rigid-body equations but v·v = L² intact. Their Jacobians are stacked in a square matrix
//! M = [joint equations; axial equations; joint coordinate rates D]. With L f the muscle forces and
//! `load` = G Q̈ − P − R,
//!
//! Mᵀ [λ; τ] = Tᵀ (L f − load):  τ = 0 in equilibrium, λ are the multipliers.
//!
//! So the rows of M⁻ᵀ Tᵀ L that belong to D are the lever arms (moment per tension), those that belong to the equations turn
//! into joint forces per tension. The 23 unwanted multipliers of the publication never appear: they belong to virtual motions that
//! are left out (rigid-body equations) or are dropped (fixed angles).

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Vector3};

use crate::dynamics::LegForce;
use crate::joint::{Equation, Force};
use crate::model::{Ankle, KneeKind, Model};
use crate::muscle::path::knee_angle;
use crate::natural::{Coordinates, N_BLOCKS, SegmentId, block};
use crate::tables::JointTable;
use crate::tangent::Tangent;
use crate::tray;

const LEG: [SegmentId; 4] = [SegmentId::Foot, SegmentId::Shank, SegmentId::Patella, SegmentId::Thigh];
/// Virtual motions per segment: turn (3), shift (3), stretch (1).
const PER_SEGMENT: usize = 7;
const N_VIRTUAL: usize = 28;

/// R f = tau and x = x0 + X f for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// R: n_coordinates × n_muscles, lever arms \[m\].
    pub lever_arms: DMatrix<f64>,
    /// tau: moment that the muscles must supply per joint coordinate \[N·m\].
    pub moments: DVector<f64>,
    /// X: n_reactions × n_muscles, joint force per tension.
    pub reaction_per_force: DMatrix<f64>,
    /// x0: joint forces without muscles \[N\].
    pub reaction_without: DVector<f64>,
    /// dQ/dq of the leg: 48 × n_coordinates \[m/rad\].
    pub tangent: DMatrix<f64>,
}

/// Reduces the equilibrium of a frame; `None` where the joints are locked (singular posture).
pub fn equilibrium(model: &Model, Q: &Coordinates, load: &LegForce) -> Option<Equilibrium> {
    let virtual_motion = VirtualMotion::new(model, Q);
    let n_muscles = model.muscles.len();
    let n_coordinates = N_VIRTUAL - 4 - model.n_joint_rows();
    let M = virtual_motion.jacobian(model, Q);

    let fe = knee_angle(&model.shapes, Q);
    let mut columns = DMatrix::zeros(N_VIRTUAL, n_muscles + 1);
    for (c, muscle) in model.muscles.iter().enumerate() {
        // Pelvis coordinates are prescribed: forces on them do no virtual work.
        muscle.unit_force(Q, fe, |b, force| virtual_motion.reduce(b, &force, &mut columns, c));
    }
    for b in 0..16 {
        let force = Vector3::from(load.fixed_rows::<3>(3 * b));
        virtual_motion.reduce(b, &force, &mut columns, n_muscles);
    }
    let lu = M.clone().lu();
    let mut tangent = DMatrix::zeros(N_VIRTUAL, n_coordinates);
    for k in 0..n_coordinates {
        tangent[(N_VIRTUAL - n_coordinates + k, k)] = 1.0;
    }
    if !lu.solve_mut(&mut tangent) || !M.transpose().lu().solve_mut(&mut columns) {
        return None;
    }
    if !columns.iter().all(|v| v.is_finite()) {
        return None;
    }

    let first = N_VIRTUAL - n_coordinates;
    let mut reactions = wanted(model, Q, &columns);
    if model.knee == KneeKind::Implant {
        tray::bear(model, Q, &model.reaction_names(), &mut reactions);
    }
    Some(Equilibrium {
        lever_arms: columns.view((first, 0), (n_coordinates, n_muscles)).into_owned(),
        moments: columns.view((first, n_muscles), (n_coordinates, 1)).column(0).into_owned(),
        reaction_per_force: reactions.columns(0, n_muscles).into_owned(),
        reaction_without: -reactions.column(n_muscles),
        tangent: virtual_motion.expand(&tangent),
    })
}

/// Turn, shift and stretch of each leg segment as changes of its blocks.
struct VirtualMotion {
    arms: [Vector3<f64>; N_BLOCKS],
    origins: [f64; N_BLOCKS],
    /// Direction of δv per segment: normal to u and w, along v; only rD moves (by minus this).
    stretch: [Vector3<f64>; 4],
}

impl VirtualMotion {
    fn new(model: &Model, Q: &Coordinates) -> Self {
        let Tangent { arms, origins, .. } = Tangent::new(model, Q);
        let stretch = LEG.map(|s| {
            let [u, rP, rD, w] = [0, 1, 2, 3].map(|k| block(Q, s.block(k)));
            let d = u.cross(&w).normalize();
            d * d.dot(&(rP - rD)).signum()
        });
        VirtualMotion { arms, origins, stretch }
    }

    /// Adds Tᵀ of a force on block `b` to column `c`.
    fn reduce(&self, b: usize, force: &Vector3<f64>, columns: &mut DMatrix<f64>, c: usize) {
        if b >= 16 {
            return;
        }
        let base = PER_SEGMENT * (b / 4);
        let turn = self.arms[b].cross(force);
        for k in 0..3 {
            columns[(base + k, c)] += turn[k];
            columns[(base + 3 + k, c)] += self.origins[b] * force[k];
        }
        if b % 4 == 2 {
            columns[(base + 6, c)] -= self.stretch[b / 4].dot(force);
        }
    }

    /// T times columns of virtual motions: 48 rows.
    fn expand(&self, motions: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(48, motions.ncols());
        for c in 0..motions.ncols() {
            for b in 0..16 {
                let base = PER_SEGMENT * (b / 4);
                let part = |k: usize| Vector3::from(motions.fixed_view::<3, 1>(base + k, c));
                let mut v = part(0).cross(&self.arms[b]) + self.origins[b] * part(3);
                if b % 4 == 2 {
                    v -= motions[(base + 6, c)] * self.stretch[b / 4];
                }
                out.fixed_view_mut::<3, 1>(3 * b, c).copy_from(&v);
            }
        }
        out
    }

    /// M: joint equations, axial equations, joint coordinate rates, on the 28 virtual motions.
    fn jacobian(&self, model: &Model, Q: &Coordinates) -> DMatrix<f64> {
        // Transposed while filling, because `reduce` works on columns.
        let mut M = DMatrix::zeros(N_VIRTUAL, N_VIRTUAL);
        let mut row = 0;
        for equation in &model.equations {
            equation.jacobian(Q, &mut |k, b, d| self.reduce(b, &d, &mut M, row + k));
            row += equation.n_rows();
        }
        for segment in LEG {
            let v = block(Q, segment.block(1)) - block(Q, segment.block(2));
            self.reduce(segment.block(1), &(2.0 * v), &mut M, row);
            self.reduce(segment.block(2), &(-2.0 * v), &mut M, row);
            row += 1;
        }
        for (distal, proximal, axis) in rates(model, Q) {
            for k in 0..3 {
                M[(PER_SEGMENT * distal.index() + k, row)] += axis[k];
                if proximal != SegmentId::Pelvis {
                    M[(PER_SEGMENT * proximal.index() + k, row)] -= axis[k];
                }
            }
            row += 1;
        }
        M.transpose()
    }
}

/// Joint coordinate rates as axis · (ω_distal − ω_proximal), in the order of `Model::coordinate_names`.
///
/// Hip: about the axes of the thigh (Z flexion, X adduction, Y internal rotation), which never coincide. Knee: about −Z of the
/// thigh. Ankle: about the talocrural and subtalar axes, each measured with the other one still.
fn rates(model: &Model, Q: &Coordinates) -> Vec<(SegmentId, SegmentId, Vector3<f64>)> {
    use SegmentId::{Foot, Pelvis, Shank, Thigh};
    let thigh = model.pose(Thigh, Q).R;
    let axis = |k: usize| Vector3::from(thigh.column(k));
    let mut rows = vec![
        (Thigh, Pelvis, axis(2)),
        (Thigh, Pelvis, axis(0)),
        (Thigh, Pelvis, axis(1)),
        (Shank, Thigh, -axis(2)),
    ];
    let shank = model.pose(Shank, Q).R;
    match model.ankle {
        Ankle::Parallel => rows.push((Foot, Shank, shank.column(2).into())),
        Ankle::Universal => {
            let table = JointTable::built_in();
            let talocrural = shank * table.point("ankle_universal", "talocrural axis").normalize();
            let subtalar =
                model.pose(Foot, Q).R * table.point("ankle_universal", "subtalar axis").normalize();
            let cosine = talocrural.dot(&subtalar);
            let dual = |a: Vector3<f64>, b: Vector3<f64>| (a - cosine * b) / (1.0 - cosine * cosine);
            rows.push((Foot, Shank, dual(talocrural, subtalar)));
            rows.push((Foot, Shank, dual(subtalar, talocrural)));
        }
    }
    rows
}

/// Wanted forces from the multipliers in `columns`: contacts on the proximal segment (push positive) in the axes of the distal
/// one, tensions, axial compressions.
fn wanted(model: &Model, Q: &Coordinates, columns: &DMatrix<f64>) -> DMatrix<f64> {
    let n = model.reaction_names().len();
    let mut out = DMatrix::zeros(n, columns.ncols());
    let (mut row, mut x) = (0, 0);
    for equation in &model.equations {
        match equation {
            Equation::Coincide { distal, .. } => {
                let R = model.pose(*distal, Q).R;
                out.rows_mut(x, 3).copy_from(&(-(R.transpose() * columns.rows(row, 3))));
                x += 3;
            }
            Equation::Product { force, .. } => {
                let factor = match force {
                    Force::None => None,
                    Force::Contact(_) => Some(-1.0),
                    Force::Tension(_, d) => Some(2.0 * d),
                };
                if let Some(factor) = factor {
                    out.row_mut(x).copy_from(&(factor * columns.row(row)));
                    x += 1;
                }
            }
        }
        row += equation.n_rows();
    }
    for segment in LEG {
        let L = model.shapes[segment.index()].L;
        out.row_mut(x).copy_from(&(-2.0 * L * columns.row(row)));
        row += 1;
        x += 1;
    }
    out
}
