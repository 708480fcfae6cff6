//! Follower pressure on a surface, from the volume it encloses.
//!
//! Π = p/3 ∫ (x − o)·n da, n out of the solid: pressure times the volume behind the surface. Where the surface is closed,
//! or its rim is held, or its rim slides in planes through o, the gradient is the follower force p n da and nothing else.
//! Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., §8.5.

use super::{Effect, Groups, Part, State, point};
use crate::element::shape;
use nalgebra::{Matrix3, Vector3};

/// Pressure on quadrilaterals; a triangle repeats its last node.
pub struct Pressure {
    groups: Groups,
    control: usize,
    origin: Vector3<f64>,
    rule: shape::Rule<4, 4, 2>,
}

impl Pressure {
    /// Pressure \[Pa\] held by the control with index `control` on `faces` (indices into `points` \[m\]), normals by the
    /// right-hand rule out of the solid; `origin`: o \[m\].
    pub fn new(
        name: &str,
        control: usize,
        origin: [f64; 3],
        points: &[[f64; 3]],
        faces: Vec<[u32; 4]>,
    ) -> Self {
        let centroids = faces.iter().map(|f| super::mean(&f.map(|n| points[n as usize]))).collect();
        Pressure {
            groups: Groups::new(name, Part::Load, &faces, centroids),
            control,
            origin: origin.into(),
            rule: shape::quad4(),
        }
    }

    /// r = x − o and the tangents ∂x/∂ξ, ∂x/∂η at point `g` of a face.
    fn frame(&self, face: usize, g: usize, x: &[f64]) -> [Vector3<f64>; 3] {
        let (mut r, mut t1, mut t2) = (-self.origin, Vector3::zeros(), Vector3::zeros());
        for (a, &n) in self.groups.nodes::<4>(face).iter().enumerate() {
            let p = Vector3::from(point(x, n));
            r += p * self.rule.n[g][a];
            t1 += p * self.rule.dn[g][a][0];
            t2 += p * self.rule.dn[g][a][1];
        }
        [r, t1, t2]
    }
}

impl Effect for Pressure {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let mut volume = 0.0;
        for face in 0..self.groups.len() {
            for g in 0..4 {
                let [r, t1, t2] = self.frame(face, g, s.x);
                volume += self.rule.w[g] * r.dot(&t1.cross(&t2));
            }
        }
        s.controls[self.control] * volume / 3.0
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        let p = s.controls[self.control] / 3.0;
        for (face, out) in (first..).zip(out.chunks_exact_mut(12)) {
            out.fill(0.0);
            for g in 0..4 {
                let [r, t1, t2] = self.frame(face, g, s.x);
                let [c0, c1, c2] = [t1.cross(&t2), t2.cross(&r), r.cross(&t1)];
                for a in 0..4 {
                    let (n, [d1, d2]) = (self.rule.n[g][a], self.rule.dn[g][a]);
                    let f = (c0 * n + c1 * d1 + c2 * d2) * (p * self.rule.w[g]);
                    for i in 0..3 {
                        out[3 * a + i] += f[i];
                    }
                }
            }
        }
    }

    /// Indefinite by nature: convexity fades it out.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        out.fill(0.0);
        let p = (1.0 - convexity) * s.controls[self.control] / 3.0;
        for (face, out) in (first..).zip(out.chunks_exact_mut(144)) {
            for g in 0..4 {
                let [r, t1, t2] = self.frame(face, g, s.x).map(|v: Vector3<f64>| v.cross_matrix());
                let scale = p * self.rule.w[g];
                for a in 0..4 {
                    let (na, [a1, a2]) = (self.rule.n[g][a], self.rule.dn[g][a]);
                    for b in 0..4 {
                        let (nb, [b1, b2]) = (self.rule.n[g][b], self.rule.dn[g][b]);
                        let k: Matrix3<f64> =
                            (t1 * (na * b2 - a2 * nb) + t2 * (a1 * nb - na * b1) + r * (a2 * b1 - a1 * b2))
                                * scale;
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
