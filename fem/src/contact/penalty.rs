//! Cheap contact: pressure in proportion to the depth of penetration, integrated over both surfaces.
//!
//! Π = ½ Σ over samples (area) ½ ε g² from both sides of a pair, g < 0 the signed distance of a sample to the other surface,
//! ε = stiffness / distance. No node meets a face: the samples lie as closely as the finer of the two meshes.
//!
//! An open surface ends at its rim. Samples a little beyond it still count, against the plane of the triangle there: rims that
//! lie on each other, as at planes of symmetry, would otherwise lose or keep their samples by round-off.

use super::Contact;
use super::candidates::Primitives;
use super::stencil::{Law, Stencil};
use crate::geometry::closest::{Closest, Points, combine, point_triangle};
use nalgebra::Vector3;

/// Fraction of the mean edge by which a sample may lie beside the rim of an open surface.
const ASIDE: f64 = 0.1;

impl Contact {
    /// Terms of all samples that lie inside a surface which they may not enter.
    pub(super) fn springs(&self, p: &[Vector3<f64>]) -> Vec<Stencil> {
        let all = &self.surfaces;
        let spring = |near: super::near::Near| {
            let [a, b, c] = all.triangles[near.triangle as usize];
            let scale = 0.5 * all.areas[near.point as usize] * self.stiffness(near.point, near.triangle)
                / self.distance;
            let x = self.triangle_points(near.point, near.triangle, p);
            let mut closest = point_triangle(&x);
            if closest.squared() > near.gap * near.gap * (1.0 + ROUND_OFF) {
                closest = point_plane(&x);
            }
            Stencil { points: [near.point, a, b, c], closest, scale, law: Law::Spring, edges: 0.0 }
        };
        self.near_within(p, Primitives::Samples, &|_, _| 0.0, self.view(), ASIDE * all.edge_length)
            .into_iter()
            .map(spring)
            .collect()
    }
}

/// Relative difference of squared distances that is none.
const ROUND_OFF: f64 = 1e-12;

/// Point x₀ and the plane of triangle (x₁, x₂, x₃).
fn point_plane(x: &Points) -> Closest {
    let (u, v, r) = (x[2] - x[1], x[3] - x[1], x[0] - x[1]);
    let (uu, uv, vv) = (u.norm_squared(), u.dot(&v), v.norm_squared());
    let det = uu * vv - uv * uv;
    let (s, t) = ((vv * u.dot(&r) - uv * v.dot(&r)) / det, (uu * v.dot(&r) - uv * u.dot(&r)) / det);
    let c = [1.0, s + t - 1.0, -s, -t];
    Closest { c, dc: [[0.0, 1.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]], n_free: 2, w: combine(&c, x) }
}
