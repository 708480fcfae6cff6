//! Linear elasticity for small displacements.

use super::{Material, Matrix3, Matrix9};

/// Linear elastic solid of small strain: not invariant under rotation, for small displacements only.
///
/// ψ = μ ε:ε + λ/2 (tr ε)²,   ε = ½ (F + Fᵀ) − I;   P = 2μ ε + λ tr ε I.
/// Hughes, The Finite Element Method, Dover 2000, §2.7.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearElastic {
    /// Lamé's μ \[Pa\].
    pub mu: f64,
    /// Lamé's λ \[Pa\].
    pub lambda: f64,
}

impl LinearElastic {
    /// From Young's modulus \[Pa\] and Poisson's ratio.
    pub fn from_young(young: f64, nu: f64) -> Self {
        let (mu, lambda) = super::neo_hookean::lame(young, nu);
        LinearElastic { mu, lambda }
    }
}

impl Material for LinearElastic {
    fn energy(&self, F: &Matrix3) -> f64 {
        let e = (F + F.transpose()) * 0.5 - Matrix3::identity();
        self.mu * e.norm_squared() + 0.5 * self.lambda * e.trace() * e.trace()
    }
    fn stress(&self, F: &Matrix3) -> Matrix3 {
        let e = (F + F.transpose()) * 0.5 - Matrix3::identity();
        e * (2.0 * self.mu) + Matrix3::identity() * (self.lambda * e.trace())
    }
    fn tangent(&self, _: &Matrix3) -> Matrix9 {
        let mut A = Matrix9::zeros();
        for i in 0..3 {
            for j in 0..3 {
                A[(i + 3 * j, i + 3 * j)] += self.mu;
                A[(i + 3 * j, j + 3 * i)] += self.mu;
                A[(4 * i, 4 * j)] += self.lambda;
            }
        }
        A
    }
}
