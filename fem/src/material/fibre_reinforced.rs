//! Laws of one fibre family: ψ as a function of I₁, J and of I₄ = a₀·C a₀, I₅ = a₀·C² a₀.
//!
//! Spencer, Continuum Theory of the Mechanics of Fibre-Reinforced Composites, CISM 282, Springer 1984.

use super::{Jet, Material, Matrix3, Matrix9, Mixed, Real, add_det_hessian, cofactor, flat};

/// A law with one fibre family.
pub trait FibreReinforced: Copy + Send + Sync {
    /// ψ̂(I₁, J, θ, I₄, I₅) \[J/m³\]; θ as in [`super::Isotropic::psi`].
    fn psi<S: Real>(&self, I1: S, J: S, theta: S, I4: S, I5: S) -> S;
}

/// A fibre-reinforced law at a place with its fibre direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlongFibre<L> {
    /// The law.
    pub law: L,
    /// Fibre direction a₀: unit vector, reference configuration.
    pub a0: nalgebra::Vector3<f64>,
}

/// What the invariants and their derivatives are made of.
struct Kinematics {
    F: Matrix3,
    I1: f64,
    J: f64,
    /// F a₀, C a₀, F C a₀.
    m: nalgebra::Vector3<f64>,
    c: nalgebra::Vector3<f64>,
    n: nalgebra::Vector3<f64>,
}

impl<L: FibreReinforced> AlongFibre<L> {
    fn kinematics(&self, F: &Matrix3) -> Kinematics {
        let m = F * self.a0;
        let c = F.transpose() * m;
        Kinematics { F: *F, I1: F.norm_squared(), J: F.determinant(), m, c, n: F * c }
    }

    fn jet(&self, k: &Kinematics, theta: f64) -> Jet<5> {
        self.law.psi(
            Jet::variable(k.I1, 0),
            Jet::variable(k.J, 1),
            Jet::variable(theta, 2),
            Jet::variable(k.m.norm_squared(), 3),
            Jet::variable(k.c.norm_squared(), 4),
        )
    }

    /// ∂I₁/∂F, ∂J/∂F, ∂I₄/∂F, ∂I₅/∂F.
    fn gradients(&self, k: &Kinematics) -> [Matrix3; 4] {
        let a = self.a0.transpose();
        [k.F * 2.0, cofactor(&k.F), k.m * a * 2.0, (k.m * k.c.transpose() + k.n * a) * 2.0]
    }
}

impl<L: FibreReinforced> Material for AlongFibre<L> {
    fn energy(&self, F: &Matrix3) -> f64 {
        self.mixed_energy(F, F.determinant())
    }

    fn stress(&self, F: &Matrix3) -> Matrix3 {
        let (P, p) = self.mixed_stress(F, F.determinant());
        P + cofactor(F) * p
    }

    fn tangent(&self, F: &Matrix3) -> Matrix9 {
        let m = self.mixed_tangent(F, F.determinant());
        let (g, q) = (flat(&cofactor(F)), flat(&m.P_theta));
        let mut A = m.A + q * g.transpose() + g * q.transpose() + g * g.transpose() * m.p_theta;
        add_det_hessian(&mut A, F, m.p);
        A
    }

    fn mixed_energy(&self, F: &Matrix3, theta: f64) -> f64 {
        let k = self.kinematics(F);
        if !(k.J > 0.0 && theta > 0.0) {
            return f64::INFINITY;
        }
        self.law.psi(k.I1, k.J, theta, k.m.norm_squared(), k.c.norm_squared())
    }

    fn mixed_stress(&self, F: &Matrix3, theta: f64) -> (Matrix3, f64) {
        let k = self.kinematics(F);
        let d = self.jet(&k, theta).g;
        let [g1, gJ, g4, g5] = self.gradients(&k);
        (g1 * d[0] + gJ * d[1] + g4 * d[3] + g5 * d[4], d[2])
    }

    fn mixed_tangent(&self, F: &Matrix3, theta: f64) -> Mixed {
        const THETA: usize = 2;
        let k = self.kinematics(F);
        let psi = self.jet(&k, theta);
        let g = self.gradients(&k);
        let index = [0, 1, 3, 4];
        let (mut P, mut P_theta, mut A) = (Matrix3::zeros(), Matrix3::zeros(), Matrix9::zeros());
        for (a, &ia) in index.iter().enumerate() {
            P += g[a] * psi.g[ia];
            P_theta += g[a] * psi.h[ia][THETA];
            let mut u = Matrix3::zeros();
            for (b, &ib) in index.iter().enumerate() {
                u += g[b] * psi.h[ia][ib];
            }
            A += flat(&g[a]) * flat(&u).transpose();
        }
        let (d1, d4, d5) = (2.0 * psi.g[0], 2.0 * psi.g[3], 2.0 * psi.g[4]);
        let (a0, m, c) = (self.a0, k.m, k.c);
        let B = F * F.transpose();
        for i in 0..3 {
            for j in 0..3 {
                let row = i + 3 * j;
                A[(row, row)] += d1;
                for l in 0..3 {
                    A[(row, i + 3 * l)] += d4 * a0[j] * a0[l] + d5 * (a0[l] * c[j] + c[l] * a0[j]);
                    for k in 0..3 {
                        A[(row, k + 3 * l)] += d5
                            * (m[i] * F[(k, j)] * a0[l]
                                + F[(i, l)] * m[k] * a0[j]
                                + B[(i, k)] * a0[j] * a0[l]);
                    }
                }
                for k in 0..3 {
                    A[(row, k + 3 * j)] += d5 * m[i] * m[k];
                }
            }
        }
        add_det_hessian(&mut A, F, psi.g[1]);
        Mixed { P, p: psi.g[THETA], A, P_theta, p_theta: psi.h[THETA][THETA] }
    }
}
