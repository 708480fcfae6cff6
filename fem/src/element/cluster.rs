//! Energy, nodal forces and stiffness of solid elements over any number of nodes, with one dilatation for all of them.
//!
//! Plain:            Π = Σ_g s_g w_g ψ(F_g)
//! Mean dilatation:  Π = Σ_g s_g w_g ψ̂(F_g, θ),   θ = Σ_g w_g det F_g / V,   V = Σ_g w_g
//!
//! over the quadrature points of all elements, s_g the factor of the element on its energy density. The places of the nodes of an element
//! are fixed means of those of others, x_a = Σ_m W_am x_m: forces and stiffness of an element are put together over its own nodes, then
//! f_m = Σ_a W_am f_a and K_mn = Σ_ab W_am K_ab W_bn. As in [`kernel`](super::kernel), they are the exact derivatives; of one element whose
//! nodes are their own this is that element.

use super::kernel::{Derivatives, Formulation, plain_tangent};
use super::principal::Blocks;
use crate::material::{Material, Matrix3, cofactor};
use nalgebra::DMatrix;

/// One element of a cluster.
#[derive(Clone, Debug)]
pub struct Part {
    /// Places in the cluster of the nodes that move it.
    pub nodes: Vec<u32>,
    /// Each of its own nodes as a mean of these, by their number in `nodes`; weights add up to one. Empty: its own nodes are these.
    pub means: Vec<Vec<(u32, f64)>>,
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
    /// ∂N/∂X of each of the element's own nodes \[1/m\]; they add up to zero.
    pub dn: Vec<[f64; 3]>,
}

/// Elements with one dilatation.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// The elements.
    pub parts: Vec<Part>,
    /// Reference volume of all \[m³\].
    pub volume: f64,
}

/// Elements of uniform strain are taken where their points feel every displacement of the nodes at least so well as all points of the elements
/// do: energy of strains at points is half of what it is in the elements, in the worst mode of all.
const FELT: f64 = 0.5;

/// Law of an element and the factor on its energy density.
pub type Scaled<L> = (L, f64);

impl Part {
    /// Where its own nodes are \[m\], from the first of the nodes that move it: round-off of their differences then grows with the size of the
    /// element and not with its distance from the origin.
    fn places(&self, x: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let first = x[self.nodes[0] as usize];
        let sides: Vec<[f64; 3]> =
            self.nodes.iter().map(|&n| std::array::from_fn(|i| x[n as usize][i] - first[i])).collect();
        if self.means.is_empty() {
            return sides;
        }
        let mean = |of: &Vec<(u32, f64)>| {
            of.iter()
                .fold([0.0; 3], |sum, &(m, w)| std::array::from_fn(|i| sum[i] + w * sides[m as usize][i]))
        };
        self.means.iter().map(mean).collect()
    }

    /// Number of its own nodes.
    fn n_own(&self) -> usize {
        if self.means.is_empty() { self.nodes.len() } else { self.means.len() }
    }

    /// The same as an element of uniform strain: one point, with the mean of its gradients over its volume (Flanagan & Belytschko, Int J Numer
    /// Methods Eng 17:679, 1981), over the nodes that move it.
    fn of_uniform_strain(&self) -> Part {
        let mut mean = vec![[0.0; 3]; self.n_own()];
        for sample in &self.samples {
            for (mean, dn) in mean.iter_mut().zip(&sample.dn) {
                (0..3).for_each(|c| mean[c] += sample.w / self.volume * dn[c]);
            }
        }
        let mut dn = vec![[0.0; 3]; self.nodes.len()];
        match self.means.is_empty() {
            true => dn = mean,
            false => {
                for (own, of) in mean.iter().zip(&self.means) {
                    of.iter().for_each(|&(m, w)| (0..3).for_each(|c| dn[m as usize][c] += w * own[c]));
                }
            }
        }
        let samples = vec![Sample { w: self.volume, dn }];
        Part { nodes: self.nodes.clone(), means: Vec::new(), samples, volume: self.volume }
    }

    /// F at every point.
    fn deformation_gradients(&self, x: &[[f64; 3]]) -> impl Iterator<Item = (&Sample, Matrix3)> {
        let places = self.places(x);
        self.samples.iter().map(move |sample| (sample, gradient_of(&places, &sample.dn)))
    }

    /// Least det F over its points.
    pub fn least_det_f(&self, x: &[[f64; 3]]) -> f64 {
        let least = |least: f64, det: f64| if det < least || det.is_nan() { det } else { least };
        self.deformation_gradients(x).map(|(_, F)| F.determinant()).fold(f64::INFINITY, least)
    }

    /// Mean of F over its reference volume.
    pub fn mean_deformation_gradient(&self, x: &[[f64; 3]]) -> Matrix3 {
        self.deformation_gradients(x).map(|(s, F)| F * s.w).sum::<Matrix3>() / self.volume
    }

    /// Its own mean volume ratio.
    pub fn dilatation(&self, x: &[[f64; 3]]) -> f64 {
        self.deformation_gradients(x).map(|(s, F)| s.w * F.determinant()).sum::<f64>() / self.volume
    }

    /// Adds what is summed over its own nodes to the nodes of the cluster that move them.
    fn hand_on(&self, own: &[[f64; 3]], out: &mut [[f64; 3]]) {
        if self.means.is_empty() {
            for (f, &n) in own.iter().zip(&self.nodes) {
                (0..3).for_each(|i| out[n as usize][i] += f[i]);
            }
            return;
        }
        for (f, mean) in own.iter().zip(&self.means) {
            for &(m, w) in mean {
                let out = &mut out[self.nodes[m as usize] as usize];
                (0..3).for_each(|i| out[i] += w * f[i]);
            }
        }
    }

    /// Adds the stiffness over its own nodes, lower blocks (a, b), a ≥ b, at `a m + b`, to that over the nodes of the cluster, row-major over
    /// `n` unknowns. `room`: for what is summed on the way.
    fn hand_on_stiffness(&self, own: &[[f64; 9]], n: usize, out: &mut [f64], room: &mut [Vec<[f64; 9]>; 2]) {
        let (m, movers) = (self.means.len(), self.nodes.len());
        if self.means.is_empty() {
            return self.add_lower(own, n, out);
        }
        // Columns first: a block of two means would go to sixty-four places at once.
        let [columns, lower] = room;
        columns.clear();
        columns.resize(m * movers, [0.0; 9]);
        lower.clear();
        lower.resize(movers * movers, [0.0; 9]);
        for a in 0..m {
            for b in 0..m {
                let block: [f64; 9] = match a >= b {
                    true => own[a * m + b],
                    false => std::array::from_fn(|e| own[b * m + a][3 * (e % 3) + e / 3]),
                };
                for &(q, w) in &self.means[b] {
                    let to = &mut columns[a * movers + q as usize];
                    (0..9).for_each(|e| to[e] += w * block[e]);
                }
            }
        }
        for a in 0..m {
            for &(p, w) in &self.means[a] {
                let p = p as usize;
                let from = &columns[a * movers..a * movers + p + 1];
                for (to, from) in lower[p * movers..p * movers + p + 1].iter_mut().zip(from) {
                    (0..9).for_each(|e| to[e] += w * from[e]);
                }
            }
        }
        self.add_lower(lower, n, out);
    }

    /// Adds lower blocks over the nodes that move it to a matrix over those of the cluster, row-major over `n` unknowns.
    fn add_lower(&self, lower: &[[f64; 9]], n: usize, out: &mut [f64]) {
        let movers = self.nodes.len();
        for p in 0..movers {
            for q in 0..=p {
                let (row, column) = (3 * self.nodes[p] as usize, 3 * self.nodes[q] as usize);
                for (e, value) in lower[p * movers + q].iter().enumerate() {
                    out[(row + e / 3) * n + column + e % 3] += value;
                    if p != q {
                        out[(column + e % 3) * n + row + e / 3] += value;
                    }
                }
            }
        }
    }
}

/// F of an element whose nodes are at `places`.
fn gradient_of(places: &[[f64; 3]], dn: &[[f64; 3]]) -> Matrix3 {
    let mut F = [[0.0; 3]; 3];
    for (place, dn) in places.iter().zip(dn).skip(1) {
        for j in 0..3 {
            for i in 0..3 {
                F[j][i] += (place[i] - places[0][i]) * dn[j];
            }
        }
    }
    F.into()
}

impl Cluster {
    /// With elements of uniform strain, an eighth of the points of hexahedra, where these feel well enough what moves its nodes; as it is where
    /// not. Elements are small beside what moves them, so their strain is nearly uniform; the modes in which it is not have no stiffness by
    /// themselves, and points of all elements of a cube leave none of its modes without.
    pub fn with_uniform_strain(self) -> Cluster {
        let parts = self.parts.iter().map(Part::of_uniform_strain).collect();
        let reduced = Cluster { parts, volume: self.volume };
        if reduced.felt() >= FELT * self.felt() { reduced } else { self }
    }

    /// How well its points feel what moves its nodes: the least eigenvalue but that of translations of Σ w b bᵀ, b the gradient at a point.
    fn felt(&self) -> f64 {
        let n = self.parts.iter().flat_map(|p| &p.nodes).max().map_or(0, |n| *n as usize + 1);
        let mut sum = DMatrix::<f64>::zeros(n, n);
        for part in &self.parts {
            let room = &mut vec![[0.0; 3]; n];
            for sample in &part.samples {
                room.fill([0.0; 3]);
                part.hand_on(&sample.dn, room);
                for &p in &part.nodes {
                    for &q in &part.nodes {
                        let (a, b) = (room[p as usize], room[q as usize]);
                        sum[(p as usize, q as usize)] += sample.w * (0..3).map(|c| a[c] * b[c]).sum::<f64>();
                    }
                }
            }
        }
        let mut eigenvalues: Vec<f64> = sum.symmetric_eigenvalues().iter().copied().collect();
        eigenvalues.sort_by(f64::total_cmp);
        eigenvalues.get(1).copied().unwrap_or(0.0)
    }

    /// θ at places `x` \[m\] of its nodes.
    pub fn dilatation(&self, x: &[[f64; 3]]) -> f64 {
        self.parts.iter().map(|part| part.volume * part.dilatation(x)).sum::<f64>() / self.volume
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
            let of = |(s, F): (&Sample, Matrix3)| {
                s.w * match formulation {
                    Formulation::Plain => law.energy(&F),
                    Formulation::MeanDilatation => law.mixed_energy(&F, theta),
                }
            };
            sum += scale * part.deformation_gradients(x).map(of).sum::<f64>();
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
        let mut own = Vec::new();
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            own.clear();
            own.resize(part.n_own(), [0.0; 3]);
            for (sample, F) in part.deformation_gradients(x) {
                let P = match formulation {
                    Formulation::Plain => law.stress(&F),
                    Formulation::MeanDilatation => {
                        let (P, p) = law.mixed_stress(&F, theta);
                        pressure += scale * sample.w * p;
                        P
                    }
                };
                scatter(&mut own, sample, &(P * (scale * sample.w)));
            }
            part.hand_on(&own, out);
        }
        if formulation == Formulation::MeanDilatation {
            let pressure = pressure / self.volume;
            for part in &self.parts {
                own.clear();
                own.resize(part.n_own(), [0.0; 3]);
                for (sample, F) in part.deformation_gradients(x) {
                    scatter(&mut own, sample, &(cofactor(&F) * (pressure * sample.w)));
                }
                part.hand_on(&own, out);
            }
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
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            for (sample, F) in part.deformation_gradients(x) {
                sum += scale * sample.w * law.mixed_stress(&F, theta).1;
            }
        }
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
        for (sample, F) in part.deformation_gradients(x) {
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
        let (mut k, mut own, mut room) = (Vec::new(), [Vec::new(), Vec::new()], Default::default());
        for (p, part) in self.parts.iter().enumerate() {
            let (law, scale) = law(p);
            let m = part.n_own();
            k.clear();
            k.resize(m * m, [0.0; 9]);
            for own in &mut own {
                own.clear();
                own.resize(m, [0.0; 3]);
            }
            for (sample, F) in part.deformation_gradients(x) {
                if !mixed {
                    accumulate(&mut k, &plain_tangent(&law, &F, convexity), scale * sample.w, &sample.dn);
                    continue;
                }
                // Of s ψ̂ + p̄ J = s (ψ̂ + (p̄/s) J).
                let at = Derivatives::new(&law, &F, theta, convexity);
                let (A, P_theta, p_theta_g) = at.tangent(&law, &F, theta, pressure / scale, convexity);
                let w = scale * sample.w;
                accumulate(&mut k, &A, w, &sample.dn);
                scatter(&mut own[0], sample, &(cofactor(&F) * (sample.w / self.volume)));
                scatter(&mut own[1], sample, &(P_theta * w));
                p_theta += w * p_theta_g;
            }
            part.hand_on_stiffness(&k, n, out, &mut room);
            if mixed {
                part.hand_on(&own[0], &mut d_theta);
                part.hand_on(&own[1], &mut coupling);
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

/// f_a += P ∂N_a/∂X.
fn scatter(f: &mut [[f64; 3]], sample: &Sample, P: &Matrix3) {
    for (f, dn) in f.iter_mut().zip(&sample.dn) {
        for i in 0..3 {
            f[i] += P[(i, 0)] * dn[0] + P[(i, 1)] * dn[1] + P[(i, 2)] * dn[2];
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
