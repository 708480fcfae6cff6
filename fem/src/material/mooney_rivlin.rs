//! Mooney-Rivlin solids: the uncoupled form, and the compressible form of LS-DYNA.

use super::{Isotropic, Real, mean_dilatation};

/// Uncoupled Mooney-Rivlin solid.
///
/// ψ = C₁₀ (Ī₁ − 3) + C₀₁ (Ī₂ − 3) + K/2 (J − 1)²,   Ī₁ = J^(−2/3) I₁, Ī₂ = J^(−4/3) I₂;
/// shear modulus G = 2 (C₁₀ + C₀₁).
/// Holzapfel, Nonlinear Solid Mechanics, Wiley 2000, §6.5; FEBio Theory Manual, "Mooney-Rivlin".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MooneyRivlin {
    /// C₁₀ \[Pa\].
    pub c10: f64,
    /// C₀₁ \[Pa\].
    pub c01: f64,
    /// Bulk modulus K \[Pa\].
    pub bulk: f64,
}

impl Isotropic for MooneyRivlin {
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, I2: S, J: S, theta: S) -> S {
        let r = J.cbrt().recip();
        let r2 = r * r;
        let e = theta - 1.0;
        (r2 * I1 - 3.0) * self.c10 + (r2 * r2 * I2 - 3.0) * self.c01 + e * e * (0.5 * self.bulk)
    }
}

/// Mooney-Rivlin solid as LS-DYNA writes it (`*MAT_MOONEY-RIVLIN_RUBBER`).
///
/// ψ = A (I₁ − 3) + B (I₂ − 3) + C (I₃⁻² − 1) + D (I₃ − 1)²,   I₃ = J²,
/// C = A/2 + B,   D = (A (5ν − 2) + B (11ν − 5)) / (2 (1 − 2ν)).
/// LS-DYNA Keyword User's Manual, Volume II, `*MAT_027`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MooneyRivlinDyna {
    /// A \[Pa\].
    pub a: f64,
    /// B \[Pa\].
    pub b: f64,
    /// Poisson ratio ν of the undeformed solid, below 0.5.
    pub nu: f64,
}

impl Isotropic for MooneyRivlinDyna {
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, I2: S, J: S, theta: S) -> S {
        let MooneyRivlinDyna { a, b, nu } = *self;
        let c = 0.5 * a + b;
        let d = (a * (5.0 * nu - 2.0) + b * (11.0 * nu - 5.0)) / (2.0 * (1.0 - 2.0 * nu));
        let (I1, I2, J) = mean_dilatation(I1, I2, J, theta);
        let I3 = J * J;
        let r = I3.recip();
        let e = I3 - 1.0;
        (I1 - 3.0) * a + (I2 - 3.0) * b + (r * r - 1.0) * c + e * e * d
    }
}
