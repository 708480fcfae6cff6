//! The tangent of an isotropic law from its principal stretches, where what is indefinite about it is plain to see.
//!
//! With F = Σ σᵢ uᵢ⊗vᵢ and Dᵢⱼ = uᵢ⊗vⱼ the second derivatives of ψ̂(I₁, I₂, J, θ) couple D₁₁, D₂₂, D₃₃ and θ with each other by those of
//! ψ̂(σ₁, σ₂, σ₃, θ), and Dᵢⱼ with Dⱼᵢ by
//!
//! a = 2ψ₁ + 2ψ₂ σₖ² on either and b = −2ψ₂ σᵢσⱼ − ψ_J σₖ between them,
//!
//! with eigenvectors Dᵢⱼ ± Dⱼᵢ, and nothing else. Here ψ_J is the slope over σ₁σ₂σ₃, which is −J where J < 0, with p̄ in it. Smith, de Goes & Kim, Analytic eigensystems for isotropic
//! distortion energies, ACM Trans. Graph. 38 (2019). No difference of stretches is divided by.

#![allow(non_snake_case)]

use super::psd::{lift, lifted};
use crate::material::{Jet, Matrix3};
use nalgebra::Vector3;

/// ∂²ψ/∂F_ij∂F_kl \[Pa\] as blocks (j, l), entry `3 i + k`.
pub type Blocks = [[[f64; 9]; 3]; 3];

/// Second derivatives of ψ̂(F, θ) + p̄ det F less the fraction `convexity` of their negative eigenvalues: ∂²/∂F∂F, ∂²/∂F∂θ and ∂²/∂θ² \[Pa\].
///
/// `psi`: ψ̂ with its derivatives over I₁, I₂, J and θ; `p`: p̄ \[Pa\]. `None` where F is too flat for principal directions.
pub fn lifted_tangent(F: &Matrix3, psi: &Jet<4>, p: f64, convexity: f64) -> Option<(Blocks, Matrix3, f64)> {
    let ([u, v], sigma) = principal(F)?;
    let side = F.determinant().signum();
    let squared = sigma.map(|s| s * s);
    let I1 = squared[0] + squared[1] + squared[2];
    let [d1, d2, dJ, _] = psi.g;
    let dJ = (dJ + p) * side;
    // ∂(I₁, I₂, J)/∂σᵢ.
    let slopes: [[f64; 3]; 3] = std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        [2.0 * sigma[i], 2.0 * sigma[i] * (I1 - squared[i]), side * sigma[j] * sigma[k]]
    });
    let along = |h: &[f64; 4], i: usize| h[0] * slopes[i][0] + h[1] * slopes[i][1] + h[2] * slopes[i][2];
    let mut H = [[0.0; 4]; 4];
    for i in 0..3 {
        let row: [f64; 4] = std::array::from_fn(|m| along(&psi.h[m], i));
        for j in 0..=i {
            let own = match i == j {
                true => 2.0 * (d1 + d2 * (I1 - squared[i])),
                false => 4.0 * d2 * sigma[i] * sigma[j] + dJ * sigma[3 - i - j],
            };
            H[i][j] = along(&row, j) + own;
            H[j][i] = H[i][j];
        }
        (H[i][3], H[3][i]) = (row[3], row[3]);
    }
    H[3][3] = psi.h[3][3];
    lift(&mut H, convexity);

    // T[j][l]: what couples the columns j and l of F in the directions v.
    let mut T = [[Matrix3::zeros(); 3]; 3];
    let outer = u.map(|a| u.map(|b| a * b.transpose()));
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let k = 3 - i - j;
        let (a, b) = (2.0 * (d1 + d2 * squared[k]), -2.0 * d2 * sigma[i] * sigma[j] - dJ * sigma[k]);
        let (sum, difference) = (lifted(a + b, convexity), lifted(a - b, convexity));
        let (a, b) = (0.5 * (sum + difference), 0.5 * (sum - difference));
        T[j][j] += outer[i][i] * a;
        T[i][i] += outer[j][j] * a;
        T[i][j] = outer[i][j] * H[i][j] + outer[j][i] * b;
        T[j][i] = T[i][j].transpose();
    }
    let mut P_theta = Matrix3::zeros();
    for i in 0..3 {
        T[i][i] += outer[i][i] * H[i][i];
        P_theta += u[i] * (v[i].transpose() * H[i][3]);
    }
    // Back to the columns of F.
    let half: [[Matrix3; 3]; 3] = std::array::from_fn(|j| {
        std::array::from_fn(|l| T[j][0] * v[0][l] + T[j][1] * v[1][l] + T[j][2] * v[2][l])
    });
    let mut blocks = [[[0.0; 9]; 3]; 3];
    for j in 0..3 {
        for l in 0..=j {
            let block = half[0][l] * v[0][j] + half[1][l] * v[1][j] + half[2][l] * v[2][j];
            // Column-major: its transpose row by row.
            blocks[l][j].copy_from_slice(block.as_slice());
            blocks[j][l].copy_from_slice(block.transpose().as_slice());
        }
    }
    Some((blocks, P_theta, H[3][3]))
}

type Axes = [Vector3<f64>; 3];

/// Orthonormal uᵢ and vᵢ, those right-handed, with F vᵢ = σᵢ uᵢ, and σᵢ; `None` where a σ is so small that its u is lost.
fn principal(F: &Matrix3) -> Option<([Axes; 2], [f64; 3])> {
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
    Some(([std::array::from_fn(|i| stretched[i] / sigma[i]), v], sigma))
}
