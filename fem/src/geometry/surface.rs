//! A surface of triangles: its topology and its measures.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SurfaceError;
use crate::mesh::Mesh;

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Coordinates \[m\].
    pub points: Vec<[f64; 3]>,
    /// Point numbers of every triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// The triangles at an edge. A triangle runs along its edge k from its point k to its point k + 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Edge {
    /// The two points, the smaller number first.
    pub points: [u32; 2],
    /// Triangle, number of the edge in it, and whether it runs along the edge from the smaller number to the larger.
    pub sides: Vec<(u32, u8, bool)>,
}

impl Surface {
    /// The surface of quadrilaterals and triangles (a triangle repeats its last node), and the node of every point.
    ///
    /// A quadrilateral is cut along the diagonal of its smallest node number, however it is turned or seen: the two
    /// triangles are part of the model where the four nodes are not in one plane.
    pub fn from_faces(points: &[[f64; 3]], faces: &[[u32; 4]]) -> (Surface, Vec<u32>) {
        let nodes = crate::mesh::unique_nodes(faces.iter().flatten().copied());
        let number: BTreeMap<u32, u32> = nodes.iter().copied().zip(0..).collect();
        let mut triangles = Vec::with_capacity(2 * faces.len());
        for face in faces {
            triangles.extend(cut(*face).into_iter().flatten().map(|t| t.map(|n| number[&n])));
        }
        (Surface { points: nodes.iter().map(|&n| points[n as usize]).collect(), triangles }, nodes)
    }

    /// The named surface of a mesh, and the node of every point. See [`Surface::from_faces`].
    pub fn of_mesh(mesh: &Mesh, name: &str) -> Result<(Surface, Vec<u32>), crate::mesh::MeshError> {
        Ok(Surface::from_faces(&mesh.points, mesh.surface(name)?))
    }

    /// Corner coordinates of a triangle \[m\].
    pub fn corners(&self, triangle: usize) -> [Vector3<f64>; 3] {
        self.triangles[triangle].map(|p| Vector3::from(self.points[p as usize]))
    }

    /// Area vector of a triangle: half the cross product of two edges \[m²\].
    pub fn area_vector(&self, triangle: usize) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a)) / 2.0
    }

    /// Unit normal of every triangle; NaN where the area is zero.
    pub fn normals(&self) -> Vec<Vector3<f64>> {
        (0..self.triangles.len()).map(|t| self.area_vector(t)).map(|n| n / n.norm()).collect()
    }

    /// Sum of the triangle areas \[m²\].
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.area_vector(t).norm()).sum()
    }

    /// Enclosed volume \[m³\], by the divergence theorem; negative for inward normals, without meaning for an open surface.
    pub fn volume(&self) -> f64 {
        // Tetrahedra towards the middle of the box: no cancellation far from the origin.
        let (low, high) = self.bounds();
        let middle = (low + high) / 2.0;
        let signed = |t| {
            let [a, b, c] = self.corners(t).map(|p| p - middle);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..self.triangles.len()).map(signed).sum()
    }

    /// Smallest and largest coordinates of the points \[m\]; infinite the wrong way round for no points.
    pub fn bounds(&self) -> (Vector3<f64>, Vector3<f64>) {
        let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        self.points
            .iter()
            .map(|p| Vector3::from(*p))
            .fold(start, |(low, high), p| (low.inf(&p), high.sup(&p)))
    }

    /// No edge belongs to one triangle only, and there is a triangle.
    pub fn is_closed(&self) -> bool {
        !self.triangles.is_empty() && self.edges().iter().all(|e| e.sides.len() > 1)
    }

    /// Neighbour across each edge (k: from point k to k + 1) of every triangle. `None` at a border.
    ///
    /// Refuses an edge of more than two triangles.
    pub fn neighbours(&self) -> Result<Vec<[Option<u32>; 3]>, SurfaceError> {
        let mut neighbours = vec![[None; 3]; self.triangles.len()];
        for edge in self.edges() {
            match edge.sides[..] {
                [_] => {}
                [(t, i, _), (u, j, _)] => {
                    neighbours[t as usize][i as usize] = Some(u);
                    neighbours[u as usize][j as usize] = Some(t);
                }
                _ => return Err(self.crowded_edge(&edge)),
            }
        }
        Ok(neighbours)
    }

    /// Number of the component of every triangle and how many components there are; triangles that share a point
    /// belong together. Components are numbered in the order of their first triangles.
    pub fn components(&self) -> (Vec<u32>, usize) {
        let mut root: Vec<u32> = (0..).take(self.points.len()).collect();
        fn find(root: &mut [u32], mut i: u32) -> u32 {
            while root[i as usize] != i {
                root[i as usize] = root[root[i as usize] as usize];
                i = root[i as usize];
            }
            i
        }
        for t in &self.triangles {
            for &p in &t[1..] {
                let (a, b) = (find(&mut root, t[0]), find(&mut root, p));
                root[a.max(b) as usize] = a.min(b);
            }
        }
        let mut number = BTreeMap::new();
        let of = self.triangles.iter().map(|t| {
            let next = number.len() as u32;
            *number.entry(find(&mut root, t[0])).or_insert(next)
        });
        (of.collect::<Vec<_>>(), number.len())
    }

    /// This surface and another as one.
    pub fn with(mut self, other: &Surface) -> Surface {
        let first = self.points.len() as u32;
        self.points.extend(&other.points);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|p| p + first)));
        self
    }

    /// The surface of some triangles, and the old number of every point.
    pub fn subset(&self, triangles: &[u32]) -> (Surface, Vec<u32>) {
        let kept = triangles.iter().map(|&t| self.triangles[t as usize]);
        let old = crate::mesh::unique_nodes(kept.clone().flatten());
        let number: BTreeMap<u32, u32> = old.iter().copied().zip(0..).collect();
        let triangles = kept.map(|t| t.map(|p| number[&p])).collect();
        (Surface { points: old.iter().map(|&p| self.points[p as usize]).collect(), triangles }, old)
    }

    /// Every edge once, by its points.
    pub(super) fn edges(&self) -> Vec<Edge> {
        let mut sides: Vec<([u32; 2], u32, u8, bool)> = Vec::with_capacity(3 * self.triangles.len());
        for (t, corners) in (0..).zip(&self.triangles) {
            for k in 0..3u8 {
                let (p, q) = (corners[k as usize], corners[(k as usize + 1) % 3]);
                sides.push(([p.min(q), p.max(q)], t, k, p < q));
            }
        }
        sides.sort_unstable();
        let edge = |group: &[([u32; 2], u32, u8, bool)]| Edge {
            points: group[0].0,
            sides: group.iter().map(|&(_, t, k, forward)| (t, k, forward)).collect(),
        };
        sides.chunk_by(|a, b| a.0 == b.0).map(edge).collect()
    }

    pub(super) fn crowded_edge(&self, edge: &Edge) -> SurfaceError {
        SurfaceError::CrowdedEdge {
            triangles: edge.sides.iter().map(|s| s.0 as usize).collect(),
            at: self.points[edge.points[0] as usize],
        }
    }
}

/// The triangles of a face: one where the last node is repeated, else two along the diagonal of the smallest number.
pub(super) fn cut([a, b, c, d]: [u32; 4]) -> [Option<[u32; 3]>; 2] {
    if c == d {
        [Some([a, b, c]), None]
    } else if a.min(c) < b.min(d) {
        [Some([a, b, c]), Some([a, c, d])]
    } else {
        [Some([b, c, d]), Some([b, d, a])]
    }
}
