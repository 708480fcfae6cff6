//! Isotropic laws: ψ as a function of I₁ = tr C, I₂ = ½(tr² C − tr C²), J = det F, with C = FᵀF.
//!
//! Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., §6.4 (derivatives of the
//! invariants): ∂I₁/∂F = 2F, ∂I₂/∂F = 2(I₁F − FC), ∂J/∂F = cof F.

use super::{Jet, Material, Matrix3, Matrix9, Mixed, Real, Slope, add_det_hessian, cofactor, flat};

/// A law of the three invariants.
pub trait Isotropic: Copy + Send + Sync {
    /// Whether ψ is finite and smooth for det F ≤ 0 too.
    const DEFINED_WHEN_INVERTED: bool = false;
    /// ψ̂(I₁, I₂, J, θ) \[J/m³\] with the volume ratio θ that the volumetric part sees: J itself, or its mean over the
    /// element. Laws without a volumetric split start with [`mean_dilatation`].
    fn psi<S: Real>(&self, I1: S, I2: S, J: S, theta: S) -> S;
}

/// Invariants of F̄ = (θ/J)^⅓ F from those of F.
#[inline(always)]
pub fn mean_dilatation<S: Real>(I1: S, I2: S, J: S, theta: S) -> (S, S, S) {
    let s = (theta / J).cbrt();
    let s2 = s * s;
    (s2 * I1, s2 * s2 * I2, theta)
}

/// I₁, I₂, J and FC.
fn invariants(F: &Matrix3) -> (f64, f64, f64, Matrix3) {
    let FC = F * (F.transpose() * F);
    let I1 = F.norm_squared();
    (I1, 0.5 * (I1 * I1 - F.dot(&FC)), F.determinant(), FC)
}

impl<L: Isotropic> Material for L {
    fn by_invariants(&self, F: &Matrix3, theta: Option<f64>) -> Option<Jet<4>> {
        let (I1, I2, J, _) = invariants(F);
        Some(match theta {
            Some(theta) => self.mixed_jet(I1, I2, J, theta),
            None => {
                let J = Jet::variable(J, 2);
                self.psi(Jet::variable(I1, 0), Jet::variable(I2, 1), J, J)
            }
        })
    }

    fn energy(&self, F: &Matrix3) -> f64 {
        let (I1, I2, J, _) = invariants(F);
        if !(L::DEFINED_WHEN_INVERTED || J > 0.0) {
            return f64::INFINITY;
        }
        self.psi(I1, I2, J, J)
    }

    fn stress(&self, F: &Matrix3) -> Matrix3 {
        let (I1, I2, J, FC) = invariants(F);
        let (I1, I2, J) = (Slope::<3>::variable(I1, 0), Slope::variable(I2, 1), Slope::variable(J, 2));
        let [d1, d2, dJ] = self.psi(I1, I2, J, J).g;
        F * (2.0 * (d1 + d2 * I1.v)) - FC * (2.0 * d2) + cofactor(F) * dJ
    }

    fn tangent(&self, F: &Matrix3) -> Matrix9 {
        let (I1, I2, J, FC) = invariants(F);
        let (I1, I2, J) = (Jet::<3>::variable(I1, 0), Jet::variable(I2, 1), Jet::variable(J, 2));
        let psi = self.psi(I1, I2, J, J);
        combine(F, &FC, I1.v, psi.g, psi.h)
    }

    fn mixed_energy(&self, F: &Matrix3, theta: f64) -> f64 {
        let (I1, I2, J, _) = invariants(F);
        if !(L::DEFINED_WHEN_INVERTED || (J > 0.0 && theta > 0.0)) {
            return f64::INFINITY;
        }
        self.psi(I1, I2, J, theta)
    }

    fn mixed_stress(&self, F: &Matrix3, theta: f64) -> (Matrix3, f64) {
        let (I1, I2, J, FC) = invariants(F);
        let variable = Slope::<4>::variable;
        let [d1, d2, dJ, dt] =
            self.psi(variable(I1, 0), variable(I2, 1), variable(J, 2), variable(theta, 3)).g;
        (F * (2.0 * (d1 + d2 * I1)) - FC * (2.0 * d2) + cofactor(F) * dJ, dt)
    }

    fn mixed_tangent(&self, F: &Matrix3, theta: f64) -> Mixed {
        let (I1, I2, J, FC) = invariants(F);
        let psi = self.mixed_jet(I1, I2, J, theta);
        let [d1, d2, dJ, p] = psi.g;
        let cof = cofactor(F);
        let dI2 = F * (2.0 * I1) - FC * 2.0;
        let h = psi.h;
        let second = [[h[0][0], h[0][1], h[0][2]], [h[1][0], h[1][1], h[1][2]], [h[2][0], h[2][1], h[2][2]]];
        Mixed {
            P: F * (2.0 * d1) + dI2 * d2 + cof * dJ,
            p,
            A: combine(F, &FC, I1, [d1, d2, dJ], second),
            P_theta: F * (2.0 * h[3][0]) + dI2 * h[3][1] + cof * h[3][2],
            p_theta: h[3][3],
        }
    }
}

/// Adds the jet evaluation of the two-field density to every isotropic law.
trait MixedJet: Isotropic {
    #[inline(always)]
    fn mixed_jet(&self, I1: f64, I2: f64, J: f64, theta: f64) -> Jet<4> {
        self.psi(Jet::variable(I1, 0), Jet::variable(I2, 1), Jet::variable(J, 2), Jet::variable(theta, 3))
    }
}
impl<L: Isotropic> MixedJet for L {}

/// Σ ψᵢ ∂²Iᵢ/∂F² + Σ ψᵢⱼ ∂Iᵢ/∂F ⊗ ∂Iⱼ/∂F, exactly symmetric.
///
/// ∂²I₂/∂F²: dF = 2(2 (F:dF) F + I₁ dF − dF C − F dFᵀ F − FFᵀ dF).
#[inline(never)]
fn combine(F: &Matrix3, FC: &Matrix3, I1: f64, d: [f64; 3], h: [[f64; 3]; 3]) -> Matrix9 {
    let C = F.transpose() * F;
    let B = F * F.transpose();
    let f = flat(F);
    let (g1, g2, gJ) = (f * 2.0, flat(&(F * (2.0 * I1) - FC * 2.0)), flat(&cofactor(F)));
    // Rows of the outer products: u₁ = ψ₁ⱼ gⱼ and so on; the 4 F⊗F of ∂²I₂ is ψ₂ g₁⊗g₁.
    let u1 = g1 * (h[0][0] + d[1]) + g2 * h[0][1] + gJ * h[0][2];
    let u2 = g1 * h[1][0] + g2 * h[1][1] + gJ * h[1][2];
    let uJ = g1 * h[2][0] + g2 * h[2][1] + gJ * h[2][2];
    let mut A = Matrix9::zeros();
    for c in 0..9 {
        let (k, l) = (c % 3, c / 3);
        for r in c..9 {
            let (i, j) = (r % 3, r / 3);
            A[(r, c)] = g1[c] * u1[r] + g2[c] * u2[r] + gJ[c] * uJ[r] - 2.0 * d[1] * F[(i, l)] * F[(k, j)];
        }
    }
    let diagonal = 2.0 * (d[0] + d[1] * I1);
    for i in 0..3 {
        for j in 0..3 {
            A[(i + 3 * j, i + 3 * j)] += diagonal;
            for l in 0..=j {
                A[(i + 3 * j, i + 3 * l)] -= 2.0 * d[1] * C[(l, j)]; // dF C
            }
            for k in 0..=i {
                A[(i + 3 * j, k + 3 * j)] -= 2.0 * d[1] * B[(i, k)]; // FFᵀ dF
            }
        }
    }
    for c in 0..9 {
        for r in 0..c {
            A[(r, c)] = A[(c, r)];
        }
    }
    add_det_hessian(&mut A, F, d[2]);
    A
}
