//! Energy, nodal forces and stiffness of solid elements over any number of nodes, with one dilatation for all of them.
//!
//! Plain:            Π = Σ_g s_g w_g ψ(F_g)
//! Mean dilatation:  Π = Σ_g s_g w_g ψ̂(F_g, θ),   θ = Σ_g w_g det F_g / V,   V = Σ_g w_g
//!
//! over the quadrature points of all elements, s_g the factor of the element on its energy density. The places of the nodes of an element
//! are fixed means of those of others, x_a = Σ_m W_am x_m, so that F_g = Σ_m x_m ⊗ B_gm with B_gm = Σ_a W_am ∂N_a/∂X. As in
//! [`kernel`](super::kernel), forces and stiffness are the exact derivatives; of one element whose nodes are their own this is that element.

use super::kernel::{Derivatives, Formulation, plain_tangent};
use super::principal::Blocks;
use crate::material::{Material, Matrix3, cofactor};

/// One element of a cluster.
#[derive(Clone, Debug)]
pub struct Part {
    /// Places in the cluster of the nodes that move it.
    pub nodes: Vec<u32>,
    /// Its quadrature points.
    pub samples: Vec<Sample>,
    /// Reference volume \[m³\].
    pub volume: f64,
}

/// One quadrature point.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Weight \[m³\].
    pub w: f64,
    /// ∂F/∂x of each node of the part \[1/m\]; they add up to zero.
    pub b: Vec<[f64; 3]>,
}

/// Elements with one dilatation.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// The elements.
    pub parts: Vec<Part>,
    /// Reference volume of all \[m³\].
    pub volume: f64,
}

/// Law of an element and the factor on its energy density.
pub type Scaled<L> = (L, f64);

impl Part {
    /// F at a point; from differences of places, as their round-off then grows with the size of the element and not with its distance from
    /// the origin.
    fn deformation_gradient(&self, sample: &Sample, x: &[[f64; 3]]) -> Matrix3 {
        let first = x[self.nodes[0] as usize];
        let mut F = [[0.0; 3]; 3];
        for (&n, b) in self.nodes.iter().zip(&sample.b).skip(1) {
            let side: [f64; 3] = std::array::from_fn(|i| x[n as usize][i] - first[i]);
            for j in 0..3 {
                for i in 0..3 {
                    F[j][i] += side[i] * b[j];
                }
            }
        }
        F.into()
    }

    /// Least det F over its points.
    pub fn least_det_f(&self, x: &[[f64; 3]]) -> f64 {
        let det = |s: &Sample| self.deformation_gradient(s, x).determinant();
        let least = |least: f64, det: f64| if det < least || det.is_nan() { det } else { least };
        self.samples.iter().map(det).fold(f64::INFINITY, least)
    }

    /// Mean of F over its reference volume.
    pub fn mean_deformation_gradient(&self, x: &[[f64; 3]]) -> Matrix3 {
        let sum = self.samples.iter().map(|s| self.deformation_gradient(s, x) * s.w).sum::<Matrix3>();
        sum / self.volume
    }

    /// Its own mean volume ratio.
    pub fn dilatation(&self, x: &[[f64; 3]]) -> f64 {
        let now = self.samples.iter().map(|s| s.w * self.deformation_gradient(s, x).determinant());
        now.sum::<f64>() / self.volume
    }
}

impl Cluster {
    /// Calls `see` with every quadrature point: its part and F there.
    fn each(&self, x: &[[f64; 3]], mut see: impl FnMut(usize, &Sample, Matrix3)) {
        for (p, part) in self.parts.iter().enumerate() {
            for sample in &part.samples {
                see(p, sample, part.deformation_gradient(sample, x));
            }
        }
    }

    /// θ at places `x` \[m\] of its nodes.
    pub fn dilatation(&self, x: &[[f64; 3]]) -> f64 {
        let mut now = 0.0;
        self.each(x, |_, s, F| now += s.w * F.determinant());
        now / self.volume
    }

    /// Π \[J\]; `+∞` where a law is not defined. `law`: of each part.
    pub fn energy<L: Material>(
        &self,
        formulation: Formulation,
        law: impl Fn(usize) -> Scaled<L>,
        x: &[[f64; 3]],
    ) -> f64 {
        let theta = match formulation {
            Formulation::Plain => f64::NAN,
            Formulation::MeanDilatation => self.dilatation(x),
        };
        let mut sum = 0.0;
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            let of = |s: &Sample| {
                let F = part.deformation_gradient(s, x);
                s.w * match formulation {
                    Formulation::Plain => law.energy(&F),
                    Formulation::MeanDilatation => law.mixed_energy(&F, theta),
                }
            };
            sum += scale * part.samples.iter().map(of).sum::<f64>();
        }
        sum
    }

    /// Overwrites `out` with ∂Π/∂x \[N\], 3 per node of the cluster.
    pub fn gradient<L: Material>(
        &self,
        formulation: Formulation,
        law: impl Fn(usize) -> Scaled<L>,
        x: &[[f64; 3]],
        out: &mut [f64],
    ) {
        out.fill(0.0);
        let out = out.as_chunks_mut::<3>().0;
        let theta = match formulation {
            Formulation::Plain => f64::NAN,
            Formulation::MeanDilatation => self.dilatation(x),
        };
        let mut pressure = 0.0;
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            for sample in &part.samples {
                let F = part.deformation_gradient(sample, x);
                let P = match formulation {
                    Formulation::Plain => law.stress(&F),
                    Formulation::MeanDilatation => {
                        let (P, p) = law.mixed_stress(&F, theta);
                        pressure += scale * sample.w * p;
                        P
                    }
                };
                scatter(out, part, sample, &(P * (scale * sample.w)));
            }
        }
        if formulation == Formulation::MeanDilatation {
            let pressure = pressure / self.volume;
            self.each(x, |p, sample, F| {
                scatter(out, &self.parts[p], sample, &(cofactor(&F) * (pressure * sample.w)));
            });
        }
    }

    /// p̄ = Σ s w ∂ψ̂/∂θ / V \[Pa\]: what answers to the volume of all parts together; 0 for the plain formulation.
    fn pressure<L: Material>(
        &self,
        formulation: Formulation,
        law: &impl Fn(usize) -> Scaled<L>,
        x: &[[f64; 3]],
    ) -> f64 {
        if formulation == Formulation::Plain {
            return 0.0;
        }
        let theta = self.dilatation(x);
        let mut sum = 0.0;
        self.each(x, |p, sample, F| {
            let (law, scale) = law(p);
            sum += scale * sample.w * law.mixed_stress(&F, theta).1;
        });
        sum / self.volume
    }

    /// Cauchy stress \[Pa\] of a part, mean over its current volume.
    pub fn mean_cauchy<L: Material>(
        &self,
        formulation: Formulation,
        law: impl Fn(usize) -> Scaled<L>,
        part: usize,
        x: &[[f64; 3]],
    ) -> Matrix3 {
        let (theta, pressure) = (self.dilatation(x), self.pressure(formulation, &law, x));
        let (of, part) = (law(part), &self.parts[part]);
        let mut sum = Matrix3::zeros();
        for sample in &part.samples {
            let F = part.deformation_gradient(sample, x);
            let P = match formulation {
                Formulation::Plain => of.0.stress(&F),
                Formulation::MeanDilatation => of.0.mixed_stress(&F, theta).0,
            };
            // p̄ cof F Fᵀ = p̄ J I.
            sum += (P * F.transpose() * of.1 + Matrix3::identity() * (pressure * F.determinant())) * sample.w;
        }
        sum / (part.dilatation(x) * part.volume)
    }

    /// Overwrites `out`, row-major over 3 unknowns of each node of the cluster, with ∂²Π/∂x∂x \[N/m\], less the fraction `convexity` of its
    /// negative curvatures, point by point: Σ w δF:(s A + p̄ ∂²J):δF + 2 (Σ s w P_θ:δF) δθ + (Σ s w p_θ) δθ².
    pub fn hessian<L: Material>(
        &self,
        formulation: Formulation,
        law: impl Fn(usize) -> Scaled<L>,
        x: &[[f64; 3]],
        convexity: f64,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        let n = 3 * x.len();
        let mixed = formulation == Formulation::MeanDilatation;
        let theta = if mixed { self.dilatation(x) } else { f64::NAN };
        let pressure = self.pressure(formulation, &law, x);
        let (mut d_theta, mut coupling) = (vec![[0.0; 3]; x.len()], vec![[0.0; 3]; x.len()]);
        let mut p_theta = 0.0;
        let mut k = Vec::new();
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            let m = part.nodes.len();
            k.clear();
            k.resize(m * m, [0.0; 9]);
            for sample in &part.samples {
                let F = part.deformation_gradient(sample, x);
                if !mixed {
                    accumulate(&mut k, &plain_tangent(&law, &F, convexity), scale * sample.w, &sample.b);
                    continue;
                }
                // Of s ψ̂ + p̄ J = s (ψ̂ + (p̄/s) J).
                let at = Derivatives::new(&law, &F, theta, convexity);
                let (A, P_theta, p_theta_g) = at.tangent(&law, &F, theta, pressure / scale, convexity);
                let w = scale * sample.w;
                accumulate(&mut k, &A, w, &sample.b);
                scatter(&mut d_theta, part, sample, &(cofactor(&F) * (sample.w / self.volume)));
                scatter(&mut coupling, part, sample, &(P_theta * w));
                p_theta += w * p_theta_g;
            }
            for a in 0..m {
                for b in 0..=a {
                    let (row, column) = (3 * part.nodes[a] as usize, 3 * part.nodes[b] as usize);
                    for (e, value) in k[a * m + b].iter().enumerate() {
                        out[(row + e / 3) * n + column + e % 3] += value;
                        if a != b {
                            out[(column + e % 3) * n + row + e / 3] += value;
                        }
                    }
                }
            }
        }
        if !mixed {
            return;
        }
        let (d_theta, coupling) = (d_theta.as_flattened(), coupling.as_flattened());
        for r in 0..n {
            let (t, h) = (d_theta[r], coupling[r] + p_theta * d_theta[r]);
            for c in 0..n {
                out[r * n + c] += h * d_theta[c] + t * coupling[c];
            }
        }
    }
}

/// f_m += P b_m.
fn scatter(f: &mut [[f64; 3]], part: &Part, sample: &Sample, P: &Matrix3) {
    for (&n, b) in part.nodes.iter().zip(&sample.b) {
        for i in 0..3 {
            f[n as usize][i] += P[(i, 0)] * b[0] + P[(i, 1)] * b[1] + P[(i, 2)] * b[2];
        }
    }
}

/// Lower blocks (a, b), a ≥ b, at `a m + b` of Σ w b_aj A_ijkl b_bl; entry `3 i + k` of each.
fn accumulate(k: &mut [[f64; 9]], A: &Blocks, w: f64, b: &[[f64; 3]]) {
    let m = b.len();
    let A = A.map(|row| row.map(|block| block.map(|a| w * a)));
    for n in 0..m {
        let mut t = [[0.0; 9]; 3];
        for j in 0..3 {
            for c in 0..9 {
                t[j][c] = A[j][0][c] * b[n][0] + A[j][1][c] * b[n][1] + A[j][2][c] * b[n][2];
            }
        }
        for a in n..m {
            let block = &mut k[a * m + n];
            for c in 0..9 {
                block[c] += b[a][0] * t[0][c] + b[a][1] * t[1][c] + b[a][2] * t[2][c];
            }
        }
    }
}
