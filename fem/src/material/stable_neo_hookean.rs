//! Stable neo-Hookean solid: finite and smooth for collapsed and inverted elements.

use super::{Isotropic, Real};

/// Stable neo-Hookean solid.
///
/// ψ = μ/2 (I₁ − 3) + λ/2 (J − α)² − μ/2 ln(I₁ + 1) + ψ₀,   α = 1 + ¾ μ/λ,
/// shifted by ψ₀ so that ψ(I) = 0. In small strain Lamé's constants are μ_L = ¾ μ and λ_L = λ − ⅝ μ.
/// Smith, de Goes & Kim, Stable neo-Hookean flesh simulation, ACM Trans Graph 2018;37(2):12, eq. (14) and §3.4.
///
/// In an element of mean dilatation only (J − α)² sees the mean volume ratio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StableNeoHookean {
    /// μ of the energy \[Pa\], 4/3 of Lamé's.
    pub mu: f64,
    /// λ of the energy \[Pa\].
    pub lambda: f64,
}

impl StableNeoHookean {
    /// With Young's modulus \[Pa\] and Poisson's ratio of the undeformed solid.
    pub fn from_young(young: f64, nu: f64) -> Self {
        let (mu, lambda) = super::neo_hookean::lame(young, nu);
        StableNeoHookean { mu: 4.0 / 3.0 * mu, lambda: lambda + 5.0 / 6.0 * mu }
    }
}

impl Isotropic for StableNeoHookean {
    const DEFINED_WHEN_INVERTED: bool = true;
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, _: S, _: S, theta: S) -> S {
        let beta = 0.75 * self.mu / self.lambda;
        let e = theta - (1.0 + beta);
        let at_rest = 0.5 * (self.lambda * beta * beta - self.mu * 4.0_f64.ln());
        (I1 - 3.0) * (0.5 * self.mu) + e * e * (0.5 * self.lambda)
            - (I1 + 1.0).ln() * (0.5 * self.mu)
            - at_rest
    }
}
