//! Constitutive laws: energy densities ψ(F), their stress P = ∂ψ/∂F and tangent ∂P/∂F.
//!
//! One file per law; those of a user's own need none of them ([`user`]). Moduli in Pa, energy densities in J/m³. Isotropic laws and laws of one fibre family state only
//! their energy over invariants ([`Isotropic`], [`FibreReinforced`]); stress and tangent follow by exact
//! differentiation. Fibres and strands, which carry force along a line only, are in [`mod@line`].

#![allow(non_snake_case)]

pub mod blemker;
mod fibre_reinforced;
pub mod foldover_free;
pub mod force_length;
mod isotropic;
mod jet;
mod law;
pub mod line;
pub mod linear_elastic;
pub mod membrane;
pub mod mooney_rivlin;
pub mod neo_hookean;
pub mod st_venant_kirchhoff;
pub mod stable_neo_hookean;
pub mod user;

pub use blemker::{Blemker, BlemkerFibre};
pub use fibre_reinforced::FibreReinforced;
pub use foldover_free::FoldoverFree;
pub use isotropic::{Isotropic, mean_dilatation};
pub use jet::{Jet, Real, Slope};
pub use law::Law;
pub use linear_elastic::LinearElastic;
pub use mooney_rivlin::{MooneyRivlin, MooneyRivlinDyna};
pub use neo_hookean::{NeoHookean, NeoHookeanUncoupled};
pub use st_venant_kirchhoff::StVenantKirchhoff;
pub use stable_neo_hookean::StableNeoHookean;
pub use user::{Hyperelastic, Site, SolidLaw, Symmetric};

/// 3×3 matrix, column-major.
pub type Matrix3 = nalgebra::Matrix3<f64>;
/// 9×9 matrix; index `i + 3j` stands for component `ij` of a 3×3 matrix.
pub type Matrix9 = nalgebra::SMatrix<f64, 9, 9>;
type Vector9 = nalgebra::SVector<f64, 9>;

/// Derivatives of the two-field density ψ̂(F, θ) of [`Material::mixed_energy`].
#[derive(Clone, Copy, Debug)]
pub struct Mixed {
    /// ∂ψ̂/∂F \[Pa\].
    pub P: Matrix3,
    /// ∂ψ̂/∂θ \[Pa\].
    pub p: f64,
    /// ∂²ψ̂/∂F∂F \[Pa\].
    pub A: Matrix9,
    /// ∂²ψ̂/∂F∂θ \[Pa\].
    pub P_theta: Matrix3,
    /// ∂²ψ̂/∂θ² \[Pa\].
    pub p_theta: f64,
}

/// A hyperelastic law.
pub trait Material: Copy + Send + Sync {
    /// ψ(F) \[J/m³\]; `+∞` where the law is not defined (det F ≤ 0 for most), so that a line search backs off.
    fn energy(&self, F: &Matrix3) -> f64;
    /// First Piola-Kirchhoff stress P = ∂ψ/∂F \[Pa\]. Needs a finite energy.
    fn stress(&self, F: &Matrix3) -> Matrix3;
    /// ∂P/∂F \[Pa\], 9×9: row `i + 3j` is P_ij, column `k + 3l` is F_kl. Needs a finite energy.
    fn tangent(&self, F: &Matrix3) -> Matrix9;
    /// ψ̂(F, θ) with its derivatives over I₁, I₂, J and θ where it depends on these alone; θ = J where none is given.
    fn by_invariants(&self, _F: &Matrix3, _theta: Option<f64>) -> Option<Jet<4>> {
        None
    }

    /// ψ̂(F, θ) \[J/m³\]: the density with the volume ratio θ taken from elsewhere (the mean over an element), so that
    /// ψ̂(F, det F) = ψ(F). Here ψ(F̄) with F̄ = (θ/J)^⅓ F.
    /// Simo, Taylor & Pister, Comput Methods Appl Mech Eng 1985;51:177.
    fn mixed_energy(&self, F: &Matrix3, theta: f64) -> f64 {
        let J = F.determinant();
        if !(J > 0.0 && theta > 0.0) {
            return f64::INFINITY;
        }
        self.energy(&(F * (theta / J).cbrt()))
    }
    /// ∂ψ̂/∂F and ∂ψ̂/∂θ \[Pa\].
    fn mixed_stress(&self, F: &Matrix3, theta: f64) -> (Matrix3, f64) {
        let J = F.determinant();
        let s = (theta / J).cbrt();
        let G = cofactor(F) / J;
        let P = self.stress(&(F * s));
        let PF = P.dot(F);
        (s * (P - PF / 3.0 * G), s * PF / (3.0 * theta))
    }
    /// All first and second derivatives of ψ̂.
    ///
    /// With G = F⁻ᵀ, Π = I − ⅓ F⊗G: ∂²ψ̂/∂F² = s² Πᵀ A Π + s (−⅓(P⊗G + G⊗P) + ⅑(P:F) G⊗G + ⅓(P:F) ∂G-term).
    fn mixed_tangent(&self, F: &Matrix3, theta: f64) -> Mixed {
        let J = F.determinant();
        let s = (theta / J).cbrt();
        let Fb = F * s;
        let G = cofactor(F) / J;
        let P = self.stress(&Fb);
        let A = self.tangent(&Fb);
        let PF = P.dot(F);
        let (f, g, p) = (flat(F), flat(&G), flat(&P));
        let Pi = Matrix9::identity() - f * g.transpose() / 3.0;
        let mut A_hat = Pi.transpose() * A * Pi * (s * s);
        A_hat += (p * g.transpose() + g * p.transpose()) * (-s / 3.0) + g * g.transpose() * (s * PF / 9.0);
        for (i, j, k, l) in all_indices() {
            A_hat[(i + 3 * j, k + 3 * l)] += s * PF / 3.0 * G[(i, l)] * G[(k, j)];
        }
        let AF = A * flat(&Fb);
        let P_hat = s * (P - PF / 3.0 * G);
        let P_theta = (P_hat + unflat(&(Pi.transpose() * AF)) * s) / (3.0 * theta);
        let p_theta = (flat(&Fb).dot(&AF) - 2.0 * s * PF) / (9.0 * theta * theta);
        Mixed { P: P_hat, p: s * PF / (3.0 * theta), A: A_hat, P_theta, p_theta }
    }
}

/// cof F = ∂(det F)/∂F.
#[inline]
pub fn cofactor(F: &Matrix3) -> Matrix3 {
    let (a, b, c) = (F.column(0), F.column(1), F.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// Adds `factor` ∂²(det F)/∂F∂F to `A`.
#[inline(never)]
pub fn add_det_hessian(A: &mut Matrix9, F: &Matrix3, factor: f64) {
    for (j, l, c, sign) in
        [(0, 1, 2, 1.0), (1, 2, 0, 1.0), (2, 0, 1, 1.0), (1, 0, 2, -1.0), (2, 1, 0, -1.0), (0, 2, 1, -1.0)]
    {
        // ∂(column j of cof F)/∂(column l) is ∓ the cross-product matrix of the third column.
        let (f, v) = (sign * factor, F.column(c));
        A[(3 * j, 3 * l + 1)] += f * v[2];
        A[(3 * j, 3 * l + 2)] -= f * v[1];
        A[(3 * j + 1, 3 * l)] -= f * v[2];
        A[(3 * j + 1, 3 * l + 2)] += f * v[0];
        A[(3 * j + 2, 3 * l)] += f * v[1];
        A[(3 * j + 2, 3 * l + 1)] -= f * v[0];
    }
}

#[inline(always)]
fn flat(M: &Matrix3) -> Vector9 {
    Vector9::from_column_slice(M.as_slice())
}

#[inline(always)]
fn unflat(v: &Vector9) -> Matrix3 {
    Matrix3::from_column_slice(v.as_slice())
}

fn all_indices() -> impl Iterator<Item = (usize, usize, usize, usize)> {
    (0..81).map(|n| (n % 3, n / 3 % 3, n / 9 % 3, n / 27))
}
