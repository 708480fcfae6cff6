//! St. Venant-Kirchhoff solid: linear elasticity in the Green-Lagrange strain.

use super::{Isotropic, Real};

/// St. Venant-Kirchhoff solid.
///
/// ψ = λ/2 (tr E)² + μ E:E,   E = ½ (C − I);   tr E = ½ (I₁ − 3),   E:E = ¼ (I₁² − 2 I₂ − 2 I₁ + 3).
/// Bonet & Wood, 2nd ed., §6.4.2. Softens under compression beyond a stretch of 0.58; finite for inverted elements.
///
/// Its volumetric part is no function of J: an element of mean dilatation treats it as a plain element does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StVenantKirchhoff {
    /// Lamé's μ \[Pa\].
    pub mu: f64,
    /// Lamé's λ \[Pa\].
    pub lambda: f64,
}

impl StVenantKirchhoff {
    /// From Young's modulus \[Pa\] and Poisson's ratio.
    pub fn from_young(young: f64, nu: f64) -> Self {
        let (mu, lambda) = super::neo_hookean::lame(young, nu);
        StVenantKirchhoff { mu, lambda }
    }
}

impl Isotropic for StVenantKirchhoff {
    const DEFINED_WHEN_INVERTED: bool = true;
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, I2: S, _: S, _: S) -> S {
        let tr = I1 - 3.0;
        tr * tr * (0.125 * self.lambda) + (I1 * I1 - I2 * 2.0 - I1 * 2.0 + 3.0) * (0.25 * self.mu)
    }
}
