//! Any solid law, chosen at run time. The choice costs a branch per quadrature point, which is nothing beside the law.

use super::*;

/// One of the solid laws.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)] // documented at the laws
pub enum Law {
    NeoHookean(NeoHookean),
    NeoHookeanUncoupled(NeoHookeanUncoupled),
    MooneyRivlin(MooneyRivlin),
    MooneyRivlinDyna(MooneyRivlinDyna),
    StableNeoHookean(StableNeoHookean),
    StVenantKirchhoff(StVenantKirchhoff),
    LinearElastic(LinearElastic),
    FoldoverFree(FoldoverFree),
    Blemker(BlemkerFibre),
}

macro_rules! each {
    ($self:ident, $law:ident => $call:expr) => {
        match $self {
            Law::NeoHookean($law) => $call,
            Law::NeoHookeanUncoupled($law) => $call,
            Law::MooneyRivlin($law) => $call,
            Law::MooneyRivlinDyna($law) => $call,
            Law::StableNeoHookean($law) => $call,
            Law::StVenantKirchhoff($law) => $call,
            Law::LinearElastic($law) => $call,
            Law::FoldoverFree($law) => $call,
            Law::Blemker($law) => $call,
        }
    };
}

impl Material for Law {
    fn energy(&self, F: &Matrix3) -> f64 {
        each!(self, law => law.energy(F))
    }
    fn stress(&self, F: &Matrix3) -> Matrix3 {
        each!(self, law => law.stress(F))
    }
    fn tangent(&self, F: &Matrix3) -> Matrix9 {
        each!(self, law => law.tangent(F))
    }
    fn by_invariants(&self, F: &Matrix3, theta: Option<f64>) -> Option<Jet<4>> {
        each!(self, law => law.by_invariants(F, theta))
    }
    fn mixed_energy(&self, F: &Matrix3, theta: f64) -> f64 {
        each!(self, law => law.mixed_energy(F, theta))
    }
    fn mixed_stress(&self, F: &Matrix3, theta: f64) -> (Matrix3, f64) {
        each!(self, law => law.mixed_stress(F, theta))
    }
    fn mixed_tangent(&self, F: &Matrix3, theta: f64) -> Mixed {
        each!(self, law => law.mixed_tangent(F, theta))
    }
}
