//! The tangent of an isotropic law made less indefinite in the principal directions of F, where it is nearly diagonal.
//!
//! With F = Σ σᵢ uᵢ⊗vᵢ and Dᵢⱼ = uᵢ⊗vⱼ the tangent couples D₁₁, D₂₂, D₃₃ (and θ) with each other, Dᵢⱼ with Dⱼᵢ, and nothing else;
//! the eigenvectors of the pairs are Dᵢⱼ ± Dⱼᵢ. Smith, de Goes & Kim, Analytic eigensystems for isotropic distortion energies, ACM
//! Trans. Graph. 38 (2019). A quarter of the time of [`lift`](super::psd::lift) on all ten components.

#![allow(non_snake_case)]

use super::psd::lift;
use crate::material::{Matrix3, Matrix9};
use nalgebra::Vector3;

/// Takes the share `share` off the negative eigenvalues of the second derivatives of an isotropic ψ̂(F, θ). Returns false where F is
/// too flat for that; nothing is changed then.
pub fn lift_isotropic(
    F: &Matrix3,
    A: &mut Matrix9,
    P_theta: &mut Matrix3,
    p_theta: &mut f64,
    share: f64,
) -> bool {
    let Some([u, v]) = principal(F) else { return false };
    let d: [[[f64; 9]; 3]; 3] =
        std::array::from_fn(|i| std::array::from_fn(|j| std::array::from_fn(|e| u[i][e % 3] * v[j][e / 3])));
    let y = d.map(|row| row.map(|d| apply(A, &d)));
    let largest = A.amax();
    for [i, j] in [[0, 1], [0, 2], [1, 2]] {
        let a = 0.5 * (dot(&d[i][j], &y[i][j]) + dot(&d[j][i], &y[j][i]));
        let b = dot(&d[i][j], &y[j][i]);
        for sign in [1.0, -1.0] {
            let value = a + sign * b;
            if value < -1e-10 * largest {
                let w: [f64; 9] = std::array::from_fn(|e| d[i][j][e] + sign * d[j][i][e]);
                add_outer(A, -0.5 * share * value, &w, &w);
            }
        }
    }
    let t: [f64; 3] = std::array::from_fn(|i| (0..9).map(|e| P_theta[e] * d[i][i][e]).sum());
    let stretch: [[f64; 4]; 4] = std::array::from_fn(|i| {
        std::array::from_fn(|j| match (i, j) {
            (3, 3) => *p_theta,
            (3, k) | (k, 3) => t[k],
            _ => 0.5 * (dot(&d[i][i], &y[j][j]) + dot(&d[j][j], &y[i][i])),
        })
    });
    let mut lifted = stretch;
    if lift(&mut lifted, share) {
        let change = |i: usize, j: usize| lifted[i][j] - stretch[i][j];
        for i in 0..3 {
            let w: [f64; 9] = std::array::from_fn(|e| (0..3).map(|j| change(i, j) * d[j][j][e]).sum());
            add_outer(A, 1.0, &d[i][i], &w);
            (0..9).for_each(|e| P_theta[e] += change(i, 3) * d[i][i][e]);
        }
        *p_theta = lifted[3][3];
    }
    true
}

type Axes = [Vector3<f64>; 3];

/// Orthonormal uᵢ and vᵢ with F vᵢ = σᵢ uᵢ; `None` where a σ is so small that its u is lost.
fn principal(F: &Matrix3) -> Option<[Axes; 2]> {
    let mut C = F.transpose() * F;
    let mut V = Matrix3::identity();
    let small = 1e-15 * C.trace();
    // Jacobi's method (Golub & Van Loan, Matrix Computations, §8.5).
    for _ in 0..10 {
        let mut done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = C[(p, q)];
            if !(off.abs() > small) {
                continue;
            }
            done = false;
            let tau = (C[(q, q)] - C[(p, p)]) / (2.0 * off);
            let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
            let s = t * c;
            C[(p, p)] -= t * off;
            C[(q, q)] += t * off;
            (C[(p, q)], C[(q, p)]) = (0.0, 0.0);
            let r = 3 - p - q;
            let (cp, cq) = (C[(r, p)], C[(r, q)]);
            let (new_p, new_q) = (c * cp - s * cq, s * cp + c * cq);
            (C[(r, p)], C[(p, r)]) = (new_p, new_p);
            (C[(r, q)], C[(q, r)]) = (new_q, new_q);
            for k in 0..3 {
                let (vp, vq) = (V[(k, p)], V[(k, q)]);
                (V[(k, p)], V[(k, q)]) = (c * vp - s * vq, s * vp + c * vq);
            }
        }
        if done {
            break;
        }
    }
    let v: [Vector3<f64>; 3] = std::array::from_fn(|i| V.column(i).into_owned());
    let stretched = v.map(|v| F * v);
    let sigma = stretched.map(|u| u.norm());
    let largest = sigma.iter().fold(0.0_f64, |m, s| m.max(*s));
    if !sigma.iter().all(|s| *s > 1e-4 * largest) {
        return None;
    }
    Some([std::array::from_fn(|i| stretched[i] / sigma[i]), v])
}

fn dot(a: &[f64; 9], b: &[f64; 9]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn apply(A: &Matrix9, x: &[f64; 9]) -> [f64; 9] {
    let mut y = [0.0; 9];
    for (column, x) in A.data.0.iter().zip(x) {
        for (y, a) in y.iter_mut().zip(column) {
            *y += a * x;
        }
    }
    y
}

/// A += factor x ⊗ y.
fn add_outer(A: &mut Matrix9, factor: f64, x: &[f64; 9], y: &[f64; 9]) {
    for (column, y) in A.data.0.iter_mut().zip(y) {
        for (a, x) in column.iter_mut().zip(x) {
            *a += factor * x * y;
        }
    }
}
