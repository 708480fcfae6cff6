//! Plane-stress laws of membranes: energy per reference volume over the in-plane Cauchy-Green tensor C (2×2).

use super::{Jet, Real};

/// A membrane law over i₁ = tr C and i₂ = det C of the in-plane C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MembraneLaw {
    /// ψ = E/(2 (1 − ν²)) ((1 − ν) E:E + ν (tr E)²), E = ½ (C − I): plane stress in the Green-Lagrange strain.
    /// Bonet & Wood, 2nd ed., §6.4.2 with S₃₃ = 0.
    StVenantKirchhoff {
        /// Young's modulus E \[Pa\].
        young: f64,
        /// Poisson's ratio ν.
        nu: f64,
    },
    /// ψ = μ/2 (i₁ + 1/i₂ − 3): incompressible, the thickness follows.
    /// Holzapfel, Nonlinear Solid Mechanics, §6.3 (membranes).
    NeoHookean {
        /// Shear modulus μ \[Pa\].
        mu: f64,
    },
}

impl MembraneLaw {
    /// Whether the law is defined at i₂ = det C.
    pub fn admits(&self, i2: f64) -> bool {
        matches!(self, MembraneLaw::StVenantKirchhoff { .. }) || i2 > 0.0
    }

    /// ψ(i₁, i₂) \[J/m³\].
    pub fn psi<S: Real>(&self, i1: S, i2: S) -> S {
        match *self {
            MembraneLaw::StVenantKirchhoff { young, nu } => {
                let tr = (i1 - 2.0) * 0.5;
                let square = (i1 * i1 - i2 * 2.0 - i1 * 2.0 + 2.0) * 0.25;
                (square * (1.0 - nu) + tr * tr * nu) * (0.5 * young / (1.0 - nu * nu))
            }
            MembraneLaw::NeoHookean { mu } => (i1 + i2.recip() - 3.0) * (0.5 * mu),
        }
    }

    /// Value, gradient and Hessian over (i₁, i₂).
    pub fn jet(&self, i1: f64, i2: f64) -> Jet<2> {
        self.psi(Jet::variable(i1, 0), Jet::variable(i2, 1))
    }
}
