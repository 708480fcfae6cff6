//! Energy, nodal forces and stiffness of one solid element, for any shape and law.
//!
//! Plain:            Π = Σ_g w_g ψ(F_g)
//! Mean dilatation:  Π = Σ_g w_g ψ̂(F_g, θ),   θ = Σ_g w_g det F_g / V
//!
//! The second is the three-field element of constant pressure and dilatation with both eliminated; force and
//! stiffness are the exact derivatives of this energy, so the stiffness is symmetric.
//! Simo, Taylor & Pister, Comput Methods Appl Mech Eng 1985;51:177.

use crate::element::Rule;
use crate::element::principal::{Blocks, lifted_tangent};
use crate::element::psd::lift;
use crate::element::shape::contract;
use crate::material::{Jet, Material, Matrix3, Matrix9, Mixed, add_det_hessian, cofactor};

/// How the volume change enters an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Formulation {
    /// At every quadrature point.
    Plain,
    /// Through its mean over the element.
    MeanDilatation,
}

/// Reference geometry of one element: `N` nodes, `G` quadrature points.
#[derive(Clone, Debug)]
pub struct SolidElement<const N: usize, const G: usize> {
    /// ∂N_a/∂X at each point \[1/m\].
    pub dn: [[[f64; 3]; N]; G],
    /// Quadrature weight times det(∂X/∂ξ) at each point \[m³\].
    pub w: [f64; G],
    /// Reference volume \[m³\].
    pub volume: f64,
}

/// Lower blocks of the stiffness of one element: block (a, b), a ≥ b, holds ∂f_a/∂x_b, entry `3 i + k`.
type Stiffness<const N: usize> = [[[f64; 9]; N]; N];

impl<const N: usize, const G: usize> SolidElement<N, G> {
    /// Geometry of the element with reference nodes `X` \[m\]; `Err` holds det(∂X/∂ξ) where it is not positive.
    pub fn new(rule: &Rule<N, G, 3>, X: &[[f64; 3]; N]) -> Result<Self, f64> {
        let mut e = SolidElement { dn: [[[0.0; 3]; N]; G], w: [0.0; G], volume: 0.0 };
        for g in 0..G {
            let jacobian = contract(X, &rule.dn[g]); // ∂X_i/∂ξ_j
            let det = jacobian.determinant();
            if !(det > 0.0) {
                return Err(det);
            }
            let inverse = cofactor(&jacobian) / det; // ∂ξ_j/∂X_i
            for a in 0..N {
                let d = inverse * nalgebra::Vector3::from(rule.dn[g][a]);
                e.dn[g][a] = d.into();
            }
            e.w[g] = rule.w[g] * det;
            e.volume += e.w[g];
        }
        Ok(e)
    }

    /// Deformation gradient at point `g`.
    #[inline(always)]
    pub fn deformation_gradient(&self, g: usize, x: &[[f64; 3]; N]) -> Matrix3 {
        contract(x, &self.dn[g])
    }

    /// Mean volume ratio θ of the element.
    #[inline(always)]
    pub fn dilatation(&self, x: &[[f64; 3]; N]) -> f64 {
        (0..G).map(|g| self.w[g] * self.deformation_gradient(g, x).determinant()).sum::<f64>() / self.volume
    }

    /// Π \[J\]; `+∞` where the law is not defined.
    pub fn energy<L: Material>(&self, formulation: Formulation, law: &L, x: &[[f64; 3]; N]) -> f64 {
        match formulation {
            Formulation::Plain => {
                (0..G).map(|g| self.w[g] * law.energy(&self.deformation_gradient(g, x))).sum()
            }
            Formulation::MeanDilatation => {
                let theta = self.dilatation(x);
                (0..G).map(|g| self.w[g] * law.mixed_energy(&self.deformation_gradient(g, x), theta)).sum()
            }
        }
    }

    /// ∂Π/∂x_a \[N\] per node.
    pub fn gradient<L: Material>(
        &self,
        formulation: Formulation,
        law: &L,
        x: &[[f64; 3]; N],
    ) -> [[f64; 3]; N] {
        let mut f = [[0.0; 3]; N];
        match formulation {
            Formulation::Plain => {
                for g in 0..G {
                    let P = law.stress(&self.deformation_gradient(g, x)) * self.w[g];
                    scatter(&mut f, &P, &self.dn[g]);
                }
            }
            Formulation::MeanDilatation => {
                let theta = self.dilatation(x);
                let mut p = 0.0;
                for g in 0..G {
                    let (P, p_g) = law.mixed_stress(&self.deformation_gradient(g, x), theta);
                    scatter(&mut f, &(P * self.w[g]), &self.dn[g]);
                    p += self.w[g] * p_g;
                }
                p /= self.volume;
                for g in 0..G {
                    let cof = cofactor(&self.deformation_gradient(g, x)) * (p * self.w[g]);
                    scatter(&mut f, &cof, &self.dn[g]);
                }
            }
        }
        f
    }

    /// Deformation gradient, mean over the reference volume.
    pub fn mean_deformation_gradient(&self, x: &[[f64; 3]; N]) -> Matrix3 {
        let sum = (0..G).fold(Matrix3::zeros(), |sum, g| sum + self.deformation_gradient(g, x) * self.w[g]);
        sum / self.volume
    }

    /// Cauchy stress \[Pa\], mean over the current volume.
    pub fn mean_cauchy<L: Material>(&self, formulation: Formulation, law: &L, x: &[[f64; 3]; N]) -> Matrix3 {
        let theta = self.dilatation(x);
        let F: [Matrix3; G] = std::array::from_fn(|g| self.deformation_gradient(g, x));
        let mut sum = Matrix3::zeros();
        match formulation {
            Formulation::Plain => {
                for g in 0..G {
                    sum += law.stress(&F[g]) * F[g].transpose() * self.w[g];
                }
            }
            Formulation::MeanDilatation => {
                // p̄ cof F Fᵀ = p̄ J I.
                let mut p = 0.0;
                for g in 0..G {
                    let (P, p_g) = law.mixed_stress(&F[g], theta);
                    sum += P * F[g].transpose() * self.w[g];
                    p += p_g * self.w[g];
                }
                sum += Matrix3::identity() * (p * theta);
            }
        }
        sum / (theta * self.volume)
    }

    /// Overwrites `out`, 3N × 3N row-major, with ∂²Π/∂x∂x \[N/m\], less the fraction `convexity` of its negative
    /// curvatures, point by point.
    pub fn hessian<L: Material>(
        &self,
        formulation: Formulation,
        law: &L,
        x: &[[f64; 3]; N],
        convexity: f64,
        out: &mut [f64],
    ) {
        let k = &mut [[[0.0; 9]; N]; N];
        match formulation {
            Formulation::Plain => {
                for g in 0..G {
                    let F = self.deformation_gradient(g, x);
                    let A = plain_tangent(law, &F, convexity);
                    accumulate(k, &A, self.w[g], &self.dn[g]);
                }
            }
            Formulation::MeanDilatation => self.mixed_hessian(law, x, convexity, k),
        }
        for a in 0..N {
            for b in 0..=a {
                for i in 0..3 {
                    for j in 0..3 {
                        let (row, column) = (3 * a + i, 3 * b + j);
                        out[row * 3 * N + column] = k[a][b][3 * i + j];
                        out[column * 3 * N + row] = k[a][b][3 * i + j];
                    }
                }
            }
        }
    }

    /// Lower blocks of the stiffness of the mean-dilatation element:
    /// Σ w δF:(A + p̄ ∂²J):δF + 2 (Σ w P_θ:δF) δθ + (Σ w p_θ) δθ²,   δθ = Σ w cof F:δF / V,   p̄ = Σ w p / V.
    fn mixed_hessian<L: Material>(&self, law: &L, x: &[[f64; 3]; N], convexity: f64, k: &mut Stiffness<N>) {
        let theta = self.dilatation(x);
        let F: [Matrix3; G] = std::array::from_fn(|g| self.deformation_gradient(g, x));
        let at: [_; G] = std::array::from_fn(|g| Derivatives::new(law, &F[g], theta, convexity));
        let p = (0..G).map(|g| self.w[g] * at[g].p()).sum::<f64>() / self.volume;
        let (mut d_theta, mut coupling, mut p_theta) = ([[0.0; 3]; N], [[0.0; 3]; N], 0.0);
        for g in 0..G {
            let (A, P_theta, p_theta_g) = at[g].tangent(law, &F[g], theta, p, convexity);
            accumulate(k, &A, self.w[g], &self.dn[g]);
            scatter(&mut d_theta, &(cofactor(&F[g]) * (self.w[g] / self.volume)), &self.dn[g]);
            scatter(&mut coupling, &(P_theta * self.w[g]), &self.dn[g]);
            p_theta += self.w[g] * p_theta_g;
        }
        for a in 0..N {
            for i in 0..3 {
                let (t, h) = (d_theta[a][i], coupling[a][i] + p_theta * d_theta[a][i]);
                for b in 0..=a {
                    for j in 0..3 {
                        k[a][b][3 * i + j] += h * d_theta[b][j] + t * coupling[b][j];
                    }
                }
            }
        }
    }
}

/// f_a += P d_a.
fn scatter<const N: usize>(f: &mut [[f64; 3]; N], P: &Matrix3, d: &[[f64; 3]; N]) {
    for a in 0..N {
        for i in 0..3 {
            f[a][i] += P[(i, 0)] * d[a][0] + P[(i, 1)] * d[a][1] + P[(i, 2)] * d[a][2];
        }
    }
}

/// Derivatives of ψ̂(F, θ) at one point: over the invariants where its tangent will be made from principal stretches.
#[allow(clippy::large_enum_variant)] // eight of them, on the stack
pub(super) enum Derivatives {
    ByInvariants(Jet<4>),
    All(Mixed),
}

impl Derivatives {
    pub(super) fn new<L: Material>(law: &L, F: &Matrix3, theta: f64, convexity: f64) -> Derivatives {
        let jet = if convexity > 0.0 { law.by_invariants(F, Some(theta)) } else { None };
        jet.map_or_else(|| Derivatives::All(law.mixed_tangent(F, theta)), Derivatives::ByInvariants)
    }

    /// ∂ψ̂/∂θ \[Pa\].
    pub(super) fn p(&self) -> f64 {
        match self {
            Derivatives::ByInvariants(psi) => psi.g[3],
            Derivatives::All(mixed) => mixed.p,
        }
    }

    /// Second derivatives of ψ̂(F, θ) + p̄ det F less the fraction `convexity` of their negative curvatures, over F, F and θ, and θ.
    pub(super) fn tangent<L: Material>(
        &self,
        law: &L,
        F: &Matrix3,
        theta: f64,
        p: f64,
        convexity: f64,
    ) -> (Blocks, Matrix3, f64) {
        let mixed = match self {
            Derivatives::ByInvariants(psi) => match lifted_tangent(F, psi, p, convexity) {
                Some(tangent) => return tangent,
                None => &law.mixed_tangent(F, theta),
            },
            Derivatives::All(mixed) => mixed,
        };
        let Mixed { mut A, mut P_theta, mut p_theta, .. } = *mixed;
        add_det_hessian(&mut A, F, p);
        project(&mut A, &mut P_theta, &mut p_theta, convexity);
        (blocks(&A), P_theta, p_theta)
    }
}

/// ∂P/∂F less the fraction `convexity` of its negative curvatures.
pub(super) fn plain_tangent<L: Material>(law: &L, F: &Matrix3, convexity: f64) -> Blocks {
    if convexity > 0.0
        && let Some(psi) = law.by_invariants(F, None)
        && let Some((A, ..)) = lifted_tangent(F, &psi, 0.0, convexity)
    {
        return A;
    }
    let mut A = law.tangent(F);
    project(&mut A, &mut Matrix3::zeros(), &mut 0.0, convexity);
    blocks(&A)
}

fn blocks(A: &Matrix9) -> Blocks {
    let entry = |j, l, c| A[(c / 3 + 3 * j, c % 3 + 3 * l)];
    std::array::from_fn(|j| std::array::from_fn(|l| std::array::from_fn(|c| entry(j, l, c))))
}

/// Lower blocks of Σ w ∂N_a/∂X_j A_ijkl ∂N_b/∂X_l.
fn accumulate<const N: usize>(k: &mut Stiffness<N>, A: &Blocks, w: f64, d: &[[f64; 3]; N]) {
    let a = A.map(|row| row.map(|block| block.map(|a| w * a)));
    for n in 0..N {
        let mut t = [[0.0; 9]; 3];
        for j in 0..3 {
            for c in 0..9 {
                t[j][c] = a[j][0][c] * d[n][0] + a[j][1][c] * d[n][1] + a[j][2][c] * d[n][2];
            }
        }
        for m in n..N {
            let block = &mut k[m][n];
            for c in 0..9 {
                block[c] += d[m][0] * t[0][c] + d[m][1] * t[1][c] + d[m][2] * t[2][c];
            }
        }
    }
}

/// [`lift`] of the 10×10 matrix over (F, θ).
fn project(A: &mut Matrix9, P_theta: &mut Matrix3, p_theta: &mut f64, convexity: f64) {
    if convexity == 0.0 {
        return;
    }
    let mut m = [[0.0; 10]; 10];
    for c in 0..9 {
        m[c][..9].copy_from_slice(&A.data.0[c]);
        m[c][9] = P_theta[c];
        m[9][c] = P_theta[c];
    }
    m[9][9] = *p_theta;
    if lift(&mut m, convexity) {
        for c in 0..9 {
            A.data.0[c].copy_from_slice(&m[c][..9]);
            P_theta[c] = m[9][c];
        }
        *p_theta = m[9][9];
    }
}
