//! Neo-Hookean solids, coupled and uncoupled.

use super::{Isotropic, Real, mean_dilatation};

/// Compressible neo-Hookean solid.
///
/// ψ = μ/2 (I₁ − 3) − μ ln J + λ/2 (ln J)².
/// Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., §6.4.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeoHookean {
    /// Shear modulus μ \[Pa\].
    pub mu: f64,
    /// Lamé's λ \[Pa\].
    pub lambda: f64,
}

impl NeoHookean {
    /// From Young's modulus \[Pa\] and Poisson's ratio of the undeformed solid.
    pub fn from_young(young: f64, nu: f64) -> Self {
        let (mu, lambda) = lame(young, nu);
        NeoHookean { mu, lambda }
    }
}

impl Isotropic for NeoHookean {
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, I2: S, J: S, theta: S) -> S {
        let (I1, _, J) = mean_dilatation(I1, I2, J, theta);
        let ln = J.ln();
        (I1 - 3.0) * (0.5 * self.mu) - ln * self.mu + ln * ln * (0.5 * self.lambda)
    }
}

/// Uncoupled neo-Hookean solid.
///
/// ψ = μ/2 (J^(−2/3) I₁ − 3) + K/2 (J − 1)².
/// Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, §6.4 and §6.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeoHookeanUncoupled {
    /// Shear modulus μ \[Pa\].
    pub mu: f64,
    /// Bulk modulus K \[Pa\].
    pub bulk: f64,
}

impl Isotropic for NeoHookeanUncoupled {
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, _: S, J: S, theta: S) -> S {
        let r = J.cbrt().recip();
        let e = theta - 1.0;
        (r * r * I1 - 3.0) * (0.5 * self.mu) + e * e * (0.5 * self.bulk)
    }
}

/// Lamé's constants (μ, λ) \[Pa\] from Young's modulus \[Pa\] and Poisson's ratio.
pub fn lame(young: f64, nu: f64) -> (f64, f64) {
    (young / (2.0 * (1.0 + nu)), young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)))
}
