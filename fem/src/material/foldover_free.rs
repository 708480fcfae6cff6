//! What unfolds a mesh: an energy of shapes that is finite for inverted ones, and the steeper there the smaller its ε.

use super::{Isotropic, Real};

/// Energy of a shape, no tissue.
///
/// ψ = I₁ χ^(-2/3) + (J² + 1) / χ \[J/m³\] with χ = (J + √(J² + ε²)) / 2, which is J where that is large beside ε, and falls to zero below.
/// Garanzha, Kaporin, Kudryavtseva, Protais, Ray & Sokolov, Foldover-free maps in 50 lines of code, ACM Trans Graph 2021;40(4):102, eq. (2)
/// to (4) with λ = 1. The undeformed shape is at rest but for terms of the order of ε².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoldoverFree {
    /// ε, above 0.
    pub epsilon: f64,
}

impl Isotropic for FoldoverFree {
    const DEFINED_WHEN_INVERTED: bool = true;
    #[inline(always)]
    fn psi<S: Real>(&self, I1: S, _: S, J: S, _: S) -> S {
        let root = (J * J + self.epsilon * self.epsilon).sqrt();
        // Where J is negative the sum would cancel.
        let chi = match J.value() > 0.0 {
            true => (J + root) * 0.5,
            false => (root - J).recip() * (0.5 * self.epsilon * self.epsilon),
        };
        I1 * chi.powf(-2.0 / 3.0) + (J * J + 1.0) / chi
    }
}
