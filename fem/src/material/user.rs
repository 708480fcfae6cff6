//! Laws of a user's own: a Rust type with an energy density, put into a scene by [`crate::scene::LawSpec::user`].
//!
//! A type that implements [`Hyperelastic`] states ψ over C = FᵀF, once, over a generic [`Real`]; stress and tangent follow by exact
//! differentiation. One that implements [`SolidLaw`] gives ψ, P and ∂P/∂F itself. Either way a mean dilatation (hexahedra) is
//! taken over from F̄ = (θ/J)^⅓ F ([`Material::mixed_energy`]).

use super::{Jet, Material, Matrix3, Matrix9, Real};
use nalgebra::Vector3;

/// Where a law is asked, and what drives it there.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// Index of the cell in its region, for laws that differ from cell to cell.
    pub cell: usize,
    /// Fibre direction: unit vector, reference configuration; zero where the scene gives none.
    pub a0: Vector3<f64>,
    controls: &'a [usize],
    values: &'a [f64],
}

impl<'a> Site<'a> {
    /// `controls`: those of the law, as indices into `values`, the values of all.
    pub fn new(cell: usize, a0: Vector3<f64>, controls: &'a [usize], values: &'a [f64]) -> Site<'a> {
        Site { cell, a0, controls, values }
    }

    /// Value of the `index`-th control of the law, in the order in which the scene names them.
    pub fn control(&self, index: usize) -> f64 {
        self.values[self.controls[index]]
    }
}

/// A symmetric tensor of second order: xx, yy, zz, xy, yz, zx.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symmetric<S>(pub [S; 6]);

impl<S: Real> Symmetric<S> {
    /// Trace.
    pub fn trace(&self) -> S {
        self.0[0] + self.0[1] + self.0[2]
    }

    /// Determinant.
    pub fn determinant(&self) -> S {
        let [xx, yy, zz, xy, yz, zx] = self.0;
        xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * zx) + zx * (xy * yz - yy * zx)
    }

    /// Sum of the squares of all nine components.
    pub fn norm_squared(&self) -> S {
        let [xx, yy, zz, xy, yz, zx] = self.0;
        xx * xx + yy * yy + zz * zz + (xy * xy + yz * yz + zx * zx) * 2.0
    }

    /// The product with a vector.
    pub fn times(&self, a: Vector3<f64>) -> [S; 3] {
        let [xx, yy, zz, xy, yz, zx] = self.0;
        [xx * a.x + xy * a.y + zx * a.z, xy * a.x + yy * a.y + yz * a.z, zx * a.x + yz * a.y + zz * a.z]
    }

    /// a · T a.
    pub fn along(&self, a: Vector3<f64>) -> S {
        let [x, y, z] = self.times(a);
        x * a.x + y * a.y + z * a.z
    }

    /// Every component times a factor.
    pub fn scaled(&self, factor: S) -> Self {
        Symmetric(self.0.map(|t| t * factor))
    }

    /// Green's strain E = ½ (C − I) of the right Cauchy-Green tensor C.
    pub fn strain(&self) -> Self {
        let [xx, yy, zz, xy, yz, zx] = self.0;
        Symmetric([xx - 1.0, yy - 1.0, zz - 1.0, xy, yz, zx].map(|t| t * 0.5))
    }
}

/// A law that is known by its energy density alone.
pub trait Hyperelastic: std::fmt::Debug + Send + Sync {
    /// ψ(C) \[J/m³\] of the right Cauchy-Green tensor C = FᵀF. Asked for det F > 0 only.
    fn psi<S: Real>(&self, C: &Symmetric<S>, site: &Site) -> S;
}

/// A hyperelastic law as an object. `Debug` names it with its constants: laws that print the same count as the same.
pub trait SolidLaw: std::fmt::Debug + Send + Sync {
    /// ψ(F) \[J/m³\]; `+∞` where the law is not defined.
    fn energy(&self, F: &Matrix3, site: &Site) -> f64;
    /// First Piola-Kirchhoff stress P = ∂ψ/∂F \[Pa\]. Asked where the energy is finite.
    fn stress(&self, F: &Matrix3, site: &Site) -> Matrix3;
    /// ∂P/∂F \[Pa\], 9×9: row `i + 3j` is P_ij, column `k + 3l` is F_kl. Asked where the energy is finite.
    fn tangent(&self, F: &Matrix3, site: &Site) -> Matrix9;
}

/// Rows and columns of the components of [`Symmetric`].
const PLACE: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

/// ψ with its derivatives over the components of C, and whether the law is defined.
fn jet<L: Hyperelastic>(law: &L, F: &Matrix3, site: &Site) -> Jet<6> {
    let C = F.transpose() * F;
    law.psi(&Symmetric(std::array::from_fn(|n| Jet::variable(C[(PLACE[n][0], PLACE[n][1])], n))), site)
}

/// Second Piola-Kirchhoff stress S = 2 ∂ψ/∂C from the slopes over the components.
fn second_stress(slopes: &[f64; 6]) -> Matrix3 {
    let mut S = Matrix3::zeros();
    for (n, [i, j]) in PLACE.into_iter().enumerate() {
        // A component off the diagonal stands for both.
        S[(i, j)] += slopes[n];
        S[(j, i)] += slopes[n];
    }
    S
}

impl<L: Hyperelastic> SolidLaw for L {
    fn energy(&self, F: &Matrix3, site: &Site) -> f64 {
        if !(F.determinant() > 0.0) {
            return f64::INFINITY;
        }
        let C = F.transpose() * F;
        let psi = self.psi(&Symmetric(PLACE.map(|[i, j]| C[(i, j)])), site);
        if psi.is_nan() { f64::INFINITY } else { psi }
    }

    fn stress(&self, F: &Matrix3, site: &Site) -> Matrix3 {
        F * second_stress(&jet(self, F, site).g)
    }

    /// A = Bᵀ (∂²ψ/∂C²) B + δ_ik S_jl, with B = ∂C/∂F, 6×9.
    fn tangent(&self, F: &Matrix3, site: &Site) -> Matrix9 {
        let psi = jet(self, F, site);
        let S = second_stress(&psi.g);
        let mut B = [[0.0; 9]; 6];
        for (n, [i, j]) in PLACE.into_iter().enumerate() {
            for k in 0..3 {
                B[n][k + 3 * i] += F[(k, j)];
                B[n][k + 3 * j] += F[(k, i)];
            }
        }
        let hB: [[f64; 9]; 6] = std::array::from_fn(|m| {
            std::array::from_fn(|c| (0..6).map(|n| 0.5 * (psi.h[m][n] + psi.h[n][m]) * B[n][c]).sum())
        });
        let mut A = Matrix9::zeros();
        for c in 0..9 {
            for r in c..9 {
                let mut a: f64 = (0..6).map(|n| B[n][r] * hB[n][c]).sum();
                if r % 3 == c % 3 {
                    a += S[(r / 3, c / 3)];
                }
                (A[(r, c)], A[(c, r)]) = (a, a);
            }
        }
        A
    }
}

/// A law at its site.
#[derive(Clone, Copy, Debug)]
pub struct At<'a> {
    /// The law.
    pub law: &'a dyn SolidLaw,
    /// The site.
    pub site: Site<'a>,
}

impl Material for At<'_> {
    fn energy(&self, F: &Matrix3) -> f64 {
        self.law.energy(F, &self.site)
    }
    fn stress(&self, F: &Matrix3) -> Matrix3 {
        self.law.stress(F, &self.site)
    }
    fn tangent(&self, F: &Matrix3) -> Matrix9 {
        self.law.tangent(F, &self.site)
    }
}

/// Young's modulus \[Pa\] of the isotropic law closest to a tangent at rest: means of its bulk and shear stiffness over all directions
/// (Voigt; Hill, Proc. Phys. Soc. A 65 (1952) 349).
pub fn mean_young(A: &Matrix9) -> f64 {
    let entry = |i: usize, j: usize, k: usize, l: usize| A[(i + 3 * j, k + 3 * l)];
    let pairs = || (0..9).map(|n| (n % 3, n / 3));
    let volumetric: f64 = pairs().map(|(i, k)| entry(i, i, k, k)).sum();
    let all: f64 = pairs().map(|(i, j)| entry(i, j, i, j)).sum();
    let (bulk, mu) = (volumetric / 9.0, (all - volumetric / 3.0) / 10.0);
    9.0 * bulk * mu / (3.0 * bulk + mu)
}
