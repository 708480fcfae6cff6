//! Membranes: surfaces with thickness and in-plane stiffness, in plane stress.
//!
//! Π = Σ_g h A_g ψ(C_g),   C = FᵀF (2×2) of the in-plane deformation gradient F (3×2).
//! Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., §9.7 (membranes).

use super::{Effect, EffectKind, Groups, MembraneState, State, mean, point};
use crate::element::psd::lift;
use crate::element::shape::{Rule, contract};
use crate::material::membrane::MembraneLaw;
use nalgebra::Matrix3x2;
use rayon::prelude::*;

/// Membrane cells with `N` nodes and `G` quadrature points.
pub struct Membrane<const N: usize, const G: usize> {
    groups: Groups,
    law: MembraneLaw,
    thickness: f64,
    /// ∂N_a/∂X in an orthonormal basis of the tangent plane \[1/m\], at each point of each cell.
    dn: Vec<[[[f64; 2]; N]; G]>,
    /// Thickness times area of each point \[m³\].
    w: Vec<[f64; G]>,
}

impl<const N: usize, const G: usize> Membrane<N, G> {
    /// Cells with nodes `nodes` (indices into `points` \[m\]) and `thickness` \[m\]; `Err` names the first cell without
    /// area.
    pub fn new(
        name: &str,
        law: MembraneLaw,
        thickness: f64,
        rule: &Rule<N, G, 2>,
        points: &[[f64; 3]],
        nodes: Vec<[u32; N]>,
    ) -> Result<Self, usize> {
        let (mut all_dn, mut all_w, mut centroids) = (Vec::new(), Vec::new(), Vec::new());
        for (cell, n) in nodes.iter().enumerate() {
            let X = n.map(|n| points[n as usize]);
            let (mut dn, mut w) = ([[[0.0; 2]; N]; G], [0.0; G]);
            for g in 0..G {
                let tangents = contract(&X, &rule.dn[g]);
                let (t1, t2) = (tangents.column(0), tangents.column(1));
                let area = t1.cross(&t2).norm();
                if !(area > 0.0) {
                    return Err(cell);
                }
                // Basis e₁ ∥ t₁, e₂ ⟂ e₁ in the plane; ∂X/∂ξ = [[l, s], [0, area/l]].
                let l = t1.norm();
                let s = t1.dot(&t2) / l;
                for a in 0..N {
                    let [x, y] = rule.dn[g][a];
                    dn[g][a] = [x / l, (y - s * x / l) * l / area];
                }
                w[g] = rule.w[g] * area * thickness;
            }
            all_dn.push(dn);
            all_w.push(w);
            centroids.push(mean(&X));
        }
        let groups = Groups::new(name, EffectKind::Membrane, &nodes, centroids);
        Ok(Membrane { groups, law, thickness, dn: all_dn, w: all_w })
    }

    fn deformation_gradient(&self, cell: usize, g: usize, x: &[f64]) -> Matrix3x2<f64> {
        let nodes = self.groups.nodes::<N>(cell).map(|n| point(x, n));
        contract(&nodes, &self.dn[cell][g])
    }
}

/// ∂(det C)/∂F = 2 F cof C and cof C.
fn det_gradient(F: &Matrix3x2<f64>) -> (Matrix3x2<f64>, nalgebra::Matrix2<f64>) {
    let C = F.transpose() * F;
    let cof = nalgebra::Matrix2::new(C[(1, 1)], -C[(0, 1)], -C[(1, 0)], C[(0, 0)]);
    (F * cof * 2.0, cof)
}

fn invariants(F: &Matrix3x2<f64>) -> (f64, f64) {
    (F.norm_squared(), (F.transpose() * F).determinant())
}

impl<const N: usize, const G: usize> Effect for Membrane<N, G> {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let energies: Vec<f64> = (0..self.groups.len())
            .into_par_iter()
            .with_min_len(128)
            .map(|c| {
                (0..G)
                    .map(|g| {
                        let (i1, i2) = invariants(&self.deformation_gradient(c, g, s.x));
                        let psi = if self.law.admits(i2) { self.law.psi(i1, i2) } else { f64::INFINITY };
                        self.w[c][g] * psi
                    })
                    .sum()
            })
            .collect();
        energies.iter().sum()
    }

    /// h P Fᵀ is the tension times the current over the reference area.
    fn membrane_state(&self, s: &State, group: usize) -> Option<MembraneState> {
        let (mut reference, mut area, mut tension) = (0.0, 0.0, nalgebra::Matrix3::zeros());
        for g in 0..G {
            let F = self.deformation_gradient(group, g, s.x);
            let (i1, i2) = invariants(&F);
            let d = self.law.jet(i1, i2).g;
            let P = F * (2.0 * d[0]) + det_gradient(&F).0 * d[1];
            let w = self.w[group][g];
            reference += w / self.thickness;
            area += w / self.thickness * i2.sqrt();
            tension += P * F.transpose() * w;
        }
        Some(MembraneState { area_ratio: area / reference, tension: tension / area })
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (c, out) in (first..).zip(out.chunks_exact_mut(3 * N)) {
            out.fill(0.0);
            for g in 0..G {
                let F = self.deformation_gradient(c, g, s.x);
                let (i1, i2) = invariants(&F);
                let d = self.law.jet(i1, i2).g;
                let P = (F * (2.0 * d[0]) + det_gradient(&F).0 * d[1]) * self.w[c][g];
                for (out, dn) in out.chunks_exact_mut(3).zip(&self.dn[c][g]) {
                    for i in 0..3 {
                        out[i] += P[(i, 0)] * dn[0] + P[(i, 1)] * dn[1];
                    }
                }
            }
        }
    }

    /// ∂²i₂/∂F²: dF = 2 dF cof C + 4 (F:dF) F − 2 F dFᵀ F − 2 FFᵀ dF, with 4 F⊗F and the products of gradients.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        for (c, out) in (first..).zip(out.chunks_exact_mut(9 * N * N)) {
            out.fill(0.0);
            for g in 0..G {
                let F = self.deformation_gradient(c, g, s.x);
                let (i1, i2) = invariants(&F);
                let psi = self.law.jet(i1, i2);
                let (g2, cof) = det_gradient(&F);
                let B = F * F.transpose();
                let mut A = [[0.0; 6]; 6];
                for r in 0..6 {
                    let (i, j) = (r % 3, r / 3);
                    for q in 0..6 {
                        let (k, l) = (q % 3, q / 3);
                        let (a, b) = (2.0 * F[(i, j)], 2.0 * F[(k, l)]);
                        let mut v = psi.h[0][0] * a * b
                            + psi.h[0][1] * (a * g2[(k, l)] + g2[(i, j)] * b)
                            + psi.h[1][1] * g2[(i, j)] * g2[(k, l)]
                            + psi.g[1] * (a * b - 2.0 * F[(i, l)] * F[(k, j)]);
                        if j == l {
                            v -= 2.0 * psi.g[1] * B[(i, k)];
                        }
                        if i == k {
                            v += 2.0 * psi.g[1] * cof[(j, l)];
                            if j == l {
                                v += 2.0 * psi.g[0];
                            }
                        }
                        A[r][q] = v;
                    }
                }
                lift(&mut A, convexity);
                let w = self.w[c][g];
                for (a, da) in self.dn[c][g].iter().enumerate() {
                    for (b, db) in self.dn[c][g].iter().enumerate() {
                        for i in 0..3 {
                            for k in 0..3 {
                                let v = (A[i][k] * db[0] + A[i][k + 3] * db[1]) * da[0]
                                    + (A[i + 3][k] * db[0] + A[i + 3][k + 3] * db[1]) * da[1];
                                out[(3 * a + i) * 3 * N + 3 * b + k] += w * v;
                            }
                        }
                    }
                }
            }
        }
    }
}
