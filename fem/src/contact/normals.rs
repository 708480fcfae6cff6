//! Which side of a surface is outside.

use super::Contact;
use super::surface::{Surface, Surfaces};
use crate::geometry::closest::Feature;
use crate::geometry::normals::PseudoNormals;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Normals of one surface.
pub(super) struct Normals {
    /// First triangle, edge and corner of the surface.
    first: [usize; 3],
    pseudo: PseudoNormals,
    /// Sum over the triangles.
    samples: Vec<Vector3<f64>>,
}

impl Normals {
    pub(super) fn new(all: &Surfaces, s: &Surface, p: &[Vector3<f64>]) -> Normals {
        let first = [s.triangles.start, s.edges.start, s.samples.start];
        let ends: Vec<[usize; 2]> =
            all.edges[s.edges.clone()].iter().map(|e| e.points.map(|c| c as usize - first[2])).collect();
        let triangles = s.triangles.clone().map(|t| Normals::parts(first, all, t));
        let pseudo = PseudoNormals::new(triangles, &ends, s.samples.len(), |c| p[c + first[2]]);
        let mut samples = vec![Vector3::zeros(); s.samples.len()];
        for t in s.triangles.clone() {
            let normal = pseudo.triangle(t - first[0]);
            all.triangle_samples[t].iter().for_each(|&p| samples[p as usize - first[2]] += normal);
        }
        Normals { first, pseudo, samples }
    }

    /// Corners and edges of a triangle, counted from the first of the surface.
    fn parts(first: [usize; 3], all: &Surfaces, t: usize) -> ([usize; 3], [usize; 3]) {
        (
            all.triangles[t].map(|c| c as usize - first[2]),
            all.triangle_edges[t].map(|e| e as usize - first[1]),
        )
    }

    /// See [`PseudoNormals::of`].
    pub(super) fn of(&self, all: &Surfaces, triangle: u32, which: Feature) -> (Vector3<f64>, bool) {
        let (corners, edges) = Normals::parts(self.first, all, triangle as usize);
        self.pseudo.of(triangle as usize - self.first[0], corners, edges, which)
    }

    /// Unit normal of a triangle.
    pub(super) fn triangle(&self, t: u32) -> Vector3<f64> {
        self.pseudo.triangle(t as usize - self.first[0])
    }

    /// Unit normal of a sample, the mean over its triangles.
    pub(super) fn sample(&self, s: u32) -> Vector3<f64> {
        self.samples[s as usize - self.first[2]].normalize()
    }
}

impl Contact {
    /// Normals of all surfaces with the collision points at `p`.
    pub(super) fn normals(&self, p: &[Vector3<f64>]) -> Vec<Normals> {
        self.surfaces.list.par_iter().map(|s| Normals::new(&self.surfaces, s, p)).collect()
    }
}
