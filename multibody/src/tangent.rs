//! Motions that the joints allow: turns and shifts of the five segments against the joint equations.
//!
//! A velocity of the leg is a twist per segment (turn ω and shift of rP, in ground), Q̇ = T ξ. T is the tangent of the
//! rigid-body equations, so only the joint equations remain: C ξ = K T ξ = 0.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Matrix6, SVector, Vector3, Vector6};

use crate::ik::local_blocks;
use crate::joint::Equation;
use crate::model::Model;
use crate::natural::{Coordinates, N_BLOCKS, SegmentId, block};

/// Turns and shifts of all segments: (ω, ṗ) per segment.
pub type Twists = SVector<f64, 30>;

/// The tangent at one posture.
pub struct Tangent<'a> {
    model: &'a Model,
    Q: Coordinates,
    /// R ℓ of each block, in ground \[m\].
    pub arms: [Vector3<f64>; N_BLOCKS],
    /// Whether the block moves with the segment's origin.
    pub origins: [f64; N_BLOCKS],
    /// Joint Jacobian on twists, n_rows × 30.
    pub C: DMatrix<f64>,
}

impl<'a> Tangent<'a> {
    /// Tangent at Q.
    pub fn new(model: &'a Model, Q: &Coordinates) -> Tangent<'a> {
        let local = local_blocks(model);
        let poses = SegmentId::ALL.map(|s| model.pose(s, Q));
        let arms: [Vector3<f64>; N_BLOCKS] = std::array::from_fn(|b| poses[b / 4].R * local[b].0);
        let origins = local.map(|l| l.1);
        let mut C = DMatrix::zeros(model.n_joint_rows(), 30);
        let mut row = 0;
        for equation in &model.equations {
            equation.jacobian(Q, &mut |k, b, d| {
                let turn = arms[b].cross(&d);
                for c in 0..3 {
                    C[(row + k, 6 * (b / 4) + c)] += turn[c];
                    C[(row + k, 6 * (b / 4) + 3 + c)] += origins[b] * d[c];
                }
            });
            row += equation.n_rows();
        }
        Tangent { model, Q: *Q, arms, origins, C }
    }

    /// T ξ.
    pub fn expand(&self, twists: &Twists) -> Coordinates {
        let mut Qd = Coordinates::zeros();
        for b in 0..N_BLOCKS {
            let (omega, shift) = self.twist(twists, b);
            Qd.fixed_rows_mut::<3>(3 * b).copy_from(&(omega.cross(&self.arms[b]) + self.origins[b] * shift));
        }
        Qd
    }

    /// Tᵀ g: generalised force on turns and shifts.
    pub fn reduce(&self, g: &Coordinates) -> Twists {
        let mut h = Twists::zeros();
        for b in 0..N_BLOCKS {
            let force = block(g, b);
            let base = 6 * (b / 4);
            let turn = self.arms[b].cross(&force);
            for c in 0..3 {
                h[base + c] += turn[c];
                h[base + 3 + c] += self.origins[b] * force[c];
            }
        }
        h
    }

    fn twist(&self, twists: &Twists, b: usize) -> (Vector3<f64>, Vector3<f64>) {
        let base = 6 * (b / 4);
        (twists.fixed_rows::<3>(base).into(), twists.fixed_rows::<3>(base + 3).into())
    }

    /// The velocity nearest to `Qd` that satisfies the rigid-body and joint equations, K Q̇ = 0
    /// (orthogonal projection on the null space of K), and its twists.
    pub fn project_velocity(&self, Qd: &Coordinates) -> Option<(Coordinates, Twists)> {
        let rhs = DVector::zeros(self.C.nrows());
        let twists = self.nearest(&self.reduce(Qd), &rhs)?;
        Some((self.expand(&twists), twists))
    }

    /// The acceleration nearest to `Qdd` with K Q̈ = −K̇ Q̇, given the twists of the projected velocity.
    pub fn project_acceleration(&self, Qdd: &Coordinates, twists: &Twists) -> Option<Coordinates> {
        let Qd = self.expand(twists);
        // Turning alone accelerates the blocks: ω × (ω × e).
        let mut spin = Coordinates::zeros();
        for b in 0..N_BLOCKS {
            let (omega, _) = self.twist(twists, b);
            spin.fixed_rows_mut::<3>(3 * b).copy_from(&omega.cross(&omega.cross(&self.arms[b])));
        }
        let mut gamma = Vec::with_capacity(self.C.nrows());
        for equation in &self.model.equations {
            match equation {
                Equation::Coincide { gap, .. } => gamma.extend((-gap.at(&spin)).iter()),
                Equation::Product { a, b, .. } => gamma.push(
                    -2.0 * a.at(&Qd).dot(&b.at(&Qd))
                        - a.at(&spin).dot(&b.at(&self.Q))
                        - a.at(&self.Q).dot(&b.at(&spin)),
                ),
            }
        }
        let alpha = self.nearest(&self.reduce(&(Qdd - spin)), &DVector::from_vec(gamma))?;
        Some(self.expand(&alpha) + spin)
    }

    /// min |T ξ − q|² subject to C ξ = rhs, given h = Tᵀ q.
    fn nearest(&self, h: &Twists, rhs: &DVector<f64>) -> Option<Twists> {
        let mut inverses = Vec::with_capacity(5);
        for segment in SegmentId::ALL {
            let mut metric = Matrix6::zeros();
            for which in 0..4 {
                let b = segment.block(which);
                let (e, o) = (self.arms[b], self.origins[b]);
                let turn = nalgebra::Matrix3::identity() * e.norm_squared() - e * e.transpose();
                let cross = o * e.cross_matrix();
                for r in 0..3 {
                    metric[(3 + r, 3 + r)] += o * o;
                    for c in 0..3 {
                        metric[(r, c)] += turn[(r, c)];
                        metric[(r, 3 + c)] += cross[(r, c)];
                        metric[(3 + c, r)] += cross[(r, c)];
                    }
                }
            }
            inverses.push(metric.cholesky()?);
        }
        let solve = |v: &Twists| {
            let mut out = *v;
            for (s, cholesky) in inverses.iter().enumerate() {
                let part: Vector6<f64> = v.fixed_rows::<6>(6 * s).into();
                out.fixed_rows_mut::<6>(6 * s).copy_from(&cholesky.solve(&part));
            }
            out
        };
        let m = self.C.nrows();
        let mut weighted = DMatrix::zeros(30, m);
        for r in 0..m {
            let row = Twists::from_iterator(self.C.row(r).iter().copied());
            weighted.set_column(r, &solve(&row));
        }
        let free = solve(h);
        let mu = (&self.C * &weighted).cholesky()?.solve(&(&self.C * free - rhs));
        Some(free - weighted * mu)
    }
}
