//! Cheap contact: pressure in proportion to the depth of penetration, integrated over both surfaces.
//!
//! Π = ½ Σ over samples (area) ½ ε g² from both sides of a pair, g < 0 the signed distance of a sample to the other surface,
//! ε = stiffness / distance. No node meets a face: the samples lie as closely as the finer of the two meshes.

use super::Contact;
use super::closest::point_triangle;
use super::stencil::{Law, Stencil};
use nalgebra::Vector3;

impl Contact {
    /// Terms of all samples that lie inside a surface which they may not enter.
    pub(super) fn springs(&self, p: &[Vector3<f64>]) -> Vec<Stencil> {
        let all = &self.surfaces;
        let spring = |near: super::start::Near| {
            let [a, b, c] = all.triangles[near.triangle as usize];
            let scale = 0.5 * all.areas[near.point as usize] * self.stiffness(near.point, a) / self.distance;
            let closest = point_triangle(&self.triangle_points(near.point, near.triangle, p));
            Stencil { points: [near.point, a, b, c], closest, scale, law: Law::Spring, edges: 0.0 }
        };
        self.near(p, 0.0).into_iter().map(spring).collect()
    }
}
