//! Cheap contact: pressure in proportion to the depth of penetration, integrated over both surfaces.
//!
//! Π = ½ Σ over samples (area) ½ ε g² from both sides of a pair, g < 0 the signed distance of a sample to the other surface,
//! ε = stiffness / distance. No node meets a face: the samples lie as closely as the finer of the two meshes.

use super::Contact;
use super::closest::{Feature, feature, point_triangle};
use super::stencil::{Law, Stencil};
use nalgebra::Vector3;

impl Contact {
    /// Terms of a sample with triangles near it: one for each surface that it lies inside.
    pub(super) fn springs(&self, near: &[[u32; 2]], p: &[Vector3<f64>]) -> Vec<Stencil> {
        let all = &self.surfaces;
        let surface = |n: &[u32; 2]| all.surface(all.triangles[n[1] as usize][0]);
        near.chunk_by(|a, b| surface(a) == surface(b)).filter_map(|near| self.spring(near, p)).collect()
    }

    fn spring(&self, near: &[[u32; 2]], p: &[Vector3<f64>]) -> Option<Stencil> {
        let all = &self.surfaces;
        let squared = |n: &[u32; 2]| point_triangle(&self.triangle_points(n[0], n[1], p)).squared();
        let [s, t] = *near.iter().min_by(|a, b| squared(a).total_cmp(&squared(b)))?;
        let x = self.triangle_points(s, t, p);
        let closest = point_triangle(&x);
        if closest.squared() > self.largest_reach * self.largest_reach {
            return None;
        }
        let at = |t: u32| all.triangles[t as usize].map(|c| p[c as usize]);
        let normal = |t: u32| {
            let [a, b, c] = at(t);
            (b - a).cross(&(c - a)).normalize()
        };
        // The pseudonormal of the closest feature; a rim has no inside.
        let out = match feature(&x).0 {
            Feature::Face => normal(t),
            Feature::Edge(e) => {
                let edge = all.triangle_edges[t as usize][e as usize];
                let shared = near.iter().filter(|n| all.triangle_edges[n[1] as usize].contains(&edge));
                let normals: Vec<Vector3<f64>> = shared.map(|n| normal(n[1])).collect();
                if normals.len() < 2 {
                    return None;
                }
                normals.iter().sum()
            }
            Feature::Vertex(v) => {
                let corner = all.triangles[t as usize][v as usize];
                let mut sum = Vector3::zeros();
                for n in near {
                    if let Some(i) = all.triangles[n[1] as usize].iter().position(|&c| c == corner) {
                        let q = at(n[1]);
                        sum += normal(n[1]) * (q[(i + 1) % 3] - q[i]).angle(&(q[(i + 2) % 3] - q[i]));
                    }
                }
                sum
            }
        };
        if closest.w.dot(&out) >= 0.0 {
            return None;
        }
        let [a, b, c] = all.triangles[t as usize];
        let scale = 0.5 * all.areas[s as usize] * self.stiffness(s, a) / self.distance;
        Some(Stencil { points: [s, a, b, c], closest, scale, law: Law::Spring, edges: 0.0 })
    }
}
