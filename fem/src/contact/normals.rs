//! Which side of a surface is outside.

use super::Contact;
use super::closest::{Closest, Feature};
use super::surface::{Surface, Surfaces};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Normals of triangles, edges and corners of one surface, by which a point is inside or outside: Bærentzen & Aanæs, Signed
/// distance computation using the angle weighted pseudonormal, IEEE Trans. Vis. Comput. Graph. 11 (2005).
pub(super) struct Normals {
    /// First triangle, edge and corner of the surface.
    first: [usize; 3],
    triangles: Vec<Vector3<f64>>,
    /// Sum over the triangles and their number; one triangle: the rim of an open surface.
    edges: Vec<(Vector3<f64>, usize)>,
    /// Sum over the triangles, weighted by angle, and whether it is on the rim.
    corners: Vec<(Vector3<f64>, bool)>,
    /// Sum over the triangles.
    samples: Vec<Vector3<f64>>,
}

impl Normals {
    pub(super) fn new(all: &Surfaces, s: &Surface, p: &[Vector3<f64>]) -> Normals {
        let first = [s.triangles.start, s.edges.start, s.samples.start];
        let mut triangles = Vec::with_capacity(s.triangles.len());
        let mut edges = vec![(Vector3::zeros(), 0); s.edges.len()];
        let mut corners = vec![(Vector3::zeros(), false); s.samples.len()];
        let mut samples = vec![Vector3::zeros(); s.samples.len()];
        for t in s.triangles.clone() {
            let at = all.triangles[t].map(|c| p[c as usize]);
            let normal = (at[1] - at[0]).cross(&(at[2] - at[0])).normalize();
            triangles.push(normal);
            all.triangle_samples[t].iter().for_each(|&p| samples[p as usize - first[2]] += normal);
            for e in all.triangle_edges[t] {
                let edge = &mut edges[e as usize - first[1]];
                *edge = (edge.0 + normal, edge.1 + 1);
            }
            for c in 0..3 {
                let (u, v) = (at[(c + 1) % 3] - at[c], at[(c + 2) % 3] - at[c]);
                corners[all.triangles[t][c] as usize - first[2]].0 += normal * u.angle(&v);
            }
        }
        for (e, _) in edges.iter().enumerate().filter(|(_, (_, n))| *n == 1) {
            all.edges[first[1] + e].points.iter().for_each(|&c| corners[c as usize - first[2]].1 = true);
        }
        Normals { first, triangles, edges, corners, samples }
    }

    /// Unit normal of a feature of a triangle, and whether it is the rim of an open surface, beyond which no side is inside: there
    /// the normal is that of the triangle.
    pub(super) fn of(&self, all: &Surfaces, triangle: u32, which: Feature) -> (Vector3<f64>, bool) {
        let t = triangle as usize;
        let own = self.triangles[t - self.first[0]];
        let (normal, rim) = match which {
            Feature::Face => (own, false),
            Feature::Edge(e) => {
                let (sum, n) = self.edges[all.triangle_edges[t][e as usize] as usize - self.first[1]];
                (sum, n == 1)
            }
            Feature::Vertex(v) => self.corners[all.triangles[t][v as usize] as usize - self.first[2]],
        };
        (if rim { own } else { normal.normalize() }, rim)
    }

    /// Unit normal of a triangle.
    pub(super) fn triangle(&self, t: u32) -> Vector3<f64> {
        self.triangles[t as usize - self.first[0]]
    }

    /// Unit normal of a sample, the mean over its triangles.
    pub(super) fn sample(&self, s: u32) -> Vector3<f64> {
        self.samples[s as usize - self.first[2]].normalize()
    }

    /// Unit normal of an edge; `None` on a rim.
    pub(super) fn edge(&self, e: u32) -> Option<Vector3<f64>> {
        let (sum, n) = self.edges[e as usize - self.first[1]];
        (n > 1).then(|| sum.normalize())
    }
}

impl Contact {
    /// Normals of all surfaces with the collision points at `p`.
    pub(super) fn normals(&self, p: &[Vector3<f64>]) -> Vec<Normals> {
        self.surfaces.list.par_iter().map(|s| Normals::new(&self.surfaces, s, p)).collect()
    }

    /// Whether two edges of two surfaces have passed each other between their ends: their shortest connection `closest`, from `f` to `e`,
    /// leads into the body of `f` and out of that of `e`.
    pub(super) fn have_crossed(&self, e: u32, f: u32, closest: &Closest, normals: &[Normals]) -> bool {
        let of = |edge: u32| self.surfaces.surface(self.surfaces.edges[edge as usize].points[0]);
        if of(e) == of(f) || closest.n_free < 2 {
            return false;
        }
        let (Some(n), Some(m)) = (normals[of(e)].edge(e), normals[of(f)].edge(f)) else { return false };
        n.dot(&m) < 0.0 && closest.w.dot(&m) < 0.0 && closest.w.dot(&n) > 0.0
    }
}
