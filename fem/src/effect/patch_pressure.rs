//! Follower pressure on a patch whose rim moves freely.
//!
//! The force on node a is p ∫ N_a n da over the patch as it is. With a free rim it is the gradient of no energy: its derivative is symmetric
//! inside the patch, but not along the rim. Schweizerhof & Ramm, Comput. Struct. 18 (1984) 1099.

use super::{Effect, Groups, Part, State, point};
use crate::element::shape;
use nalgebra::{Matrix3, Vector3};

/// Pressure on quadrilaterals; a triangle repeats its last node.
pub struct PatchPressure {
    groups: Groups,
    control: usize,
    rule: shape::Rule<4, 4, 2>,
}

impl PatchPressure {
    /// Name of the effect, but for the surface.
    pub const NAME: &str = "patch pressure on ";

    /// Pressure \[Pa\] held by the control with index `control` on `faces` (indices into `points` \[m\]), normals by the
    /// right-hand rule out of the solid.
    pub fn new(name: &str, control: usize, points: &[[f64; 3]], faces: &[[u32; 4]]) -> Self {
        let centroids = faces.iter().map(|f| super::mean(&f.map(|n| points[n as usize]))).collect();
        PatchPressure {
            groups: Groups::new(name, Part::Load, faces, centroids),
            control,
            rule: shape::quad4(),
        }
    }

    /// The tangents ∂x/∂ξ, ∂x/∂η at point `g` of a face.
    fn tangents(&self, face: usize, g: usize, x: &[f64]) -> [Vector3<f64>; 2] {
        let mut t = [Vector3::zeros(); 2];
        for (&n, dn) in self.groups.nodes::<4>(face).iter().zip(&self.rule.dn[g]) {
            t[0] += Vector3::from(point(x, n)) * dn[0];
            t[1] += Vector3::from(point(x, n)) * dn[1];
        }
        t
    }
}

impl Effect for PatchPressure {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn has_potential(&self) -> bool {
        false
    }

    fn energy(&self, _: &State) -> f64 {
        0.0
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (face, out) in (first..).zip(out.chunks_exact_mut(12)) {
            out.fill(0.0);
            for g in 0..4 {
                let [t1, t2] = self.tangents(face, g, s.x);
                let force = t1.cross(&t2) * (s.controls[self.control] * self.rule.w[g]);
                for a in 0..4 {
                    for i in 0..3 {
                        out[3 * a + i] += self.rule.n[g][a] * force[i];
                    }
                }
            }
        }
    }

    /// ∂f_a/∂x_b = p ∫ N_a (N_b,η [t₁]ₓ − N_b,ξ [t₂]ₓ), made symmetric. Indefinite by nature: convexity fades it out.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        out.fill(0.0);
        let p = (1.0 - convexity) * s.controls[self.control] / 2.0;
        for (face, out) in (first..).zip(out.chunks_exact_mut(144)) {
            for g in 0..4 {
                let [t1, t2] = self.tangents(face, g, s.x).map(|v| v.cross_matrix());
                for a in 0..4 {
                    let (na, [a1, a2]) = (self.rule.n[g][a], self.rule.dn[g][a]);
                    for b in 0..4 {
                        let (nb, [b1, b2]) = (self.rule.n[g][b], self.rule.dn[g][b]);
                        let k: Matrix3<f64> =
                            (t1 * (na * b2 - a2 * nb) + t2 * (a1 * nb - na * b1)) * (p * self.rule.w[g]);
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
