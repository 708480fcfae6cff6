//! Two laws as a user writes them: only their energy density.

#![allow(non_snake_case)]

use fem::material::{Hyperelastic, Real, Site, Symmetric};

/// Passive heart muscle: transversely isotropic exponential of Fung's type, nearly incompressible.
///
/// ψ = C/2 (exp Q − 1) + K/2 (J − 1)²,
/// Q = b_f E₁₁² + b_t (E₂₂² + E₃₃² + 2 E₂₃²) + 2 b_fs (E₁₂² + E₁₃²),
/// with Green's strain E of F̄ = J^-⅓ F, axis 1 along the fibre.
/// Guccione, McCulloch & Waldman, J. Biomech. Eng. 113 (1991) 42; as in Land et al., Proc. R. Soc. A 471 (2015) 20150641.
#[derive(Clone, Copy, Debug)]
pub struct Guccione {
    /// C \[Pa\].
    pub c: f64,
    /// Exponent along the fibre.
    pub bf: f64,
    /// Exponent across it.
    pub bt: f64,
    /// Exponent of shear of fibres.
    pub bfs: f64,
    /// Bulk modulus K \[Pa\].
    pub bulk: f64,
}

impl Hyperelastic for Guccione {
    fn psi<S: Real>(&self, C: &Symmetric<S>, site: &Site) -> S {
        let J = C.determinant().sqrt();
        let E = C.scaled(J.powf(-2.0 / 3.0)).strain();
        let [x, y, z] = E.times(site.a0);
        // In any frame with axis 1 along the fibre: E₁₁, E₁₁² + E₁₂² + E₁₃², and the sum of all squares.
        let (along, row, all) = (E.along(site.a0), x * x + y * y + z * z, E.norm_squared());
        let along_squared = along * along;
        let Q = along_squared * self.bf
            + (all - row * 2.0 + along_squared) * self.bt
            + (row - along_squared) * (2.0 * self.bfs);
        (Q.exp() - 1.0) * (0.5 * self.c) + (J - 1.0) * (J - 1.0) * (0.5 * self.bulk)
    }
}

/// A passive law with fibres that pull: second Piola-Kirchhoff stress T f ⊗ f, the tension T \[Pa\] held by the first control.
///
/// ψ = ψ_passive + T/2 (f·C f − 1).
#[derive(Clone, Copy, Debug)]
#[allow(dead_code)] // problem 1 is passive; the tests use it
pub struct Active<L>(pub L);

impl<L: Hyperelastic> Hyperelastic for Active<L> {
    fn psi<S: Real>(&self, C: &Symmetric<S>, site: &Site) -> S {
        self.0.psi(C, site) + (C.along(site.a0) - 1.0) * (0.5 * site.control(0))
    }
}
