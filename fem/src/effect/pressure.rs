//! Follower pressure on a surface, from the volume that the surface sweeps.
//!
//! Π = p V, V the volume between where the surface is and where it is in the mesh, positive on the side of n, out of the solid; nodes
//! on its rim start from where their prescribed components have been moved to. The force is ∂Π/∂x_a = p ∫ N_a n da and nothing else, on the
//! rim too, so that the openings of the surface, as many as it has, carry none of it.
//!
//! It is the derivative of Π for every displacement δx that the rim may have if that lies in the strip which the rim sweeps, since
//! δV = ∫ δx·n da over the surface and the strips: where the surface is closed, where its rim is held, and where the rim slides in the
//! planes of its openings ([`plan`](crate::plan) refuses others). Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis,
//! 2nd ed., §8.5.

use super::{Effect, EffectKind, Groups, State, point};
use crate::element::shape::{self, contract};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// Pressure on quadrilaterals; a triangle repeats its last node.
pub struct Pressure {
    groups: Groups,
    control: usize,
    /// Nodes of each face in the mesh \[m\].
    X: Vec<[Vector3<f64>; 4]>,
    /// Nodes that are not free, with the projector onto the directions in which they are.
    rim: BTreeMap<u32, Matrix3<f64>>,
    rule: shape::Rule<4, 4, 2>,
}

impl Pressure {
    /// Name of the effect, but for the surface.
    pub const NAME: &str = "pressure on ";

    /// Pressure \[Pa\] held by the control with index `control` on `faces` (indices into `points` \[m\]), normals by the
    /// right-hand rule out of the solid; `rim`: the nodes of the rim, each with the projector onto the directions in which it is not
    /// prescribed.
    pub fn new(
        name: &str,
        control: usize,
        points: &[[f64; 3]],
        faces: Vec<[u32; 4]>,
        rim: BTreeMap<u32, Matrix3<f64>>,
    ) -> Self {
        let X: Vec<[Vector3<f64>; 4]> = faces.iter().map(|f| f.map(|n| points[n as usize].into())).collect();
        let centroids = faces.iter().map(|f| super::mean(&f.map(|n| points[n as usize]))).collect();
        Pressure {
            groups: Groups::new(name, EffectKind::Load, &faces, centroids),
            control,
            X,
            rim,
            rule: shape::quad4(),
        }
    }

    /// The tangents ∂x/∂ξ, ∂x/∂η at point `g` of a face with nodes at `x`.
    fn tangents(&self, g: usize, x: &[Vector3<f64>; 4]) -> [Vector3<f64>; 2] {
        let t = contract(&x.map(<[f64; 3]>::from), &self.rule.dn[g]);
        [t.column(0).into(), t.column(1).into()]
    }

    fn places(&self, face: usize, x: &[f64]) -> [Vector3<f64>; 4] {
        self.groups.nodes::<4>(face).map(|n| point(x, n).into())
    }

    /// How far the nodes of a face at `x` have gone of their own \[m\].
    fn displacements(&self, face: usize, x: &[Vector3<f64>; 4]) -> [Vector3<f64>; 4] {
        let nodes = self.groups.nodes::<4>(face);
        std::array::from_fn(|a| {
            let u = x[a] - self.X[face][a];
            self.rim.get(&nodes[a]).map_or(u, |free| free * u)
        })
    }
}

impl Effect for Pressure {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    /// The nodes on straight ways from T to t: V = ∫₀¹ ∫ u·(T₁ + s (t₁ − T₁)) × (T₂ + s (t₂ − T₂)) dξ dη ds.
    fn energy(&self, s: &State) -> f64 {
        let mut volume = 0.0;
        for face in 0..self.groups.len() {
            let x = self.places(face, s.x);
            let u = self.displacements(face, &x);
            for g in 0..4 {
                let ([t1, t2], [d1, d2]) = (self.tangents(g, &x), self.tangents(g, &u));
                let (T1, T2) = (t1 - d1, t2 - d2);
                let mixed = T1.cross(&d2) + d1.cross(&T2);
                let normal = T1.cross(&T2) + mixed / 2.0 + d1.cross(&d2) / 3.0;
                let u: Vector3<f64> = (0..4).map(|a| u[a] * self.rule.n[g][a]).sum();
                volume += self.rule.w[g] * u.dot(&normal);
            }
        }
        s.controls[self.control] * volume
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        let p = s.controls[self.control];
        for (face, out) in (first..).zip(out.chunks_exact_mut(12)) {
            let x = self.places(face, s.x);
            out.fill(0.0);
            for g in 0..4 {
                let [t1, t2] = self.tangents(g, &x);
                let normal = t1.cross(&t2) * (p * self.rule.w[g]);
                for a in 0..4 {
                    for i in 0..3 {
                        out[3 * a + i] += self.rule.n[g][a] * normal[i];
                    }
                }
            }
        }
    }

    /// The symmetric part of the derivative of the forces, face by face: what is not symmetric cancels between faces, and on the rim
    /// nothing that is not prescribed feels it. Indefinite by nature: convexity fades it out.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        out.fill(0.0);
        let p = (1.0 - convexity) * s.controls[self.control] / 2.0;
        for (face, out) in (first..).zip(out.chunks_exact_mut(144)) {
            let x = self.places(face, s.x);
            for g in 0..4 {
                let [t1, t2] = self.tangents(g, &x).map(|v: Vector3<f64>| v.cross_matrix());
                let scale = p * self.rule.w[g];
                for a in 0..4 {
                    let (na, [a1, a2]) = (self.rule.n[g][a], self.rule.dn[g][a]);
                    for b in 0..4 {
                        let (nb, [b1, b2]) = (self.rule.n[g][b], self.rule.dn[g][b]);
                        let k: Matrix3<f64> = (t1 * (na * b2 - a2 * nb) + t2 * (a1 * nb - na * b1)) * scale;
                        for i in 0..3 {
                            for j in 0..3 {
                                out[(3 * a + i) * 12 + 3 * b + j] += k[(i, j)];
                            }
                        }
                    }
                }
            }
        }
    }
}
