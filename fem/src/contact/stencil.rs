//! One term of the contact potential: four points and the barrier of their distance, with exact derivatives.
//!
//! The squared distance is D(x) = min over ξ of |w|², w = Σ cᵢ(ξ) xᵢ ([`Closest`]). At the minimum
//! ∂D/∂xᵢ = 2 cᵢ w (the envelope theorem) and ∂²D/∂xᵢ∂xⱼ = 2 cᵢ cⱼ I − Fᵢ A⁻¹ Fⱼᵀ with Fᵢₖ = ∂²|w|²/∂xᵢ∂ξₖ =
//! 2 (cᵢ Wₖ + ∂ₖcᵢ w), Aₖₗ = 2 Wₖ·Wₗ, Wₖ = ∂w/∂ξₖ (the implicit function theorem).

#![allow(non_snake_case)]

use super::barrier::{barrier, softened};
use crate::element::psd::lift;
use crate::geometry::closest::{Closest, Points, combine};
use nalgebra::{Matrix3, Vector3};

/// Rows of a 12 × 12 matrix over four points.
pub type Matrix12 = [[f64; 12]; 12];

/// How the energy of a term depends on the distance d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// κ A d̂ B(d/d̂) of the [`barrier`] with activation distance d̂ \[m\].
    Barrier(f64),
    /// The same, softened below a fraction `softness` of d̂; `side` is −1 where d is a depth of penetration.
    Soft {
        /// d̂ \[m\].
        reach: f64,
        /// That fraction.
        softness: f64,
        /// 1 outside, −1 inside, or as many times that as it counts as deeper.
        side: f64,
        /// How much deeper it counts \[m\].
        extra: f64,
    },
    /// ½ k d² of a penetration by d.
    Spring,
}

/// A term of the contact potential; of two edges times their mollifier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stencil {
    /// The points, in the numbering of the collision points. Those without weight repeat others.
    pub points: [u32; 4],
    /// Shortest connection.
    pub closest: Closest,
    /// κ A \[N\] of a barrier, k \[N/m\] of a spring; negative where a feature is counted once too often.
    pub scale: f64,
    /// How it depends on the distance.
    pub law: Law,
    /// Two edges: the rest value of (length · length)² \[m⁴\] for the mollifier; zero otherwise.
    pub edges: f64,
}

/// Edges whose squared sine falls below this fraction are mollified (Li et al. 2020, eq. 24).
const PARALLEL: f64 = 1e-3;

impl Stencil {
    /// Distance \[m\].
    pub fn distance(&self) -> f64 {
        self.closest.w.norm()
    }

    /// Energy e(d) \[J\] before mollification, e′/d and e″.
    fn profile(&self, d: f64) -> [f64; 3] {
        match self.law {
            Law::Barrier(reach) => {
                let [b, b1, b2] = barrier(d / reach);
                [self.scale * reach * b, self.scale * (b1 / d), self.scale * b2 / reach]
            }
            Law::Soft { reach, softness, side, extra } => {
                let [b, b1, b2] = softened((side * d - extra) / reach, softness);
                // On the other surface itself the connection has no direction.
                let slope = if d > 0.0 { side * b1 / d } else { 0.0 };
                [self.scale * reach * b, self.scale * slope, self.scale * side * side * b2 / reach]
            }
            Law::Spring => [0.5 * self.scale * d * d, self.scale, self.scale],
        }
    }

    /// Whether it is between a point and the inside of a triangle, and counted as what it is.
    pub fn is_face(&self) -> bool {
        self.closest.n_free == 2 && self.edges == 0.0 && self.scale > 0.0
    }

    /// Whether point `i` has a part in it.
    pub fn weighs(&self, i: usize) -> bool {
        self.closest.c[i] != 0.0 || self.edges > 0.0 || self.closest.dc.iter().any(|dc| dc[i] != 0.0)
    }

    /// Energy \[J\].
    pub fn energy(&self, x: &Points) -> f64 {
        let [energy, ..] = self.profile(self.distance());
        let [m, ..] = self.mollifier(x).0;
        energy * m
    }

    /// ∂/∂x of the four points \[N\].
    pub fn gradient(&self, x: &Points) -> [Vector3<f64>; 4] {
        let [energy, slope, _] = self.profile(self.distance());
        let ([m, m1, _], cross) = self.mollifier(x);
        let pull = self.closest.w * (slope * m);
        let mut g = self.closest.c.map(|c| pull * c);
        if m1 != 0.0 {
            for (g, dc) in g.iter_mut().zip(cross.gradient()) {
                *g += dc * (energy * m1);
            }
        }
        g
    }

    /// ∂²/∂x∂x \[N/m\].
    pub fn hessian(&self, x: &Points) -> Matrix12 {
        let d = self.distance();
        // Two points in one place (of a spring): all directions are alike.
        let n = if d > 0.0 { self.closest.w / d } else { Vector3::zeros() };
        let c = &self.closest.c;
        let [energy, slope, curvature] = self.profile(d);
        let ([m, m1, m2], cross) = self.mollifier(x);
        let (along, across) = (curvature * m, slope * m);
        // d times ∂²d/∂x∂x = cᵢ cⱼ (I − n nᵀ) − G A⁻¹ Gᵀ with Gᵢₖ = cᵢ Wₖ + ∂ₖcᵢ w, A = W·W.
        let n_free = self.closest.n_free;
        let W: [Vector3<f64>; 2] = std::array::from_fn(|k| combine(&self.closest.dc[k], x));
        let A = [W[0].norm_squared(), W[0].dot(&W[1]), W[1].norm_squared()];
        let inverse = match n_free {
            2 => {
                let det = A[0] * A[2] - A[1] * A[1];
                [[A[2] / det, -A[1] / det], [-A[1] / det, A[0] / det]]
            }
            1 => [[1.0 / A[0], 0.0], [0.0, 0.0]],
            _ => [[0.0; 2]; 2],
        };
        let G: [[Vector3<f64>; 2]; 4] = std::array::from_fn(|i| {
            std::array::from_fn(|k| W[k] * c[i] + self.closest.w * self.closest.dc[k][i])
        });
        let nn = n * n.transpose();
        let mut H = [[0.0; 12]; 12];
        for i in 0..4 {
            for j in 0..4 {
                let mut block =
                    nn * (along * c[i] * c[j]) + (Matrix3::identity() - nn) * (across * c[i] * c[j]);
                for k in 0..n_free {
                    for l in 0..n_free {
                        block -= G[i][k] * G[j][l].transpose() * (across * inverse[k][l]);
                    }
                }
                add(&mut H, i, j, &block);
            }
        }
        if m1 != 0.0 || m2 != 0.0 {
            let dcross = cross.gradient();
            let pull = self.closest.w * slope;
            for i in 0..4 {
                for j in 0..4 {
                    let block = dcross[i] * dcross[j].transpose() * (energy * m2)
                        + cross.hessian(i, j) * (energy * m1)
                        + (dcross[i] * pull.transpose() * c[j] + pull * dcross[j].transpose() * c[i]) * m1;
                    add(&mut H, i, j, &block);
                }
            }
        }
        H
    }

    /// The Hessian \[N/m\] less the fraction `convexity` of its negative curvatures.
    ///
    /// But for the mollifier it is made of cᵢ n, ∂ₖcᵢ n and cᵢ t alone, n along the connection and t across it: at most five directions out
    /// of twelve, and the eigenvalues of a matrix over these.
    pub fn lifted_hessian(&self, x: &Points, convexity: f64) -> Matrix12 {
        let mut H = self.hessian(x);
        let d = self.distance();
        let mollified = self.edges > 0.0 && self.mollifier(x).0[1] != 0.0;
        if convexity == 0.0 || mollified || !(d > 0.0) {
            lift(&mut H, convexity);
            return H;
        }
        let directions = self.directions();
        let row = |b: &[f64; 12]| -> [f64; 12] {
            std::array::from_fn(|j| H.iter().zip(b).map(|(row, b)| row[j] * b).sum())
        };
        let dot = |a: &[f64; 12], b: &[f64; 12]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let rows = directions.each_ref().map(row);
        let small: [[f64; 5]; 5] = rows.each_ref().map(|r| directions.each_ref().map(|b| dot(r, b)));
        let mut change = small;
        if !lift(&mut change, convexity) {
            return H;
        }
        for (change, small) in change.as_flattened_mut().iter_mut().zip(small.as_flattened()) {
            *change -= small;
        }
        for (b, change) in directions.iter().zip(&change) {
            let across: [f64; 12] =
                std::array::from_fn(|j| directions.iter().zip(change).map(|(b, m)| b[j] * m).sum());
            for (row, b) in H.iter_mut().zip(b) {
                row.iter_mut().zip(&across).for_each(|(h, a)| *h += b * a);
            }
        }
        H
    }

    /// Orthonormal directions of the four points that the Hessian is made of, the rest zero.
    fn directions(&self) -> [[f64; 12]; 5] {
        let n = self.closest.w.normalize();
        // Any two tangents.
        let aside = Vector3::ith(n.iamin(), 1.0);
        let t = n.cross(&aside).normalize();
        let along = |weights: &[f64; 4], v: &Vector3<f64>| -> [f64; 12] {
            std::array::from_fn(|i| weights[i / 3] * v[i % 3])
        };
        // Gram-Schmidt, twice, as c and ∂c may lie close to each other.
        let mut weights: [[f64; 4]; 3] = [self.closest.c, self.closest.dc[0], self.closest.dc[1]];
        for k in 0..3 {
            if k > self.closest.n_free {
                weights[k] = [0.0; 4];
                continue;
            }
            for _ in 0..2 {
                for j in 0..k {
                    let other = weights[j];
                    let dot: f64 = weights[k].iter().zip(&other).map(|(a, b)| a * b).sum();
                    weights[k].iter_mut().zip(&other).for_each(|(w, o)| *w -= dot * o);
                }
            }
            let norm = weights[k].iter().map(|w| w * w).sum::<f64>().sqrt();
            weights[k] = weights[k].map(|w| w / norm);
        }
        let [c, first, second] = &weights;
        [along(c, &n), along(first, &n), along(second, &n), along(c, &t), along(c, &n.cross(&t))]
    }

    /// Mollifier of nearly parallel edges with its derivatives with respect to |u × v|²: 1 where they cross or are none.
    fn mollifier(&self, x: &Points) -> ([f64; 3], Cross) {
        let cross = Cross { u: x[1] - x[0], v: x[3] - x[2] };
        let least = PARALLEL * self.edges;
        if least <= 0.0 {
            return ([1.0, 0.0, 0.0], cross);
        }
        let s = cross.squared() / least;
        if s >= 1.0 {
            return ([1.0, 0.0, 0.0], cross);
        }
        ([s * (2.0 - s), 2.0 * (1.0 - s) / least, -2.0 / (least * least)], cross)
    }
}

fn add(H: &mut Matrix12, i: usize, j: usize, block: &Matrix3<f64>) {
    for r in 0..3 {
        for c in 0..3 {
            H[3 * i + r][3 * j + c] += block[(r, c)];
        }
    }
}

/// |u × v|² of two edges u = x₁ − x₀, v = x₃ − x₂ and its derivatives.
struct Cross {
    u: Vector3<f64>,
    v: Vector3<f64>,
}

/// ∂(u, v)/∂xᵢ: (which edge, sign).
const ENDS: [(usize, f64); 4] = [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)];

impl Cross {
    fn squared(&self) -> f64 {
        self.u.cross(&self.v).norm_squared()
    }

    fn gradient(&self) -> [Vector3<f64>; 4] {
        let Cross { u, v } = self;
        let du = (u * v.norm_squared() - v * u.dot(v)) * 2.0;
        let dv = (v * u.norm_squared() - u * u.dot(v)) * 2.0;
        [-du, du, -dv, dv]
    }

    fn hessian(&self, i: usize, j: usize) -> Matrix3<f64> {
        let Cross { u, v } = self;
        let ((a, sa), (b, sb)) = (ENDS[i], ENDS[j]);
        let block = match (a, b) {
            (0, 0) => (Matrix3::identity() * v.norm_squared() - v * v.transpose()) * 2.0,
            (1, 1) => (Matrix3::identity() * u.norm_squared() - u * u.transpose()) * 2.0,
            (0, 1) => {
                u * v.transpose() * 4.0 - v * u.transpose() * 2.0 - Matrix3::identity() * (2.0 * u.dot(v))
            }
            _ => v * u.transpose() * 4.0 - u * v.transpose() * 2.0 - Matrix3::identity() * (2.0 * u.dot(v)),
        };
        block * (sa * sb)
    }
}
