//! Normals by which a point is inside or outside of a surface.

use nalgebra::Vector3;

use super::closest::Feature;

/// Normals of triangles, edges and corners of a surface. With these the sign of (point − closest point) · normal is right everywhere:
/// Bærentzen & Aanæs, Signed distance computation using the angle weighted pseudonormal, IEEE Trans. Vis. Comput. Graph. 11 (2005).
#[derive(Clone, Debug)]
pub struct PseudoNormals {
    triangles: Vec<Vector3<f64>>,
    /// Sum over the triangles and their number; one triangle: the rim of an open surface.
    edges: Vec<(Vector3<f64>, usize)>,
    /// Sum over the triangles, weighted by angle, and whether it is on the rim.
    corners: Vec<(Vector3<f64>, bool)>,
}

impl PseudoNormals {
    /// Of `triangles`, each by its corners and its edges (0 1), (1 2), (2 0); `ends` of the edges; where the corners are: `place` \[m\].
    pub fn new(
        triangles: impl Iterator<Item = ([usize; 3], [usize; 3])>,
        ends: &[[usize; 2]],
        n_corners: usize,
        place: impl Fn(usize) -> Vector3<f64>,
    ) -> PseudoNormals {
        let mut normals = Vec::with_capacity(triangles.size_hint().0);
        let mut edges = vec![(Vector3::zeros(), 0); ends.len()];
        let mut corners = vec![(Vector3::zeros(), false); n_corners];
        for (of_triangle, its_edges) in triangles {
            let at = of_triangle.map(&place);
            let normal = (at[1] - at[0]).cross(&(at[2] - at[0])).normalize();
            normals.push(normal);
            for e in its_edges {
                edges[e] = (edges[e].0 + normal, edges[e].1 + 1);
            }
            for c in 0..3 {
                let (u, v) = (at[(c + 1) % 3] - at[c], at[(c + 2) % 3] - at[c]);
                corners[of_triangle[c]].0 += normal * u.angle(&v);
            }
        }
        for (_, ends) in edges.iter().zip(ends).filter(|((_, n), _)| *n == 1) {
            ends.iter().for_each(|&c| corners[c].1 = true);
        }
        PseudoNormals { triangles: normals, edges, corners }
    }

    /// Unit normal of a triangle.
    pub fn triangle(&self, triangle: usize) -> Vector3<f64> {
        self.triangles[triangle]
    }

    /// Unit normal of a feature of a triangle with these corners and edges, and whether it is the rim of an open surface, beyond which no
    /// side is inside: there the normal is that of the triangle.
    pub fn of(
        &self,
        triangle: usize,
        corners: [usize; 3],
        edges: [usize; 3],
        which: Feature,
    ) -> (Vector3<f64>, bool) {
        let own = self.triangles[triangle];
        let (normal, rim) = match which {
            Feature::Face => (own, false),
            Feature::Edge(e) => {
                let (sum, n) = self.edges[edges[e as usize]];
                (sum, n == 1)
            }
            Feature::Vertex(v) => self.corners[corners[v as usize]],
        };
        (if rim { own } else { normal.normalize() }, rim)
    }
}
